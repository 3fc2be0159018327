//! A straight leg: a point that runs along it within the limits of speed, acceleration and jerk, and the vehicle after it.
//!
//! The real one rounds corners with an S-curve through the next leg; here the point slows down for every waypoint, without
//! stopping at those that are flown past. Nothing about that was observed, and jink flies in GUIDED.

use super::position_control::{Limits, Motion, PositionControl, straight_speed_mps};
use super::shaping::{correcting_velocity_1d, shape_velocity_1d};
use jink_simulated_world::vehicle::STEP_S;
use nalgebra::Vector3;

/// The point has arrived within this (m).
const ARRIVED_M: f64 = 0.05;

/// A leg being flown.
#[derive(Clone, Copy, Debug, Default)]
pub struct Leg {
    origin: Vector3<f64>,
    way: Vector3<f64>,
    along_m: f64,
    speed_mps: f64,
    acceleration_mps2: f64,
}

impl Leg {
    /// From the reference, with the speed it has in that direction, to `destination`.
    pub fn new(from: &Motion, destination: Vector3<f64>) -> Self {
        let way = destination - from.position;
        let direction = way.try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        Self {
            origin: from.position,
            way,
            along_m: 0.0,
            speed_mps: from.velocity.dot(&direction).max(0.0),
            acceleration_mps2: 0.0,
        }
    }

    /// Where it leads.
    pub fn destination(&self) -> Vector3<f64> {
        self.origin + self.way
    }

    /// What is left of it (m).
    pub fn left_m(&self) -> f64 {
        self.way.norm() - self.along_m
    }

    /// Whether the point has arrived.
    pub fn has_arrived(&self) -> bool {
        self.left_m() < ARRIVED_M
    }

    /// Moves the point and the reference on by a step.
    pub fn step(&mut self, limits: &Limits, control: &mut PositionControl) {
        let direction = self.way.try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        let most_mps = straight_speed_mps(self.way, limits);
        let shape = if direction.xy().norm() > 0.1 {
            &limits.horizontal
        } else {
            &limits.vertical
        };
        self.along_m += self.speed_mps * STEP_S;
        self.speed_mps += self.acceleration_mps2 * STEP_S;
        let wanted_mps = correcting_velocity_1d(self.left_m(), -most_mps, most_mps, shape, STEP_S);
        self.acceleration_mps2 = shape_velocity_1d(
            wanted_mps,
            0.0,
            self.speed_mps,
            self.acceleration_mps2,
            shape,
            STEP_S,
        );
        let point = Motion {
            position: self.origin + direction * self.along_m,
            velocity: direction * self.speed_mps,
            acceleration: direction * self.acceleration_mps2,
        };
        control.follow(&point);
        control.follow_height(&point);
    }
}
