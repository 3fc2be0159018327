//! How PX4 takes a companion's trajectory into its automatic modes, holes included.
//!
//! | in | out |
//! |---|---|
//! | TRAJECTORY_REPRESENTATION_WAYPOINTS, _BEZIER as decoded | the flight task's setpoint, replaced |
//! | | "go to Hold", with its cause |
//!
//! In every cycle of an automatic mode, with `wp` and `curve` the last messages ever received:
//!
//! * timed out: `wp` older than 0.5 s and `curve` past its end (or from the future);
//! * without content: neither has a valid point, for 0.5 s on end;
//! * either of the two, in Hold: nothing is injected; elsewhere: Hold is demanded and the place is held;
//! * otherwise point 0 of `wp` is injected, or else the curve's present state.
//!
//! [`Variant::A`] asks of `wp` only that it once was valid: a stale waypoint wins over a live curve. [`Variant::B`] asks
//! that it is not stale, demands Hold once instead of in every cycle, and before the first valid message only waits.
//! Where neither branch yields a setpoint the mission's own, unchecked one is flown: that is what PX4 does.

use super::bezier::Curve;
use super::setpoint::{MotionSetpoint, unset};
use jink_shared_types::vehicle::NavMode;
use nalgebra::Vector3;

/// Age at which waypoints count as stale (us).
const STREAM_TIMEOUT_US: u64 = 500_000;
/// Time without any valid point before that counts as failure (us).
const INVALID_TIME_US: u64 = 500_000;

/// Which state of the trajectory interface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Variant {
    /// v1.11 to v1.13.
    #[default]
    A,
    /// After the timeout and initialisation fixes of November 2022, up to v1.15.
    B,
}

/// Why the companion's data sent the vehicle to Hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HoldCause {
    /// Nothing received for 0.5 s, in OFFBOARD for COM_OF_LOSS_T.
    StreamStopped,
    /// The last curve ended, and no waypoints came either.
    CurveExpired,
    /// The last curve starts in the future.
    CurveInFuture,
    /// Messages come, but without a valid point.
    NoValidPoint,
    /// In Position mode, with collision prevention: no distances for 5 s.
    NoObstacleData,
}

/// Point 0 of the last WAYPOINTS message.
#[derive(Clone, Copy, Debug)]
struct Waypoint {
    received_us: u64,
    valid: bool,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    yaw_rad: f64,
    yaw_rate_radps: f64,
}

/// The consumer of the companion's trajectories.
#[derive(Clone, Debug)]
pub struct AvoidanceConsumer {
    variant: Variant,
    waypoint: Option<Waypoint>,
    curve: Option<Curve>,
    invalid_since_us: Option<u64>,
    held_position: Option<Vector3<f64>>,
    activated: bool,
}

impl AvoidanceConsumer {
    /// Nothing received yet.
    pub fn new(variant: Variant) -> Self {
        Self {
            variant,
            waypoint: None,
            curve: None,
            invalid_since_us: None,
            held_position: None,
            activated: false,
        }
    }

    /// Takes point 0 of a WAYPOINTS message. `setpoint.acceleration` is not looked at.
    pub fn receive_waypoint(&mut self, now_us: u64, valid: bool, setpoint: &MotionSetpoint) {
        self.waypoint = Some(Waypoint {
            received_us: now_us,
            valid,
            position: setpoint.position,
            velocity: setpoint.velocity,
            yaw_rad: setpoint.yaw_rad,
            yaw_rate_radps: setpoint.yaw_rate_radps,
        });
    }

    /// Takes a BEZIER message.
    pub fn receive_curve(&mut self, curve: Curve) {
        self.curve = Some(curve);
    }

