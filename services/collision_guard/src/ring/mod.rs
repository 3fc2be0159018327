//! The sector ring from raw ranges: obstacles around the vehicle, and how far it is known to be free.
//!
//! | in | out |
//! |---|---|
//! | vehicle states ([`Ring::vehicle`]) | |
//! | point clouds and scans, per sensor ([`Ring::cloud`], [`Ring::scan`]) | [`SectorRing`] at any later time ([`Ring::ring`]) |
//! | | the [`RingQuery`] for a path: obstacle points, and whether a place is known to be free |
//!
//! * One layer per sensor. Over layers the smallest distance to an obstacle counts; free is what any layer saw free. A
//!   cloud replaces its layer. A scan, a beam or a row replaces what it sees again: sensors that turn report a part at
//!   a time.
//! * Sectors are level: every ray is rotated by the attitude the vehicle had when it was measured (`sweep.rs`).
//! * What a layer saw stays fixed in local NED. The ring at a later pose is recomputed from it: the vehicle has moved
//!   and turned, the obstacles have not.
//! * Only the height band around the vehicle counts. Hits above and below are no obstacles; a ray is known to be free
//!   only as far as it stays inside the band. A hit within the vehicle's own radius is the vehicle: no obstacle, and
//!   its ray is ignored.
//! * Scans, single beams and rows of level distances count whatever the height of their ends (`beam.rs`).
//! * A cloud captured longer ago than its sensor's deadline contributes nothing, nor do scans, beams and rows older
//!   than that and than half a second: their sectors become unknown, and unknown is not free.
//! * As long as its clouds come, what a sensor saw free from places that the vehicle has passed counts where it sees
//!   nothing now (`view_memory.rs`): where a brake lifts its nose, a lidar that looks up has no level ray ahead.
//!
//! **Limit.** The ring is flat: it does not cover what is above or below the band. For a motion that climbs or
//! descends, an obstacle inside the band counts as a column of any height, and one outside the band does not count
//! until the vehicle has come to its height. Vertical clearance is checked by the planner.

mod beam;
mod bearing;
mod cloud;
mod poses;
mod query;
mod sensor_layer;
mod sensor_view;
mod sweep;
mod view_memory;

pub use poses::PoseRefused;
pub use query::{RingQuery, Visibility};

pub(crate) use bearing::SLOTS;

use beam::ScanSpan;
use jink_shared_types::params::{self, ParamSet};
use jink_shared_types::pose_history::Pose;
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::ring::{SECTORS, SectorRing, sector_bearing_rad, sector_of};
use jink_shared_types::topics;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Point, SampleHeader, Timestamp};
use poses::Poses;
use sensor_layer::{Lifetimes, SensorLayer};
use sensor_view::{SectorBorders, SensorView};
use std::fmt;
use sweep::{Envelope, SectorCollector, SweepTransform};
use view_memory::ViewMemory;

pub use jink_shared_types::ranges::SENSORS;

/// How long scans, beams and rows count at least (s): a sensor that turns comes back to its edges in that time, and PX4
/// keeps ranges as long.
const SCAN_LIFETIME_S: f64 = 0.5;
/// Remembered views are not asked farther than this (m): at 6 m/s, with PX4's CP_DELAY and MPC_ACC_HOR, a pilot's vehicle needs 9 m.
const REMEMBERED_M: f32 = 12.0;
/// Longest sweep (s): the range of the 16-bit time offset of a cloud point.
const SWEEP_S: f64 = 0.655_35;

/// Why ranges were rejected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RangeRefused {
    /// The sensor has no layer.
    NoSuchSensor {
        /// Its number.
        sensor: usize,
        /// How many there are.
        sensors: usize,
    },
    /// The sample contradicts itself: its reach is no positive number.
    BadReach {
        /// The reach in the sample (m).
        range_max_m: f32,
    },
    /// The sample contradicts itself: its first ray is later than its last, or more than a sweep earlier.
    BadTimes {
        /// First ray.
        first: Timestamp,
        /// Last ray.
        last: Timestamp,
    },
    /// The vehicle's pose at the time of the rays is not known.
    NoPose {
        /// First ray.
        first: Timestamp,
        /// Last ray.
        last: Timestamp,
        /// The newest vehicle state.
        newest: Timestamp,
    },
}

