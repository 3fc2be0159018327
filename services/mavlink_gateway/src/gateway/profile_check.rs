//! Whether the profile is for the autopilot on the link, and which one is chosen where jink chooses it.
//!
//! | known | setpoints and changes of mode | component 196 | said, once |
//! |---|---|---|---|
//! | nothing yet | none | STANDBY | after [`PATIENCE_S`] that the autopilot does not answer |
//! | the profile fits | yes | as the chain is | which one was chosen, if jink chose it |
//! | it does not | none | STANDBY | the right profile, or what to set |
//! | it fitted in this run, and does not any more | yes: what is committed is flown to its end | CRITICAL | the same |

use super::Gateway;
use super::mission::MissionFlight;
use crate::avoidance::Input;
use crate::executive::Part;
use crate::io::Outputs;
use jink_mavlink_link::fit::{DEVIATION_SWITCH, Fit, MatchingProfile, TRAJECTORY_SWITCH};
use jink_mavlink_link::message::{Body, COMPONENT_AUTOPILOT};
use jink_mavlink_link::profile_name::ProfileName;
use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{
    AUTOPILOT_UNFIT, Event, EventSample, INTERFACE_OFF, PROFILE_CHOSEN, PROFILE_UNFIT, PROFILE_UNPROVEN,
};
use jink_shared_types::link::ProfileFit;
use jink_shared_types::params::GW_RATE;

/// How long the right profile may be unknown before that is reported (s): every question has been asked ten times.
const PATIENCE_S: f64 = 5.0;

/// What is known of the profile and the autopilot.
#[derive(Clone, Debug)]
pub(super) struct ProfileCheck {
    pub(super) fit: Fit,
    /// A profile is in force: it was configured, or has been chosen.
    is_chosen: bool,
    /// Proven in this run, by this gateway or one before it, and not denied since.
    is_proven: bool,
    /// Setpoints may leave: it was proven once in this run.
    speaks: bool,
    found: ProfileFit,
    /// For the heartbeat.
    pub(super) input: Input,
    /// Since when the autopilot is seen and nothing is known.
    open_since: Option<Timestamp>,
    reported: Option<(u16, &'static str)>,
}

impl ProfileCheck {
    /// A profile is in force already unless `chooses`; one that `is_proven` was so by an earlier gateway of this run.
    pub(super) fn new(chooses: bool, is_proven: bool) -> Self {
        Self {
            fit: Fit::default(),
            is_chosen: !chooses || is_proven,
            is_proven,
            speaks: is_proven,
            found: if is_proven {
                ProfileFit::Fits
            } else {
                ProfileFit::Unknown
            },
            input: Input::Missing,
            open_since: None,
            reported: None,
        }
    }

    /// The autopilot has started anew: what was found out about it has to be found out again.
    pub(super) fn restart(&mut self) {
        self.fit.restart();
        self.is_proven = false;
    }

    /// Whether the profile fits.
    pub(super) fn found(&self) -> ProfileFit {
        self.found
    }

    /// Whether setpoints and changes of mode may leave.
    pub(super) fn speaks(&self) -> bool {
        self.speaks
    }

    fn judge(&mut self, profile: ProfileName) {
        let found = match (self.is_chosen, self.fit.matching_profile()) {
            (true, _) => self.fit.of(profile),
            (false, MatchingProfile::None) => ProfileFit::TooOld,
            (false, _) => ProfileFit::Unknown,
        };
        self.is_proven = match found {
            ProfileFit::Fits => true,
            ProfileFit::Unknown => self.is_proven,
            _ => false,
        };
        self.found = if self.is_proven { ProfileFit::Fits } else { found };
        self.speaks |= self.is_proven;
        self.input.notice(self.is_proven);
    }

