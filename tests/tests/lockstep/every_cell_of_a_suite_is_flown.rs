//! The suites in which planners are compared: a flight of each cell, judged by the true world.

use jink_simulated_world::world::WorldKind;
use jink_tests::campaign::{FlightOutcome, FlightReport, fly_drawn, recorded, setup};
use jink_tests::flights::Flights;
use jink_tests::pairing::PX4_CURRENT;
use jink_tests::suite::{Choice, Suite};

/// Flies one cell of a suite.
fn flown(suite: Suite, cell: &str, seed: u64) -> FlightReport {
    let choice = Choice {
        cells: vec![cell.to_owned()],
        ..Choice::default()
    };
    flown_as(suite, &choice, seed)
}

/// Flies the first cell of a choice.
fn flown_as(suite: Suite, choice: &Choice, seed: u64) -> FlightReport {
    let cell = suite.cells(choice).unwrap().remove(0);
    assert!(matches!(cell.kind, WorldKind::Benchmark(_)));
    let setup = PX4_CURRENT.fly(setup(&cell, seed).unwrap()).unwrap();
    fly_drawn(setup, &cell).unwrap().report
}

/// Cells whose goal is not reached by every seed; nor is that of any cell of S4.
const NOT_YET: [&str; 7] = [
    "flightbench",
    "office",
    "gap_1.2",
    "gap_1.0",
    "gap_0.8",
    "gap_0.7",
    "slot",
];

/// Every cell once. What stands still is never touched, and no commitment leads into it.
pub fn cell_flights() -> Flights {
    let mut flights = Flights::new();
    for suite in Suite::ALL {
        for cell in suite.cell_names() {
            let name = format!("{} {cell}", suite.name());
            flights.add(&name, false, move || {
                let flight = flown(suite, cell, 101);
                println!("{flight:?}");
                assert_eq!(flight.collisions_certified, 0, "{flight:?}");
                assert_eq!(flight.commitments_touching, 0, "{flight:?}");
                assert_ne!(flight.outcome, FlightOutcome::CollisionStatic, "{flight:?}");
                assert_ne!(flight.outcome, FlightOutcome::LimitViolation, "{flight:?}");
                let is_done = matches!(flight.outcome, FlightOutcome::Goal | FlightOutcome::Stopped);
                assert!(
                    is_done || NOT_YET.contains(&cell) || suite == Suite::S4,
                    "{flight:?}"
                );
                assert!(flight.commitments > 10, "nothing was judged: {flight:?}");
            });
        }
    }
    flights
}

/// Forests in which passages look wide enough from afar and are not from nearby: two beside each other, or one whose cells
/// flicker in the sensor's noise. The vehicle must not go to and fro between them for good.
pub fn narrow_passage_flights() -> Flights {
    let mut flights = Flights::new();
    let dense = Choice {
        cells: vec!["forest".to_owned()],
        density_per_m2: Some(1.0 / 12.0),
        ..Choice::default()
    };
    let noisy = Choice {
        cells: vec!["noise".to_owned()],
        ..Choice::default()
    };
    let with_camera = Choice {
        cells: vec!["flightbench".to_owned()],
        ..Choice::default()
    };
    let forests = [
        (Suite::S1, dense, 141),
        (Suite::S5, noisy, 162),
        // The straight leg to the goal touches corners of unsafe cells, and has no polytope.
        (Suite::S1, with_camera, 32),
    ];
    for (suite, choice, seed) in forests {
        flights.add(&format!("{} seed {seed}", suite.name()), false, move || {
            let flight = flown_as(suite, &choice, seed);
            assert_eq!(flight.outcome, FlightOutcome::Goal, "{flight:?}");
            assert!(flight.time_s < 90.0, "{flight:?}");
        });
    }
    flights
}

#[test]
fn what_is_recorded_is_read_back_and_a_line_that_was_cut_off_is_flown_again() {
    let folder = std::env::temp_dir().join(format!("jink_recorded_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("flights.jsonl");
    let flight = flown(Suite::S3, "corner", 7);
    assert_eq!(flight.outcome, FlightOutcome::Goal, "{flight:?}");
    assert_eq!(flight.collisions_certified, 0, "{flight:?}");
    assert_eq!(flight.commitments_touching, 0, "{flight:?}");
    let (mut file, before) = recorded::open(&path, true).unwrap();
    assert!(before.is_empty());
    recorded::write(&mut file, &flight).unwrap();
    let whole = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, format!("{whole}{}", &whole[..whole.len() / 2])).unwrap();
    let (mut file, before) = recorded::open(&path, true).unwrap();
    assert_eq!(before.len(), 1);
    assert_eq!((before[0].seed, &before[0].hash), (7, &flight.hash));
    // Flown again it is the same flight.
    let again = flown(Suite::S3, "corner", 7);
    assert_eq!(again.hash, flight.hash);
    recorded::write(&mut file, &again).unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap().lines().count(), 2);
    std::fs::write(&path, format!("{whole}{{\"seed\": 1}}\n")).unwrap();
    let error = recorded::open(&path, true).unwrap_err();
    assert!(
        error.contains("flights.jsonl:2: not the report of a flight"),
        "{error}"
    );
    std::fs::remove_dir_all(&folder).unwrap();
}
