//! The references on which ArduCopter's tracking and stopping were measured, flown by the emulator.
//!
//! References are those of the PX4 table ([`reference`](jink_emulated_autopilot::reference)). Errors are horizontal
//! distances to where the reference is at that time; cross is the distance to the nearest point of its path.

use super::STEPS_PER_S;
use super::copter::{
    CopterFlight, POSITION, POSITION_VELOCITY, PVA, VELOCITY, VELOCITY_ACCELERATION, at, level, setpoint,
};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::reference::{self, COUNT_TO_S, Reference, STOP_WATCHED_S, wave};
use nalgebra::Vector3;

/// How old a position is when a script has received it (s). Fitted, the same for every row: at 2 m/s on a straight line nothing
/// else is left of the error.
const POSITION_AGE_S: f64 = 0.01;

/// WPNAV_ACCEL and jerk of the column "fast".
pub const FAST: &[(&str, f64)] = &[("WPNAV_ACCEL", 500.0), ("PSC_JERK_XY", 20.0)];
/// Limits wide enough for 8 m/s, 3 m, 40 m.
pub const WIDE: &[(&str, f64)] = &[
    ("WPNAV_ACCEL", 900.0),
    ("PSC_JERK_XY", 20.0),
    ("ANGLE_MAX", 4_500.0),
    ("WPNAV_SPEED", 1_500.0),
];
/// Defaults.
pub const DEFAULT: &[(&str, f64)] = &[];

/// How the reference is sent.
#[derive(Clone, Copy)]
pub struct Sender {
    /// `type_mask`.
    pub mask: u16,
    /// Rate (Hz).
    pub rate_hz: f64,
    /// How far ahead the position is sent (s).
    pub position_ahead_s: f64,
    /// How far ahead the rest is sent (s).
    pub rest_ahead_s: f64,
}

const fn sender(mask: u16) -> Sender {
    Sender {
        mask,
        rate_hz: 50.0,
        position_ahead_s: 0.0,
        rest_ahead_s: 0.0,
    }
}

const fn ahead(position_ahead_s: f64, rest_ahead_s: f64) -> Sender {
    Sender {
        position_ahead_s,
        rest_ahead_s,
        ..sender(PVA)
    }
}

/// What was flown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// Distance to the reference, median (m).
    pub p50: f64,
    /// And largest (m).
    pub max: f64,
    /// Largest distance to the path (m).
    pub cross_max: f64,
}

/// A row of the tracking table.
pub struct Row {
    /// What is sent.
    pub name: &'static str,
    sender: Sender,
    parameters: &'static [(&'static str, f64)],
    /// What is flown.
    pub reference: Reference,
    /// p50 and max; cross max where it was noted, else NaN (m).
    pub observed: Errors,
    /// Why the emulator may differ by more than the tests allow; empty = it does not.
    pub apart: &'static str,
}

/// Flies the reference from `from_s` to `to_s` and returns the positions, 50 a second.
fn fly(
    flight: &mut CopterFlight,
    sender: Sender,
    reference: &Reference,
    from_s: f64,
    to_s: f64,
) -> Vec<(f64, Vector3<f64>)> {
    let every = (STEPS_PER_S / sender.rate_hz).round() as usize;
    let mut track = Vec::new();
    for step in 0..((to_s - from_s) * STEPS_PER_S) as usize {
        let t = from_s + step as f64 / STEPS_PER_S;
        if step % every == 0 {
            let rest_s = t + sender.rest_ahead_s;
            flight.companion(setpoint(
                sender.mask,
                reference.position(t + sender.position_ahead_s),
                reference.velocity(rest_s),
                reference.acceleration(rest_s),
            ));
        }
        if step % 5 == 0 {
            track.push((t + POSITION_AGE_S, flight.copter.estimate().position.vector()));
        }
        flight.step();
    }
    assert_eq!(flight.copter.aborted(), None);
    track
}

fn ready(sender: Sender, reference: &Reference, parameters: &[(&str, f64)]) -> CopterFlight {
    let mut flight = CopterFlight::airborne(parameters);
    fly(&mut flight, sender, reference, -3.0, 0.0);
    flight
}

