//! iceoryx2 as it comes: one topic and one event per hop, nothing of jink's but the size of its samples.
#![allow(unsafe_code)]

use crate::samples::Sample;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::listener::ListenerWaitError;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{Config, FileName, Path, SemanticString, ServiceName, SignalHandlingMode, ipc};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{ApprovedTrajectory, Route, Trajectory};
use jink_shared_types::ranges::PointCloud;
use jink_transport_chain::{Fault, Incoming, Outgoing, StageArgs};
use std::time::Duration;

/// Begins the names of the shared memory of a chain in `folder`.
pub fn prefix(folder: &std::path::Path) -> String {
    let name = folder
        .file_name()
        .and_then(|name| name.to_str())
        .unwrap_or("chain");
    format!("{name}-")
}

/// A process of the chain, known to the others by the files in its folder.
fn node(args: &StageArgs) -> Result<Node<ipc::Service>, Fault> {
    let mut config = Config::default();
    let root = args.folder.join("iceoryx2");
    let root = root.to_str().ok_or("the folder is no text")?;
    config
        .global
        .set_root_path(&Path::new(root.as_bytes()).map_err(fault)?);
    config.global.prefix = FileName::new(prefix(&args.folder).as_bytes()).map_err(fault)?;
    NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(fault)
}

fn fault(error: impl std::fmt::Debug) -> Fault {
    format!("iceoryx2: {error:?}").into()
}

struct Out<T: Sample + 'static> {
    publisher: Publisher<ipc::Service, T, ()>,
    notifier: Notifier<ipc::Service>,
    message: usize,
    _node: Node<ipc::Service>,
}

impl<T: Sample> Outgoing for Out<T> {
    fn send(&mut self, fill: &mut dyn FnMut(&mut [u8])) -> Result<(), Fault> {
        let mut loan = self.publisher.loan_uninit().map_err(fault)?;
        // SAFETY: the memory is mapped and as long as a `T`, of which every bit pattern is valid and the kernel has initialised every byte.
        let sample = unsafe {
            fill(std::slice::from_raw_parts_mut(
                loan.payload_mut().as_mut_ptr().cast::<u8>(),
                self.message,
            ));
            loan.assume_init()
        };
        sample.send().map_err(fault)?;
        self.notifier.notify().map_err(fault)?;
        Ok(())
    }
}

struct In<T: Sample + 'static> {
    subscriber: Subscriber<ipc::Service, T, ()>,
    listener: Listener<ipc::Service>,
    message: usize,
    _node: Node<ipc::Service>,
}

impl<T: Sample> Incoming for In<T> {
    fn receive(&mut self, patience: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), Fault> {
        match self.listener.timed_wait(|_| {}, patience) {
            // A signal: the chain ends.
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => {}
            Err(error) => return Err(fault(error)),
        }
        // Of more than one the newest counts, as for jink's services.
        let mut newest = None;
        while let Some(sample) = self.subscriber.receive().map_err(fault)? {
            newest = Some(sample);
        }
        if let Some(sample) = newest {
            let bytes = jink_shared_types::layout::bytes_of(&*sample);
            take(&bytes[..self.message]);
        }
        Ok(())
    }
}

/// What a hop consists of: its samples, and the event that announces them.
struct Hop<T: Sample + 'static> {
    node: Node<ipc::Service>,
    samples: publish_subscribe::PortFactory<ipc::Service, T, ()>,
    events: event::PortFactory<ipc::Service>,
}

impl<T: Sample + 'static> Hop<T> {
    fn open(args: &StageArgs, hop: usize) -> Result<Self, Fault> {
        let node = node(args)?;
        let name = ServiceName::new(&format!("hop/{hop}")).map_err(fault)?;
        let samples = node.service_builder(&name).publish_subscribe::<T>();
        let events = node.service_builder(&name).event();
        Ok(Self {
            samples: samples.open_or_create().map_err(fault)?,
            events: events.open_or_create().map_err(fault)?,
            node,
        })
    }
}

fn out<T: Sample + 'static>(
    args: &StageArgs,
    hop: usize,
    message: usize,
) -> Result<Box<dyn Outgoing>, Fault> {
    let hop = Hop::<T>::open(args, hop)?;
    Ok(Box::new(Out {
        publisher: hop.samples.publisher_builder().create().map_err(fault)?,
        notifier: hop.events.notifier_builder().create().map_err(fault)?,
        message,
        _node: hop.node,
    }))
}

fn incoming<T: Sample + 'static>(
    args: &StageArgs,
    hop: usize,
    message: usize,
) -> Result<Box<dyn Incoming>, Fault> {
    let hop = Hop::<T>::open(args, hop)?;
    Ok(Box::new(In {
        subscriber: hop.samples.subscriber_builder().create().map_err(fault)?,
        listener: hop.events.listener_builder().create().map_err(fault)?,
        message,
        _node: hop.node,
    }))
}

/// The end of hop `hop` that sends, with the type of its sample.
pub fn publisher(args: &StageArgs, hop: usize, message: usize) -> Result<Box<dyn Outgoing>, Fault> {
    match hop {
        0 => out::<PointCloud>(args, hop, message),
        1 => out::<LocalMap>(args, hop, message),
        2 => out::<Route>(args, hop, message),
        3 => out::<Trajectory>(args, hop, message),
        _ => out::<ApprovedTrajectory>(args, hop, message),
    }
}

/// The end that reads.
pub fn subscriber(args: &StageArgs, hop: usize, message: usize) -> Result<Box<dyn Incoming>, Fault> {
    match hop {
        0 => incoming::<PointCloud>(args, hop, message),
        1 => incoming::<LocalMap>(args, hop, message),
        2 => incoming::<Route>(args, hop, message),
        3 => incoming::<Trajectory>(args, hop, message),
        _ => incoming::<ApprovedTrajectory>(args, hop, message),
    }
}
