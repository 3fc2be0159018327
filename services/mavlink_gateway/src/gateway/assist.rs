//! Assisted flight in the gateway: what [`Assist`] sees, and what becomes of its intents.

use super::Gateway;
use super::mission::MissionFlight;
use crate::assist::facts::AutopilotFacts;
use crate::assist::motion::{AssistedMotion, HeightLimits, MotionDemand};
use crate::assist::record::AssistRecord;
use crate::assist::sticks::channels_us;
use crate::assist::switch::Switch;
use crate::assist::{Assist, AssistScene, ModeRequest};
use crate::avoidance::ranges_flow;
use crate::demand::Demand;
use crate::io::{Inputs, Outputs};
use crate::landed_state::LandedState;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::message::{Body, COMPONENT_AUTOPILOT, Outgoing, Receipt};
use jink_shared_types::Timestamp;
use jink_shared_types::link::AssistState;
use jink_shared_types::params::{
    CP_DIST, MPC_VEL_MANUAL, OA_ALT_MAX, OA_ALT_MIN, OA_ASSIST_CH, OA_ASSIST_YAW, OA_SPD_CLIMB, OA_SPD_DESC,
};
use jink_shared_types::prevention::PreventionState;
use jink_shared_types::vehicle::NavMode;
use mavlink::MessageData;
use mavlink::dialect::{
    COMMAND_LONG_DATA, MANUAL_CONTROL_DATA, MavAutopilot, MavCmd, MavMessage, MavModeFlag, PARAM_VALUE_DATA,
    RC_CHANNELS_DATA,
};
use nalgebra::Vector2;

/// The sticks have to come this often (Hz).
const STICKS_HZ: f64 = 20.0;
/// The switch does where it is not among the sticks.
const SWITCH_HZ: f64 = 5.0;
/// Fastest descent while nobody knows the height (m/s): slower than a landing.
const UNKNOWN_DESCENT_MPS: f64 = 0.3;

/// Everything about assisted flight.
#[derive(Clone, Debug, Default)]
pub(super) struct AssistedFlight {
    assist: Assist,
    motion: AssistedMotion,
    facts: AutopilotFacts,
    switch: Switch,
}

impl AssistedFlight {
    /// Somebody chooses it, or switches it off.
    ///
    /// # Errors
    /// A word for what prevents it.
    pub(super) fn choose(&mut self, on: bool) -> Result<(), &'static str> {
        self.assist.choose(on)
    }

    /// Setpoints are its own.
    pub(super) fn streams(&self) -> bool {
        self.assist.streams()
    }

    /// The autopilot has refused a mode.
    pub(super) fn note_refusal(&mut self) {
        self.assist.note_refusal();
    }

    /// For the figures.
    pub(super) fn state(&self) -> AssistState {
        self.assist.state()
    }

    /// What the next gateway has to know, while the autopilot follows this.
    pub(super) fn record(&self) -> Option<AssistRecord> {
        let pilots_mode = self.assist.pilots_mode()?;
        Some(AssistRecord {
            pilots_mode,
            calibration: self.facts.calibration().copied(),
        })
    }

    /// Goes on where the gateway before has stopped.
    pub(super) fn resume(&mut self, now: Timestamp, record: &AssistRecord) {
        self.assist.resume(now, record.pilots_mode);
        self.facts = AutopilotFacts::with_calibration(record.calibration);
    }

    /// Takes what the autopilot reports of a parameter.
    pub(super) fn take_parameter(&mut self, autopilot: MavAutopilot, reported: &PARAM_VALUE_DATA) {
        self.facts.take(autopilot, reported);
    }

    /// When its next question to the autopilot is due.
    fn next_wake(&self, make: AutopilotType) -> Option<Timestamp> {
        self.facts.next_wake(make)
    }
}

