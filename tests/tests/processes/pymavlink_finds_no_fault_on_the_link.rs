//! An autopilot, a relay and a jink that does not know they are simulated: pymavlink decodes every byte that jink sends,
//! judges it, and is the ground station that flies the mission. Distances come from the world's own description.

use jink_tests::peers::AUTOPILOT_ONLY;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, TempFolder, answer, program, python_with_pymavlink, workspace};
use serde_json::Value;
use std::process::Command;

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn an_external_autopilot_is_flown_through_a_virtual_world_and_pymavlink_finds_no_fault() {
    // There and half the way back: long enough for PX4's rule on time stamps to change when the clocks are synchronised.
    let Some((figures, text)) = listen("bezier", &["60,0", "30,0"], None) else {
        return;
    };
    assert!(figures["timesync_answers"].as_u64().unwrap() > 500, "{text}");
    assert!(
        rate_hz(&figures, "TRAJECTORY_REPRESENTATION_BEZIER") > 15.0,
        "{text}"
    );
    println!("{text}");
}

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn in_waypoints_too_and_the_telemetry_log_can_be_read_back() {
    let folder = TempFolder::new("tlog");
    let Some((figures, text)) = listen("waypoints", &["30,0"], Some(folder.text())) else {
        return;
    };
    assert!(
        rate_hz(&figures, "TRAJECTORY_REPRESENTATION_WAYPOINTS") > 15.0,
        "{text}"
    );
    assert_eq!(
        rate_hz(&figures, "TRAJECTORY_REPRESENTATION_BEZIER"),
        0.0,
        "{text}"
    );

    let mut logs = std::fs::read_dir(folder.path()).unwrap();
    let log = logs.next().unwrap().unwrap().path();
    let python = python_with_pymavlink().unwrap();
    let reader = workspace().join("tests/peers/read_tlog.py");
    let read = answer(Command::new(python).arg(reader).arg(&log));
    let read: Value = serde_json::from_str(read.stdout.lines().last().unwrap_or_default())
        .unwrap_or_else(|_| panic!("{read:?}"));
    let count = |what: &str| read["messages"][what].as_u64().unwrap_or(0);
    // Both directions, every sender, in order, and nothing else.
    assert!(count("TRAJECTORY_REPRESENTATION_WAYPOINTS 196") > 200, "{read}");
    assert!(count("TRAJECTORY_REPRESENTATION_WAYPOINTS 1") > 50, "{read}");
    assert!(
        count("HEARTBEAT 196") > 20 && count("HEARTBEAT 191") > 20 && count("HEARTBEAT 1") > 10,
        "{read}"
    );
    assert_eq!(
        (&read["bad"], &read["backwards"]),
        (&0.into(), &0.into()),
        "{read}"
    );
}

fn rate_hz(figures: &Value, kind: &str) -> f64 {
    figures["rates_hz"][kind].as_f64().unwrap_or(0.0)
}

/// Flies the mission over `waypoints` with setpoints of one kind and everything written to the folder `tlog`; what the listener
/// has found, and everything as text. `None` without pymavlink.
fn listen(output: &str, waypoints: &[&str], tlog: Option<&str>) -> Option<(Value, String)> {
    let python = match python_with_pymavlink() {
        Ok(python) => python,
        Err(missing) => {
            jink_tests::not_tested(&missing);
            return None;
        }
    };
    let (relay, companion, station) = (free_udp_port(), free_udp_port(), free_udp_port());
    let world = ["--world", "forest", "--seed", "3"];
    let folder = TempFolder::with_config(&format!("ap_{output}"));
    folder.write("services.toml", AUTOPILOT_ONLY);
    let description = answer(&mut program(
        "jink",
        &["world", "--json", "--world", "forest", "--seed", "3"],
    ));
    let world_file = folder.write("world.json", &description.stdout);

    let link = format!("link.address=udpin:127.0.0.1:{relay}");
    let ground = format!("simulation.ground_station_port={station}");
    let _autopilot = System::up(
        &format!("ap_{output}"),
        &[
            &world[..],
            &["--config", folder.text(), "--set", &link, "--set", &ground],
        ]
        .concat(),
    );
    let link = format!("udpin:127.0.0.1:{companion}");
    let output_set = format!("link.output={output}");
    let tlog_set = format!("link.tlog={}", tlog.unwrap_or_default());
    let sets = ["--link", &link, "--set", &output_set, "--set", &tlog_set];
    let jink = System::up(&format!("co_{output}"), &[&world[..], &sets].concat());

    let received = answer(
        Command::new(python)
            .arg(workspace().join("tests/peers/listener.py"))
            .args(["--autopilot-port", &relay.to_string()])
            .args(["--companion-port", &companion.to_string()])
            .args(["--station-port", &station.to_string()])
            .args(["--world", &world_file.to_string_lossy()])
            .args(waypoints.iter().flat_map(|place| ["--waypoint", place])),
    );
    let last = received.stdout.lines().last().unwrap_or_default();
    let figures: Value = serde_json::from_str(last).unwrap_or_else(|_| panic!("{received:?}"));
    let text = format!("{}\n{figures:#}\n{:#}", received.stderr, jink.status());

    assert_eq!(figures["outcome"], "done", "{text}");
    assert_eq!(figures["faults"], Value::Array(Vec::new()), "{text}");
    assert_eq!(figures["holds"], 0, "{text}");
    assert!(figures["min_clearance_m"].as_f64().unwrap() > 0.0, "{text}");
    // Rates over the whole flight, on a machine that may be busy: one and five a second are promised.
    assert!(rate_hz(&figures, "HEARTBEAT") > 0.9, "{text}");
    assert!(rate_hz(&figures, "OBSTACLE_DISTANCE") > 4.0, "{text}");
    Some((figures, text))
}
