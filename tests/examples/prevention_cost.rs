//! What collision prevention costs per tick, beside PX4's own loop in the same run and the same scenes.
//!
//! `cargo run --release -p jink-tests --example prevention_cost`
//!
//! PX4's loop is the one of the emulated autopilot, which answers as PX4 does; like PX4's it counts in single precision. A tick of it: the
//! setpoint constrained on its map, with a new OBSTACLE_DISTANCE at every third tick, as at 15 messages and 50 ticks a second. A tick of ours: the
//! same on the sector ring, then a velocity instead of an acceleration (what a pilot's sticks are where he steers through jink), then the acceleration
//! with the making of the ring from a planar scan's layer.

use jink_collision_guard::prevention::{HorizontalSetpoint, Prevention, PreventionConfig};
use jink_collision_guard::ring::Ring;
use jink_emulated_px4::collision_prevention::{CollisionPrevention, ObstacleDistance, Settings};
use jink_shared_types::params::ParamSet;
use jink_shared_types::pose_history::Pose;
use jink_shared_types::quantile::quantiles;
use jink_shared_types::ranges::RangeScan;
use jink_shared_types::ring::{SECTORS, SectorRing};
use jink_shared_types::{SampleHeader, Timestamp};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use std::hint::black_box;
use std::time::Instant;

const RUNS: usize = 20_000;
const DISTANCE_M: f64 = 2.0;

/// Distances all around (m), from the nose clockwise.
type Scene = [f64; SECTORS];

fn scenes() -> Vec<(&'static str, Scene)> {
    let wall = |bearing_deg: f64, distance_m: f64| {
        std::array::from_fn(|sector| {
            let cosine = (5.0 * sector as f64 - bearing_deg).to_radians().cos();
            if cosine > 0.05 {
                distance_m / cosine
            } else {
                f64::INFINITY
            }
        })
    };
    let nearer = |a: Scene, b: Scene| std::array::from_fn(|sector| a[sector].min(b[sector]));
    vec![
        ("nothing there", [f64::INFINITY; SECTORS]),
        ("wall", wall(0.0, 4.0)),
        ("corner", nearer(wall(0.0, 4.0), wall(90.0, 3.0))),
        ("corridor", nearer(wall(90.0, 2.5), wall(270.0, 2.5))),
        (
            "room",
            std::array::from_fn(|sector| 3.0 + (sector * 37 % 11) as f64 * 0.4),
        ),
    ]
}

fn main() {
    println!(
        "{:<16} {:<26} {:>9} {:>9} {:>9} {:>9}",
        "scene", "loop", "min us", "p50 us", "p99 us", "max us"
    );
    for (name, scene) in scenes() {
        let mut theirs = Theirs::new(&scene);
        let mut ours = Ours::new(&scene);
        // Turn by turn, so that both see the same machine.
        let mut us: [Vec<f64>; 4] = std::array::from_fn(|_| Vec::with_capacity(RUNS));
        for run in 0..RUNS {
            let stick = 0.001 * run as f64;
            us[0].push(timed(|| theirs.tick(run, stick)));
            us[1].push(timed(|| ours.tick(run, stick)));
            us[2].push(timed(|| ours.velocity_tick(run, stick)));
            us[3].push(timed(|| ours.tick_with_ring(run, stick)));
        }
        let figures = us
            .each_ref()
            .map(|us| quantiles(us, [0.0, 0.5, 0.99, 1.0]).unwrap_or_default());
        for (what, [min, p50, p99, max]) in [
            "PX4's",
            "ours, on the ring",
            "ours, a velocity",
            "ours, and the ring's making",
        ]
        .iter()
        .zip(figures)
        {
            println!("{name:<16} {what:<26} {min:>9.2} {p50:>9.2} {p99:>9.2} {max:>9.2}");
        }
        let [theirs, ours, ..] = figures.map(|[_, p50, ..]| p50);
        println!("{name:<16} {:<26} {:>19.2}", "ours / PX4's, p50", ours / theirs);
    }
}

fn timed(run: impl FnOnce() -> f64) -> f64 {
    let begin = Instant::now();
    black_box(run());
    begin.elapsed().as_secs_f64() * 1e6
}

/// PX4's loop.
struct Theirs {
    prevention: CollisionPrevention,
    message: ObstacleDistance,
}

