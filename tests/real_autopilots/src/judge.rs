//! What a flight was expected to do, and whether it did.
//!
//! Everything about the vehicle's motion is the simulator's truth. Texts count when they leave jink, whatever a forwarding
//! autopilot makes of them.

use crate::flight::{Trouble, VEHICLE_RADIUS_M};
use crate::mission::Place;
use crate::record::{Record, Shared, Truth};
use crate::scenarios::Scenario;
use crate::setup::Setup;
use jink_shared_types::coded::Wire as _;
use jink_shared_types::vehicle::NavMode;
use mavlink::Message;
use mavlink::dialect::MavMessage;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// A place counts as reached so near, on the level (m): jink's own 1.0 m and the estimate's error.
const REACHED_M: f64 = 1.5;
/// A landing counts as one at a place so near (m): the descent drifts besides.
const LANDED_M: f64 = 2.5;
/// Standing: within this of the last place (m) ...
const REST_M: f64 = 0.5;
/// ... for this long (s).
const REST_S: f64 = 4.0;
/// Slower than this it rests while no setpoint comes (m/s).
const RESTS_MPS: f64 = 0.3;
/// Height below which a vehicle is on the ground or about to be (m).
const GROUND_M: f64 = 0.3;
/// Sinking faster than this onto the ground is a crash (m/s).
const HARD_MPS: f64 = 2.0;
/// A change of mode follows its request within this (s): heartbeats come once a second.
const FOLLOWS_S: f64 = 3.0;

/// What a flight is expected to do; whatever it is, nothing may be hit.
#[derive(Clone, Copy, Debug)]
pub enum Expectation {
    /// Passes all places, comes to the aim and lands there.
    Goal,
    /// Comes to rest at the aim and stays in the air.
    Arrives,
    /// Lands at the aim.
    Lands,
    /// Sends one of the texts within so many seconds of the mark, and rests in the air.
    Holds(&'static [&'static str], f64),
    /// Rests where it is, with or without a word.
    Rests,
    /// Either [`Expectation::Arrives`] or [`Expectation::Holds`].
    ArrivesOrHolds(&'static [&'static str], f64),
    /// Either [`Expectation::Goal`] or [`Expectation::Holds`].
    GoalOrHolds(&'static [&'static str], f64),
    /// Never leaves the ground, and one of the texts is sent.
    StaysDown(&'static [&'static str], f64),
    /// Nothing but what the script itself has asked for: the script's end is the flight's.
    AsTheScriptSays,
}

impl fmt::Display for Expectation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let texts = |texts: &[&str]| texts.join("|");
        match self {
            Self::Goal => write!(f, "goal"),
            Self::Arrives => write!(f, "arrives"),
            Self::Lands => write!(f, "lands there"),
            Self::Holds(words, within_s) => {
                write!(f, "holds, reports \"{}\" in {within_s:.0} s", texts(words))
            }
            Self::Rests => write!(f, "holds"),
            Self::ArrivesOrHolds(words, _) => write!(f, "arrives, or holds and reports \"{}\"", texts(words)),
            Self::GoalOrHolds(words, _) => write!(f, "goal, or holds and reports \"{}\"", texts(words)),
            Self::StaysDown(words, _) => write!(f, "stays down, reports \"{}\"", texts(words)),
            Self::AsTheScriptSays => write!(f, "as the script says"),
        }
    }
}

/// What the script wants looked at.
#[derive(Clone, Debug)]
pub struct Aim {
    /// Where the flight is to end.
    pub end: Place,
    /// Places to be passed before, in this order.
    pub through: Vec<Place>,
    /// Places that must not be come to after the mark.
    pub never: Vec<Place>,
    /// Words that must not be sent.
    pub unsaid: Vec<&'static str>,
    /// When the event came that the expectation is about (s).
    pub marked_s: f64,
}

impl Aim {
    /// At `end`.
    pub fn at(end: Place) -> Self {
        Self {
            end,
            through: Vec::new(),
            never: Vec::new(),
            unsaid: Vec::new(),
            marked_s: 0.0,
        }
    }

    /// The event comes now.
    pub fn mark(&mut self, record: &Shared) {
        self.marked_s = record.lock().now_s();
    }

