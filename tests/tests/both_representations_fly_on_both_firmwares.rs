//! The trajectory interface in all four combinations: curves or waypoints, on PX4 before and after its time-out fixes.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_mavlink_gateway::Representation;
use jink_simulator::autopilot::{AutopilotConfig, Firmware, Variant};
use jink_simulator::flyer::FlyerConfig;
use jink_tests::campaign::{Cell, FlightOutcome, fly_as, setup};

#[test]
fn through_a_forest() {
    let cell = Cell {
        kind: "forest".parse().unwrap(),
        density_per_m2: None,
        speed_mps: 3.0,
        limit_s: 120.0,
    };
    for representation in [Representation::Bezier, Representation::Waypoints] {
        for variant in [Variant::A, Variant::B] {
            for seed in [1, 2, 3] {
                let mut setup = setup(&cell, seed).unwrap();
                setup.representation = representation;
                setup.autopilot = FlyerConfig::Px4(AutopilotConfig {
                    firmware: Firmware::Trajectory(variant),
                    ..AutopilotConfig::default()
                });
                let report = fly_as(setup, cell.speed_mps).unwrap();
                let what = format!("{representation:?} on {variant:?}: {report:?}");
                println!("{what}");
                assert_eq!(report.outcome, FlightOutcome::Goal, "{what}");
                assert_eq!((report.collisions, report.hold_count), (0, 0), "{what}");
                assert!(report.setpoint_gap_ms <= 100.0, "{what}");
            }
        }
    }
}