/// The errors of a row as the emulator flies it.
pub fn tracking(row: &Row) -> Errors {
    let mut flight = ready(row.sender, &row.reference, row.parameters);
    let track = fly(&mut flight, row.sender, &row.reference, 0.0, COUNT_TO_S);
    let strays = reference::Errors::of(&row.reference, &track);
    Errors {
        p50: strays.total[0],
        max: strays.total[1],
        cross_max: strays.cross[1],
    }
}

/// The tracking table.
pub fn rows() -> Vec<Row> {
    let row = |name, sender, parameters, reference, (p50, max, cross_max)| Row {
        name,
        sender,
        parameters,
        reference,
        observed: Errors { p50, max, cross_max },
        apart: "",
    };
    let apart = |why, row: Row| Row { apart: why, ..row };
    let limits = "at the limit of jerk and lean small differences decide whether it is lost";
    let single = "one run, and the only row of its kind";
    let none = f64::NAN;
    let (straight, gentle) = (wave(2.0, 0.0, 20.0), wave(3.0, 2.0, 20.0));
    let (hard, fastest) = (wave(4.5, 2.0, 25.0), wave(8.0, 3.0, 40.0));
    let (pva, pv) = (sender(PVA), sender(POSITION_VELOCITY));
    let slow = Sender { rate_hz: 10.0, ..pva };
    vec![
        row("pva", pva, DEFAULT, straight, (0.02, 0.08, none)),
        row("pva", pva, DEFAULT, gentle, (0.13, 0.21, 0.12)),
        row("pva", pva, DEFAULT, hard, (0.18, 0.33, 0.18)),
        row("pva, fast", pva, FAST, straight, (0.02, 0.09, none)),
        row("pva, fast", pva, FAST, gentle, (0.13, 0.21, none)),
        row("pva, fast", pva, FAST, hard, (0.16, 0.32, none)),
        row("pos+vel", pv, DEFAULT, straight, (0.02, 0.09, none)),
        row("pos+vel", pv, DEFAULT, gentle, (0.61, 0.99, 0.84)),
        row("pos+vel", pv, DEFAULT, hard, (1.90, 4.24, 4.0)),
        apart(single, row("pos+vel, fast", pv, FAST, hard, (0.48, 0.75, none))),
        row(
            "pva, 0.15 s ahead",
            ahead(0.15, 0.15),
            DEFAULT,
            hard,
            (0.61, 0.67, none),
        ),
        apart(
            single,
            row(
                "pva, v and a 0.15 s ahead",
                ahead(0.0, 0.15),
                DEFAULT,
                hard,
                (0.21, 0.32, none),
            ),
        ),
        row(
            "pva, fast, 0.05 s ahead",
            ahead(0.05, 0.05),
            FAST,
            hard,
            (0.16, 0.20, none),
        ),
        row(
            "pva, fast, 0.30 s ahead",
            ahead(0.3, 0.3),
            FAST,
            hard,
            (1.31, none, none),
        ),
        row(
            "pos+vel, 0.15 s ahead",
            Sender {
                mask: POSITION_VELOCITY,
                ..ahead(0.15, 0.15)
            },
            DEFAULT,
            hard,
            (1.82, 4.01, none),
        ),
        row("pva at 10 Hz", slow, DEFAULT, hard, (0.19, 0.64, none)),
        row(
            "vel+acc",
            sender(VELOCITY_ACCELERATION),
            DEFAULT,
            hard,
            (0.28, 0.40, none),
        ),
        row("vel", sender(VELOCITY), DEFAULT, hard, (2.54, none, none)),
        row("pos", sender(POSITION), DEFAULT, hard, (8.7, none, none)),
        row("pva", pva, DEFAULT, fastest, (6.85, 8.18, 8.16)),
        apart(limits, row("pva, fast", pva, FAST, fastest, (2.54, 6.85, 3.8))),
        apart(limits, row("pva, wide", pva, WIDE, fastest, (0.28, 1.13, 0.42))),
        apart(limits, row("pos+vel", pv, DEFAULT, fastest, (3.9, 9.0, none))),
    ]
}

/// A row of the stop table.
pub struct Stop {
    /// What is sent.
    pub name: &'static str,
    sender: Sender,
    parameters: &'static [(&'static str, f64)],
    /// What is flown.
    pub reference: Reference,
    /// How far past the end (m).
    pub observed: f64,
}

/// How far past the end the emulator goes (m).
pub fn overshoot(stop: &Stop) -> f64 {
    let mut flight = ready(stop.sender, &stop.reference, stop.parameters);
    let track = fly(&mut flight, stop.sender, &stop.reference, 0.0, STOP_WATCHED_S);
    stop.reference.overshoot(&track)
}

