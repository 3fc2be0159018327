//! The mission, flown in the autopilot's stead: taken over, item by item, or shown to an autopilot that flies it itself.

use super::client::Item;
use super::items::{Course, Task, first_item, navigates, path, radius_m, yaw_rad};
use super::{Executive, FlightGoal, Intent, Part, Scene};
use crate::demand::Demand;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{
    ITEM_HELD, ITEM_STRAIGHT, ITEM_UNGUARDED, JUMP_NOWHERE, MISSION_RESUMED, MISSION_TAKEN, MISSION_WAITS,
    NO_GOAL, UNGUARDED,
};
use jink_shared_types::vehicle::NavMode;
use nalgebra::Vector3;

/// The way to be taken over must be planned and entered within this time (s); then the plan is dropped and made anew from where
/// the autopilot has flown meanwhile. It leaves room for one demand that is lost and its repetition; longer, a
/// plan that the autopilot does not follow would lie ever farther from the vehicle.
const PREPARATION_S: f64 = 1.5;
/// A vehicle that is slower has not moved away from its own stop before the mode is entered (m/s): at rest in 0.5 m, the distance
/// within which a plan counts as where the vehicle is.
const SLOW_MPS: f64 = 1.0;
/// The same for one that climbs at its take-off: above it nothing was looked for by the autopilot either.
const CLIMBING_MPS: f64 = 2.0;
/// A mission that is flown without jink for so long is reported to the pilot (s): longer than a takeover with a lost
/// message.
const UNGUARDED_S: f64 = 3.0;
/// Pause in which the old plan is dropped (s): the wish is said every 0.2 s, and route, trajectory and approval count as silent
/// after 0.15 s each, so everybody has noticed that nothing is wanted before the next plan is.
const PAUSE_S: f64 = 0.5;
/// After so many attempts to take a mission over it is left alone.
const ATTEMPTS: u32 = 5;
/// A landing that is not farther than this beside its place (m) is vertical: what a vehicle drifts while it descends.
const ABOVE_M: f64 = 0.5;
/// A take-off whose place is farther away than this (m) has a horizontal part; nearer, a vehicle that has climbed is there.
const BESIDE_M: f64 = 2.0;
/// A take-off has climbed once this little is missing (m).
const CLIMBED_M: f64 = 1.0;
/// Items that are passed over in one step.
const PASSES: usize = 32;

/// Where an item is to be flown to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Target {
    /// To be there for so long (s).
    Visit(Vector3<f64>, f64),
    /// Above the place where the autopilot lands, asked for it like this.
    Above(Vector3<f64>, Demand),
    /// It has been flown.
    Done,
    /// The autopilot climbs.
    Climb,
    /// Nobody could guard it.
    Unguarded(&'static str),
    /// The mission ends here without an end of its own.
    Nowhere,
    /// It cannot be said yet.
    NotYet,
}

impl Target {
    fn place(self) -> Option<Vector3<f64>> {
        match self {
            Self::Visit(place, _) | Self::Above(place, _) => Some(place),
            _ => None,
        }
    }
}

impl Executive {
    /// The way to the autopilot's current item, which counts it as reached itself.
    pub(super) fn show(
        &mut self,
        scene: &Scene<'_>,
        place: &impl Fn(&Item, Vector3<f64>) -> Option<Vector3<f64>>,
    ) -> Intent {
        self.notice_unguarded(scene);
        let Some((items, index)) = self.to_be_flown(scene) else {
            return Intent::default();
        };
        let target = self.target(scene, items, index, place);
        match target {
            Target::Unguarded(name) => self.hold_before(scene, &items[index], name),
            Target::Above(above, _) if is_above(scene, above) => Intent::default(),
            _ => self.wanting(scene, items, index, target, place),
        }
    }

