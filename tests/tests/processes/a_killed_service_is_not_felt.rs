//! A flight of the real processes in which the planner is killed twice, and the supervisor: the goal is reached, nothing is touched, the
//! autopilot never falls back to Hold, and how a service ended is shown.

use jink_tests::processes::{Flight, until};

#[test]
fn a_forest_is_crossed_while_the_planner_dies_twice_and_the_supervisor_once() {
    let flight = Flight::begin(&[
        "--seed",
        "4",
        "--kill",
        "planner@2s",
        "--kill",
        "supervisor@7s",
        "--kill",
        "planner@11s",
    ]);
    flight.until_it_flies();
    until("the restart", || flight.service("planner")["restarts"] == 1);
    let mut end = serde_json::Value::Null;
    until("its end on record", || {
        end = flight.status()["ends"][0].clone();
        end.is_object()
    });
    assert_eq!(end["process"], "planner", "{end}");
    assert!(end["exit"].as_str().unwrap().contains('9'), "{end}");
    assert!(end["cycles"].as_u64().unwrap() > 0, "{end}");
    assert!(
        end["last_lines"].is_array() && end["lived_s"].as_f64().unwrap() > 0.0,
        "{end}"
    );
    let text = flight.jink(&["status"]).stdout;
    assert!(text.contains("planner (start 1, process id"), "{text}");

    let figures = flight.end();
    assert_eq!(figures["outcome"], "goal", "{figures}");
    assert_eq!(figures["collisions"], 0, "{figures}");
    assert_eq!(figures["fcu_hold_count"], 0, "{figures}");
    let faults = figures["faults"].as_array().unwrap();
    assert_eq!(faults.len(), 3, "{figures}");
    assert!(faults.iter().all(|fault| fault["survived"] == true), "{figures}");
}