/// The stop table.
pub fn stops() -> Vec<Stop> {
    let stop = |name, sender, parameters, speed, stop, observed| Stop {
        name,
        sender,
        parameters,
        reference: Reference {
            stop,
            ..wave(speed, 0.0, 20.0)
        },
        observed,
    };
    let (pva, pv) = (sender(PVA), sender(POSITION_VELOCITY));
    vec![
        stop("pva", pva, DEFAULT, 4.5, 2.0, 0.35),
        stop("pva", pva, DEFAULT, 4.5, 4.0, 0.44),
        stop("pva, 0.15 s ahead", ahead(0.15, 0.15), DEFAULT, 4.5, 4.0, 0.41),
        stop("pva", pva, DEFAULT, 8.0, 4.0, 0.88),
        stop("pva, fast", pva, FAST, 4.5, 2.0, 0.35),
        stop("pva, fast", pva, FAST, 4.5, 4.0, 0.38),
        stop("pva, fast", pva, FAST, 8.0, 4.0, 0.87),
        stop("pva, fast", pva, FAST, 8.0, 3.0, 0.80),
        stop("pos+vel", pv, DEFAULT, 4.5, 2.0, 1.22),
        stop("pos+vel", pv, DEFAULT, 4.5, 4.0, 2.50),
        stop("pos+vel", pv, DEFAULT, 8.0, 4.0, 9.68),
        stop("vel+acc", sender(VELOCITY_ACCELERATION), DEFAULT, 4.5, 2.0, 0.38),
    ]
}

/// What happened after something ended a flight at 4.5 m/s: positions from where it was at that moment (m).
#[derive(Clone, Copy, Debug, Default)]
pub struct After {
    /// After one second.
    pub one_s: f64,
    /// After three.
    pub three_s: f64,
    /// The furthest.
    pub max: f64,
    /// The last.
    pub last: f64,
    /// From then on slower than 0.1 m/s (s).
    pub stopped_s: f64,
}

/// Watches a flight north from now on for `seconds`, doing `act` before each step with the time since now.
pub fn watch(flight: &mut CopterFlight, seconds: f64, mut act: impl FnMut(&mut CopterFlight, f64)) -> After {
    let begin = flight.position().x;
    let mut after = After {
        max: f64::MIN,
        ..After::default()
    };
    let mut slow_since = None;
    for step in 0..(seconds * STEPS_PER_S) as usize {
        let t = step as f64 / STEPS_PER_S;
        act(flight, t);
        flight.step();
        let way = flight.position().x - begin;
        after.max = after.max.max(way);
        after.last = way;
        if (t - 1.0).abs() < 1e-9 {
            after.one_s = way;
        }
        if (t - 3.0).abs() < 1e-9 {
            after.three_s = way;
        }
        if flight.speed() < 0.1 {
            slow_since.get_or_insert(t);
        }
    }
    after.stopped_s = slow_since.unwrap_or(f64::NAN);
    after
}

/// North at 4.5 m/s for 8 s, sent as `mask` says at 50 Hz.
pub fn at_cruise(mask: u16, parameters: &[(&str, f64)]) -> CopterFlight {
    let reference = wave(4.5, 0.0, 20.0);
    let sender = sender(mask);
    let mut flight = ready(sender, &reference, parameters);
    fly(&mut flight, sender, &reference, 0.0, 8.0);
    flight
}

/// A way to fall silent at 4.5 m/s, and what was observed then: +1 s, +3 s, max, final (m).
pub struct Silence {
    /// What was sent last.
    pub name: &'static str,
    mask: u16,
    parameters: &'static [(&'static str, f64)],
    /// Acceleration in the messages of the last 0.3 s (m/s^2).
    acceleration: f64,
    /// Observed.
    pub observed: [f64; 4],
}

