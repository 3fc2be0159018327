//! The references on which PX4's tracking and stopping were measured, flown by the emulator.
//!
//! Errors from 5 s to 14 s: along (negative = behind) at the same time, cross against the
//! nearest point of the path. Stops: minimum jerk with the given peak deceleration, how far past the end.

use super::current::NO_YAW_RATE;
use super::{Answer, Flight, STEPS_PER_S, waypoint};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::reference::{COUNT_TO_S, Errors, LEVEL_DOWN_M, Reference, STOP_WATCHED_S, wave};
use jink_emulated_autopilot::{Link, script};
use jink_emulated_px4::Px4Config;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;
use nalgebra::Vector3;

/// How old a position is when a script has received it (s). The figures compare with the reference at the time of
/// reception; this age (telemetry cycle, UDP, interpreter) is fitted, and is the same for every row.
const POSITION_AGE_S: f64 = 0.025;
/// How the reference is sent.
#[derive(Clone, Copy)]
pub enum Sender {
    Bezier {
        ahead_s: f64,
    },
    Waypoints,
    Offboard {
        position_ahead_s: f64,
        rest_ahead_s: f64,
    },
}

fn message(sender: Sender, reference: &Reference, t: f64) -> MavMessage {
    let floats = |v: Vector3<f64>| -> [f32; 3] { [v.x as f32, v.y as f32, v.z as f32] };
    match sender {
        Sender::Bezier { ahead_s } => {
            const DURATION_S: f64 = 0.8;
            let (from, to) = (t + ahead_s, t + ahead_s + DURATION_S);
            let start = jink_shared_types::bezier::End {
                position: reference.position(from),
                velocity: reference.velocity(from),
                acceleration: reference.acceleration(from),
            };
            let points = jink_shared_types::bezier::quartic_between(
                &start,
                reference.position(to),
                reference.velocity(to),
                DURATION_S,
            );
            MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(TRAJECTORY_REPRESENTATION_BEZIER_DATA {
                time_usec: 0,
                pos_x: points.map(|p| p.x as f32),
                pos_y: points.map(|p| p.y as f32),
                pos_z: points.map(|p| p.z as f32),
                delta: [0.0, 0.0, 0.0, 0.0, DURATION_S as f32],
                pos_yaw: [0.0; 5],
                valid_points: 5,
            })
        }
        Sender::Waypoints => waypoint(
            floats(reference.position(t)),
            floats(reference.velocity(t)),
            [0.0, f32::NAN],
        ),
        Sender::Offboard {
            position_ahead_s,
            rest_ahead_s,
        } => {
            let rest_s = t + rest_ahead_s;
            let motion = [
                reference.position(t + position_ahead_s),
                reference.velocity(rest_s),
                reference.acceleration(rest_s),
            ];
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(script::setpoint(NO_YAW_RATE, motion))
        }
    }
}

/// In the air at the start of the reference, in the mode that listens to `sender`, with the vehicle at rest.
pub(super) fn airborne(mut config: Px4Config, sender: Sender, reference: &Reference) -> Flight {
    config
        .parameters
        .push(("MIS_TAKEOFF_ALT".to_owned(), -LEVEL_DOWN_M));
    let mut flight = Flight::new(config);
    // Bezier flights must never have seen a valid waypoint: stale ones would win.
    let bezier = matches!(sender, Sender::Bezier { .. });
    if bezier {
        flight.answer = Answer::Silent;
    }
    flight.run(2.5);
    flight.upload(&[[200.0, 0.0, LEVEL_DOWN_M]]);
    flight.set_mode(NavMode::Hold);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    flight.set_mode(NavMode::Takeoff);
    fly(&mut flight, sender, reference, -15.0, 0.0, bezier);
    flight.answer = Answer::Silent;
    fly(&mut flight, sender, reference, -3.0, 0.0, true);
    let mode = match sender {
        Sender::Offboard { .. } => NavMode::Offboard,
        _ => NavMode::Mission,
    };
    assert_eq!(flight.set_mode(mode), MavResult::MAV_RESULT_ACCEPTED);
    fly(&mut flight, sender, reference, -3.0, 0.0, true);
    assert_eq!(flight.autopilot.mode(), mode, "{:?}", flight.autopilot.holds());
    flight
}

/// Flies from `from_s` to `to_s` of the reference and returns the positions, 50 a second.
pub(super) fn fly(
    flight: &mut Flight,
    sender: Sender,
    reference: &Reference,
    from_s: f64,
    to_s: f64,
    talking: bool,
) -> Vec<(f64, Vector3<f64>)> {
    let every = match sender {
        Sender::Offboard { .. } => 5,
        _ => 12,
    };
    let steps = ((to_s - from_s) * STEPS_PER_S) as usize;
    let mut track = Vec::new();
    for step in 0..steps {
        let t = from_s + step as f64 / STEPS_PER_S;
        if talking && step % every == 0 {
            flight.from(Link::Companion, 1, 196, message(sender, reference, t));
        }
        if step % 5 == 0 {
            track.push((t, flight.autopilot.estimate().position.vector()));
        }
        flight.step();
    }
    track
}

