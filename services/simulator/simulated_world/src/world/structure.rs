//! Surfaces that have no formula: the cells of an OctoMap, the triangles of a mesh. Rays through cells are ours ([`CellBlock`]), the
//! nearest surface and rays through meshes are found by the crate `bvh`.
//!
//! Files have x, y, z with z up; where x points to the north y points to the west.

use super::cells::CellBlock;
use super::octomap::Octomap;
use super::solids::{Contact, YawedBox};
use super::stl::Triangle;
use bvh::aabb::{Aabb, Bounded};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::Bvh;
use bvh::point_query::PointDistance;
use bvh::ray::Ray;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeSet;
use std::sync::Arc;

/// The corridor of a real building (worlds/README.md).
pub(super) const BUILDING: &[u8] = include_bytes!("../../worlds/building_geb079.bt");

/// Width of the line that stands for a surface in a picture (m).
const LINE_M: f64 = 0.02;
/// Most lines of a structure in a picture.
const LINES_MAX: usize = 4_000;

#[derive(Debug)]
enum Shape {
    /// Solid cells: for distances, for rays, and to be drawn.
    Cells {
        tree: Tree<Cell>,
        block: CellBlock,
        map: Octomap,
    },
    /// Surfaces without an inside.
    Mesh { tree: Tree<Triangle> },
}

/// Where the file's origin lies in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Placement {
    /// North of the local origin (m).
    pub north_m: f64,
    /// East of it (m).
    pub east_m: f64,
    /// Above the ground (m).
    pub up_m: f64,
    /// Direction of the file's x axis, clockwise from north (rad).
    pub yaw_rad: f64,
}

/// One structure; clones share it.
#[derive(Clone, Debug)]
pub struct Structure {
    shape: Arc<Shape>,
    place: Placement,
}

impl Structure {
    /// The occupied cells of a map; those below the ground of the world are left out.
    pub fn cells(mut map: Octomap, place: Placement) -> Self {
        let cell_m = map.cell_m;
        // What reaches above the ground by less than a hair is its floor.
        map.occupied
            .retain(|cell| f64::from(cell[2] + 1) * cell_m + place.up_m > 1e-6);
        let cell = |cell: &[i32; 3]| Cell {
            low: cell.map(|index| f64::from(index) * cell_m).into(),
            size_m: cell_m,
        };
        Self {
            shape: Arc::new(Shape::Cells {
                tree: Tree::new(map.occupied.iter().map(cell)),
                block: CellBlock::new(cell_m, &map.occupied),
                map,
            }),
            place,
        }
    }

    /// The triangles of a mesh; the text says why they are none.
    pub fn mesh(triangles: Vec<Triangle>, place: Placement) -> Result<Self, String> {
        if triangles.is_empty() {
            return Err("the mesh has no triangles".to_owned());
        }
        Ok(Self {
            shape: Arc::new(Shape::Mesh {
                tree: Tree::new(triangles),
            }),
            place,
        })
    }

    /// Signed distance from `point` (local NED) to the surface (m), negative inside a cell; a mesh has no inside.
    pub fn distance_m(&self, point: &Vector3<f64>) -> f64 {
        let at = self.point_in_file(point);
        match &*self.shape {
            Shape::Cells { tree, .. } => tree.nearest(at).map_or(f64::INFINITY, |(cell, distance_m)| {
                distance_m - cell.depth_m(&at).max(0.0)
            }),
            Shape::Mesh { tree } => tree
                .nearest(at)
                .map_or(f64::INFINITY, |(_, distance_m)| distance_m),
        }
    }

    /// Where the ray from `origin` along the unit vector `direction` (both local NED) first meets it within `range_m`.
    pub fn meets(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, range_m: f64) -> Option<Contact> {
        let (from, along) = (self.point_in_file(origin), self.direction_in_file(direction));
        match &*self.shape {
            Shape::Cells { block, .. } => block.meets(from.into(), along.into(), range_m),
            Shape::Mesh { tree } => tree.first_met(&Ray::new(from, along), range_m),
        }
    }