impl fmt::Display for RangeRefused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RangeRefused::NoSuchSensor { sensor, sensors } => {
                write!(f, "sensor {sensor}, but there are only {sensors}")
            }
            RangeRefused::BadReach { range_max_m } => write!(f, "a reach of {range_max_m} m"),
            RangeRefused::BadTimes { first, last } => {
                write!(f, "rays from {} ns to {} ns", first.ns, last.ns)
            }
            RangeRefused::NoPose { first, last, newest } => write!(
                f,
                "no vehicle state for rays from {} ns to {} ns, the newest is of {} ns",
                first.ns, last.ns, newest.ns
            ),
        }
    }
}
impl std::error::Error for RangeRefused {}

/// The sector ring.
#[derive(Clone, Debug)]
pub struct Ring {
    envelope: Envelope,
    poses: Poses,
    layers: Vec<SensorLayer>,
    memory: ViewMemory,
    collector: SectorCollector,
    borders: SectorBorders,
}

impl Ring {
    /// With the vehicle's radius and the height band of `params`.
    pub fn from_params(params: &ParamSet) -> Self {
        Self {
            envelope: Envelope {
                radius_m: params.get(&params::OA_VEH_RADIUS),
                band_half_m: params.get(&params::GD_BAND),
            },
            poses: Poses::new(),
            layers: vec![SensorLayer::new(); SENSORS],
            memory: ViewMemory::new(),
            collector: SectorCollector::new(),
            borders: SectorBorders::new(),
        }
    }

    /// Takes a vehicle state; ranges measured after it need it. If the estimator has moved its origin, everything seen
    /// so far is dropped.
    ///
    /// # Errors
    /// [`PoseRefused`] if the state is invalid or late; the history stays as it was.
    pub fn vehicle(&mut self, state: &VehicleState, header: &SampleHeader) -> Result<(), PoseRefused> {
        if self.poses.push(state, header)? {
            self.memory.clear();
            self.layers.iter_mut().for_each(SensorLayer::invalidate_places);
        }
        Ok(())
    }

    /// Takes a point cloud as the new layer of `sensor` (0 to [`SENSORS`] - 1; scans and clouds share the numbers).
    ///
    /// # Errors
    /// [`RangeRefused`]; the sensor's last layer stays, and grows old.
    pub fn cloud(
        &mut self,
        sensor: usize,
        cloud: &PointCloud,
        header: &SampleHeader,
    ) -> Result<(), RangeRefused> {
        let first = if cloud.first_point.is_set() {
            cloud.first_point
        } else {
            header.capture
        };
        let deadline_s = header.deadline_ms(topics::RANGE_CLOUD.row.deadline_ms) * 1e-3;
        let rays = RangeSampleInfo {
            first,
            last: header.capture,
            sensor_m: cloud.origin,
            range_min_m: cloud.range_min_m,
            range_max_m: cloud.range_max_m,
            lifetimes: Lifetimes {
                deadline_s,
                kept_s: deadline_s,
                is_remembered: true,
            },
        };
        let [from, to] = self.begin(sensor, &rays)?;
        let sweep = self.sweep(&rays, &from, &to);
        cloud::collect(cloud, &sweep, &mut self.collector);
        let collector = &mut self.collector;
        let layer = &mut self.layers[sensor];
        let view = layer.replace(&to, rays.last, |view| collector.finish(&sweep, view));
        self.memory.store_if_new(sensor, view, rays.last);
        Ok(())
    }

    /// Takes a planar scan, a single beam or a row of distances of `sensor`. A beam as wide as several sectors fills
    /// them all.
    ///
    /// # Errors
    /// [`RangeRefused`]; what the sensor said before stays, and grows old.
    pub fn scan(
        &mut self,
        sensor: usize,
        scan: &RangeScan,
        header: &SampleHeader,
    ) -> Result<(), RangeRefused> {
        let rays = RangeSampleInfo::of_scan(scan, header);
        let [from, to] = self.begin(sensor, &rays)?;
        self.take_scan(sensor, scan, &rays, &from, &to);
        Ok(())
    }

