//! From a chain of cells to a short guide of straight legs, all of it known to be safe.

use crate::configuration_space::ConfigurationSpace;
use crate::search::Path;
use jink_shared_types::motion::CORRIDOR_POLYTOPES;
use nalgebra::Vector3;

/// Longest leg (m): each leg becomes one polynomial piece, and a long one cannot follow the speed profile.
const LEG_MAX_M: f64 = 3.0;
/// A path at a requested speed may be short and have a moving start: two pieces cannot follow that, four can. No leg is
/// made shorter than this for it (m).
const LEGS_MIN: f64 = 4.0;
const LEG_MIN_M: f64 = 0.7;
/// A point of a proposed path that is nearer than this to the straight line between its neighbours is left out (m):
/// each leg of a corridor has a polytope, and there are few of them.
const STRAIGHT_M: f64 = 0.25;
/// A motion turns within the first leg of its path if that changes its velocity by less than this (m/s), and at once if it has no
/// more than this ahead (m).
const LEAD_IN_MPS: f64 = 1.0;
const LEAD_IN_MIN_M: f64 = 0.5;
/// Where a straight beginning is not safe, or no path leads on from its end, one shorter by this factor is tried: seven in all from 6 m.
const LEAD_IN_SHORTER: f64 = 0.7;
/// Legs shorter than this are rounding errors (m).
const NEGLIGIBLE_M: f64 = 1e-3;

/// How long a guide may be, what it needs at its end, and the motion at its start.
#[derive(Clone, Copy, Debug)]
pub struct GuideLength {
    /// The longest (m).
    pub max_m: f64,
    /// What stays safe behind its end (m), which the vehicle runs past the end of a stop; a guide that ends where its path
    /// does needs none, because the stop there is gentle.
    pub margin_m: f64,
    /// The length (m) in which a gentle stop is possible.
    pub stop_m: f64,
    /// The velocity at its start (local NED, m/s).
    pub velocity: Vector3<f64>,
    /// The acceleration (m/s2) that a turn may take.
    pub acceleration_mps2: f64,
    /// The jerk (m/s3) that a turn may take.
    pub jerk_mps3: f64,
}

/// The straight legs of a path, first vertex = its start.
#[derive(Clone, Debug)]
pub struct Guide {
    vertices: Vec<Vector3<f64>>,
    points: Vec<Vector3<f64>>,
    has_margin: bool,
}

impl Default for Guide {
    fn default() -> Self {
        Self {
            vertices: Vec::with_capacity(64),
            points: Vec::with_capacity(4096),
            has_margin: false,
        }
    }
}

impl Guide {
    /// The vertices.
    pub fn vertices(&self) -> &[Vector3<f64>] {
        &self.vertices
    }

    /// Whether its path is safe behind its end, for the margin that was asked for.
    pub fn has_margin(&self) -> bool {
        self.has_margin
    }

    /// Total length (m).
    pub fn length_m(&self) -> f64 {
        length_m(&self.vertices)
    }

    /// Builds the guide from `start` along `path` (the first cell holds `start`) as far as it is safe in `tier`, and the
    /// margin of `length` short of where it stops being safe. `goal` replaces the last cell's centre if the path ends in
    /// its cell. Returns whether the goal itself is the end.
    pub fn build(
        &mut self,
        space: &ConfigurationSpace,
        tier: usize,
        start: &Vector3<f64>,
        path: &Path,
        goal: Option<&Vector3<f64>>,
        length: &GuideLength,
    ) -> bool {
        let reaches_end = self.safe_points(space, tier, start, path, goal);
        let whole_m = length_m(&self.points);
        let at_goal = goal.is_some() && reaches_end && (length.stop_m..=length.max_m).contains(&whole_m);
        let wanted_m = (whole_m - length.margin_m).min(length.max_m);
        self.has_margin = !at_goal;
        if !at_goal {
            cut_to(&mut self.points, wanted_m);
        }
        self.pull_taut(space, tier);
        self.lead_in(space, tier, length);
        self.split_long_legs(LEG_MAX_M);
        at_goal && self.vertices.len() <= CORRIDOR_POLYTOPES + 1 || {
            self.vertices.truncate(CORRIDOR_POLYTOPES + 1);
            false
        }
    }

