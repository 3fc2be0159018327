//! A synthetic world of cylinders, a lidar in it, and trajectories through it.
#![allow(dead_code, reason = "every test uses a part of it")]
#![allow(
    clippy::unwrap_used,
    reason = "a helper that cannot do its work fails the test"
)]

use jink_collision_guard::StepEvents;
use jink_collision_guard::guard::{Guard, GuardConfig, GuardInputs};
use jink_collision_guard::ring::Ring;
use jink_shared_types::bezier::{End, quintic_between};
use jink_shared_types::frames::{AngularRate, Attitude, Mounting};
use jink_shared_types::layout::Layout;
use jink_shared_types::motion::{ApprovedTrajectory, BezierPiece, MotionLimits, Trajectory, TrajectoryMode};
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::{CloudPoint, PointCloud, RangeScan, RayKind};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::sample::Stamped;
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Coded, Flag, Point, Reading, Reserved, SampleHeader, Timestamp, Velocity};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;

/// Height at which everything flies, as down coordinate (m).
pub const DOWN_M: f64 = -2.0;

pub fn time(seconds: f64) -> Timestamp {
    Timestamp::from_seconds(seconds)
}

/// The random numbers of `seed`.
pub fn random(seed: u64) -> SplitMix64 {
    SplitMix64::seed_from_u64(seed)
}

/// Normal with standard deviation one, nearly: the sum of twelve uniform numbers.
fn normal(random: &mut SplitMix64) -> f64 {
    (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
}

/// Where the vehicle is.
#[derive(Clone, Copy)]
pub struct VehiclePose {
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub attitude: UnitQuaternion<f64>,
    pub rates: Vector3<f64>,
    /// How its autopilot follows; zeros: not known.
    pub tracking: Tracking,
}

impl VehiclePose {
    pub fn at(x_m: f64, y_m: f64) -> Self {
        Self {
            position: Vector3::new(x_m, y_m, DOWN_M),
            velocity: Vector3::zeros(),
            attitude: UnitQuaternion::identity(),
            rates: Vector3::zeros(),
            tracking: Tracking::default(),
        }
    }

    pub fn turned(self, roll: f64, pitch: f64, yaw: f64) -> Self {
        Self {
            attitude: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            ..self
        }
    }

    pub fn state(&self) -> VehicleState {
        VehicleState {
            position: Point::from_vector(self.position),
            velocity: Velocity::from_vector(self.velocity),
            attitude: Attitude::from_rotation(self.attitude),
            rates: AngularRate::new(self.rates.x, self.rates.y, self.rates.z),
            position_valid: Flag::YES,
            autopilot_alive: Flag::YES,
            tracking: self.tracking,
            ..VehicleState::default()
        }
    }
}

/// Upright cylinders (x, y, radius), from the ground to the sky, on the plane z = 0.
#[derive(Clone, Default)]
pub struct World(pub Vec<[f64; 3]>);

impl World {
    /// Distance along the unit vector `along` from `from` to the nearest surface (m).
    pub fn cast(&self, from: Vector3<f64>, along: Vector3<f64>) -> f64 {
        let mut nearest = if along.z > 1e-9 {
            -from.z / along.z
        } else {
            f64::INFINITY
        };
        let flat = along.xy().norm();
        for [x, y, radius] in &self.0 {
            let to = Vector3::new(x - from.x, y - from.y, 0.0).xy();
            let ahead = to.dot(&along.xy()) / flat;
            let aside_m2 = to.norm_squared() - ahead * ahead;
            if ahead > 0.0 && aside_m2 < radius * radius {
                nearest = nearest.min((ahead - (radius * radius - aside_m2).sqrt()).max(0.0) / flat);
            }
        }
        nearest
    }

    /// Horizontal distance from (x, y) to the nearest surface (m).
    pub fn clearance_m(&self, x_m: f64, y_m: f64) -> f64 {
        self.0
            .iter()
            .map(|[x, y, radius]| (x - x_m).hypot(y - y_m) - radius)
            .fold(f64::INFINITY, f64::min)
    }
}

#[derive(Clone)]
pub struct Lidar {
    pub rows: usize,
    pub columns: usize,
    /// Half the vertical opening (rad).
    pub half_height_rad: f64,
    /// Half the horizontal opening (rad); pi for all around.
    pub half_width_rad: f64,
    pub range_max_m: f64,
    pub sigma_m: f64,
    pub sweep_s: f64,
}

impl Default for Lidar {
    fn default() -> Self {
        Self {
            rows: 32,
            columns: 360,
            half_height_rad: 0.5,
            half_width_rad: std::f64::consts::PI,
            range_max_m: 12.0,
            sigma_m: 0.0,
            sweep_s: 0.1,
        }
    }
}

impl Lidar {
    /// The sweep that ends at `end_s`, of a vehicle that is at `place(t)` at time `t`.
    pub fn sweep(
        &self,
        world: &World,
        place: &dyn Fn(f64) -> VehiclePose,
        end_s: f64,
        random: &mut SplitMix64,
    ) -> (Box<PointCloud>, SampleHeader) {
        let mut cloud = PointCloud::boxed();
        cloud.first_point = time(end_s - self.sweep_s);
        cloud.range_min_m = 0.2;
        cloud.range_max_m = self.range_max_m as f32;
        cloud.range_sigma_m = self.sigma_m as f32;
        for column in 0..self.columns {
            let share = (column as f64 + 0.5) / self.columns as f64;
            let azimuth = (2.0 * share - 1.0) * self.half_width_rad;
            let offset_10us = (share * self.sweep_s * 1e5) as u16;
            let here = place(end_s - self.sweep_s + f64::from(offset_10us) * 1e-5);
            for row in 0..self.rows {
                let elevation = if self.rows == 1 {
                    0.0
                } else {
                    (2.0 * row as f64 / (self.rows - 1) as f64 - 1.0) * self.half_height_rad
                };
                let along = Vector3::new(
                    elevation.cos() * azimuth.cos(),
                    elevation.cos() * azimuth.sin(),
                    -elevation.sin(),
                );
                let range = world.cast(here.position, here.attitude * along);
                let (range, kind) = if range > self.range_max_m {
                    (self.range_max_m, RayKind::Clear)
                } else {
                    (range + self.sigma_m * normal(random), RayKind::Hit)
                };
                let end = along * range;
                assert!(cloud.push(CloudPoint {
                    forward_m: end.x as f32,
                    right_m: end.y as f32,
                    down_m: end.z as f32,
                    offset_10us,
                    kind: Coded::new(kind),
                    reserved: Reserved::ZERO,
                }));
            }
        }
        (cloud, SampleHeader::at(time(end_s)))
    }
}

/// A cloud of single points in the body frame, all measured at `at_s`.
pub fn points(ends: &[([f64; 3], RayKind)], range_max_m: f64, at_s: f64) -> (Box<PointCloud>, SampleHeader) {
    let mut cloud = PointCloud::boxed();
    cloud.first_point = time(at_s);
    cloud.range_min_m = 0.2;
    cloud.range_max_m = range_max_m as f32;
    for (end, kind) in ends {
        assert!(cloud.push(CloudPoint {
            forward_m: end[0] as f32,
            right_m: end[1] as f32,
            down_m: end[2] as f32,
            offset_10us: 0,
            kind: Coded::new(*kind),
            reserved: Reserved::ZERO,
        }));
    }
    (cloud, SampleHeader::at(time(at_s)))
}

/// A single beam straight ahead of the sensor, `width_rad` wide, turned by `yaw_rad` in the body.
pub fn beam(range_m: f32, width_rad: f64, yaw_rad: f64) -> RangeScan {
    let mut scan = RangeScan {
        mounting: Mounting::from_rotation(UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad)),
        beam_width_rad: width_rad as f32,
        range_min_m: 0.1,
        range_max_m: 10.0,
        beams: 1,
        ..RangeScan::default()
    };
    scan.range_m[0] = range_m;
    scan
}

