//! What an assisted vehicle is sent: the velocity that may be flown, or the place where it came to rest.
//!
//! | sticks | horizontal | PX4 | ArduCopter |
//! |---|---|---|---|
//! | away from the centre, or the vehicle moves | the velocity that the guard allows, acceleration 0 | height and climb besides | climb besides: an ignored axis ignores its whole group |
//! | centred, and the vehicle at rest | the place where it came to rest | every position given | every position given |
//!
//! The guard brakes for where the vehicle is, so a position goes out only at rest: a reference that runs ahead of a moving vehicle
//! would pull it on past where the guard has stopped it.
//!
//! The heading is a rate while the yaw stick is deflected, and the angle that it came to afterwards. Heights are held between
//! [`HeightLimits`]; descents become slower towards the lower one, because landing is the pilot's.

use crate::profile::position_target::NO_PLACE_NOR_HEADING;
use crate::vehicle::Present;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::message::COMPONENT_AUTOPILOT;
use jink_shared_types::Timestamp;
use jink_shared_types::frames::wrap_pi;
use mavlink::dialect::{
    MavFrame, MavMessage, PositionTargetTypemask as Mask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use nalgebra::{Vector2, Vector3};

/// Slower than this the vehicle counts as being at rest (m/s).
const REST_MPS: f64 = 0.3;
/// A velocity below this is none (m/s).
const NONE_MPS: f64 = 1e-3;
/// A held place that is farther away than this (m) is given up for the one where the vehicle is: nobody has looked at the way back.
const ASTRAY_M: f64 = 1.0;
/// The height that is held is at most so far from the vehicle (m).
const HEIGHT_LEAD_M: f64 = 0.5;
/// The climb changes by this much (m/s2): what both autopilots follow.
const CLIMB_MPS2: f64 = 2.0;
/// Near a limit of the height the climb is this much for each metre that is left (1/s).
const TAPER_PER_S: f64 = 0.7;
/// So long after the yaw stick was centred (s) the heading that the vehicle has come to is held.
const TURNED_S: f64 = 0.5;
/// Longer than this (s) between two setpoints is another flight.
const GAP_S: f64 = 0.5;

/// How high the vehicle is, and between what it may climb and descend (m).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeightLimits {
    /// Height above the ground, else above home; `None` not known.
    pub above_ground_m: Option<f64>,
    /// Height above home; `None` not known.
    pub above_home_m: Option<f64>,
    /// Lowest height above the ground.
    pub lowest_m: f64,
    /// Greatest height above home.
    pub highest_m: f64,
    /// Fastest descent while the height is not known (m/s).
    pub unknown_descent_mps: f64,
}

impl HeightLimits {
    /// What of a climb (m/s, upwards) may be flown.
    fn limit(&self, climb_mps: f64) -> f64 {
        let most = |left_m: f64| (TAPER_PER_S * left_m).max(0.0);
        if climb_mps > 0.0 {
            let highest = self.above_home_m.map(|height_m| most(self.highest_m - height_m));
            return highest.map_or(climb_mps, |most_mps| climb_mps.min(most_mps));
        }
        let lowest = self.above_ground_m.or(self.above_home_m);
        let most_mps = lowest.map_or(self.unknown_descent_mps, |height_m| {
            most(height_m - self.lowest_m)
        });
        climb_mps.max(-most_mps)
    }
}

/// What is wanted at one moment.
#[derive(Clone, Copy, Debug)]
pub struct MotionDemand {
    /// Now.
    pub now: Timestamp,
    /// The vehicle.
    pub vehicle: Present,
    /// The horizontal velocity that the guard allows (north, east, m/s).
    pub velocity: Vector2<f64>,
    /// The pilot wants to go somewhere.
    pub is_steered: bool,
    /// Climb that the pilot wants (m/s, upwards).
    pub climb_mps: f64,
    /// Turn that he wants (rad/s, to the right).
    pub turn_radps: f64,
    /// What limits the climb.
    pub heights: HeightLimits,
}

