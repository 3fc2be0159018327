//! Obstacles reported over MAVLink, and what ArduCopter makes of them.

use crate::support::copter::{CopterFlight, POSITION_VELOCITY, PVA, VELOCITY, at, level, setpoint};
use jink_emulated_autopilot::Link;
use jink_emulated_autopilot::modes::arducopter::Mode;
use mavlink::dialect::*;
use nalgebra::Vector3;

/// Where the wall stands (m north).
const WALL_M: f64 = 15.0;
const NONE: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

/// A scan of the wall as a vehicle heading north sees it.
fn scan(flight: &CopterFlight) -> MavMessage {
    let ahead_m = WALL_M - flight.position().x;
    let distances = std::array::from_fn(|bin| {
        let cosine = (bin as f64 * 5.0).to_radians().cos();
        let far = cosine < 0.1 || ahead_m <= 0.0;
        if far {
            u16::MAX
        } else {
            (ahead_m / cosine * 100.0) as u16
        }
    });
    MavMessage::OBSTACLE_DISTANCE(OBSTACLE_DISTANCE_DATA {
        distances,
        increment: 5,
        min_distance: 20,
        max_distance: 2_000,
        frame: MavFrame::MAV_FRAME_BODY_FRD,
        ..OBSTACLE_DISTANCE_DATA::default()
    })
}

/// The wall as one point.
fn point(flight: &CopterFlight, frame: MavFrame) -> MavMessage {
    MavMessage::OBSTACLE_DISTANCE_3D(OBSTACLE_DISTANCE_3D_DATA {
        time_boot_ms: (flight.now_s() * 1e3) as u32,
        x: (WALL_M - flight.position().x) as f32,
        min_distance: 0.2,
        max_distance: 20.0,
        frame,
        ..OBSTACLE_DISTANCE_3D_DATA::default()
    })
}

fn nothing() -> MavMessage {
    MavMessage::OBSTACLE_DISTANCE(OBSTACLE_DISTANCE_DATA {
        distances: [u16::MAX; 72],
        increment: 5,
        min_distance: 20,
        max_distance: 2_000,
        ..OBSTACLE_DISTANCE_DATA::default()
    })
}

/// In the air with a sensor of MAVLink.
fn airborne(parameters: &[(&str, f64)]) -> CopterFlight {
    let mut flight = CopterFlight::with(&[&[("PRX1_TYPE", 2.0)], parameters].concat());
    flight.run(6.0);
    flight.companion(nothing());
    flight.step();
    flight.set_mode(Mode::Guided);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    flight.take_off(5.0);
    flight.run(12.0);
    flight
}

/// How near to the wall it came while `report` reported it at `rate_hz` and `act` flew (m); negative = through it.
fn closest(
    flight: &mut CopterFlight,
    seconds: f64,
    rate_hz: f64,
    report: impl Fn(&CopterFlight) -> MavMessage,
    mut act: impl FnMut(&mut CopterFlight),
) -> f64 {
    let mut closest_m = f64::INFINITY;
    let every = (250.0 / rate_hz) as usize;
    for step in 0..(seconds * 250.0) as usize {
        if step % every == 0 {
            let message = report(flight);
            flight.companion(message);
        }
        if step % 5 == 0 {
            act(flight);
        }
        flight.step();
        closest_m = closest_m.min(WALL_M - flight.position().x);
    }
    closest_m
}

/// Full stick forward in LOITER.
fn push(flight: &mut CopterFlight) {
    flight.sticks([1_500, 1_000, 1_500, 1_500]);
}

fn loiter(parameters: &[(&str, f64)]) -> CopterFlight {
    let mut flight = airborne(parameters);
    flight.sticks([1_500; 4]);
    flight.step();
    flight.set_mode(Mode::Loiter);
    flight
}

const UNFILTERED: (&str, f64) = ("PRX_FILT", 0.0);

#[test]
fn without_data_arming_is_refused() {
    let mut flight = CopterFlight::with(&[("PRX1_TYPE", 2.0)]);
    flight.run(6.0);
    flight.set_mode(Mode::Guided);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_FAILED);
    assert_eq!(
        flight.texts.last().map(String::as_str),
        Some("Arm: PRX1: No Data")
    );
    flight.companion(nothing());
    flight.step();
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
}

#[test]
fn the_health_bit_follows_the_data_within_half_a_second_and_nothing_is_reported() {
    let proximity = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_PROXIMITY;
    let mut flight = airborne(&[]);
    flight.want(Link::Companion, 1, 100.0);
    let texts = flight.texts.len();
    flight.companion(nothing());
    let health = flight.collect(2.0, |packet| match &packet.message {
        MavMessage::SYS_STATUS(status) => Some(status.onboard_control_sensors_health.contains(proximity)),
        _ => None,
    });
    let healthy_s = health.iter().filter(|healthy| **healthy).count() as f64 * 0.01;
    assert!((healthy_s - 0.46).abs() < 0.06, "{healthy_s}");
    assert!(!health[health.len() - 1]);
    assert_eq!(flight.texts.len(), texts);
}

#[test]
fn the_sensor_has_to_be_there_at_the_start() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.set("PRX1_TYPE", 2.0);
    let closest_m = closest(&mut flight, 8.0, 10.0, scan, |flight| {
        flight.companion(setpoint(VELOCITY, NONE, level(4.0, 0.0), NONE));
    });
    assert!(closest_m < 0.0);
}

