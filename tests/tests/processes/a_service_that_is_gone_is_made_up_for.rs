//! Services end in flight and do not come back by themselves: the vehicle comes to rest in space that was known to be
//! free, the autopilot receives the true state, and the flight goes on when they are back.

use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, program, until};
use std::process::Stdio;
use std::time::Duration;

/// How long a vehicle may stand before its goal counts as out of reach (s), and how long the guard is gone.
const BLOCKED_S: u64 = 8;
const GUARD_GONE: Duration = Duration::from_secs(BLOCKED_S + 2);

#[test]
fn planner_fusion_and_guard_one_after_the_other() {
    let [link, station] = [free_udp_port(), free_udp_port()];
    let jink = System::up(
        "gone",
        &[
            "--world",
            "forest",
            "--seed",
            "8",
            "--set",
            &format!("link.address=udpin:127.0.0.1:{link}"),
            "--set",
            &format!("simulation.ground_station_port={station}"),
            "--set",
            &format!("params.OA_BLOCKED_T={BLOCKED_S}"),
        ],
    );
    let port = station.to_string();
    let mut mission = program(
        "jink-simulator",
        &["fly", "--port", &port, "--world", "forest", "--seed", "8"],
    );
    let mission = mission.stdout(Stdio::piped()).spawn().unwrap();
    jink.until_it_flies();
    for service in ["planner", "obstacle_fusion", "collision_guard"] {
        let start_m = jink.flown_m();
        until("some way", || jink.flown_m() > start_m + 4.0);
        let stop = jink.jink(&["stop", service]);
        assert_eq!(stop.code, Some(0), "{service}: {stop:?}");
        jink.until_it_rests();
        let status = jink.status();
        let said = status["link"]["avoidance"].as_str().unwrap_or_default();
        assert!(!said.is_empty() && said != "active", "{service}: {status}");
        assert_ne!(status["health"], "healthy", "{service}: {status}");
        if service == "collision_guard" {
            std::thread::sleep(GUARD_GONE);
        }
        let restart = jink.jink(&["restart", "--hard", service]);
        assert_eq!(restart.code, Some(0), "{service}: {restart:?}");
        until("good health", || jink.status()["link"]["avoidance"] == "active");
    }
    let flown = mission.wait_with_output().unwrap();
    assert_eq!(flown.status.code(), Some(0), "{flown:?}");
    let truth = jink.truth();
    assert_eq!(jink.truth_number("collisions"), Some(0.0), "{truth}");
    assert_eq!(
        jink.truth_number("hold_count"),
        Some(0.0),
        "{truth} {:?}",
        jink.jink(&["log", "simulator"])
    );
}

#[test]
fn parameters_are_read_tuned_and_kept_whoever_is_dead() {
    let jink = System::up(
        "tuned",
        &[
            "--world",
            "forest",
            "--set",
            &format!("link.address=udpin:127.0.0.1:{}", free_udp_port()),
            "--set",
            &format!("simulation.ground_station_port={}", free_udp_port()),
        ],
    );
    let value = || {
        let reported = jink.jink(&["param", "get", "OA_SPD_MAX"]);
        reported.stdout.trim().parse::<f64>().ok()
    };
    let set = |text: &str| jink.jink(&["param", "set", "OA_SPD_MAX", text]);
    let stop = jink.jink(&["stop", "mavlink_gateway"]);
    assert_eq!(stop.code, Some(0), "{stop:?}");
    until("the gateway's end", || {
        jink.service("mavlink_gateway")["state"] == "stopped"
    });
    let tuned = set("2.5");
    assert_eq!(tuned.code, Some(0), "{tuned:?}");
    assert_eq!(value(), Some(2.5));
    let refused = set("99");
    assert_eq!(refused.code, Some(1), "{refused:?}");
    let restart = jink.jink(&["restart", "mavlink_gateway"]);
    assert_eq!(restart.code, Some(0), "{restart:?}");
    assert_eq!(value(), Some(2.5));

    // Its owner dies: a new one has what was changed.
    jink.kill("parameter_server");
    until("another owner", || {
        let server = jink.service("parameter_server");
        server["restarts"] == 1 && server["state"] == "active"
    });
    until("the values", || value() == Some(2.5));
    assert_eq!(set("3.5").code, Some(0));
    assert_eq!(value(), Some(3.5));
    until("good health", || jink.status()["health"] == "healthy");
}