    /// Whether all places were passed in order.
    fn is_through(&self, truth: &[Truth]) -> bool {
        let mut left = self.through.iter();
        let mut next = left.next();
        for state in truth {
            match next {
                None => return true,
                Some(place) if is_near(place, state) => next = left.next(),
                Some(_) => {}
            }
        }
        next.is_none()
    }
}

fn is_near(place: &Place, state: &Truth) -> bool {
    place.level_distance_m(state.place) < REACHED_M
}

fn since(record: &Record, at_s: f64) -> &[Truth] {
    &record.truth[record.truth.partition_point(|truth| truth.at_s < at_s)..]
}

fn is_up(record: &Record) -> bool {
    record.last().is_some_and(|truth| -truth.place.z_m > GROUND_M)
}

fn has_reported(record: &Record, words: &[&str], aim: &Aim, within_s: f64) -> bool {
    is_said(record, words, aim.marked_s - 0.5, aim.marked_s + within_s)
}

/// Whether a text with one of the words came between these times (s).
fn is_said(record: &Record, words: &[&str], from_s: f64, until_s: f64) -> bool {
    let mut texts = record.texts.iter();
    let has_word = |text: &str| words.iter().any(|word| text.contains(word));
    words.is_empty() || texts.any(|text| (from_s..until_s).contains(&text.at_s) && has_word(&text.text))
}

/// Whether what keeps the vehicle on the ground was reported: as soon as it is known, which may be before the mark.
fn has_explained(record: &Record, words: &[&str], aim: &Aim, within_s: f64) -> bool {
    is_said(record, words, 0.0, aim.marked_s + within_s)
}

impl Expectation {
    /// Longest time from the mark on (s).
    pub fn limit_s(self) -> f64 {
        match self {
            Self::Goal => 100.0,
            Self::Arrives | Self::Lands => 60.0,
            Self::Rests => 20.0,
            Self::Holds(_, within_s) => within_s + 12.0,
            Self::ArrivesOrHolds(_, within_s) => (within_s + 12.0).max(60.0),
            Self::GoalOrHolds(_, within_s) => (within_s + 12.0).max(100.0),
            Self::StaysDown(_, within_s) => within_s + 2.0,
            Self::AsTheScriptSays => 0.0,
        }
    }

    /// Whether nothing that follows could change the verdict. What stays down is watched to the end.
    pub fn is_decided(self, record: &Record, aim: &Aim) -> bool {
        let has_landed = !record.mode().is_armed && !is_up(record);
        match self {
            Self::StaysDown(words, within_s) => {
                is_up(record)
                    || record.now_s() - aim.marked_s > within_s && has_explained(record, words, aim, within_s)
            }
            Self::Holds(words, within_s) => {
                self.is_met(record, aim) || has_landed || {
                    record.now_s() - aim.marked_s > within_s && !has_reported(record, words, aim, within_s)
                }
            }
            _ => self.is_met(record, aim) || has_landed,
        }
    }

    /// Whether it came true.
    pub fn is_met(self, record: &Record, aim: &Aim) -> bool {
        let Some(last) = record.last() else { return false };
        let rests = record.rests(REST_S, REST_M) && record.now_s() - aim.marked_s > REST_S && is_up(record);
        let has_landed = !record.mode().is_armed && !is_up(record);
        match self {
            Self::Goal | Self::Lands => {
                let flown = since(record, aim.marked_s);
                has_landed && aim.is_through(flown) && aim.end.level_distance_m(last.place) < LANDED_M
            }
            Self::Arrives => rests && is_near(&aim.end, last) && aim.is_through(since(record, aim.marked_s)),
            Self::Holds(words, within_s) => rests && has_reported(record, words, aim, within_s),
            Self::Rests => rests,
            Self::ArrivesOrHolds(words, within_s) => {
                Self::Arrives.is_met(record, aim) || Self::Holds(words, within_s).is_met(record, aim)
            }
            Self::GoalOrHolds(words, within_s) => {
                Self::Goal.is_met(record, aim) || Self::Holds(words, within_s).is_met(record, aim)
            }
            Self::StaysDown(words, within_s) => {
                record.truth.iter().all(|truth| -truth.place.z_m < GROUND_M)
                    && has_explained(record, words, aim, within_s)
            }
            Self::AsTheScriptSays => true,
        }
    }
}

