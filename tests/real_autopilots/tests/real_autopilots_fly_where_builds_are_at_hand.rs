//! The first flights of the suite on every build that `builds.toml` names; without one the test says so and passes.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_real_autopilots::runner::{self, Options};
use jink_real_autopilots::scenarios::planned;
use jink_real_autopilots::setup::Setup;
use jink_real_autopilots::{builds, table};

#[test]
fn a_plain_mission_and_a_go_to_are_flown_on_every_build_at_hand() {
    let found = builds::configured().unwrap();
    let mut flights = planned(&["plain$".to_owned(), "/go_to$".to_owned()]);
    for setup in Setup::ALL {
        if let Err(why) = runner::is_flown(setup, &found) {
            jink_testkit::not_tested(&format!("{setup}: {why} in {}", builds::file().display()));
            flights.retain(|flight| flight.setup != setup);
        }
    }
    if flights.is_empty() {
        return;
    }
    let options = Options {
        builds: found,
        jobs: 1,
        first_instance: 7,
        json: None,
        svg: None,
        keep: None,
        programs: runner::programs().unwrap(),
        config: runner::workspace().join("config"),
    };
    let verdicts = runner::run(&flights, &options);
    assert_eq!(verdicts.len(), flights.len());
    assert!(
        verdicts.iter().all(|verdict| verdict.passed),
        "{}",
        table::markdown(&verdicts, &[])
    );
}