    /// What it looks like from above at `height_m` above ground: thin boxes, for pictures.
    pub fn outline(&self, height_m: f64) -> Vec<YawedBox> {
        let level_m = height_m - self.place.up_m;
        let lines = match &*self.shape {
            Shape::Cells { map, .. } => self.rows_of(map, (level_m / map.cell_m).floor() as i32),
            Shape::Mesh { tree } => {
                let cuts = tree.parts.iter().filter_map(|part| cut(&part.shape, level_m));
                cuts.map(|[a, b]| self.line(a, b, LINE_M)).collect()
            }
        };
        let step = lines.len().div_ceil(LINES_MAX).max(1);
        lines.into_iter().step_by(step).collect()
    }

    /// The cells of one layer, joined along x.
    fn rows_of(&self, map: &Octomap, layer: i32) -> Vec<YawedBox> {
        let cells: BTreeSet<(i32, i32)> = map
            .occupied
            .iter()
            .filter(|cell| cell[2] == layer)
            .map(|cell| (cell[1], cell[0]))
            .collect();
        let mut lines: Vec<(i32, i32, i32)> = Vec::new();
        for (y, x) in cells {
            match lines.last_mut() {
                Some((row, _, end)) if (*row, *end) == (y, x) => *end = x + 1,
                _ => lines.push((y, x, x + 1)),
            }
        }
        let size_m = map.cell_m;
        let at = |cells: i32| f64::from(cells) * size_m;
        let line = |(y, from, to): (i32, i32, i32)| {
            let middle_m = at(y) + 0.5 * size_m;
            self.line([at(from), middle_m], [at(to), middle_m], size_m)
        };
        lines.into_iter().map(line).collect()
    }

    /// A box along the line between two places in the file's x and y.
    fn line(&self, a: [f64; 2], b: [f64; 2], width_m: f64) -> YawedBox {
        let [a, b] = [a, b].map(|[x, y]| self.point_in_world(x, y));
        let along = b - a;
        let middle = (a + b) * 0.5;
        let yaw_rad = along.y.atan2(along.x);
        YawedBox::new(
            middle.x,
            middle.y,
            along.norm(),
            width_m,
            yaw_rad,
            self.place.up_m + width_m,
        )
    }

    fn point_in_world(&self, x: f64, y: f64) -> Vector3<f64> {
        let (sin, cos) = self.place.yaw_rad.sin_cos();
        // y points to the left of x.
        let north_m = self.place.north_m + x * cos + y * sin;
        let east_m = self.place.east_m + x * sin - y * cos;
        Vector3::new(north_m, east_m, 0.0)
    }

    fn point_in_file(&self, point: &Vector3<f64>) -> Point3<f64> {
        let place = &self.place;
        self.direction_in_file(&(point - Vector3::new(place.north_m, place.east_m, -place.up_m)))
            .into()
    }

    fn direction_in_file(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        let (sin, cos) = self.place.yaw_rad.sin_cos();
        Vector3::new(
            direction.x * cos + direction.y * sin,
            direction.x * sin - direction.y * cos,
            -direction.z,
        )
    }
}

/// Parts of a surface, found by place.
#[derive(Debug)]
struct Tree<S> {
    bvh: Bvh<f64, 3>,
    parts: Vec<Part<S>>,
}

/// One part of a surface, with the place in the tree that `bvh` gives it.
#[derive(Debug)]
struct Part<S> {
    shape: S,
    node: usize,
}

/// What parts of surfaces are.
trait Surface {
    fn bounds(&self) -> Aabb<f64, 3>;
    fn nearest(&self, point: &Point3<f64>) -> Point3<f64>;
}

impl<S: Surface> Tree<S> {
    fn new(shapes: impl IntoIterator<Item = S>) -> Self {
        let mut parts: Vec<Part<S>> = shapes.into_iter().map(|shape| Part { shape, node: 0 }).collect();
        Self {
            bvh: Bvh::build(&mut parts),
            parts,
        }
    }

    /// The part that is nearest to `point`, and how far away it is (m).
    fn nearest(&self, point: Point3<f64>) -> Option<(&S, f64)> {
        let (part, distance_m) = self.bvh.nearest_to(point, &self.parts)?;
        Some((&part.shape, distance_m))
    }
}