/// Whether something was hit: an obstacle, or the ground at speed.
pub fn has_collided(record: &Record) -> bool {
    // Each state is looked at several times; only the last two seconds are new.
    let recent = since(record, record.now_s() - 2.0);
    recent.iter().any(|truth| truth.clearance_m < VEHICLE_RADIUS_M) || hits_ground(recent)
}

fn hits_ground(truth: &[Truth]) -> bool {
    truth
        .iter()
        .any(|state| -state.place.z_m < GROUND_M && state.velocity_mps.z > HARD_MPS)
}

/// A flight as a line of the table and of the JSON.
#[derive(Clone, Debug, Serialize)]
pub struct Verdict {
    /// Autopilot and profile.
    pub setup: &'static str,
    /// Firmware of the autopilot, as it reports it.
    pub version: String,
    /// Flight.
    pub flight: String,
    /// World.
    pub world: &'static str,
    /// Seed.
    pub seed: u64,
    /// What was expected.
    pub expectation: String,
    /// It came true, nothing was hit, nobody changed the mode unasked.
    pub passed: bool,
    /// What happened, in a word.
    pub outcome: String,
    /// Why it failed; empty if it passed.
    pub reason: String,
    /// Something was hit.
    pub collided: bool,
    /// Smallest distance from the vehicle's centre to an obstacle's surface (m); `None` without obstacles.
    pub min_clearance_m: Option<f64>,
    /// Highest true speed (m/s).
    pub top_speed_mps: f64,
    /// Time with running motors (s).
    pub time_s: f64,
    /// Longest time between two setpoints on the wire while the autopilot followed them in the air, cuts left out (ms).
    pub longest_gap_ms: f64,
    /// Changes of mode that nobody asked for.
    pub unwanted_modes: Vec<String>,
    /// All modes in their order.
    pub modes: Vec<String>,
    /// Restarts of services.
    pub restarts: u64,
    /// Texts of jink, with the time (s).
    pub texts: Vec<String>,
    /// Bytes a second at the station's port while the motors ran.
    pub radio_bytes_per_s: f64,
    /// Of these, what jink sends.
    pub jink_bytes_per_s: f64,
    /// Bytes a second of jink's messages there, by name.
    pub radio_shares: BTreeMap<String, f64>,
    /// Time from the start of the first process to the end (s).
    pub wall_s: f64,
}

impl Verdict {
    /// A flight that never began.
    pub fn not_flown(scenario: &Scenario, setup: Setup, reason: &str) -> Self {
        Self {
            setup: setup.name(),
            version: String::new(),
            flight: scenario.name.to_owned(),
            world: scenario.world.0,
            seed: scenario.world.1,
            expectation: scenario.expectation.to_string(),
            passed: false,
            outcome: "not flown".to_owned(),
            reason: reason.to_owned(),
            collided: false,
            min_clearance_m: None,
            top_speed_mps: 0.0,
            time_s: 0.0,
            longest_gap_ms: 0.0,
            unwanted_modes: Vec::new(),
            modes: Vec::new(),
            restarts: 0,
            texts: Vec::new(),
            radio_bytes_per_s: 0.0,
            jink_bytes_per_s: 0.0,
            radio_shares: BTreeMap::new(),
            wall_s: 0.0,
        }
    }
}

