//! How closely an autopilot follows a trajectory: the table that planner, generator, guard and judges use.
//!
//! A trajectory is certified for a tube around it, in which the vehicle stays. Corner cutting grows with the commanded
//! acceleration `a`, and hardly with the speed alone: `tube = BASE + CUT * a`. Past the end of a stop the vehicle runs
//! `OVERSHOOT * a`, with the greatest deceleration `a`; both hold up to the hardest braking that was measured. Which numbers
//! hold belongs to the way in which the autopilot is commanded, so the gateway, which knows it, publishes them with the
//! vehicle's state.

/// Tracking error on a straight (m): 0.02 to 0.03 m measured, doubled for wind and for other airframes.
pub const TUBE_BASE_M: f64 = 0.06;

/// Figures beyond these (s^2, m/s^2, m/s^3) describe no autopilot.
const PLAUSIBLE_S2: f64 = 5.0;
const PLAUSIBLE_BRAKING_MPS2: f64 = 20.0;
const PLAUSIBLE_JERK_MPS3: f64 = 500.0;

crate::sample! {
    /// How closely the autopilot follows what it is sent. Zeros: not known.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Tracking: 32 {
        /// Corner cutting per commanded acceleration (m per m/s^2).
        pub cut_s2: f64,
        /// Overshoot of a stop per greatest deceleration (m per m/s^2).
        pub overshoot_s2: f64,
        /// Hardest braking to rest that it follows as the other figures say (m/s^2).
        pub braking_mps2: f64,
        /// Jerk of that braking (m/s^3).
        pub braking_jerk_mps3: f64,
    }
}

impl Tracking {
    /// PX4 1.11 to 1.15 with its trajectory interface: the loosest. PX4 smooths every curve once more
    /// with its own limits (acceleration 3 m/s^2, jerk 4 m/s^3). Measured: in waves with 1.8 m/s^2 of lateral
    /// acceleration at 3 m/s corners were cut by up to 0.60 m, in jink's own turns in a forest, planned with
    /// 1.2 m/s^2 at 2 m/s, by 0.50 m; a tenth is added for airframes that follow less well. Stops ran 0.93 m past their
    /// end at 2 m/s^2, 1.37 m at 3 m/s^2. Below half of PX4's own acceleration limit the linear law holds.
    pub const PX4_TRAJECTORY: Self = Self {
        cut_s2: 0.41,
        overshoot_s2: 0.47,
        // A quarter more than plans accelerate with; beyond half of MPC_ACC_HOR (3) PX4 brakes in a way of its own.
        braking_mps2: 1.3,
        braking_jerk_mps3: 3.2,
    };

    /// PX4 in OFFBOARD, with positions, velocities and accelerations 50 times a second, velocity and acceleration sent early, and errors
    /// answered as if its gains were higher, as the gateway does. Measured in forests at up to 7.7 m/s, planned with 3.6 m/s^2:
    /// 0.34 m at most in three flights, with 3.0 m/s^2 0.21 m in three (PX4 of today) and 0.24 m in two (PX4 of 2021). Stops: 0.31 m
    /// past their end at 3.5 m/s^2, 0.50 m at 5.9 m/s^2: OFFBOARD has no limit of acceleration but the tilt (MPC_TILTMAX_AIR, 45 degrees:
    /// 9.8 m/s^2).
    pub const PX4_OFFBOARD: Self = Self {
        cut_s2: 0.09,
        overshoot_s2: 0.14,
        braking_mps2: 6.0,
        braking_jerk_mps3: 20.0,
    };

    /// ArduCopter in GUIDED, the same stream without any of that. Measured in slaloms: 0.12 m at 1.8 m/s^2, 0.18 m at 2.6 m/s^2; in
    /// forests at up to 7 m/s, planned with 1.5, 1.8 and 2.4 m/s^2, 0.28, 0.30 and 0.41 m. Stops 0.35 m past their end at 2 m/s^2, 0.80 m at 3.
    pub const ARDUPILOT_GUIDED: Self = Self {
        cut_s2: 0.17,
        overshoot_s2: 0.27,
        // Measured up to 4, but it corrects with 2.5 at most (WPNAV_ACCEL).
        braking_mps2: 3.0,
        braking_jerk_mps3: 6.0,
    };

    /// These figures; `None` if they are not known, or are none of an autopilot.
    pub fn known(self) -> Option<Self> {
        let is_known = |figure: f64, most: f64| figure > 0.0 && figure <= most;
        let are_known = is_known(self.cut_s2, PLAUSIBLE_S2)
            && is_known(self.overshoot_s2, PLAUSIBLE_S2)
            && is_known(self.braking_mps2, PLAUSIBLE_BRAKING_MPS2)
            && is_known(self.braking_jerk_mps3, PLAUSIBLE_JERK_MPS3);
        are_known.then_some(self)
    }

    /// With figures that are at least as loose as `cut_s2` and `overshoot_s2`.
    #[must_use]
    pub fn looser(self, cut_s2: f64, overshoot_s2: f64) -> Self {
        Self {
            cut_s2: self.cut_s2.max(cut_s2),
            overshoot_s2: self.overshoot_s2.max(overshoot_s2),
            ..self
        }
    }

