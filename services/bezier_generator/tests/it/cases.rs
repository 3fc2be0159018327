//! Random problems: guides through corridors, cut into pieces as the generator does.

use jink_bezier_generator::problem::PieceSpec;
use jink_bezier_generator::profile::{LegPiece, cut};
use jink_shared_types::frames::{Acceleration, Point, Velocity};
use jink_shared_types::motion::{
    HalfSpace, MotionLimits, MotionState, POLYTOPE_PLANES, Polytope, Route, RouteMode,
};
use jink_shared_types::{Coded, Timestamp};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;

/// Most pieces of a problem.
pub const PIECES_MAX: usize = 11;
/// Fewest pieces of a problem.
const PIECES_MIN: usize = 3;
const LIMITS: MotionLimits = MotionLimits {
    speed_mps: 3.0,
    climb_mps: 1.5,
    descent_mps: 1.0,
    acceleration_mps2: 1.2,
    jerk_mps3: 2.5,
    yaw_rate_radps: 0.5,
    tube_m: 0.45,
    overshoot_m: 0.56,
    braking_mps2: 1.2,
    braking_jerk_mps3: 2.5,
};

/// What kind of problem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Hardly a turn, from rest.
    Straight,
    /// Turns to either side, from rest.
    Zigzag,
    /// Turns in a corridor of 0.02 to 0.4 m to each side, from rest.
    Narrow,
    /// Turns, from a start that moves along the first leg, or nearly.
    Moving,
    /// A start too fast for a short corridor, or that leaves it sideways: rarely feasible.
    Hopeless,
}

/// All of them.
pub const KINDS: [Kind; 5] = [
    Kind::Straight,
    Kind::Zigzag,
    Kind::Narrow,
    Kind::Moving,
    Kind::Hopeless,
];

/// A problem.
#[derive(Clone, Debug)]
pub struct Case {
    /// Where it starts.
    pub start: MotionState,
    /// Where it shall end.
    pub target: Vector3<f64>,
    /// Its limits.
    pub limits: MotionLimits,
    /// Its corridor, one polytope per leg.
    pub corridor: Vec<Polytope>,
    vertices: Vec<Vector3<f64>>,
    pieces: Vec<LegPiece>,
}

impl Case {
    /// The problem of this kind and seed.
    pub fn random(kind: Kind, seed: u64) -> Self {
        let mut random = SplitMix64::seed_from_u64(seed);
        loop {
            let case = Self::draw(kind, &mut random);
            if (PIECES_MIN..=PIECES_MAX).contains(&case.pieces.len()) {
                return case;
            }
        }
    }

    fn draw(kind: Kind, random: &mut SplitMix64) -> Self {
        let limits = limits(random);
        let (turn_rad, side_m, speed_share) = match kind {
            Kind::Straight => (0.05, random.random_range(0.4..1.2), 0.0),
            Kind::Zigzag => (0.9, random.random_range(0.4..1.2), 0.0),
            Kind::Narrow => (0.9, random.random_range(0.02..0.4), 0.0),
            Kind::Moving => (
                0.9,
                random.random_range(0.3..1.2),
                random.random_range(0.1..1.005),
            ),
            Kind::Hopeless => (1.2, random.random_range(0.25..0.6), random.random_range(0.7..1.0)),
        };
        let speed_mps = speed_share * limits.speed_mps;
        let vertices = guide(kind, turn_rad, random);
        let along = (vertices[1] - vertices[0]).normalize();
        let off = if kind == Kind::Hopeless { 0.7 } else { 0.05 };
        let aside = Vector3::new(-along.y, along.x, 0.0) * random.random_range(-off..=off);
        let velocity = (along + aside).normalize() * speed_mps;
        let acceleration = along * (limits.acceleration_mps2 * speed_share * random.random_range(-0.5..0.5));
        let start = MotionState {
            position: Point::from_vector(vertices[0]),
            velocity: Velocity::from_vector(velocity),
            acceleration: Acceleration::from_vector(acceleration),
            ..MotionState::default()
        };
        let stretch = [1.0, 1.0, 1.15, 1.4, 0.8][random.random_range(0..5)];
        let mut pieces = vec![LegPiece::default(); PIECES_MAX];
        let count = cut(&vertices, &velocity, &limits, stretch, &mut pieces);
        pieces.truncate(count);
        let legs = vertices.windows(2);
        Self {
            start,
            target: vertices[vertices.len() - 1],
            limits,
            corridor: legs.map(|leg| around(&leg[0], &leg[1], side_m, random)).collect(),
            vertices,
            pieces,
        }
    }

