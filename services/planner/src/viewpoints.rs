//! Viewpoints: where the path leads through space that was never seen, the vehicle turns, or moves within known space,
//! so that it sees the path.
//!
//! | in | out |
//! |---|---|
//! | the path through unknown space, the field of view, the inflated map | a reachable place and a heading there, from which most of what is missing comes into view |
//!
//! Every viewpoint is tried once in 20 s: what does not come into view from there will not do so at a second try.

use crate::configuration_space::ConfigurationSpace;
use crate::search::{Path, ReachableCell};
use jink_shared_types::Timestamp;
use jink_shared_types::frames::wrap_pi;
use jink_shared_types::map::{Cell, center_of};
use jink_shared_types::view::FieldOfView;
use nalgebra::{Rotation3, Vector3};
use std::collections::VecDeque;

/// How far a viewpoint may be (m, along the flown path): beyond, it would be a path of its own.
pub const REACH_M: f32 = 5.0;
/// Cells of the path that are to be seen, from the first that is not known on: three metres of it, half of that on half
/// cells.
const PATH_CELLS: usize = 15;
/// Most unknown cells that are to be seen: more would not change which viewpoint is best.
const MISSING_MAX: usize = 48;
/// Most candidates, nearest first.
const CANDIDATES_MAX: usize = 400;
/// At least this share of the missing cells has to come into view for a viewpoint to be used.
const GAIN_MIN: f64 = 0.1;
/// A metre of path, and a radian of turning, costs this share of the missing cells.
const COST_PER_METRE: f64 = 0.06;
const COST_PER_RADIAN: f64 = 0.04;
/// A viewpoint this near (m) to an earlier one with nearly the same heading (rad) shows nothing new.
const SAME_PLACE_M: f64 = 0.5;
const SAME_HEADING_RAD: f64 = 0.35;
/// After this time a viewpoint may be tried again (s): what hid the path may have moved, and noise has settled.
const RETRY_AFTER_S: f64 = 20.0;
/// Viewpoints are counted over this time (s): two with half a turn each take longer than the period above.
const COUNTED_S: f64 = 60.0;
/// At a viewpoint the vehicle waits for the frames from there (s).
pub const DWELL_S: f64 = 0.7;
/// Viewpoints that are stored.
const HISTORY: usize = 32;

/// A place and a heading to see from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The place.
    pub cell: Cell,
    /// The heading there (rad).
    pub yaw_rad: f64,
}

/// Earlier viewpoints and the one in progress.
#[derive(Debug)]
pub struct Viewpoints {
    tried: Vec<(Viewpoint, Timestamp)>,
    next: usize,
    /// The route that leads to the last viewpoint, and since when.
    in_progress: Option<(u64, Timestamp)>,
    /// When the last viewpoints, and the turns toward the paths to them, were started.
    started_recently: VecDeque<Timestamp>,
    missing: Vec<Vector3<f64>>,
    /// Reachable cells, nearest first.
    pub places: Vec<ReachableCell>,
}

impl Default for Viewpoints {
    fn default() -> Self {
        Self {
            tried: Vec::with_capacity(HISTORY),
            next: 0,
            in_progress: None,
            started_recently: VecDeque::with_capacity(HISTORY),
            missing: Vec::with_capacity(8_192),
            places: Vec::with_capacity(8_192),
        }
    }
}

impl Viewpoints {
    /// Clears the history: there is a new goal, or the path continues.
    pub fn reset(&mut self) {
        self.tried.clear();
        self.next = 0;
        self.in_progress = None;
    }

    /// The route to a viewpoint, and when it departs.
    pub fn in_progress(&self) -> Option<(u64, Timestamp)> {
        self.in_progress
    }

    /// Records that route `route_id` leads to `viewpoint` from `time` on.
    pub fn record(&mut self, viewpoint: Viewpoint, route_id: u64, time: Timestamp) {
        self.record_turn(route_id, time);
        if self.tried.len() < HISTORY {
            self.tried.push((viewpoint, time));
        } else {
            self.tried[self.next] = (viewpoint, time);
            self.next = (self.next + 1) % HISTORY;
        }
    }