impl Gateway {
    /// Takes the remote control's channels: ArduPilot's sticks, and the switch.
    pub(super) fn take_channels(&mut self, channels: &RC_CHANNELS_DATA, received: Timestamp) {
        if self.config.profile.autopilot_type() == AutopilotType::ArduPilot
            && let Some(calibration) = self.assist.facts.calibration()
        {
            self.steering
                .sticks
                .take_channels(channels, calibration, received);
        }
        let number = self.params().get(&OA_ASSIST_CH) as usize;
        let raw_us = number
            .checked_sub(1)
            .and_then(|index| channels_us(channels).get(index).copied().flatten());
        if let Some(on) = self.assist.switch.take(raw_us) {
            // What prevents it is reported in the next step.
            let _reported = self.assist.choose(on);
        }
    }

    /// Whether the profile assists pilots, and somebody has set jink up for it: collision prevention is on, or there is a switch.
    fn may_assist(&self) -> bool {
        let is_on = |row| self.params().get(row) > 0.0;
        self.config.profile.assists() && (is_on(&CP_DIST) || is_on(&OA_ASSIST_CH))
    }

    /// When it has something to ask next.
    pub(super) fn assist_wake(&self) -> Option<Timestamp> {
        let make = self
            .vehicle
            .make()
            .filter(|_| self.may_assist() && self.was_alive)?;
        self.assist.next_wake(make)
    }

    /// One step of it: asks for what is needed to be ready for it, and for the modes.
    pub(super) fn run_assist(&mut self, now: Timestamp, inputs: &Inputs<'_>, outputs: &mut Outputs) {
        // Before the first heartbeat the modes' numbers mean nothing: until then what was resumed goes on.
        let Some((system_id, make)) = self.selector.system_id(now).zip(self.vehicle.make()) else {
            return;
        };
        if self.may_assist() && self.was_alive {
            self.prepare_assist(now, make, system_id, outputs);
        }
        let guard = inputs.prevented.fresh().map(|prevented| prevented.state.get());
        let custom_mode = self.vehicle.custom_mode();
        let scene = AssistScene {
            now,
            mode: self.vehicle.mode(),
            custom_mode,
            is_pilots_mode: make.is_pilots_mode(custom_mode),
            is_armed: self.vehicle.is_armed(),
            in_air: self.vehicle.has_taken_off(),
            has_landed: self.vehicle.landed_state() == LandedState::OnGround,
            fits: self.config.profile.assists() && self.profile_fits() && self.was_alive,
            keeps_distance: self.params().get(&CP_DIST) > 0.0,
            hindrance: self.assist.facts.hindrance(make),
            sticks_age_s: self.steering.sticks.age_s(now),
            is_level: self.steering.sticks.up(now) == 0.0,
            sees: ranges_flow(now, inputs.ring),
            guard,
            is_ending: self.controlled_stop.is_some(),
            is_on_mission: self.mission.as_ref().is_some_and(MissionFlight::wants_a_plan),
        };
        let streamed = self.assist.streams();
        let intent = self.assist.assist.step(&scene);
        if streamed != self.assist.streams() {
            self.assist.motion = AssistedMotion::default();
        }
        match intent.request {
            Some(ModeRequest::Follow) => self.demand(now, Demand::Follow, outputs),
            Some(ModeRequest::Hold) => self.demand(now, Demand::Hold, outputs),
            Some(ModeRequest::Pilots(custom_mode)) => {
                self.mode_choice.ask(now);
                let command = mode_command(make.numbers_of(custom_mode), system_id);
                outputs.send(self.outgoing(now, Body::Message(command)));
            }
            None => {}
        }
        if let Some(text) = intent.text {
            if text.event.id == jink_shared_types::events::ASSIST_REFUSED.id {
                self.assist.facts.ask_again(now);
            }
            Self::notify_pilot(&text, outputs);
        }
    }

