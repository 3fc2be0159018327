//! Virtual sensors as a process: frames rendered as soon as the pose at their end is known.

use super::settings;
use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, Wake};
use jink_shared_types::frames::{Attitude, LocalNed, Point};
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::truth::SimTruth;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use jink_simulated_world::sensors::{Output as Kind, Pose, PoseTrack, SensorRig};
use jink_simulated_world::world::World;
use std::collections::{BTreeSet, VecDeque};
use std::fmt;

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
    silent: BTreeSet<usize>,
    delay: ScanDelay,
    under_way: VecDeque<LateScan>,
}

/// A slow driver of scans. Clouds are not delayed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScanDelay {
    /// From the end of a scan until it is published (s).
    pub delay_s: f64,
    /// It is stamped as if it had been taken when it is published: what a driver does that does not know better.
    pub is_stamped_on_arrival: bool,
}

/// A scan that is not published yet.
struct LateScan {
    arrives: Timestamp,
    sensor: usize,
    header: SampleHeader,
    scan: Box<RangeScan>,
}

impl fmt::Debug for SensorService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SensorService({} sensors)", self.sinks.len())
    }
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
        for (name, output, rate_hz) in rig.outputs() {
            sinks.push(match output {
                Kind::Cloud => Sink::Cloud(ports.range_output(topics::RANGE_CLOUD, name, rate_hz)?),
                Kind::Scan => Sink::Scan(ports.range_output(topics::RANGE_SCAN, name, rate_hz)?),
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
            silent: BTreeSet::new(),
            delay: ScanDelay::default(),
            under_way: VecDeque::new(),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        self.take_poses();
        // The rig is switched on with the first pose: its frames count from there.
        if !self.newest.is_set() {
            return Wake::on_data();
        }
        while let Some(frame) = self.rig.next_due(self.newest) {
            if self.silent.contains(&frame.sensor) {
                continue;
            }
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
                delay,
                under_way,
                ..
            } = self;
            let mut rendered = Ok(());
            match sinks.get_mut(frame.sensor) {
                Some(Sink::Cloud(output)) => {
                    output.write(header, |cloud| {
                        rendered = rig.render_cloud(&frame, world, track, cloud);
                    });
                }
                Some(Sink::Scan(_)) if delay.delay_s > 0.0 => {
                    let mut scan = Box::<RangeScan>::default();
                    rendered = rig.render_scan(&frame, world, track, &mut scan);
                    under_way.push_back(LateScan {
                        arrives: frame.end.plus_seconds(delay.delay_s),
                        sensor: frame.sensor,
                        header,
                        scan,
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
        self.publish_late(cycle.now);
        Wake::at(
            self.under_way
                .front()
                .map_or(Timestamp::from_ns(u64::MAX), |late| late.arrives),
        )
    }
}

impl SensorService {
    /// Puts another world in the place of the one there is: something in it has moved.
    pub fn move_world(&mut self, world: World) {
        self.world = world;
    }

    /// Lets sensors, by their numbers, fall silent: what a dead driver looks like to the rest. The others go on.
    pub fn silence(&mut self, sensors: &BTreeSet<usize>) {
        self.silent.clone_from(sensors);
    }

    /// Lets the drivers of scans be slow from now on.
    pub fn delay_scans(&mut self, delay: ScanDelay) {
        self.delay = delay;
    }

    fn publish_late(&mut self, now: Timestamp) {
        while self.under_way.front().is_some_and(|late| late.arrives <= now)
            && let Some(mut late) = self.under_way.pop_front()
        {
            if self.delay.is_stamped_on_arrival {
                late.header.capture = late.header.capture.plus_seconds(self.delay.delay_s);
                late.scan.first_beam = late.scan.first_beam.plus_seconds(self.delay.delay_s);
            }
            if let Some(Sink::Scan(output)) = self.sinks.get_mut(late.sensor) {
                output.send(late.header, &late.scan);
            }
        }
    }

    fn take_poses(&mut self) {
        let Self {
            track,
            newest,
            carrier,
            ..
        } = self;
        // Without an attitude there is no pose to render from.
        let mut take = |time: Timestamp, position: Point<LocalNed>, attitude: Attitude| {
            if let Some(attitude) = attitude.rotation().filter(|_| time > *newest) {
                *newest = time;
                track.push(time, Pose { position, attitude });
            }
        };
        match carrier {
            Carrier::Simulated(truth) => truth.each(|truth| {
                take(truth.header.capture, truth.position, truth.attitude);
            }),
            Carrier::External(state) => state.each(|state| {
                if state.position_valid.is_set() {
                    take(state.header.capture, state.position, state.attitude);
                }
            }),
        }
    }
}