    /// Records that the vehicle turns toward the path to a viewpoint by route `route_id` from `time` on.
    pub fn record_turn(&mut self, route_id: u64, time: Timestamp) {
        self.in_progress = Some((route_id, time));
        if self.started_recently.len() == HISTORY {
            self.started_recently.pop_front();
        }
        self.started_recently.push_back(time);
    }

    /// How many viewpoints, and turns toward the paths to them, were started in the last minute before `time`.
    pub fn started_recently(&self, time: Timestamp) -> usize {
        let is_recent = |when: &&Timestamp| time.seconds_since(**when).abs() < COUNTED_S;
        self.started_recently.iter().filter(is_recent).count()
    }

    fn was_tried(&self, viewpoint: &Viewpoint, time: Timestamp) -> bool {
        self.tried.iter().any(|(old, when)| {
            let away_m = (center_of(old.cell).vector() - center_of(viewpoint.cell).vector()).norm();
            time.seconds_since(*when).abs() < RETRY_AFTER_S
                && away_m < SAME_PLACE_M
                && wrap_pi(old.yaw_rad - viewpoint.yaw_rad).abs() < SAME_HEADING_RAD
        })
    }

    /// Collects what is missing along `path`: the unknown cells that keep its first unsafe part from being safe in its
    /// speed tier. `false` if nothing is.
    pub fn collect_missing(&mut self, space: &ConfigurationSpace, path: &Path) -> bool {
        let tier = path.tier;
        self.missing.clear();
        let is_safe = |step: &&[Cell]| touched(step[0], step[1]).all(|cell| space.is_safe(tier, cell));
        let unsafe_part = path.cells.windows(2).skip_while(is_safe).take(PATH_CELLS);
        for step in unsafe_part.step_by(2) {
            let is_unsafe = |cell: &Cell| !space.is_safe(tier, *cell);
            let mut cells = std::iter::once(step[1]).chain(touched(step[0], step[1]));
            let Some(cell) = cells.find(is_unsafe) else {
                continue;
            };
            let unknown = space
                .cells_within(tier, cell)
                .filter(|cell| space.is_unknown(*cell));
            let clearance = self.missing.capacity() - self.missing.len();
            self.missing
                .extend(unknown.map(|cell| center_of(cell).vector()).take(clearance));
        }
        let step = self.missing.len().div_ceil(MISSING_MAX).max(1);
        let mut index = 0;
        self.missing.retain(|_| {
            index += 1;
            (index - 1) % step == 0
        });
        !self.missing.is_empty()
    }

    /// The best viewpoint of [`Viewpoints::places`], which are cells of `tier`, for a vehicle at `start` with heading
    /// `yaw_rad` and the field of view `view`; `None` if nothing that is missing comes into view from any of them.
    pub fn best(
        &self,
        space: &ConfigurationSpace,
        tier: usize,
        view: &FieldOfView,
        start: Cell,
        yaw_rad: f64,
        time: Timestamp,
    ) -> Option<Viewpoint> {
        let is_all_around = view.is_all_around();
        let middle = self.missing.iter().sum::<Vector3<f64>>() / self.missing.len().max(1) as f64;
        let mut best: Option<(f64, Viewpoint)> = None;
        for place in self.places.iter().take(CANDIDATES_MAX) {
            let from = space.center_of(tier, place.cell);
            let toward = middle - from;
            let viewpoint = Viewpoint {
                cell: place.cell,
                yaw_rad: if is_all_around || toward.xy().norm() < 0.5 {
                    yaw_rad
                } else {
                    toward.y.atan2(toward.x)
                },
            };
            let turn_rad = wrap_pi(viewpoint.yaw_rad - yaw_rad).abs();
            let is_here = place.cell == start && turn_rad < SAME_HEADING_RAD;
            if is_here || self.was_tried(&viewpoint, time) {
                continue;
            }
            let cost = COST_PER_METRE * f64::from(place.path_m) + COST_PER_RADIAN * turn_rad;
            if best.is_some_and(|(gain, _)| 1.0 - cost <= gain) {
                continue;
            }
            let seen = self.share_seen(space, view, &from, viewpoint.yaw_rad);
            let gain = seen - cost;
            if seen >= GAIN_MIN && best.is_none_or(|(max, _)| gain > max) {
                best = Some((gain, viewpoint));
            }
        }
        best.map(|(_, viewpoint)| viewpoint)
    }