/// Vehicle states at 50 Hz from `from_s` to `to_s`, both included.
pub fn fly(ring: &mut Ring, place: &dyn Fn(f64) -> VehiclePose, from_s: f64, to_s: f64) {
    let steps = ((to_s - from_s) / 0.02).round() as u32;
    for i in 0..=steps {
        let t = from_s + 0.02 * f64::from(i);
        // Steps that overlap with an earlier call are late-comers: the ring refuses them, and knows them already.
        let _ = ring.vehicle(&place(t).state(), &SampleHeader::at(time(t)));
    }
}

pub fn ring() -> Ring {
    Ring::from_params(&ParamSet::default())
}

pub fn view(ring: &Ring, at_s: f64) -> SectorRing {
    let mut out = SectorRing::default();
    ring.ring(time(at_s), &mut out);
    assert!(out.is_plausible(), "{out:?}");
    out
}

/// A ring at rest at `place` at `at_s` that has just seen `world`.
pub fn looking(world: &World, place: VehiclePose, at_s: f64) -> Ring {
    let mut ring = ring();
    look(&mut ring, world, place, at_s);
    ring
}

/// `ring` sees `world` from rest at `place` at `at_s`.
pub fn look(ring: &mut Ring, world: &World, place: VehiclePose, at_s: f64) {
    fly(ring, &|_| place, at_s - 0.2, at_s);
    let (cloud, header) = Lidar::default().sweep(world, &|_| place, at_s, &mut random(1));
    ring.cloud(0, &cloud, &header).unwrap();
}

pub fn limits() -> MotionLimits {
    MotionLimits {
        speed_mps: 4.0,
        climb_mps: 2.0,
        descent_mps: 2.0,
        acceleration_mps2: 4.0,
        jerk_mps3: 12.0,
        yaw_rate_radps: 2.0,
        tube_m: 0.2,
        overshoot_m: 0.2,
        braking_mps2: 4.0,
        braking_jerk_mps3: 12.0,
    }
}

