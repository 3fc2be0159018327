//! The check of a link before the flight: it reports what keeps jink from flying, with a remedy for each.
//!
//! | in | out |
//! |---|---|
//! | messages ([`LinkCheck::take`]), what each link counts ([`LinkCheck::set_counts`]), time | requests to the autopilot ([`LinkCheck::step`]) |
//! | the plan: profile, system id, links, highest speed | [`Finding`]s, each with its subject, its effect on flights and its remedy |
//!
//! Pure, and harmless: no setpoint, no mode, no arming, no parameter is ever sent. Its heartbeat is that of an on-board
//! computer (component 191), and is sent only until an autopilot is received, because on some links the companion has
//! to send first. No autopilot takes that for an obstacle avoidance.
//!
//! Findings are in the order of causes: the link, the protocol, the autopilot and whether it is the right one, its
//! answers, its parameters, other senders that interfere. What follows from an earlier finding is not reported again,
//! so the first blocker is the one to correct first. Every threshold is in `limits` with its reason.

mod active_probe;
mod finding;
mod judge;
mod limits;
mod observations;
mod passive_probe;
#[cfg(test)]
mod tests;
mod tool;

pub use active_probe::parameters as examined_parameters;
pub use finding::{Finding, Severity};
pub use passive_probe::{Counts, PassiveProbe};
pub use tool::run;

use active_probe::{ActiveProbe, OWN_COMPONENT};
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::fit::{Fit, MatchingProfile};
use jink_mavlink_link::links::{LinkSetup, SetupError};
use jink_mavlink_link::message::{
    Body, COMPONENT_AUTOPILOT, Content, Destination, Outgoing, Receipt, Received,
};
use jink_mavlink_link::profile_name::{ProfileChoice, ProfileName, UnknownName};
use jink_mavlink_link::ticker::Ticker;
use jink_mavlink_link::vehicle_selector::ALIVE_S;
use jink_mavlink_link::vehicle_selector::VehicleSelector;
use jink_mavlink_link::vehicle_selector::{is_autopilot, is_from_autopilot};
use jink_runtime::config::{Config, Purpose};
use jink_shared_types::Timestamp;
use jink_shared_types::link::ProfileFit;
use jink_shared_types::params::{CP_DIST, MPC_ACC_HOR, MPC_JERK_MAX, OA_ASSIST_CH, OA_SPD_MAX};
use limits::LISTEN_S;
use mavlink::dialect::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType};
use observations::Observations;
use std::fmt;

/// What jink is configured for.
#[derive(Clone, Debug)]
pub struct Plan {
    /// How setpoints will be sent.
    pub profile: ProfileChoice,
    /// The vehicle's system id; `None` = that of the only autopilot received.
    pub system_id: Option<u8>,
    /// The highest speed of a planned motion (m/s).
    pub speed_max_mps: f64,
    /// What collision prevention counts on, if a switch of the remote control chooses assisted flight.
    pub assist: Option<Braking>,
    /// The links, the autopilot's first.
    pub links: Vec<LinkSetup>,
}

/// How collision prevention expects the vehicle to brake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Braking {
    /// Deceleration (m/s2): MPC_ACC_HOR.
    pub acceleration_mps2: f64,
    /// How fast that builds up (m/s3): MPC_JERK_MAX.
    pub jerk_mps3: f64,
}

/// Why a configuration is no plan.
#[derive(Debug)]
pub enum PlanError {
    /// A link is described wrongly.
    Link(SetupError),
    /// There is no such profile.
    Profile(UnknownName),
}

impl fmt::Display for PlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Link(source) => write!(f, "{source}"),
            Self::Profile(source) => write!(f, "link.profile: {source}"),
        }
    }
}

impl std::error::Error for PlanError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Link(source) => Some(source),
            Self::Profile(source) => Some(source),
        }
    }
}

