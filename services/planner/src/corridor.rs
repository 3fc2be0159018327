//! Convex pieces of certified space around a guide.
//!
//! Around a segment that is known to be safe, every unsafe cell in the neighbourhood is cut off by the plane through
//! its point nearest to the segment, at right angles to the line between the two: nearest cells first, and each plane
//! takes all cells behind it along (S. Liu et al., "Planning Dynamically Feasible Trajectories for Quadrotors Using
//! Safe Flight Corridors in 3-D Complex Environments", RA-L 2017, section III, with the segment itself as seed instead
//! of an ellipsoid). The segment stays inside by construction: both are convex, so the plane separates them.

use crate::configuration_space::ConfigurationSpace;
use jink_shared_types::map::SIZE_X;
use jink_shared_types::motion::{HalfSpace, POLYTOPE_PLANES, Polytope};
use nalgebra::Vector3;

/// How far a polytope may reach to the side of its segment (m), first try.
const REACH_M: f64 = 2.0;
/// The same upwards and downwards (m): level flight needs less.
const REACH_VERTICAL_M: f64 = 1.0;
/// Tries with half the reach each, if the half-spaces do not suffice.
const TRIES: u32 = 4;
/// Taken off every plane (m), so that rounding never touches an unsafe cell.
const INSET_M: f64 = 1e-3;

/// Nearer than this a segment and a cell touch (m).
const TOUCHING_M: f64 = 1e-6;

/// Reusable memory of the corridor builder.
#[derive(Debug)]
pub struct CorridorBuilder {
    cells: Vec<(f64, Vector3<f64>)>,
}

impl Default for CorridorBuilder {
    fn default() -> Self {
        Self {
            cells: Vec::with_capacity(32_768),
        }
    }
}

impl CorridorBuilder {
    /// The polytope around the segment from `a` to `b` in `tier`, between the heights `down_range_m` (smallest and
    /// largest down coordinate). `None` if the segment itself touches an unsafe cell.
    pub fn polytope(
        &mut self,
        space: &ConfigurationSpace,
        tier: usize,
        a: &Vector3<f64>,
        b: &Vector3<f64>,
        down_range_m: (f64, f64),
    ) -> Option<Polytope> {
        let mut reach = 1.0;
        for _ in 0..TRIES {
            let size = Vector3::new(REACH_M, REACH_M, REACH_VERTICAL_M) * reach;
            let mut low = a.inf(b) - size;
            let mut high = a.sup(b) + size;
            low.z = low.z.max(down_range_m.0.min(a.z.min(b.z)));
            high.z = high.z.min(down_range_m.1.max(a.z.max(b.z)));
            self.collect(space, tier, &low, &high, a, b);
            let mut polytope = box_of(&low, &high);
            match self.cut(space.cell_m(tier), a, b, &mut polytope) {
                CutResult::Done => return Some(polytope),
                CutResult::TouchesSegment => return None,
                CutResult::TooManyPlanes => reach *= 0.5,
            }
        }
        None
    }

    /// Gathers the unsafe cells in the box that border on safe ones, with their distance from the segment.
    fn collect(
        &mut self,
        space: &ConfigurationSpace,
        tier: usize,
        low: &Vector3<f64>,
        high: &Vector3<f64>,
        a: &Vector3<f64>,
        b: &Vector3<f64>,
    ) {
        self.cells.clear();
        let first = space.cell_of(tier, low).map(|cell| cell - 1);
        let last = space.cell_of(tier, high).map(|cell| cell + 1);
        let min_x = space.min_cell(tier)[0];
        let unsafe_row = |y: i32, z: i32| {
            let cell = [first[0], y, z];
            // Rows outside the window are unknown as a whole.
            if space.holds(tier, [min_x, y, z]) {
                space.blocked(tier).row_at(cell)
            } else {
                u128::MAX
            }
        };
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                let row = unsafe_row(y, z);
                let inner = row.rotate_left(1)
                    & row.rotate_right(1)
                    & unsafe_row(y - 1, z)
                    & unsafe_row(y + 1, z)
                    & unsafe_row(y, z - 1)
                    & unsafe_row(y, z + 1);
                let border = row & !inner;
                for x in first[0]..=last[0] {
                    let inside = (x - min_x) as usize & !(SIZE_X - 1) == 0;
                    let bit = x as usize & (SIZE_X - 1);
                    if inside && border >> bit & 1 == 1 {
                        let center = space.center_of(tier, [x, y, z]);
                        let distance_m2 = (center - nearest_on_segment(a, b, &center)).norm_squared();
                        self.cells.push((distance_m2, center));
                    }
                }
            }
        }
    }

    /// Cuts off the cells, whose edge is `cell_m`, from `polytope`, the box in which they were collected.
    fn cut(&mut self, cell_m: f64, a: &Vector3<f64>, b: &Vector3<f64>, polytope: &mut Polytope) -> CutResult {
        while let Some(nearest) = self
            .cells
            .iter()
            .copied()
            .reduce(|best, cell| if cell.0 < best.0 { cell } else { best })
        {
            let Some(plane) = separate(cell_m, a, b, &nearest.1) else {
                return CutResult::TouchesSegment;
            };
            if polytope.len as usize >= POLYTOPE_PLANES {
                return CutResult::TooManyPlanes;
            }
            polytope.push(plane);
            let normal = Vector3::from(plane.normal);
            let half_width_m = 0.5 * cell_m * normal.iter().map(|n| n.abs()).sum::<f64>();
            self.cells
                .retain(|(_, center)| normal.dot(center) - half_width_m < plane.offset_m - 2.0 * TOUCHING_M);
        }
        CutResult::Done
    }
}