    /// Has the way planned while the autopilot still flies, and takes over once setpoints lie where it flies. If they do not in
    /// time, the autopilot is to hold first.
    pub(super) fn prepare(
        &mut self,
        scene: &Scene<'_>,
        place: &impl Fn(&Item, Vector3<f64>) -> Option<Vector3<f64>>,
    ) -> Intent {
        self.notice_unguarded(scene);
        if let Some(intent) = self
            .verify_given_back(scene)
            .or_else(|| self.watch_given_back(scene))
        {
            return intent;
        }
        let Some((items, index)) = self.to_be_flown(scene).filter(|_| self.attempts < ATTEMPTS) else {
            self.preparing = None;
            return Intent::default();
        };
        let target = self.target(scene, items, index, place);
        match target {
            Target::Unguarded(name) => return self.hold_before(scene, &items[index], name),
            Target::Climb | Target::Done | Target::Nowhere => return Intent::default(),
            Target::Above(above, _) if scene.mode == NavMode::Mission && is_above(scene, above) => {
                return Intent::default();
            }
            _ => {}
        }
        if !scene.ready {
            self.preparing = None;
            self.report(&MISSION_WAITS, "", 0.0);
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
        if target.place().is_none() {
            return Intent::default();
        }
        self.flight_goal = FlightGoal::Mission;
        let is_slow = scene.level_mps <= SLOW_MPS && scene.speed_mps <= CLIMBING_MPS;
        let may_follow = scene.on_plan || is_slow;
        Intent {
            demand: may_follow.then(|| self.ask(scene.now, Demand::Follow)).flatten(),
            ..self.wanting(scene, items, index, target, place)
        }
    }

    /// The autopilot is to hold while nobody looks for obstacles.
    fn halt(&mut self, scene: &Scene<'_>) -> Intent {
        let flies = scene.mode == NavMode::Mission;
        Intent::asking(flies.then(|| self.ask(scene.now, Demand::Hold)).flatten())
    }

    /// An item that nobody could guard: the autopilot holds before it, or is let fly it.
    fn hold_before(&mut self, scene: &Scene<'_>, item: &Item, name: &'static str) -> Intent {
        let number = f64::from(item.sequence);
        self.preparing = None;
        if scene.lets_fly_unguarded {
            self.report(&ITEM_UNGUARDED, name, number);
            return Intent::default();
        }
        self.report(&ITEM_HELD, name, number);
        self.halt(scene)
    }

    /// Reports once that the autopilot flies the mission on its own for too long now, until it is in another mode.
    fn notice_unguarded(&mut self, scene: &Scene<'_>) {
        let item = scene.items.zip(scene.current).and_then(|(items, current)| {
            self.current_item(scene, items, current)
                .map(|index| &items[index])
        });
        // Not known which item: it may be one.
        let is_ours = item.is_none_or(|item| {
            matches!(Task::of(scene.make, item), Task::Visit { .. }) && !self.was_given_back(item.sequence)
        });
        let alone = match self.part {
            Part::TakesOver => !self.yielded,
            Part::ShowsTheWay => !scene.ready,
            Part::WhenChosen | Part::None => false,
        } && scene.mode == NavMode::Mission
            && scene.armed
            && scene.in_air
            && is_ours;
        if !alone {
            self.unguarded = None;
            return;
        }
        let before = *self.unguarded.get_or_insert(scene.now);
        if before.is_set() && scene.now.seconds_since(before) > UNGUARDED_S {
            self.unguarded = Some(Timestamp::NEVER);
            self.report(&UNGUARDED, "", 0.0);
        }
    }

    /// The items and the one that the autopilot flies, if jink has a part in it.
    fn to_be_flown<'a>(&self, scene: &Scene<'a>) -> Option<(&'a [Item], usize)> {
        let able = matches!(self.part, Part::TakesOver | Part::ShowsTheWay)
            && !self.yielded
            && scene.armed
            && scene.in_air
            && scene.position.is_some();
        let (items, current) = scene.items.zip(scene.current).filter(|_| able)?;
        let index = self.current_item(scene, items, current)?;
        let afresh = !self.was_given_back(items[index].sequence);
        afresh.then_some((items, index))
    }

    /// Which one the autopilot flies while `current` counts as its current item.
    fn current_item(&self, scene: &Scene<'_>, items: &[Item], current: u16) -> Option<usize> {
        let from = usize::from(current.max(first_item(scene.make)));
        self.course.foresee(scene.make, items, from)
    }

    /// What the items before `index` have left; of those that jink has not passed itself, what they say in order.
    fn course_at(&self, scene: &Scene<'_>, items: &[Item], index: usize) -> Course {
        if self.course == Course::default() {
            return Course::begun_at(scene.make, items, index);
        }
        self.course
    }

