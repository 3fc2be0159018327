//! Flies the autopilot's mission in its stead, for autopilots that only follow setpoints (OFFBOARD, GUIDED).
//!
//! | the autopilot | jink |
//! |---|---|
//! | flies its mission in the air, at a plain waypoint; the mission is read; jink is ready | has the way planned from the vehicle's own motion; asks for the mode in which setpoints are followed as soon as they lie where the vehicle is, at once if it hardly moves |
//! | flies on while that does not succeed: a slow link, a vehicle that gathers speed; or at once if jink is not ready | asks it to hold, since nobody looks for obstacles, and takes over from rest once it can |
//! | still flies its mission after a while | tells the pilot |
//! | follows setpoints | wants the current waypoint and the next one, counts them as reached, tells the autopilot which is current |
//! | the next item is no plain waypoint (a landing, a loiter, ...) | comes to rest, makes that item current, gives the mission back |
//! | the last waypoint is reached | comes to rest, gives the mission back: the autopilot finishes it |
//! | leaves that mode otherwise: the pilot, a failsafe | nothing, until somebody lets it fly the mission again |
//!
//! The stream is there before the mode is asked for, so entering is never refused and begins without a jump. Whoever chooses the
//! mode himself gets the same: the mission from its current item on. So does a gateway that was started again in flight: the
//! autopilot re-enters the mode as soon as setpoints come, and its current item is where the flight was.

pub mod client;
pub mod georeference;

use crate::config::GatewayConfig;
use client::Item;
use jink_shared_types::vehicle::{DesiredPath, DesiredPoint, NavMode};
use jink_shared_types::{Coded, Flag, Point, Timestamp};
use mavlink::dialects::ardupilotmega::MavCmd;
use nalgebra::Vector3;

/// A waypoint without a radius of its own counts as reached within this (m): PX4's default for multicopters is 2 m
/// (NAV_ACC_RAD); a planned path passes nearer.
const RADIUS_M: f64 = 1.0;
/// No radius is smaller than what a vehicle holds (m).
const SMALLEST_RADIUS_M: f64 = 0.3;
/// Slower than this counts as at rest (m/s): below the 0.3 m/s at which a vehicle counts as standing before an item, so that none
/// is taken for blocked while it waits to be given back; much lower, gusts at the end of the way would keep the mission from
/// ever being given back.
const REST_MPS: f64 = 0.2;
/// The way to be taken over must be planned and entered within this time (s); then the plan is dropped and made anew from where
/// the autopilot has flown meanwhile. It leaves room for one demand that is lost and its repetition after [`REPEAT_S`]; longer, a
/// plan that the autopilot does not follow would lie ever farther from the vehicle.
const PREPARATION_S: f64 = 1.5;
/// A vehicle that is slower has not moved away from its own stop before the mode is entered (m/s): at rest in 0.5 m, the distance
/// within which a plan counts as where the vehicle is.
const SLOW_MPS: f64 = 1.0;
/// A mission that is flown without jink for so long is told to the pilot (s): longer than taking over takes with a lost message.
const UNGUARDED_S: f64 = 3.0;
/// Pause in which the old plan is dropped (s): the wish is said every 0.2 s, and route, trajectory and approval count as silent
/// after 0.15 s each, so everybody has noticed that nothing is wanted before the next plan is.
const PAUSE_S: f64 = 0.5;
/// A demand is repeated after this long (s): a change of mode shows within 30 ms, its heartbeat at once, and over a slow
/// link in less than this; an autopilot that flies its mission gathers speed meanwhile.
const REPEAT_S: f64 = 0.5;
/// After so many demands without effect it is left alone until something changes.
const TRIES: u32 = 10;
/// After so many attempts to take a mission over it is left alone, too.
const ATTEMPTS: u32 = 5;
/// Speeds a mission may ask for (m/s).
const SPEEDS_MPS: std::ops::RangeInclusive<f32> = 0.1..=30.0;

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

/// What the autopilot is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Demand {
    /// To follow setpoints.
    Follow,
    /// To fly its mission again.
    Mission,
    /// To hold its place.
    Hold,
    /// To count this item as the current one.
    Current(u16),
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
    /// The mission; `None` not read.
    pub items: Option<&'a [Item]>,
    /// The item that the autopilot counts as current; `None` not known.
    pub current: Option<u16>,
    /// The whole chain is ready.
    pub ready: bool,
    /// The setpoints that are sent belong to a plan and lie where the vehicle is.
    pub on_plan: bool,
}

