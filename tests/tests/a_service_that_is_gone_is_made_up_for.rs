//! Services end in flight and do not come back by themselves: the vehicle comes to rest in space that was known to be
//! free, the autopilot is told the truth, and the flight goes on when they are back.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_tests::processes::{Flight, until};

#[test]
fn planner_fusion_and_guard_one_after_the_other() {
    let flight = Flight::begin(&["--seed", "8"]);
    flight.until_it_flies();
    for service in ["planner", "obstacle_fusion", "collision_guard"] {
        let start_m = flight.flown_m();
        until("some way", || flight.flown_m() > start_m + 4.0);
        let stop = flight.jink(&["stop", service]);
        assert_eq!(stop.code, Some(0), "{service}: {stop:?}");
        flight.until_it_rests();
        let status = flight.status();
        assert_eq!(status["link"]["avoidance"], "critical", "{service}: {status}");
        assert_ne!(status["health"], "healthy", "{service}: {status}");
        let restart = flight.jink(&["restart", "--hard", service]);
        assert_eq!(restart.code, Some(0), "{service}: {restart:?}");
        until("good health", || flight.status()["link"]["avoidance"] == "active");
    }
    let figures = flight.end();
    assert_eq!(figures["outcome"], "goal", "{figures}");
    assert_eq!(figures["collisions"], 0, "{figures}");
    assert_eq!(figures["fcu_hold_count"], 0, "{figures}");
}

#[test]
fn how_a_killed_service_ended_is_kept_and_shown() {
    let flight = Flight::begin(&["--seed", "9", "--kill", "planner@3s"]);
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
    assert_eq!(flight.end()["outcome"], "goal");
}