#[derive(Clone, Copy, Debug)]
struct Place {
    position: Vector2<f64>,
    shift: Vector2<f64>,
}

/// Makes setpoints of demands.
#[derive(Clone, Copy, Debug, Default)]
pub struct AssistedMotion {
    last: Option<Timestamp>,
    held: Option<Place>,
    /// Down coordinate that is held, with the shift at its time (m).
    height: (f64, f64),
    climb_mps: f64,
    turned: Option<Timestamp>,
    yaw_rad: Option<f64>,
}

impl AssistedMotion {
    /// The setpoint for now.
    pub fn setpoint(&mut self, demand: &MotionDemand, make: AutopilotType, system_id: u8) -> MavMessage {
        let passed_s = self.begin(demand);
        self.hold(demand);
        self.climb(demand, passed_s);
        self.turn(demand);
        self.message(demand, make, system_id)
    }

    /// Time since the last setpoint (s); a flight begins with what the vehicle does.
    fn begin(&mut self, demand: &MotionDemand) -> f64 {
        let last = self.last.replace(demand.now);
        match last.map(|last| demand.now.seconds_since(last)) {
            Some(passed_s) if (0.0..=GAP_S).contains(&passed_s) => passed_s,
            _ => {
                let vehicle = &demand.vehicle;
                *self = Self {
                    last: self.last,
                    height: (vehicle.position.z, vehicle.shift.z),
                    climb_mps: -vehicle.velocity.z,
                    turned: Some(demand.now),
                    ..Self::default()
                };
                0.0
            }
        }
    }

    fn hold(&mut self, demand: &MotionDemand) {
        let vehicle = &demand.vehicle;
        let (here, shift) = (vehicle.position.xy(), vehicle.shift.xy());
        if demand.is_steered || demand.velocity.norm() > NONE_MPS {
            self.held = None;
        } else if let Some(held) = &mut self.held {
            held.position += shift - held.shift;
            held.shift = shift;
            if (held.position - here).norm() > ASTRAY_M {
                held.position = here;
            }
        } else if vehicle.velocity.xy().norm() < REST_MPS {
            self.held = Some(Place {
                position: here,
                shift,
            });
        }
    }

    fn climb(&mut self, demand: &MotionDemand, passed_s: f64) {
        let vehicle = &demand.vehicle;
        let step = CLIMB_MPS2 * passed_s;
        let wanted_mps = finite(demand.climb_mps).clamp(self.climb_mps - step, self.climb_mps + step);
        self.climb_mps = demand.heights.limit(wanted_mps);
        let (down_m, shift_m) = self.height;
        let down_m = down_m + (vehicle.shift.z - shift_m) - self.climb_mps * passed_s;
        let near = down_m.clamp(
            vehicle.position.z - HEIGHT_LEAD_M,
            vehicle.position.z + HEIGHT_LEAD_M,
        );
        self.height = (near, vehicle.shift.z);
    }

    fn turn(&mut self, demand: &MotionDemand) {
        if demand.turn_radps != 0.0 {
            self.turned = Some(demand.now);
            self.yaw_rad = None;
        } else if self.yaw_rad.is_none()
            && self
                .turned
                .is_none_or(|turned| demand.now.seconds_since(turned) >= TURNED_S)
        {
            self.yaw_rad = Some(wrap_pi(demand.vehicle.yaw_rad));
        }
    }

