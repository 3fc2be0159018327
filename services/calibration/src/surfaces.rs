//! Small planes in a cloud, and the nearest of them.

use super::points::{Points, cube_of};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use std::collections::BTreeMap;

/// Planes are looked for in cubes of this edge (m) ...
const CUBE_M: f64 = 0.3;
/// ... among points up to this far from the mean of a cube (m), or this share of their range: the rows of a lidar are 2 degrees apart.
const NEAR_M: f64 = 0.3;
const NEAR_RATIO: f64 = 0.05;
/// No more than two cubes away (m), whatever the range.
const NEAR_MAX_M: f64 = 2.0 * CUBE_M;
/// Points of which a plane is made at least.
const POINTS_MIN: usize = 8;
/// A neighbourhood is a plane if its variance across is below this share of the middle one: across an edge it is tilted ...
const FLAT: f64 = 0.1;
/// ... and no line: the middle one is above this share of the largest.
const WIDE: f64 = 0.03;

/// A small plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    /// Mean of its points (body, m).
    pub center: Point3<f64>,
    /// Unit normal, toward the sensor.
    pub normal: Vector3<f64>,
    /// Variance of the normal's direction (rad^2).
    pub normal_variance: f64,
    /// Points in the cube itself.
    pub weight: f64,
}

/// The small planes of a cloud, as a k-d tree over their centers.
#[derive(Clone, Debug, Default)]
pub struct Surfaces {
    /// In the order of the tree: the middle of a range splits it.
    pub(super) all: Vec<Surface>,
}

impl Surfaces {
    /// Those of `points`.
    pub fn of(points: &Points) -> Self {
        let mut cubes: BTreeMap<[i32; 3], Vec<Point3<f64>>> = BTreeMap::new();
        for point in points.iter() {
            cubes.entry(cube_of(point, CUBE_M)).or_default().push(*point);
        }
        let mut near = Vec::new();
        let mut all: Vec<Surface> = cubes
            .iter()
            .filter_map(|(cube, inside)| {
                let mean = mean_of(inside);
                let range_m = (mean - points.origin()).norm();
                let near_m = (NEAR_RATIO * range_m).clamp(NEAR_M, NEAR_MAX_M);
                neighbourhood(&cubes, *cube, &mean, near_m, &mut near);
                plane(&near, inside.len() as f64, &points.origin())
            })
            .collect();
        sort(&mut all, 0);
        Self { all }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// The nearest one to `point` no farther than `limit_m` that `fits`.
    pub(super) fn nearest(
        &self,
        point: &Point3<f64>,
        limit_m: f64,
        fits: impl Fn(&Surface) -> bool,
    ) -> Option<&Surface> {
        let mut best = (limit_m * limit_m, None);
        let mut open = vec![(0, self.all.len(), 0, 0.0)];
        while let Some((from, to, axis, away_m2)) = open.pop() {
            if from >= to || away_m2 > best.0 {
                continue;
            }
            let middle = usize::midpoint(from, to);
            let surface = &self.all[middle];
            let distance_m2 = (surface.center - point).norm_squared();
            if distance_m2 < best.0 && fits(surface) {
                best = (distance_m2, Some(surface));
            }
            let across_m = point[axis] - surface.center[axis];
            let next = (axis + 1) % 3;
            let (low, high) = ((from, middle), (middle + 1, to));
            let (this, other) = if across_m < 0.0 { (low, high) } else { (high, low) };
            open.push((other.0, other.1, next, across_m * across_m));
            open.push((this.0, this.1, next, away_m2));
        }
        best.1
    }
}

/// Orders `surfaces` as a tree that splits along `axis` first.
fn sort(surfaces: &mut [Surface], axis: usize) {
    if surfaces.len() < 2 {
        return;
    }
    let middle = surfaces.len() / 2;
    surfaces.select_nth_unstable_by(middle, |a, b| a.center[axis].total_cmp(&b.center[axis]));
    let (low, high) = surfaces.split_at_mut(middle);
    sort(low, (axis + 1) % 3);
    sort(&mut high[1..], (axis + 1) % 3);
}

fn mean_of(points: &[Point3<f64>]) -> Point3<f64> {
    let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
    Point3::from(sum / points.len().max(1) as f64)
}

/// The points in and around `cube` that are within `near_m` of `mean`.
fn neighbourhood(
    cubes: &BTreeMap<[i32; 3], Vec<Point3<f64>>>,
    cube: [i32; 3],
    mean: &Point3<f64>,
    near_m: f64,
    into: &mut Vec<Point3<f64>>,
) {
    into.clear();
    let reach = (near_m / CUBE_M).ceil() as i32;
    for x in -reach..=reach {
        for y in -reach..=reach {
            // Cubes that differ in their last index only are neighbours in the tree, too.
            let row = [cube[0] + x, cube[1] + y];
            let from = [row[0], row[1], cube[2] - reach];
            let to = [row[0], row[1], cube[2] + reach];
            for points in cubes.range(from..=to).map(|(_, points)| points) {
                let is_near = |point: &&Point3<f64>| (*point - mean).norm_squared() <= near_m * near_m;
                into.extend(points.iter().filter(is_near));
            }
        }
    }
}

fn plane(points: &[Point3<f64>], weight: f64, origin: &Point3<f64>) -> Option<Surface> {
    if points.len() < POINTS_MIN {
        return None;
    }
    let count = points.len() as f64;
    let center = mean_of(points);
    let spread = points.iter().map(|point| point - center);
    let covariance: Matrix3<f64> = spread.map(|off| off * off.transpose()).sum::<Matrix3<f64>>() / count;
    let (variances, axes) = ordered(covariance);
    let [across, middle, along] = variances;
    if across > FLAT * middle || middle < WIDE * along {
        return None;
    }
    let normal = axes[0];
    let toward = origin - center;
    Some(Surface {
        center,
        normal: if normal.dot(&toward) < 0.0 {
            -normal
        } else {
            normal
        },
        normal_variance: across / (count * middle),
        weight,
    })
}

/// Eigenvalues from the smallest to the largest, and their vectors.
pub(super) fn ordered(symmetric: Matrix3<f64>) -> ([f64; 3], [Vector3<f64>; 3]) {
    let eigen = SymmetricEigen::new(symmetric);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    (
        order.map(|index| eigen.eigenvalues[index]),
        order.map(|index| eigen.eigenvectors.column(index).into_owned()),
    )
}

#[cfg(test)]
mod tests {
    use super::{Surface, Surfaces, sort};
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_plane_is_that_of_a_search_through_all(
            centers in proptest::collection::vec(proptest::array::uniform3(-5.0..5.0f64), 1..200),
            place in proptest::array::uniform3(-6.0..6.0f64), limit_m in 0.1..4.0f64,
        ) {
            let mut all: Vec<Surface> = centers
                .iter()
                .map(|center| Surface {
                    center: Point3::from(*center),
                    normal: Vector3::z(),
                    normal_variance: 0.0,
                    weight: 1.0,
                })
                .collect();
            sort(&mut all, 0);
            let surfaces = Surfaces { all };
            let place = Point3::from(place);
            let fits = |surface: &Surface| surface.center.x > -2.0;
            let found = surfaces.nearest(&place, limit_m, fits).map(|one| (one.center - place).norm());
            let expected = surfaces
                .all
                .iter()
                .filter(|one| fits(one))
                .map(|one| (one.center - place).norm())
                .filter(|distance_m| *distance_m < limit_m)
                .min_by(f64::total_cmp);
            prop_assert_eq!(found, expected);
        }
    }
}