    /// Builds the guide as [`Self::build`] does, but from cell to cell and only as far as a corridor has polytopes for that: a
    /// straight leg past the corners of unsafe cells may be safe and have no polytope, a step between two cells has one.
    pub fn build_in_steps(
        &mut self,
        space: &ConfigurationSpace,
        tier: usize,
        start: &Vector3<f64>,
        path: &Path,
        goal: Option<&Vector3<f64>>,
        margin_m: f64,
    ) -> bool {
        let reaches_end = self.safe_points(space, tier, start, path, goal);
        let at_goal = goal.is_some() && reaches_end && self.points.len() <= CORRIDOR_POLYTOPES + 1;
        self.has_margin = !reaches_end;
        if !reaches_end {
            let wanted_m = length_m(&self.points) - margin_m;
            cut_to(&mut self.points, wanted_m);
        }
        self.vertices.clear();
        self.vertices
            .extend(self.points.iter().take(CORRIDOR_POLYTOPES + 1));
        at_goal
    }

    /// Builds the guide along the points of `way`, as [`Self::build`] does along cells, without shortcuts. Returns
    /// whether its end is the end of `way`.
    pub fn follow(
        &mut self,
        space: &ConfigurationSpace,
        tier: usize,
        way: &[Vector3<f64>],
        length_max_m: f64,
        margin_m: f64,
    ) -> bool {
        let is_safe = self.safe_part(space, tier, way);
        let whole_m = length_m(&self.points);
        let at_end = is_safe && whole_m <= length_max_m;
        self.has_margin = !at_end;
        if !at_end {
            // A proposed path that is longer than a guide may not be safe beyond its end either.
            let safe_m = if is_safe { whole_m } else { whole_m - margin_m };
            cut_to(&mut self.points, safe_m.min(length_max_m));
        }
        self.straighten(space, tier);
        let leg_max_m = length_m(&self.vertices) / LEGS_MIN;
        self.split_long_legs(leg_max_m.clamp(LEG_MIN_M, LEG_MAX_M));
        let fits = self.vertices.len() <= CORRIDOR_POLYTOPES + 1;
        self.vertices.truncate(CORRIDOR_POLYTOPES + 1);
        at_end && fits
    }

    /// The part of `way` that is safe from its start on; `true` if all of it is.
    fn safe_part(&mut self, space: &ConfigurationSpace, tier: usize, way: &[Vector3<f64>]) -> bool {
        self.points.clear();
        self.points.extend(way.first());
        for leg in way.windows(2) {
            let end = space.first_in(tier, &leg[0], &leg[1], |space, cell| !space.is_safe(tier, cell));
            if let Some(t) = end {
                self.points.push(leg[0] + (leg[1] - leg[0]) * t);
                return false;
            }
            self.points.push(leg[1]);
        }
        true
    }

    /// Leaves out the points that hardly bend the path.
    fn straighten(&mut self, space: &ConfigurationSpace, tier: usize) {
        self.vertices.clear();
        self.vertices.extend(self.points.first());
        let mut anchor = 0;
        while anchor + 1 < self.points.len() {
            let mut far = anchor + 1;
            for candidate in anchor + 2..self.points.len() {
                let (a, b) = (self.points[anchor], self.points[candidate]);
                let between = &self.points[anchor + 1..candidate];
                let is_straight = between.iter().all(|point| is_beside(&a, &b, point));
                if !is_straight || !space.segment_is_safe(tier, &a, &b) {
                    break;
                }
                far = candidate;
            }
            self.vertices.push(self.points[far]);
            anchor = far;
        }
    }