    fn message(&self, demand: &MotionDemand, make: AutopilotType, system_id: u8) -> MavMessage {
        // What came through shared memory may be damaged: no number, no motion.
        let velocity = demand.velocity.map(finite);
        let (place, velocity) = match &self.held {
            Some(held) => (held.position, Vector2::zeros()),
            None => (Vector2::zeros(), velocity),
        };
        let mut type_mask = match (self.held.is_some(), make) {
            (true, _) => Mask::empty(),
            (false, AutopilotType::Px4) => {
                Mask::POSITION_TARGET_TYPEMASK_X_IGNORE | Mask::POSITION_TARGET_TYPEMASK_Y_IGNORE
            }
            (false, AutopilotType::ArduPilot) => NO_PLACE_NOR_HEADING & !HEADING,
        };
        if self.yaw_rad.is_none() {
            type_mask |= Mask::POSITION_TARGET_TYPEMASK_YAW_IGNORE;
        }
        let has_height = !type_mask.contains(Mask::POSITION_TARGET_TYPEMASK_Z_IGNORE);
        let position = Vector3::new(place.x, place.y, if has_height { self.height.0 } else { 0.0 });
        MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: (demand.now.ns / 1_000_000) as u32,
            x: position.x as f32,
            y: position.y as f32,
            z: position.z as f32,
            vx: velocity.x as f32,
            vy: velocity.y as f32,
            vz: -self.climb_mps as f32,
            yaw: self.yaw_rad.unwrap_or(0.0) as f32,
            yaw_rate: finite(demand.turn_radps) as f32,
            type_mask,
            target_system: system_id,
            target_component: COMPONENT_AUTOPILOT,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
        })
    }
}

/// Heading and its rate are not given.
const HEADING: Mask =
    Mask::POSITION_TARGET_TYPEMASK_YAW_IGNORE.union(Mask::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE);