impl Plan {
    /// From the configuration.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn of(config: &Config) -> Result<Self, PlanError> {
        let rows = config.link.rows();
        let links: Result<Vec<_>, _> = rows.iter().map(LinkSetup::of).collect();
        Ok(Self {
            profile: config.link.profile.parse().map_err(PlanError::Profile)?,
            system_id: (config.link.system_id != 0).then_some(config.link.system_id),
            speed_max_mps: config.params.get(&OA_SPD_MAX),
            assist: (config.params.get(&OA_ASSIST_CH) > 0.0 && config.params.get(&CP_DIST) > 0.0).then(
                || Braking {
                    acceleration_mps2: config.params.get(&MPC_ACC_HOR),
                    jerk_mps3: config.params.get(&MPC_JERK_MAX),
                },
            ),
            links: links.map_err(PlanError::Link)?,
        })
    }

    /// Whether an autopilot is looked for on link `index`.
    fn expects_autopilot_on(&self, index: u8) -> bool {
        let link = self.links.get(usize::from(index));
        link.is_some_and(|link| link.purpose == Purpose::Autopilot)
    }
}

/// What is known of one link.
#[derive(Clone, Debug, Default)]
struct LinkState {
    counts: Counts,
    /// Why it could not be opened.
    failure: Option<String>,
}

/// The check of all links.
#[derive(Debug)]
pub struct LinkCheck {
    plan: Plan,
    patience_s: f64,
    begin: Timestamp,
    link_states: Vec<LinkState>,
    observations: Observations,
    selector: VehicleSelector,
    probe: Option<ActiveProbe>,
    /// The profile that is checked; where jink chooses it, `None` until that is known.
    profile: Option<ProfileName>,
    fit: Fit,
    heartbeat_timer: Ticker,
}

impl LinkCheck {
    /// A check of `plan`, for `patience_s` at most.
    pub fn new(plan: Plan, patience_s: f64) -> Self {
        Self {
            link_states: vec![LinkState::default(); plan.links.len()],
            selector: VehicleSelector::new(plan.system_id),
            profile: match plan.profile {
                ProfileChoice::Auto => None,
                ProfileChoice::Fixed(profile) => Some(profile),
            },
            fit: Fit::default(),
            plan,
            patience_s,
            begin: Timestamp::NEVER,
            observations: Observations::default(),
            probe: None,
            heartbeat_timer: Ticker::new(1.0),
        }
    }

    /// Link `index` could not be opened.
    pub fn link_failed(&mut self, index: usize, cause: String) {
        if let Some(line) = self.link_states.get_mut(index) {
            line.failure = Some(cause);
        }
    }

    /// What link `index` has counted so far.
    pub fn set_counts(&mut self, index: usize, counts: Counts) {
        if let Some(line) = self.link_states.get_mut(index) {
            line.counts = counts;
        }
    }

    /// Takes one message.
    pub fn take(&mut self, received: &Received) {
        self.observations.take(received);
        let Content::Message(message) = &received.content else {
            return;
        };
        let Ok(system_id) = u8::try_from(received.header.system_id) else {
            return;
        };
        if received.header.component_id != COMPONENT_AUTOPILOT
            || !self.plan.expects_autopilot_on(received.link)
        {
            return;
        }
        let time = received.time;
        if is_from_autopilot(message) {
            self.selector.observe(system_id, time);
        }
        if self.selector.system_id(time) != Some(system_id)
            || !self.selector.is_selected_link(received.link, time)
        {
            return;
        }
        if let MavMessage::HEARTBEAT(heartbeat) = message
            && is_autopilot(heartbeat)
            && self.probe.is_none()
        {
            self.probe = Some(ActiveProbe::new(system_id, heartbeat.clone(), time, self.profile));
        }
        self.choose(time, message);
        if let Some(probe) = &mut self.probe
            && probe.system_id() == system_id
        {
            probe.take(time, message);
        }
    }

    /// Where the choice is left to jink, the autopilot's answers choose the profile; then it is checked for that one.
    fn choose(&mut self, time: Timestamp, message: &MavMessage) {
        self.fit.take(message);
        let Some(probe) = self.probe.as_ref().filter(|_| self.profile.is_none()) else {
            return;
        };
        if let MatchingProfile::Profile(profile) = self.fit.matching_profile() {
            self.profile = Some(profile);
            self.probe = Some(ActiveProbe::new(
                probe.system_id(),
                probe.heartbeat.clone(),
                time,
                Some(profile),
            ));
        }
    }