    /// The share of the missing cells that comes into view from `from` with heading `yaw_rad`.
    fn share_seen(
        &self,
        space: &ConfigurationSpace,
        view: &FieldOfView,
        from: &Vector3<f64>,
        yaw_rad: f64,
    ) -> f64 {
        let body_r_local = Rotation3::from_axis_angle(&Vector3::z_axis(), -yaw_rad);
        let seen = self.missing.iter().filter(|cell| {
            view.covers(&(body_r_local * (*cell - from)))
                && space
                    .first_cell(from, cell, ConfigurationSpace::is_occupied)
                    .is_none()
        });
        seen.count() as f64 / self.missing.len().max(1) as f64
    }
}

/// The cells that a step from `a` to its neighbour `b` touches.
fn touched(a: Cell, b: Cell) -> impl Iterator<Item = Cell> {
    let ends = move |axis: usize| a[axis].min(b[axis])..=a[axis].max(b[axis]);
    ends(2).flat_map(move |z| ends(1).flat_map(move |y| ends(0).map(move |x| [x, y, z])))
}

#[cfg(test)]
mod tests {
    use super::{HISTORY, Viewpoint, Viewpoints};
    use crate::configuration_space::tests::{known_map, space_of};
    use crate::search::{Path, ReachableCell};
    use crate::speed_tiers::SLOW_TIER;
    use jink_shared_types::Timestamp;
    use jink_shared_types::map::{Cell, LocalMap, clear, set};
    use jink_shared_types::view::FieldOfView;
    use nalgebra::Vector3;

    /// A field of view of `aside_deg` to either side and from `low_deg` to `high_deg`.
    fn view(aside_deg: i32, low_deg: i32, high_deg: i32) -> FieldOfView {
        let mut view = FieldOfView {
            near_m: 0.1,
            far_m: 12.0,
            ..FieldOfView::default()
        };
        for aside in -aside_deg..aside_deg {
            for up in low_deg..high_deg {
                let [aside, up] = [aside, up].map(|deg| (f64::from(deg) + 0.5).to_radians());
                view.add(&Vector3::new(
                    up.cos() * aside.cos(),
                    up.cos() * aside.sin(),
                    -up.sin(),
                ));
            }
        }
        view
    }

    #[test]
    fn turns_toward_a_viewpoint_count_as_viewpoints_for_a_minute() {
        let at = |s: f64| Timestamp::from_seconds(100.0 + s);
        let mut viewpoints = Viewpoints::default();
        viewpoints.record_turn(1, at(0.0));
        let viewpoint = Viewpoint {
            cell: [0, 0, 0],
            yaw_rad: 1.0,
        };
        viewpoints.record(viewpoint, 2, at(10.0));
        assert_eq!(viewpoints.started_recently(at(11.0)), 2);
        // Longer than a viewpoint is kept from being tried again.
        assert_eq!(viewpoints.started_recently(at(45.0)), 2);
        assert_eq!(viewpoints.started_recently(at(65.0)), 1);
        for n in 0..100 {
            viewpoints.record_turn(n, at(100.0));
        }
        assert_eq!(viewpoints.started_recently(at(100.0)), HISTORY);
    }