    /// Where the item at `index` leads. Where its height does not count, the one at which it was begun does.
    fn target(
        &mut self,
        scene: &Scene<'_>,
        items: &[Item],
        index: usize,
        place: &impl Fn(&Item, Vector3<f64>) -> Option<Vector3<f64>>,
    ) -> Target {
        let Some(position) = scene.position else {
            return Target::NotYet;
        };
        let item = &items[index];
        let begun = match self.began_at {
            Some((at, begun)) if at == index => begun,
            // Behind an item that was reached the next one begins at its place.
            _ => self.arrived_at.take().unwrap_or(position),
        };
        self.began_at = Some((index, begun));
        let at_this_height = |place: Vector3<f64>| Vector3::new(place.x, place.y, begun.z);
        let task = Task::of(scene.make, item);
        if !scene.is_located && !matches!(task, Task::Wait(_) | Task::Unguarded(_) | Task::Nowhere) {
            return Target::NotYet;
        }
        match (task, place(item, begun)) {
            (Task::Visit { stay_s, is_spline }, Some(place)) => {
                if is_spline {
                    self.report(&ITEM_STRAIGHT, "", f64::from(item.sequence));
                }
                Target::Visit(place, stay_s)
            }
            (Task::Visit { .. }, None) => Target::Unguarded("without place"),
            (Task::Wait(seconds), _) => Target::Visit(begun, seconds),
            // The last one is flown in the autopilot's landing mode, as a return is. What comes behind one is the mission's, and so is
            // PX4's precision landing.
            (Task::Land, place) => {
                let is_precise = scene.make == AutopilotType::Px4 && item.params[1] > 0.0;
                let is_last = index + 1 == items.len() && !is_precise;
                let demand = if is_last { Demand::Land } else { Demand::Mission };
                Target::Above(at_this_height(place.unwrap_or(begun)), demand)
            }
            (Task::Return, _) => match scene.home {
                Some(home) => Target::Above(at_this_height(home), Demand::Land),
                None => Target::Unguarded("return"),
            },
            (Task::TakeOff, Some(place)) if scene.make == AutopilotType::Px4 => {
                let beside_m = (place - position).xy().norm();
                match (position.z - place.z > CLIMBED_M, beside_m > BESIDE_M) {
                    (true, _) if scene.mode == NavMode::Mission => Target::Climb,
                    (_, true) => Target::Visit(Vector3::new(place.x, place.y, place.z.min(begun.z)), 0.0),
                    // Taken over before its end, while the vehicle is slow: behind it the autopilot gathers speed at once.
                    _ if scene.mode == NavMode::Mission && self.part == Part::TakesOver => {
                        Target::Visit(Vector3::new(begun.x, begun.y, place.z), 0.0)
                    }
                    _ if scene.mode == NavMode::Mission => Target::Climb,
                    _ => Target::Done,
                }
            }
            (Task::TakeOff, _) if scene.mode == NavMode::Mission => Target::Climb,
            // ArduPilot climbs where it is, and never descends for it.
            (Task::TakeOff, Some(place)) if begun.z - place.z > CLIMBED_M => {
                Target::Visit(Vector3::new(begun.x, begun.y, place.z), 0.0)
            }
            (Task::TakeOff, _) => Target::Done,
            (Task::Unguarded(name), _) => Target::Unguarded(name),
            (Task::Nowhere, _) => Target::Nowhere,
        }
    }

    /// The wish to be at the target, and behind it at the next place.
    fn wanting(
        &self,
        scene: &Scene<'_>,
        items: &[Item],
        index: usize,
        target: Target,
        place: &impl Fn(&Item, Vector3<f64>) -> Option<Vector3<f64>>,
    ) -> Intent {
        let next = match target {
            Target::Visit(target, 0.0) if scene.is_located => self
                .course
                .foresee(scene.make, items, index + 1)
                .map(|next| &items[next])
                .filter(|next| matches!(Task::of(scene.make, next), Task::Visit { .. }))
                .and_then(|next| place(next, target)),
            _ => None,
        };
        let course = self.course_at(scene, items, index);
        Intent {
            path: target.place().map(|place| {
                let yaw_rad = yaw_rad(scene.make, &items[index]);
                path(place, yaw_rad, next, course.speed_mps)
            }),
            ..Intent::default()
        }
    }