    /// The path as points, cut where it stops being safe; `true` if all of it is.
    fn safe_points(
        &mut self,
        space: &ConfigurationSpace,
        tier: usize,
        start: &Vector3<f64>,
        path: &Path,
        goal: Option<&Vector3<f64>>,
    ) -> bool {
        self.points.clear();
        self.points.push(*start);
        let mut last = *start;
        for (index, cell) in path.cells.iter().enumerate().skip(1) {
            let at_end = index + 1 == path.cells.len();
            let center = space.center_of(path.tier, *cell);
            let next = match goal {
                Some(goal) if at_end => *goal,
                _ => center,
            };
            if !space.segment_is_safe(tier, &last, &next) {
                // Steps from cell to cell are safe from centre to centre; start and goal lie anywhere in theirs.
                let between = if index == 1 {
                    space.center_of(path.tier, path.cells[0])
                } else {
                    center
                };
                let is_way = space.segment_is_safe(tier, &last, &between)
                    && space.segment_is_safe(tier, &between, &next);
                if !is_way {
                    return false;
                }
                self.points.push(between);
            }
            self.points.push(next);
            last = next;
        }
        if let (Some(goal), 1) = (goal, path.cells.len()) {
            if !space.segment_is_safe(tier, &last, goal) {
                return false;
            }
            self.points.push(*goal);
        }
        true
    }

    /// Replaces chains of points by the longest straight legs that stay safe.
    fn pull_taut(&mut self, space: &ConfigurationSpace, tier: usize) {
        self.vertices.clear();
        let Some(first) = self.points.first() else {
            return;
        };
        self.vertices.push(*first);
        let mut anchor = 0;
        while anchor + 1 < self.points.len() {
            let mut far = anchor + 1;
            for candidate in anchor + 2..self.points.len() {
                if space.segment_is_safe(tier, &self.points[anchor], &self.points[candidate]) {
                    far = candidate;
                } else {
                    break;
                }
            }
            self.vertices.push(self.points[far]);
            anchor = far;
        }
    }

    /// Puts a straight leg along the present velocity in front, as long as the turn into the path takes: shorter where that is not safe
    /// or has no safe way to the path, none where even the shortest has not.
    fn lead_in(&mut self, space: &ConfigurationSpace, tier: usize, length: &GuideLength) {
        let speed_mps = length.velocity.norm();
        let [first, second, ..] = self.vertices[..] else {
            return;
        };
        let change_mps = 2.0 * speed_mps * (0.5 * length.velocity.angle(&(second - first))).sin();
        if change_mps.is_nan() || change_mps < LEAD_IN_MPS {
            return;
        }
        let turn_s = change_mps / length.acceleration_mps2 + length.acceleration_mps2 / length.jerk_mps3;
        let mut ahead_m = 0.5 * speed_mps * turn_s;
        while ahead_m > LEAD_IN_MIN_M {
            let ahead = first + length.velocity * (ahead_m / speed_mps);
            ahead_m *= LEAD_IN_SHORTER;
            if !space.segment_is_safe(tier, &first, &ahead) {
                continue;
            }
            let joins = |point: &Vector3<f64>| space.segment_is_safe(tier, &ahead, point);
            let Some(next) = self.points.iter().rposition(joins).filter(|next| *next > 0) else {
                continue;
            };
            // From where it joins the path on, that is pulled taut as before.
            self.points.drain(..next);
            self.pull_taut(space, tier);
            self.vertices.splice(..0, [first, ahead]);
            return;
        }
    }

    fn split_long_legs(&mut self, leg_max_m: f64) {
        self.points.clear();
        self.points.extend_from_slice(&self.vertices);
        self.vertices.clear();
        for (index, point) in self.points.iter().enumerate() {
            if let Some(last) = self.vertices.last().copied() {
                let leg = point - last;
                if leg.norm() < NEGLIGIBLE_M && index + 1 < self.points.len() {
                    continue;
                }
                let parts = (leg.norm() / leg_max_m).ceil().max(1.0) as usize;
                for part in 1..parts {
                    self.vertices.push(last + leg * (part as f64 / parts as f64));
                }
            }
            self.vertices.push(*point);
        }
    }
}

