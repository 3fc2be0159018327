//! PX4's own collision prevention: keeps a pilot in Position mode from what rangefinders and companions see.
//!
//! | in | out |
//! |---|---|
//! | attitude, [`DistanceSensor`]s, [`ObstacleDistance`] | the fused map: 72 bins of 5 degrees about the nose |
//! | wanted acceleration, velocity setpoint, boot time | the acceleration that is allowed, warnings, the wish for Hold |
//!
//! ```
//! use jink_emulated_px4::collision_prevention::{CollisionPrevention, ObstacleDistance, Settings};
//! use nalgebra::Vector2;
//!
//! let settings = Settings { distance_m: 4.0, ..Settings::default() };
//! let mut prevention = CollisionPrevention::new(settings);
//! prevention.obstacle_distance(ObstacleDistance { distances_cm: [500; 72], ..ObstacleDistance::default() });
//! let outcome = prevention.tick(10_000, Vector2::new(3.0, 0.0), Vector2::zeros());
//! assert!(outcome.setpoint_mps2.x < 0.1, "a metre beyond the distance to keep hardly anything is left");
//! ```
//!
//! As PX4 main of August 2026 does it, **defects included**: it is there to be compared with, not to be imitated. In
//! single precision, with wrapping time stamps, and in the order of PX4's own steps. Two guards are ours, for what ends
//! PX4's process: at most 72 elements of a message are read, and increments beyond 360 degrees write nothing. The
//! parts, in the order of a tick:
//!
//! | file | idea |
//! |---|---|
//! | `settings`, `message` | what it is given |
//! | `rangefinder`, `scan` | readings into bins |
//! | `map`, `angle` | which reading a bin keeps, when it forgets |
//! | `guidance` | a little to the side, where it is freer |
//! | `constraint` | less acceleration towards the nearest obstacle |
//! | `braking` | against a velocity that could not be stopped any more |
//! | `silence` | no data: no motion, a warning, Hold |
//!
//! What a better one would do differently: the nearest of all readings should count in a bin, not the newest;
//! everything ahead should limit the setpoint, not the single closest bin; a bin nearer than the sensor's minimum
//! should brake, not make the setpoint NaN; and a centred stick should brake, too.

mod angle;
mod braking;
mod constraint;
mod guidance;
mod map;
mod message;
mod rangefinder;
mod scan;
mod settings;
mod silence;

pub use braking::{Braking, speed_to_stop_mps};
pub use constraint::authority;
pub use guidance::{Guidance, guide};
pub use map::{BINS, Map, UNKNOWN_CM, accepts};
pub use message::{DistanceSensor, INSTANCES, ObstacleDistance, frame};
pub use rangefinder::{Projection, project};
pub use settings::Settings;

use nalgebra::Vector2;
use silence::Silence;

/// A setpoint not longer than this is a stick at rest (m/s^2).
const STICK_AT_REST_MPS2: f32 = 0.001;

/// What a tick came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// CP_DIST is positive. If not, the setpoint is the one that was given and nothing else below means anything.
    pub active: bool,
    /// The acceleration that is allowed, world frame, north and east (m/s^2). May be NaN.
    pub setpoint_mps2: Vector2<f32>,
    /// At least one bin is known.
    pub data_present: bool,
    /// The pilot is to be warned of missing data: at most once a second.
    pub warns_of_no_data: bool,
    /// Hold is asked for.
    pub wants_hold: bool,
    /// A message came in this frame, which is not understood.
    pub unsupported_frame: Option<u8>,
    /// Distance of the closest bin (m); 655.35 if all are unknown.
    pub closest_m: f32,
    /// Its direction, world frame.
    pub closest_direction: Vector2<f32>,
    /// Distance that is kept (m).
    pub keep_m: f32,
    /// How the setpoint came about; `None` without data or with the stick at rest.
    pub steering: Option<Steering>,
}

/// How a setpoint came about: `constrained_mps2 + braking.acceleration_mps2 * braking.direction`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steering {
    /// The direction after guidance.
    pub guidance: Guidance,
    /// It may be flown in.
    pub feasible: bool,
    /// What is left of the wanted acceleration, world frame (m/s^2).
    pub constrained_mps2: Vector2<f32>,
    /// What is added against the velocity.
    pub braking: Braking,
}

/// The algorithm with its memory.
#[derive(Clone, Debug)]
pub struct CollisionPrevention {
    settings: Settings,
    unread: Unread,
    attitude: [f32; 4],
    yaw_rad: f32,
    map: Map,
    published_cm: [u16; BINS],
    silence: Silence,
}

/// Queues of length one: what has come since the last tick.
#[derive(Clone, Copy, Debug, Default)]
struct Unread {
    attitude: Option<[f32; 4]>,
    distance_sensors: [Option<DistanceSensor>; INSTANCES],
    obstacle_distance: Option<ObstacleDistance>,
}

