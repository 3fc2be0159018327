//! Range sensors rendered in a world: what a vehicle with these sensors would have measured there.
//!
//! | in | out |
//! |---|---|
//! | sensor specs, seed | [`SensorRig`] |
//! | the time | [`Frame`]s that have just ended |
//! | a frame, the world, the track of poses | a point cloud or a range scan, written in place |
//!
//! ```
//! use jink_simulated_world::sensors::{Output, Pose, PoseTrack, SensorRig, SensorSpec};
//! use jink_simulated_world::world::{World, WorldKind};
//! use jink_shared_types::ranges::{PointCloud, RangeScan};
//! use jink_shared_types::{Point, Timestamp};
//!
//! let world = World::generate(WorldKind::Gap, 1)?;
//! let mut rig = SensorRig::new(&SensorSpec::default_rig(), 1)?;
//! let mut track = PoseTrack::new(rig.longest_frame_s(), 0.004);
//! let (mut cloud, mut scan) = (PointCloud::boxed(), RangeScan::default());
//! for step in 1..=100 {
//!     let now = Timestamp::from_ns(step * 4_000_000);
//!     track.push(now, Pose::level(Point::new(0.01 * step as f64, 0.0, -2.5), 0.0));
//!     while let Some(frame) = rig.next_due(now) {
//!         match frame.output {
//!             Output::Cloud => rig.render_cloud(&frame, &world, &track, &mut cloud)?,
//!             Output::Scan => rig.render_scan(&frame, &world, &track, &mut scan)?,
//!         }
//!     }
//! }
//! assert_eq!(cloud.points().len(), 20_000);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Rays start at the mounted sensor and meet obstacles and ground; the vehicle itself is never in the way.
//! Rendering allocates nothing. Each sensor draws from its own random stream, so that one more or less leaves the
//! others alone.

mod depth;
mod error;
mod head;
mod kind;
mod lidar;
mod pattern;
mod pose;
mod products;
mod scan;
mod spec;

#[cfg(test)]
mod tests;

pub use error::{RenderError, SensorError};
pub use kind::SensorKind;
pub use pose::{Pose, PoseCursor, PoseTrack};
pub use spec::{NoReturn, SensorSpec};

use crate::world::World;
use depth::DepthCamera;
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{PointCloud, RangeScan};
use lidar::Lidar3d;
use scan::{Lidar2d, Rangefinder};

/// Limits of a sensor's rate (Hz): a point's offset counts at most 65,535 steps of 10 us, 0.655 s; and nothing here
/// is meant for physics-rate sensing.
const RATE_HZ: [f64; 2] = [2.0, 200.0];

/// Which sample a sensor renders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// A point cloud.
    Cloud,
    /// A range scan.
    Scan,
}

/// One frame of one sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Index of the sensor in the rig.
    pub sensor: usize,
    /// What it renders.
    pub output: Output,
    /// When the first ray is measured.
    pub begin: Timestamp,
    /// When the frame is complete: the sample's `capture`. Equal to `begin` for sensors that see all at once.
    pub end: Timestamp,
}

/// The sensors of one vehicle.
#[derive(Clone, Debug)]
pub struct SensorRig {
    sensors: Vec<Sensor>,
    /// When the rig was switched on: the first time it was asked what is due.
    start: Option<Timestamp>,
}

impl SensorRig {
    /// The rig of `specs`; `seed` gives all noise.
    ///
    /// # Errors
    /// The first mistake in the specs, [`SensorError`].
    pub fn new(specs: &[SensorSpec], seed: u64) -> Result<Self, SensorError> {
        for (index, spec) in specs.iter().enumerate() {
            if specs[..index].iter().any(|other| other.name == spec.name) {
                return Err(SensorError::NameTwice {
                    name: spec.name.clone(),
                });
            }
        }
        let sensors = specs
            .iter()
            .map(|spec| Sensor::new(spec, seed))
            .collect::<Result<_, _>>()?;
        Ok(Self { sensors, start: None })
    }

    /// How many sensors there are.
    pub fn len(&self) -> usize {
        self.sensors.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.sensors.is_empty()
    }

    /// Name of a sensor.
    pub fn name(&self, sensor: usize) -> Option<&str> {
        self.sensors.get(sensor).map(|s| s.name.as_str())
    }

    /// Names, outputs and rates (Hz) of all sensors, by index: what topics to open.
    pub fn outputs(&self) -> impl Iterator<Item = (&str, Output, f64)> {
        self.sensors
            .iter()
            .map(|s| (s.name.as_str(), s.output(), 1e9 / s.period_ns as f64))
    }

    /// Longest frame (s): what a [`PoseTrack`] must cover.
    pub fn longest_frame_s(&self) -> f64 {
        let longest_ns = self.sensors.iter().map(|s| s.period_ns).max();
        longest_ns.unwrap_or(0) as f64 * 1e-9
    }

    /// The earliest frame that has ended by `now` and was not handed out before; ask until there is none. The first
    /// call switches the rig on: frames begin and end at multiples of their period on the clock, so that two rigs of the
    /// same specs, switched on at different times, measure the same frames and one can take the other's place.
    pub fn next_due(&mut self, now: Timestamp) -> Option<Frame> {
        let start = *self.start.get_or_insert(now);
        let (index, end) = self
            .sensors
            .iter()
            .enumerate()
            .map(|(index, sensor)| (index, sensor.next_end(start)))
            .min_by_key(|(_, end)| *end)
            .filter(|(_, end)| *end <= now)?;
        let sensor = self.sensors.get_mut(index)?;
        sensor.frames += 1;
        Some(Frame {
            sensor: index,
            output: sensor.output(),
            begin: if sensor.takes_its_period() {
                Timestamp::from_ns(end.ns - sensor.period_ns)
            } else {
                end
            },
            end,
        })
    }

