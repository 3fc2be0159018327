//! Autopilots in simulation: their clock runs slower than the board's, and stands still for a moment at arming. Nothing of it is
//! felt in flight.

use jink_emulated_px4::Pace;
use jink_shared_types::events;
use jink_simulator::autopilot::AutopilotConfig;
use jink_tests::campaign::{Cell, FlightOutcome, fly_as};
use jink_tests::flights::Flights;
use jink_tests::lockstep::{FlightSetup, LockStep};
use jink_tests::pairing::{PX4_CURRENT, PX4_TRAJECTORY};

fn paced(mut setup: FlightSetup, pace: Pace) -> FlightSetup {
    if let AutopilotConfig::Px4(config) = &mut setup.autopilot {
        config.pace = pace;
    }
    setup
}

pub fn a_clock_that_is_slower_by_a_hundredth_leads_to_the_goal() -> Flights {
    Flights::of_one("a_clock_that_is_slower_by_a_hundredth_leads_to_the_goal", || {
        let pace = Pace {
            rate: 0.988,
            ..Pace::default()
        };
        // What it flies is judged in its own seconds, of which the board's have fewer.
        let forest = Cell::forest().unwrap();
        let judged = Cell {
            speed_mps: forest.speed_mps / pace.rate,
            ..forest
        };
        for whose in [PX4_CURRENT, PX4_TRAJECTORY] {
            let report = fly_as(paced(whose.forest(1).unwrap(), pace), &judged).unwrap();
            assert_eq!(report.outcome, FlightOutcome::Goal, "{whose:?} {report:?}");
            assert_eq!((report.collisions, report.hold_count), (0, 0), "{whose:?}");
        }
    })
}

/// A vehicle on the ground that says nothing for a moment is no reason to notify anybody.
#[test]
fn a_moment_of_silence_at_arming_is_not_reported() {
    let pace = Pace {
        arming_stall_s: 0.16,
        ..Pace::default()
    };
    let mut flight = LockStep::new(paced(PX4_TRAJECTORY.forest(1).unwrap(), pace)).unwrap();
    assert!(flight.run_until(60.0, |f| f.truth().armed.is_set()));
    let reported = flight.count(&events::AVOIDANCE_DEGRADED);
    flight.run(3.0);
    assert_eq!(flight.count(&events::AVOIDANCE_DEGRADED), reported);
    assert!(flight.autopilot().is_armed());
}
