//! The flight is taken out of jink's hands and given back by the mode: both are answered, so that nobody wonders who flies.
//!
//! | in the air | the pilot reads |
//! |---|---|
//! | from a mode that jink flies to Hold, Position or a manual mode, and jink did not ask for it | that jink waits |
//! | back to a mode in which jink shows the autopilot its way | that jink flies on |
//!
//! Other modes have texts of their own: [`super::unguarded_mode`]. What jink flies itself, and when it goes on, the executive says.

use super::Gateway;
use crate::io::Outputs;
use jink_shared_types::Timestamp;
use jink_shared_types::coded::Wire;
use jink_shared_types::events::{EventSample, HELD, RESUMED};
use jink_shared_types::vehicle::NavMode;

/// A mode that jink has asked for comes within this time (s): an older PX4 reports its mode once a second.
const ASKED_S: f64 = 3.0;

/// Watches for it.
#[derive(Clone, Copy, Debug)]
pub(super) struct ModeChoice {
    was_flown: bool,
    waits: bool,
    /// When jink asked for a mode last.
    asked: Timestamp,
}

impl Default for ModeChoice {
    fn default() -> Self {
        Self {
            was_flown: false,
            waits: false,
            asked: Timestamp::NEVER,
        }
    }
}

impl ModeChoice {
    /// Jink asks for a mode.
    pub(super) fn ask(&mut self, now: Timestamp) {
        self.asked = now;
    }

    /// One step in `mode`, in which jink flies if `is_flown`; `flies`: in the air with running motors.
    fn step(&mut self, now: Timestamp, mode: NavMode, flies: bool, is_flown: bool) -> Option<EventSample> {
        if !flies {
            *self = Self::default();
            return None;
        }
        if mode == NavMode::Unknown {
            return None;
        }
        let was_flown = std::mem::replace(&mut self.was_flown, is_flown);
        if is_flown {
            let resumed = std::mem::take(&mut self.waits);
            return resumed.then(|| EventSample::new(&RESUMED, "", [0.0; 2]));
        }
        if !was_flown || !matches!(mode, NavMode::Hold | NavMode::Position | NavMode::Manual) {
            return None;
        }
        self.waits = true;
        let is_ours = self.asked.is_set() && now.seconds_since(self.asked) <= ASKED_S;
        (!is_ours).then(|| EventSample::new(&HELD, mode.name(), [0.0; 2]))
    }
}

impl Gateway {
    /// Answers whoever has chosen a mode in which jink waits, or one in which it flies on.
    pub(super) fn watch_mode_choice(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let mode = self.vehicle.mode();
        let flies = self.was_alive && self.vehicle.is_armed() && self.vehicle.has_taken_off();
        let goes_somewhere = matches!(mode, NavMode::Mission | NavMode::Offboard | NavMode::Return);
        let is_flown = goes_somewhere && self.profile.listens(mode) && !self.assist.streams();
        let event = self.mode_choice.step(now, mode, flies, is_flown);
        let is_said_otherwise =
            |event: &EventSample| event.id == RESUMED.id && self.config.profile.flies_the_mission();
        if let Some(event) = event.filter(|event| !is_said_otherwise(event)) {
            outputs.report(event);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::ModeChoice;
    use jink_shared_types::Timestamp;
    use jink_shared_types::vehicle::NavMode;

    /// What the pilot reads of a flight through `modes`, a second each, in which jink flies OFFBOARD; before those in `asked` it
    /// asks for the mode.
    fn texts(modes: &[NavMode], asked: &[usize]) -> Vec<String> {
        let mut choice = ModeChoice::default();
        let mut texts = Vec::new();
        for (second, mode) in modes.iter().enumerate() {
            let now = Timestamp::from_seconds(100.0 + second as f64);
            if asked.contains(&second) {
                choice.ask(now);
            }
            let is_flown = *mode == NavMode::Offboard;
            for _ in 0..3 {
                texts.extend(choice.step(now, *mode, true, is_flown).map(|event| event.text()));
            }
        }
        texts
    }

    #[test]
    fn a_pilot_who_holds_and_goes_on_is_answered_both_times_once() {
        use NavMode::{Hold, Manual, Offboard, Unknown};
        assert_eq!(
            texts(
                &[Hold, Offboard, Unknown, Offboard, Hold, Hold, Offboard, Manual],
                &[]
            ),
            [
                "jink: mode hold, jink waits",
                "jink: flying on",
                "jink: mode manual, jink waits"
            ]
        );
    }

    #[test]
    fn what_jink_asks_for_itself_is_no_answer_to_anybody() {
        use NavMode::{Hold, Land, Mission, Offboard};
        assert_eq!(texts(&[Offboard, Hold, Hold], &[1]), [""; 0]);
        assert_eq!(texts(&[Offboard, Mission, Land], &[1]), [""; 0]);
        assert_eq!(texts(&[Offboard, Hold, Offboard], &[1]), ["jink: flying on"]);
    }
}
