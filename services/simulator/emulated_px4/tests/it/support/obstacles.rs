//! A pilot in Position mode among obstacles that OBSTACLE_DISTANCE reports.

use super::current::{holding, lift, with_drag};
use super::{Flight, STEPS_PER_S};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;
use nalgebra::Vector2;

/// Reach of the sensor (cm).
const MAX_CM: u16 = 1_500;
/// Steps between two stick messages: 20 Hz and a little more.
const STICK_STEPS: usize = 12;

/// Full stick ahead.
pub const FORWARD: [i16; 2] = [1_000, 0];
/// Sticks at rest.
pub const RELEASED: [i16; 2] = [0, 0];
/// The distance that was kept when a real one was observed.
pub const KEEP_4_M: (&str, f64) = ("CP_DIST", 4.0);

/// How far it is from a place (north, east) in a direction (from north) (m).
pub type World<'a> = &'a dyn Fn(Vector2<f64>, f64) -> f64;

/// Nothing anywhere.
pub fn open_air(_: Vector2<f64>, _: f64) -> f64 {
    f64::INFINITY
}

/// A wall across, `north_m` from the origin.
pub fn wall(north_m: f64) -> impl Fn(Vector2<f64>, f64) -> f64 {
    wall_with_gap(north_m, [f64::NAN; 2])
}

/// The same with a gap between two places (east, m).
pub fn wall_with_gap(north_m: f64, gap_m: [f64; 2]) -> impl Fn(Vector2<f64>, f64) -> f64 {
    move |from, angle_rad| {
        let way_m = (north_m - from.x) / angle_rad.cos();
        let east_m = from.y + way_m * angle_rad.sin();
        let through = gap_m[0] < east_m && east_m < gap_m[1];
        if way_m > 0.0 && !through {
            way_m
        } else {
            f64::INFINITY
        }
    }
}

/// In Position mode 5 m up with sticks at rest, CP_DIST and all else as given.
pub fn in_position(parameters: &[(&str, f64)]) -> Flight {
    let mut flight = holding(parameters);
    enter_position(&mut flight);
    flight
}

/// The same with another drag (N/(m/s)).
pub fn in_position_with_drag(drag: f64, parameters: &[(&str, f64)]) -> Flight {
    let mut flight = with_drag(drag, parameters);
    lift(&mut flight);
    enter_position(&mut flight);
    flight
}

/// At full stick in open air until the speed is that of the sensor's range, scans at 10 Hz.
pub fn cruising(drag: f64) -> Flight {
    let mut flight = in_position_with_drag(drag, &[KEEP_4_M]);
    push(&mut flight, 12.0, FORWARD, Some((0.1, &open_air)), |_| {});
    flight
}

/// From any mode into Position.
pub fn enter_position(flight: &mut Flight) {
    sticks(flight, [0, 0]);
    flight.step();
    assert_eq!(flight.set_mode(NavMode::Position), MavResult::MAV_RESULT_ACCEPTED);
}

/// Queues a stick message: forward and right of 1000.
pub fn sticks(flight: &mut Flight, [x, y]: [i16; 2]) {
    let message = MANUAL_CONTROL_DATA {
        x,
        y,
        z: 500,
        target: 1,
        ..MANUAL_CONTROL_DATA::default()
    };
    flight.from(Link::GroundStation, 255, 190, MavMessage::MANUAL_CONTROL(message));
}

/// What a sensor sees now, 72 elements of 5 degrees.
pub fn scan(flight: &Flight, world: World, frame: MavFrame) -> OBSTACLE_DISTANCE_DATA {
    let truth = flight.autopilot.truth();
    let ahead_rad = if frame == MavFrame::MAV_FRAME_BODY_FRD {
        truth.attitude.yaw_rad()
    } else {
        0.0
    };
    let from = truth.position.vector().xy();
    OBSTACLE_DISTANCE_DATA {
        distances: std::array::from_fn(|element| {
            let cm = world(from, ahead_rad + (element as f64 * 5.0).to_radians()) * 100.0;
            (cm.round() as u16).min(MAX_CM + 1)
        }),
        min_distance: 20,
        max_distance: MAX_CM,
        increment: 5,
        frame,
        ..OBSTACLE_DISTANCE_DATA::default()
    }
}

/// Sends it to the autopilot.
pub fn report(flight: &mut Flight, scan: OBSTACLE_DISTANCE_DATA) {
    flight.companion(196, MavMessage::OBSTACLE_DISTANCE(scan));
}

/// Sticks at `stick` for `seconds`, scans every `interval_s` if there are any; `look` after each step.
pub fn push(
    flight: &mut Flight,
    seconds: f64,
    stick: [i16; 2],
    scans: Option<(f64, World)>,
    mut look: impl FnMut(&Flight),
) {
    for step in 0..(seconds * STEPS_PER_S).round() as usize {
        if step % STICK_STEPS == 0 {
            sticks(flight, stick);
        }
        if let Some((interval_s, world)) = scans
            && step % (interval_s * STEPS_PER_S).round() as usize == 0
        {
            let seen = scan(flight, world, MavFrame::MAV_FRAME_BODY_FRD);
            report(flight, seen);
        }
        flight.step();
        look(flight);
    }
}

/// Whether a measured number is what was observed but for a share of it.
pub fn within(measured: f64, observed: f64, share: f64) -> bool {
    (measured - observed).abs() <= observed * share
}
