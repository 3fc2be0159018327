//! A pilot who flies by hand, in PX4's Position mode.

use crate::lockstep::LockStep;
use crate::pairing::PX4_DEVIATION;
use jink_shared_types::vehicle::NavMode;
use jink_simulator::ground_station::Phase;
use mavlink::dialects::ardupilotmega::{MANUAL_CONTROL_DATA, MavMessage};

/// Between two messages of the sticks (s).
const STICKS_PERIOD_S: f64 = 0.05;

/// Sticks at `[forward, right]`, of 1000 each.
pub fn sticks([x, y]: [i16; 2]) -> MavMessage {
    MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
        x,
        y,
        z: 500,
        target: 1,
        ..MANUAL_CONTROL_DATA::default()
    })
}

/// Flies the mission until it is under way, then by hand for so long: `stick` says where to, of 1000, at a time since then (s). The
/// smallest clearance on the way (m).
///
/// # Panics
/// If the mission ends before it is under way.
pub fn by_hand(
    flight: &mut LockStep,
    seconds: f64,
    mut stick: impl FnMut(&mut LockStep, f64) -> [i16; 2],
) -> f64 {
    let (mut from_s, mut next_s, mut nearest_m) = (None, 0.0, f64::INFINITY);
    loop {
        flight.step();
        let truth = *flight.truth();
        let was_under_way = from_s.is_some() || truth.mode == NavMode::Mission;
        if flight.station().progress().phase != Phase::Mission || !was_under_way {
            assert_eq!(flight.outcome(), None, "it never was under way");
            continue;
        }
        let time_s = truth.time_s - *from_s.get_or_insert(truth.time_s);
        if time_s >= seconds {
            return nearest_m;
        }
        if truth.time_s >= next_s {
            next_s = truth.time_s + STICKS_PERIOD_S;
            // What jink has asked for stays.
            if !matches!(truth.mode.get(), NavMode::Position | NavMode::Hold) {
                PX4_DEVIATION.command_mode(flight, NavMode::Position);
            }
            let place = stick(flight, time_s);
            flight.send(sticks(place));
        }
        nearest_m = nearest_m.min(truth.clearance_m);
    }
}