    /// Has the sticks and the switch come, and asks for parameters.
    fn prepare_assist(&mut self, now: Timestamp, make: AutopilotType, system_id: u8, outputs: &mut Outputs) {
        match make {
            AutopilotType::Px4 => {
                self.streams.need_sticks(MANUAL_CONTROL_DATA::ID, STICKS_HZ);
                if self.params().get(&OA_ASSIST_CH) > 0.0 {
                    self.streams.need_sticks(RC_CHANNELS_DATA::ID, SWITCH_HZ);
                }
            }
            AutopilotType::ArduPilot => self.streams.need_sticks(RC_CHANNELS_DATA::ID, STICKS_HZ),
        }
        if let Some(question) = self
            .assist
            .facts
            .question(now, make, (system_id, COMPONENT_AUTOPILOT))
        {
            outputs.send(self.outgoing(now, Body::Message(question)));
        }
    }

    /// The setpoint of an assisted flight, when it is due.
    pub(super) fn fly_assisted(&mut self, now: Timestamp, inputs: &Inputs<'_>, outputs: &mut Outputs) {
        let (Some(system_id), Some(vehicle)) = (self.selector.system_id(now), self.vehicle.present(now))
        else {
            return;
        };
        // That of the profile, which fits: a gateway that is started again in flight does not wait for a heartbeat.
        let make = self.config.profile.autopilot_type();
        let params = self.params();
        let [full_mps, climb_mps, descent_mps] =
            [&MPC_VEL_MANUAL, &OA_SPD_CLIMB, &OA_SPD_DESC].map(|row| params.get(row));
        let full_radps = params.get(&OA_ASSIST_YAW).to_radians();
        let [above_ground_m, above_home_m] = self.vehicle.heights_m(now);
        let heights = HeightLimits {
            above_ground_m,
            above_home_m,
            lowest_m: params.get(&OA_ALT_MIN),
            highest_m: params.get(&OA_ALT_MAX),
            unknown_descent_mps: UNKNOWN_DESCENT_MPS,
        };
        let is_steered = self.assist.assist.follows_sticks() && self.controlled_stop.is_none();
        let (wish, up, turn) = match is_steered {
            true => {
                let sticks = &self.steering.sticks;
                let wish = sticks.velocity(now, vehicle.yaw_rad, full_mps);
                (wish, sticks.up(now), sticks.turn(now))
            }
            false => (Vector2::zeros(), 0.0, 0.0),
        };
        let allowed = self.steering.ask_guard(now, wish, inputs, outputs);
        if !self.setpoints.take(now) {
            return;
        }
        // Where nobody watches nothing is flown.
        let (velocity, is_watched) = match allowed {
            Some((velocity, PreventionState::Free | PreventionState::Acting)) => (velocity, true),
            _ => (Vector2::zeros(), false),
        };
        let demand = MotionDemand {
            now,
            vehicle,
            velocity,
            is_steered: is_watched && wish != Vector2::zeros(),
            climb_mps: up * if up > 0.0 { climb_mps } else { descent_mps },
            turn_radps: turn * full_radps,
            heights,
        };
        let message = self.assist.motion.setpoint(&demand, make, system_id);
        self.last_setpoint = now;
        outputs.send(Outgoing {
            receipt: Receipt::Setpoint { first_of: None },
            ..self.outgoing(now, Body::Message(message))
        });
    }

    /// The mode as missions see it: a pilot who is assisted flies by hand.
    pub(super) fn mode_for_missions(&self) -> NavMode {
        match self.assist.streams() {
            true => NavMode::Position,
            false => self.vehicle.mode(),
        }
    }
}

fn mode_command((main, sub): (u32, u32), target_system: u8) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1: f32::from(MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.bits()),
        param2: main as f32,
        param3: sub as f32,
        command: MavCmd::MAV_CMD_DO_SET_MODE,
        target_system,
        target_component: COMPONENT_AUTOPILOT,
        ..COMMAND_LONG_DATA::default()
    })
}
