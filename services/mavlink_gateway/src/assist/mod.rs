//! Assisted flight: a pilot flies through jink in OFFBOARD or GUIDED, and what his sticks ask for passes through the collision guard.
//!
//! It is off until he chooses it, by a switch (OA_ASSIST_CH) or a command (MAV_CMD_USER_1), and every way out leads back to a mode of
//! the autopilot's own. What is sent is made by `motion`; which mode is asked for when, here:
//!
//! | seen | asked of the autopilot | sent meanwhile |
//! |---|---|---|
//! | chosen, and nothing prevents it | the mode that follows setpoints, `STREAM_S` after the stream has begun | what the guard allows of the sticks, as later on |
//! | chosen, and something does | nothing; the reason is sent to the pilot | nothing |
//! | the autopilot does not change for `ENGAGE_S`, or refuses | nothing more; the pilot is notified | nothing |
//! | switched off | the pilot's mode: the one in which he chose it | what the guard allows of the sticks |
//! | the mode changes, by whomever | nothing: he has it | nothing |
//! | it comes back by itself within `RETURN_S`, as PX4 does after a lost stream | the pilot's mode | a stop, then the place |
//! | no sticks for `STICKS_KEPT_S` | nothing | a stop, then the place |
//! | no sticks for `STICKS_LOST_S` | Hold: the pilot's mode would have nobody | the same |
//! | no ranges, or the guard is silent | nothing | a stop, then the place |
//! | the same for `BLIND_S` | Hold | the same |
//! | CP_DIST is switched off, the vehicle has landed | the pilot's mode | what is left of the sticks |
//! | the pilot's mode is refused, or does not come | Hold | a stop, then the place |
//! | disarmed; the autopilot has started anew | nothing | nothing |
//!
//! The stream never ends before the autopilot has left the mode that follows it. Centred sticks are no way out: the vehicle holds its
//! place for as long as they are. A gateway that is started again in flight goes on from its predecessor's record
//! ([`Assist::resume`]), and without one leaves the vehicle where it is.

pub(crate) mod facts;
pub(crate) mod motion;
pub mod record;
pub(crate) mod sticks;
pub(crate) mod switch;

use crate::executive::{PilotText, REPEAT_S};
use jink_shared_types::Timestamp;
use jink_shared_types::events::{ASSIST_HOLDS, ASSIST_OFF, ASSIST_ON, ASSIST_REFUSED, Event};
use jink_shared_types::link::AssistState;
use jink_shared_types::prevention::PreventionState;
use jink_shared_types::vehicle::NavMode;

/// For so long (s) the stream goes out before its mode is asked for: PX4 wants a setpoint in the last COM_OF_LOSS_T, and the guard
/// answers within 0.1 s.
const STREAM_S: f64 = 0.3;
/// An autopilot that has not changed its mode after this long (s) does not.
const ENGAGE_S: f64 = 3.0;
/// Without sticks for so long (s) nobody is there to fly: four times what a lost message costs, and before PX4's return begins.
const STICKS_LOST_S: f64 = 2.0;
/// Without ranges for so long (s) the autopilot holds by itself, as collision prevention does in PX4.
const BLIND_S: f64 = 5.0;
/// The pilot's mode that does not come after this long (s) is not waited for.
const GIVE_BACK_S: f64 = 2.0;
/// A mode that follows setpoints and is back this soon (s) was not chosen by anybody: a pilot takes longer for two changes.
const RETURN_S: f64 = 3.0;

/// Where it stands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Off,
    /// Streams since then, and waits for the mode.
    Engaging {
        since: Timestamp,
    },
    Assisting,
    /// Has the autopilot asked for another mode since then.
    Leaving {
        to: ModeRequest,
        since: Timestamp,
    },
}

/// A mode that is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeRequest {
    /// The one that follows setpoints.
    Follow,
    /// The pilot's, by the autopilot's own number.
    Pilots(u32),
    /// The one that holds.
    Hold,
}