fn finite(number: f64) -> f64 {
    if number.is_finite() { number } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::{AssistedMotion, HeightLimits, MotionDemand};
    use crate::vehicle::Present;
    use jink_mavlink_link::autopilot_type::AutopilotType;
    use jink_shared_types::Timestamp;
    use mavlink::dialect::{MavMessage, SET_POSITION_TARGET_LOCAL_NED_DATA};
    use nalgebra::{Vector2, Vector3};
    use proptest::prelude::*;

    /// Masks that both autopilots were seen to fly: everything given; all but the place; each with a heading or a rate.
    const PX4_MASKS: [u16; 4] = [0, 0x400, 0x3, 0x403];
    const COPTER_MASKS: [u16; 4] = [0, 0x400, 0x7, 0x407];

    fn demand(now_s: f64, velocity: Vector2<f64>) -> MotionDemand {
        MotionDemand {
            now: Timestamp::from_seconds(now_s),
            vehicle: Present {
                position: Vector3::new(3.0, 4.0, -5.0),
                velocity: Vector3::zeros(),
                yaw_rad: 1.0,
                shift: Vector3::zeros(),
            },
            velocity,
            is_steered: velocity.norm() > 0.0,
            climb_mps: 0.0,
            turn_radps: 0.0,
            heights: HeightLimits {
                above_ground_m: None,
                above_home_m: Some(5.0),
                lowest_m: 1.0,
                highest_m: 120.0,
                unknown_descent_mps: 0.3,
            },
        }
    }

    fn sent(
        motion: &mut AssistedMotion,
        demand: &MotionDemand,
        make: AutopilotType,
    ) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
        match motion.setpoint(demand, make, 7) {
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(target) => target,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn released_sticks_hold_the_place_where_it_came_to_rest() {
        for make in [AutopilotType::Px4, AutopilotType::ArduPilot] {
            let mut motion = AssistedMotion::default();
            let moving = demand(10.0, Vector2::new(2.0, 0.0));
            assert_eq!(sent(&mut motion, &moving, make).vx, 2.0);
            assert!(motion.held.is_none());
            let mut released = demand(10.02, Vector2::zeros());
            released.vehicle.velocity = Vector3::new(1.0, 0.0, 0.0);
            let target = sent(&mut motion, &released, make);
            assert_eq!((target.vx, motion.held.is_some()), (0.0, false), "it still moves");
            let rest = demand(10.04, Vector2::zeros());
            let target = sent(&mut motion, &rest, make);
            assert_eq!((target.x, target.y, target.z), (3.0, 4.0, -5.0));
            assert_eq!(target.type_mask.bits() & 0x3ff, 0);
            // The estimator's coordinates jump: the place in the world stays.
            let mut jumped = demand(10.06, Vector2::zeros());
            jumped.vehicle.shift = Vector3::new(0.5, 0.0, 0.0);
            jumped.vehicle.position.x = 3.5;
            assert_eq!(sent(&mut motion, &jumped, make).x, 3.5);
            // Blown away, it stays where it is.
            let mut blown = jumped;
            blown.now = Timestamp::from_seconds(10.08);
            blown.vehicle.position.y = 5.5;
            assert_eq!(sent(&mut motion, &blown, make).y, 5.5);
        }
    }

    #[test]
    fn a_descent_ends_above_the_ground_and_a_climb_below_the_ceiling() {
        for (above_m, climb_mps, ends_mps) in [
            (1.0, -1.0, 0.0),
            (0.2, -1.0, 0.0),
            (120.0, 1.0, 0.0),
            (20.0, -1.0, -1.0),
        ] {
            let mut motion = AssistedMotion::default();
            let mut vz = f32::NAN;
            for i in 0..100 {
                let mut demand = demand(10.0 + 0.02 * f64::from(i), Vector2::zeros());
                demand.climb_mps = climb_mps;
                demand.heights.above_home_m = Some(above_m);
                vz = sent(&mut motion, &demand, AutopilotType::Px4).vz;
            }
            assert!((f64::from(vz) + ends_mps).abs() < 1e-6, "{above_m} m: {vz}");
        }
    }

    #[test]
    fn a_turn_is_a_rate_and_ends_at_the_heading_that_was_reached() {
        let mut motion = AssistedMotion::default();
        let mut turning = demand(10.0, Vector2::zeros());
        turning.turn_radps = 0.5;
        let target = sent(&mut motion, &turning, AutopilotType::Px4);
        assert_eq!((target.yaw_rate, target.type_mask.bits() & 0x400), (0.5, 0x400));
        for i in 1..=30 {
            let mut released = demand(10.0 + 0.02 * f64::from(i), Vector2::zeros());
            released.vehicle.yaw_rad = 1.3;
            let target = sent(&mut motion, &released, AutopilotType::Px4);
            let has_heading = target.type_mask.bits() & 0x400 == 0;
            assert_eq!(has_heading, i >= 25, "{i}");
            assert!(!has_heading || (target.yaw - 1.3).abs() < 1e-6 && target.yaw_rate == 0.0);
        }
    }

    proptest! {
        #[test]
        fn whatever_is_wanted_every_number_is_finite_and_no_axis_is_left_alone(
            steps in proptest::collection::vec(
                (0.0..0.8f64, -9.0..9.0f64, -9.0..9.0f64, prop_oneof![Just(f64::NAN), -3.0..3.0f64], -2.0..2.0f64, any::<bool>()), 1..60),
        ) {
            for (make, masks) in [(AutopilotType::Px4, PX4_MASKS), (AutopilotType::ArduPilot, COPTER_MASKS)] {
                let mut motion = AssistedMotion::default();
                let mut now_s = 10.0;
                for (passed_s, north, east, odd, turn, is_steered) in &steps {
                    now_s += passed_s;
                    let mut demand = demand(now_s, Vector2::new(*north, *odd));
                    demand.is_steered = *is_steered;
                    demand.vehicle.velocity = Vector3::new(*east, 0.0, *north * 0.1);
                    demand.climb_mps = *odd;
                    demand.turn_radps = if *turn > 1.0 { 0.0 } else { *turn };
                    let target = sent(&mut motion, &demand, make);
                    let numbers = [target.x, target.y, target.z, target.vx, target.vy, target.vz, target.yaw, target.yaw_rate];
                    prop_assert!(numbers.iter().all(|n| n.is_finite()), "{target:?}");
                    prop_assert!(masks.contains(&target.type_mask.bits()), "{:#x}", target.type_mask.bits());
                }
            }
        }
    }
}
