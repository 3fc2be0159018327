//! Whether the vehicle makes progress toward the goal, and if not, why.
//!
//! Neither standing nor the straight distance is the criterion: a detour leads away from the goal for a while, and a
//! vehicle may circle round a goal that it cannot reach. The criterion is the cost of the remaining path, as the search
//! finds it: if the lowest since the goal is the goal does not become lower for OA_BLOCKED_T, the goal is out of reach. A
//! detour that is found in flight makes the cost greater at once; the time for flying it is added. Nothing else counts: a path
//! that ends before the goal has no cost of reaching it, and places where the vehicle has not been yet are no end of a search.
//!
//! Searches that go on finding something a little cheaper end as well: the way flown for a goal is at most [`WAY_FACTOR`] times the
//! highest cost that it has had, and [`WAY_M`], and all searches together take at most [`SEARCHES_S`] and what the straight way
//! takes at 1 m/s. In mazes and dead ends whose goals can be reached 3.2 times that cost was flown at most.

use crate::search::{PathEnd, SearchResult};
use jink_shared_types::Timestamp;
use jink_shared_types::frames::{LocalNed, Point};

/// A path that is shorter by this is progress (m): above what the map's noise makes of it from plan to plan.
const PROGRESS_M: f64 = 0.5;
/// A goal that has moved by less is the same (m).
const SAME_GOAL_M: f64 = 0.1;
/// Nobody watches for longer than this (s) only while planning pauses, or the planner has been stopped: that time does not
/// count.
const WATCHED_S: f64 = 1.0;
/// A detour takes so many times what it takes at the speed of its tier: the vehicle slows down at corners, and into and out of
/// dead ends.
const DETOUR_FACTOR: f64 = 2.0;
/// Longest way for a goal: so many times the highest cost that it has had ...
const WAY_FACTOR: f64 = 4.0;
/// ... and this (m), for goals nearby.
const WAY_M: f64 = 20.0;
/// Longest time of all searches for a goal (s), besides OA_BLOCKED_T and a second for each metre of the straight way to it: one
/// detour along all four sides of the map's window in a slow speed tier takes it, and whole flights through mazes of 20 m took 205 s
/// at most.
const SEARCHES_S: f64 = 240.0;
/// A search is reported once it has led no nearer for so long (s): by then it is no mere bend ...
const SEARCH_REPORTED_S: f64 = 10.0;
/// ... and again after this time (s).
const SEARCH_REPEATED_S: f64 = 30.0;

/// Without progress for this share of the timeout the vehicle is stalled: long enough to come through a gap that flickers, and
/// three quarters are left to try other ways.
const STALLED_SHARE: f64 = 0.25;

/// Places are as large as this (m): about what is seen of a narrow way at once.
const PLACE_M: f64 = 2.0;
/// Places that are remembered.
const PLACES: usize = 512;

/// A path that was known counts as known for so long (s) after plans have failed: for a moment they do in narrow places.
const PATH_LOST_S: f64 = 5.0;

/// Why a goal is not reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstruction {
    /// An obstacle is at the goal.
    Occupied,
    /// Obstacles around the goal leave no path.
    Enclosed,
    /// It lies outside of the heights allowed; the vehicle waits above or below it.
    Height,
    /// No path is known that ends in known-free space.
    Unseen,
    /// Paths were known and flown, and none has led nearer.
    NotFound,
    /// A path is known, but plans along it are not flown: the guard refuses them, or the generator makes no curve.
    Unflown,
}

impl Obstruction {
    /// The obstruction of a path that does not end at the goal.
    pub fn of(found: Option<&SearchResult>) -> Self {
        match found {
            Some(found) if found.goal_is_occupied => Obstruction::Occupied,
            Some(found) if found.end == PathEnd::NearestPoint => Obstruction::Enclosed,
            _ => Obstruction::Unseen,
        }
    }

    /// The text for the pilot.
    pub fn text(self) -> &'static str {
        match self {
            Obstruction::Occupied => "obstacle there",
            Obstruction::Enclosed => "no way round",
            Obstruction::Height => "height not allowed",
            Obstruction::Unseen => "way not seen",
            Obstruction::NotFound => "no way found",
            Obstruction::Unflown => "plans not flown",
        }
    }
}

