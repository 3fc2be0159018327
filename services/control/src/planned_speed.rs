//! How fast plans get, and how closely they assume that the vehicle follows: as the planner says it.

use crate::figures::round;
use jink_shared_types::motion::Route;
use serde::Serialize;

/// What of it concerns a person.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlannedSpeed {
    /// The highest speed that plans reach (m/s): they end at rest in known space, braking no harder than the vehicle follows.
    pub reached_mps: f64,
    /// The highest speed that is allowed (m/s).
    pub allowed_mps: f64,
    /// Corners that the vehicle cuts (m per m/s2).
    pub cut_s2: f64,
    /// Overshoot of stops (m per m/s2).
    pub overshoot_s2: f64,
}

impl PlannedSpeed {
    /// Of `route`; `None` while the planner does not know how closely the vehicle follows.
    pub fn of(route: &Route) -> Option<Self> {
        let tracking = route.tracking.known()?;
        Some(Self {
            reached_mps: round(f64::from(route.reached_mps)),
            allowed_mps: round(f64::from(route.allowed_mps)),
            cut_s2: round(tracking.cut_s2),
            overshoot_s2: round(tracking.overshoot_s2),
        })
    }

    /// For people, a line.
    pub fn line(&self) -> String {
        let Self {
            reached_mps,
            allowed_mps,
            cut_s2,
            overshoot_s2,
        } = self;
        format!(
            "speed: plans reach {reached_mps:.1} of {allowed_mps:.1} m/s; cuts corners {cut_s2:.2} s2, overshoots {overshoot_s2:.2} s2\n"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::PlannedSpeed;
    use jink_shared_types::motion::Route;
    use jink_shared_types::tracking::Tracking;

    #[test]
    fn nothing_is_shown_before_it_is_known_and_then_a_line_of_a_screen() {
        assert_eq!(PlannedSpeed::of(&Route::default()), None);
        let route = Route {
            tracking: Tracking::PX4_OFFBOARD,
            reached_mps: 5.21,
            allowed_mps: 8.0,
            ..Route::default()
        };
        let line = PlannedSpeed::of(&route).unwrap().line();
        assert_eq!(
            line,
            "speed: plans reach 5.2 of 8.0 m/s; cuts corners 0.09 s2, overshoots 0.14 s2\n"
        );
        assert!(line.len() <= 81, "{}", line.len());
    }
}