/// Judges a flight whose script and waiting ended with `outcome`.
pub fn verdict(
    scenario: &Scenario,
    setup: Setup,
    record: &Record,
    aim: &Aim,
    outcome: &Result<(), Trouble>,
) -> Verdict {
    let mut verdict = Verdict::not_flown(scenario, setup, "");
    verdict.version = record.version.clone().unwrap_or_default();
    let nearest = record
        .truth
        .iter()
        .map(|truth| truth.clearance_m)
        .fold(f64::INFINITY, f64::min);
    verdict.min_clearance_m = nearest.is_finite().then_some(nearest);
    verdict.collided = nearest < VEHICLE_RADIUS_M || hits_ground(&record.truth);
    verdict.top_speed_mps = record.truth.iter().map(Truth::speed_mps).fold(0.0, f64::max);
    verdict.time_s = armed_time_s(record);
    verdict.longest_gap_ms = 1e3 * longest_gap_s(record, setup);
    verdict.unwanted_modes = unwanted_modes(record, aim, setup);
    verdict.modes = record
        .modes
        .iter()
        .map(|(at_s, mode)| {
            format!(
                "{at_s:.1} {}{}",
                mode.mode.name(),
                if mode.is_armed { "" } else { " (disarmed)" }
            )
        })
        .collect();
    verdict.texts = record
        .texts
        .iter()
        .filter(|text| text.is_jinks)
        .map(|text| format!("{:.1} {}", text.at_s, text.text))
        .collect();
    radio(record, &mut verdict);
    let is_met = outcome.is_ok() && scenario.expectation.is_met(record, aim);
    let (word, reason) = match outcome {
        _ if verdict.collided => (
            "COLLISION".to_owned(),
            format!("{nearest:.2} m at {}", where_nearest(record)),
        ),
        Err(trouble @ Trouble::Never { .. }) => (state(record, aim), trouble.to_string()),
        Err(trouble) => ("stopped".to_owned(), trouble.to_string()),
        Ok(()) if is_met => (state(record, aim), String::new()),
        Ok(()) => (state(record, aim), format!("expected: {}", scenario.expectation)),
    };
    verdict.outcome = word;
    verdict.reason = reason;
    if verdict.reason.is_empty() && !verdict.unwanted_modes.is_empty() && !scenario.allows_modes {
        verdict.reason = format!("mode changed unasked: {}", verdict.unwanted_modes.join(", "));
    }
    if verdict.reason.is_empty() {
        verdict.reason = broken_rule(record, aim).unwrap_or_default();
    }
    verdict.passed = verdict.reason.is_empty();
    verdict
}

/// A place that it should not have come to, a text that should not have been sent.
fn broken_rule(record: &Record, aim: &Aim) -> Option<String> {
    let flown = since(record, aim.marked_s);
    let came = aim
        .never
        .iter()
        .find(|place| flown.iter().any(|truth| is_near(place, truth)));
    let said = record
        .texts
        .iter()
        .find(|text| aim.unsaid.iter().any(|word| text.text.contains(word)));
    came.map(|place| {
        format!(
            "came to {:.0}/{:.0}, which nobody asked for any more",
            place.north_m, place.east_m
        )
    })
    .or_else(|| said.map(|text| format!("reported \"{}\"", text.text)))
}

/// What it does at the end.
fn state(record: &Record, aim: &Aim) -> String {
    let Some(last) = record.last() else {
        return "no truth".to_owned();
    };
    let from_m = aim.end.level_distance_m(last.place);
    let at = if from_m < LANDED_M {
        "at the aim".to_owned()
    } else {
        format!("{from_m:.1} m from the aim")
    };
    let doing = match (
        is_up(record),
        record.mode().is_armed,
        record.rests(REST_S, REST_M),
    ) {
        (true, _, true) => "rests",
        (true, _, false) => "flies",
        (false, true, _) => "on the ground, armed,",
        (false, false, _) => "landed",
    };
    format!("{doing} {at}")
}

fn where_nearest(record: &Record) -> String {
    let nearest = record
        .truth
        .iter()
        .min_by(|a, b| a.clearance_m.total_cmp(&b.clearance_m));
    nearest.map_or_else(String::new, |truth| {
        format!(
            "{:.1}/{:.1}, {:.1} m up, {:.1} m/s, mode {}",
            truth.place.x_m,
            truth.place.y_m,
            -truth.place.z_m,
            truth.speed_mps(),
            record
                .mode_at(truth.at_s)
                .map_or("unknown", |mode| mode.mode.name())
        )
    })
}

fn armed_time_s(record: &Record) -> f64 {
    let ends = record
        .modes
        .iter()
        .skip(1)
        .map(|(at_s, _)| *at_s)
        .chain([record.now_s()]);
    let stays = record.modes.iter().zip(ends);
    stays
        .filter(|((_, mode), _)| mode.is_armed)
        .map(|((from_s, _), to_s)| to_s - from_s)
        .sum()
}

