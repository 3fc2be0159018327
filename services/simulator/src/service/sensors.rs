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
    delay: FrameDelay,
    under_way: VecDeque<LateFrame>,
}

/// A slow driver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameDelay {
    /// From the end of a frame until it is published (s).
    pub delay_s: f64,
    /// It is stamped as if it had been taken when it is published: what a driver does that does not know better.
    pub is_stamped_on_arrival: bool,
}

/// A frame that is not published yet.
struct LateFrame {
    arrives: Timestamp,
    sensor: usize,
    header: SampleHeader,
    ranges: Ranges,
}

/// What is in a frame.
enum Ranges {
    Cloud(Box<PointCloud>),
    Scan(Box<RangeScan>),
}

impl fmt::Debug for SensorService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SensorService({} sensors)", self.sinks.len())
    }
}

impl Service for SensorService {
    const PROGRAM: &'static str = "simulator";
    const REPLAYS: bool = false;

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
            delay: FrameDelay::default(),
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
            let late = match sinks.get_mut(frame.sensor) {
                Some(Sink::Cloud(_)) if delay.delay_s > 0.0 => {
                    let mut cloud = PointCloud::boxed();
                    rendered = rig.render_cloud(&frame, world, track, &mut cloud);
                    Some(Ranges::Cloud(cloud))
                }
                Some(Sink::Scan(_)) if delay.delay_s > 0.0 => {
                    let mut scan = Box::<RangeScan>::default();
                    rendered = rig.render_scan(&frame, world, track, &mut scan);
                    Some(Ranges::Scan(scan))
                }
                Some(Sink::Cloud(output)) => {
                    output.write(header, |cloud| {
                        rendered = rig.render_cloud(&frame, world, track, cloud);
                    });
                    None
                }
                Some(Sink::Scan(output)) => {
                    output.write(header, |scan| {
                        rendered = rig.render_scan(&frame, world, track, scan);
                    });
                    None
                }
                None => None,
            };
            if let Some(ranges) = late {
                under_way.push_back(LateFrame {
                    arrives: frame.end.plus_seconds(delay.delay_s),
                    sensor: frame.sensor,
                    header,
                    ranges,
                });
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

/// Copies what counts of a cloud.
fn copy(from: &PointCloud, to: &mut PointCloud) {
    to.origin = from.origin;
    to.first_point = from.first_point;
    to.range_min_m = from.range_min_m;
    to.range_max_m = from.range_max_m;
    to.range_sigma_m = from.range_sigma_m;
    to.len = from.len;
    let points = &from.points[..from.len as usize];
    to.points[..points.len()].clone_from_slice(points);
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

    /// Lets the drivers be slow from now on.
    pub fn delay_frames(&mut self, delay: FrameDelay) {
        self.delay = delay;
    }

    fn publish_late(&mut self, now: Timestamp) {
        while self.under_way.front().is_some_and(|late| late.arrives <= now)
            && let Some(mut late) = self.under_way.pop_front()
        {
            let shift_s = if self.delay.is_stamped_on_arrival {
                self.delay.delay_s
            } else {
                0.0
            };
            late.header.capture = late.header.capture.plus_seconds(shift_s);
            match (self.sinks.get_mut(late.sensor), late.ranges) {
                (Some(Sink::Cloud(output)), Ranges::Cloud(mut cloud)) => {
                    cloud.first_point = cloud.first_point.plus_seconds(shift_s);
                    output.write(late.header, |slot| copy(&cloud, slot));
                }
                (Some(Sink::Scan(output)), Ranges::Scan(mut scan)) => {
                    scan.first_beam = scan.first_beam.plus_seconds(shift_s);
                    output.send(late.header, &scan);
                }
                _ => {}
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
