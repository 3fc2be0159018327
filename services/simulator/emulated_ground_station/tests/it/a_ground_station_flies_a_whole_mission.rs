//! Ground station and autopilot over MAVLink messages alone, without a companion: take-off, mission, landing.

use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::{Link, Packet};
use jink_emulated_ground_station::{Ending, FlightPlan, GroundStation, Outcome, Phase};
use jink_emulated_px4::{Px4, Px4Config};
use jink_shared_types::frames::Point;

struct Flight {
    autopilot: Px4,
    station: GroundStation,
    outbox: Vec<Packet>,
    to_autopilot: Vec<Packet>,
}

impl Flight {
    fn new(avoidance: bool, plan: FlightPlan) -> Self {
        let config = Px4Config {
            parameters: vec![("COM_OBS_AVOID".to_owned(), f64::from(u8::from(avoidance)))],
            ..Px4Config::default()
        };
        Self::with(config, plan)
    }

    fn with(config: Px4Config, plan: FlightPlan) -> Self {
        Self {
            autopilot: Px4::new(config).unwrap(),
            station: GroundStation::new(plan),
            outbox: Vec::new(),
            to_autopilot: Vec::new(),
        }
    }

    fn step(&mut self) {
        self.outbox.clear();
        self.autopilot.step(&self.to_autopilot, &mut self.outbox);
        self.to_autopilot.clear();
        let to_station: Vec<_> = self
            .outbox
            .iter()
            .filter(|packet| packet.link == Link::GroundStation)
            .map(|packet| (packet.header, packet.message.clone()))
            .collect();
        let mut sent = Vec::new();
        self.station.step(self.autopilot.time_s(), &to_station, &mut sent);
        self.to_autopilot
            .extend(sent.into_iter().map(|(header, message)| Packet {
                link: Link::GroundStation,
                header,
                message,
            }));
    }
}

fn plan(ending: Ending) -> FlightPlan {
    FlightPlan {
        takeoff_height_m: 2.5,
        waypoints: vec![Point::new(30.0, 0.0, -2.5), Point::new(30.0, 20.0, -2.5)],
        tail: Vec::new(),
        in_flight: Vec::new(),
        cruise_speed_mps: None,
        ending,
        resume: false,
        mission_limit_s: 60.0,
    }
}

#[test]
fn without_avoidance_the_mission_is_flown_at_cruise_speed_and_ends_disarmed() {
    let mut flight = Flight::new(false, plan(Ending::Land));
    let (mut top_speed, mut highest_m) = (0.0f64, 0.0f64);
    while flight.station.progress().outcome.is_none() {
        flight.step();
        let truth = flight.autopilot.truth();
        top_speed = top_speed.max(truth.velocity.vector().xy().norm());
        highest_m = highest_m.max(-truth.position.z_m);
    }
    assert_eq!(
        flight.station.progress().outcome,
        Some(Outcome::Done),
        "{:?}",
        flight.station.progress()
    );
    let end = flight.autopilot.truth().position;
    assert!(
        (end.x_m - 30.0).abs() < 2.5 && (end.y_m - 20.0).abs() < 2.5,
        "{end:?}"
    );
    assert!((4.5..5.6).contains(&top_speed), "{top_speed} m/s");
    assert!((2.0..3.5).contains(&highest_m), "{highest_m} m");
    assert!(!flight.autopilot.is_armed() && flight.autopilot.is_landed());
    assert_eq!(flight.autopilot.hold_count(), 0);
}

#[test]
fn the_take_off_climbs_to_the_height_that_was_asked_for() {
    let mut flight = Flight::new(
        false,
        FlightPlan {
            takeoff_height_m: 6.0,
            waypoints: vec![Point::new(10.0, 0.0, -6.0)],
            ..plan(Ending::Land)
        },
    );
    let mut highest_m = 0.0f64;
    while flight.station.progress().outcome.is_none() {
        flight.step();
        highest_m = highest_m.max(-flight.autopilot.truth().position.z_m);
    }
    let progress = flight.station.progress();
    assert_eq!(progress.outcome, Some(Outcome::Done), "{progress:?}");
    assert!((5.0..7.0).contains(&highest_m), "{highest_m} m");
}

#[test]
fn with_avoidance_and_no_companion_arming_is_refused_and_the_reason_is_kept() {
    let mut flight = Flight::new(true, plan(Ending::Land));
    while flight.station.progress().outcome.is_none() {
        flight.step();
    }
    let outcome = flight.station.progress().outcome.clone();
    let Some(Outcome::TimedOut {
        phase: Phase::Arm,
        reason,
        ..
    }) = outcome
    else {
        panic!("{outcome:?}");
    };
    assert!(reason.contains("Avoidance system not ready"), "{reason}");
}

#[test]
fn current_px4_flies_it_too_and_needs_nobody() {
    let mut flight = Flight::with(Px4Config::current(0.1), plan(Ending::Return));
    let mut highest_m = 0.0f64;
    while flight.station.progress().outcome.is_none() {
        flight.step();
        highest_m = highest_m.max(-flight.autopilot.truth().position.z_m);
    }
    let progress = flight.station.progress();
    assert_eq!(progress.outcome, Some(Outcome::Done), "{progress:?}");
    assert_eq!(progress.reached, 2);
    assert!(
        (29.0..31.0).contains(&highest_m),
        "the return climbs: {highest_m}"
    );
    assert!(flight.autopilot.truth().position.vector().xy().norm() < 1.0);
}
