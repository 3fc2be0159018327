//! The recorder as a process.

use crate::carrier::CarrierThread;
use crate::topic_recorder::TopicRecorder;
use jink_runtime::{Cycle, Ports, Service, StartError, Wake};

/// How often topics are looked at (Hz): of the fastest, which has 250 samples a second, those of a tenth of a second wait.
const LOOK_HZ: u32 = 50;
/// How often the carrying of logs is judged where nothing is recorded (Hz).
const JUDGE_HZ: u32 = 2;

/// The service: see [`crate`].
#[derive(Debug)]
pub struct RecorderService {
    topics: Option<TopicRecorder>,
    carrier: CarrierThread,
}

impl Service for RecorderService {
    const PROGRAM: &'static str = "recorder";
    const REPLAYS: bool = false;

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let folder = ports.config().recorder.folder.as_deref();
        let topics = folder.map(|folder| TopicRecorder::begin(ports, folder, Self::PROGRAM));
        let carrier = CarrierThread::begin(&ports.setup().instance, ports.config());
        Ok(Self {
            topics: topics.transpose()?,
            carrier: carrier.map_err(|error| StartError::Needs {
                what: "a thread that carries logs".to_owned(),
                cause: error.to_string(),
            })?,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        if let Some(event) = self.carrier.judge() {
            cycle.events.publish(cycle.now, &event);
        }
        let hz = match &mut self.topics {
            Some(topics) => {
                topics.look(cycle);
                LOOK_HZ
            }
            None => JUDGE_HZ,
        };
        Wake::at(cycle.now.next_beat(hz))
    }
}