    /// The mission, from item to item.
    pub(super) fn fly_mission(
        &mut self,
        scene: &Scene<'_>,
        place: &impl Fn(&Item, Vector3<f64>) -> Option<Vector3<f64>>,
    ) -> Intent {
        let (Some(items), Some(position), true) = (scene.items, scene.position, scene.in_air) else {
            return Intent::default();
        };
        let first = usize::from(first_item(scene.make));
        if !items.iter().skip(first).any(navigates) {
            return self.clear();
        }
        let mut start = match (self.index, scene.current.map(usize::from)) {
            (Some(index), _) => index,
            (None, None) => return Intent::default(),
            // Nobody has begun the mission.
            (None, Some(current)) if current < first && self.part == Part::WhenChosen => {
                self.flight_goal = FlightGoal::None;
                self.report(&NO_GOAL, "", 0.0);
                return Intent::default();
            }
            (None, Some(current)) if current >= items.len() => return self.clear(),
            (None, Some(current)) => {
                let start = current.max(first);
                self.course = self.course_at(scene, items, start);
                start
            }
        };
        let mut begins = false;
        for _ in 0..PASSES {
            let Some(index) = self.course.follow(scene.make, items, start) else {
                return self.finish(scene, items, place);
            };
            if self.index != Some(index) {
                self.go_on_at(Some(index));
                begins = true;
            }
            let target = self.target(scene, items, index, place);
            let is_flown = match target {
                Target::Done => true,
                Target::Visit(target, stay_s) => {
                    self.has_visited(scene, position, target, &items[index], stay_s)
                }
                _ => false,
            };
            if is_flown {
                start = index + 1;
                self.go_on_at(Some(start));
                self.arrived_at = target.place();
                begins = true;
                continue;
            }
            let intent = self.fly_to(scene, items, index, target, place);
            return Intent {
                read_again: intent.read_again || begins,
                ..intent
            };
        }
        Intent::default()
    }

    fn has_visited(
        &mut self,
        scene: &Scene<'_>,
        position: Vector3<f64>,
        target: Vector3<f64>,
        item: &Item,
        stay_s: f64,
    ) -> bool {
        if (position - target).norm() > radius_m(item) {
            return false;
        }
        let since = *self.reached.get_or_insert(scene.now);
        scene.now.seconds_since(since) >= stay_s
    }

    fn fly_to(
        &mut self,
        scene: &Scene<'_>,
        items: &[Item],
        index: usize,
        target: Target,
        place: &impl Fn(&Item, Vector3<f64>) -> Option<Vector3<f64>>,
    ) -> Intent {
        let item = &items[index];
        if !std::mem::replace(&mut self.is_told, true) {
            let is_new = !std::mem::replace(&mut self.was_taken, true);
            let event = if is_new { &MISSION_TAKEN } else { &MISSION_RESUMED };
            self.report(event, "", f64::from(item.sequence));
        }
        match target {
            Target::Above(above, demand) if is_above(scene, above) => {
                return self.leave(scene, item.sequence, demand, Some(above));
            }
            Target::Unguarded(name) if scene.lets_fly_unguarded => {
                self.report(&ITEM_UNGUARDED, name, f64::from(item.sequence));
                return self.leave(scene, item.sequence, Demand::Mission, None);
            }
            Target::Unguarded(name) => {
                self.report(&ITEM_HELD, name, f64::from(item.sequence));
                return Intent::default();
            }
            Target::Nowhere => {
                self.report(&JUMP_NOWHERE, "", f64::from(item.sequence));
                return Intent::default();
            }
            _ => {}
        }
        self.leaving = None;
        let demand = (scene.current != Some(item.sequence))
            .then(|| self.ask(scene.now, Demand::Current(item.sequence)))
            .flatten();
        Intent {
            demand,
            ..self.wanting(scene, items, index, target, place)
        }
    }
}

/// Whether what is left of a landing at that place is vertical.
fn is_above(scene: &Scene<'_>, place: Vector3<f64>) -> bool {
    scene
        .position
        .is_some_and(|position| (position - place).xy().norm() <= ABOVE_M)
}
