//! The memory behind a publisher's samples, where they are large.
//!
//! A file in shared memory has as many pages as were written to. A page that is not there when it is written, because others have
//! taken the rest, ends the process by SIGBUS. So pages are taken beforehand (`fallocate`), which does not touch them: those of the
//! samples that the services need at the start, those of others before a sample is filled for the first time.
//!
//! iceoryx2 hands out the slot that was given back last, at first slot 0, 1, 2: slot n is used only while n others are.

use crate::instance::Instance;
use crate::open_error::OpenError;
use crate::room;
use std::fs::File;

/// The file, and how much of it is there.
pub(crate) struct Pool {
    topic: String,
    file: File,
    /// Size of the file (bytes).
    bytes: u64,
    /// Address of the first slot.
    first: usize,
    /// A slot is a little more: the headers.
    payload_bytes: usize,
    slots: usize,
    /// Slots whose memory is there.
    taken: usize,
}

impl Pool {
    /// The file of publisher `id`; its `slots` begin at address `first`.
    pub(crate) fn find(
        instance: &Instance,
        id: u128,
        topic: &str,
        first: usize,
        payload_bytes: usize,
        slots: usize,
    ) -> Option<Self> {
        let end = format!("_{id}.data");
        let path = instance.memory_files().find(|path| {
            let name = path.file_name().unwrap_or_default();
            name.to_str().is_some_and(|name| name.ends_with(&end))
        })?;
        let file = File::options().write(true).open(path).ok()?;
        Some(Self {
            topic: topic.to_owned(),
            bytes: file.metadata().ok()?.len(),
            file,
            first,
            payload_bytes,
            slots,
            taken: 0,
        })
    }

    /// Takes the memory of the first `slots`.
    pub(crate) fn take(&mut self, slots: usize) -> Result<(), OpenError> {
        // What comes before the slots, and the headers in between, are reckoned from the end: rather a page too much than one too little.
        let others = self.slots.saturating_sub(slots) * self.payload_bytes;
        room::take(&self.file, self.bytes.saturating_sub(others as u64), &self.topic)?;
        self.taken = slots;
        Ok(())
    }

    /// Whether the memory of the slot at `payload` is there, or could be had.
    pub(crate) fn holds(&mut self, payload: *const u8) -> bool {
        // Headers make less than a slot of all slots together: what is large is 64 KiB at least.
        let slot = payload.addr().saturating_sub(self.first) / self.payload_bytes.max(1);
        slot < self.taken || self.take(slot + 1).is_ok()
    }
}
