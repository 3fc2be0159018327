//! The heading: held, along the track, as asked, or turning.

use super::parameters::{Parameter as P, Parameters};
use super::position_control::Motion;
use super::setpoint::YawRequest;
use jink_shared_types::frames::wrap_pi;
use jink_simulated_world::vehicle::STEP_S;

/// How fast the heading may be led (rad/s): ATC_SLEW_YAW and AUTO_YAW slew, 60 degrees a second.
const SLEW_RADPS: f64 = std::f64::consts::FRAC_PI_3;
/// The track gives a heading from this share of the speed limit on.
const TRACK_SHARE: f64 = 0.05;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Kind {
    #[default]
    Hold,
    Track,
    Fixed(f64),
    AngleAndRate(f64, f64),
    Rate(f64),
}

/// What leads the heading.
#[derive(Clone, Copy, Debug, Default)]
pub struct AutoYaw {
    kind: Kind,
    led_rad: f64,
}

impl AutoYaw {
    /// Holds the heading the vehicle has.
    pub fn hold(&mut self, yaw_rad: f64) {
        *self = Self {
            kind: Kind::Hold,
            led_rad: yaw_rad,
        };
    }

    /// On the ground: led from the heading the vehicle has, whatever is asked for.
    pub fn rest(&mut self, yaw_rad: f64) {
        self.led_rad = yaw_rad;
    }

    /// What WP_YAW_BEHAVIOR says, from the heading held now.
    pub fn set_default(&mut self, parameters: &Parameters) {
        self.kind = if parameters.get(P::WP_YAW_BEHAVIOR) == 0.0 {
            Kind::Hold
        } else {
            Kind::Track
        };
    }

    /// What a setpoint asks for.
    pub fn request(&mut self, request: YawRequest, parameters: &Parameters) {
        match request {
            YawRequest::Default => self.set_default(parameters),
            YawRequest::Relative(by_rad) => self.kind = Kind::Fixed(wrap_pi(self.led_rad + by_rad)),
            YawRequest::Angle(yaw_rad, rate_radps) => {
                self.kind = Kind::AngleAndRate(wrap_pi(yaw_rad), rate_radps);
            }
            YawRequest::Rate(rate_radps) => self.kind = Kind::Rate(rate_radps),
        }
    }

    /// Sticks turn it.
    pub fn turn(&mut self, rate_radps: f64) {
        self.kind = Kind::Rate(rate_radps);
    }

    /// The setpoints ended: what turns, stops turning.
    pub fn time_out(&mut self) {
        if matches!(self.kind, Kind::Rate(_) | Kind::AngleAndRate(..)) {
            self.kind = Kind::Hold;
        }
    }

    /// One step: heading (rad) and heading rate (rad/s) to follow, `desired` being the reference of the motion.
    pub fn step(&mut self, desired: &Motion, speed_max_mps: f64) -> (f64, f64) {
        let (wanted_rad, rate_radps) = match &mut self.kind {
            Kind::Hold => (self.led_rad, 0.0),
            Kind::Track => track(desired, speed_max_mps).unwrap_or((self.led_rad, 0.0)),
            Kind::Fixed(yaw_rad) => (*yaw_rad, 0.0),
            Kind::AngleAndRate(yaw_rad, rate_radps) => {
                *yaw_rad = wrap_pi(*yaw_rad + *rate_radps * STEP_S);
                (*yaw_rad, *rate_radps)
            }
            Kind::Rate(rate_radps) => (wrap_pi(self.led_rad + *rate_radps * STEP_S), *rate_radps),
        };
        let step = SLEW_RADPS.max(rate_radps.abs()) * STEP_S;
        let change = wrap_pi(wanted_rad - self.led_rad).clamp(-step, step);
        self.led_rad = wrap_pi(self.led_rad + change);
        (self.led_rad, rate_radps.clamp(-SLEW_RADPS, SLEW_RADPS))
    }
}

/// Heading and heading rate of the reference's track.
fn track(desired: &Motion, speed_max_mps: f64) -> Option<(f64, f64)> {
    let (v, a) = (desired.velocity.xy(), desired.acceleration.xy());
    let speed = v.norm();
    (speed > TRACK_SHARE * speed_max_mps).then(|| (v.y.atan2(v.x), v.perp(&a) / (speed * speed)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn moving(x: f64, y: f64) -> Motion {
        Motion {
            velocity: Vector3::new(x, y, 0.0),
            ..Motion::default()
        }
    }

    #[test]
    fn the_track_leads_only_above_a_twentieth_of_the_speed_limit() {
        let mut yaw = AutoYaw::default();
        yaw.hold(1.0);
        yaw.set_default(&Parameters::default());
        assert_eq!(yaw.step(&moving(0.0, 0.4), 10.0), (1.0, 0.0));
        for _ in 0..500 {
            yaw.step(&moving(0.0, 0.6), 10.0);
        }
        assert!((yaw.led_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn a_relative_heading_is_asked_anew_by_every_message() {
        let (mut yaw, parameters) = (AutoYaw::default(), Parameters::default());
        yaw.hold(0.0);
        for _ in 0..500 {
            yaw.request(YawRequest::Relative(std::f64::consts::FRAC_PI_2), &parameters);
            yaw.step(&Motion::default(), 10.0);
        }
        assert!((wrap_pi(yaw.led_rad - 2.0 * SLEW_RADPS)).abs() < 1e-6);
    }

    #[test]
    fn what_turns_stops_turning_when_setpoints_end() {
        let (mut yaw, parameters) = (AutoYaw::default(), Parameters::default());
        yaw.request(YawRequest::Rate(0.5), &parameters);
        yaw.step(&Motion::default(), 10.0);
        yaw.time_out();
        assert_eq!(yaw.step(&Motion::default(), 10.0).1, 0.0);
    }
}