    /// What there is to report at `now`, if anything.
    fn update(&mut self, now: Timestamp, profile: ProfileName) -> Option<(&'static Event, &'static str)> {
        let matching_profile = self.fit.matching_profile();
        let is_open = self.found == ProfileFit::Unknown
            || matches!(self.found, ProfileFit::OtherAutopilot | ProfileFit::NoInterface)
                && matching_profile == MatchingProfile::Open;
        if !is_open {
            self.open_since = None;
        }
        let since = *self.open_since.get_or_insert(now);
        let switch = match profile {
            ProfileName::Px4Deviation => DEVIATION_SWITCH,
            _ => TRAJECTORY_SWITCH,
        };
        let update = match (self.found, matching_profile) {
            (ProfileFit::Fits, _) => None,
            (ProfileFit::SwitchedOff, _) => Some((&INTERFACE_OFF, switch)),
            (ProfileFit::Unknown, MatchingProfile::Open | MatchingProfile::Profile(_)) => {
                (now.seconds_since(since) >= PATIENCE_S).then_some((&PROFILE_UNPROVEN, self.fit.unanswered()))
            }
            (_, MatchingProfile::Profile(right)) => Some((&PROFILE_UNFIT, right.name())),
            (_, MatchingProfile::None) => Some((&AUTOPILOT_UNFIT, "")),
            // A PX4 under another profile, which has not said yet how it is set up: this one always flies it.
            (_, MatchingProfile::Open) => (now.seconds_since(since) >= PATIENCE_S)
                .then_some((&PROFILE_UNFIT, ProfileName::Px4Offboard.name())),
        };
        let reported = update.map(|(event, name)| (event.id, name));
        if self.found == ProfileFit::Unknown && update.is_none() || reported == self.reported {
            return None;
        }
        self.reported = reported;
        // Who was told that it does not fit is told that it does.
        let fits = self.found == ProfileFit::Fits;
        update.or(fits.then_some((&PROFILE_CHOSEN, profile.name())))
    }
}

impl Gateway {
    /// Asks and finds out whether the profile fits, and chooses it where that is left to jink.
    pub(super) fn watch_profile(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let Some(system_id) = self.selector.system_id(now).filter(|_| self.was_alive) else {
            self.profile_check.open_since = None;
            return;
        };
        if !self.profile_check.is_chosen
            && let MatchingProfile::Profile(profile) = self.profile_check.fit.matching_profile()
        {
            self.choose(now, profile);
            outputs.report(EventSample::new(&PROFILE_CHOSEN, profile.name(), [0.0; 2]));
        }
        self.profile_check.judge(self.config.profile);
        if let Some((event, name)) = self.profile_check.update(now, self.config.profile) {
            outputs.report(EventSample::new(event, name, [0.0; 2]));
        }
        let target = (system_id, COMPONENT_AUTOPILOT);
        if let Some(question) = self
            .profile_check
            .fit
            .question(now, self.profile_check.found, target)
        {
            outputs.send(self.outgoing(now, Body::Message(question)));
        }
    }

    /// From now on, and for the whole run.
    fn choose(&mut self, now: Timestamp, profile: ProfileName) {
        self.profile_check.is_chosen = true;
        self.config.profile = profile;
        self.config.setpoint_rate_hz = profile.rate_hz(self.params().get(&GW_RATE));
        self.profile = self.config.build_profile();
        self.mission = profile
            .reads_the_mission()
            .then(|| MissionFlight::new(Part::of(&self.config)));
        // The autopilot is already there: what will not be flown is told before the flight.
        if let Some(flight) = &mut self.mission {
            flight.read_anew(now);
        }
        self.streams = self.needed_streams();
        self.setpoints = Ticker::new(self.config.setpoint_rate_hz);
    }

    /// The profile in force if it was proven in this run: what the next gateway of this run goes on with.
    pub fn proven_profile(&self) -> Option<ProfileName> {
        (self.profile_check.is_chosen && self.profile_check.is_proven).then_some(self.config.profile)
    }

    /// Whether the profile fits the autopilot, as far as is known.
    pub fn profile_fits(&self) -> bool {
        self.profile_check.found == ProfileFit::Fits
    }

    /// For the figures: profile in force, profile for this autopilot.
    pub(super) fn profile_names(&self) -> [&'static str; 2] {
        let matching_profile = match self.profile_check.fit.matching_profile() {
            MatchingProfile::Profile(profile) => profile.name(),
            MatchingProfile::Open | MatchingProfile::None => "",
        };
        let chosen = if self.profile_check.is_chosen {
            self.config.profile.name()
        } else {
            ""
        };
        [chosen, matching_profile]
    }
}
