//! A pilot who steers through jink: his sticks become a wish, and what the guard leaves of it goes to the autopilot.
//!
//! | Position mode, in the air | sent |
//! |---|---|
//! | collision prevention switched off (CP_DIST) | nothing: the pilot flies the autopilot |
//! | sticks away from the centre, or the vehicle moving | the velocity that may be flown, fifty times a second |
//! | sticks centred and the vehicle at rest | nothing: the autopilot holds its place |
//! | the guard has fallen silent | stop |
//!
//! Sent is the horizontal velocity, with an acceleration of zero: what the autopilot would add from the sticks itself would lead past
//! it. Heights and headings stay the pilot's.

use super::Gateway;
use crate::assist::sticks::PilotSticks;
use crate::demand::Demand;
use crate::io::{Inputs, Outputs};
use crate::profile::position_target::NO_PLACE_NOR_HEADING;
use crate::vehicle::Present;
use jink_mavlink_link::message::{Body, COMPONENT_AUTOPILOT, Outgoing, Receipt};
use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::params::MPC_VEL_MANUAL;
use jink_shared_types::prevention::{PilotDemand, PreventionState};
use jink_shared_types::vehicle::NavMode;
use jink_shared_types::{Timestamp, Velocity};
use mavlink::dialect::{MavFrame, MavMessage, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA};
use nalgebra::Vector2;

/// Slower than this the vehicle counts as being at rest (m/s).
const AT_REST_MPS: f64 = 0.3;
/// The pilot's wish is sent to the guard this often (Hz), as the topic table says.
const DEMAND_RATE_HZ: f64 = 20.0;
/// A hold is asked for this often while it is needed (s).
const HOLD_EVERY_S: f64 = 1.0;

/// Horizontal velocities and accelerations, and nothing else.
const HORIZONTAL: PositionTargetTypemask = NO_PLACE_NOR_HEADING
    .union(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_VZ_IGNORE)
    .union(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_AZ_IGNORE);

/// The sticks, and what was made of them.
#[derive(Debug)]
pub(super) struct Steering {
    pub(super) sticks: PilotSticks,
    demands: Ticker,
    /// The guard's last word was that it watches over the pilot.
    is_watched: bool,
    hold_due: Timestamp,
}

impl Default for Steering {
    fn default() -> Self {
        Self {
            sticks: PilotSticks::default(),
            demands: Ticker::new(DEMAND_RATE_HZ),
            is_watched: false,
            hold_due: Timestamp::NEVER,
        }
    }
}

impl Steering {
    /// Sends the guard what the pilot wants (north, east, m/s), when that is due, and answers what it allows of it;
    /// `None`: it is silent.
    pub(super) fn ask_guard(
        &mut self,
        now: Timestamp,
        wish: Vector2<f64>,
        inputs: &Inputs<'_>,
        outputs: &mut Outputs,
    ) -> Option<(Vector2<f64>, PreventionState)> {
        if self.demands.take(now) {
            let demand = PilotDemand {
                velocity: Velocity::new(wish.x, wish.y, 0.0),
                ..PilotDemand::default()
            };
            outputs.pilot_demand = Some((demand, now));
        }
        let prevented = inputs.prevented.fresh()?;
        Some((prevented.velocity.vector().xy(), prevented.state.get()))
    }
}

impl Gateway {
    /// Whether a pilot steers through jink now.
    pub(super) fn is_steered(&self) -> bool {
        self.config.profile.steers()
            && self.vehicle.mode() == NavMode::Position
            && self.vehicle.has_taken_off()
    }

    /// Sends the guard what the pilot wants, and the autopilot what of it may be flown.
    pub(super) fn steer(&mut self, now: Timestamp, inputs: &Inputs<'_>, outputs: &mut Outputs) {
        let (Some(system_id), Some(vehicle)) = (self.selector.system_id(now), self.vehicle.present(now))
        else {
            return;
        };
        let full_mps = self.params().get(&MPC_VEL_MANUAL);
        let wish = self.steering.sticks.velocity(now, vehicle.yaw_rad, full_mps);
        let (velocity, state) = match self.steering.ask_guard(now, wish, inputs, outputs) {
            Some((allowed, state)) => {
                self.steering.is_watched = state != PreventionState::Off;
                (allowed, state)
            }
            None => (Vector2::zeros(), PreventionState::Blind),
        };
        let is_beat = self.setpoints.take(now);
        if !self.steering.is_watched || !is_beat {
            return;
        }
        if state == PreventionState::Hold && now >= self.steering.hold_due {
            self.steering.hold_due = now.plus_seconds(HOLD_EVERY_S);
            self.demand(now, Demand::Hold, outputs);
        }
        if is_at_rest(&vehicle) && wish == Vector2::zeros() {
            return;
        }
        self.last_setpoint = now;
        let message = horizontal(now, system_id, velocity);
        outputs.send(Outgoing {
            receipt: Receipt::Setpoint { first_of: None },
            ..self.outgoing(now, Body::Message(message))
        });
    }
}

fn is_at_rest(vehicle: &Present) -> bool {
    vehicle.velocity.xy().norm() < AT_REST_MPS
}

fn horizontal(now: Timestamp, system_id: u8, velocity: Vector2<f64>) -> MavMessage {
    // What came through shared memory may be damaged: no number, no motion.
    let velocity = if velocity.iter().all(|v| v.is_finite()) {
        velocity
    } else {
        Vector2::zeros()
    };
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms: (now.ns / 1_000_000) as u32,
        vx: velocity.x as f32,
        vy: velocity.y as f32,
        type_mask: HORIZONTAL,
        target_system: system_id,
        target_component: COMPONENT_AUTOPILOT,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
    })
}
