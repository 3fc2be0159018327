//! Flights of the real processes in which services are killed, and the supervisor: the goal is reached, nothing is touched, the autopilot
//! never falls back to Hold nor waits for setpoints, and how a service ended is shown.

use jink_tests::machine::{BUSY_SHARE, Load};
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{Flight, System, demo, until};
use jink_tests::{not_tested, permit};
use rustix::process::{Pid, Signal, kill_process};
use std::time::Duration;

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

/// From one setpoint to the next at most while a service that was killed is replaced (ms): twice the usual period, and PX4 waits for five
/// times as long.
const GAP_MAX_MS: f64 = 100.0;
/// Flights that are flown until the machine lets one be judged.
const FLIGHTS: usize = 3;
/// Time taken by the hypervisor in one flight (ms) above which the gap is not that of the services alone.
const STOLEN_MS: f64 = 100.0;

/// Every service is killed in one flight, and the largest time between two setpoints around each kill is compared with the target. What
/// the machine stood still is no service's: it is taken off, and on a machine that was busy otherwise nothing is judged but that the flight
/// was unharmed.
#[test]
fn each_service_killed_in_turn_leaves_no_gap_between_setpoints() {
    let _permit = permit::for_judging_time();
    let services = [
        "planner",
        "mavlink_gateway",
        "obstacle_fusion",
        "bezier_generator",
        "sensors",
        "collision_guard",
        "ground_services",
        "parameter_server",
    ];
    let mut arguments = vec!["--seed".to_owned(), "4".to_owned()];
    for (index, service) in services.iter().enumerate() {
        arguments.extend(["--kill".to_owned(), format!("{service}@{}s", 2 + 2 * index)]);
    }
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let mut unjudged = String::new();
    for _ in 0..FLIGHTS {
        let load = Load::begin();
        let flight = demo(&arguments);
        let share = load.share();
        let figures = &flight.figures;
        assert_eq!(figures["outcome"], "goal", "{}", flight.text);
        assert_eq!(figures["collisions"], 0, "{}", flight.text);
        assert_eq!(figures["fcu_hold_count"], 0, "{}", flight.text);
        let faults = figures["faults"].as_array().unwrap();
        assert_eq!(faults.len(), services.len(), "{}", flight.text);
        assert!(
            faults.iter().all(|fault| fault["survived"] == true),
            "{}",
            flight.text
        );

        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        let allowed_ms = GAP_MAX_MS + number(&figures["machine_stall_max_ms"]);
        let too_long: Vec<String> = faults
            .iter()
            .filter(|fault| number(&fault["gap_ms"]) > allowed_ms)
            .map(|fault| format!("{} {} ms", fault["process"], fault["gap_ms"]))
            .collect();
        if too_long.is_empty() {
            return;
        }
        let stolen_ms = number(&figures["machine_stolen_ms"]);
        unjudged = format!("{too_long:?} of {allowed_ms:.0} ms, {share:.2} busy, {stolen_ms:.0} ms stolen");
        assert!(
            share > BUSY_SHARE || stolen_ms > STOLEN_MS,
            "{unjudged}\n{}",
            flight.text
        );
    }
    not_tested(&format!(
        "the machine was too busy for gaps to be judged: {unjudged}"
    ));
}

/// The process id of the gateway, as soon as it is there.
fn gateway_of(instance: &str) -> Option<i32> {
    let entries = std::fs::read_dir("/proc").ok()?.flatten();
    let mut pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok());
    pids.find(|pid| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let arguments: Vec<&[u8]> = line.split(|byte| *byte == 0).collect();
        arguments.contains(&b"mavlink_gateway".as_slice()) && arguments.contains(&instance.as_bytes())
    })
}

/// Eight restarts within ten seconds are allowed: whatever half-made things so many early deaths leave in shared memory, the ninth
/// instance works, and everybody who asks gets an answer meanwhile.
#[test]
fn a_gateway_killed_eight_times_as_soon_as_it_is_seen_comes_back() {
    let [link, station] = [free_udp_port(), free_udp_port()];
    let jink = System::up(
        "early",
        &[
            "--world",
            "forest",
            "--set",
            &format!("link.address=udpin:127.0.0.1:{link}"),
            "--set",
            &format!("simulation.ground_station_port={station}"),
        ],
    );
    let mut killed = Vec::new();
    until("eight deaths", || {
        while let Some(pid) = gateway_of(jink.instance()).filter(|_| killed.len() < 8) {
            if killed.contains(&pid) {
                continue;
            }
            // From an instance that has opened nothing to one that is about to work.
            std::thread::sleep(Duration::from_millis(4 * killed.len() as u64));
            let killing = Pid::from_raw(pid).map(|pid| kill_process(pid, Signal::KILL));
            assert_eq!(killing, Some(Ok(())));
            killed.push(pid);
        }
        killed.len() == 8
    });
    until("the ninth instance", || {
        assert!(jink.status().is_object(), "{:?}", jink.jink(&["status"]));
        let gateway = jink.service("mavlink_gateway");
        assert_ne!(gateway["state"], "failed", "{gateway}");
        gateway["state"] == "active" && gateway["restarts"] == 8
    });
    let restarted = jink.jink(&["restart", "mavlink_gateway"]);
    assert_eq!(restarted.code, Some(0), "{restarted:?}");
}