/// What follows from it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Intent {
    /// What is wanted of the planner; `None`: nothing, what is committed ends at rest.
    pub path: Option<DesiredPath>,
    /// What is to be asked of the autopilot now.
    pub demand: Option<Demand>,
    /// From now on the autopilot flies on its own what jink is here to fly.
    pub unguarded: bool,
}

/// Where the mission stands.
#[derive(Clone, Debug)]
pub struct Executive {
    part: Part,
    /// The item that is flown to.
    index: Option<usize>,
    /// It was reached then.
    reached: Option<Timestamp>,
    before: NavMode,
    /// The autopilot left the mode without being asked; the mission is the autopilot's until it begins anew.
    yielded: bool,
    /// The mission was given back at this item: it is not taken over at it again.
    given_back: Option<u16>,
    preparing: Option<Timestamp>,
    /// Attempts to take over since the mode has changed.
    attempts: u32,
    /// The autopilot holds because it was asked to, until the mission is taken over.
    halted: bool,
    /// Since when the mission is flown without jink; `None`: it is not; [`Timestamp::NEVER`]: that was told.
    unguarded: Option<Timestamp>,
    asked: Option<(Demand, Timestamp, u32)>,
}

impl Executive {
    /// For one flight after the other.
    pub fn new(part: Part) -> Self {
        Self {
            part,
            index: None,
            reached: None,
            before: NavMode::Unknown,
            yielded: false,
            given_back: None,
            preparing: None,
            attempts: 0,
            halted: false,
            unguarded: None,
            asked: None,
        }
    }

    /// One step. `place` tells where an item lies in the local frame (m); `None` if that cannot be said.
    pub fn step(&mut self, scene: &Scene<'_>, place: impl Fn(&Item) -> Option<Vector3<f64>>) -> Intent {
        self.notice_mode(scene);
        match scene.mode {
            NavMode::Mission if self.part == Part::ShowsTheWay => Intent {
                unguarded: self.notice_unguarded(scene),
                ..self.show(scene, place)
            },
            NavMode::Offboard if self.part != Part::ShowsTheWay => self.fly(scene, place),
            NavMode::Mission => Intent {
                unguarded: self.notice_unguarded(scene),
                ..self.prepare(scene, place)
            },
            NavMode::Hold if self.halted => self.prepare(scene, place),
            _ => Intent::default(),
        }
    }

    /// The way to the autopilot's current item, which counts it as reached itself.
    fn show(&self, scene: &Scene<'_>, place: impl Fn(&Item) -> Option<Vector3<f64>>) -> Intent {
        let way = self.to_be_taken_over(scene).and_then(|(items, index)| {
            let target = place(&items[index])?;
            Some(path(items, index, target, self.next(items, index, place)))
        });
        Intent {
            path: way,
            ..Intent::default()
        }
    }

    /// Has the way planned while the autopilot still flies, and takes over once setpoints lie where it flies. If they do not in
    /// time, the autopilot is to hold first.
    fn prepare(&mut self, scene: &Scene<'_>, place: impl Fn(&Item) -> Option<Vector3<f64>>) -> Intent {
        let Some((items, index)) = self.to_be_taken_over(scene).filter(|_| self.attempts < ATTEMPTS) else {
            self.preparing = None;
            return Intent::default();
        };
        if !scene.ready {
            self.preparing = None;
            return self.halt(scene);
        }
        let since = *self.preparing.get_or_insert(scene.now);
        let passed_s = scene.now.seconds_since(since);
        if passed_s > PREPARATION_S {
            if passed_s > PREPARATION_S + PAUSE_S {
                self.preparing = None;
                self.attempts += 1;
            }
            return self.halt(scene);
        }
        let Some(target) = place(&items[index]) else {
            return Intent::default();
        };
        let may_follow = scene.on_plan || scene.speed_mps <= SLOW_MPS;
        Intent {
            path: Some(path(items, index, target, self.next(items, index, place))),
            demand: may_follow.then(|| self.ask(scene.now, Demand::Follow)).flatten(),
            unguarded: false,
        }
    }

    /// The autopilot is to hold while nobody looks for obstacles.
    fn halt(&mut self, scene: &Scene<'_>) -> Intent {
        let flies = scene.mode == NavMode::Mission;
        Intent {
            demand: flies.then(|| self.ask(scene.now, Demand::Hold)).flatten(),
            ..Intent::default()
        }
    }

