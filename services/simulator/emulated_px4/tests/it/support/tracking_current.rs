//! Tracking and stopping of current PX4 in OFFBOARD, as measured on its built-in simulator with two drags.
//!
//! The references are those of [`tracking`](super::tracking): position, velocity and acceleration at 50 Hz.

use super::tracking::{Sender, airborne, errors, fly, offboard};
use jink_emulated_autopilot::reference::{Errors, Reference, STOP_AT_S, STOP_WATCHED_S, wave};
use jink_emulated_px4::Px4Config;

/// Light drag (N/(m/s)).
pub const LIGHT: f64 = 0.1;
/// The built-in simulator's own drag (N/(m/s)).
pub const HEAVY: f64 = 1.0;

/// How old a position is when a script has received it (s): fitted, the same for every row, and 5 ms less than for the older
/// figures.
const POSITION_AGE_S: f64 = 0.02;

/// A row of the tracking table.
pub struct Row {
    /// Drag (N/(m/s)).
    pub drag: f64,
    /// Velocity and acceleration are sent this far ahead (s).
    pub rest_ahead_s: f64,
    /// What is flown.
    pub reference: Reference,
    /// What was measured.
    pub observed: Errors,
}

/// The errors of a row as the emulator flies it.
pub fn tracking(row: &Row) -> Errors {
    errors(
        Px4Config::current(row.drag),
        offboard(0.0, row.rest_ahead_s),
        &row.reference,
        POSITION_AGE_S,
    )
}

/// The tracking table: light drag, then heavy drag.
pub fn rows() -> Vec<Row> {
    let row = |drag, rest_ahead_s, reference, [e50, emax, a50, amin, c50, cmax]: [f64; 6]| Row {
        drag,
        rest_ahead_s,
        reference,
        observed: Errors {
            total: [e50, emax],
            along: [a50, amin],
            cross: [c50, cmax],
        },
    };
    let straight = wave(2.0, 0.0, 20.0);
    let gentle = wave(3.0, 2.0, 20.0);
    let hard = wave(4.5, 2.0, 25.0);
    let fast = wave(8.0, 3.0, 40.0);
    vec![
        row(LIGHT, 0.0, straight, [0.09, 0.17, -0.09, -0.17, 0.02, 0.04]),
        row(LIGHT, 0.0, gentle, [0.28, 0.42, -0.16, -0.33, 0.20, 0.31]),
        row(LIGHT, 0.0, hard, [0.38, 0.61, -0.18, -0.39, 0.31, 0.51]),
        row(LIGHT, 0.15, hard, [0.21, 0.30, -0.14, -0.27, 0.14, 0.20]),
        row(LIGHT, 0.0, fast, [0.84, 1.26, -0.43, -0.80, 0.68, 1.09]),
        row(HEAVY, 0.0, straight, [0.39, 0.85, -0.39, -0.85, 0.02, 0.03]),
        row(HEAVY, 0.0, gentle, [0.85, 1.28, -0.69, -1.26, 0.26, 0.60]),
        row(HEAVY, 0.0, hard, [1.00, 1.97, -0.90, -1.97, 0.33, 0.64]),
        row(HEAVY, 0.15, hard, [0.99, 1.95, -0.84, -1.94, 0.44, 0.72]),
        row(HEAVY, 0.0, fast, [1.89, 4.37, -1.84, -4.31, 0.58, 1.07]),
    ]
}

/// A row of the stop table.
pub struct Stop {
    /// Drag (N/(m/s)).
    pub drag: f64,
    /// What is flown.
    pub reference: Reference,
    /// What was measured.
    pub observed: Stray,
}

/// How far a stop strays (m).
#[derive(Clone, Copy)]
pub struct Stray {
    /// Past the end of the reference.
    pub past_end: f64,
    /// Furthest ahead of the reference at the same time.
    pub ahead: f64,
    /// Furthest behind it.
    pub behind: f64,
}

impl Stray {
    /// In the order of the table.
    pub fn list(&self) -> [f64; 3] {
        [self.past_end, self.ahead, self.behind]
    }
}

/// How far the emulator strays, from the beginning of the stop.
pub fn stopping(stop: &Stop) -> Stray {
    let (sender, reference): (Sender, _) = (offboard(0.0, 0.0), &stop.reference);
    let mut flight = airborne(Px4Config::current(stop.drag), sender, reference);
    let track = fly(&mut flight, sender, reference, 0.0, STOP_WATCHED_S, true);
    let end = reference.position(STOP_WATCHED_S).x;
    let mut stray = Stray {
        past_end: 0.0,
        ahead: 0.0,
        behind: 0.0,
    };
    for (t, position) in track.iter().filter(|(t, _)| *t >= STOP_AT_S) {
        let lead = position.x - reference.position(*t + POSITION_AGE_S).x;
        stray.past_end = stray.past_end.max(position.x - end);
        stray.ahead = stray.ahead.max(lead);
        stray.behind = stray.behind.max(-lead);
    }
    stray
}

/// The stop table: light drag, then heavy drag.
pub fn stops() -> Vec<Stop> {
    let stop = |drag, speed, stop, [past_end, ahead, behind]: [f64; 3]| Stop {
        drag,
        reference: Reference {
            stop,
            ..wave(speed, 0.0, 20.0)
        },
        observed: Stray {
            past_end,
            ahead,
            behind,
        },
    };
    vec![
        stop(LIGHT, 4.5, 2.0, [0.18, 0.29, 0.23]),
        stop(LIGHT, 4.5, 4.0, [0.62, 0.63, 0.25]),
        stop(LIGHT, 8.0, 4.0, [0.44, 0.65, 0.43]),
        stop(HEAVY, 4.5, 2.0, [1.35, 1.35, 1.29]),
        stop(HEAVY, 4.5, 4.0, [1.29, 1.29, 1.27]),
        stop(HEAVY, 8.0, 4.0, [2.38, 2.38, 2.35]),
    ]
}
