//! The file descriptors the loop sleeps on: a topic's wake-ups, next to sockets and serial ports.
#![allow(unsafe_code)]

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::{FileDescriptorBased, ipc};
use std::os::fd::BorrowedFd;

/// Wakes the loop when a topic has a new sample.
pub(crate) struct Wakeup {
    listener: Listener<ipc::Service>,
}

impl Wakeup {
    pub(crate) fn new(listener: Listener<ipc::Service>) -> Self {
        Self { listener }
    }

    /// Readable when there is something new.
    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the listener owns the descriptor and keeps it open as long as it lives, which the borrow enforces.
        unsafe { BorrowedFd::borrow_raw(self.listener.file_descriptor().native_handle()) }
    }

    /// Takes what has been signalled, so that the next sample wakes again.
    pub(crate) fn clear(&self) {
        // An error here means a wake-up less, not data lost: samples are fetched from their own queue.
        let _signals = self.listener.try_wait(|_| {});
    }
}