    /// Whether the autopilot flies the mission on its own for too long now; said once, until it is in another mode.
    fn notice_unguarded(&mut self, scene: &Scene<'_>) -> bool {
        let item = scene.items.zip(scene.current).and_then(|(items, current)| {
            let index = first_place(items, usize::from(current))?;
            Some(&items[index])
        });
        // Not known which item: it may be one.
        let is_ours = item.is_none_or(|item| is_plain(item) && self.given_back != Some(item.sequence));
        let alone = match self.part {
            Part::TakesOver => !self.yielded,
            Part::ShowsTheWay => !scene.ready,
            Part::WhenChosen | Part::None => false,
        } && scene.armed
            && scene.in_air
            && is_ours;
        if !alone {
            self.unguarded = None;
            return false;
        }
        let before = *self.unguarded.get_or_insert(scene.now);
        let due = before.is_set() && scene.now.seconds_since(before) > UNGUARDED_S;
        if due {
            self.unguarded = Some(Timestamp::NEVER);
        }
        due
    }

    /// The item that is flown to cannot be reached: the one behind it is flown to.
    pub fn skip(&mut self) {
        self.index = self.index.map(|index| index + 1);
        self.reached = None;
    }

    fn notice_mode(&mut self, scene: &Scene<'_>) {
        let before = std::mem::replace(&mut self.before, scene.mode);
        if before == scene.mode {
            return;
        }
        let asked = self.asked.take().map(|(demand, ..)| demand);
        self.preparing = None;
        self.attempts = 0;
        self.unguarded = None;
        self.halted = (before, scene.mode, asked) == (NavMode::Mission, NavMode::Hold, Some(Demand::Hold));
        match (before, scene.mode) {
            (_, NavMode::Offboard) => {
                self.yielded = false;
                self.given_back = None;
                self.index = None;
                self.reached = None;
            }
            // Nothing was flown: it was armed in this mode, or hovered.
            (NavMode::Offboard, _) if self.index.is_none() => self.yielded = false,
            (NavMode::Offboard, NavMode::Mission) => self.yielded = asked != Some(Demand::Mission),
            (NavMode::Offboard, _) => self.yielded = asked != Some(Demand::Hold),
            // Somebody lets the autopilot fly its mission.
            (_, NavMode::Mission) => {
                self.yielded = false;
                self.given_back = None;
            }
            _ => {}
        }
    }

    /// The items and the one to go on at, if the mission is to be taken over as soon as that can be done.
    fn to_be_taken_over<'a>(&self, scene: &Scene<'a>) -> Option<(&'a [Item], usize)> {
        let able = matches!(self.part, Part::TakesOver | Part::ShowsTheWay)
            && !self.yielded
            && scene.armed
            && scene.in_air
            && scene.position.is_some();
        let (items, current) = scene.items.zip(scene.current).filter(|_| able)?;
        let index = first_place(items, usize::from(current))?;
        let item = &items[index];
        let afresh = self.given_back != Some(item.sequence);
        (is_plain(item) && afresh).then_some((items, index))
    }

    fn fly(&mut self, scene: &Scene<'_>, place: impl Fn(&Item) -> Option<Vector3<f64>>) -> Intent {
        let (Some(items), Some(position), true) = (scene.items, scene.position, scene.in_air) else {
            return Intent::default();
        };
        let Some(current) = self.index.or(scene.current.map(usize::from)) else {
            return Intent::default();
        };
        // Items that are no place (a change of speed, a jump that is not taken) are passed over.
        let Some(index) = first_place(items, current) else {
            return self.give_back(scene, items);
        };
        let item = &items[index];
        if self.index != Some(index) {
            self.index = Some(index);
            self.reached = None;
        }
        if !is_plain(item) {
            if scene.current != Some(item.sequence) {
                return self.leave(scene, Demand::Current(item.sequence));
            }
            return self.leave(scene, Demand::Mission);
        }
        let Some(target) = place(item) else {
            // Not known where: what the autopilot makes of it is not jink's.
            return self.leave(scene, Demand::Hold);
        };
        if (position - target).norm() <= radius_m(item) {
            let since = *self.reached.get_or_insert(scene.now);
            if scene.now.seconds_since(since) >= f64::from(item.params[0]).max(0.0) {
                self.index = Some(index + 1);
                self.reached = None;
                return self.fly_on(scene, items, index + 1, place);
            }
        }
        let path = path(items, index, target, self.next(items, index, place));
        let demand = (scene.current != Some(item.sequence))
            .then(|| self.ask(scene.now, Demand::Current(item.sequence)))
            .flatten();
        Intent {
            path: Some(path),
            demand,
            unguarded: false,
        }
    }

    /// Where it goes on behind `index`, if that is a plain waypoint.
    fn next(
        &self,
        items: &[Item],
        index: usize,
        place: impl Fn(&Item) -> Option<Vector3<f64>>,
    ) -> Option<Vector3<f64>> {
        let next = &items[first_place(items, index + 1)?];
        place(next).filter(|_| is_plain(next))
    }

    /// An item was reached; the next step looks at the one behind it, and until then its place is wanted.
    fn fly_on(
        &mut self,
        scene: &Scene<'_>,
        items: &[Item],
        index: usize,
        place: impl Fn(&Item) -> Option<Vector3<f64>>,
    ) -> Intent {
        let Some(next) = first_place(items, index) else {
            return self.give_back(scene, items);
        };
        let item = &items[next];
        match place(item).filter(|_| is_plain(item)) {
            Some(target) => Intent {
                path: Some(path(items, next, target, self.next(items, next, place))),
                demand: self.ask(scene.now, Demand::Current(item.sequence)),
                unguarded: false,
            },
            None => Intent::default(),
        }
    }

    /// All is flown: the autopilot finishes the mission at its last place, where the vehicle is.
    fn give_back(&mut self, scene: &Scene<'_>, items: &[Item]) -> Intent {
        let last = items.iter().rev().find(|item| navigates(item));
        self.given_back = last.map(|item| item.sequence);
        match self.given_back {
            Some(last) if scene.current != Some(last) => self.leave(scene, Demand::Current(last)),
            Some(_) => self.leave(scene, Demand::Mission),
            None => Intent::default(),
        }
    }

    /// Comes to rest first: without a wish the committed trajectory ends, and then its end is held.
    fn leave(&mut self, scene: &Scene<'_>, demand: Demand) -> Intent {
        let rests = scene.speed_mps <= REST_MPS;
        Intent {
            path: None,
            demand: rests.then(|| self.ask(scene.now, demand)).flatten(),
            unguarded: false,
        }
    }

    /// A demand goes out at once, again every second, and not for ever.
    fn ask(&mut self, now: Timestamp, demand: Demand) -> Option<Demand> {
        let (last, times) = match self.asked {
            Some((asked, last, times)) if asked == demand => (last, times),
            _ => (Timestamp::NEVER, 0),
        };
        let due = times == 0 || now.seconds_since(last) >= REPEAT_S;
        if !due || times >= TRIES {
            return None;
        }
        self.asked = Some((demand, now, times + 1));
        Some(demand)
    }
}

