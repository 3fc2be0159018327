//! Flights through a forest over links that lose, double, delay, reorder and damage frames, both ways: nothing is touched,
//! and up to a fifth lost or 100 ms each way the goal is reached without a fall to Hold.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_tests::campaign::{Cell, FlightOutcome, fly_as, setup};
use jink_tests::lossy::LinkFaults;
use std::sync::Mutex;

#[test]
fn through_a_forest_over_bad_links() {
    let none = LinkFaults::default();
    let loss = |loss| LinkFaults { loss, ..none };
    let delay = |delay_s| LinkFaults { delay_s, ..none };
    // The last column: whether the goal must be reached. At 200 ms each way the vehicle stays where it is, and safe.
    let rows = [
        ("nothing", none, true),
        ("1 % lost", loss(0.01), true),
        ("5 % lost", loss(0.05), true),
        ("20 % lost", loss(0.2), true),
        (
            "5 % doubled",
            LinkFaults {
                duplication: 0.05,
                ..none
            },
            true,
        ),
        (
            "5 % damaged",
            LinkFaults {
                corruption: 0.05,
                ..none
            },
            true,
        ),
        (
            "0 to 100 ms, reordered",
            LinkFaults {
                reordering_s: 0.1,
                ..none
            },
            true,
        ),
        ("50 ms late", delay(0.05), true),
        ("100 ms late", delay(0.1), true),
        ("200 ms late", delay(0.2), false),
        (
            "all: 5 %, 0 to 50 ms",
            LinkFaults {
                loss: 0.05,
                duplication: 0.05,
                corruption: 0.01,
                delay_s: 0.0,
                reordering_s: 0.05,
            },
            true,
        ),
    ];
    let next = Mutex::new(rows.iter());
    let lines = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                loop {
                    let Some((name, faults, must_arrive)) = next.lock().unwrap().next() else {
                        return;
                    };
                    let cell = Cell {
                        kind: "forest".parse().unwrap(),
                        density_per_m2: None,
                        speed_mps: 3.0,
                        limit_s: 120.0,
                    };
                    let mut setup = setup(&cell, 3).unwrap();
                    setup.link_faults = Some(*faults);
                    let report = fly_as(setup, cell.speed_mps).unwrap();
                    let line = format!(
                        "{name:24} {:?}, {} touched, largest gap {:4.0} ms, {} Holds, {:.1} m/s, nearest {:.2} m",
                        report.outcome,
                        report.collisions,
                        report.setpoint_gap_ms,
                        report.hold_count,
                        report.mean_speed_mps,
                        report.min_clearance_m,
                    );
                    lines.lock().unwrap().push(line.clone());
                    assert_eq!(report.collisions, 0, "{line}");
                    if *must_arrive {
                        assert_eq!(report.outcome, FlightOutcome::Goal, "{line}");
                        assert_eq!(report.hold_count, 0, "{line}");
                    }
                }
            });
        }
    });
    println!("{}", lines.lock().unwrap().join("\n"));
}
