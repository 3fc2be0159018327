//! The solids a world is made of: the exact distance to each, and where a ray first meets it.
//!
//! | solid | stands |
//! |---|---|
//! | [`Cylinder`] | upright, from below the ground to its top |
//! | [`YawedBox`] | turned about the vertical only, between two heights |
//! | [`Sphere`] | anywhere |
//!
//! Vectors are local NED (down positive), sizes and heights are in metres with heights up. Distances are signed,
//! negative inside. Source of the formulas: C. Ericson, "Real-Time Collision Detection", sections 5.1 and 5.3.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A direction component below this is parallel to the plane in question; its crossing lies past any range.
const PARALLEL: f64 = 1e-12;

/// Where a ray meets one solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Distance along the ray (m), 0 if the ray starts inside.
    pub range_m: f64,
    /// Cosine of the angle between ray and surface normal, 0 (grazing) to 1 (head-on, or starts inside).
    pub incidence_cos: f64,
}

/// A ray that starts inside a solid meets it at once.
const INSIDE: Contact = Contact {
    range_m: 0.0,
    incidence_cos: 1.0,
};

/// An upright cylinder (a tree, a pillar). It goes on below the ground, so its foot is no surface.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Cylinder {
    /// Axis, north (m).
    pub north_m: f64,
    /// Axis, east (m).
    pub east_m: f64,
    /// Radius (m).
    pub radius_m: f64,
    /// Height of the top above ground (m).
    pub top_m: f64,
}

impl Cylinder {
    fn distance_m(&self, point: &Vector3<f64>) -> f64 {
        let beside_m = (point.x - self.north_m).hypot(point.y - self.east_m) - self.radius_m;
        let above_m = -point.z - self.top_m;
        if beside_m > 0.0 && above_m > 0.0 {
            beside_m.hypot(above_m)
        } else {
            beside_m.max(above_m)
        }
    }

    fn meets(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Contact> {
        let (x, y) = (origin.x - self.north_m, origin.y - self.east_m);
        let radius2 = self.radius_m * self.radius_m;
        let outside = x * x + y * y - radius2;
        let (up, climb) = (-origin.z, -direction.z);
        if outside < 0.0 && up < self.top_m {
            return Some(INSIDE);
        }
        if outside >= 0.0 {
            let closing = -(x * direction.x + y * direction.y);
            if closing <= 0.0 {
                return None;
            }
            // The discriminant as radius against miss distance: no cancellation for rays that graze from afar.
            let miss = x * direction.y - y * direction.x;
            let speed2 = direction.x * direction.x + direction.y * direction.y;
            let discriminant = speed2 * radius2 - miss * miss;
            if discriminant < 0.0 {
                return None;
            }
            let root = discriminant.sqrt();
            let range_m = outside / (closing + root);
            if up + climb * range_m <= self.top_m {
                return Some(Contact {
                    range_m,
                    incidence_cos: root / self.radius_m,
                });
            }
        }
        if up < self.top_m || climb >= -PARALLEL {
            return None;
        }
        let range_m = (self.top_m - up) / climb;
        let (x, y) = (x + direction.x * range_m, y + direction.y * range_m);
        (x * x + y * y <= radius2).then_some(Contact {
            range_m,
            incidence_cos: -climb,
        })
    }
}

/// A box that is level but may be turned about the vertical (a wall, a crate).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct YawedBox {
    north_m: f64,
    east_m: f64,
    length_m: f64,
    width_m: f64,
    yaw_rad: f64,
    bottom_m: f64,
    top_m: f64,
    #[serde(skip)]
    yaw_cos: f64,
    #[serde(skip)]
    yaw_sin: f64,
}

impl YawedBox {
    /// Centre (`north_m`, `east_m`), `length_m` along the direction `yaw_rad` (clockwise from north), `width_m`
    /// across it, on the ground.
    pub fn new(north_m: f64, east_m: f64, length_m: f64, width_m: f64, yaw_rad: f64, top_m: f64) -> Self {
        Self {
            north_m,
            east_m,
            length_m,
            width_m,
            yaw_rad,
            bottom_m: 0.0,
            top_m,
            yaw_cos: yaw_rad.cos(),
            yaw_sin: yaw_rad.sin(),
        }
    }

    /// The same box with its underside `bottom_m` above ground.
    pub fn raised(self, bottom_m: f64) -> Self {
        Self { bottom_m, ..self }
    }

    /// Half of length, width and height (m).
    fn half(&self) -> Vector3<f64> {
        Vector3::new(self.length_m, self.width_m, self.top_m - self.bottom_m) * 0.5
    }

    /// Local components turned into the box's axes.
    fn turned(&self, v: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(
            self.yaw_cos * v.x + self.yaw_sin * v.y,
            self.yaw_cos * v.y - self.yaw_sin * v.x,
            v.z,
        )
    }

    fn relative(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let centre = Vector3::new(self.north_m, self.east_m, -0.5 * (self.top_m + self.bottom_m));
        self.turned(&(point - centre))
    }

    fn distance_m(&self, point: &Vector3<f64>) -> f64 {
        let beyond = self.relative(point).abs() - self.half();
        beyond.map(|b| b.max(0.0)).norm() + beyond.max().min(0.0)
    }