    /// The same for a scan that was taken at once, at `pose`, independent of the vehicle's states.
    ///
    /// # Errors
    /// As [`Ring::scan`].
    pub fn scan_from(
        &mut self,
        sensor: usize,
        scan: &RangeScan,
        header: &SampleHeader,
        pose: &Pose,
    ) -> Result<(), RangeRefused> {
        let rays = RangeSampleInfo::of_scan(scan, header);
        self.admit(sensor, &rays)?;
        self.take_scan(sensor, scan, &rays, pose, pose);
        Ok(())
    }

    fn take_scan(&mut self, sensor: usize, scan: &RangeScan, rays: &RangeSampleInfo, from: &Pose, to: &Pose) {
        let span = ScanSpan {
            first: (rays.first, from),
            last: (rays.last, to),
            vehicle_radius_m: self.envelope.radius_m,
        };
        let layer = &mut self.layers[sensor];
        let view = layer.add(to, rays.last, |view| beam::collect(scan, &span, view));
        self.memory.store_if_new(sensor, view, rays.last);
    }

    /// The ring seen from the vehicle's pose at `now`. Without a pose everything is unknown.
    pub fn ring(&self, now: Timestamp, out: &mut SectorRing) {
        match self.poses.at(now) {
            Some(pose) => self.ring_from(now, &pose, out),
            None => *out = self.empty(),
        }
    }

    /// The ring seen from `pose` at `now`, independent of the vehicle's states.
    pub fn ring_from(&self, now: Timestamp, pose: &Pose, out: &mut SectorRing) {
        *out = self.empty();
        out.position = Point::from_vector(pose.position_m);
        out.attitude = jink_shared_types::frames::Attitude::from_rotation(pose.local_q_body);
        let mut range_min_m = f32::INFINITY;
        for layer in &self.layers {
            for view in layer.views(now) {
                range_min_m = range_min_m.min(layer.range_min_m);
                self.add_free_distances(view, pose, Age::Newest, out);
                add_hits(view, pose, out);
            }
        }
        let band_half_m = self.envelope.band_half_m;
        for kept in self.memory.views(now, pose.position_m.z, band_half_m) {
            if self.layers[kept.sensor].remembers(now) {
                self.add_free_distances(&kept.view, pose, Age::Remembered, out);
            }
        }
        if range_min_m.is_finite() {
            out.range_min_m = range_min_m;
        }
    }

    fn empty(&self) -> SectorRing {
        SectorRing {
            band_half_m: self.envelope.band_half_m as f32,
            ..SectorRing::default()
        }
    }

    /// Whether any sensor still sends ranges.
    pub fn is_fresh(&self, now: Timestamp) -> bool {
        self.layers.iter().any(|layer| layer.is_arriving(now))
    }

