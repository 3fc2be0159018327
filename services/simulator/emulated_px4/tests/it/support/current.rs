//! Flights of current PX4 with a scripted companion in OFFBOARD.

use super::tracking_current::LIGHT;
use super::{Answer, Flight, north_east};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::{Link, script};
use jink_emulated_px4::Px4Config;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;
use nalgebra::Vector3;

/// Bits of the type mask: position, velocity, acceleration, heading rate are ignored.
pub const NO_POSITION: u16 = 0x007;
pub const NO_VELOCITY: u16 = 0x038;
pub const NO_ACCELERATION: u16 = 0x1c0;
pub const NO_YAW_RATE: u16 = 0x800;

/// On the ground, before the first step: light drag, no companion's heartbeat, nobody answers.
pub fn on_ground(parameters: &[(&str, f64)]) -> Flight {
    with_drag(LIGHT, parameters)
}

/// The same with another drag (N/(m/s)).
pub fn with_drag(drag: f64, parameters: &[(&str, f64)]) -> Flight {
    let mut config = Px4Config::current(drag);
    let own = parameters.iter().map(|(n, v)| ((*n).to_owned(), *v));
    config.parameters.extend(own);
    let mut flight = Flight::new(config);
    flight.heartbeat = None;
    flight.answer = Answer::Silent;
    flight
}

/// In Hold 5 m up, at rest, armed without sticks.
pub fn holding(parameters: &[(&str, f64)]) -> Flight {
    let mut flight = on_ground(parameters);
    lift(&mut flight);
    flight
}

/// From the ground to Hold 5 m up.
pub fn lift(flight: &mut Flight) {
    let real = MavParamType::MAV_PARAM_TYPE_REAL32;
    let height = script::parameter("MIS_TAKEOFF_ALT", 5.0, real);
    flight.from(Link::GroundStation, 255, 190, height);
    flight.run(2.5);
    assert_eq!(flight.set_mode(NavMode::Hold), MavResult::MAV_RESULT_ACCEPTED);
    flight.take_off();
}

/// A setpoint with everything the mask does not ignore.
pub fn setpoint(position: [f64; 3], velocity: [f64; 3], mask: u16) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
    script::setpoint(mask, [position.into(), velocity.into(), Vector3::zeros()])
}

/// A place to stay at.
pub fn place(position: [f64; 3]) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
    setpoint(position, [0.0; 3], NO_VELOCITY | NO_ACCELERATION | NO_YAW_RATE)
}

/// Where the vehicle is, as a place to stay at.
pub fn here(flight: &Flight) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
    let position = flight.autopilot.truth().position;
    place([position.x_m, position.y_m, position.z_m])
}

/// Sends `setpoint` every `interval_s` for `seconds`.
pub fn stream(
    flight: &mut Flight,
    setpoint: &SET_POSITION_TARGET_LOCAL_NED_DATA,
    interval_s: f64,
    seconds: f64,
) {
    let end_s = flight.now_s() + seconds;
    while flight.now_s() < end_s - 1e-9 {
        send(flight, setpoint);
        flight.run(interval_s.min(end_s - flight.now_s()));
    }
}

/// Queues one setpoint from the companion.
pub fn send(flight: &mut Flight, setpoint: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
    flight.companion(196, MavMessage::SET_POSITION_TARGET_LOCAL_NED(setpoint.clone()));
}

/// In OFFBOARD, staying where it is, the stream having run at 20 Hz until now.
pub fn staying(parameters: &[(&str, f64)]) -> Flight {
    let mut flight = holding(parameters);
    enter_offboard(&mut flight);
    flight
}

/// From Hold into OFFBOARD at the same place.
pub fn enter_offboard(flight: &mut Flight) {
    let here = here(flight);
    send(flight, &here);
    flight.step();
    assert_eq!(flight.set_mode(NavMode::Offboard), MavResult::MAV_RESULT_ACCEPTED);
    stream(flight, &here, 0.05, 2.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
}

/// What a moving companion sends.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Speech {
    /// Position, velocity and acceleration.
    Everything,
    /// Velocity alone.
    Velocity,
}

/// Takes a flight in OFFBOARD to `speed` (m/s) north within 3 s and keeps it for 8 s, at 50 Hz. The last setpoint has just been
/// taken when it returns.
pub fn cruise_north(flight: &mut Flight, speed: f64, speech: Speech, sticks: bool) {
    const RAMP_S: f64 = 3.0;
    let start = flight.autopilot.truth().position;
    for i in 0..550 {
        let t = f64::from(i) * 0.02;
        let share = (t / RAMP_S).min(1.0);
        let (v, a) = (speed * share, if t < RAMP_S { speed / RAMP_S } else { 0.0 });
        let s = if t < RAMP_S {
            speed * t * share / 2.0
        } else {
            speed * (t - RAMP_S / 2.0)
        };
        let mask = match speech {
            Speech::Everything => NO_YAW_RATE,
            Speech::Velocity => NO_POSITION | NO_ACCELERATION | NO_YAW_RATE,
        };
        let mut point = setpoint([start.x_m + s, start.y_m, start.z_m], [v, 0.0, 0.0], mask);
        point.afx = a as f32;
        if sticks {
            stick(flight, 0);
        }
        send(flight, &point);
        flight.run(if i == 549 { 0.004 } else { 0.02 });
    }
}

/// Queues a stick message, `forward` of 1000.
pub fn stick(flight: &mut Flight, forward: i16) {
    let message = MANUAL_CONTROL_DATA {
        x: forward,
        z: 500,
        target: 1,
        ..MANUAL_CONTROL_DATA::default()
    };
    flight.from(Link::GroundStation, 255, 190, MavMessage::MANUAL_CONTROL(message));
}

/// Runs for `seconds` with centred sticks at 20 Hz if `sticks`, and watches.
pub fn watch(flight: &mut Flight, seconds: f64, sticks: bool, mut look: impl FnMut(&Flight)) {
    for step in 0..(seconds * super::STEPS_PER_S) as usize {
        if sticks && step % 12 == 0 {
            stick(flight, 0);
        }
        flight.step();
        look(flight);
    }
}

/// How far north the vehicle goes from now on (m), at most, before it turns back.
pub fn travel_north(flight: &mut Flight, sticks: bool) -> f64 {
    let start = north_east(flight).0;
    let mut furthest = start;
    watch(flight, 12.0, sticks, |f| furthest = furthest.max(north_east(f).0));
    furthest - start
}

/// Asks for a message of the companion's link at an interval (s).
pub fn ask_for(flight: &mut Flight, id: u32, interval_s: f64) -> MavResult {
    let message = script::message_interval(id, (interval_s * 1e6) as f32);
    flight.companion(196, message);
    for _ in 0..10 {
        flight.step();
        let command = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
        if let Some(result) = script::result_of(&flight.received, Link::Companion, command) {
            return result;
        }
    }
    panic!("no acknowledgement");
}

/// The modes that the companion's link reports in this step: in force and intended.
pub fn reported_modes(flight: &Flight) -> Option<(NavMode, NavMode)> {
    let mode =
        |custom| jink_emulated_autopilot::modes::px4::mode_of_custom(custom).unwrap_or(NavMode::Unknown);
    flight.received.iter().find_map(|p| match &p.message {
        MavMessage::CURRENT_MODE(m) if p.link == Link::Companion => {
            Some((mode(m.custom_mode), mode(m.intended_custom_mode)))
        }
        _ => None,
    })
}