enum CutResult {
    Done,
    TouchesSegment,
    TooManyPlanes,
}

fn box_of(low: &Vector3<f64>, high: &Vector3<f64>) -> Polytope {
    let mut polytope = Polytope::default();
    for axis in 0..3 {
        let mut normal = [0.0; 3];
        normal[axis] = 1.0;
        polytope.push(HalfSpace {
            normal,
            offset_m: high[axis],
        });
        normal[axis] = -1.0;
        polytope.push(HalfSpace {
            normal,
            offset_m: -low[axis],
        });
    }
    polytope
}

/// The point of the segment nearest to `point`.
fn nearest_on_segment(a: &Vector3<f64>, b: &Vector3<f64>, point: &Vector3<f64>) -> Vector3<f64> {
    let way = b - a;
    let length2 = way.norm_squared();
    if length2 < 1e-12 {
        return *a;
    }
    a + way * ((point - a).dot(&way) / length2).clamp(0.0, 1.0)
}

/// The half-space that holds the segment and leaves out the cell of edge `cell_m` around `center`, through the cell's
/// point nearest to the segment. `None` if the segment enters the cell.
///
/// The nearest pair is found by alternating projections onto the two convex sets (von Neumann; Cheney and Goldstein
/// 1959), which converges for a box and a segment in a few rounds.
fn separate(cell_m: f64, a: &Vector3<f64>, b: &Vector3<f64>, center: &Vector3<f64>) -> Option<HalfSpace> {
    let half = Vector3::repeat(0.5 * cell_m);
    let (low, high) = (center - half, center + half);
    let mut on_segment = nearest_on_segment(a, b, center);
    let mut on_cell = *center;
    for _ in 0..40 {
        on_cell = on_segment.sup(&low).inf(&high);
        let next = nearest_on_segment(a, b, &on_cell);
        let moved = (next - on_segment).norm_squared();
        on_segment = next;
        if moved < 1e-18 {
            break;
        }
    }
    let between = on_cell - on_segment;
    let gap_m = between.norm();
    if gap_m < TOUCHING_M {
        return separate_touching(cell_m, a, b, center);
    }
    let normal = between / gap_m;
    // Alternating projections stop slightly before the nearest pair: the plane is moved until it clears the whole cell.
    let half_width_m = 0.5 * cell_m * normal.iter().map(|n| n.abs()).sum::<f64>();
    let cell_side_m = normal.dot(center) - half_width_m;
    let segment_side_m = normal.dot(a).max(normal.dot(b));
    let inset_m = INSET_M.min(0.5 * (cell_side_m - segment_side_m));
    (inset_m > 0.0).then(|| HalfSpace {
        normal: normal.into(),
        offset_m: cell_side_m - inset_m,
    })
}

