//! Turns ranges into a sliding tri-state voxel map: occupied, known to be free, or unknown.
//!
//! Promise: a cell is free only if a ray passed through it, or the vehicle itself was in it, or the user declares it,
//! and no hit outweighs that. Unknown is not free; rays without a pose, a valid time or plausible numbers open no
//! space. Cells known by a declaration alone are marked ([`LocalMap::declared`]), and the first measurement takes
//! precedence.
//!
//! | in | out |
//! |---|---|
//! | [`VehicleState`]: where the sensors were at each time | [`LocalMap`]: bit planes `occupied` and `known` |
//! | [`PointCloud`], [`RangeScan`]: hits, "nothing there", "unknown" | live sensors, whether ranges are fresh |
//! | | [`MovingObstacles`]: what moves, and how fast |
//!
//! The steps for a frame: every ray is placed with the vehicle's pose at the time it was measured (`poses`), checked
//! against its sensor's limits (`rays`, `cloud`, `scan`), and entered into two bit planes, cells hit and cells passed
//! through (`frame_bits`); the vehicle's own volume is free (`body`). Then the frame counts once, as log-odds evidence
//! (`window`): one hit makes a cell occupied, one miss never makes an occupied cell free. The design follows ROG-Map
//! (Ren et al., arXiv 2302.14819): modular addressing, sliding by clearing, evidence per frame.
//!
//! Around it lies a coarse map ([`FarMap`]) of obstacles farther away and of the cells that the window has left:
//! `far_window`.
//!
//! Beside the map, each sensor is checked for faults that its frames show ([`SensorFinding`]): `health`.
//!
//! Moving obstacles: a cell that something has left is free again when rays have passed through it often enough, twelve
//! frames at most. Until then it stays occupied: that costs clearance, not safety. Free is what was free when it was
//! last seen, and free cells do not age: what comes is in the map with the next ray that hits it. Where it is going to
//! be is said by its track (`moving`, [`MovingObstacles`]).
//!
//! [`Fusion`] is deterministic to the bit and allocates nothing after [`Fusion::new`].

mod body;
mod cells;
mod cloud;
mod contributions;
mod far_window;
mod field_of_view;
mod frame_bits;
mod health;
mod moving;
mod overhang;
mod pace;
mod poses;
mod rays;
mod rebase;
mod scan;
mod service;
mod shift_window;
mod start_bubble;
mod transient_hits;
mod window;

pub use health::SensorFinding;
pub use service::FusionService;

use contributions::Contributions;
use far_window::FarWindow;
use field_of_view::FieldOfViewEstimator;
use frame_bits::{FrameBits, RayBatch};
use health::SensorChecks;
use jink_shared_types::clock::Order;
use jink_shared_types::far_map::FarMap;
use jink_shared_types::frames::{BodyFrd, LocalNed, Point};
use jink_shared_types::layout::Layout;
use jink_shared_types::map::{CELL_M, LocalMap, cell_of, declared_as};
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::params::{
    OA_CARVE_RNG, OA_DCL_HANG_HI, OA_DCL_HANG_LO, OA_DCL_START, OA_VEH_RADIUS, ParamSet,
};
use jink_shared_types::pose_history::{Estimate, PoseHistory};
use jink_shared_types::ranges::{PointCloud, RangeScan, SENSORS};
use jink_shared_types::topics::{RANGE_CLOUD, RANGE_SCAN, TopicRow};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Added, Flag, Reserved, SampleHeader, Timestamp};
use moving::Moving;
use nalgebra::Vector3;
use poses::{Pose, SweepPoses};
use rays::{RayTracer, SensorLimits};
use rebase::{FrameShift, known_jump_m};
use start_bubble::StartBubble;
use transient_hits::{LidarView, TransientHits};
use window::MapWindow;

/// The window's middle lies ahead of the vehicle by its flight of this time (s), at most this far (m): plans lead ahead, and 6 m of the
/// window stay behind the vehicle.
const AHEAD_S: f64 = 1.0;
const AHEAD_MAX_M: f64 = 6.0;

