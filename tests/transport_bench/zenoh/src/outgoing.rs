//! The ends of a hop that messages go into.

use crate::hop::{self, Kind};
use bytes::{Bytes, BytesMut};
use jink_transport_chain::{Fault, Outgoing, StageArgs};
use zenoh::bytes::ZBytes;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::shm::{
    AllocAlignment, BlockOn, GarbageCollect, PosixShmProviderBackend, ShmProvider, ShmProviderBuilder,
};
use zenoh::{Session, Wait};

/// Messages that fit into the shared memory of a hop: one is filled, one is read, and two wait.
const MESSAGES: usize = 4;
/// Shared memory that is taken up by more than messages, for each of them (bytes).
const AROUND_BYTES: usize = 4096;

/// What a process publishes.
struct Publication {
    // Dropped before the session.
    publisher: Publisher<'static>,
    _session: Session,
}

impl Publication {
    fn new(args: &StageArgs, kind: Kind, bytes: usize) -> Result<Publication, Fault> {
        let session = hop::connect(args, kind, bytes)?;
        let publisher = session
            .declare_publisher(hop::key(args.place))
            .express(true)
            .priority(Priority::RealTime)
            .congestion_control(CongestionControl::Block)
            .reliability(Reliability::Reliable)
            .wait()?;
        Ok(Publication {
            publisher,
            _session: session,
        })
    }

    fn put(&self, message: impl Into<ZBytes>) -> Result<(), Fault> {
        self.publisher.put(message).wait()
    }
}

/// Messages go through a socket.
pub struct Sockets {
    publication: Publication,
    /// The memory of the last message, for the next one.
    memory: Bytes,
    bytes: usize,
}

impl Sockets {
    /// Publishes messages of `bytes` bytes.
    pub fn new(args: &StageArgs, kind: Kind, bytes: usize) -> Result<Sockets, Fault> {
        Ok(Sockets {
            publication: Publication::new(args, kind, bytes)?,
            memory: BytesMut::zeroed(bytes).freeze(),
            bytes,
        })
    }
}

impl Outgoing for Sockets {
    fn send(&mut self, fill: &mut dyn FnMut(&mut [u8])) -> Result<(), Fault> {
        // Zenoh has copied the last one to its socket, and so gives it back, or still has it.
        let last = std::mem::take(&mut self.memory);
        let mut memory = last
            .try_into_mut()
            .unwrap_or_else(|_| BytesMut::zeroed(self.bytes));
        fill(&mut memory);
        self.memory = memory.freeze();
        self.publication.put(self.memory.clone())
    }
}

/// Messages are in shared memory.
pub struct Memory {
    publication: Publication,
    provider: ShmProvider<PosixShmProviderBackend>,
    bytes: usize,
}

impl Memory {
    /// Publishes messages of `bytes` bytes.
    pub fn new(args: &StageArgs, bytes: usize) -> Result<Memory, Fault> {
        let all_bytes = MESSAGES * (bytes + AROUND_BYTES);
        let provider = ShmProviderBuilder::default_backend((all_bytes, AllocAlignment::ALIGN_8_BYTES))
            .wait()
            .map_err(|error| format!("zenoh gets no {all_bytes} bytes of shared memory: {error}"))?;
        Ok(Memory {
            publication: Publication::new(args, Kind::Memory, bytes)?,
            provider,
            bytes,
        })
    }
}

impl Outgoing for Memory {
    fn send(&mut self, fill: &mut dyn FnMut(&mut [u8])) -> Result<(), Fault> {
        let mut message = self
            .provider
            .alloc((self.bytes, AllocAlignment::ALIGN_8_BYTES))
            .with_policy::<BlockOn<GarbageCollect>>()
            .wait()
            .map_err(|error| format!("no shared memory for a message: {error:?}"))?;
        fill(&mut message);
        self.publication.put(message)
    }
}