/// Watches the progress toward one goal.
#[derive(Clone, Debug)]
pub struct GoalProgress {
    timeout_s: f64,
    goal: Option<Point<LocalNed>>,
    /// The lowest remaining cost since the goal is what it is (m), and when that was.
    min_m: f64,
    since: Timestamp,
    /// The highest remaining cost since then (m).
    max_m: f64,
    /// Since the goal is what it is: the straight way to it (m), the highest cost (m), the way flown (m), the time of the
    /// searches that have ended (s).
    straight_m: f64,
    highest_m: f64,
    way_m: f64,
    searched_s: f64,
    /// Up to where the way is counted.
    place: Option<Point<LocalNed>>,
    is_blocked: bool,
    due: Timestamp,
    /// The last step.
    watched: Timestamp,
    /// When a path was known last, and how fast it is flown (m/s).
    path_known: (Timestamp, f64),
    /// Where the vehicle has been since the goal is what it is.
    places: Vec<[i32; 3]>,
    /// When the remaining cost became lower, or the vehicle came to a new place.
    moved_on: Timestamp,
    /// When it was reported last that a way is searched for.
    reported: Timestamp,
}

impl GoalProgress {
    /// A goal is out of reach after `timeout_s` without progress.
    pub fn new(timeout_s: f64) -> Self {
        Self::with_room(timeout_s, Vec::with_capacity(PLACES))
    }

    /// The same in memory that is there already.
    fn with_room(timeout_s: f64, mut places: Vec<[i32; 3]>) -> Self {
        places.clear();
        Self {
            timeout_s,
            goal: None,
            min_m: f64::INFINITY,
            since: Timestamp::NEVER,
            max_m: 0.0,
            straight_m: 0.0,
            highest_m: 0.0,
            way_m: 0.0,
            searched_s: 0.0,
            place: None,
            is_blocked: false,
            due: Timestamp::NEVER,
            watched: Timestamp::NEVER,
            path_known: (Timestamp::NEVER, 0.0),
            places,
            moved_on: Timestamp::NEVER,
            reported: Timestamp::NEVER,
        }
    }

    /// There is no goal, or it was reached.
    pub fn reset(&mut self) {
        *self = Self::with_room(self.timeout_s, std::mem::take(&mut self.places));
    }

    /// Whether the vehicle has come neither nearer nor to a new place for a quarter of the time after which the goal counts as
    /// out of reach.
    pub fn is_stalled(&self, now: Timestamp) -> bool {
        self.goal.is_some() && now.seconds_since(self.moved_on) > STALLED_SHARE * self.timeout_s
    }

    /// Whether the goal has been out of reach, and still is.
    pub fn is_blocked(&self) -> bool {
        self.is_blocked
    }

    /// Whether a path with the remaining cost `remaining_m` is about as short as the shortest before.
    pub fn is_as_short(&self, remaining_m: f64) -> bool {
        remaining_m <= self.min_m + PROGRESS_M
    }

    /// The goal does not count as out of reach any more at `now`.
    pub fn resume(&mut self, now: Timestamp) {
        self.is_blocked = false;
        self.begin(now);
    }

    /// The time and the way for the goal begin anew.
    fn begin(&mut self, now: Timestamp) {
        (self.way_m, self.searched_s) = (0.0, 0.0);
        self.since = now;
        self.moved_on = now;
    }

    /// For how long no path has been found that is shorter than any before (s), if that is a search.
    fn search_s(&self, now: Timestamp) -> f64 {
        let searched_s = now.seconds_since(self.since);
        if searched_s < SEARCH_REPORTED_S {
            0.0
        } else {
            searched_s
        }
    }

    /// Whether the way flown for the goal, or the searches, are more than any way to it would be worth.
    fn is_spent(&self, now: Timestamp) -> bool {
        let searched_s = self.searched_s + self.search_s(now);
        self.way_m > WAY_FACTOR * self.highest_m + WAY_M
            || searched_s > self.timeout_s + SEARCHES_S + self.straight_m
    }