impl Tree<Triangle> {
    /// Where a ray first meets a triangle from either side within `range_m`.
    fn first_met(&self, ray: &Ray<f64, 3>, range_m: f64) -> Option<Contact> {
        let candidates = self.bvh.traverse_iterator(ray, &self.parts);
        let hits = candidates.map(|part| {
            let [a, b, c] = part.shape.map(Point3::from);
            let (front, back) = (
                ray.intersects_triangle(&a, &b, &c),
                ray.intersects_triangle(&a, &c, &b),
            );
            (front.distance.min(back.distance), (b - a).cross(&(c - a)))
        });
        let (range_m, normal) = hits
            .filter(|(hit_m, _)| *hit_m <= range_m)
            .min_by(|one, other| one.0.total_cmp(&other.0))?;
        Some(Contact {
            range_m,
            incidence_cos: normal.normalize().dot(&ray.direction).abs().min(1.0),
        })
    }
}

impl<S: Surface> Bounded<f64, 3> for Part<S> {
    fn aabb(&self) -> Aabb<f64, 3> {
        // A hair thicker than it is: a ray along the plane of a flat part would not meet it.
        let (bounds, hair) = (self.shape.bounds(), Vector3::repeat(1e-9));
        Aabb::with_bounds(bounds.min - hair, bounds.max + hair)
    }
}

impl<S: Surface> PointDistance<f64, 3> for Part<S> {
    fn distance_squared(&self, point: Point3<f64>) -> f64 {
        (self.shape.nearest(&point) - point).norm_squared()
    }
}

impl<S: Surface> BHShape<f64, 3> for Part<S> {
    fn set_bh_node_index(&mut self, node: usize) {
        self.node = node;
    }
    fn bh_node_index(&self) -> usize {
        self.node
    }
}

/// An occupied cell.
#[derive(Debug)]
struct Cell {
    low: Point3<f64>,
    size_m: f64,
}

impl Cell {
    fn high(&self) -> Point3<f64> {
        self.low + Vector3::repeat(self.size_m)
    }

    /// How deep `point` lies inside (m), negative outside.
    fn depth_m(&self, point: &Point3<f64>) -> f64 {
        (point - self.low).inf(&(self.high() - point)).min()
    }
}

impl Surface for Cell {
    fn bounds(&self) -> Aabb<f64, 3> {
        Aabb::with_bounds(self.low, self.high())
    }

    fn nearest(&self, point: &Point3<f64>) -> Point3<f64> {
        point.sup(&self.low).inf(&self.high())
    }
}

impl Surface for Triangle {
    fn bounds(&self) -> Aabb<f64, 3> {
        let [a, b, c] = self.map(Point3::from);
        Aabb::with_bounds(a.inf(&b).inf(&c), a.sup(&b).sup(&c))
    }

    /// C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5: the region of the triangle that `point` lies over.
    fn nearest(&self, point: &Point3<f64>) -> Point3<f64> {
        let [a, b, c] = self.map(Point3::from);
        let (ab, ac) = (b - a, c - a);
        let [(ab_a, ac_a), (ab_b, ac_b), (ab_c, ac_c)] =
            [a, b, c].map(|corner| (ab.dot(&(point - corner)), ac.dot(&(point - corner))));
        if ab_a <= 0.0 && ac_a <= 0.0 {
            return a;
        }
        if ab_b >= 0.0 && ac_b <= ab_b {
            return b;
        }
        if ac_c >= 0.0 && ab_c <= ac_c {
            return c;
        }
        let over_ab = ab_a * ac_b - ab_b * ac_a;
        if over_ab <= 0.0 && ab_a >= 0.0 && ab_b <= 0.0 {
            return a + ab * (ab_a / (ab_a - ab_b));
        }
        let over_ac = ab_c * ac_a - ab_a * ac_c;
        if over_ac <= 0.0 && ac_a >= 0.0 && ac_c <= 0.0 {
            return a + ac * (ac_a / (ac_a - ac_c));
        }
        let over_bc = ab_b * ac_c - ab_c * ac_b;
        if over_bc <= 0.0 && ac_b >= ab_b && ab_c >= ac_c {
            return b + (c - b) * ((ac_b - ab_b) / ((ac_b - ab_b) + (ab_c - ac_c)));
        }
        let sum = over_ab + over_ac + over_bc;
        a + ab * (over_ac / sum) + ac * (over_ab / sum)
    }
}