/// The configuration of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusionConfig {
    /// Radius of the sphere around the centre of gravity that holds the whole vehicle (m).
    pub vehicle_radius_m: f64,
    /// Range up to which rays clear the map (m), at most 12: the window is made for that.
    pub carve_range_m: f64,
    /// How many range sensors there are. They are numbered from 0, whatever their kind.
    pub sensor_count: usize,
    /// The user's declarations for each sensor, by its number.
    pub declared: [DeclaredOfSensor; SENSORS],
    /// Start bubble: everything within this distance of the vehicle (m) is free on the ground and while it is above the
    /// place where it stood; zero: not declared.
    pub start_bubble_m: f64,
    /// Lowest and highest height above home between which nothing hangs from above (m); the second not above the first: not declared.
    pub no_overhang_m: [f64; 2],
    /// [`LocalMap::epoch`] of the first map: a restarted process continues the count of its predecessor.
    pub first_epoch: u32,
}

/// The user's declarations for a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeclaredOfSensor {
    /// The readings of its plane hold this far above and below it (m).
    pub band_m: [f64; 2],
    /// A ray without an answer met nothing.
    pub no_return_is_clear: bool,
    /// Frames per second by its table (Hz); zero where it does not say.
    pub rate_hz: f64,
    /// Obstacles near the vehicle are hit in nearly every frame: true for lidars that cover an area, not for cameras,
    /// which miss blank surfaces, nor for scans, which leave their plane when the vehicle tilts.
    pub repeats_hits: bool,
}

impl FusionConfig {
    /// The values of `params`, for `sensor_count` range topics of which nothing is declared; epochs count from 0.
    pub fn from_params(params: &ParamSet, sensor_count: usize) -> Self {
        Self {
            vehicle_radius_m: params.get(&OA_VEH_RADIUS),
            carve_range_m: params.get(&OA_CARVE_RNG),
            sensor_count,
            declared: [DeclaredOfSensor::default(); SENSORS],
            start_bubble_m: params.get(&OA_DCL_START),
            no_overhang_m: [params.get(&OA_DCL_HANG_LO), params.get(&OA_DCL_HANG_HI)],
            first_epoch: 0,
        }
    }
}

/// Counts of what was rejected, since construction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RejectedCounts {
    /// Vehicle states out of order, without a valid position, or with impossible numbers.
    pub states_refused: u64,
    /// Clouds and scans of unknown sensors, out of order, or with an impossible description.
    pub frames_refused: u64,
    /// Rays measured at a time for which no pose is known.
    pub rays_without_pose: u64,
    /// Rays with implausible numbers for their sensor.
    pub rays_malformed: u64,
    /// Hits inside the vehicle's radius.
    pub self_hits: u64,
    /// Clouds and scans that repeat the one before where that cannot be.
    pub frames_repeated: u64,
}

/// The map and its inputs.
pub struct Fusion {
    config: FusionConfig,
    history: PoseHistory,
    sweep: SweepPoses,
    frame: FrameBits,
    window: MapWindow,
    far: FarWindow,
    sensors: Contributions,
    health: SensorChecks,
    /// Motors armed, by the newest state.
    armed: bool,
    view: FieldOfViewEstimator,
    transient_hits: TransientHits,
    moving: Moving,
    /// That the position is adrift was reported.
    adrift_reported: bool,
    counters: RejectedCounts,
    /// Down coordinate of home (m); NaN unknown.
    home_down_m: f64,
    /// Something was seen hanging from above where it is declared that nothing does.
    overhang_seen: bool,
    start: StartBubble,
    estimator_resets: Option<u32>,
    epoch: u32,
    /// Frames traced so far.
    frames: u64,
}

/// The place for the middle of the window.
fn middle_of_window(state: &VehicleState) -> Point<LocalNed> {
    let mut ahead = AHEAD_S * state.velocity.vector();
    ahead.z = 0.0;
    Point::from_vector(state.position.vector() + ahead.cap_magnitude(AHEAD_MAX_M))
}

impl Fusion {
    /// An all-unknown map around the local origin. Allocates everything that will ever be needed.
    pub fn new(config: FusionConfig) -> Self {
        Self {
            config,
            history: PoseHistory::new(poses::REACH),
            sweep: SweepPoses::new(),
            frame: FrameBits::new(),
            window: MapWindow::new(),
            far: FarWindow::new(),
            sensors: Contributions::new(config.sensor_count),
            health: SensorChecks::new(
                &config.declared.map(|declared| declared.rate_hz)[..config.sensor_count.min(SENSORS)],
            ),
            armed: false,
            view: FieldOfViewEstimator::new(),
            transient_hits: TransientHits::new(config.sensor_count),
            moving: Moving::new(),
            adrift_reported: false,
            home_down_m: f64::NAN,
            overhang_seen: false,
            start: StartBubble::default(),
            counters: RejectedCounts::default(),
            estimator_resets: None,
            epoch: config.first_epoch,
            frames: 0,
        }
    }

