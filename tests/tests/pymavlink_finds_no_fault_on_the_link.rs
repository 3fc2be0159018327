//! An autopilot, a relay and a jink that does not know they are simulated: pymavlink decodes every byte that jink sends,
//! judges it, and is the ground station that flies the mission. Distances come from the world's own description.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_tests::processes::{
    System, TempFolder, answer, free_udp_port, program, python_with_pymavlink, workspace,
};
use serde_json::Value;
use std::process::Command;

/// The process table of a host with nothing but an autopilot and its vehicle.
const AUTOPILOT_ONLY: &str = r#"
[[process]]
name = "simulator"
program = "jink-simulator"
arguments = ["vehicle"]
when = "simulated_vehicle"
heartbeat_timeout_ms = 500
"#;

#[test]
fn an_external_autopilot_is_flown_through_a_virtual_world_and_pymavlink_finds_no_fault() {
    let python = match python_with_pymavlink() {
        Ok(python) => python,
        Err(missing) => {
            eprintln!("NOT TESTED: {missing}");
            return;
        }
    };
    let (relay, companion, station) = (free_udp_port(), free_udp_port(), free_udp_port());
    let world = ["--world", "forest", "--seed", "3"];
    let folder = TempFolder::with_config("autopilot");
    folder.write("services.toml", AUTOPILOT_ONLY);
    let description = answer(&mut program(
        "jink",
        &["world", "--json", "--world", "forest", "--seed", "3"],
    ));
    let world_file = folder.write("world.json", &description.stdout);

    let link = format!("link.address=udpin:127.0.0.1:{relay}");
    let ground = format!("simulation.ground_station_port={station}");
    let _autopilot = System::up(
        "autopilot",
        &[
            &world[..],
            &["--config", folder.text(), "--set", &link, "--set", &ground],
        ]
        .concat(),
    );
    let link = format!("udpin:127.0.0.1:{companion}");
    let jink = System::up("companion", &[&world[..], &["--link", &link]].concat());

    // There and half the way back: long enough for PX4's rule on time stamps to change when the clocks are synchronised.
    let heard = answer(
        Command::new(python)
            .arg(workspace().join("tests/peers/listener.py"))
            .args(["--autopilot-port", &relay.to_string()])
            .args(["--companion-port", &companion.to_string()])
            .args(["--station-port", &station.to_string()])
            .args(["--world", &world_file.to_string_lossy()])
            .args(["--waypoint", "60,0", "--waypoint", "30,0"]),
    );
    let last = heard.stdout.lines().last().unwrap_or_default();
    let figures: Value = serde_json::from_str(last).unwrap_or_else(|_| panic!("{heard:?}"));
    let text = format!("{}\n{figures:#}\n{:#}", heard.stderr, jink.status());

    assert_eq!(figures["outcome"], "done", "{text}");
    assert_eq!(figures["faults"], Value::Array(Vec::new()), "{text}");
    assert_eq!(figures["holds"], 0, "{text}");
    assert!(figures["min_clearance_m"].as_f64().unwrap() > 0.0, "{text}");
    assert!(figures["timesync_answers"].as_u64().unwrap() > 500, "{text}");
    let rate = |kind: &str| figures["rates_hz"][kind].as_f64().unwrap_or(0.0);
    // Rates over the whole flight, on a machine that may be busy: PX4 needs 2 Hz, 1 Hz and 10 Hz.
    assert!(rate("TRAJECTORY_REPRESENTATION_BEZIER") > 15.0, "{text}");
    assert!(rate("HEARTBEAT") > 0.9, "{text}");
    assert!(rate("OBSTACLE_DISTANCE") > 10.0, "{text}");
    println!("{text}");
}
