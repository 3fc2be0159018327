//! Removes what dead processes have left in shared memory, in a thread of its own: it may take seconds, and nothing that is supervised
//! waits for it.

use jink_runtime::cleanup::sweep;
use jink_runtime::realtime::{Scheduling, schedule};
use jink_runtime::{Instance, cleanup};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

/// After a death the memory is swept a second time: what is left of a start that was cut short cannot be distinguished from a start
/// under way before that.
const AGAIN: Duration = Duration::from_secs(cleanup::BEING_CREATED.as_secs() + 5);

/// The thread.
#[derive(Debug)]
pub struct Sweeper(SyncSender<()>);

impl Sweeper {
    /// Starts it, for `instance`.
    pub fn start(instance: &Instance) -> std::io::Result<Self> {
        let (requests, incoming) = sync_channel(1);
        let instance = instance.clone();
        std::thread::Builder::new()
            .name("sweeper".to_owned())
            .spawn(move || sweep_on_request(&instance, &incoming))?;
        Ok(Self(requests))
    }

    /// Something has died.
    pub fn request(&self) {
        // One that is waiting is enough.
        let _waiting_already = self.0.try_send(());
    }
}

fn sweep_on_request(instance: &Instance, incoming: &Receiver<()>) {
    // It began with the supervisor's own precedence, if that has any.
    if let Err(error) = schedule(0, Scheduling::Ordinary) {
        tracing::debug!("the sweeper keeps its scheduling: {error}");
    }
    while let Ok(()) = incoming.recv() {
        sweep(instance);
        loop {
            match incoming.recv_timeout(AGAIN) {
                Ok(()) => {
                    sweep(instance);
                }
                Err(RecvTimeoutError::Timeout) if sweep(instance).left > 0 => {}
                Err(RecvTimeoutError::Timeout) => break,
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }
}
