//! How closely plans assume that the vehicle follows: what is known of the profile that is flown, or what was learned in flight where
//! that is less closely. What is learned is kept as parameters, across flights.

use super::Planner;
use crate::committed_trajectory::is_flown;
use jink_shared_types::motion::{ApprovedTrajectory, Verdict};
use jink_shared_types::params;
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::{NavMode, VehicleState};
use jink_shared_types::{Stamped, Timestamp};

/// What was learned is kept where it is more than what is known by this factor: less is noise.
const LEARNED_BEYOND: f64 = 1.15;
/// It is kept at most once in this time (s).
const LEARNED_EVERY_S: f64 = 10.0;

impl Planner {
    /// Plans as hard as the autopilot follows: as is known of the profile, or as was learned if that is less closely. The
    /// tubes stay the same, and with them what is inflated and what is committed.
    pub(super) fn take_tracking(&mut self, state: &VehicleState) {
        self.profile_tracking = state.tracking.known().or(self.profile_tracking);
        let Some(profile) = self.profile_tracking else {
            return;
        };
        let [cut_s2, overshoot_s2] =
            [&params::OA_TRK_CUT, &params::OA_TRK_OVER].map(|figure| self.params.get(figure));
        let tracking = profile.looser(cut_s2, overshoot_s2);
        if tracking != self.tracking {
            self.tracking = tracking;
            self.update_limits();
        }
        self.report_speed();
    }

    /// Learns from where the vehicle is while it should be on what is approved.
    pub(super) fn learn(&mut self, state: &Stamped<'_, VehicleState>, approved: Option<&ApprovedTrajectory>) {
        let is_led = match state.mode.get() {
            NavMode::Offboard => self.follows_setpoints,
            NavMode::Mission => !self.follows_setpoints,
            _ => false,
        };
        let time = state.header.capture;
        let reference = approved
            .filter(|approved| is_led && matches!(approved.verdict.get(), Verdict::Passed | Verdict::Kept))
            .map(|approved| &approved.trajectory)
            .filter(|trajectory| is_flown(trajectory) && time >= trajectory.start)
            .and_then(|trajectory| trajectory.at(time));
        match reference {
            Some(reference) => self.following.add(time, &state.position, &reference),
            None => self.following.pause(),
        }
    }

    /// What is to be kept of how closely the vehicle follows, if it was learned that this is less closely than is known: only the
    /// figures that are, zero for the others. What is known of this profile would bind one that follows more closely.
    pub fn learned(&mut self, now: Timestamp) -> Option<Tracking> {
        if self.profile_tracking.is_none() || now < self.learned_after {
            return None;
        }
        let learned = self.following.learned();
        let kept = Tracking {
            cut_s2: kept_s2(learned.cut_s2, self.tracking.cut_s2, params::OA_TRK_CUT.max),
            overshoot_s2: kept_s2(
                learned.overshoot_s2,
                self.tracking.overshoot_s2,
                params::OA_TRK_OVER.max,
            ),
            ..Tracking::default()
        };
        (kept != Tracking::default()).then(|| {
            self.learned_after = now.plus_seconds(LEARNED_EVERY_S);
            kept
        })
    }
}

/// What is kept of a figure (s2): upwards to the hundredth, so that the same is not learned again at once; zero if it is hardly more than is known.
fn kept_s2(learned_s2: f64, known_s2: f64, most_s2: f64) -> f64 {
    if learned_s2 > LEARNED_BEYOND * known_s2 {
        ((learned_s2 * 100.0).ceil() / 100.0).min(most_s2)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::kept_s2;

    #[test]
    fn only_what_is_much_more_than_was_known_is_kept_and_then_it_is_known() {
        for (learned_s2, expected_s2) in [(0.0, 0.0), (0.16, 0.0), (0.19, 0.0), (0.201, 0.21), (7.0, 2.0)] {
            assert_eq!(kept_s2(learned_s2, 0.17, 2.0), expected_s2, "{learned_s2}");
            assert_eq!(
                kept_s2(learned_s2.min(2.0), expected_s2.max(0.17), 2.0),
                0.0,
                "{learned_s2}"
            );
        }
    }
}