    /// Replaces position, velocity and heading of `setpoint` as PX4 would. `Some` = the mode must become Hold.
    pub fn inject(
        &mut self,
        now_us: u64,
        mode: NavMode,
        position: &Vector3<f64>,
        setpoint: &mut MotionSetpoint,
    ) -> Option<HoldCause> {
        let waypoint_stale = self
            .waypoint
            .is_none_or(|w| now_us - w.received_us > STREAM_TIMEOUT_US);
        let curve_stale = self.curve.is_none_or(|c| curve_timed_out(&c, now_us));
        let waypoint_valid = self.waypoint.is_some_and(|w| w.valid);
        let curve_valid = self.curve.is_some_and(|c| c.len > 0);
        let without_content = self.without_content(now_us, !waypoint_valid && !curve_valid);
        let timed_out = waypoint_stale && curve_stale;

        if timed_out || without_content {
            if mode == NavMode::Hold {
                return None;
            }
            return self.fail(now_us, timed_out, position, setpoint);
        }
        self.activated = true;
        self.held_position = None;
        let fresh_enough = |stale: bool| self.variant == Variant::A || !stale;
        match (self.waypoint, self.curve) {
            (Some(point), _) if point.valid && fresh_enough(waypoint_stale) => {
                setpoint.position = point.position;
                setpoint.velocity = point.velocity;
                setpoint.yaw_rad = point.yaw_rad;
                setpoint.yaw_rate_radps = point.yaw_rate_radps;
            }
            (_, Some(curve)) if curve.len > 0 && fresh_enough(curve_stale) => {
                inject_curve(&curve, now_us, setpoint);
            }
            _ => {}
        }
        None
    }

    fn without_content(&mut self, now_us: u64, now_without: bool) -> bool {
        if !now_without {
            self.invalid_since_us = None;
            return false;
        }
        let since_us = *self.invalid_since_us.get_or_insert(now_us);
        now_us - since_us >= INVALID_TIME_US
    }

    fn fail(
        &mut self,
        now_us: u64,
        timed_out: bool,
        position: &Vector3<f64>,
        setpoint: &mut MotionSetpoint,
    ) -> Option<HoldCause> {
        let place = *self.held_position.get_or_insert(*position);
        *setpoint = MotionSetpoint {
            position: place,
            ..MotionSetpoint::unset()
        };
        let demands = match self.variant {
            Variant::A => true,
            Variant::B => std::mem::take(&mut self.activated),
        };
        demands.then(|| self.cause(now_us, timed_out))
    }

    fn cause(&self, now_us: u64, timed_out: bool) -> HoldCause {
        if !timed_out {
            return HoldCause::NoValidPoint;
        }
        match self.curve {
            Some(curve) if curve.age_s(now_us) < 0.0 => HoldCause::CurveInFuture,
            Some(curve) if curve.len > 0 && self.waypoint.is_none_or(|w| !w.valid) => HoldCause::CurveExpired,
            _ => HoldCause::StreamStopped,
        }
    }
}

/// PX4 subtracts unsigned times: a start in the future counts as an age of half an eternity.
fn curve_timed_out(curve: &Curve, now_us: u64) -> bool {
    let age_s = curve.age_s(now_us);
    let lives = curve.len > 0 && curve.duration_s > 0.0 && age_s >= 0.0 && age_s <= curve.duration_s;
    !lives
}

/// The curve's state where there is one. Where there is none ("bad trajectory") the heading is lost and the setpoint
/// stays the mission's own.
fn inject_curve(curve: &Curve, now_us: u64, setpoint: &mut MotionSetpoint) {
    setpoint.yaw_rad = f64::NAN;
    setpoint.yaw_rate_radps = f64::NAN;
    if let Some(state) = curve.at(now_us) {
        setpoint.position = state.position;
        setpoint.velocity = state.velocity;
        setpoint.yaw_rad = state.yaw_rad;
        setpoint.yaw_rate_radps = state.yaw_rate_radps;
    }
}

