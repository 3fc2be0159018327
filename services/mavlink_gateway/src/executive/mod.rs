//! Decides what is flown where the autopilot only follows setpoints (OFFBOARD, GUIDED): its mission in its stead, the place that a
//! ground station asks for, or nothing.
//!
//! | the autopilot | jink |
//! |---|---|
//! | flies its mission in the air, at an item that jink can fly; the mission is read; jink is ready | has the way planned from the vehicle's own motion; asks for the mode in which setpoints are followed as soon as they lie where the vehicle is, at once if it hardly moves |
//! | flies on while that does not succeed: a slow link, a vehicle that gathers speed; or at once if jink is not ready | asks it to hold, since nobody looks for obstacles, and takes over from rest once it can |
//! | begins an item that nobody could guard ([`items`]) | asks it to hold and notifies the pilot, unless OA_UNGUARDED lets it fly |
//! | still flies its mission after a while | notifies the pilot |
//! | follows setpoints, and its mission was taken over | wants the current item and the next one, counts them as reached, sends the autopilot which one is current |
//! | the next item ends on the ground | comes to rest above its place, asks for the landing mode, or gives the mission back where it goes on behind it; watches the descent (`give_back`) |
//! | the last item is reached | comes to rest, gives the mission back: the autopilot finishes it |
//! | is commanded to go to a place (`go_to`) | has the way there planned instead of the mission |
//! | follows setpoints, and nobody asked for a flight | holds, and says what it waits for |
//! | leaves that mode otherwise: the pilot, a failsafe | nothing, until somebody lets it fly the mission again |
//! | is let fly its mission again out of that mode | takes it over again; if that is repeated within seconds, leaves it alone, and reports that |
//!
//! The stream is there before the mode is asked for, so entering is never refused and begins without a jump. A mission that was
//! taken over goes on when the mode is entered again, as PX4 does by itself after a lost stream. A gateway that was started again
//! in flight knows from its predecessor's [`record`] what was flown.
//!
//! Other stations may choose another item or upload another mission at any time. What jink has asked for itself is remembered until
//! it shows; every other change is somebody's wish, and is followed.

pub(crate) mod client;
pub(crate) mod georeference;
mod give_back;
pub(crate) mod go_to;
pub mod items;
mod mission;
pub(crate) mod notice;
pub mod record;

use crate::config::GatewayConfig;
use crate::demand::Demand;
use crate::note::Note;
use client::Item;
use give_back::{FlownAlone, GivenBack};
use go_to::GoTo;
use items::Course;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_shared_types::Timestamp;
use jink_shared_types::events::Event;
use jink_shared_types::vehicle::{DesiredPath, NavMode};
use nalgebra::Vector3;

/// A demand is repeated after this long (s): a change of mode shows within 30 ms, its heartbeat at once, and over a slow
/// link in less than this; an autopilot that flies its mission gathers speed meanwhile.
pub(crate) const REPEAT_S: f64 = 0.5;
/// After so many demands without effect it is left alone until something changes.
pub(crate) const TRIES: u32 = 10;
/// Requests for an item that may be on their way at once: more are not made before the first has shown.
const REQUESTED_MAX: usize = 4;
/// A change of the current item this soon (s) after the mode was entered is the autopilot's own, from just before.
const ENTERED_S: f64 = 1.0;
/// Texts that wait to be sent; more of them in one step are left out.
const UPDATES_MAX: usize = 4;

/// What jink does about missions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Flies them where somebody lets it follow setpoints; takes none over.
    WhenChosen,
    /// Takes over those that the autopilot flies.
    TakesOver,
    /// Shows the autopilot the way while that flies them itself.
    ShowsTheWay,
    /// Nothing.
    None,
}

impl Part {
    /// That of a profile.
    pub fn of(config: &GatewayConfig) -> Self {
        match (config.profile.flies_the_mission(), config.takes_missions) {
            (true, true) => Self::TakesOver,
            (true, false) => Self::WhenChosen,
            (false, true) => Self::ShowsTheWay,
            (false, false) => Self::None,
        }
    }
}

/// What is flown while the autopilot follows setpoints.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FlightGoal {
    /// Nothing: the vehicle holds its place.
    #[default]
    None,
    /// The mission.
    Mission,
    /// To a place in the local frame (m).
    GoTo(Vector3<f64>),
}

/// A DO_CHANGE_SPEED as a command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedCommand {
    /// Its kind, as the command says it.
    pub kind: f32,
    /// Its speed, likewise (m/s).
    pub speed_mps: f32,
    /// Counts them.
    pub serial: u32,
}

