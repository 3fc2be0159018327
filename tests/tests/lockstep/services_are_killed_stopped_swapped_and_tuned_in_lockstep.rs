//! What happens to the processes of an aircraft happens to those of a campaign: in lock-step, too, services are killed, stopped,
//! replaced by a second instance and tuned in flight, by the supervisor's rules, and the same seed gives the same flight.

use jink_emulated_ground_station::Outcome;
use jink_shared_types::events;
use jink_shared_types::health::Health;
use jink_shared_types::vehicle::NavMode;
use jink_supervisor::shadow::SwapProgress;
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::{COPTER, PX4_CURRENT, PX4_TRAJECTORY, Pairing};

/// Everything that flies, but not what is flown.
const SERVICES: [&str; 6] = [
    "mavlink_gateway",
    "collision_guard",
    "bezier_generator",
    "planner",
    "obstacle_fusion",
    "sensors",
];
/// Between two of whatever happens (s).
const PERIOD_S: f64 = 4.0;

/// A flight through a forest to its end; once a period in the mission something happens. Returns it with where it led.
fn fly(
    pairing: Pairing,
    seed: u64,
    mut happens: impl FnMut(&mut LockStep, usize),
) -> (LockStep, Vec<[u64; 3]>) {
    let mut flight = LockStep::new(pairing.forest(seed).unwrap()).unwrap();
    let (mut track, mut times, mut under_way_s) = (Vec::new(), 0, 0.0);
    while flight.outcome().is_none() {
        flight.step();
        let place = flight.truth().position;
        track.push([place.x_m, place.y_m, place.z_m].map(f64::to_bits));
        if matches!(flight.truth().mode.get(), NavMode::Mission | NavMode::Offboard) {
            under_way_s += 0.004;
        }
        if under_way_s > PERIOD_S * (times + 1) as f64 {
            happens(&mut flight, times);
            times += 1;
        }
    }
    assert!(times >= 3, "{times} times only");
    assert_eq!(
        flight.outcome(),
        Some(&Outcome::Done),
        "{:?}",
        flight.events.last()
    );
    assert_eq!(flight.truth().collisions, 0);
    (flight, track)
}

pub fn kill_flights() -> Flights {
    let mut flights = Flights::new();
    for (number, service) in SERVICES.into_iter().enumerate() {
        flights.add(service, service == "collision_guard", move || {
        let pairing = [PX4_TRAJECTORY, PX4_CURRENT, COPTER][number % 3];
        let (flight, _) = fly(pairing, 3, |flight, _| {
            assert_eq!(
                flight.health(),
                Health::Healthy,
                "{service}: {:?}",
                flight.board().states()
            );
            flight.board().kill(service);
        });
        let restarts = flight.count(&events::PROCESS_RESTARTED);
        println!(
            "{service} with {}: {restarts} restarts, clearance {:.2} m, largest gap between setpoints {:.0} ms",
            pairing.autopilot,
            flight.truth().min_clearance_m,
            flight.truth().setpoint_gap_max_s * 1e3
        );
        assert!(restarts >= 3, "{service}: {restarts} restarts");
        // PX4 gives its companion up after half a second.
        assert!(flight.truth().setpoint_gap_max_s < 0.4, "{service}");
        assert_eq!(flight.truth().hold_count, 0, "{service}");
});
    }
    flights
}

#[test]
fn each_service_is_killed_on_the_way_and_comes_back() {
    kill_flights().fly_some();
}

pub fn a_flight_whose_planner_is_killed_is_the_same_to_the_bit_the_second_time() -> Flights {
    Flights::of_one(
        "a_flight_whose_planner_is_killed_is_the_same_to_the_bit_the_second_time",
        || {
            let killed = || fly(PX4_TRAJECTORY, 5, |flight, _| flight.board().kill("planner")).1;
            let left_alone = fly(PX4_TRAJECTORY, 5, |_, _| {}).1;
            let once = killed();
            assert_eq!(once, killed());
            assert_ne!(once, left_alone);
        },
    )
}