#[test]
fn sectors_come_back_as_distance_sensors() {
    let mut flight = airborne(&[UNFILTERED]);
    let ahead = scan(&flight);
    flight.companion(ahead);
    flight.step();
    flight.ask(
        MavCmd::MAV_CMD_REQUEST_MESSAGE,
        [132.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    );
    let sectors: Vec<(u8, u8, u16)> = flight
        .received
        .iter()
        .filter_map(|packet| match &packet.message {
            MavMessage::DISTANCE_SENSOR(m) => Some((m.id, m.orientation as u8, m.current_distance)),
            _ => None,
        })
        .collect();
    let named: Vec<(u8, u8)> = sectors.iter().map(|s| (s.0, s.1)).collect();
    assert_eq!(named, [(10, 0), (11, 1), (17, 7)]);
    assert!(sectors[0].2.abs_diff(1_500) < 30, "{}", sectors[0].2);
}

#[test]
fn loiter_at_full_stick_stops_before_the_wall_and_later_with_the_filter() {
    let fast = closest(&mut loiter(&[UNFILTERED]), 12.0, 10.0, scan, push);
    let slow_scans = closest(&mut loiter(&[UNFILTERED]), 12.0, 2.5, scan, push);
    let wide = closest(
        &mut loiter(&[UNFILTERED, ("AVOID_MARGIN", 4.0)]),
        12.0,
        10.0,
        scan,
        push,
    );
    let filtered = closest(&mut loiter(&[]), 12.0, 10.0, scan, push);
    assert!((fast - 2.25).abs() < 0.3 * 2.25, "{fast}");
    assert!((slow_scans - 2.14).abs() < 0.4 * 2.14, "{slow_scans}");
    assert!((wide - 4.39).abs() < 0.3 * 4.39, "{wide}");
    assert!(filtered < fast - 0.3, "{filtered}");
}

#[test]
fn a_velocity_in_guided_stops_before_the_wall_and_with_the_filter_too_late() {
    let north = |flight: &mut CopterFlight| {
        flight.companion(setpoint(VELOCITY, NONE, level(4.0, 0.0), NONE));
    };
    let fast = closest(&mut airborne(&[UNFILTERED]), 12.0, 10.0, scan, north);
    let wide = closest(
        &mut airborne(&[UNFILTERED, ("AVOID_MARGIN", 4.0)]),
        12.0,
        10.0,
        scan,
        north,
    );
    let filtered = closest(&mut airborne(&[]), 12.0, 10.0, scan, north);
    assert!((fast - 1.82).abs() < 0.4 * 1.82, "{fast}");
    assert!((wide - 3.98).abs() < 0.3 * 3.98, "{wide}");
    assert!(filtered < fast - 0.3, "{filtered}");
}

#[test]
fn setpoints_with_a_position_fly_straight_through_the_wall() {
    for mask in [PVA, POSITION_VELOCITY] {
        let mut flight = airborne(&[UNFILTERED]);
        let begin_s = flight.now_s();
        let closest_m = closest(&mut flight, 8.0, 10.0, scan, |flight| {
            let x = 4.0 * (flight.now_s() - begin_s);
            flight.companion(setpoint(mask, at(x, 0.0), level(4.0, 0.0), NONE));
        });
        assert!(closest_m < -5.0, "{mask} {closest_m}");
    }
}

#[test]
fn switched_off_or_without_messages_it_does_not_stop() {
    let off = closest(
        &mut loiter(&[UNFILTERED, ("AVOID_ENABLE", 0.0)]),
        8.0,
        10.0,
        scan,
        push,
    );
    let blind = closest(&mut loiter(&[UNFILTERED]), 8.0, 10.0, |_| nothing(), push);
    assert!(off < -2.0 && blind < -2.0, "{off} {blind}");
}

#[test]
fn points_in_the_bodys_frame_stop_loiter_and_others_are_alive_and_unseen() {
    let seen = |flight: &CopterFlight| point(flight, MavFrame::MAV_FRAME_BODY_FRD);
    let unseen = |flight: &CopterFlight| point(flight, MavFrame::MAV_FRAME_LOCAL_NED);
    let body = closest(&mut loiter(&[UNFILTERED]), 12.0, 10.0, seen, push);
    let other = closest(&mut loiter(&[UNFILTERED]), 8.0, 10.0, unseen, push);
    assert!((body - 2.21).abs() < 0.3 * 2.21, "{body}");
    assert!(other < -2.0, "{other}");
}

#[test]
fn a_wall_no_longer_reported_is_forgotten_after_two_seconds() {
    let mut flight = loiter(&[UNFILTERED]);
    closest(&mut flight, 12.0, 10.0, scan, push);
    let held = flight.position().x;
    let mut moved_s = None;
    for step in 0..1_500 {
        if step % 5 == 0 {
            push(&mut flight);
        }
        flight.step();
        if flight.position().x > held + 0.3 && moved_s.is_none() {
            moved_s = Some(f64::from(step) * 0.004);
        }
    }
    let moved_s = moved_s.unwrap();
    assert!((1.4..2.6).contains(&moved_s), "{moved_s}");
    assert!(flight.position().x > WALL_M, "through the wall");
    assert_eq!(flight.copter.flight_mode(), Mode::Loiter);
}
