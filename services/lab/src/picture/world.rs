//! A world as far as it can be drawn.

use serde::Deserialize;

/// A world as the simulator describes it in JSON, as far as it can be drawn.
#[derive(Clone, Debug, Deserialize, PartialEq)]
pub struct World {
    /// Kind.
    pub world: String,
    /// Seed.
    pub seed: u64,
    /// Where the flight starts.
    pub start: Place,
    /// Where it leads.
    pub goals: Vec<Place>,
    /// The part of the world that matters.
    pub bounds: Bounds,
    /// Trees and posts.
    #[serde(default)]
    pub cylinders: Vec<Cylinder>,
    /// Walls and crates.
    #[serde(default)]
    pub boxes: Vec<YawedBox>,
    /// Balls.
    #[serde(default)]
    pub spheres: Vec<Sphere>,
}

/// A place.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
pub struct Place {
    /// North of the origin (m).
    pub north_m: f64,
    /// East of the origin (m).
    pub east_m: f64,
}

/// A rectangle on the ground.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
pub struct Bounds {
    /// Southern edge (m).
    pub north_min_m: f64,
    /// Northern edge (m).
    pub north_max_m: f64,
    /// Western edge (m).
    pub east_min_m: f64,
    /// Eastern edge (m).
    pub east_max_m: f64,
}

/// An upright cylinder.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
pub struct Cylinder {
    /// Axis, north (m).
    pub north_m: f64,
    /// Axis, east (m).
    pub east_m: f64,
    /// Radius (m).
    pub radius_m: f64,
}

/// A level box turned about the vertical.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
pub struct YawedBox {
    /// Centre, north (m).
    pub north_m: f64,
    /// Centre, east (m).
    pub east_m: f64,
    /// Length along its heading (m).
    pub length_m: f64,
    /// Width across it (m).
    pub width_m: f64,
    /// Heading, clockwise from north (rad).
    pub yaw_rad: f64,
}

/// A sphere.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
pub struct Sphere {
    /// Centre, north (m).
    pub north_m: f64,
    /// Centre, east (m).
    pub east_m: f64,
    /// Radius (m).
    pub radius_m: f64,
}