/// Where a triangle crosses the level `z`: two places, x and y.
fn cut(triangle: &Triangle, z: f64) -> Option<[[f64; 2]; 2]> {
    let edges = [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (triangle[a], triangle[b]));
    let mut crossings = edges.iter().filter_map(|(a, b)| {
        let (above, below) = (a[2] - z, b[2] - z);
        let share = above / (above - below);
        ((above < 0.0) != (below < 0.0)).then(|| [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis])))
    });
    Some([crossings.next()?, crossings.next()?])
}

#[cfg(test)]
mod tests {
    use super::{Placement, Structure};
    use crate::world::octomap::Octomap;
    use crate::world::solids::{Obstacle, YawedBox};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    /// A block of 2 x 1 x 1 cells of half a metre that touches the origin of its file: x 0..1, y 0..0.5, z 0..0.5.
    fn block() -> Octomap {
        Octomap {
            cell_m: 0.5,
            occupied: vec![[0, 0, 0], [1, 0, 0]],
        }
    }

    /// The same as triangles of its two long sides.
    fn sides() -> Vec<[[f64; 3]; 3]> {
        let side = |y: f64| {
            let corner = |x: f64, z: f64| [x, y, z];
            [
                [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 0.5)],
                [corner(0.0, 0.0), corner(1.0, 0.5), corner(0.0, 0.5)],
            ]
        };
        [side(0.0), side(0.5)].concat()
    }

    const PLACE: Placement = Placement {
        north_m: 10.0,
        east_m: -4.0,
        up_m: 1.0,
        yaw_rad: 0.7,
    };

    proptest! {
        #[test]
        fn cells_are_met_and_kept_away_from_like_the_box_that_they_are(
            north in -2.0..2.0f64, east in -2.0..2.0f64, down in -2.0..2.0f64,
            aside in -3.1..3.1f64, up in -1.5..1.5f64,
        ) {
            let cells = Structure::cells(block(), PLACE);
            // The middle of the block: half a metre along x, a quarter to the left.
            let middle = cells.point_in_world(0.5, 0.25);
            let like = Obstacle::Box(YawedBox::new(middle.x, middle.y, 1.0, 0.5, PLACE.yaw_rad, 1.5).raised(1.0));
            let point = middle + Vector3::new(north, east, down - 1.25);
            prop_assert!((cells.distance_m(&point) - like.distance_m(&point)).abs() < 0.251, "inside only to the next cell");
            if like.distance_m(&point) > 0.0 {
                prop_assert!((cells.distance_m(&point) - like.distance_m(&point)).abs() < 1e-9);
                let direction = Vector3::new(up.cos() * aside.cos(), up.cos() * aside.sin(), -up.sin());
                let (one, other) = (cells.meets(&point, &direction, 20.0), like.meets(&point, &direction));
                prop_assert_eq!(one.is_some(), other.is_some());
                if let (Some(one), Some(other)) = (one, other) {
                    prop_assert!((one.range_m - other.range_m).abs() < 1e-9);
                    prop_assert!((one.incidence_cos - other.incidence_cos).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn a_mesh_is_met_on_either_side_and_drawn_where_it_is_cut() {
        let mesh = Structure::mesh(
            sides(),
            Placement {
                yaw_rad: 0.0,
                ..PLACE
            },
        )
        .unwrap();
        // y points to the west: the sides lie at east -4 and -4.5.
        let from = Vector3::new(10.5, -2.0, -1.25);
        let west = Vector3::new(0.0, -1.0, 0.0);
        let hit = mesh.meets(&from, &west, 10.0).unwrap();
        assert!((hit.range_m - 2.0).abs() < 1e-9 && (hit.incidence_cos - 1.0).abs() < 1e-9);
        assert!(mesh.meets(&from, &west, 1.9).is_none());
        let between = Vector3::new(10.5, -4.2, -1.25);
        assert!((mesh.meets(&between, &west, 10.0).unwrap().range_m - 0.3).abs() < 1e-9);
        assert!((mesh.distance_m(&between) - 0.2).abs() < 1e-9);
        assert!(!mesh.outline(1.25).is_empty() && mesh.outline(2.0).is_empty());
    }

    #[test]
    fn what_lies_below_the_ground_is_no_obstacle() {
        let sunk = Structure::cells(block(), Placement { up_m: -0.5, ..PLACE });
        let above = Vector3::new(10.0, -4.0, -3.0);
        assert!(sunk.meets(&above, &Vector3::new(0.0, 0.0, 1.0), 10.0).is_none());
    }
}