    fn unknown_where(map: &mut LocalMap, unknown: impl Fn(Cell) -> bool) {
        for x in -64..64 {
            for y in -64..64 {
                for z in -32..32 {
                    if unknown([x, y, z]) {
                        clear(&mut map.known, [x, y, z]);
                    }
                }
            }
        }
        set(&mut map.known, [0, 0, 0]);
    }

    fn path_of(cells: Vec<Cell>) -> Path {
        Path {
            tier: SLOW_TIER,
            cells,
        }
    }

    fn viewpoints_at(places: &[Cell]) -> Viewpoints {
        let mut viewpoints = Viewpoints::default();
        viewpoints.places.extend(places.iter().map(|cell| ReachableCell {
            cell: *cell,
            path_m: cell.iter().map(|axis| axis.abs() as f32 * 0.2).sum(),
        }));
        viewpoints
    }

    #[test]
    fn what_is_beside_a_forward_camera_is_turned_to() {
        let mut map = known_map(|_| false);
        unknown_where(&mut map, |cell| cell[1] > 8);
        let space = space_of(&map);
        let mut viewpoints = viewpoints_at(&[[0, 0, 0]]);
        let cells: Vec<Cell> = (0..30).map(|y| [0, y, 0]).collect();
        assert!(viewpoints.collect_missing(&space, &path_of(cells)));
        let viewpoint = viewpoints.best(
            &space,
            SLOW_TIER,
            &view(43, -29, 29),
            [0, 0, 0],
            0.0,
            Timestamp::from_seconds(1.0),
        );
        let viewpoint = viewpoint.unwrap();
        assert!(
            (viewpoint.yaw_rad - std::f64::consts::FRAC_PI_2).abs() < 0.1,
            "{viewpoint:?}"
        );
        viewpoints.record(viewpoint, 1, Timestamp::from_seconds(1.0));
        let again = viewpoints.best(
            &space,
            SLOW_TIER,
            &view(43, -29, 29),
            [0, 0, 0],
            0.0,
            Timestamp::from_seconds(5.0),
        );
        assert_eq!(again, None, "it was looked at already");
    }

    #[test]
    fn what_is_below_a_lidar_that_looks_up_is_gone_down_for() {
        let mut map = known_map(|_| false);
        unknown_where(&mut map, |cell| cell[0] > 6 && cell[2] > 1);
        let space = space_of(&map);
        let mut viewpoints = viewpoints_at(&[[0, 0, 0], [0, 6, 0], [-6, 0, 0], [0, 0, 5], [0, 0, -5]]);
        let cells: Vec<Cell> = (0..30).map(|x| [x, 0, 0]).collect();
        assert!(viewpoints.collect_missing(&space, &path_of(cells)));
        let viewpoint = viewpoints.best(
            &space,
            SLOW_TIER,
            &view(180, -5, 50),
            [0, 0, 0],
            0.3,
            Timestamp::from_seconds(1.0),
        );
        let viewpoint = viewpoint.unwrap();
        assert_eq!(viewpoint.cell, [0, 0, 5], "five cells down");
        assert!(
            (viewpoint.yaw_rad - 0.3).abs() < 1e-9,
            "it sees all around: there is no need to turn"
        );
    }

    #[test]
    fn nothing_is_looked_for_behind_a_wall() {
        let mut map = known_map(|p| (p.x - 2.0).abs() < 0.2);
        unknown_where(&mut map, |cell| cell[0] > 12);
        let space = space_of(&map);
        let mut viewpoints = viewpoints_at(&[[0, 0, 0], [0, 0, 5], [-6, 0, 0]]);
        let cells: Vec<Cell> = (13..30).map(|x| [x, 0, 0]).collect();
        assert!(viewpoints.collect_missing(&space, &path_of(cells)));
        let viewpoint = viewpoints.best(
            &space,
            SLOW_TIER,
            &view(180, -45, 45),
            [0, 0, 0],
            0.0,
            Timestamp::from_seconds(1.0),
        );
        assert_eq!(viewpoint, None);
    }
}