/// The point as WAYPOINTS carries it, all fields of one index.
pub fn point_of(position: [f32; 3], velocity: [f32; 3], yaw: f32, yaw_rate: f32) -> MotionSetpoint {
    MotionSetpoint {
        position: Vector3::from(position.map(f64::from)),
        velocity: Vector3::from(velocity.map(f64::from)),
        acceleration: unset(),
        yaw_rad: f64::from(yaw),
        yaw_rate_radps: f64::from(yaw_rate),
    }
}

/// Whether the injected target differs from the flight task's own by more than rounding.
pub fn is_modified(target: &Vector3<f64>, setpoint: &Vector3<f64>) -> bool {
    let epsilon = f64::from(f32::EPSILON);
    let horizontally = (target - setpoint).xy().norm() > epsilon;
    let vertically = setpoint.z.is_finite() && (target - setpoint).z.abs() > epsilon;
    horizontally || vertically
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bezier::{ControlPoint, POINTS_MAX};

    const HERE: Vector3<f64> = Vector3::new(1.0, 2.0, -5.0);
    const OWN: Vector3<f64> = Vector3::new(50.0, 0.0, -5.0);
    const THEIRS: Vector3<f64> = Vector3::new(4.0, 3.0, -5.0);

    fn own() -> MotionSetpoint {
        MotionSetpoint {
            position: OWN,
            ..MotionSetpoint::unset()
        }
    }

    fn theirs() -> MotionSetpoint {
        MotionSetpoint {
            position: THEIRS,
            ..MotionSetpoint::unset()
        }
    }

    fn curve(start_us: i64, duration_s: f64) -> Curve {
        let point = ControlPoint {
            position: THEIRS * 2.0,
            yaw_rad: 0.0,
        };
        Curve {
            points: [point; POINTS_MAX],
            len: 5,
            start_us,
            duration_s,
        }
    }

    fn inject(
        consumer: &mut AvoidanceConsumer,
        now_us: u64,
        mode: NavMode,
    ) -> (Vector3<f64>, Option<HoldCause>) {
        let mut setpoint = own();
        let cause = consumer.inject(now_us, mode, &HERE, &mut setpoint);
        (setpoint.position, cause)
    }

    #[test]
    fn a_waypoint_serves_for_half_a_second_and_then_the_vehicle_holds() {
        for variant in [Variant::A, Variant::B] {
            let mut consumer = AvoidanceConsumer::new(variant);
            consumer.receive_waypoint(1_000_000, true, &theirs());
            assert_eq!(inject(&mut consumer, 1_500_000, NavMode::Mission), (THEIRS, None));
            let (position, cause) = inject(&mut consumer, 1_504_000, NavMode::Mission);
            assert_eq!((position, cause), (HERE, Some(HoldCause::StreamStopped)));
        }
    }

    #[test]
    fn in_hold_an_invalid_stream_leaves_the_setpoint_alone() {
        for variant in [Variant::A, Variant::B] {
            let mut consumer = AvoidanceConsumer::new(variant);
            assert_eq!(inject(&mut consumer, 9_000_000, NavMode::Hold), (OWN, None));
            consumer.receive_waypoint(9_000_000, true, &theirs());
            assert_eq!(inject(&mut consumer, 9_100_000, NavMode::Hold), (THEIRS, None));
        }
    }

    #[test]
    fn precedence_trap_of_variant_a_and_fall_through_of_variant_b() {
        for (variant, expected) in [(Variant::A, THEIRS), (Variant::B, THEIRS * 2.0)] {
            let mut consumer = AvoidanceConsumer::new(variant);
            consumer.receive_waypoint(1_000_000, true, &theirs());
            consumer.receive_curve(curve(1_400_000, 4.0));
            assert_eq!(inject(&mut consumer, 1_450_000, NavMode::Mission).0, THEIRS);
            assert_eq!(inject(&mut consumer, 3_000_000, NavMode::Mission).0, expected);
        }
    }

    #[test]
    fn one_waypoints_message_without_points_opens_the_way_for_curves() {
        let mut consumer = AvoidanceConsumer::new(Variant::A);
        consumer.receive_waypoint(1_000_000, true, &theirs());
        consumer.receive_waypoint(1_100_000, false, &theirs());
        consumer.receive_curve(curve(1_100_000, 2.0));
        assert_eq!(inject(&mut consumer, 1_150_000, NavMode::Mission).0, THEIRS * 2.0);
    }

    #[test]
    fn a_curve_expires_at_its_duration() {
        let mut consumer = AvoidanceConsumer::new(Variant::A);
        consumer.receive_curve(curve(1_000_000, 4.0));
        assert_eq!(inject(&mut consumer, 5_000_000, NavMode::Mission).1, None);
        let (_, cause) = inject(&mut consumer, 5_004_000, NavMode::Mission);
        assert_eq!(cause, Some(HoldCause::CurveExpired));
    }

    #[test]
    fn hole_an_expired_curve_with_fresh_empty_waypoints_lets_the_mission_pass() {
        for variant in [Variant::A, Variant::B] {
            let mut consumer = AvoidanceConsumer::new(variant);
            consumer.receive_curve(curve(1_000_000, 0.3));
            assert_eq!(inject(&mut consumer, 1_200_000, NavMode::Mission).0, THEIRS * 2.0);
            for now_us in (1_400_000..4_000_000).step_by(100_000) {
                consumer.receive_waypoint(now_us, false, &theirs());
                assert_eq!(inject(&mut consumer, now_us, NavMode::Mission), (OWN, None));
            }
        }
    }

    #[test]
    fn hole_a_curve_of_the_future_with_fresh_waypoints_lets_the_mission_pass() {
        let mut consumer = AvoidanceConsumer::new(Variant::A);
        consumer.receive_waypoint(1_000_000, false, &theirs());
        consumer.receive_curve(curve(1_700_000, 1.0));
        assert_eq!(inject(&mut consumer, 1_200_000, NavMode::Mission), (OWN, None));
        let (_, cause) = inject(&mut consumer, 1_504_000, NavMode::Mission);
        assert_eq!(cause, Some(HoldCause::CurveInFuture));
    }

    #[test]
    fn messages_without_a_valid_point_lead_to_hold_after_half_a_second() {
        let mut consumer = AvoidanceConsumer::new(Variant::A);
        let mut fell_us = None;
        for now_us in (0..2_000_000).step_by(8_000) {
            consumer.receive_waypoint(now_us, false, &theirs());
            if let (_, Some(cause)) = inject(&mut consumer, now_us, NavMode::Mission) {
                assert_eq!(cause, HoldCause::NoValidPoint);
                fell_us.get_or_insert(now_us);
            }
        }
        assert_eq!(fell_us, Some(504_000));
    }

    #[test]
    fn variant_b_waits_without_a_mode_change_before_the_first_message_and_demands_hold_once() {
        let mut consumer = AvoidanceConsumer::new(Variant::B);
        assert_eq!(inject(&mut consumer, 4_000_000, NavMode::Mission), (HERE, None));
        consumer.receive_waypoint(5_000_000, true, &theirs());
        inject(&mut consumer, 5_100_000, NavMode::Mission);
        assert!(inject(&mut consumer, 6_000_000, NavMode::Mission).1.is_some());
        assert!(inject(&mut consumer, 6_008_000, NavMode::Mission).1.is_none());
        let mut nagging = AvoidanceConsumer::new(Variant::A);
        assert!(inject(&mut nagging, 4_000_000, NavMode::Mission).1.is_some());
        assert!(inject(&mut nagging, 4_008_000, NavMode::Mission).1.is_some());
    }

    #[test]
    fn a_mirrored_target_is_not_modified_and_a_missing_height_is_no_modification() {
        assert!(!is_modified(&OWN, &OWN));
        assert!(is_modified(&OWN, &Vector3::new(50.0, 0.001, -5.0)));
        let without_height = Vector3::new(50.0, 0.0, f64::NAN);
        assert!(!is_modified(&OWN, &without_height));
    }
}