/// Whether `point` lies beside the segment from `a` to `b`, and near.
fn is_beside(a: &Vector3<f64>, b: &Vector3<f64>, point: &Vector3<f64>) -> bool {
    let way = b - a;
    let t = (point - a).dot(&way) / way.norm_squared().max(1e-12);
    (0.0..=1.0).contains(&t) && (a + way * t - point).norm() < STRAIGHT_M
}

fn length_m(points: &[Vector3<f64>]) -> f64 {
    points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
}

/// Cuts a chain of points after `length_m`.
fn cut_to(points: &mut Vec<Vector3<f64>>, length_m: f64) {
    let mut remaining_m = length_m.max(0.0);
    for index in 1..points.len() {
        let leg = points[index] - points[index - 1];
        if leg.norm() >= remaining_m {
            points[index] = points[index - 1] + leg * (remaining_m / leg.norm().max(1e-9));
            points.truncate(index + 1);
            return;
        }
        remaining_m -= leg.norm();
    }
}

#[cfg(test)]
mod tests {
    use super::{Guide, GuideLength};
    use crate::configuration_space::tests::{known_map, space_of};
    use crate::corridor::CorridorBuilder;
    use crate::search::{Search, SearchQuery};
    use jink_shared_types::map::{center_of, clear};
    use nalgebra::Vector3;

    const LENGTH: GuideLength = GuideLength {
        max_m: 20.0,
        margin_m: 0.5,
        stop_m: 0.0,
        velocity: Vector3::new(0.0, 0.0, 0.0),
        acceleration_mps2: 1.0,
        jerk_mps3: 2.0,
    };

    #[test]
    fn a_guide_is_safe_taut_and_stops_short_of_the_unknown() {
        let map = {
            let mut map = known_map(|p| (p.x - 4.0).hypot(p.y) < 0.5);
            for row in 0..map.known.len() {
                // Unknown beyond x = 8 m (cell 40 on).
                let known = u128::from(map.known[row][0]) | u128::from(map.known[row][1]) << 64;
                let mut mask = 0u128;
                for x in -64..40i32 {
                    mask |= 1 << (x as usize & 127);
                }
                let known = known & mask;
                map.known[row] = [known as u64, (known >> 64) as u64];
            }
            map
        };
        let space = space_of(&map);
        let mut search = Search::default();
        let query = SearchQuery {
            tier: 1,
            start: [0, 0, 0],
            goal: [60, 0, 0],
            z_range: (-5, 5),
            height_cost: 0.5,
        };
        search.run(&space, &query).unwrap();
        let mut guide = Guide::default();
        let start = center_of([0, 0, 0]).vector();
        let at_goal = guide.build(&space, 1, &start, search.path(), None, &LENGTH);
        assert!(!at_goal);
        let vertices = guide.vertices();
        assert!((2..9).contains(&vertices.len()), "{vertices:?}");
        for pair in vertices.windows(2) {
            assert!(space.segment_is_safe(1, &pair[0], &pair[1]));
        }
        let end = vertices.last().unwrap();
        assert!(end.x > 5.5 && end.x < 7.3, "{end}");
    }

    #[test]
    fn every_step_of_a_guide_from_cell_to_cell_has_a_polytope() {
        // Posts on a grid: the path winds between them, past corners of unsafe cells.
        let map = known_map(|p| {
            let off = |m: f64, pitch: f64| (m / pitch - (m / pitch).round()).abs() * pitch;
            p.x > 0.8 && off(p.x, 1.7).hypot(off(p.y + 0.35 * p.x, 1.9)) < 0.15
        });
        let space = space_of(&map);
        let mut search = Search::default();
        let query = SearchQuery {
            tier: 2,
            start: [0, 0, 0],
            goal: [30, 2, 0],
            z_range: (-1, 1),
            height_cost: 0.5,
        };
        search.run(&space, &query).unwrap();
        let mut guide = Guide::default();
        let start = center_of([0, 0, 0]).vector() + Vector3::new(0.03, -0.05, 0.02);
        let at_goal = guide.build_in_steps(&space, 2, &start, search.path(), None, 0.1);
        assert!(!at_goal);
        let vertices = guide.vertices();
        assert!(vertices.len() > 4 && vertices[0] == start, "{vertices:?}");
        let mut corridor = CorridorBuilder::default();
        for pair in vertices.windows(2) {
            let polytope = corridor.polytope(&space, 2, &pair[0], &pair[1], (-1.0, 1.0));
            assert!(polytope.is_some(), "{pair:?}");
        }
    }

