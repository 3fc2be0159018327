//! What makes a flight of a suite hard beside its world: things that move in it, and senses that fail.

use crate::lockstep::{FlightSetup, FrameDelay, LockStep};
use jink_simulated_world::random::Random;
use jink_simulated_world::sensors::{SensorKind, SensorSpec};
use jink_simulated_world::world::{Cylinder, Obstacle, Scene, Sphere, World};

/// Random streams of this file, apart from those of the worlds.
const MOVERS_STREAM: u64 = 60;
const FRAMES_STREAM: u64 = 61;

/// Steps of a flight (4 ms) between two places of what moves.
const MOVED_EVERY: u64 = 5;
const STEP_S: f64 = 0.004;

/// What moves keeps to this strip of the way (m), and to both sides of it.
const STRIP_NORTH_M: [f64; 2] = [5.0, 35.0];
const STRIP_EAST_M: f64 = 10.0;
const MOVER_RADIUS_M: f64 = 0.3;
const MOVER_TOP_M: f64 = 6.0;
const MOVER_SLOWEST_MPS: f64 = 0.5;

/// A thing that is thrown crosses the way this far ahead of where the vehicle is then (m), and starts this far beside it:
/// at 3 m/s both come there at about the same time.
const THROWN_AHEAD_M: f64 = 4.0;
const THROWN_BESIDE_M: f64 = 12.0;
const THROWN_RADIUS_M: f64 = 0.15;
const THROWN_MPS: [f64; 2] = [6.0, 8.0];
/// It is thrown when the vehicle is here (m north).
const THROWN_AT_M: f64 = 15.0;

/// Where the sensors die, and where the companion (m north).
const DEATH_NORTH_M: f64 = 20.0;
/// Share of the frames that are dropped, and for how many steps (4 ms) it is drawn whether: about a frame at 30 Hz.
const DROPPED: f64 = 0.2;
const FRAME_STEPS: u64 = 8;
/// From capture to publication (s).
const LATENCY_S: f64 = 0.15;
/// Drift per way (1), and how far it goes before it is taken back at once (m).
const DRIFT: f64 = 0.01;
const DRIFT_CORRECTED_M: f64 = 0.3;
/// Standard deviation of the gusts on each axis (m/s): one in twenty exceeds 6 m/s.
const GUST_SIGMA_MPS: f64 = 3.0;

/// What happens in a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Hindrance {
    /// Nothing.
    #[default]
    None,
    /// Things move.
    Movers(Movers),
    /// Senses fail.
    Degraded(Degraded),
}

/// Things that move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Movers {
    count: u32,
    fastest_mps: f64,
    is_thrown: bool,
}

impl Movers {
    /// Posts that walk: half of them across the way, half anywhere; one in four stops or turns.
    pub const fn crowd(count: u32, fastest_mps: f64) -> Self {
        Self {
            count,
            fastest_mps,
            is_thrown: false,
        }
    }

    /// A ball thrown across the way.
    pub const fn thrown() -> Self {
        Self {
            count: 0,
            fastest_mps: 0.0,
            is_thrown: true,
        }
    }
}

/// What fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degraded {
    /// Ranges are twice as noisy.
    Noise,
    /// One frame in five does not come.
    Dropped,
    /// Frames come 150 ms late.
    Latency,
    /// The estimated position drifts by 1 % of the way, and jumps back by 0.3 m.
    Drift,
    /// Gusts of 6 m/s.
    Gusts,
    /// All sensors fall silent half-way.
    SensorDeath,
    /// The companion dies half-way and does not come back.
    CompanionDeath,
}

impl Hindrance {
    /// Whether a vehicle that comes to rest half-way and touches nothing has done what it could.
    pub fn ends_half_way(self) -> bool {
        matches!(
            self,
            Self::Degraded(Degraded::SensorDeath | Degraded::CompanionDeath)
        )
    }

    /// What of it is part of the set-up.
    pub fn prepare(self, setup: &mut FlightSetup) {
        let Self::Degraded(how) = self else {
            return;
        };
        match how {
            Degraded::Noise => setup.sensors.iter_mut().for_each(twice_the_noise),
            Degraded::Drift => {
                let estimator = setup.autopilot.estimator_mut();
                (estimator.drift_ratio, estimator.corrected_at_m) = (DRIFT, DRIFT_CORRECTED_M);
                estimator.seed = setup.seed;
            }
            Degraded::Gusts => setup.autopilot.vehicle_mut().wind.gust_sigma_mps = GUST_SIGMA_MPS,
            Degraded::Dropped | Degraded::Latency | Degraded::SensorDeath | Degraded::CompanionDeath => {}
        }
    }

