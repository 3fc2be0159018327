//! With collision prevention switched on the guard and the planner keep its distance, too: what flies a mission is not allowed what a
//! pilot is not.

use jink_emulated_ground_station::Outcome;
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::{PX4_CURRENT, PX4_TRAJECTORY, Pairing};

/// Distance that collision prevention keeps (m), from the centre.
const CP_DIST_M: f64 = 1.7;
/// The hull (m).
const RADIUS_M: f64 = 0.3;
/// What of it may be lost: the sensor's noise, and what the autopilot cuts of corners (m).
const LOST_M: f64 = 0.3;

/// Smallest clearance of a flight through the forest of `seed` that keeps the distance, how often the guard braked, and how it ended.
fn fly(pairing: Pairing, seed: u64) -> (f64, u32, Option<Outcome>) {
    let mut setup = pairing.forest(seed).unwrap();
    setup.params.set("CP_DIST", CP_DIST_M).unwrap();
    let mut flight = LockStep::new(setup).unwrap();
    let mut nearest_m = f64::INFINITY;
    while flight.outcome().is_none() {
        flight.step();
        assert_eq!(flight.truth().collisions, 0, "seed {seed}");
        nearest_m = nearest_m.min(flight.truth().clearance_m);
    }
    (nearest_m, flight.brakes, flight.outcome().cloned())
}

/// Without it both flights pass a trunk at less than a metre.
pub fn forest_flights() -> Flights {
    let mut flights = Flights::new();
    for (pairing, seed) in [(PX4_TRAJECTORY, 1), (PX4_CURRENT, 2)] {
        flights.add(&format!("{} seed {seed}", pairing.name()), false, move || {
            let (nearest_m, brakes, outcome) = fly(pairing, seed);
            println!(
                "{:?} seed {seed}: nearest {nearest_m:.2} m of the hull, {brakes} brakes",
                pairing.profile
            );
            assert_eq!(outcome, Some(Outcome::Done), "seed {seed}");
            assert!(
                nearest_m > CP_DIST_M - RADIUS_M - LOST_M,
                "seed {seed}: {nearest_m} m"
            );
        });
    }
    flights
}