/// What is known at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// Now.
    pub now: Timestamp,
    /// Mode in force, as the autopilot itself said last.
    pub mode: NavMode,
    /// Motors armed.
    pub armed: bool,
    /// Neither on the ground nor taking off.
    pub in_air: bool,
    /// Position in the local frame (m); `None` not known.
    pub position: Option<Vector3<f64>>,
    /// Speed (m/s).
    pub speed_mps: f64,
    /// Horizontal part of it (m/s).
    pub level_mps: f64,
    /// The mission; `None` not read.
    pub items: Option<&'a [Item]>,
    /// Counts the missions that were read, each different from the one before.
    pub version: u32,
    /// The mission is being read: the autopilot takes no other request about it.
    pub is_reading: bool,
    /// When the last whole reading of the mission began.
    pub read_at: Timestamp,
    /// The item that the autopilot counts as current; `None` not known.
    pub current: Option<u16>,
    /// Whose mission it is.
    pub make: AutopilotType,
    /// Home in the local frame (m); `None` not known.
    pub home: Option<Vector3<f64>>,
    /// Places of items can be converted to the local frame.
    pub is_located: bool,
    /// The place that a station has asked for last.
    pub go_to: Option<GoTo>,
    /// The speed that a station has asked for last.
    pub speed_command: Option<SpeedCommand>,
    /// Motions that nobody can guard may be flown by the autopilot (OA_UNGUARDED).
    pub lets_fly_unguarded: bool,
    /// The whole chain is ready.
    pub ready: bool,
    /// The setpoints that are sent belong to a plan and lie where the vehicle is.
    pub on_plan: bool,
}

/// A text for the pilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PilotText {
    /// Row of the event table.
    pub event: &'static Event,
    /// Fills its name.
    pub name: &'static str,
    /// Fills its first number.
    pub number: f64,
}

/// What follows from it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Intent {
    /// What is wanted of the planner; `None`: nothing, what is committed ends at rest.
    pub path: Option<DesiredPath>,
    /// What is to be asked of the autopilot now.
    pub demand: Option<Demand>,
    /// What is to be sent to the pilot now.
    pub update: Option<PilotText>,
    /// What is to be said in the log.
    pub note: Option<Note>,
    /// The mission is to be read anew before anything else happens.
    pub read_again: bool,
}

impl Intent {
    fn asking(demand: Option<Demand>) -> Self {
        Self {
            demand,
            ..Self::default()
        }
    }
}

/// Where the flight stands.
#[derive(Clone, Debug)]
pub struct Executive {
    part: Part,
    flight_goal: FlightGoal,
    /// The go-to was asked for while the autopilot held its place: it holds again afterwards.
    returns_to_hold: bool,
    /// The item that is flown to.
    index: Option<usize>,
    /// What the items that were passed have left.
    course: Course,
    /// Where the way to the item begins: at the place of the one before, or where the vehicle was.
    began_at: Option<(usize, Vector3<f64>)>,
    /// The place of an item that was reached, until the next one begins.
    arrived_at: Option<Vector3<f64>>,
    /// It was reached then.
    reached: Option<Timestamp>,
    before: NavMode,
    entered: Timestamp,
    was_armed: bool,
    /// The autopilot flies its mission on its own, as somebody wants it, until the mode changes.
    yielded: bool,
    /// The mission was given back, and is not taken over again at the same item.
    given_back: Option<GivenBack>,
    /// The autopilot flew it from another item, and did not let itself be put right.
    is_refused: bool,
    /// Where what was given back is flown.
    flown_alone: Option<FlownAlone>,
    /// That the mission is flown was said since the mode was entered, and in this flight.
    is_told: bool,
    was_taken: bool,
    /// The speed that was asked for by command (m/s), and how many were.
    commanded_mps: Option<f32>,
    speed_serial: u32,
    /// At rest since then to give the mission back.
    leaving: Option<Timestamp>,
    preparing: Option<Timestamp>,
    /// Attempts to take over since the mode has changed.
    attempts: u32,
    /// The autopilot holds because it was asked to, until the mission is taken over.
    halted: bool,
    /// Somebody let the autopilot fly its mission out of the mode that follows setpoints.
    left: Timestamp,
    /// Since when the mission is flown without jink; `None`: it is not; [`Timestamp::NEVER`]: that was reported.
    unguarded: Option<Timestamp>,
    asked: Option<(Demand, Timestamp, u32)>,
    current: Option<u16>,
    requested: [Option<(u16, Timestamp)>; REQUESTED_MAX],
    version: u32,
    reads_again: bool,
    is_reading: bool,
    go_to_serial: u32,
    /// What was reported last: it is not repeated while nothing changes.
    reported: Option<PilotText>,
    update: Vec<PilotText>,
}

