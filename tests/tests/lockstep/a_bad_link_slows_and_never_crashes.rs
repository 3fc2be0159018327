//! Flights through a forest over links that lose, double, delay, reorder and damage frames, both ways: nothing is touched,
//! and up to a fifth lost or 100 ms each way the goal is reached without a fall to Hold.

use jink_tests::campaign::{Cell, FlightOutcome, fly_as};
use jink_tests::flights::Flights;
use jink_tests::lossy::LinkFaults;
use jink_tests::pairing::{COPTER, PX4_CURRENT, PX4_TRAJECTORY, Pairing};

pub fn forest_flights() -> Flights {
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
    let in_every_run = (PX4_CURRENT, "all: 5 %, 0 to 50 ms");
    let mut flights = Flights::new();
    for whose in [PX4_TRAJECTORY, PX4_CURRENT, COPTER] {
        for (name, faults, must_arrive) in rows {
            if whose == PX4_TRAJECTORY || worst.contains(&name) {
                flights.add(
                    &format!("{} {name}", whose.name()),
                    (whose, name) == in_every_run,
                    move || fly(whose, name, faults, must_arrive),
                );
            }
        }
    }
    flights
}

fn fly(whose: Pairing, name: &str, faults: LinkFaults, must_arrive: bool) {
    let mut setup = whose.forest(3).unwrap();
    // Whoever is notified that jink holds does not let the mission go on blindly, again and again.
    setup.plan.resume = whose == PX4_TRAJECTORY;
    setup.link_faults = Some(faults);
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
    println!("{line}");
    assert_eq!(report.collisions, 0, "{line}");
    if must_arrive {
        assert_eq!(report.outcome, FlightOutcome::Goal, "{line}");
        assert_eq!(report.hold_count, 0, "{line}");
    }
}

#[test]
fn through_a_forest_over_bad_links() {
    forest_flights().fly_some();
}
