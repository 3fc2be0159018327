//! A pilot who is assisted, in lock-step: PX4's sticks by MANUAL_CONTROL, ArduCopter's by RC_CHANNELS_OVERRIDE.
//!
//! PX4's pilot chooses assisted flight by a command, ArduCopter's by a switch.
// A harness for tests: without its flight there is nothing to test.
#![allow(clippy::expect_used, clippy::panic)]

use crate::lockstep::{FlightSetup, LockStep};
use crate::pairing::Pairing;
use jink_emulated_ground_station::{Make, Phase};
use jink_mavlink_link::message::COMPONENT_AVOIDANCE;
use jink_shared_types::link::AssistState;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{
    COMMAND_LONG_DATA, MANUAL_CONTROL_DATA, MavCmd, MavMessage, RC_CHANNELS_OVERRIDE_DATA,
};

/// Between two messages of the sticks (s).
const STICKS_PERIOD_S: f64 = 0.05;
/// ArduCopter takes overrides from this system only.
const PILOT: f64 = 254.0;
/// Channel of the switch.
const SWITCH: f64 = 6.0;
/// He takes over at this height (m).
const HEIGHT_M: f64 = 1.8;
/// What a pilot waits for happens within this time (s).
const PATIENCE_S: f64 = 60.0;

/// Forward, right, up, turn right, -1 to 1 each.
pub type Sticks = [f64; 4];
/// Let go of.
pub const CENTRED: Sticks = [0.0; 4];

/// The pilot.
#[derive(Clone, Copy, Debug)]
pub struct AssistedPilot {
    make: Make,
    pairing: Pairing,
    is_switched_on: bool,
    /// His remote control is on.
    pub is_received: bool,
    next_s: f64,
}

impl AssistedPilot {
    /// Takes off in the forest of `seed`, as `change` sets it up, and flies by hand at its edge.
    ///
    /// # Panics
    /// If that does not succeed.
    pub fn take_off(pairing: Pairing, seed: u64, change: impl FnOnce(&mut FlightSetup)) -> (LockStep, Self) {
        let mut setup = pairing.forest(seed).expect("a forest");
        setup.plan.resume = false;
        setup.takes_missions = false;
        let parameters: &[(&str, f64)] = match pairing.make {
            Make::Px4 => &[("MAN_OVERRIDE_SPD", -1.0)],
            Make::ArduCopter => &[("MAV_GCS_SYSID", PILOT)],
        };
        for (name, value) in parameters {
            setup.autopilot = setup.autopilot.with_parameter(name, *value);
        }
        let mut ours = vec![
            ("CP_DIST", 1.5),
            ("MPC_VEL_MANUAL", 6.0),
            ("OA_ASSIST_CH", SWITCH),
        ];
        if pairing.make == Make::ArduCopter {
            // As ArduCopter shapes velocities: WPNAV_ACCEL, PSC_JERK_XY.
            ours.extend([("MPC_ACC_HOR", 2.5), ("MPC_JERK_MAX", 5.0)]);
        }
        for (name, value) in ours {
            setup.params.set(name, value).expect("a parameter of jink's");
        }
        change(&mut setup);
        let mut flight = LockStep::new(setup).expect("a flight");
        let mut pilot = Self {
            make: pairing.make,
            pairing,
            is_switched_on: false,
            is_received: true,
            next_s: 0.0,
        };
        let begin_s = flight.truth().time_s;
        while flight.station().progress().phase != Phase::Mission || flight.truth().mode != NavMode::Mission {
            pilot.step(&mut flight, CENTRED);
            assert!(flight.truth().time_s - begin_s < PATIENCE_S, "it never took off");
        }
        // ArduCopter takes off in its mission.
        while -flight.truth().position.z_m < HEIGHT_M {
            pilot.step(&mut flight, CENTRED);
            assert!(flight.truth().time_s - begin_s < PATIENCE_S, "it never climbed");
        }
        // From here on only the pilot commands.
        flight.silent_station = true;
        pilot.change_mode(&mut flight, NavMode::Position);
        pilot.fly(&mut flight, 3.0, |_, _| CENTRED);
        (flight, pilot)
    }

    /// 4 ms, with the sticks there.
    pub fn step(&mut self, flight: &mut LockStep, sticks: Sticks) {
        flight.step();
        let now_s = flight.truth().time_s;
        if self.is_received && now_s >= self.next_s {
            self.next_s = now_s + STICKS_PERIOD_S;
            flight.send(self.message(sticks));
        }
    }

    /// Flies for so long (s), the sticks where `sticks` says at a time since then (s). The smallest clearance on the way (m).
    pub fn fly(
        &mut self,
        flight: &mut LockStep,
        seconds: f64,
        mut sticks: impl FnMut(&mut LockStep, f64) -> Sticks,
    ) -> f64 {
        let (begin_s, mut nearest_m) = (flight.truth().time_s, f64::INFINITY);
        loop {
            let time_s = flight.truth().time_s - begin_s;
            if time_s >= seconds {
                return nearest_m;
            }
            let sticks = sticks(flight, time_s);
            self.step(flight, sticks);
            nearest_m = nearest_m.min(flight.truth().clearance_m);
        }
    }

    /// Changes the mode on his remote control.
    pub fn change_mode(&mut self, flight: &mut LockStep, mode: NavMode) {
        self.pairing.command_mode(flight, mode);
    }

    /// Chooses assisted flight, or switches it off.
    pub fn choose(&mut self, flight: &mut LockStep, on: bool) {
        self.is_switched_on = on;
        if self.make == Make::Px4 {
            flight.send(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                command: MavCmd::MAV_CMD_USER_1,
                param1: f32::from(u8::from(on)),
                target_system: 1,
                target_component: COMPONENT_AVOIDANCE,
                ..COMMAND_LONG_DATA::default()
            }));
        }
    }

    /// Chooses it, and waits until he is assisted.
    ///
    /// # Panics
    /// If he is not.
    pub fn engage(&mut self, flight: &mut LockStep) {
        self.choose(flight, true);
        self.fly(flight, 1.5, |_, _| CENTRED);
        assert_eq!(flight.assist(), AssistState::On, "{:?}", flight.events.last());
        assert_eq!(flight.truth().mode, NavMode::Offboard);
    }

    fn message(&self, [forward, right, up, turn]: Sticks) -> MavMessage {
        let thousandths = |share: f64| (share * 1000.0) as i16;
        let pulse_us = |share: f64| (1500.0 + 500.0 * share) as u16;
        match self.make {
            Make::Px4 => MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
                x: thousandths(forward),
                y: thousandths(right),
                z: thousandths(0.5 + 0.5 * up),
                r: thousandths(turn),
                target: 1,
                ..MANUAL_CONTROL_DATA::default()
            }),
            Make::ArduCopter => MavMessage::RC_CHANNELS_OVERRIDE(RC_CHANNELS_OVERRIDE_DATA {
                chan1_raw: pulse_us(right),
                chan2_raw: pulse_us(-forward),
                chan3_raw: pulse_us(up),
                chan4_raw: pulse_us(turn),
                chan5_raw: u16::MAX,
                chan6_raw: if self.is_switched_on { 2000 } else { 1000 },
                chan7_raw: u16::MAX,
                chan8_raw: u16::MAX,
                target_system: 1,
                target_component: 1,
                ..RC_CHANNELS_OVERRIDE_DATA::default()
            }),
        }
    }
}