impl Theirs {
    fn new(scene: &Scene) -> Self {
        let settings = Settings {
            distance_m: DISTANCE_M as f32,
            ..Settings::default()
        };
        let cm = |metres: f64| {
            if metres.is_finite() {
                (metres * 100.0) as u16
            } else {
                1201
            }
        };
        let message = ObstacleDistance {
            increment_deg: 5.0,
            max_cm: 1200,
            distances_cm: scene.map(cm),
            ..ObstacleDistance::default()
        };
        Self {
            prevention: CollisionPrevention::new(settings),
            message,
        }
    }

    fn tick(&mut self, run: usize, stick: f64) -> f64 {
        let now_us = 20_000 * (run as u64 + 1);
        if run.is_multiple_of(3) {
            self.message.time_us = now_us;
            self.prevention.obstacle_distance(self.message);
        }
        self.prevention.attitude([1.0, 0.0, 0.0, 0.0]);
        let (sin, cos) = (stick as f32).sin_cos();
        let setpoint = Vector2::new(3.0 * cos, 3.0 * sin);
        let outcome = self.prevention.tick(now_us, setpoint, Vector2::new(2.0, 0.5));
        f64::from(outcome.setpoint_mps2.x)
    }
}

/// Ours.
struct Ours {
    prevention: Prevention,
    ring: Ring,
    pose: Pose,
    scan: RangeScan,
    sectors: SectorRing,
}

impl Ours {
    fn new(scene: &Scene) -> Self {
        let mut params = ParamSet::default();
        // The value lies within its range.
        let _known = params.set("CP_DIST", DISTANCE_M);
        let mut scan = RangeScan {
            angle_step_rad: 5f32.to_radians(),
            beam_width_rad: 5f32.to_radians(),
            range_min_m: 0.2,
            range_max_m: 12.0,
            beams: SECTORS as u32,
            ..RangeScan::default()
        };
        for (range_m, metres) in scan.range_m.iter_mut().zip(scene) {
            *range_m = *metres as f32;
        }
        Self {
            prevention: Prevention::new(PreventionConfig::from_params(&params)),
            ring: Ring::from_params(&params),
            pose: Pose {
                position_m: Vector3::zeros(),
                local_q_body: UnitQuaternion::identity(),
            },
            scan,
            sectors: SectorRing::default(),
        }
    }

    fn tick(&mut self, run: usize, stick: f64) -> f64 {
        if run == 0 {
            self.make(self.at(0));
        }
        // The ring stays as fresh as it is flown with.
        let now = self.at(0).plus_seconds(0.02 * (run % 3) as f64);
        self.constrain(now, stick)
    }

    fn velocity_tick(&mut self, run: usize, stick: f64) -> f64 {
        let now = self.at(0).plus_seconds(0.02 * (run % 3) as f64);
        let (sin, cos) = stick.sin_cos();
        let demand = HorizontalSetpoint::Velocity(Vector2::new(6.0 * cos, 6.0 * sin));
        let velocity = Vector2::new(2.0, 0.5);
        self.prevention
            .step(now, &self.sectors, demand, velocity)
            .setpoint
            .x
    }

    fn tick_with_ring(&mut self, run: usize, stick: f64) -> f64 {
        let now = self.at(run / 3 * 3).plus_seconds(0.02 * (run % 3) as f64);
        if run.is_multiple_of(3) {
            let taken = self
                .ring
                .scan_from(0, &self.scan, &SampleHeader::at(now), &self.pose);
            assert!(taken.is_ok(), "{taken:?}");
        }
        let mut sectors = self.sectors;
        self.ring.ring_from(now, &self.pose, &mut sectors);
        let kept = std::mem::replace(&mut self.sectors, sectors);
        let answer = self.constrain(now, stick);
        self.sectors = kept;
        answer
    }

    fn make(&mut self, now: Timestamp) {
        let taken = self
            .ring
            .scan_from(0, &self.scan, &SampleHeader::at(now), &self.pose);
        assert!(taken.is_ok(), "{taken:?}");
        self.ring.ring_from(now, &self.pose, &mut self.sectors);
    }

    fn constrain(&mut self, now: Timestamp, stick: f64) -> f64 {
        let (sin, cos) = stick.sin_cos();
        let demand = HorizontalSetpoint::Acceleration(Vector2::new(3.0 * cos, 3.0 * sin));
        let velocity = Vector2::new(2.0, 0.5);
        self.prevention
            .step(now, &self.sectors, demand, velocity)
            .setpoint
            .x
    }

    fn at(&self, run: usize) -> Timestamp {
        Timestamp::from_seconds(100.0 + 0.02 * run as f64)
    }
}