/// A row of the tracking table.
pub struct Row {
    /// Stream.
    pub name: &'static str,
    sender: Sender,
    /// What is flown.
    pub reference: Reference,
    /// Along p50, along worst, cross p50, cross max (m).
    pub observed: [f64; 4],
}

/// The errors of a row as the emulator flies it (m).
pub fn tracking(row: &Row) -> [f64; 4] {
    let config = Px4Config::default();
    let errors = errors(config, row.sender, &row.reference, POSITION_AGE_S);
    [errors.along[0], errors.along[1], errors.cross[0], errors.cross[1]]
}

/// `age_s`: how old the positions are that are compared with the reference.
pub(super) fn errors(config: Px4Config, sender: Sender, reference: &Reference, age_s: f64) -> Errors {
    let mut flight = airborne(config, sender, reference);
    let track = fly(&mut flight, sender, reference, 0.0, COUNT_TO_S, true);
    let aged: Vec<_> = track.into_iter().map(|(t, at)| (t + age_s, at)).collect();
    Errors::of(reference, &aged)
}

/// How far past the end the emulator goes (m).
pub fn overshoot(stop: &Stop) -> f64 {
    let (sender, reference) = (stop.sender, &stop.reference);
    let mut flight = airborne(Px4Config::default(), sender, reference);
    let track = fly(&mut flight, sender, reference, 0.0, STOP_WATCHED_S, true);
    reference.overshoot(&track)
}

pub(super) const fn offboard(position_ahead_s: f64, rest_ahead_s: f64) -> Sender {
    Sender::Offboard {
        position_ahead_s,
        rest_ahead_s,
    }
}

/// The tracking table.
pub fn rows() -> Vec<Row> {
    let bezier = Sender::Bezier { ahead_s: 0.0 };
    let row = |name, sender, reference, observed| Row {
        name,
        sender,
        reference,
        observed,
    };
    let (straight, gentle, hard) = (wave(2.0, 0.0, 20.0), wave(3.0, 2.0, 20.0), wave(4.5, 2.0, 25.0));
    vec![
        row("Bezier", bezier, straight, [-0.02, -0.12, 0.01, 0.02]),
        row("Bezier", bezier, gentle, [-0.29, -0.51, 0.32, 0.60]),
        row("Bezier", bezier, hard, [-1.47, -3.02, 1.54, 3.80]),
        row(
            "WAYPOINTS",
            Sender::Waypoints,
            straight,
            [-0.09, -0.18, 0.02, 0.03],
        ),
        row("WAYPOINTS", Sender::Waypoints, gentle, [-0.40, -0.62, 0.31, 0.61]),
        row("WAYPOINTS", Sender::Waypoints, hard, [-1.57, -3.09, 1.47, 3.85]),
        row(
            "OFFBOARD",
            offboard(0.0, 0.0),
            straight,
            [-0.07, -0.10, 0.02, 0.03],
        ),
        row("OFFBOARD", offboard(0.0, 0.0), gentle, [-0.19, -0.29, 0.17, 0.26]),
        row("OFFBOARD", offboard(0.0, 0.0), hard, [-0.28, -0.41, 0.22, 0.33]),
        row(
            "OFFBOARD, v and a 0.15 s ahead",
            offboard(0.0, 0.15),
            hard,
            [-0.20, -0.37, 0.12, 0.20],
        ),
        row(
            "OFFBOARD, all 0.1 s ahead",
            offboard(0.1, 0.1),
            hard,
            [0.19, 0.06, 0.23, 0.35],
        ),
        row(
            "Bezier, 0.2 s ahead",
            Sender::Bezier { ahead_s: 0.2 },
            gentle,
            [0.38, 0.19, 0.34, 0.59],
        ),
    ]
}

/// A row of the stop table.
pub struct Stop {
    /// Stream.
    pub name: &'static str,
    sender: Sender,
    /// What is flown.
    pub reference: Reference,
    /// How far past the end (m).
    pub observed: f64,
}

/// The stop table.
pub fn stops() -> Vec<Stop> {
    let bezier = Sender::Bezier { ahead_s: 0.0 };
    let stop = |name, sender, speed, stop, observed| Stop {
        name,
        sender,
        reference: Reference {
            stop,
            ..wave(speed, 0.0, 20.0)
        },
        observed,
    };
    let ahead = "OFFBOARD, v and a 0.15 s ahead";
    vec![
        stop("Bezier", bezier, 4.5, 2.0, 0.93),
        stop("Bezier", bezier, 4.5, 3.0, 1.37),
        stop("OFFBOARD", offboard(0.0, 0.0), 4.5, 2.0, 0.34),
        stop("OFFBOARD", offboard(0.0, 0.0), 4.5, 4.0, 0.46),
        stop("OFFBOARD", offboard(0.0, 0.0), 8.0, 4.0, 0.76),
        stop(ahead, offboard(0.0, 0.15), 4.5, 4.0, 0.22),
    ]
}