    /// The vehicle is at `place` at `now`, the path to `goal` has the remaining cost `remaining_m`, and a detour is being flown at
    /// `speed_mps` (none: 0); `None`: no path to the goal is known. Returns whether the goal counts as out of reach from now on, and again
    /// after every further timeout. It does so until [`Self::resume`], whatever paths seem to be found.
    pub fn step(
        &mut self,
        now: Timestamp,
        goal: &Point<LocalNed>,
        place: &Point<LocalNed>,
        remaining_m: Option<f64>,
        speed_mps: f64,
    ) -> bool {
        let is_same = self
            .goal
            .is_some_and(|before| (before.vector() - goal.vector()).norm() <= SAME_GOAL_M);
        if !is_same {
            self.reset();
            self.goal = Some(*goal);
            self.straight_m = (goal.vector() - place.vector()).norm();
            self.highest_m = self.straight_m;
            self.begin(now);
        }
        if self.watched.is_set() && now.seconds_since(self.watched) > WATCHED_S {
            self.pause(now);
        }
        self.watched = now;
        let way_m = (place.vector() - self.place.get_or_insert(*place).vector()).norm();
        if way_m > PROGRESS_M {
            self.way_m += way_m;
            self.place = Some(*place);
        }
        if let Some(remaining_m) = remaining_m {
            self.highest_m = self.highest_m.max(remaining_m);
            if remaining_m < self.min_m - PROGRESS_M {
                self.searched_s += self.search_s(now);
                self.min_m = remaining_m;
                self.max_m = remaining_m;
                self.since = now;
                self.moved_on = now;
                self.due = now;
            }
            self.max_m = self.max_m.max(remaining_m);
        }
        if speed_mps > 0.0 {
            self.path_known = (now, speed_mps);
        }
        let (known, known_mps) = self.path_known;
        let is_known = known_mps > 0.0 && now.seconds_since(known) < PATH_LOST_S;
        let detour_s = if is_known && self.min_m.is_finite() {
            DETOUR_FACTOR * (self.max_m - self.min_m) / known_mps
        } else {
            0.0
        };
        let counted_since = if self.is_blocked { self.due } else { self.since };
        let is_due = now.seconds_since(counted_since) >= self.timeout_s + detour_s;
        if !is_due && (self.is_blocked || !self.is_spent(now)) {
            return false;
        }
        self.is_blocked = true;
        self.due = now;
        true
    }

    /// For how long a way has been searched for (s), if that is to be reported at `now`.
    pub fn search_to_report_s(&mut self, now: Timestamp) -> Option<f64> {
        let searched_s = self.search_s(now);
        let is_due = self.goal.is_some()
            && !self.is_blocked
            && searched_s > 0.0
            && (!self.reported.is_set() || now.seconds_since(self.reported) >= SEARCH_REPEATED_S);
        is_due.then(|| {
            self.reported = now;
            searched_s
        })
    }

    /// The vehicle is at `position`, on a path that leads on to the goal as far as is known.
    pub fn explore(&mut self, now: Timestamp, position: &Point<LocalNed>) {
        let place = [position.x_m, position.y_m, position.z_m].map(|m| (m / PLACE_M).floor() as i32);
        if self.goal.is_some() && self.places.len() < PLACES && !self.places.contains(&place) {
            self.places.push(place);
            self.moved_on = now;
        }
    }