/// What is known at one moment.
#[derive(Clone, Copy, Debug)]
pub struct AssistScene {
    /// Now.
    pub now: Timestamp,
    /// Mode in force.
    pub mode: NavMode,
    /// Its number.
    pub custom_mode: u32,
    /// It is one in which a pilot flies with the place or the height held, and may choose this.
    pub is_pilots_mode: bool,
    /// Motors armed.
    pub is_armed: bool,
    /// Neither on the ground nor taking off.
    pub in_air: bool,
    /// It stands on the ground.
    pub has_landed: bool,
    /// The profile is one that follows setpoints, and fits.
    pub fits: bool,
    /// CP_DIST is above zero.
    pub keeps_distance: bool,
    /// Which of the autopilot's parameters prevents it.
    pub hindrance: Option<&'static str>,
    /// Time since the sticks were received (s); `None`: never.
    pub sticks_age_s: Option<f64>,
    /// The throttle stick is at its centre, so that choosing this neither climbs nor descends.
    pub is_level: bool,
    /// Ranges flow.
    pub sees: bool,
    /// What the guard does about the sticks; `None`: it is silent.
    pub guard: Option<PreventionState>,
    /// Somebody is about to end jink.
    pub is_ending: bool,
    /// A mission or a go-to is flown, or about to be: the mode that follows setpoints is for that.
    pub is_on_mission: bool,
}

impl AssistScene {
    /// What prevents it, in words for the text that says so.
    fn refusal(&self) -> Option<&'static str> {
        let has_sticks = self
            .sticks_age_s
            .is_some_and(|age_s| age_s <= sticks::STICKS_KEPT_S);
        [
            (!self.fits, "profile"),
            (!self.keeps_distance, "set CP_DIST"),
            (self.is_ending, "jink is ending"),
            (!self.is_armed || !self.in_air, "not in the air"),
            (!self.is_pilots_mode, "choose Position first"),
            (!has_sticks, "no sticks"),
            (!self.is_level, "centre the throttle"),
            (!self.sees, "no range data"),
        ]
        .into_iter()
        .find_map(|(speaks_against, word)| speaks_against.then_some(word))
        .or(self.hindrance)
    }
}

/// What follows from it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AssistIntent {
    /// The mode to be asked for now.
    pub request: Option<ModeRequest>,
    /// What is to be sent to the pilot now.
    pub text: Option<PilotText>,
}

/// Assisted flight.
#[derive(Clone, Copy, Debug)]
pub struct Assist {
    phase: Phase,
    /// Chosen (`true`) or switched off since the last step.
    choice: Option<bool>,
    /// The mode to go back to, by the autopilot's number.
    pilots_mode: u32,
    asked: Timestamp,
    /// The autopilot has refused what was asked for.
    was_refused: bool,
    /// It ended by a change of mode then.
    ended: Timestamp,
    /// Without ranges since then.
    blind_since: Option<Timestamp>,
    /// Resumed then: neither sticks nor samples of the guard have been received since.
    resumed: Timestamp,
    holds: Option<&'static str>,
    /// What spoke against it at the last step.
    refusal: Option<&'static str>,
}

impl Default for Assist {
    fn default() -> Self {
        Self {
            phase: Phase::Off,
            choice: None,
            pilots_mode: 0,
            asked: Timestamp::NEVER,
            was_refused: false,
            ended: Timestamp::NEVER,
            blind_since: None,
            resumed: Timestamp::NEVER,
            holds: None,
            refusal: Some("jink not ready"),
        }
    }
}

impl Assist {
    /// Goes on where the gateway before has stopped; `pilots_mode`: the mode to go back to.
    pub fn resume(&mut self, now: Timestamp, pilots_mode: u32) {
        *self = Self {
            phase: Phase::Assisting,
            pilots_mode,
            resumed: now,
            ..Self::default()
        };
    }

    /// The mode to go back to, while the autopilot follows this: what the next gateway has to know.
    pub fn pilots_mode(&self) -> Option<u32> {
        matches!(self.phase, Phase::Assisting | Phase::Leaving { .. }).then_some(self.pilots_mode)
    }

