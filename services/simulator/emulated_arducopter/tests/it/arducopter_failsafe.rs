//! The lost ground station.

use crate::support::copter::CopterFlight;
use jink_emulated_autopilot::Link;
use jink_emulated_autopilot::modes::arducopter::Mode;
use mavlink::dialect::*;

fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA::default())
}

/// Heartbeats of the companion for `seconds`, and of the ground station if it lives.
fn beat(flight: &mut CopterFlight, seconds: usize, station: bool) {
    for _ in 0..seconds {
        flight.companion(heartbeat());
        if station {
            flight.station(heartbeat());
        }
        flight.run(1.0);
    }
}

#[test]
fn by_default_silence_of_everybody_changes_nothing() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.station(heartbeat());
    flight.run(8.0);
    assert_eq!(flight.copter.flight_mode(), Mode::Guided);
}

#[test]
fn with_fs_gcs_enable_a_lost_ground_station_is_a_return_although_the_companion_lives() {
    let mut flight = CopterFlight::airborne(&[("FS_GCS_ENABLE", 1.0)]);
    beat(&mut flight, 5, true);
    assert_eq!(flight.copter.flight_mode(), Mode::Guided);
    let mut lost_s = None;
    for second in 0..8 {
        flight.companion(heartbeat());
        let at_s = flight.run_until(1.0, |f| f.copter.flight_mode() == Mode::Rtl);
        if let (Some(at_s), None) = (at_s, lost_s) {
            lost_s = Some(f64::from(second) + at_s);
        }
    }
    // The last heartbeat came a second before the count began.
    let lost_s = lost_s.unwrap() + 1.0;
    assert!((lost_s - 4.8).abs() < 0.3, "{lost_s}");
    assert!(flight.texts.iter().any(|t| t == "GCS Failsafe"));
    beat(&mut flight, 3, true);
    assert_eq!(flight.copter.flight_mode(), Mode::Rtl);
}

#[test]
fn a_station_that_was_never_received_is_not_missed_and_another_system_is_none() {
    let mut flight = CopterFlight::airborne(&[("FS_GCS_ENABLE", 1.0)]);
    flight.from(Link::GroundStation, 254, 190, heartbeat());
    flight.run(10.0);
    assert_eq!(flight.copter.flight_mode(), Mode::Guided);
}
