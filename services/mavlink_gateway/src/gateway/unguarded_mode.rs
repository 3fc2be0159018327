//! Modes in which the autopilot flies by itself where nobody looks for obstacles: it circles, follows somebody, or returns.
//!
//! | chosen in flight | jink |
//! |---|---|
//! | a circle, follow me, once | asks for Hold, and notifies the pilot |
//! | again within ten seconds, or with OA_UNGUARDED | lets it fly, and reports that |
//! | return: the pilot's way out, or the autopilot's own | lets it fly, and reports that |
//! | with `link.takes_missions` switched off; follow me and return of a PX4 that asks its companion for the way | nothing |

use super::Gateway;
use crate::demand::Demand;
use crate::executive::notice::MEANT_S;
use crate::executive::{PilotText, REPEAT_S, TRIES};
use crate::io::Outputs;
use jink_mavlink_link::profile_name::ProfileName;
use jink_shared_types::Timestamp;
use jink_shared_types::coded::Wire;
use jink_shared_types::events::{MODE_HELD, MODE_UNGUARDED};
use jink_shared_types::params::OA_UNGUARDED;
use jink_shared_types::vehicle::NavMode;

/// Watches for them.
#[derive(Clone, Copy, Debug)]
pub(super) struct UnguardedMode {
    mode: NavMode,
    /// One was refused then.
    refused: Timestamp,
    is_meant: bool,
    is_reported: bool,
    asked: Timestamp,
    tries: u32,
}

impl Default for UnguardedMode {
    fn default() -> Self {
        Self {
            mode: NavMode::Unknown,
            refused: Timestamp::NEVER,
            is_meant: false,
            is_reported: false,
            asked: Timestamp::NEVER,
            tries: 0,
        }
    }
}

impl UnguardedMode {
    /// One step in `mode`; `flies`: in the air with running motors, `is_allowed`: the pilot lets it fly.
    fn step(
        &mut self,
        now: Timestamp,
        mode: NavMode,
        flies: bool,
        is_allowed: bool,
    ) -> (Option<Demand>, Option<PilotText>) {
        let is_unguarded = matches!(mode, NavMode::Orbit | NavMode::Follow | NavMode::Return);
        if std::mem::replace(&mut self.mode, mode) != mode {
            self.is_reported = false;
            self.tries = 0;
            if is_unguarded {
                self.is_meant = self.refused.is_set() && now.seconds_since(self.refused) <= MEANT_S;
                self.refused = Timestamp::NEVER;
            }
        }
        if !is_unguarded || !flies {
            return (None, None);
        }
        let lets_fly = self.is_meant || is_allowed || mode == NavMode::Return;
        let update = (!std::mem::replace(&mut self.is_reported, true)).then_some(PilotText {
            event: if lets_fly { &MODE_UNGUARDED } else { &MODE_HELD },
            name: mode.name(),
            number: 0.0,
        });
        let is_due = self.tries == 0 || now.seconds_since(self.asked) >= REPEAT_S;
        if lets_fly || !is_due || self.tries >= TRIES {
            return (None, update);
        }
        self.refused = now;
        self.asked = now;
        self.tries += 1;
        (Some(Demand::Hold), update)
    }
}

impl Gateway {
    /// Holds before motions that nobody could guard.
    pub(super) fn watch_unguarded_modes(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let mode = self.vehicle.mode();
        let is_planned = matches!(mode, NavMode::Follow | NavMode::Return)
            && self.config.profile == ProfileName::Px4Trajectory;
        let flies = self.was_alive && self.vehicle.is_armed() && self.vehicle.has_taken_off() && !is_planned;
        if !self.config.takes_missions {
            return;
        }
        let is_allowed = self.params().get(&OA_UNGUARDED) > 0.0;
        let (demand, update) = self.unguarded_mode.step(now, mode, flies, is_allowed);
        if let Some(demand) = demand {
            self.demand(now, demand, outputs);
        }
        if let Some(update) = update {
            Self::notify_pilot(&update, outputs);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::UnguardedMode;
    use crate::demand::Demand;
    use jink_shared_types::Timestamp;
    use jink_shared_types::events::{Event, MODE_HELD, MODE_UNGUARDED};
    use jink_shared_types::vehicle::NavMode;

    struct Bench {
        watch: UnguardedMode,
        s: f64,
        flies: bool,
        is_allowed: bool,
    }

    impl Bench {
        fn new(flies: bool, is_allowed: bool) -> Self {
            Self {
                watch: UnguardedMode::default(),
                s: 10.0,
                flies,
                is_allowed,
            }
        }

        /// How often Hold was asked for, and what was reported.
        fn fly(&mut self, mode: NavMode, seconds: f64) -> (usize, Vec<&'static Event>) {
            let (mut asked, mut reported) = (0, Vec::new());
            let end_s = self.s + seconds;
            while self.s < end_s {
                self.s += 0.02;
                let now = Timestamp::from_seconds(self.s);
                let (demand, update) = self.watch.step(now, mode, self.flies, self.is_allowed);
                asked += usize::from(demand == Some(Demand::Hold));
                reported.extend(update.map(|update| update.event));
            }
            (asked, reported)
        }
    }

    #[test]
    fn a_circle_is_held_and_reported_unless_it_is_chosen_again() {
        let mut bench = Bench::new(true, false);
        assert_eq!(bench.fly(NavMode::Mission, 1.0), (0, vec![]));
        assert_eq!(bench.fly(NavMode::Orbit, 0.3), (1, vec![&MODE_HELD]));
        assert_eq!(bench.fly(NavMode::Hold, 3.0), (0, vec![]));
        assert_eq!(bench.fly(NavMode::Orbit, 5.0), (0, vec![&MODE_UNGUARDED]));
        assert_eq!(bench.fly(NavMode::Hold, 3.0), (0, vec![]));
        // A third time is a first time again, and so is a second time much later.
        assert_eq!(bench.fly(NavMode::Orbit, 0.3), (1, vec![&MODE_HELD]));
        assert_eq!(bench.fly(NavMode::Hold, 20.0), (0, vec![]));
        assert_eq!(bench.fly(NavMode::Follow, 0.3), (1, vec![&MODE_HELD]));
    }

    #[test]
    fn a_return_is_reported_and_never_held() {
        let mut bench = Bench::new(true, false);
        assert_eq!(bench.fly(NavMode::Return, 5.0), (0, vec![&MODE_UNGUARDED]));
        assert_eq!(bench.fly(NavMode::Hold, 1.0), (0, vec![]));
        assert_eq!(bench.fly(NavMode::Return, 5.0), (0, vec![&MODE_UNGUARDED]));
    }

    #[test]
    fn what_does_not_answer_is_asked_again_and_not_for_ever() {
        let (asked, reported) = Bench::new(true, false).fly(NavMode::Orbit, 60.0);
        assert_eq!((asked, reported), (10, vec![&MODE_HELD]));
    }

    #[test]
    fn what_is_allowed_or_on_the_ground_is_left_alone() {
        assert_eq!(
            Bench::new(true, true).fly(NavMode::Orbit, 2.0),
            (0, vec![&MODE_UNGUARDED])
        );
        assert_eq!(Bench::new(false, false).fly(NavMode::Orbit, 2.0), (0, vec![]));
    }
}