    /// What of it happens in flight.
    pub fn in_flight(self, world: &World, seed: u64, sensors: usize) -> InFlight {
        let kind = match self {
            Self::Movers(movers) => Kind::Moving(Box::new(Moving::new(movers, world, seed))),
            Self::Degraded(how) => Kind::Failing(how, Random::new(seed, FRAMES_STREAM)),
            Self::None => Kind::Nothing,
        };
        InFlight {
            kind,
            sensors,
            steps: 0,
        }
    }
}

/// The noise that a sensor has, doubled; without any written that of its kind (`simulated_world::sensors::SensorKind`), which for one
/// with a `model` may not be its own.
fn twice_the_noise(spec: &mut SensorSpec) {
    let double = |written: &mut Option<f64>, default: f64| *written = Some(2.0 * written.unwrap_or(default));
    match spec.kind {
        SensorKind::DepthCamera => double(&mut spec.sigma_per_m, 0.005),
        SensorKind::Lidar2d => double(&mut spec.sigma_m, 0.01),
        SensorKind::Rangefinder => {
            double(&mut spec.sigma_m, 0.02);
            double(&mut spec.sigma_ratio, 0.01);
        }
        _ => double(&mut spec.sigma_m, 0.02),
    }
}

/// What happens in a flight, under way.
#[derive(Debug)]
pub struct InFlight {
    kind: Kind,
    sensors: usize,
    steps: u64,
}

#[derive(Debug)]
enum Kind {
    Nothing,
    Moving(Box<Moving>),
    Failing(Degraded, Random),
}

impl InFlight {
    /// Before each step of the flight.
    pub fn step(&mut self, flight: &mut LockStep) {
        let north_m = flight.truth().position.x_m;
        match &mut self.kind {
            Kind::Nothing => {}
            Kind::Moving(moving) if self.steps.is_multiple_of(MOVED_EVERY) => {
                moving.step(MOVED_EVERY as f64 * STEP_S, north_m);
                flight.move_world(moving.world());
            }
            Kind::Moving(_) => {}
            Kind::Failing(Degraded::Dropped, random) if self.steps.is_multiple_of(FRAME_STEPS) => {
                flight.silent_sensors = match random.unit() < DROPPED {
                    true => (0..self.sensors).collect(),
                    false => Default::default(),
                };
            }
            Kind::Failing(Degraded::Latency, _) => {
                flight.frame_delay = FrameDelay {
                    delay_s: LATENCY_S,
                    is_stamped_on_arrival: false,
                };
            }
            Kind::Failing(Degraded::SensorDeath, _) if north_m > DEATH_NORTH_M => {
                flight.silent_sensors = (0..self.sensors).collect();
            }
            Kind::Failing(Degraded::CompanionDeath, _) if north_m > DEATH_NORTH_M => {
                flight.dead_companion = true;
                // Who sends it on its way again flies it without a companion.
                flight.silent_station = true;
            }
            Kind::Failing(..) => {}
        }
        self.steps += 1;
    }
}

/// A thing on its way.
#[derive(Clone, Copy, Debug)]
struct Mover {
    north_m: f64,
    east_m: f64,
    north_mps: f64,
    east_mps: f64,
    /// When it stops or turns (s); infinity for never. Then how fast it goes on.
    changes_s: f64,
    then_mps: [f64; 2],
}

/// A world in which things move.
#[derive(Debug)]
struct Moving {
    still: Scene,
    movers: Vec<Mover>,
    /// The ball; `None` before it is thrown.
    ball: Option<Mover>,
    /// How fast it is thrown (m/s); `None` where none is.
    thrown_mps: Option<f64>,
    /// How high it flies (m).
    up_m: f64,
    time_s: f64,
}

impl Moving {
    fn new(movers: Movers, world: &World, seed: u64) -> Self {
        let mut random = Random::new(seed, MOVERS_STREAM);
        let mut still = Scene::of(world.name(), world.obstacles().to_vec());
        still.seed = world.seed();
        still.goals = world.goals().to_vec();
        still.bounds = *world.bounds();
        still.flight_height_m = world.flight_height_m();
        let drawn = (0..movers.count).map(|number| Mover::draw(number, movers.fastest_mps, &mut random));
        Self {
            movers: drawn.collect(),
            thrown_mps: movers
                .is_thrown
                .then(|| random.between(THROWN_MPS[0], THROWN_MPS[1])),
            up_m: still.flight_height_m,
            still,
            ball: None,
            time_s: 0.0,
        }
    }

    fn step(&mut self, passed_s: f64, vehicle_north_m: f64) {
        self.time_s += passed_s;
        for mover in &mut self.movers {
            mover.step(self.time_s, passed_s);
        }
        if let Some(ball) = &mut self.ball {
            ball.east_m += ball.east_mps * passed_s;
        } else if let Some(speed_mps) = self.thrown_mps
            && vehicle_north_m > THROWN_AT_M
        {
            self.ball = Some(Mover {
                north_m: vehicle_north_m + THROWN_AHEAD_M,
                east_m: -THROWN_BESIDE_M,
                north_mps: 0.0,
                east_mps: speed_mps,
                changes_s: f64::INFINITY,
                then_mps: [0.0; 2],
            });
        }
    }