    /// Appends the messages to send now.
    pub fn step(&mut self, now: Timestamp, out: &mut Vec<Outgoing>) {
        if !self.begin.is_set() {
            self.begin = now;
        }
        let nobody = self.autopilots().is_empty();
        if nobody && self.heartbeat_timer.take(now) {
            for index in (0..self.plan.links.len()).filter_map(|index| u8::try_from(index).ok()) {
                if self.plan.expects_autopilot_on(index) {
                    out.push(outgoing(self.selector.default_id(), index, own_heartbeat()));
                }
            }
        }
        if self.selector.system_id(now).is_none() {
            return;
        }
        let link = self.selector.link();
        if let Some(probe) = &mut self.probe {
            let mut messages = Vec::new();
            let system_id = probe.system_id();
            match self.profile {
                Some(_) => probe.send(now, &mut messages),
                None => messages.extend(self.fit.question(
                    now,
                    ProfileFit::Unknown,
                    (system_id, COMPONENT_AUTOPILOT),
                )),
            }
            out.extend(
                messages
                    .into_iter()
                    .map(|message| outgoing(system_id, link, message)),
            );
        }
    }

    /// Whether nothing more can be found out, or the time is over.
    pub fn is_done(&self, now: Timestamp) -> bool {
        let looked_for = self.plan.links.iter().zip(&self.link_states);
        let all_failed = looked_for
            .filter(|(link, _)| link.purpose == Purpose::Autopilot)
            .all(|(_, line)| line.failure.is_some());
        let settled = self.probe.as_ref().is_some_and(|probe| {
            let alive = now.seconds_since(probe.last) <= ALIVE_S;
            alive && probe.age_s(now) >= LISTEN_S && probe.is_settled()
        });
        let passed_s = if self.begin.is_set() {
            now.seconds_since(self.begin)
        } else {
            0.0
        };
        // Several autopilots and no configured id: more time does not help.
        let undecided =
            !self.autopilots().is_empty() && self.selector.system_id(now).is_none() && passed_s >= LISTEN_S;
        all_failed || settled || undecided || passed_s >= self.patience_s
    }

    /// A line of progress.
    pub fn progress(&self, now: Timestamp) -> String {
        let left_s = (self.patience_s - now.seconds_since(self.begin)).max(0.0);
        let doing = match &self.probe {
            None if self.autopilots().is_empty() => "listening for an autopilot".to_owned(),
            None => "listening".to_owned(),
            Some(probe) => {
                let (done, all) = probe.progress();
                format!(
                    "{}: {done} of {all} questions answered, streams are watched",
                    self.subject()
                )
            }
        };
        format!("{doing} ({left_s:.0} s at most)")
    }

    /// The autopilot in words: `PX4 1.15.2, quadrotor, system 1`.
    pub fn subject(&self) -> String {
        let Some(probe) = &self.probe else {
            return "no autopilot".to_owned();
        };
        let version = probe
            .version
            .map_or(String::new(), |version| format!(" {version}"));
        format!(
            "{}{version}, {}, system {}",
            autopilot_name(probe.autopilot_type()),
            vehicle_type_name(probe.heartbeat.mavtype),
            probe.system_id()
        )
    }

    /// What was found.
    pub fn findings(&self, now: Timestamp) -> Vec<Finding> {
        judge::judge(self, now)
    }

    /// Systems of the autopilots observations where one is looked for.
    fn autopilots(&self) -> Vec<u32> {
        let observations = self
            .observations
            .autopilots(|link| self.plan.expects_autopilot_on(link));
        observations.map(|sender| sender.system_id).collect()
    }
}

/// Sent on links on which the companion has to send first.
fn own_heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_STANDBY,
        mavlink_version: 3,
    })
}

fn outgoing(system_id: u8, link: u8, message: MavMessage) -> Outgoing {
    Outgoing {
        system_id,
        component_id: OWN_COMPONENT,
        body: Body::Message(message),
        to: Destination::Link(link),
        receipt: Receipt::Plain,
    }
}

fn autopilot_name(autopilot_type: Option<AutopilotType>) -> &'static str {
    match autopilot_type {
        Some(AutopilotType::Px4) => "PX4",
        Some(AutopilotType::ArduPilot) => "ArduPilot",
        None => "an unknown autopilot",
    }
}

/// What MAVLink calls the vehicle, in small letters.
fn vehicle_type_name(kind: MavType) -> String {
    let name = format!("{kind:?}");
    let short = name.strip_prefix("MAV_TYPE_").unwrap_or(&name);
    short.to_lowercase().replace('_', " ")
}
