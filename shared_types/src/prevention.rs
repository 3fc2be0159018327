//! Collision prevention between processes: the pilot's demand, and what of it may be flown.

use crate::coded::Coded;
use crate::frames::{LocalNed, Velocity};
use crate::reserved::Reserved;

crate::sample! {
    /// What the pilot's sticks demand, where he steers through jink.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct PilotDemand: 32 {
        /// Horizontal velocity (m/s); its down component is zero and not read.
        pub velocity: Velocity<LocalNed>,
        /// Room for later fields, zero.
        pub reserved: Reserved<8>,
    }
    plausible if Self::is_consistent
}

impl PilotDemand {
    /// Whether it is a velocity.
    pub fn is_consistent(&self) -> bool {
        self.velocity.is_finite()
    }
}

crate::wire_enum! {
    /// What was done to a setpoint.
    pub enum PreventionState {
        /// Collision prevention is switched off: the setpoint is the demand.
        Off = 0 "off",
        /// Nothing.
        Free = 1 "free",
        /// Turned or slowed.
        Acting = 2 "acting",
        /// No data: no motion.
        Blind = 3 "blind",
        /// No data for so long that the autopilot is to hold.
        Hold = 4 "hold",
    }
}

crate::wire_enum! {
    /// Why something was done to a setpoint.
    pub enum PreventionCause {
        /// Nothing was done.
        None = 0 "none",
        /// A better direction nearby was taken.
        Guided = 1 "guided",
        /// An obstacle is there.
        Obstacle = 2 "obstacle",
        /// It is too fast for how far the sensors see.
        Reach = 3 "reach",
        /// It leads where no sensor looks.
        Unseen = 4 "unseen",
        /// No sensor has data.
        NoData = 5 "no data",
        /// A number is NaN.
        BadInput = 6 "bad input",
    }
}

crate::sample! {
    /// What of a pilot's demand may be flown.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct PreventedDemand: 40 {
        /// Horizontal velocity (m/s); its down component is zero.
        pub velocity: Velocity<LocalNed>,
        /// Distance of the nearest obstacle, or of the nearest end of what is known (m); 0 = nothing is known.
        pub nearest_m: f32,
        /// What was done.
        pub state: Coded<PreventionState>,
        /// Why.
        pub cause: Coded<PreventionCause>,
        /// Explicit padding, zero.
        pub reserved: Reserved<2>,
        /// Room for later fields, zero.
        pub reserved_tail: Reserved<8>,
    }
    plausible if Self::is_consistent
}

impl PreventedDemand {
    /// Whether it is a velocity, beside a distance.
    pub fn is_consistent(&self) -> bool {
        self.velocity.is_finite() && self.nearest_m >= 0.0
    }
}
