//! Flights of the real processes, some of which are killed on the way: the goal is reached, nothing is touched, the
//! autopilot never falls back to Hold.

use jink_tests::processes::{Demo, demo};

fn flies(arguments: &[&str]) -> Demo {
    let flight = demo(arguments);
    assert_eq!(flight.figures["outcome"], "goal", "{}", flight.text);
    assert_eq!(flight.figures["collisions"], 0, "{}", flight.text);
    assert_eq!(flight.figures["fcu_hold_count"], 0, "{}", flight.text);
    assert_eq!(flight.code, Some(0), "{}", flight.text);
    flight
}

#[test]
fn a_forest_is_crossed_by_independent_processes_and_one_may_die_twice() {
    let quiet = flies(&["--seed", "3"]);
    assert_eq!(quiet.figures["restarts"], 0, "{}", quiet.text);
    let killed = flies(&["--seed", "4", "--kill", "planner@4s", "--kill", "planner@9s"]);
    assert!(
        killed.figures["restarts"].as_u64().unwrap() >= 2,
        "{}",
        killed.text
    );
}