impl CollisionPrevention {
    /// Knows nothing yet; the nose points north.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            unread: Unread::default(),
            attitude: [1.0, 0.0, 0.0, 0.0],
            yaw_rad: 0.0,
            map: Map::default(),
            published_cm: [UNKNOWN_CM; BINS],
            silence: Silence::default(),
        }
    }

    /// Forgets everything but the settings and what has not been read yet.
    pub fn restart(&mut self) {
        *self = Self {
            unread: self.unread,
            ..Self::new(self.settings)
        };
    }

    /// Changes the settings; they count from the next tick on.
    pub fn set(&mut self, settings: Settings) {
        self.settings = settings;
    }

    /// The attitude, `world_q_body` as w, x, y, z. The last one counts, however old.
    pub fn attitude(&mut self, world_q_body: [f32; 4]) {
        self.unread.attitude = Some(world_q_body);
    }

    /// A reading of rangefinder `instance`, 0 to 9; others do not exist.
    pub fn distance_sensor(&mut self, instance: usize, reading: DistanceSensor) {
        if let Some(slot) = self.unread.distance_sensors.get_mut(instance) {
            *slot = Some(reading);
        }
    }

    /// Distances all around.
    pub fn obstacle_distance(&mut self, message: ObstacleDistance) {
        self.unread.obstacle_distance = Some(message);
    }

    /// One cycle at boot time `now_us`: reads what has come and limits the acceleration `setpoint_mps2` of a vehicle
    /// whose velocity setpoint is `velocity_mps`; both in the world frame, north and east. While CP_DIST is not
    /// positive nothing is read.
    pub fn tick(&mut self, now_us: u64, setpoint_mps2: Vector2<f32>, velocity_mps: Vector2<f32>) -> Outcome {
        let active = self.silence.activate(now_us, self.settings.is_active());
        let unsupported_frame = if active { self.read(now_us) } else { None };
        let closest = self.map.closest();
        let mut outcome = Outcome {
            active,
            setpoint_mps2,
            data_present: false,
            warns_of_no_data: false,
            wants_hold: false,
            unsupported_frame,
            closest_m: self.map.distance_m(closest),
            closest_direction: angle::bin_direction(self.yaw_rad, closest as i32),
            keep_m: (f32::from(self.map.min_cm) / 100.0).max(self.settings.distance_m),
            steering: None,
        };
        if !active {
            return outcome;
        }
        outcome.data_present = self.map.is_present(now_us);
        if !outcome.data_present {
            outcome.setpoint_mps2 = Vector2::zeros();
            (outcome.warns_of_no_data, outcome.wants_hold) = self.silence.step(now_us, self.map.time_us);
        } else if setpoint_mps2.norm() > STICK_AT_REST_MPS2 {
            let steering = self.steer(now_us, setpoint_mps2, velocity_mps, &outcome);
            // Without anything to brake for this is infinity times zero: NaN, as in PX4.
            outcome.setpoint_mps2 =
                steering.constrained_mps2 + steering.braking.direction * steering.braking.acceleration_mps2;
            outcome.steering = Some(steering);
        }
        outcome
    }

    /// Reads what has come, publishes, and only then forgets what is old.
    fn read(&mut self, now_us: u64) -> Option<u8> {
        let unread = std::mem::take(&mut self.unread);
        if let Some(attitude) = unread.attitude {
            self.attitude = attitude;
            self.yaw_rad = angle::heading_rad(attitude);
        }
        for reading in unread.distance_sensors.iter().flatten() {
            rangefinder::ingest(&mut self.map, now_us, reading, self.attitude);
        }
        let unsupported = unread
            .obstacle_distance
            .and_then(|message| scan::ingest(&mut self.map, now_us, &message, self.yaw_rad));
        self.published_cm = self.map.distance_cm;
        self.map.forget_stale(now_us);
        unsupported
    }

    fn steer(
        &self,
        now_us: u64,
        setpoint_mps2: Vector2<f32>,
        velocity_mps: Vector2<f32>,
        so_far: &Outcome,
    ) -> Steering {
        let (map, yaw_rad, settings) = (&self.map, self.yaw_rad, &self.settings);
        let guidance = guide(&map.distance_cm, setpoint_mps2, yaw_rad, settings);
        let braking = braking::brake(map, now_us, yaw_rad, velocity_mps, so_far.keep_m, settings);
        let feasible = constraint::is_feasible(map, guidance.bin, settings);
        let constrained_mps2 = if feasible {
            let towards = (so_far.closest_m, so_far.closest_direction);
            let share =
                constraint::constrain(map, yaw_rad, guidance.direction, towards, so_far.keep_m, settings);
            share * setpoint_mps2.norm()
        } else {
            Vector2::zeros()
        };
        Steering {
            guidance,
            feasible,
            constrained_mps2,
            braking,
        }
    }

    /// The map as it is now.
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The distances as published in the last tick (cm): bins that expired in it are still there.
    pub fn published_cm(&self) -> &[u16; BINS] {
        &self.published_cm
    }

    /// The heading in use (rad).
    pub fn yaw_rad(&self) -> f32 {
        self.yaw_rad
    }
}

#[cfg(test)]
mod tests;