#[test]
fn a_service_that_hangs_is_seen_and_replaced() {
    let (flight, _) = fly(PX4_TRAJECTORY, 7, |flight, times| {
        if times == 1 {
            flight.board().pause("planner", true);
        }
    });
    assert_eq!(flight.count(&events::PROCESS_HUNG), 1);
    assert_eq!(flight.count(&events::PROCESS_RESTARTED), 1);
}

pub fn swap_flights() -> Flights {
    let mut flights = Flights::new();
    for service in SERVICES {
        flights.add(service, service == "mavlink_gateway", move || {
            let (mut flight, _) = fly(PX4_TRAJECTORY, 9, |flight, times| {
                if times == 0 || times == 2 {
                    flight.board().swap(service);
                }
            });
            let progress: Vec<_> = flight
                .board()
                .swap_progress
                .iter()
                .map(|(_, progress)| *progress)
                .collect();
            let done = progress
                .iter()
                .filter(|step| **step == SwapProgress::Done)
                .count();
            println!(
                "{service}: {done} swaps, largest gap between setpoints {:.0} ms",
                flight.truth().setpoint_gap_max_s * 1e3
            );
            assert_eq!(done, 2, "{service}: {progress:?}");
            assert_eq!(flight.count(&events::PROCESS_SWAPPED), 2, "{service}");
            assert_eq!(flight.count(&events::PROCESS_RESTARTED), 0, "{service}");
            // No more than without.
            assert!(flight.truth().setpoint_gap_max_s < 0.1, "{service}");
        });
    }
    flights
}

#[test]
fn every_service_is_replaced_in_flight_by_a_second_instance() {
    swap_flights().fly_some();
}

pub fn a_speed_that_is_lowered_on_the_way_is_kept_from_then_on() -> Flights {
    Flights::of_one("a_speed_that_is_lowered_on_the_way_is_kept_from_then_on", || {
        let mut set_s = f64::NAN;
        let mut fastest_mps = 0.0f64;
        let mut flight = LockStep::new(PX4_TRAJECTORY.forest(11).unwrap()).unwrap();
        while flight.outcome().is_none() {
            flight.step();
            let truth = *flight.truth();
            if set_s.is_nan() && truth.mode == NavMode::Mission && truth.velocity.vector().norm() > 2.0 {
                set_s = truth.time_s;
                flight.set_param("OA_SPD_MAX", 1.0);
            }
            // What is committed is flown first.
            if truth.time_s > set_s + 8.0 && truth.mode == NavMode::Mission {
                fastest_mps = fastest_mps.max(truth.velocity.vector().norm());
            }
        }
        assert_eq!(flight.outcome(), Some(&Outcome::Done));
        println!("{fastest_mps:.2} m/s after OA_SPD_MAX was set to 1");
        assert!((0.6..1.1).contains(&fastest_mps), "{fastest_mps} m/s");
    })
}

pub fn ranges_are_dated_from_sensor_to_wire() -> Flights {
    Flights::of_one("ranges_are_dated_from_sensor_to_wire", || {
        let (flight, _) = fly(PX4_TRAJECTORY, 2, |_, _| {});
        let link = flight.link_status();
        let [p50_ms, p99_ms] = [0.5, 0.99].map(|part| link.capture_to_wire.quantile_us(part) * 1e-3);
        println!("capture to wire: p50 {p50_ms}, p99 {p99_ms} ms of the board's clock");
        // Six hops of a step each, and the wait for a beat: what is computed takes no time.
        assert!((16.0..40.0).contains(&p50_ms), "{p50_ms}");
        // A budget of 100 ms, most of which a lidar of 10 Hz needs for itself. The supervisor reports three late outputs,
        // which are fewer than one in a hundred of a flight.
        let is_late = flight.count(&events::OUTPUT_LATE) > 0;
        let max_ms = f64::from(link.capture_to_wire.max_us) * 1e-3;
        assert!(
            !is_late || max_ms > 100.0,
            "said to be late, but {max_ms} ms at most"
        );
        assert!(is_late || p99_ms <= 100.0, "{p99_ms} ms and nothing said");
    })
}