    /// No ranges, or no guard, from the last step until `now`: that time does not count.
    pub fn pause(&mut self, now: Timestamp) {
        if self.goal.is_some() && self.watched.is_set() {
            let paused_s = now.seconds_since(self.watched);
            self.since = self.since.plus_seconds(paused_s);
            self.place = None;
            if self.is_blocked {
                self.due = self.due.plus_seconds(paused_s);
            }
            self.watched = now;
            self.moved_on = now;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::GoalProgress;
    use jink_shared_types::Timestamp;
    use jink_shared_types::frames::{LocalNed, Point};
    use proptest::prelude::*;

    const HERE: Point<LocalNed> = Point::new(0.0, 0.0, 0.0);

    /// When the goal was out of reach within 100 s, with `remaining_m` after each time.
    fn blocked(detour_mps: f64, remaining_m: impl Fn(f64) -> Option<f64>) -> Vec<f64> {
        let mut progress = GoalProgress::new(10.0);
        let goal = Point::new(1.0, 2.0, 3.0);
        let seconds = (0..1000).map(|i| f64::from(i) * 0.1);
        seconds
            .filter(|s| {
                progress.step(
                    Timestamp::from_seconds(50.0 + s),
                    &goal,
                    &HERE,
                    remaining_m(*s),
                    detour_mps,
                )
            })
            .collect()
    }

    #[test]
    fn whoever_comes_nearer_is_left_alone_however_slowly() {
        assert!(blocked(0.0, |s| Some(60.0 - 0.1 * s)).is_empty());
    }

    #[test]
    fn standing_wobbling_and_circling_are_reported_after_the_timeout_and_again() {
        let path_choice: [fn(f64) -> Option<f64>; 3] =
            [|_| Some(3.0), |s| Some(3.0 + 0.4 * s.sin()), |_| None];
        for remaining_m in path_choice {
            let due = blocked(0.0, remaining_m);
            assert!(due[0] < 13.0 && due.len() >= 8, "{due:?}");
        }
        let circling = blocked(1.5, |s| Some(4.0 + 2.0 * s.sin()));
        assert!(circling[0] < 20.0, "{circling:?}");
    }

    #[test]
    fn a_detour_is_given_the_time_it_takes_and_no_more() {
        let remaining_m = |s: f64| Some(if s < 5.0 { 10.0 - s } else { 45.0 - 1.5 * (s - 5.0) }.max(4.0));
        let due = blocked(1.5, remaining_m);
        assert!(due[0] > 35.0, "{due:?}");
    }

    #[test]
    fn plans_that_fail_for_a_moment_take_the_time_for_a_detour_from_nobody() {
        let mut progress = GoalProgress::new(10.0);
        let goal = Point::new(1.0, 2.0, 3.0);
        let due = (0..1000).map(|i| f64::from(i) * 0.1).find(|s| {
            let remaining_m = if *s < 5.0 { 10.0 - s } else { 45.0 };
            // Every third second none is found, and after 40 s there is none at all.
            let speed_mps = if (*s as i32) % 3 == 0 || *s > 40.0 {
                0.0
            } else {
                1.5
            };
            progress.step(
                Timestamp::from_seconds(50.0 + s),
                &goal,
                &HERE,
                Some(remaining_m),
                speed_mps,
            )
        });
        assert!(due.is_some_and(|s| (40.0..47.0).contains(&s)), "{due:?}");
    }

    #[test]
    fn time_in_which_nobody_watches_does_not_count() {
        let mut progress = GoalProgress::new(10.0);
        let goal = Point::new(1.0, 2.0, 3.0);
        let mut is_blocked =
            |s: f64| progress.step(Timestamp::from_seconds(50.0 + s), &goal, &HERE, Some(3.0), 0.0);
        for second in 0..8 {
            assert!(!is_blocked(f64::from(second)));
        }
        assert!(!is_blocked(300.0));
        let due = (301..400).find(|second| is_blocked(f64::from(*second)));
        assert!(due.is_some_and(|second| (302..305).contains(&second)), "{due:?}");
    }

    #[test]
    fn whoever_comes_to_new_places_is_not_stalled_and_out_of_reach_all_the_same() {
        let goal = Point::new(100.0, 0.0, 0.0);
        let mut progress = GoalProgress::new(10.0);
        let due = (0..4000).map(|i| f64::from(i) * 0.1).find(|s| {
            let now = Timestamp::from_seconds(50.0 + s);
            progress.explore(now, &Point::new(0.9 * s, 0.0, 0.0));
            assert!(!progress.is_stalled(now));
            progress.step(now, &goal, &HERE, Some(30.0), 0.0)
        });
        assert!(due.is_some_and(|s| (9.0..12.0).contains(&s)), "{due:?}");
    }

    #[test]
    fn what_is_out_of_reach_stays_so_when_a_path_seems_shorter_by_a_little() {
        let goal = Point::new(100.0, 0.0, 0.0);
        let mut progress = GoalProgress::new(10.0);
        for s in (0..400).map(|i| f64::from(i) * 0.1) {
            let now = Timestamp::from_seconds(50.0 + s);
            let remaining_m = if s < 15.0 { 30.0 } else { 29.0 - 0.1 * s };
            progress.step(now, &goal, &HERE, Some(remaining_m), 0.0);
            if (s - 10.0).abs() > 0.5 {
                assert_eq!(progress.is_blocked(), s > 10.0, "{s}");
            }
        }
        progress.resume(Timestamp::from_seconds(90.0));
        assert!(!progress.is_blocked());
    }

    #[test]
    fn time_that_does_not_count_is_no_progress() {
        let goal = Point::new(100.0, 0.0, 0.0);
        let mut progress = GoalProgress::new(10.0);
        let due = (0..1000).map(|i| f64::from(i) * 0.1).find(|s| {
            let now = Timestamp::from_seconds(50.0 + s);
            // Three seconds out of four something is evaded.
            if (*s as i32) % 4 != 0 {
                progress.pause(now);
            }
            progress.step(now, &goal, &HERE, Some(30.0), 0.0)
        });
        assert!(due.is_some_and(|s| (35.0..45.0).contains(&s)), "{due:?}");
    }

    #[test]
    fn a_search_is_reported_with_its_time_at_most_every_half_minute() {
        let goal = Point::new(100.0, 0.0, 0.0);
        let mut progress = GoalProgress::new(60.0);
        let mut reported = Vec::new();
        for s in (0..2000).map(|i| f64::from(i) * 0.1) {
            let now = Timestamp::from_seconds(50.0 + s);
            // Nearer for five seconds; then not, on a detour of 30 m.
            let remaining_m = if s < 5.0 { 40.0 - s } else { 65.0 };
            if progress.step(now, &goal, &HERE, Some(remaining_m), 1.5) {
                break;
            }
            if let Some(searched_s) = progress.search_to_report_s(now) {
                reported.push((s.round(), searched_s.round()));
            }
        }
        assert_eq!(reported, [(15.0, 10.0), (45.0, 40.0), (75.0, 70.0)]);
    }

    proptest! {
        /// Whatever a search pretends and wherever it leads, a goal has an end.
        #[test]
        fn every_goal_has_an_end_whatever_the_search_finds_and_wherever_the_vehicle_flies(
            remaining in proptest::collection::vec((5.0..60.0f64, 0.3..3.0f64, 0.0..2.0f64), 1000),
        ) {
            let goal = Point::new(30.0, 0.0, 0.0);
            let mut progress = GoalProgress::new(10.0);
            let mut way_m = 0.0;
            let mut is_out_of_reach = false;
            for (i, (remaining_m, speed_mps, step_m)) in remaining.into_iter().enumerate() {
                let now = Timestamp::from_seconds(50.0 + i as f64);
                // Round and round, always nearer by a little more than counts.
                way_m += step_m;
                let place = Point::new(way_m.cos(), way_m.sin(), 0.0);
                progress.explore(now, &place);
                let falls_m = 60.0 - 0.03 * i as f64;
                let remaining_m = if i % 20 == 0 { falls_m } else { remaining_m.max(falls_m) };
                is_out_of_reach |= progress.step(now, &goal, &place, Some(remaining_m), speed_mps);
                prop_assert!(is_out_of_reach || way_m < 270.0 && i < 300, "{} m", way_m);
            }
            prop_assert!(is_out_of_reach);
        }
    }

    #[test]
    fn a_vehicle_is_stalled_some_time_after_its_last_progress() {
        let mut progress = GoalProgress::new(12.0);
        let goal = Point::new(1.0, 2.0, 3.0);
        let at = |s: f64| Timestamp::from_seconds(50.0 + s);
        assert!(!progress.is_stalled(at(0.0)));
        for i in 0..100 {
            let s = 0.1 * f64::from(i);
            // Nearer for four seconds, which is noticed every half metre, then not.
            progress.step(at(s), &goal, &HERE, Some(20.0 - s.min(4.0)), 0.0);
            let is_stalled = progress.is_stalled(at(s));
            assert!(if is_stalled { s > 6.4 } else { s < 7.1 }, "{s}");
        }
    }

    #[test]
    fn another_goal_begins_anew() {
        let mut progress = GoalProgress::new(10.0);
        for i in 0..1000 {
            let goal = Point::new(f64::from(i / 50), 0.0, 0.0);
            let now = Timestamp::from_seconds(50.0 + 0.1 * f64::from(i));
            assert!(!progress.step(now, &goal, &HERE, Some(5.0), 0.0));
        }
    }
}