    /// The deceleration (m/s^2) and jerk (m/s^3) of the shortest stop from `speed_mps` (m/s), the overshoot included, that are not
    /// below `least` and not above the hardest ones: the least of `v^2 / 2a + v a / 2j + k a` is at `a = v / sqrt(2 k + v / j)`.
    pub fn shortest_stop(&self, speed_mps: f64, least: (f64, f64)) -> (f64, f64) {
        let (least_mps2, least_mps3) = least;
        let spread = 2.0 * self.overshoot_s2 + speed_mps / self.braking_jerk_mps3;
        let braking_mps2 = (speed_mps / spread.sqrt()).min(self.braking_mps2).max(least_mps2);
        let jerk_mps3 = self.braking_jerk_mps3 * (braking_mps2 / self.braking_mps2).min(1.0);
        (braking_mps2, jerk_mps3.max(least_mps3))
    }

    /// The hardest stop that is asked for where nothing else is left: deceleration (m/s^2) and jerk (m/s^3). PX4's MPC_ACC_HOR is 3,
    /// its MPC_JERK_MAX 8.
    pub fn hardest_stop(&self) -> (f64, f64) {
        (self.braking_mps2.max(3.0), self.braking_jerk_mps3.max(6.0))
    }

    /// The tube (m) of a motion that accelerates by `acceleration_mps2` at most (m/s^2).
    pub fn tube_m(&self, acceleration_mps2: f64) -> f64 {
        TUBE_BASE_M + self.cut_s2 * acceleration_mps2
    }

    /// The acceleration (m/s^2) that a tube of `tube_m` (m) has room for; zero if that is below [`TUBE_BASE_M`].
    pub fn acceleration_mps2(&self, tube_m: f64) -> f64 {
        (tube_m - TUBE_BASE_M).max(0.0) / self.cut_s2
    }

    /// How far (m) the vehicle runs past the end of a stop with `deceleration_mps2` at most (m/s^2).
    pub fn overshoot_m(&self, deceleration_mps2: f64) -> f64 {
        self.overshoot_s2 * deceleration_mps2
    }
}

#[cfg(test)]
mod tests {
    use super::Tracking;
    use crate::motion::stopping_distance_m;
    use proptest::prelude::*;

    /// Acceleration asked for (m/s^2), corner cut (m).
    const CUTS: [(Tracking, &[(f64, f64)]); 3] = [
        (Tracking::PX4_TRAJECTORY, &[(0.0, 0.03), (1.2, 0.50), (1.8, 0.60)]),
        (Tracking::PX4_OFFBOARD, &[(0.0, 0.04), (3.0, 0.24), (3.6, 0.34)]),
        (
            Tracking::ARDUPILOT_GUIDED,
            &[(0.0, 0.03), (1.5, 0.28), (1.8, 0.30), (2.4, 0.41)],
        ),
    ];
    /// Deceleration asked for (m/s^2), overshoot (m).
    const OVERSHOOTS: [(Tracking, &[(f64, f64)]); 3] = [
        (Tracking::PX4_TRAJECTORY, &[(2.0, 0.93), (3.0, 1.37)]),
        (Tracking::PX4_OFFBOARD, &[(3.5, 0.31), (5.9, 0.50)]),
        (
            Tracking::ARDUPILOT_GUIDED,
            &[(2.0, 0.35), (3.0, 0.80), (4.0, 0.88)],
        ),
    ];

    #[test]
    fn no_figure_is_smaller_than_what_was_measured() {
        for (tracking, cuts) in CUTS {
            for (acceleration_mps2, cut_m) in cuts {
                assert!(
                    tracking.tube_m(*acceleration_mps2) > *cut_m,
                    "{tracking:?}: {cut_m} m"
                );
            }
        }
        for (tracking, overshoots) in OVERSHOOTS {
            for (deceleration_mps2, over_m) in overshoots {
                assert!(
                    tracking.overshoot_m(*deceleration_mps2) >= *over_m,
                    "{tracking:?}: {over_m} m"
                );
            }
        }
    }

    proptest! {
        #[test]
        fn no_other_braking_stops_in_less(speed_mps in 0.1..12.0f64, share in 0.05..1.0f64) {
            for (tracking, _) in CUTS {
                let needed_m = |(a, j): (f64, f64)| {
                    stopping_distance_m(speed_mps, 0.0, a, j) + tracking.overshoot_m(a)
                };
                let (best_mps2, _) = tracking.shortest_stop(speed_mps, (0.0, 0.0));
                prop_assert!(best_mps2 <= tracking.braking_mps2);
                let (jerk_mps3, other_mps2) = (tracking.braking_jerk_mps3, share * tracking.braking_mps2);
                let best_m = needed_m((best_mps2, jerk_mps3));
                prop_assert!(best_m <= needed_m((other_mps2, jerk_mps3)) + 1e-9);
            }
        }
    }

    #[test]
    fn a_tube_has_room_for_the_acceleration_that_needs_it() {
        for (tracking, _) in CUTS {
            for acceleration_mps2 in [0.0, 0.3, 2.0] {
                let room_mps2 = tracking.acceleration_mps2(tracking.tube_m(acceleration_mps2));
                assert!((room_mps2 - acceleration_mps2).abs() < 1e-9);
            }
            assert_eq!(tracking.acceleration_mps2(0.01), 0.0);
        }
    }

    #[test]
    fn figures_of_no_autopilot_are_not_known() {
        for figure in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9] {
            let unknown = Tracking {
                cut_s2: figure,
                ..Tracking::PX4_OFFBOARD
            };
            assert_eq!(unknown.known(), None);
        }
        assert_eq!(Tracking::default().known(), None);
        assert_eq!(Tracking::PX4_OFFBOARD.known(), Some(Tracking::PX4_OFFBOARD));
    }
}