impl Executive {
    /// For one flight after the other.
    pub fn new(part: Part) -> Self {
        Self {
            part,
            flight_goal: FlightGoal::None,
            returns_to_hold: false,
            index: None,
            course: Course::default(),
            began_at: None,
            arrived_at: None,
            reached: None,
            before: NavMode::Unknown,
            entered: Timestamp::NEVER,
            was_armed: false,
            yielded: false,
            given_back: None,
            is_refused: false,
            flown_alone: None,
            is_told: false,
            was_taken: false,
            commanded_mps: None,
            speed_serial: 0,
            leaving: None,
            preparing: None,
            attempts: 0,
            halted: false,
            left: Timestamp::NEVER,
            unguarded: None,
            asked: None,
            current: None,
            requested: [None; REQUESTED_MAX],
            version: 0,
            reads_again: false,
            is_reading: false,
            go_to_serial: 0,
            reported: None,
            update: Vec::with_capacity(UPDATES_MAX),
        }
    }

    /// What is flown while the autopilot follows setpoints.
    pub fn flight_goal(&self) -> FlightGoal {
        self.flight_goal
    }

    /// One step. `place` gives where an item leads in the local frame (m) from where it is begun; `None` if that cannot be said.
    pub fn step(
        &mut self,
        scene: &Scene<'_>,
        place: impl Fn(&Item, Vector3<f64>) -> Option<Vector3<f64>>,
    ) -> Intent {
        self.is_reading = scene.is_reading;
        self.notice_arming(scene);
        self.notice_mode(scene);
        self.notice_mission(scene);
        self.notice_current(scene);
        self.notice_go_to(scene);
        self.notice_speed(scene);
        let intent = match scene.mode {
            NavMode::Mission if self.part == Part::ShowsTheWay => self.show(scene, &place),
            NavMode::Offboard if self.part != Part::ShowsTheWay => self.fly(scene, &place),
            NavMode::Mission => self.prepare(scene, &place),
            NavMode::Land => self.watch_given_back(scene).unwrap_or_default(),
            NavMode::Hold if self.halted => self.prepare(scene, &place),
            NavMode::Hold if self.is_going(scene) => self.prepare_go_to(scene),
            _ => Intent::default(),
        };
        let update = (!self.update.is_empty()).then(|| self.update.remove(0));
        self.reads_again |= intent.read_again;
        // A request for an item goes first: an autopilot that is being read ignores it.
        let read_again = self.reads_again && !matches!(intent.demand, Some(Demand::Current(_)));
        self.reads_again &= !read_again;
        Intent {
            update,
            read_again,
            ..intent
        }
    }

    /// The item that is flown to cannot be reached: the one behind it is flown to.
    pub fn skip(&mut self) {
        self.go_on_at(self.index.map(|index| index + 1));
    }

    /// What is flown is flown to another item.
    fn go_on_at(&mut self, index: Option<usize>) {
        self.index = index;
        self.began_at = None;
        // Passed items lie between two places; a choice begins where the vehicle is.
        self.arrived_at = self.arrived_at.filter(|_| index.is_some());
        self.reached = None;
        self.leaving = None;
        self.reported = None;
    }

    /// Has it sent to the pilot, unless it was the last that was sent to him and nothing has changed.
    fn report(&mut self, event: &'static Event, name: &'static str, number: f64) {
        let update = PilotText { event, name, number };
        if self.reported.replace(update) != Some(update) && self.update.len() < UPDATES_MAX {
            self.update.push(update);
        }
    }

    /// A demand goes out at once, again every half second, and not for ever.
    fn ask(&mut self, now: Timestamp, demand: Demand) -> Option<Demand> {
        let (last, times) = match self.asked {
            Some((asked, last, times)) if asked == demand => (last, times),
            _ => (Timestamp::NEVER, 0),
        };
        let due = times == 0 || now.seconds_since(last) >= REPEAT_S;
        let is_busy = self.is_reading && matches!(demand, Demand::Current(_));
        if !due || is_busy || times >= TRIES {
            return None;
        }
        self.asked = Some((demand, now, times + 1));
        if let Demand::Current(item) = demand {
            let slot = self.requested.iter().position(Option::is_none).unwrap_or(0);
            let known = self
                .requested
                .iter()
                .position(|asked| asked.is_some_and(|(other, _)| other == item));
            self.requested[known.unwrap_or(slot)] = Some((item, now));
        }
        Some(demand)
    }

    /// How often the same has been asked for without effect.
    fn times_asked(&self, demand: Demand) -> u32 {
        self.asked
            .filter(|(asked, ..)| *asked == demand)
            .map_or(0, |(.., times)| times)
    }
}

#[cfg(test)]
mod numbers;
#[cfg(test)]
mod tests;
