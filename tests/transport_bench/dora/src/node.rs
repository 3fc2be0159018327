//! The ends of the hops of one process, which is a node of a dataflow.

use dora_node_api::dora_core::config::DataId;
use dora_node_api::{DoraNode, Event, EventStream, MetadataParameters, TryRecvError};
use jink_transport_chain::program::Ends;
use jink_transport_chain::{Fault, Incoming, Outgoing, StageArgs};
use rustix::process::{Signal, getpid, kill_process};
use std::time::Duration;

/// The name of each input and of each output.
pub const MESSAGE: &str = "message";

/// The ends of this process, as soon as all nodes of the dataflow are ready.
pub fn open(args: &StageArgs) -> Result<Ends, Fault> {
    let (node, events) = DoraNode::init_from_env()?;
    let Some(bytes) = args.bytes_out() else {
        return Ok((
            Some(Box::new(Inputs {
                events,
                _node: Some(node),
            })),
            None,
        ));
    };
    // The first node waits for nothing, but has to hear that it is to end.
    let (inputs, events) = match args.bytes_in() {
        Some(_) => (Some(Inputs { events, _node: None }), None),
        None => (None, Some(events)),
    };
    let outputs = Outputs {
        node,
        events,
        output: DataId::from(MESSAGE.to_owned()),
        bytes,
    };
    Ok((
        inputs.map(|inputs| Box::new(inputs) as Box<dyn Incoming>),
        Some(Box::new(outputs)),
    ))
}

/// Dora says that the dataflow is to end: the same as SIGTERM to this process.
fn end() -> Result<(), Fault> {
    kill_process(getpid(), Signal::TERM)?;
    Ok(())
}

/// What a node gets.
struct Inputs {
    events: EventStream,
    /// The last node has no outputs that would keep it.
    _node: Option<DoraNode>,
}

impl Incoming for Inputs {
    // However patient: dora has something to say when the dataflow ends, and would set a timer, in a thread of its own, for each
    // message that is waited for with patience.
    fn receive(&mut self, _patience: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), Fault> {
        match self.events.recv() {
            Some(Event::Input { data, .. }) => take((&data).try_into()?),
            Some(Event::Stop(_)) | None => end()?,
            Some(Event::NodeFailed {
                source_node_id,
                error,
                ..
            }) => return Err(format!("{source_node_id}: {error}").into()),
            Some(Event::Error(text)) => return Err(text.into()),
            Some(_) => {}
        }
        Ok(())
    }
}

/// What a node sends.
struct Outputs {
    node: DoraNode,
    /// What the first node has to hear.
    events: Option<EventStream>,
    output: DataId,
    bytes: usize,
}

impl Outgoing for Outputs {
    fn send(&mut self, fill: &mut dyn FnMut(&mut [u8])) -> Result<(), Fault> {
        let parameters = MetadataParameters::default();
        self.node
            .send_output_raw(self.output.clone(), parameters, self.bytes, fill)?;
        match self.events.as_mut().map(EventStream::try_recv) {
            Some(Ok(Event::Stop(_)) | Err(TryRecvError::Closed)) => end(),
            Some(Ok(Event::Error(text))) => Err(text.into()),
            _ => Ok(()),
        }
    }
}