/// The table of streams that stop.
pub fn silences() -> Vec<Silence> {
    let silence = |name, mask, parameters, acceleration, observed| Silence {
        name,
        mask,
        parameters,
        acceleration,
        observed,
    };
    let half: &[(&str, f64)] = &[("GUID_TIMEOUT", 0.5)];
    let tenth: &[(&str, f64)] = &[("GUID_TIMEOUT", 0.1)];
    vec![
        silence("pva", PVA, DEFAULT, 0.0, [4.62, 13.65, 19.2, 13.5]),
        silence(
            "pos+vel",
            POSITION_VELOCITY,
            DEFAULT,
            0.0,
            [4.62, 13.65, 19.2, 13.5],
        ),
        silence("vel", VELOCITY, DEFAULT, 0.0, [4.64, 13.71, 19.6, 19.3]),
        silence("pva, a = +1 at last", PVA, DEFAULT, 1.0, [5.08, 17.8, 33.8, 26.5]),
        silence("pva, a = -1 at last", PVA, DEFAULT, -1.0, [4.24, 9.5, 10.2, 9.25]),
        silence("pos", POSITION, DEFAULT, 0.0, [4.10, 8.35, 8.5, 8.0]),
        silence("pva, GUID_TIMEOUT 0.5", PVA, half, 0.0, [4.56, 7.7, 7.9, 2.3]),
        silence("vel, GUID_TIMEOUT 0.5", VELOCITY, half, 0.0, [4.6, 8.2, 8.3, 8.0]),
        silence(
            "vel, GUID_TIMEOUT 0.1",
            VELOCITY,
            tenth,
            0.0,
            [4.2, 6.4, 6.4, 6.1],
        ),
    ]
}

/// What the emulator does after a silence.
pub fn fall_silent(silence: &Silence) -> After {
    let mut flight = at_cruise(silence.mask, silence.parameters);
    if silence.acceleration != 0.0 {
        let reference = wave(4.5, 0.0, 20.0);
        flight.stream(0.3, 50.0, |t| {
            let t = 8.0 + t;
            setpoint(
                silence.mask,
                reference.position(t),
                reference.velocity(t),
                level(silence.acceleration, 0.0),
            )
        });
    }
    watch(&mut flight, 25.0, |_, _| {})
}

/// A way to stop from 4.5 m/s, and what was observed: travel, end (m), time to 0.1 m/s (s; NaN not noted).
pub struct Halt {
    /// What is done.
    pub name: &'static str,
    act: fn(&mut CopterFlight, f64, f64),
    /// Observed.
    pub observed: [f64; 3],
}

/// The table of halts; `act` gets the place where it began (m north) and the time since (s).
pub fn halts() -> Vec<Halt> {
    use jink_emulated_autopilot::modes::arducopter::Mode;
    use mavlink::dialect::MavCmd;
    let halt = |name, act, observed| Halt { name, act, observed };
    vec![
        halt(
            "velocity 0 streamed",
            |flight, _, _| {
                flight.companion(setpoint(VELOCITY, at(0.0, 0.0), level(0.0, 0.0), level(0.0, 0.0)));
            },
            [6.0, 5.8, 2.7],
        ),
        halt(
            "pva \"here, v = 0\"",
            |flight, x, _| flight.companion(setpoint(PVA, at(x, 0.0), level(0.0, 0.0), level(0.0, 0.0))),
            [5.8, -0.1, 2.1],
        ),
        halt(
            "position 4.5 m ahead",
            |flight, x, t| {
                if t == 0.0 {
                    flight.companion(setpoint(
                        POSITION,
                        at(x + 4.5, 0.0),
                        level(0.0, 0.0),
                        level(0.0, 0.0),
                    ));
                }
            },
            [5.7, 4.56, f64::NAN],
        ),
        halt(
            "DO_PAUSE_CONTINUE",
            |flight, _, t| {
                if t == 0.0 {
                    flight.ask(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, [0.0; 7]);
                }
            },
            [5.9, 5.7, 2.8],
        ),
        halt(
            "LOITER, sticks centred",
            |flight, _, t| {
                flight.sticks([1_500; 4]);
                if t == 0.0 {
                    flight.set_mode(Mode::Loiter);
                }
            },
            [8.0, 7.9, 3.1],
        ),
        halt(
            "BRAKE",
            |flight, _, t| {
                if t == 0.0 {
                    flight.set_mode(Mode::Brake);
                }
            },
            [8.1, 8.1, 5.1],
        ),
    ]
}

/// What the emulator does when commanded to halt at 4.5 m/s.
pub fn come_to_rest(halt: &Halt) -> After {
    let mut flight = at_cruise(PVA, DEFAULT);
    let x = flight.position().x;
    watch(&mut flight, 15.0, |flight, t| (halt.act)(flight, x, t))
}