    /// A query for places around at `now`.
    pub fn query(&self, now: Timestamp) -> RingQuery<'_> {
        RingQuery::new(self, now)
    }

    /// The vehicle's poses at the first and at the last of `rays`.
    fn begin(&mut self, sensor: usize, rays: &RangeSampleInfo) -> Result<[Pose; 2], RangeRefused> {
        self.admit(sensor, rays)?;
        let (first, last) = (rays.first, rays.last);
        match (self.poses.at(first), self.poses.at(last)) {
            (Some(from), Some(to)) => Ok([from, to]),
            _ => Err(RangeRefused::NoPose {
                first,
                last,
                newest: self.poses.newest(),
            }),
        }
    }

    /// Records that the sensor sends samples, unless the sample contradicts itself.
    fn admit(&mut self, sensor: usize, rays: &RangeSampleInfo) -> Result<(), RangeRefused> {
        if !(rays.range_max_m > 0.0 && rays.range_max_m.is_finite()) {
            return Err(RangeRefused::BadReach {
                range_max_m: rays.range_max_m,
            });
        }
        let (first, last) = (rays.first, rays.last);
        if !(0.0..=SWEEP_S).contains(&last.seconds_since(first)) {
            return Err(RangeRefused::BadTimes { first, last });
        }
        let sensors = self.layers.len();
        let Some(layer) = self.layers.get_mut(sensor) else {
            return Err(RangeRefused::NoSuchSensor { sensor, sensors });
        };
        layer.record_arrival(rays.last, rays.lifetimes);
        layer.range_min_m = rays.range_min_m.max(0.0);
        Ok(())
    }

    fn sweep(&mut self, rays: &RangeSampleInfo, from: &Pose, to: &Pose) -> SweepTransform {
        self.collector.start();
        SweepTransform::new(
            (rays.first, from),
            (rays.last, to),
            rays.sensor_m.vector(),
            rays.range_max_m,
            self.envelope,
        )
    }

    fn add_free_distances(&self, view: &SensorView, pose: &Pose, age: Age, out: &mut SectorRing) {
        let place_m = [pose.position_m.x, pose.position_m.y];
        let footprint_m = self.envelope.radius_m as f32;
        let yaw_rad = pose.yaw_rad();
        for sector in 0..SECTORS {
            let is_enough = out.distance_m[sector].is_finite() || out.range_max_m[sector] >= REMEMBERED_M;
            if age == Age::Remembered && is_enough {
                continue;
            }
            let toward_rad = yaw_rad + sector_bearing_rad(sector);
            let way = view.free_distance_m(&self.borders, place_m, toward_rad, footprint_m);
            let Some(way) = way else {
                continue;
            };
            if way.way_m > out.range_max_m[sector] {
                out.range_max_m[sector] = way.way_m;
            }
            // A free distance that ends at an obstacle is not "nothing up to here", even if the obstacle's nearest
            // point lies in the next sector by now.
            let distance_m = if way.ends_at_obstacle && age == Age::Newest {
                way.way_m
            } else {
                f32::INFINITY
            };
            note(out, sector, distance_m, way.sector.seen);
        }
    }
}

/// How old a view is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Age {
    /// A sensor's newest.
    Newest,
    /// A view from a place that the vehicle has passed: its free space counts, its obstacles do not.
    Remembered,
}

/// Writes a distance, if it is the smallest so far. NaN, still unknown, is not smaller than anything.
fn note(out: &mut SectorRing, sector: usize, distance_m: f32, seen: Timestamp) {
    let has_smaller = out.distance_m[sector] <= distance_m;
    if !has_smaller {
        out.distance_m[sector] = distance_m;
        out.seen[sector] = seen;
    }
}

fn add_hits(view: &SensorView, pose: &Pose, out: &mut SectorRing) {
    let yaw_rad = pose.yaw_rad();
    for (place_m, seen) in view.places() {
        let (north, east) = (place_m[0] - pose.position_m.x, place_m[1] - pose.position_m.y);
        let sector = sector_of(east.atan2(north) - yaw_rad);
        note(out, sector, north.hypot(east) as f32, seen);
    }
}

/// What clouds and scans have in common.
struct RangeSampleInfo {
    first: Timestamp,
    last: Timestamp,
    sensor_m: Point<jink_shared_types::BodyFrd>,
    range_min_m: f32,
    range_max_m: f32,
    lifetimes: Lifetimes,
}

impl RangeSampleInfo {
    fn of_scan(scan: &RangeScan, header: &SampleHeader) -> Self {
        let deadline_s = header.deadline_ms(topics::RANGE_SCAN.row.deadline_ms) * 1e-3;
        Self {
            first: if scan.first_beam.is_set() {
                scan.first_beam
            } else {
                header.capture
            },
            last: header.capture,
            sensor_m: scan.origin,
            range_min_m: scan.range_min_m,
            range_max_m: scan.range_max_m,
            lifetimes: Lifetimes {
                deadline_s,
                kept_s: deadline_s.max(SCAN_LIFETIME_S),
                // Parts of a sensor that turns do not come again where it is stuck.
                is_remembered: false,
            },
        }
    }
}
