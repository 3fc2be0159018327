//! What only a simulator knows: where the vehicle really is and how close it came.

use crate::coded::{Coded, Flag};
use crate::frames::{Attitude, LocalNed, Point, Velocity};
use crate::vehicle::NavMode;

crate::sample! {
    /// Ground truth of a simulated flight.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct SimTruth: 184 {
        /// True position.
        pub position: Point<LocalNed>,
        /// True velocity.
        pub velocity: Velocity<LocalNed>,
        /// True `local_q_body`.
        pub attitude: Attitude,
        /// Distance from the vehicle's hull to the nearest obstacle now (m); negative inside.
        pub clearance_m: f64,
        /// Smallest of those since take-off (m); infinity before.
        pub min_clearance_m: f64,
        /// Way flown since take-off (m).
        pub flown_m: f64,
        /// Time under way (in the air, outside take-off and landing) (s).
        pub cruise_s: f64,
        /// Way flown in that time (m).
        pub cruise_m: f64,
        /// Simulated time since the start (s).
        pub time_s: f64,
        /// Largest time between two setpoints the autopilot received in automatic flight (s).
        pub setpoint_gap_max_s: f64,
        /// Setpoints the autopilot received.
        pub setpoints: u64,
        /// How often a message of the companion did not carry the sequence number after that of the one before: each
        /// one a loss, a repetition or a start anew.
        pub sequence_breaks: u64,
        /// Contacts with obstacles, counted once each.
        pub collisions: u32,
        /// How often the autopilot fell back to Hold because its companion failed it.
        pub hold_count: u32,
        /// Mission item being flown.
        pub mission_item: u16,
        /// Mission items.
        pub mission_items: u16,
        /// Mode.
        pub mode: Coded<NavMode>,
        /// Motors armed.
        pub armed: Flag,
        /// On the ground.
        pub landed: Flag,
        /// The last mission item has been reached.
        pub mission_done: Flag,
        /// Radius of the vehicle's hull (m).
        pub hull_radius_m: f64,
        /// Largest time by which the simulation ran behind the board's clock since take-off (s); 0 in lock-step.
        pub late_max_s: f64,
    }
    plausible if Self::is_consistent
}

impl SimTruth {
    /// Whether it is a motion, and its figures are some.
    pub fn is_consistent(&self) -> bool {
        let figures = [
            self.clearance_m,
            self.min_clearance_m,
            self.flown_m,
            self.cruise_s,
            self.cruise_m,
        ];
        self.position.is_finite()
            && self.velocity.is_finite()
            && self.attitude.is_rotation()
            && self.time_s.is_finite()
            && figures.iter().all(|figure| !figure.is_nan())
    }
}
