//! Approaches: a pilot pushes the vehicle at an obstacle and holds the stick. Where does it come to rest?
//!
//! | in | out |
//! |---|---|
//! | [`Cell`]: scene, speed, directions, delay of the sensor, who prevents | [`Approach`]: distances, times, oscillation; its [`Moment`]s |
//!
//! Flown with the whole chain in lock-step (`lockstep.rs`). Whoever prevents, autopilot, vehicle, sensor, link, scene and stick are the
//! same, and so are CP_DIST, CP_DELAY, CP_GUIDE_ANG and MPC_*:
//!
//! | who | CP_DIST on | what it works from |
//! |---|---|---|
//! | [`Who::Jink`] | jink, profile `px4_deviation` | the guard's ring |
//! | [`Who::Px4`] | the emulated current PX4 | OBSTACLE_DISTANCE, made of the same ring, ten times a second |
//! | [`Who::Nobody`] | neither | only shows that the scene is dangerous |
//!
//! Distances are those of the vehicle's centre to the nearest surface, as CP_DIST counts; a collision is a contact of the hull.

mod cells;
mod flight;
mod measure;
mod plot;
mod scene;
mod table;

pub use cells::{Filter, cells};
pub use flight::fly;
pub use plot::{is_drawn, plots};
pub use scene::{Place, Scene};
pub use table::table;

use serde::Serialize;

/// Distance to keep (m).
pub const CP_DIST_M: f64 = 2.0;
/// What CP_DELAY allows for link and tracking (s): PX4's documentation says 0.1 to 0.5.
pub const LINK_AND_TRACKING_S: f64 = 0.3;

/// Who keeps the vehicle from the obstacle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Who {
    /// jink, between the pilot's sticks and Position mode.
    Jink,
    /// The autopilot itself.
    Px4,
    /// Nobody.
    Nobody,
}

/// What is not as usual.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Variant {
    /// Nothing: a lidar that sees 50 m, true stamps, CP_DELAY as documented, calm air.
    Usual,
    /// CP_DELAY is 0.
    NoDelaySet,
    /// The lidar sees 12 m.
    NearSighted,
    /// The driver stamps its scans when they arrive.
    StampedOnArrival,
    /// Wind of 3 m/s from behind, with gusts of 1.5 m/s (one sigma).
    Gusts,
}

impl Variant {
    /// For the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Usual => "as documented",
            Self::NoDelaySet => "CP_DELAY 0",
            Self::NearSighted => "lidar of 12 m",
            Self::StampedOnArrival => "stamped on arrival",
            Self::Gusts => "wind 3 m/s, gusts 1.5",
        }
    }

    /// How far the lidar sees (m).
    pub fn range_m(self) -> f64 {
        if self == Self::NearSighted { 12.0 } else { 50.0 }
    }
}

/// One approach.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// What stands there.
    pub scene: Scene,
    /// CP_GUIDE_ANG (deg).
    pub guide_deg: f64,
    /// Speed that the stick asks for (m/s).
    pub speed_mps: f64,
    /// Heading of the vehicle, clockwise from the direction of motion (deg).
    pub heading_deg: f64,
    /// The scene is turned by this (deg): 0 is struck head-on.
    pub incidence_deg: f64,
    /// Delay of the sensor (s).
    pub delay_s: f64,
    /// What is not as usual.
    pub variant: Variant,
    /// Who prevents.
    pub who: Who,
    /// Seed of the sensor's noise and of the wind.
    pub seed: u64,
}

impl Cell {
    /// Head-on, without guidance, with a sensor that delays nothing.
    pub fn new(scene: Scene, speed_mps: f64, who: Who) -> Self {
        Self {
            scene,
            guide_deg: 0.0,
            speed_mps,
            heading_deg: 0.0,
            incidence_deg: 0.0,
            delay_s: 0.0,
            variant: Variant::Usual,
            who,
            seed: 1,
        }
    }

    /// CP_DELAY (s).
    pub fn cp_delay_s(&self) -> f64 {
        if self.variant == Variant::NoDelaySet {
            0.0
        } else {
            self.delay_s + LINK_AND_TRACKING_S
        }
    }

    /// What stands ahead begins here (m): far enough to get to the speed, and to see it coming.
    pub fn ahead_m(&self) -> f64 {
        6.0 + 2.5 * self.speed_mps + 0.5 * self.speed_mps * self.speed_mps
    }

    /// In words, for file names and lines.
    pub fn name(&self) -> String {
        let guided = if self.guide_deg > 0.0 { "_guided" } else { "" };
        format!(
            "{}{guided}_{}mps_h{}_i{}_d{}_{:?}_{:?}",
            self.scene.name(),
            self.speed_mps,
            self.heading_deg,
            self.incidence_deg,
            (self.delay_s * 1000.0).round(),
            self.variant,
            self.who
        )
        .to_lowercase()
    }
}

/// The vehicle every 20 ms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Moment {
    /// Since the stick was pushed (s).
    pub time_s: f64,
    /// Ahead (m).
    pub ahead_m: f64,
    /// To the right (m).
    pub right_m: f64,
    /// Velocity ahead and to the right (m/s).
    pub velocity_mps: [f64; 2],
    /// True acceleration ahead and to the right (m/s2).
    pub acceleration_mps2: [f64; 2],
    /// From the centre to the nearest surface (m).
    pub distance_m: f64,
    /// What jink sent, ahead and to the right (m/s): zero before it does.
    pub setpoint_mps: [f64; 2],
    /// Where the person is, if one walks (m).
    pub person_m: Option<[f64; 2]>,
}

impl Moment {
    /// Horizontal speed (m/s).
    pub fn speed_mps(&self) -> f64 {
        self.velocity_mps[0].hypot(self.velocity_mps[1])
    }
}

/// How an approach ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// It came to rest.
    Rest,
    /// It passed what stood there.
    Passed,
    /// It goes on, along something.
    Moving,
    /// The hull touched something.
    Collision,
}

/// What an approach came to. Distances are less CP_DIST: 0 is where the vehicle should be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Approach {
    /// Which one.
    pub cell: Cell,
    /// How it ended.
    pub ending: Ending,
    /// Highest speed (m/s).
    pub reached_mps: f64,
    /// Smallest distance (m).
    pub nearest_m: f64,
    /// Distance at rest, the mean of the last second (m).
    pub rest_m: Option<f64>,
    /// From 15 m before CP_DIST, or from the start if that is nearer, until it rests (s).
    pub rest_after_s: Option<f64>,
    /// Until it has passed (s).
    pub passed_after_s: Option<f64>,
    /// Speed at the first contact (m/s).
    pub impact_mps: Option<f64>,
    /// How far off it was slower than nine tenths of its highest speed for good (m).
    pub slows_at_m: f64,
    /// Changes of sign of the closing speed after the first rest, beyond 0.05 m/s.
    pub reversals: u32,
    /// Between the least and the largest distance in the last five seconds (m), if it rested.
    pub swing_m: Option<f64>,
    /// Speed to the side in the last five seconds (m/s): along a wall that is struck obliquely.
    pub aside_mps: f64,
    /// Mean speed ahead until the end (m/s).
    pub ahead_mps: f64,
    /// Hardest true acceleration (m/s2).
    pub acceleration_mps2: f64,
    /// Turns of the velocity to the side beyond 0.05 m/s, each second.
    pub weaving_hz: f64,
    /// jink: largest change between two setpoints after the start (m/s).
    pub setpoint_jump_mps: f64,
    /// jink: turns of the setpoint to the side beyond 0.05 m/s, each second.
    pub setpoint_weaving_hz: f64,
}