    fn meets(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Contact> {
        let (start, along, half) = (self.relative(origin), self.turned(direction), self.half());
        let (mut enter, mut leave, mut facing) = (f64::NEG_INFINITY, f64::INFINITY, 1.0);
        for axis in 0..3 {
            if along[axis].abs() < PARALLEL {
                if start[axis].abs() > half[axis] {
                    return None;
                }
                continue;
            }
            let reach = half[axis].copysign(along[axis]);
            let (near, far) = (
                (-reach - start[axis]) / along[axis],
                (reach - start[axis]) / along[axis],
            );
            if near > enter {
                (enter, facing) = (near, along[axis].abs());
            }
            leave = leave.min(far);
        }
        if enter > leave || leave < 0.0 {
            return None;
        }
        if enter < 0.0 {
            return Some(INSIDE);
        }
        Some(Contact {
            range_m: enter,
            incidence_cos: facing,
        })
    }
}

/// A sphere (a balloon, a ball in the air).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Sphere {
    /// Centre, north (m).
    pub north_m: f64,
    /// Centre, east (m).
    pub east_m: f64,
    /// Height of the centre above ground (m).
    pub up_m: f64,
    /// Radius (m).
    pub radius_m: f64,
}

impl Sphere {
    fn relative(&self, point: &Vector3<f64>) -> Vector3<f64> {
        point - Vector3::new(self.north_m, self.east_m, -self.up_m)
    }

    fn distance_m(&self, point: &Vector3<f64>) -> f64 {
        self.relative(point).norm() - self.radius_m
    }

    fn meets(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Contact> {
        let start = self.relative(origin);
        let radius2 = self.radius_m * self.radius_m;
        if start.norm_squared() < radius2 {
            return Some(INSIDE);
        }
        let closing = -start.dot(direction);
        let miss2 = (start + direction * closing).norm_squared();
        if closing < 0.0 || miss2 > radius2 {
            return None;
        }
        let root = (radius2 - miss2).sqrt();
        Some(Contact {
            range_m: (closing - root).max(0.0),
            incidence_cos: root / self.radius_m,
        })
    }
}

/// One obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Obstacle {
    /// A tree or pillar.
    Cylinder(Cylinder),
    /// A wall or crate.
    Box(YawedBox),
    /// A ball in the air.
    Sphere(Sphere),
}

/// What it is, where, how large, in metres to the centimetre.
impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = |north_m: f64, east_m: f64| format!("{north_m:7.2} m north {east_m:7.2} m east");
        match self {
            Self::Cylinder(tree) => write!(
                f,
                "cylinder {}, radius {:.2} m, up to {:.2} m",
                place(tree.north_m, tree.east_m),
                tree.radius_m,
                tree.top_m
            ),
            Self::Box(wall) => write!(
                f,
                "box      {}, {:.2} x {:.2} m turned by {:.1} deg, from {:.2} to {:.2} m",
                place(wall.north_m, wall.east_m),
                wall.length_m,
                wall.width_m,
                wall.yaw_rad.to_degrees(),
                wall.bottom_m,
                wall.top_m
            ),
            Self::Sphere(ball) => write!(
                f,
                "sphere   {}, radius {:.2} m, centre {:.2} m up",
                place(ball.north_m, ball.east_m),
                ball.radius_m,
                ball.up_m
            ),
        }
    }
}

impl Obstacle {
    /// Signed distance from `point` (local NED) to the surface (m), negative inside.
    pub fn distance_m(&self, point: &Vector3<f64>) -> f64 {
        match self {
            Self::Cylinder(solid) => solid.distance_m(point),
            Self::Box(solid) => solid.distance_m(point),
            Self::Sphere(solid) => solid.distance_m(point),
        }
    }

    /// Where the ray from `origin` along the unit vector `direction` (both local NED) first meets it.
    pub fn meets(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Contact> {
        match self {
            Self::Cylinder(solid) => solid.meets(origin, direction),
            Self::Box(solid) => solid.meets(origin, direction),
            Self::Sphere(solid) => solid.meets(origin, direction),
        }
    }

    /// The rectangle it covers seen from above: north from, north to, east from, east to (m).
    pub fn footprint_m(&self) -> [f64; 4] {
        let (north_m, east_m, north_reach_m, east_reach_m) = match self {
            Self::Cylinder(s) => (s.north_m, s.east_m, s.radius_m, s.radius_m),
            Self::Sphere(s) => (s.north_m, s.east_m, s.radius_m, s.radius_m),
            Self::Box(s) => {
                let (c, n) = (s.yaw_cos.abs(), s.yaw_sin.abs());
                let (l, w) = (0.5 * s.length_m, 0.5 * s.width_m);
                (s.north_m, s.east_m, c * l + n * w, n * l + c * w)
            }
        };
        [
            north_m - north_reach_m,
            north_m + north_reach_m,
            east_m - east_reach_m,
            east_m + east_reach_m,
        ]
    }

    /// A circle around its footprint: centre north, east, and radius (m).
    pub fn circle_m(&self) -> [f64; 3] {
        match self {
            Self::Cylinder(s) => [s.north_m, s.east_m, s.radius_m],
            Self::Sphere(s) => [s.north_m, s.east_m, s.radius_m],
            Self::Box(s) => [s.north_m, s.east_m, 0.5 * s.length_m.hypot(s.width_m)],
        }
    }

    /// Height of its highest point above ground (m).
    pub fn top_m(&self) -> f64 {
        match self {
            Self::Cylinder(s) => s.top_m,
            Self::Box(s) => s.top_m,
            Self::Sphere(s) => s.up_m + s.radius_m,
        }
    }

    /// Its smallest extent (m): what decides whether a beam of finite width can miss it.
    pub fn thickness_m(&self) -> f64 {
        match self {
            Self::Cylinder(s) => (2.0 * s.radius_m).min(s.top_m),
            Self::Box(s) => 2.0 * s.half().min(),
            Self::Sphere(s) => 2.0 * s.radius_m,
        }
    }
}
