//! The return: climb, fly home, descend, land.
//!
//! The height is RTL_RETURN_ALT above home, or inside the cone around home (half angle RTL_CONE_ANG, up to RTL_MIN_DIST)
//! the cone's, but at least twice the acceptance radius; never below where the vehicle is.

use super::navigator::input::NavigatorInput;
use super::parameters::{Parameter as P, Parameters};
use super::setpoint::{CurrentPoint, PointKind};
use jink_emulated_autopilot::mission::single;
use nalgebra::Vector3;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    #[default]
    Climb,
    Home,
    Descend,
    Land,
}

/// The return's memory.
#[derive(Clone, Debug, Default)]
pub struct ReturnHome {
    stage: Stage,
    height_m: f64,
    start: Vector3<f64>,
}

impl ReturnHome {
    /// Starts from where the vehicle is; on the ground it only lands.
    pub fn start(&mut self, input: &NavigatorInput) -> CurrentPoint {
        self.start = single(input.estimate.position.vector());
        let distance_m = (self.start - input.home).xy().norm();
        let above_home_m = input.home.z - self.start.z;
        self.height_m = return_height_m(distance_m, input.parameters).max(above_home_m);
        self.stage = if input.landed { Stage::Land } else { Stage::Climb };
        self.point(input)
    }

    /// Height of the way home, above home (m).
    pub fn height_m(&self) -> f64 {
        self.height_m
    }

    /// The next waypoint, when the present one has been reached.
    pub fn step(&mut self, input: &NavigatorInput) -> Option<CurrentPoint> {
        if self.stage == Stage::Land {
            return None;
        }
        let target = self.point(input).position;
        let away = target - input.estimate.position.vector();
        let near = away.xy().norm() <= input.parameters.get(P::NAV_ACC_RAD)
            && away.z.abs() <= input.parameters.get(P::NAV_MC_ALT_RAD);
        if !near {
            return None;
        }
        self.stage = match self.stage {
            Stage::Climb => Stage::Home,
            Stage::Home => Stage::Descend,
            _ => Stage::Land,
        };
        Some(self.point(input))
    }

    fn point(&self, input: &NavigatorInput) -> CurrentPoint {
        let home = input.home;
        let low_m = self.height_m.min(input.parameters.get(P::RTL_DESCEND_ALT));
        let (kind, position) = match self.stage {
            Stage::Climb => (
                PointKind::Position,
                Vector3::new(self.start.x, self.start.y, home.z - self.height_m),
            ),
            Stage::Home => (
                PointKind::Position,
                Vector3::new(home.x, home.y, home.z - self.height_m),
            ),
            Stage::Descend => (PointKind::Position, Vector3::new(home.x, home.y, home.z - low_m)),
            Stage::Land => (PointKind::Land, home),
        };
        CurrentPoint {
            kind,
            position: single(position),
            yaw_rad: f64::NAN,
            acceptance_m: input.parameters.get(P::NAV_ACC_RAD),
            cruise_mps: -1.0,
        }
    }
}

fn return_height_m(distance_m: f64, parameters: &Parameters) -> f64 {
    let mut height_m = parameters.get(P::RTL_RETURN_ALT);
    let acceptance_m = parameters.get(P::NAV_ACC_RAD);
    if distance_m <= acceptance_m {
        return 2.0 * distance_m;
    }
    let half_angle_rad = parameters.radians(P::RTL_CONE_ANG);
    let inside = distance_m <= parameters.get(P::RTL_MIN_DIST);
    if half_angle_rad > 0.0 && half_angle_rad < std::f64::consts::FRAC_PI_2 && inside {
        height_m = height_m.min(distance_m / half_angle_rad.tan());
    }
    height_m.max(2.0 * acceptance_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_height_follows_the_cone_near_home_and_the_parameter_far_from_it() {
        let parameters = Parameters::default();
        assert_eq!(return_height_m(1.0, &parameters), 2.0);
        assert_eq!(return_height_m(3.0, &parameters), 4.0);
        assert!((return_height_m(8.0, &parameters) - 8.0).abs() < 1e-9);
        assert_eq!(return_height_m(50.0, &parameters), 30.0);
    }
}
