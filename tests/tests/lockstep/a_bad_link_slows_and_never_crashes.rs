//! Flights through a forest over links that lose, double, delay, reorder and damage frames, both ways: nothing is touched,
//! and up to a fifth lost or 100 ms each way the goal is reached without a fall to Hold.

use jink_tests::campaign::{Cell, FlightOutcome, fly_as};
use jink_tests::lossy::LinkFaults;
use jink_tests::pairing::{COPTER, PX4_CURRENT, PX4_TRAJECTORY, Pairing};
use std::sync::Mutex;

#[test]
fn through_a_forest_over_bad_links() {
    let none = LinkFaults::default();
    let loss = |loss| LinkFaults { loss, ..none };
    let delay = |delay_s| LinkFaults { delay_s, ..none };
    // The last column: whether the goal must be reached. At 200 ms each way the vehicle stays where it is, or is halted there, and safe.
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
    // What only follows setpoints is flown over the worst that must be borne.
    let worst = [
        "nothing",
        "20 % lost",
        "5 % damaged",
        "100 ms late",
        "200 ms late",
        "all: 5 %, 0 to 50 ms",
    ];
    let flights: Vec<(Pairing, _)> = [PX4_TRAJECTORY, PX4_CURRENT, COPTER]
        .into_iter()
        .flat_map(|whose| rows.iter().map(move |row| (whose, row)))
        .filter(|(whose, (name, ..))| *whose == PX4_TRAJECTORY || worst.contains(name))
        .collect();
    let next = Mutex::new(flights.iter());
    let lines = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                loop {
                    let Some((whose, (name, faults, must_arrive))) = next.lock().unwrap().next() else {
                        return;
                    };
                    let mut setup = whose.forest(3).unwrap();
                    // Who is told that jink holds does not let the mission go on blindly, again and again.
                    setup.plan.resume = *whose == PX4_TRAJECTORY;
                    setup.link_faults = Some(*faults);
                    let report = fly_as(setup, &Cell::forest().unwrap()).unwrap();
                    let line = format!(
                        "{:16} {name:24} {:?}, {} touched, largest gap {:4.0} ms, {} Holds, {:.1} m/s, nearest {:.2} m",
                        whose.profile.name(),
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
