//! The end of a hop that messages come out of.

use crate::hop::{self, Kind};
use jink_transport_chain::{Fault, Incoming, StageArgs};
use std::time::Duration;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

/// What a process has subscribed to.
pub struct Subscription {
    // Dropped before the session.
    subscriber: Subscriber<FifoChannelHandler<Sample>>,
    /// For messages that come in pieces: a process needs its sample as one.
    whole: Vec<u8>,
    is_shared: bool,
    _session: Session,
}

impl Subscription {
    /// Subscribes to what passes hop `hop`, messages of `bytes` bytes.
    pub fn new(args: &StageArgs, kind: Kind, hop: usize, bytes: usize) -> Result<Subscription, Fault> {
        let session = hop::listen(args, kind, hop, bytes)?;
        let subscriber = session.declare_subscriber(hop::key(hop)).wait()?;
        Ok(Subscription {
            subscriber,
            whole: Vec::with_capacity(bytes),
            is_shared: kind == Kind::Memory,
            _session: session,
        })
    }
}

impl Incoming for Subscription {
    fn receive(&mut self, patience: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), Fault> {
        let Some(sample) = self.subscriber.recv_timeout(patience)? else {
            return Ok(());
        };
        let message = sample.payload();
        if self.is_shared && message.as_shm().is_none() {
            return Err("a message came through the socket instead of shared memory".into());
        }
        let mut pieces = message.slices();
        match (pieces.next(), pieces.next()) {
            (Some(piece), None) => take(piece),
            _ => {
                self.whole.clear();
                message
                    .slices()
                    .for_each(|piece| self.whole.extend_from_slice(piece));
                take(&self.whole);
            }
        }
        Ok(())
    }
}