    /// Takes the vehicle state valid at `header.capture`; the window follows the vehicle, its middle ahead of it.
    ///
    /// A changed reset count means that the local frame has moved under the map. If this state and the one before
    /// determine by how much, map and poses are shifted, and cells that then overlap two are free only if both were;
    /// else map, poses and contributions are cleared and the epoch counts up, whether or not the state itself can be
    /// used.
    pub fn vehicle(&mut self, state: &VehicleState, header: &SampleHeader) {
        match Order::judge(header.capture, self.history.newest()) {
            Order::Newer => {}
            Order::ClockStep => {
                self.history.clear();
                self.health.forget_poses();
            }
            Order::Late => {
                self.counters.states_refused += 1;
                return;
            }
        }
        let known_resets = self.estimator_resets.replace(state.estimator_resets);
        if let Some(resets) = known_resets.filter(|resets| *resets != state.estimator_resets) {
            match self.jump_m(state, header.capture, resets) {
                Some(jump_m) => {
                    self.far.absorb(&self.window);
                    self.far.shift(&jump_m);
                    self.window.shift(&FrameShift::by(&jump_m));
                    self.transient_hits.clear();
                    self.moving.clear();
                    self.start.shift(&jump_m);
                    self.history.shift(&jump_m);
                }
                None => self.drop_map(),
            }
        }
        self.home_down_m = state.home_down_m;
        self.armed = state.armed.is_set();
        let estimate = Estimate::of(state);
        if let Some(estimate) = &estimate {
            self.moving.vehicle(header.capture, estimate);
        }
        if estimate.is_some_and(|estimate| self.history.push(estimate, header.capture)) {
            let middle = cell_of(middle_of_window(state));
            if self.window.must_follow(middle) {
                self.far.absorb(&self.window);
                self.window.follow(middle);
            }
            self.far.follow(cell_of(state.position));
            if self.start.update(state, header.capture) && self.config.start_bubble_m > 0.0 {
                body::declare_sphere(
                    &mut self.window,
                    state.position.vector(),
                    self.config.start_bubble_m,
                );
            }
        } else {
            self.counters.states_refused += 1;
        }
    }

    /// By how much (m) one reset since `resets` has moved the local frame, if that is known.
    fn jump_m(&self, state: &VehicleState, capture: Timestamp, resets: u32) -> Option<Vector3<f64>> {
        if resets.wrapping_add(1) != state.estimator_resets {
            return None;
        }
        let (at, before) = self.history.newest_estimate()?;
        known_jump_m(&before, &Estimate::of(state)?, capture.seconds_since(at))
    }

    /// How often the map was cleared.
    pub fn epoch(&self) -> u32 {
        self.epoch
    }

    fn drop_map(&mut self) {
        self.window.clear();
        self.far.clear();
        self.transient_hits.clear();
        self.moving.clear();
        self.history.clear();
        self.sensors.forget_contributions();
        self.health.forget_poses();
        self.start = StartBubble::default();
        self.epoch = self.epoch.wrapping_add(1);
    }

    /// Enters the cloud of sensor number `sensor`.
    pub fn cloud(&mut self, sensor: usize, cloud: &PointCloud, header: &SampleHeader) {
        let plausible = cloud.is_plausible();
        let limits = self.limits(cloud.origin, cloud.range_min_m, cloud.range_max_m);
        let Some(limits) = limits.filter(|_| plausible && self.accept(sensor, header, &RANGE_CLOUD.row))
        else {
            self.counters.frames_refused += 1;
            return;
        };
        let pose = self.history.at(header.capture).map(Pose::from);
        if !self.health.accepts_cloud(sensor, cloud, header.capture, pose) {
            self.counters.frames_repeated += 1;
            return;
        }
        let reach_m = limits.reach_m;
        let repeats_hits = self.config.declared.get(sensor).is_some_and(|of| of.repeats_hits);
        let confirming_sensor = repeats_hits.then_some(sensor);
        let rays = cloud.points().len();
        if self.trace(
            limits,
            header.capture,
            [0.0; 2],
            confirming_sensor,
            rays,
            |tracer| {
                tracer.cloud(cloud);
            },
        ) {
            self.view
                .cloud(sensor, cloud, header.capture, self.frames, reach_m);
            self.sensors.contributed(sensor, false);
            self.moving.sees_height();
        }
        let (sweep, history) = (&mut self.sweep, &self.history);
        self.health.cloud(sensor, cloud, header.capture, sweep, history);
    }