pub fn end(position: [f64; 2], velocity: [f64; 2]) -> End {
    End {
        position: Vector3::new(position[0], position[1], DOWN_M),
        velocity: Vector3::new(velocity[0], velocity[1], 0.0),
        acceleration: Vector3::zeros(),
    }
}

/// From state to state with the given durations.
pub fn trajectory(id: u64, start_s: f64, from: End, legs: &[(End, f64)]) -> Trajectory {
    let mut made = Trajectory {
        id,
        start: time(start_s),
        splice: time(start_s),
        limits: limits(),
        mode: Coded::new(TrajectoryMode::Plan),
        ..Trajectory::default()
    };
    let mut last = from;
    for (next, duration_s) in legs {
        let piece = BezierPiece::new(&quintic_between(&last, next, *duration_s), [0.0; 6], *duration_s);
        assert!(made.push(piece));
        last = *next;
    }
    made
}

/// From rest at the origin straight north: up to `speed` within `rise_s`, steady until `far_m`, and to rest again.
pub fn straight(id: u64, start_s: f64, speed: f64, rise_s: f64, far_m: f64) -> Trajectory {
    let run_up = 0.5 * speed * rise_s;
    let steady = far_m - 2.0 * run_up;
    assert!(steady > 0.0);
    trajectory(
        id,
        start_s,
        end([0.0, 0.0], [0.0, 0.0]),
        &[
            (end([run_up, 0.0], [speed, 0.0]), rise_s),
            (end([run_up + steady, 0.0], [speed, 0.0]), steady / speed),
            (end([far_m, 0.0], [0.0, 0.0]), rise_s),
        ],
    )
}

/// What a generator makes: repeats `base` until `splice_s`, then comes to rest a bit aside.
pub fn successor(base: &Trajectory, id: u64, now_s: f64, splice_s: f64) -> Trajectory {
    let mut made = Trajectory {
        id,
        base_id: base.id,
        splice: time(splice_s),
        limits: base.limits,
        mode: Coded::new(TrajectoryMode::Plan),
        ..Trajectory::default()
    };
    assert!(made.take_prefix(base, time(now_s), time(splice_s)));
    let from = base.at(time(splice_s)).unwrap().end();
    let (x, y) = (from.position.x, from.position.y);
    let duration_s = 4.0;
    let to = end(
        [x + 0.5 * duration_s * from.velocity.norm().max(1.0), y + 0.3],
        [0.0, 0.0],
    );
    let points = quintic_between(&from, &to, duration_s);
    assert!(made.push(BezierPiece::new(&points, [0.0; 6], duration_s)));
    made
}

/// The vehicle exactly on `trajectory`, tilted as its acceleration demands.
pub fn on(trajectory: &Trajectory, t: f64) -> VehiclePose {
    let state = trajectory.at(time(t)).unwrap();
    let acceleration = state.acceleration.vector();
    VehiclePose {
        position: state.position.vector(),
        velocity: state.velocity.vector(),
        attitude: UnitQuaternion::from_euler_angles(acceleration.y / 9.81, -acceleration.x / 9.81, 0.0),
        rates: Vector3::zeros(),
        tracking: Tracking::default(),
    }
}

pub fn guard() -> Guard {
    Guard::new(GuardConfig::from_params(&ParamSet::default()), 3)
}

/// One step of `guard` with a fresh state of a vehicle at `place`, where nothing moves.
pub fn step(
    guard: &mut Guard,
    at_s: f64,
    trajectory: Option<&Trajectory>,
    ring: &Ring,
    place: VehiclePose,
) -> (ApprovedTrajectory, StepEvents) {
    step_among(guard, at_s, trajectory, ring, place, &MovingObstacles::default())
}

/// The same where `moving` moves.
pub fn step_among(
    guard: &mut Guard,
    at_s: f64,
    trajectory: Option<&Trajectory>,
    ring: &Ring,
    place: VehiclePose,
    moving: &MovingObstacles,
) -> (ApprovedTrajectory, StepEvents) {
    let (state, header) = (place.state(), SampleHeader::at(time(at_s)));
    let mut out = ApprovedTrajectory::default();
    let inputs = GuardInputs {
        trajectory,
        state: Reading::Fresh(Stamped {
            sample: &state,
            header: &header,
        }),
        ring,
        moving: Reading::Fresh(Stamped {
            sample: moving,
            header: &header,
        }),
    };
    let step_events = guard.step(time(at_s), &inputs, &mut out);
    assert!(out.is_plausible(), "{out:?}");
    (out, step_events)
}

/// A guard that flies nothing, in an empty world.
pub fn hovering_guard(at_s: f64) -> (Guard, Ring) {
    (
        guard(),
        looking(&World::default(), VehiclePose::at(0.0, 0.0), at_s),
    )
}
