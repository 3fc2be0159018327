//! How far current PX4 goes on after the last OFFBOARD setpoint, as measured.

use super::current::{Speech, cruise_north, enter_offboard, lift, travel_north, with_drag};
use super::tracking_current::{HEAVY, LIGHT};

/// One loss of the stream under way.
pub struct Case {
    /// What follows the loss.
    pub name: &'static str,
    parameters: &'static [(&'static str, f64)],
    speed: f64,
    speech: Speech,
    sticks: bool,
    drag: f64,
    /// Way north of the last setpoint (m).
    pub observed: f64,
}

/// How far the emulator goes on (m).
pub fn travel(case: &Case) -> f64 {
    let mut flight = with_drag(case.drag, case.parameters);
    lift(&mut flight);
    enter_offboard(&mut flight);
    cruise_north(&mut flight, case.speed, case.speech, case.sticks);
    travel_north(&mut flight, case.sticks)
}

/// All that was measured.
pub fn cases() -> Vec<Case> {
    const HOLD: &[(&str, f64)] = &[("COM_OBL_RC_ACT", 5.0)];
    const HOLD_SOON: &[(&str, f64)] = &[("COM_OBL_RC_ACT", 5.0), ("COM_OF_LOSS_T", 0.3)];
    let case = |name, parameters, speed, observed| Case {
        name,
        parameters,
        speed,
        speech: Speech::Everything,
        sticks: false,
        drag: LIGHT,
        observed,
    };
    vec![
        case("RTL from 4.5 m/s", &[], 4.5, 5.4),
        Case {
            sticks: true,
            ..case("POSCTL from 4.5 m/s", &[], 4.5, 5.8)
        },
        case("LOITER from 4.5 m/s", HOLD, 4.5, 7.3),
        case("LOITER after 0.3 s from 4.5 m/s", HOLD_SOON, 4.5, 7.9),
        Case {
            speech: Speech::Velocity,
            ..case("LOITER from 4.5 m/s, velocity alone", HOLD, 4.5, 11.2)
        },
        case("LOITER from 8 m/s", HOLD, 8.0, 14.6),
        case("LOITER after 0.3 s from 8 m/s", HOLD_SOON, 8.0, 18.2),
        Case {
            drag: HEAVY,
            ..case("RTL from 4.8 m/s, heavy drag", &[], 4.8, 7.0)
        },
    ]
}