    /// Enters the scan of sensor number `sensor`.
    pub fn scan(&mut self, sensor: usize, scan: &RangeScan, header: &SampleHeader) {
        let mounting = scan
            .mounting
            .rotation()
            .filter(|_| scan.is_plausible() && scan::is_mappable(scan));
        let limits = self.limits(scan.origin, scan.range_min_m, scan.range_max_m);
        let usable = limits.zip(mounting);
        let Some((limits, body_q_sensor)) = usable.filter(|_| self.accept(sensor, header, &RANGE_SCAN.row))
        else {
            self.counters.frames_refused += 1;
            return;
        };
        let pose = self.history.at(header.capture).map(Pose::from);
        if !self.health.accepts_scan(sensor, scan, header.capture, pose) {
            self.counters.frames_repeated += 1;
            return;
        }
        let single_beam = scan.beams <= 1;
        let declared = self.config.declared.get(sensor).filter(|_| !single_beam);
        let band_m = declared.map_or([0.0; 2], |declared| declared.band_m);
        let reach_m = limits.reach_m;
        let rays = scan.ranges().len();
        if self.trace(limits, header.capture, band_m, None, rays, |tracer| {
            tracer.scan(scan, &body_q_sensor);
        }) {
            self.view
                .scan(sensor, scan, &body_q_sensor, header.capture, reach_m, band_m);
            self.sensors.contributed(sensor, single_beam);
        }
        if !single_beam {
            let (sweep, history) = (&mut self.sweep, &self.history);
            self.health
                .scan(sensor, scan, &body_q_sensor, header.capture, sweep, history);
        }
    }

    /// Whether the frame with `header`, of a topic of `row`, is newer than the sensor's last.
    fn accept(&mut self, sensor: usize, header: &SampleHeader, row: &TopicRow) -> bool {
        let newest = self.sensors.newest(sensor);
        let deadline_ms = header.deadline_ms(row.deadline_ms);
        let is_newer = self.sensors.accept(sensor, header.capture, deadline_ms);
        if !is_newer {
            self.health.late(sensor, header.capture, newest);
        }
        is_newer
    }

    fn limits(&self, origin: Point<BodyFrd>, min_m: f32, max_m: f32) -> Option<SensorLimits> {
        SensorLimits::of(origin, min_m, max_m, &self.config)
    }

    /// Traces the rays that `enter` adds, `rays` at most, copies them to the declared band, adds the vehicle's volume
    /// at the time of capture and counts the frame as evidence; whether any ray had information. Hits that
    /// `confirming_sensor` does not repeat are withdrawn.
    fn trace(
        &mut self,
        limits: SensorLimits,
        capture: Timestamp,
        band_m: [f64; 2],
        confirming_sensor: Option<usize>,
        rays: usize,
        enter: impl FnOnce(&mut RayTracer),
    ) -> bool {
        self.frame.begin(self.window.min_cell());
        self.far.begin(rays);
        let (origin_m, near_m) = (limits.origin_body_m, limits.range_min_m);
        let mut tracer = RayTracer {
            limits,
            frame: &mut self.frame,
            far_offset: self.far.offset(self.window.min_cell()),
            far: &mut self.far,
            counters: &mut self.counters,
            has_information: false,
            number: self.frames,
            sweep: &mut self.sweep,
            history: &self.history,
            time_slot: None,
            place: None,
            rays: RayBatch::new(),
        };
        enter(&mut tracer);
        tracer.flush();
        self.frames = self.frames.wrapping_add(1);
        let has_information = tracer.has_information;
        self.far.apply();
        if band_m != [0.0; 2] {
            // A cell counts if all of it lies in the band.
            let [up, down] = band_m.map(|m| (m / CELL_M) as usize);
            self.frame.spread(up, down);
        }
        if let Some(pose) = self.history.at(capture).map(Pose::from) {
            let radius_m = self.config.vehicle_radius_m;
            body::mark_body(&mut self.frame, &self.window, pose.position_m, radius_m);
            if let Some(sensor) = confirming_sensor {
                let looking = LidarView {
                    sensor,
                    origin_m,
                    near_m,
                    answered: self.view.ever(sensor),
                    pose,
                    capture,
                };
                self.transient_hits.look(&looking, &self.frame, &mut self.window);
            }
        }
        self.moving.look(capture, &self.frame, &self.window);
        self.window.apply(&self.frame);
        has_information
    }

