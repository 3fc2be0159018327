//! Virtual sensors as a process: frames rendered as soon as the pose at their end is known.

use crate::settings;
use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, Wake};
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::truth::SimTruth;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use jink_simulator::sensors::{Output as Kind, Pose, PoseTrack, SensorRig};
use jink_simulator::world::World;

/// Shortest distance between two poses of either source (s): dimensions the memory of poses.
const POSE_STEP_S: f64 = 0.004;

/// Whose pose the sensors hang on.
enum Carrier {
    Simulated(Input<SimTruth>),
    External(Input<VehicleState>),
}

/// Where a sensor's frames go.
enum Sink {
    Cloud(Output<PointCloud>),
    Scan(Output<RangeScan>),
}

/// The rendering of all configured sensors.
pub struct SensorService {
    world: World,
    rig: SensorRig,
    track: PoseTrack,
    carrier: Carrier,
    sinks: Vec<Sink>,
    newest: Timestamp,
}

impl Service for SensorService {
    const PROGRAM: &'static str = "simulator";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let needs = |what: &str, cause: String| StartError::Needs {
            what: what.to_owned(),
            cause,
        };
        let world = settings::world(ports.config())?;
        let specs = settings::sensors(ports)?;
        let rig = SensorRig::new(&specs, ports.config().simulation.seed)
            .map_err(|error| needs("the sensors", error.to_string()))?;
        if rig.is_empty() {
            return Err(needs(
                "a sensor",
                "the configuration has no [[sensor]]".to_owned(),
            ));
        }
        let mut sinks = Vec::new();
        for (name, output) in rig.outputs() {
            sinks.push(match output {
                Kind::Cloud => Sink::Cloud(ports.output_of(topics::RANGE_CLOUD, name)?),
                Kind::Scan => Sink::Scan(ports.output_of(topics::RANGE_SCAN, name)?),
            });
        }
        let external = ports
            .setup()
            .arguments
            .iter()
            .any(|argument| argument == "external");
        let carrier = if external {
            Carrier::External(ports.trigger(topics::VEHICLE_STATE)?.needed())
        } else {
            Carrier::Simulated(ports.trigger(topics::SIM_TRUTH)?.needed())
        };
        Ok(Self {
            track: PoseTrack::new(rig.longest_frame_s() + 0.2, POSE_STEP_S),
            world,
            rig,
            carrier,
            sinks,
            newest: Timestamp::NEVER,
        })
    }

    fn cycle(&mut self, _cycle: &mut Cycle<'_>) -> Wake {
        self.take_poses();
        // The rig is switched on with the first pose: its frames count from there.
        if !self.newest.is_set() {
            return Wake::on_data();
        }
        while let Some(frame) = self.rig.next_due(self.newest) {
            let header = SampleHeader {
                capture: frame.end,
                ..SampleHeader::default()
            }
            .derived(Stage::Sensor, frame.end);
            let Self {
                rig,
                world,
                track,
                sinks,
                ..
            } = self;
            let mut rendered = Ok(());
            match sinks.get_mut(frame.sensor) {
                Some(Sink::Cloud(output)) => {
                    output.write(header, |cloud| {
                        rendered = rig.render_cloud(&frame, world, track, cloud);
                    });
                }
                Some(Sink::Scan(output)) => {
                    output.write(header, |scan| {
                        rendered = rig.render_scan(&frame, world, track, scan);
                    });
                }
                None => {}
            }
            if let Err(error) = rendered {
                tracing::error!("a frame was not rendered: {error}");
            }
        }
        self.rig.advance(self.newest, &self.world, &self.track);
        Wake::on_data()
    }
}

impl SensorService {
    fn take_poses(&mut self) {
        let Self {
            track,
            newest,
            carrier,
            ..
        } = self;
        let mut take = |time: Timestamp, pose: Pose| {
            if time > *newest {
                *newest = time;
                track.push(time, pose);
            }
        };
        match carrier {
            Carrier::Simulated(truth) => truth.each(|truth| {
                take(
                    truth.header.capture,
                    Pose {
                        position: truth.position,
                        attitude: truth.attitude.rotation(),
                    },
                );
            }),
            Carrier::External(state) => state.each(|state| {
                if state.position_valid.is_set() {
                    take(
                        state.header.capture,
                        Pose {
                            position: state.position,
                            attitude: state.attitude.rotation(),
                        },
                    );
                }
            }),
        }
    }
}