    /// Somebody chooses it, or switches it off. What prevents it, as far as is known now.
    ///
    /// # Errors
    /// A word for what prevents it.
    pub fn choose(&mut self, on: bool) -> Result<(), &'static str> {
        self.choice = Some(on);
        match self.refusal.filter(|_| on && self.phase == Phase::Off) {
            Some(word) => Err(word),
            None => Ok(()),
        }
    }

    /// The autopilot has refused a mode.
    pub fn note_refusal(&mut self) {
        self.was_refused = true;
    }

    /// Setpoints are its own.
    pub fn streams(&self) -> bool {
        self.phase != Phase::Off
    }

    /// The sticks are flown: in every phase but that of a stop.
    pub fn follows_sticks(&self) -> bool {
        match self.phase {
            Phase::Off => false,
            Phase::Engaging { .. } | Phase::Assisting => true,
            Phase::Leaving { to, .. } => to != ModeRequest::Hold,
        }
    }

    /// For the figures.
    pub fn state(&self) -> AssistState {
        match self.phase {
            Phase::Off => AssistState::Off,
            Phase::Engaging { .. } => AssistState::Engaging,
            Phase::Assisting if self.holds.is_some() => AssistState::Holds,
            Phase::Assisting => AssistState::On,
            Phase::Leaving { .. } => AssistState::Leaving,
        }
    }

    /// One step.
    pub fn step(&mut self, scene: &AssistScene) -> AssistIntent {
        let refused = std::mem::take(&mut self.was_refused);
        let choice = self.choice.take();
        self.refusal = scene.refusal();
        match self.phase {
            Phase::Off => self.wait(scene, choice),
            Phase::Engaging { since } => self.engage(scene, choice, refused, since),
            Phase::Assisting => self.assist(scene, choice),
            Phase::Leaving { to, since } => self.leave(scene, refused, to, since),
        }
    }

    fn wait(&mut self, scene: &AssistScene, choice: Option<bool>) -> AssistIntent {
        let is_back = scene.mode == NavMode::Offboard
            && !scene.is_on_mission
            && self.ended.is_set()
            && scene.now.seconds_since(self.ended) <= RETURN_S;
        if is_back {
            self.ended = Timestamp::NEVER;
            return self.begin_leaving(scene.now, ModeRequest::Pilots(self.pilots_mode), None);
        }
        match (choice, self.refusal) {
            (Some(true), Some(word)) => reported(&ASSIST_REFUSED, word),
            (Some(true), None) => {
                *self = Self {
                    phase: Phase::Engaging { since: scene.now },
                    pilots_mode: scene.custom_mode,
                    refusal: None,
                    ..Self::default()
                };
                AssistIntent::default()
            }
            _ => AssistIntent::default(),
        }
    }

    fn engage(
        &mut self,
        scene: &AssistScene,
        choice: Option<bool>,
        refused: bool,
        since: Timestamp,
    ) -> AssistIntent {
        if scene.mode == NavMode::Offboard {
            self.phase = Phase::Assisting;
            if choice == Some(false) {
                return self.begin_leaving(
                    scene.now,
                    ModeRequest::Pilots(self.pilots_mode),
                    Some("switched off"),
                );
            }
            return reported(&ASSIST_ON, "");
        }
        let passed_s = scene.now.seconds_since(since);
        let word = if choice == Some(false) {
            Some("switched off")
        } else if scene.custom_mode != self.pilots_mode {
            Some("mode changed")
        } else if refused {
            Some("autopilot refuses")
        } else if passed_s > ENGAGE_S {
            Some("no answer")
        } else {
            self.refusal.filter(|_| !self.asked.is_set())
        };
        if let Some(word) = word {
            self.end(scene.now);
            return reported(&ASSIST_REFUSED, word);
        }
        let is_watched = matches!(scene.guard, Some(PreventionState::Free | PreventionState::Acting));
        match is_watched && passed_s >= STREAM_S {
            true => self.ask(scene.now, ModeRequest::Follow),
            false => AssistIntent::default(),
        }
    }

    fn assist(&mut self, scene: &AssistScene, choice: Option<bool>) -> AssistIntent {
        let now = scene.now;
        if scene.mode != NavMode::Offboard || !scene.is_armed {
            self.end(now);
            let word = if scene.is_armed {
                "mode changed"
            } else {
                "disarmed"
            };
            return reported(&ASSIST_OFF, word);
        }
        let is_blind = !matches!(
            scene.guard,
            Some(PreventionState::Free | PreventionState::Acting | PreventionState::Off)
        );
        let blind_s = match is_blind {
            true => now.seconds_since(*self.blind_since.get_or_insert(now)),
            false => {
                self.blind_since = None;
                0.0
            }
        };
        let since_resumed_s = if self.resumed.is_set() {
            now.seconds_since(self.resumed)
        } else {
            f64::INFINITY
        };
        let silent_s = scene.sticks_age_s.unwrap_or(f64::INFINITY).min(since_resumed_s);
        let pilots = ModeRequest::Pilots(self.pilots_mode);
        if choice == Some(false) {
            return self.begin_leaving(now, pilots, Some("switched off"));
        } else if !scene.keeps_distance {
            return self.begin_leaving(now, pilots, Some("CP_DIST is off"));
        } else if scene.has_landed {
            return self.begin_leaving(now, pilots, Some("landed"));
        } else if silent_s > STICKS_LOST_S {
            return self.begin_leaving(now, ModeRequest::Hold, Some("no sticks"));
        } else if blind_s > BLIND_S {
            return self.begin_leaving(now, ModeRequest::Hold, Some("no range data"));
        }
        let holds = if silent_s > sticks::STICKS_KEPT_S {
            Some("no sticks")
        } else if is_blind && blind_s > sticks::STICKS_KEPT_S {
            Some("no range data")
        } else {
            None
        };
        if holds == self.holds {
            return AssistIntent::default();
        }
        self.holds = holds;
        match holds {
            Some(word) => reported(&ASSIST_HOLDS, word),
            None => reported(&ASSIST_ON, ""),
        }
    }

    fn leave(
        &mut self,
        scene: &AssistScene,
        refused: bool,
        to: ModeRequest,
        since: Timestamp,
    ) -> AssistIntent {
        let now = scene.now;
        if scene.mode != NavMode::Offboard || !scene.is_armed {
            self.end(now);
            return AssistIntent::default();
        }
        let is_late = now.seconds_since(since) > GIVE_BACK_S;
        let has_no_pilot = scene
            .sticks_age_s
            .is_none_or(|age_s| age_s > sticks::STICKS_KEPT_S);
        if to != ModeRequest::Hold && (refused || is_late || has_no_pilot) {
            return self.begin_leaving(now, ModeRequest::Hold, None);
        }
        self.ask(now, to)
    }

    fn begin_leaving(&mut self, now: Timestamp, to: ModeRequest, word: Option<&'static str>) -> AssistIntent {
        self.phase = Phase::Leaving { to, since: now };
        self.asked = Timestamp::NEVER;
        AssistIntent {
            text: word.map(|name| PilotText {
                number: 0.0,
                event: &ASSIST_OFF,
                name,
            }),
            ..self.ask(now, to)
        }
    }

    fn end(&mut self, now: Timestamp) {
        *self = Self {
            pilots_mode: self.pilots_mode,
            ended: now,
            refusal: self.refusal,
            ..Self::default()
        };
    }

    fn ask(&mut self, now: Timestamp, request: ModeRequest) -> AssistIntent {
        if self.asked.is_set() && now.seconds_since(self.asked) < REPEAT_S {
            return AssistIntent::default();
        }
        self.asked = now;
        AssistIntent {
            request: Some(request),
            text: None,
        }
    }
}

fn reported(event: &'static Event, name: &'static str) -> AssistIntent {
    AssistIntent {
        request: None,
        text: Some(PilotText {
            event,
            name,
            number: 0.0,
        }),
    }
}

#[cfg(test)]
mod tests;