/// The same for a segment that touches the cell without entering it: it runs along a face, as one does that starts on
/// the border between two cells, or past an edge or a corner, as the diagonals between centres do. The plane is that of
/// a face, or one through the segment that faces the cell.
fn separate_touching(
    cell_m: f64,
    a: &Vector3<f64>,
    b: &Vector3<f64>,
    center: &Vector3<f64>,
) -> Option<HalfSpace> {
    let way = b - a;
    let along = way / way.norm().max(TOUCHING_M);
    let signs = || [-1.0, 0.0, 1.0].into_iter();
    let directions =
        signs().flat_map(|x| signs().flat_map(move |y| signs().map(move |z| Vector3::new(x, y, z))));
    let faces = directions
        .clone()
        .filter(|direction| direction.norm_squared() == 1.0);
    let beside =
        directions.filter_map(|direction| (direction - along * direction.dot(&along)).try_normalize(0.1));
    faces.chain(beside).find_map(|normal| {
        let half_width_m = 0.5 * cell_m * normal.iter().map(|n| n.abs()).sum::<f64>();
        let offset_m = normal.dot(center) - half_width_m;
        let segment_side_m = normal.dot(a).max(normal.dot(b));
        // The segment lies inside by the distance that it may be from the cell.
        (segment_side_m < offset_m + TOUCHING_M).then(|| HalfSpace {
            normal: normal.into(),
            offset_m: offset_m + TOUCHING_M,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::CorridorBuilder;
    use crate::configuration_space::tests::{known_map, space_of};
    use jink_shared_types::map::center_of;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    const HEIGHTS: (f64, f64) = (-6.0, 6.0);

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn a_polytope_holds_its_segment_and_no_unsafe_point(
            trees in proptest::collection::vec((-6.0..6.0f64, -6.0..6.0f64), 1..8),
            a in (-4.0..4.0f64, -4.0..4.0f64), b in (-4.0..4.0f64, -4.0..4.0f64),
            samples in proptest::collection::vec((-7.0..7.0f64, -7.0..7.0f64, -1.5..1.5f64), 400),
        ) {
            let map = known_map(|p| trees.iter().any(|(x, y)| (p.x - x).hypot(p.y - y) < 0.3));
            let space = space_of(&map);
            let (a, b) = (Vector3::new(a.0, a.1, 0.05), Vector3::new(b.0, b.1, 0.05));
            prop_assume!(space.segment_is_safe(1, &a, &b));
            let polytope = CorridorBuilder::default().polytope(&space, 1, &a, &b, HEIGHTS);
            prop_assert!(polytope.is_some());
            let polytope = polytope.unwrap();
            prop_assert!(polytope.depth_m(&a) > 0.0 && polytope.depth_m(&b) > 0.0);
            for (x, y, z) in samples {
                let point = Vector3::new(x, y, z);
                if polytope.depth_m(&point) >= 0.0 {
                    prop_assert!(space.is_safe_at(1, &point), "{point}");
                }
            }
        }
    }

    #[test]
    fn a_segment_through_an_obstacle_has_no_polytope() {
        let space = space_of(&known_map(|p| p.xy().norm() < 0.3));
        let (a, b) = (Vector3::new(-4.0, 0.1, 0.1), Vector3::new(4.0, 0.1, 0.1));
        assert!(
            CorridorBuilder::default()
                .polytope(&space, 1, &a, &b, HEIGHTS)
                .is_none()
        );
    }

    #[test]
    fn a_diagonal_past_the_corner_of_an_unsafe_cell_has_a_polytope() {
        // One side of the diagonal is unsafe up to the corners.
        let space = space_of(&known_map(|p| p.x - p.y > 1.5));
        let unsafe_from = (-20..20).find(|x| !space.is_safe(1, [*x, 0, 0])).unwrap();
        let first = center_of([unsafe_from - 1, 0, 0]).vector();
        for steps in 1..8 {
            let last = first + Vector3::new(1.0, 1.0, 0.0) * (f64::from(steps) * 0.2);
            for (a, b) in [(first, last), (last, first)] {
                let polytope = CorridorBuilder::default().polytope(&space, 1, &a, &b, HEIGHTS);
                let polytope = polytope.unwrap();
                assert!(polytope.depth_m(&a) > 0.0 && polytope.depth_m(&b) > 0.0);
                let unsafe_side = center_of([unsafe_from + 1, 1, 0]).vector();
                assert!(polytope.depth_m(&unsafe_side) < 0.0);
            }
        }
    }

    #[test]
    fn a_segment_on_the_border_of_an_unsafe_cell_still_has_a_polytope() {
        let space = space_of(&known_map(|p| (p.y - 1.3).abs() < 0.1));
        let unsafe_from = (-20..20).find(|y| !space.is_safe(1, [0, *y, 0])).unwrap();
        let border_m = f64::from(unsafe_from) * 0.2;
        let (a, b) = (Vector3::new(0.0, border_m, 0.1), Vector3::new(2.0, border_m, 0.1));
        let polytope = CorridorBuilder::default()
            .polytope(&space, 1, &a, &b, HEIGHTS)
            .unwrap();
        assert!(polytope.depth_m(&a) > 0.0);
        assert!(polytope.depth_m(&Vector3::new(1.0, border_m + 0.01, 0.1)) < 0.0);
    }
}