/// Longest time between two setpoints in one stay in the mode that follows them. An ArduCopter that rests where jink has
/// brought it is sent none, so that a station's go-to shows.
fn longest_gap_s(record: &Record, setup: Setup) -> f64 {
    let followed = if setup.has_setpoint_mode() {
        NavMode::Offboard
    } else {
        NavMode::Mission
    };
    let mut longest_s: f64 = 0.0;
    for pair in record.setpoints_s.windows(2) {
        let [from_s, to_s] = [pair[0], pair[1]];
        if to_s - from_s <= longest_s {
            continue;
        }
        let is_silence = record
            .silences_s
            .iter()
            .any(|(begin_s, end_s)| *begin_s < to_s && from_s < end_s + 1.0);
        let is_followed = |at_s: f64| {
            record
                .mode_at(at_s)
                .is_some_and(|mode| mode.mode == followed && mode.is_armed)
        };
        let stays = !record.modes.iter().any(|(at_s, _)| (from_s..to_s).contains(at_s));
        let rests = |truth: &Truth| setup == Setup::Guided && truth.speed_mps() < RESTS_MPS;
        let is_up = since(record, from_s)
            .first()
            .is_some_and(|truth| -truth.place.z_m > 1.0 && !rests(truth));
        if !is_silence && stays && is_followed(from_s) && is_followed(to_s) && is_up {
            longest_s = to_s - from_s;
        }
    }
    longest_s
}

/// Changes of mode in the air that neither the station nor jink asked for, and that are no part of a take-off, a landing or the
/// end of a mission.
fn unwanted_modes(record: &Record, aim: &Aim, setup: Setup) -> Vec<String> {
    let mut unwanted = Vec::new();
    for pair in record.modes.windows(2) {
        let [(_, from), (at_s, to)] = [pair[0], pair[1]];
        if from.custom == to.custom || !from.is_armed || !to.is_armed {
            continue;
        }
        let was_asked = |wanted: NavMode| {
            record.requests.iter().any(|request| {
                (-0.3..FOLLOWS_S).contains(&(at_s - request.at_s))
                    && request.mode.is_none_or(|mode| mode == wanted)
            })
        };
        let is_asked = was_asked(to.mode);
        let truth = since(record, at_s).first().or(record.last());
        let is_at_end = truth.is_some_and(|truth| aim.end.level_distance_m(truth.place) < 3.0);
        let is_natural = match (from.mode, to.mode) {
            (NavMode::Takeoff, NavMode::Hold) => true,
            // Given back at its last item, it is over before a heartbeat has reported it.
            (NavMode::Offboard, NavMode::Hold) => is_at_end && was_asked(NavMode::Mission),
            // PX4 ends a mission in Hold.
            (NavMode::Mission, NavMode::Hold) => {
                is_at_end && setup.autopilot().make() == jink_emulated_ground_station::Make::Px4
            }
            // A landing item or the end of a return; on the ground everything may change.
            (_, NavMode::Land) => is_at_end,
            _ => truth.is_some_and(|truth| -truth.place.z_m < GROUND_M),
        };
        if !is_asked && !is_natural {
            unwanted.push(format!(
                "{} to {} at {at_s:.1} s",
                from.mode.name(),
                to.mode.name()
            ));
        }
    }
    unwanted
}

fn radio(record: &Record, verdict: &mut Verdict) {
    let time_s = record.radio_time_s.max(1.0);
    for ((is_autopilots, id), share) in &record.radio {
        let bytes_per_s = share.bytes as f64 / time_s;
        verdict.radio_bytes_per_s += bytes_per_s;
        if !is_autopilots {
            verdict.jink_bytes_per_s += bytes_per_s;
            let name = MavMessage::default_message_from_id(*id)
                .map_or_else(|| id.to_string(), |message| message.message_name().to_owned());
            *verdict.radio_shares.entry(name).or_default() += (bytes_per_s * 10.0).round() / 10.0;
        }
    }
}