    #[test]
    fn a_path_along_the_edge_of_the_unknown_does_not_cut_its_corners() {
        // The diagonal is safe, the cells to its one side are not.
        let space_beside = |is_left: bool, aside: i32| {
            let mut map = known_map(|_| false);
            for x in -64..64 {
                for y in -64..64 {
                    let is_beyond = if is_left { y > x + aside } else { x > y + aside };
                    for z in (-32..32).filter(|_| is_beyond) {
                        clear(&mut map.known, [x, y, z]);
                    }
                }
            }
            space_of(&map)
        };
        for is_left in [false, true] {
            let mut spaces = (0..40).map(|aside| space_beside(is_left, aside));
            let space = spaces.find(|space| space.is_safe(1, [0, 0, 0]));
            let space = space.unwrap();
            assert_eq!(space.is_safe(1, [7, 8, 0]), !is_left);
            let mut search = Search::default();
            let query = SearchQuery {
                tier: 1,
                start: [0, 0, 0],
                goal: [15, 15, 0],
                z_range: (-5, 5),
                height_cost: 0.5,
            };
            search.run(&space, &query).unwrap();
            let [start, goal] = [query.start, query.goal].map(|cell| center_of(cell).vector());
            let mut guide = Guide::default();
            assert!(
                guide.build(&space, 1, &start, search.path(), Some(&goal), &LENGTH),
                "left: {is_left}"
            );
        }
    }

    #[test]
    fn a_near_goal_is_reached_exactly() {
        let space = space_of(&known_map(|_| false));
        let mut search = Search::default();
        let goal = Vector3::new(1.03, 0.51, 0.07);
        let query = SearchQuery {
            tier: 0,
            start: [0, 0, 0],
            goal: [5, 2, 0],
            z_range: (-5, 5),
            height_cost: 0.5,
        };
        search.run(&space, &query).unwrap();
        let mut guide = Guide::default();
        let start = Vector3::new(0.1, 0.1, 0.1);
        assert!(guide.build(&space, 0, &start, search.path(), Some(&goal), &LENGTH));
        assert_eq!(*guide.vertices().last().unwrap(), goal);
    }

    #[test]
    fn a_guide_that_is_begun_at_speed_leads_straight_on_as_far_as_the_turn_needs_and_is_safe() {
        // A wall across; the path leads along it.
        for (speed_mps, wall_m, is_led) in [
            (0.0, 20.0, false),
            (6.0, 20.0, true),
            (6.0, 4.0, true),
            (6.0, 1.2, false),
        ] {
            let space = space_of(&known_map(|p| p.x > wall_m));
            let mut search = Search::default();
            let query = SearchQuery {
                tier: 1,
                start: [0, 0, 0],
                goal: [2, 40, 0],
                z_range: (-5, 5),
                height_cost: 0.5,
            };
            search.run(&space, &query).unwrap();
            let start = center_of([0, 0, 0]).vector();
            let length = GuideLength {
                velocity: Vector3::new(speed_mps, 0.0, 0.0),
                acceleration_mps2: 3.9,
                jerk_mps3: 9.4,
                ..LENGTH
            };
            let mut guide = Guide::default();
            guide.build(&space, 1, &start, search.path(), None, &length);
            let vertices = guide.vertices();
            let first = vertices[1] - vertices[0];
            assert_eq!(
                first.x > 0.5 && first.y.abs() < 1e-9,
                is_led,
                "{speed_mps} {wall_m} {vertices:?}"
            );
            for pair in vertices.windows(2) {
                assert!(space.segment_is_safe(1, &pair[0], &pair[1]), "{pair:?}");
            }
            assert!(vertices.last().unwrap().y > 6.0, "{vertices:?}");
        }
    }
}