    /// Writes the whole map at `now`, every field of it.
    pub fn write(&self, now: Timestamp, out: &mut LocalMap) {
        let (occupied_cells, known_cells) = self.window.write(out, self.no_overhang());
        out.min_cell = self.window.min_cell();
        out.live_sensors = self.sensors.live(now);
        out.sending_sensors = Added::new(self.sensors.sending(now));
        // With a faulty sensor the vehicle must not take off, and where the position is adrift nothing is where the map says.
        let is_held = !self.armed && self.health.is_any_wrong() || self.is_adrift();
        out.ranges_fresh = Flag::from(self.sensors.fresh(now) && !is_held);
        out.faults = Added::new(self.health.bits());
        out.reserved = Reserved::ZERO;
        out.epoch = self.epoch;
        out.occupied_cells = occupied_cells;
        out.known_cells = known_cells;
        out.cell_m = CELL_M;
        out.declarations = self.declarations();
        self.view.write(&mut out.view);
        out.reserved2 = Reserved::ZERO;
    }

    /// Writes the far map, every field of it.
    pub fn write_far(&mut self, out: &mut FarMap) {
        self.far.absorb(&self.window);
        self.far.write(out);
        out.epoch = self.epoch;
    }

    /// Writes what moves around the vehicle, every field of it.
    pub fn write_moving(&mut self, out: &mut MovingObstacles) {
        let vehicle = self.history.newest_estimate();
        let place_m = vehicle.map_or(Vector3::zeros(), |(_, estimate)| estimate.position_m);
        self.moving.write(&place_m, self.epoch, out);
    }

    /// The layers of cells in which nothing hangs from above, if that is declared.
    fn no_overhang(&self) -> Option<[i32; 2]> {
        let [low_m, high_m] = self.config.no_overhang_m;
        // False as long as home is not known.
        let is_declared = high_m > low_m && self.home_down_m.is_finite() && !self.overhang_seen;
        let layer = |height_m: f64| (self.home_down_m - height_m) / CELL_M;
        is_declared.then(|| [layer(high_m).ceil() as i32, layer(low_m).floor() as i32])
    }

    /// The declarations, bits of [`declared_as`].
    fn declarations(&self) -> u8 {
        let sensors = self.config.declared.iter().take(self.config.sensor_count);
        let of_sensors = sensors.map(|declared| {
            let band = if declared.band_m == [0.0; 2] {
                0
            } else {
                declared_as::BAND
            };
            let no_return = if declared.no_return_is_clear {
                declared_as::NO_RETURN
            } else {
                0
            };
            band | no_return
        });
        let mut bits = of_sensors.fold(0, |all, bits| all | bits);
        if self.config.start_bubble_m > 0.0 {
            bits |= declared_as::START;
        }
        if !self.overhang_seen && self.config.no_overhang_m[1] > self.config.no_overhang_m[0] {
            bits |= declared_as::NO_OVERHANG;
        }
        bits
    }

    /// Searches for something that hangs from above where it is declared that nothing does; whether it was found just
    /// now. The declaration is not used any more then, as long as this `Fusion` exists.
    pub fn finds_overhang(&mut self) -> bool {
        let is_found = self
            .no_overhang()
            .is_some_and(|layers| self.window.has_ceiling(layers));
        self.overhang_seen |= is_found;
        is_found
    }

    /// The next change of a sensor's fault that was not returned before; call until there is none. Compares the frames
    /// that have come since the last call, which takes up to a few milliseconds: after the map is published.
    pub fn next_finding(&mut self) -> Option<SensorFinding> {
        self.health.compare_pending();
        self.health.next_change()
    }

    /// Whether the vehicle moves otherwise than its estimate, if that has changed since the last call. After
    /// [`Fusion::next_finding`].
    pub fn adrift_change(&mut self) -> Option<bool> {
        let is_adrift = self.is_adrift();
        (std::mem::replace(&mut self.adrift_reported, is_adrift) != is_adrift).then_some(is_adrift)
    }

    /// A sensor that sees the vehicle move otherwise than its estimated position; none while it is the estimate that contradicts
    /// itself.
    pub fn adrift_seen_by(&self) -> Option<usize> {
        self.health.adrift()
    }

    fn is_adrift(&self) -> bool {
        self.health.adrift().is_some() || self.moving.is_slipping()
    }

    /// The counts of what was rejected so far.
    pub fn counters(&self) -> RejectedCounts {
        self.counters
    }
}