    /// Its pieces.
    pub fn specs(&self) -> Vec<PieceSpec<'_>> {
        let spec = |piece: &LegPiece| PieceSpec {
            duration_s: piece.duration_s,
            polytope: &self.corridor[piece.leg],
            guide: piece.end,
            brakes: false,
            across: None,
        };
        self.pieces.iter().map(spec).collect()
    }

    /// The route that asks for it.
    #[allow(dead_code, reason = "not every user of this file has routes")]
    pub fn route(&self, splice: Timestamp) -> Route {
        let mut route = Route {
            id: 7,
            mode: Coded::new(RouteMode::Plan),
            splice,
            start: self.start,
            target: Point::from_vector(self.target),
            limits: self.limits,
            ..Route::default()
        };
        for (guide, vertex) in route.guide.iter_mut().zip(&self.vertices) {
            *guide = Point::from_vector(*vertex);
            route.guide_len += 1;
        }
        for (slot, polytope) in route.corridor.iter_mut().zip(&self.corridor) {
            *slot = *polytope;
            route.corridor_len += 1;
        }
        route
    }
}

/// Those of a slow vehicle, or any.
fn limits(random: &mut SplitMix64) -> MotionLimits {
    if random.random_bool(0.5) {
        return LIMITS;
    }
    let acceleration_mps2 = random.random_range(0.5..5.0);
    MotionLimits {
        speed_mps: random.random_range(0.5..10.0),
        climb_mps: random.random_range(0.3..3.0),
        descent_mps: random.random_range(0.3..2.0),
        acceleration_mps2,
        jerk_mps3: acceleration_mps2 * random.random_range(1.0..4.0),
        braking_mps2: 0.0,
        braking_jerk_mps3: 0.0,
        ..LIMITS
    }
}

fn guide(kind: Kind, turn_rad: f64, random: &mut SplitMix64) -> Vec<Vector3<f64>> {
    let legs = match kind {
        Kind::Hopeless => random.random_range(1..4),
        _ => random.random_range(1..8),
    };
    let longest_m = if kind == Kind::Hopeless { 1.5 } else { 3.0 };
    let mut vertices = vec![Vector3::new(0.0, 0.0, -2.5)];
    let mut direction_rad = random.random_range(-3.1..3.1_f64);
    for leg in 0..legs {
        let length_m = random.random_range(1.0..longest_m);
        let slope = random.random_range(-0.4..0.4) * turn_rad;
        let step = Vector3::new(direction_rad.cos(), direction_rad.sin(), slope) * length_m;
        vertices.push(vertices[leg] + step);
        direction_rad += random.random_range(-turn_rad..turn_rad);
    }
    vertices
}

/// A box around the segment from `a` to `b`, `side_m` to each side, with up to ten of its corners cut off.
fn around(a: &Vector3<f64>, b: &Vector3<f64>, side_m: f64, random: &mut SplitMix64) -> Polytope {
    let mut polytope = Polytope::default();
    let mut push = |normal: Vector3<f64>, room_m: f64| {
        polytope.push(HalfSpace {
            normal: normal.into(),
            offset_m: normal.dot(a).max(normal.dot(b)) + room_m,
        });
    };
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut normal = Vector3::zeros();
            normal[axis] = sign;
            push(normal, side_m);
        }
    }
    for _ in 0..random.random_range(0..=10.min(POLYTOPE_PLANES - 6)) {
        let normal = Vector3::from_fn(|_, _| random.random_range(-1.0..1.0_f64));
        if normal.norm() > 0.1 {
            push(normal.normalize(), side_m * random.random_range(0.7..1.3));
        }
    }
    polytope
}