    fn world(&self) -> World {
        let mut scene = self.still.clone();
        scene.obstacles.extend(self.movers.iter().map(|mover| {
            Obstacle::Cylinder(Cylinder {
                north_m: mover.north_m,
                east_m: mover.east_m,
                radius_m: MOVER_RADIUS_M,
                top_m: MOVER_TOP_M,
            })
        }));
        scene.obstacles.extend(self.ball.map(|ball| {
            Obstacle::Sphere(Sphere {
                north_m: ball.north_m,
                east_m: ball.east_m,
                up_m: self.up_m,
                radius_m: THROWN_RADIUS_M,
            })
        }));
        World::new(scene)
    }
}

impl Mover {
    fn draw(number: u32, fastest_mps: f64, random: &mut Random) -> Self {
        let speed_mps = random.between(MOVER_SLOWEST_MPS, fastest_mps);
        let sign = if random.unit() < 0.5 { 1.0 } else { -1.0 };
        let angle_rad = random.between(0.0, std::f64::consts::TAU);
        let crosses = number.is_multiple_of(2);
        let [north_mps, east_mps] = match crosses {
            true => [0.0, sign * speed_mps],
            false => [speed_mps * angle_rad.cos(), speed_mps * angle_rad.sin()],
        };
        let changes = number % 4 == 3;
        let stops = random.unit() < 0.5;
        let (turned_rad, at_s) = (random.between(0.5, 3.0), random.between(10.0, 40.0));
        let (sin, cos) = turned_rad.sin_cos();
        let turned_mps = [north_mps * cos - east_mps * sin, north_mps * sin + east_mps * cos];
        Self {
            north_m: random.between(STRIP_NORTH_M[0], STRIP_NORTH_M[1]),
            east_m: random.between(-STRIP_EAST_M, STRIP_EAST_M),
            north_mps,
            east_mps,
            changes_s: if changes { at_s } else { f64::INFINITY },
            then_mps: if stops { [0.0; 2] } else { turned_mps },
        }
    }

    /// One step, turned back at the edges of the strip.
    fn step(&mut self, time_s: f64, passed_s: f64) {
        if time_s >= self.changes_s {
            [self.north_mps, self.east_mps] = self.then_mps;
            self.changes_s = f64::INFINITY;
        }
        self.north_m += self.north_mps * passed_s;
        self.east_m += self.east_mps * passed_s;
        let [low_m, high_m] = STRIP_NORTH_M;
        if self.north_m < low_m {
            self.north_mps = self.north_mps.abs();
        } else if self.north_m > high_m {
            self.north_mps = -self.north_mps.abs();
        }
        if self.east_m.abs() > STRIP_EAST_M {
            self.east_mps = -self.east_mps.abs().copysign(self.east_m);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use jink_simulated_world::world::{Benchmark, WorldKind};

    #[test]
    fn what_moves_stays_in_its_strip_and_moves_as_fast_as_it_says() {
        let world = World::generate(WorldKind::Benchmark(Benchmark::Glade), 1).unwrap();
        let mut moving = Moving::new(Movers::crowd(40, 2.0), &world, 1);
        let (mut stopped, begin) = (0, moving.movers.clone());
        for _ in 0..3_000 {
            let before = moving.movers.clone();
            moving.step(0.02, 0.0);
            for (old, new) in before.iter().zip(&moving.movers) {
                let moved_mps = (new.north_m - old.north_m).hypot(new.east_m - old.east_m) / 0.02;
                assert!(moved_mps < 2.0 + 1e-9, "{moved_mps}");
                assert!((4.9..35.1).contains(&new.north_m) && new.east_m.abs() < 10.1);
            }
        }
        for (first, last) in begin.iter().zip(&moving.movers) {
            assert!(first.north_mps.hypot(first.east_mps) >= 0.5);
            stopped += u32::from(last.north_mps.hypot(last.east_mps) == 0.0);
        }
        assert!((1..=10).contains(&stopped), "{stopped} of 40");
        assert_eq!(moving.world().obstacles().len(), world.obstacles().len() + 40);
    }

    #[test]
    fn a_ball_is_thrown_when_the_vehicle_comes() {
        let world = World::generate(WorldKind::Benchmark(Benchmark::Glade), 1).unwrap();
        let mut moving = Moving::new(Movers::thrown(), &world, 1);
        moving.step(0.02, 10.0);
        assert!(moving.ball.is_none());
        moving.step(0.02, 16.0);
        moving.step(1.0, 16.0);
        let ball = moving.ball.unwrap();
        assert!((-6.0..=-4.0).contains(&ball.east_m), "{}", ball.east_m);
    }
}