/// A waypoint that is flown to, waited at for a while at most, and left.
fn is_plain(item: &Item) -> bool {
    item.command == MavCmd::MAV_CMD_NAV_WAYPOINT && item.autocontinue
}

/// Whether an item means a place or a task of the autopilot's own: what the protocol counts as a navigation command.
fn navigates(item: &Item) -> bool {
    (item.command as u32) < MavCmd::MAV_CMD_NAV_LAST as u32
}

/// The first item from `from` on that is a place or a task.
fn first_place(items: &[Item], from: usize) -> Option<usize> {
    (from..items.len()).find(|index| navigates(&items[*index]))
}

fn radius_m(item: &Item) -> f64 {
    match f64::from(item.params[1]) {
        radius if radius > 0.0 => radius.max(SMALLEST_RADIUS_M),
        _ => RADIUS_M,
    }
}

/// The speed that the mission asks for at `index`: the last DO_CHANGE_SPEED of a ground speed before it (m/s); NaN none.
fn speed_mps(items: &[Item], index: usize) -> f64 {
    let changes = items[..index].iter().rev();
    let mut speeds = changes
        .filter(|item| item.command == MavCmd::MAV_CMD_DO_CHANGE_SPEED && item.params[0] == 1.0)
        .map(|item| item.params[1]);
    speeds
        .find(|speed| SPEEDS_MPS.contains(speed))
        .map_or(f64::NAN, f64::from)
}

fn path(items: &[Item], index: usize, target: Vector3<f64>, next: Option<Vector3<f64>>) -> DesiredPath {
    let point = |place: Vector3<f64>, yaw_rad: f32| DesiredPoint {
        position: Point::from_vector(place),
        yaw_rad,
        valid: Flag::YES,
        ..DesiredPoint::default()
    };
    let yaw_rad = items[index].params[3].to_radians();
    DesiredPath {
        points: [
            point(target, f32::NAN),
            point(target, yaw_rad),
            point(next.unwrap_or(target), f32::NAN),
        ],
        mission_speed_mps: speed_mps(items, index),
        mode: Coded::new(NavMode::Offboard),
        ..DesiredPath::default()
    }
}

#[cfg(test)]
mod tests;