    /// Measures what sweeps under way have passed by `now`, at most up to the last pose of the track, so that little is
    /// left to do when they end. Frames come out the same to the bit, with it or without.
    pub fn advance(&mut self, now: Timestamp, world: &World, track: &PoseTrack) {
        let (Some(start), Some(mut poses)) = (self.start, track.cursor()) else {
            return;
        };
        for sensor in &mut self.sensors {
            let end = sensor.next_end(start);
            if let Model::Lidar3d(lidar) = &mut sensor.model {
                let begin = Timestamp::from_ns(end.ns - sensor.period_ns);
                lidar.advance(world, &mut poses, [begin, end], now);
            }
        }
    }

    /// Renders a frame of a sensor that makes clouds. Points are in the body frame as it stood at their own time.
    ///
    /// # Errors
    /// [`RenderError`]; `out` is then unchanged.
    pub fn render_cloud(
        &mut self,
        frame: &Frame,
        world: &World,
        track: &PoseTrack,
        out: &mut PointCloud,
    ) -> Result<(), RenderError> {
        let sensor = self.sensor(frame)?;
        let mut poses = track.cursor().ok_or(RenderError::NoPose)?;
        match &mut sensor.model {
            Model::Lidar3d(lidar) => lidar.render(world, &mut poses, frame.begin, frame.end, out),
            Model::DepthCamera(camera) => camera.render(world, &mut poses, frame.end, out),
            Model::Lidar2d(_) | Model::Rangefinder(_) => {
                return Err(RenderError::OtherOutput {
                    sensor: frame.sensor,
                    kind: sensor.kind,
                });
            }
        }
        Ok(())
    }

    /// Renders a frame of a sensor that makes scans.
    ///
    /// # Errors
    /// [`RenderError`]; `out` is then unchanged.
    pub fn render_scan(
        &mut self,
        frame: &Frame,
        world: &World,
        track: &PoseTrack,
        out: &mut RangeScan,
    ) -> Result<(), RenderError> {
        let sensor = self.sensor(frame)?;
        let mut poses = track.cursor().ok_or(RenderError::NoPose)?;
        match &mut sensor.model {
            Model::Lidar2d(lidar) => lidar.render(world, &mut poses, frame.begin, frame.end, out),
            Model::Rangefinder(finder) => finder.render(world, &poses.at(frame.end), frame.end, out),
            Model::Lidar3d(_) | Model::DepthCamera(_) => {
                return Err(RenderError::OtherOutput {
                    sensor: frame.sensor,
                    kind: sensor.kind,
                });
            }
        }
        Ok(())
    }

    fn sensor(&mut self, frame: &Frame) -> Result<&mut Sensor, RenderError> {
        let sensors = self.sensors.len();
        self.sensors
            .get_mut(frame.sensor)
            .ok_or(RenderError::NoSuchSensor {
                sensor: frame.sensor,
                sensors,
            })
    }
}

/// One sensor and its schedule.
#[derive(Clone, Debug)]
struct Sensor {
    name: String,
    kind: SensorKind,
    period_ns: u64,
    /// Frames handed out.
    frames: u64,
    model: Model,
}

#[derive(Clone, Debug)]
enum Model {
    Lidar3d(Lidar3d),
    DepthCamera(DepthCamera),
    Lidar2d(Lidar2d),
    Rangefinder(Box<Rangefinder>),
}

impl Sensor {
    fn new(spec: &SensorSpec, rig_seed: u64) -> Result<Self, SensorError> {
        let spec = &products::filled(spec);
        spec.check()?;
        let (default_hz, model) = match spec.kind {
            SensorKind::Lidar3d => (
                lidar::DEFAULT_RATE_HZ,
                Model::Lidar3d(Lidar3d::new(spec, rig_seed)?),
            ),
            SensorKind::DepthCamera => (
                depth::DEFAULT_RATE_HZ,
                Model::DepthCamera(DepthCamera::new(spec, rig_seed)?),
            ),
            SensorKind::Lidar2d => (scan::LIDAR_RATE_HZ, Model::Lidar2d(Lidar2d::new(spec, rig_seed)?)),
            SensorKind::Rangefinder => (
                scan::RANGEFINDER_RATE_HZ,
                Model::Rangefinder(Box::new(Rangefinder::new(spec, rig_seed)?)),
            ),
            kind @ (SensorKind::AutopilotRangefinder | SensorKind::ObstacleRow) => {
                let sensor = spec.name.clone();
                return Err(SensorError::NotRendered { sensor, kind });
            }
        };
        let rate_hz = spec.number("rate_hz", spec.rate_hz, default_hz, RATE_HZ)?;
        Ok(Self {
            name: spec.name.clone(),
            kind: spec.kind,
            period_ns: (1e9 / rate_hz).round() as u64,
            frames: 0,
            model,
        })
    }

    fn output(&self) -> Output {
        match self.model {
            Model::Lidar3d(_) | Model::DepthCamera(_) => Output::Cloud,
            Model::Lidar2d(_) | Model::Rangefinder(_) => Output::Scan,
        }
    }

    fn takes_its_period(&self) -> bool {
        matches!(self.model, Model::Lidar3d(_) | Model::Lidar2d(_))
    }

    /// When the next frame ends, for a rig switched on at `start`.
    fn next_end(&self, start: Timestamp) -> Timestamp {
        let begin_ns = start.ns.next_multiple_of(self.period_ns);
        Timestamp::from_ns(begin_ns + (self.frames + 1) * self.period_ns)
    }
}
