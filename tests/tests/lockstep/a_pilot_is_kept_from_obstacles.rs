//! In Position mode, with external avoidance, collision prevention stands between the pilot's sticks and the autopilot: whatever he
//! does, the vehicle keeps its distance.

use jink_shared_types::events;
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::PX4_DEVIATION;
use jink_tests::pilot::by_hand;

/// Distance that collision prevention keeps (m).
const CP_DIST_M: f64 = 1.5;
/// What of it may be lost: the sensor's noise, a trunk between two rays, the autopilot's overshoot (m).
const LOST_M: f64 = 0.3;

fn forest(seed: u64, distance_m: f64) -> LockStep {
    let mut setup = PX4_DEVIATION.forest(seed).unwrap();
    // The ground station leaves the mode to the pilot.
    setup.plan.resume = false;
    setup.params.set("CP_DIST", distance_m).unwrap();
    setup.params.set("MPC_VEL_MANUAL", 6.0).unwrap();
    LockStep::new(setup).unwrap()
}

pub fn forest_flights() -> Flights {
    let mut flights = Flights::new();
    for seed in [1, 2, 3, 4] {
        flights.add(&format!("seed {seed}"), seed == 1, move || {
            let mut flight = forest(seed, CP_DIST_M);
            // Ahead, then to all sides.
            let nearest_m = by_hand(&mut flight, 40.0, |_, t| {
                let turn = (t / 5.0).floor() * 0.9;
                [(1000.0 * f64::cos(turn)) as i16, (1000.0 * f64::sin(turn)) as i16]
            });
            let truth = flight.truth();
            let way_m = truth.position.x_m.hypot(truth.position.y_m);
            println!(
                "seed {seed}: nearest {nearest_m:.2} m, {way_m:.1} m away, {} reports",
                flight.count(&events::PREVENTION_ACTS)
            );
            assert_eq!(truth.collisions, 0, "seed {seed}");
            // Reported is the distance of the centre, and clearance counts from the hull.
            assert!(nearest_m > CP_DIST_M - 0.3 - LOST_M, "seed {seed}: {nearest_m} m");
            assert!(flight.count(&events::PREVENTION_ACTS) > 0, "seed {seed}");
        });
    }
    flights
}

#[test]
fn pushed_into_a_forest_at_full_stick_it_touches_nothing() {
    forest_flights().fly_some();
}

#[test]
fn switched_off_it_says_nothing() {
    let mut flight = forest(1, -1.0);
    let mut counts = Vec::new();
    // Back to where nothing stands.
    by_hand(&mut flight, 8.0, |flight, t| {
        // The change of mode is known within half a second.
        if t > 1.0 {
            counts.push(flight.autopilot().setpoint_statistics().count);
        }
        [-300, 0]
    });
    assert!(flight.truth().position.x_m < -3.0, "it is flown");
    assert_eq!(counts.first(), counts.last());
    assert_eq!(flight.count(&events::PREVENTION_ACTS), 0);
}
