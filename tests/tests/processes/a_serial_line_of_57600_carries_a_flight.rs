//! A jink at a serial port of 57600 bit/s, the line as slow as that, pymavlink at its other end: a mission is flown, and
//! heartbeats, trajectories and obstacle maps arrive at the rates that docs/links.md promises.

use jink_tests::peers::{AUTOPILOT_ONLY, PYMAVLINK, Terminal, python_or_say};
use jink_tests::permit;
use jink_tests::ports::free_udp_ports;
use jink_tests::processes::{System, TempFolder, answer, program, until, workspace};
use serde_json::Value;
use std::process::Command;

const BYTES_PER_S: f64 = 5760.0;

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn at_the_rates_that_are_promised() {
    // Two systems, a relay and a listener, and what is judged is when something comes.
    let _permit = permit::for_judging_time();
    let Some(python) = python_or_say(&PYMAVLINK) else {
        return;
    };
    let ports = free_udp_ports(3);
    let [relay, companion, station] = [ports[0], ports[1], ports[2]];
    let world = ["--world", "forest", "--seed", "3"];
    let folder = TempFolder::with_config("serial_line");
    folder.write("services.toml", AUTOPILOT_ONLY);
    let description = answer(&mut program("jink", &[&["world", "--json"][..], &world].concat()));
    let world_file = folder.write("world.json", &description.stdout);
    let line = Terminal::start(
        Command::new(&python)
            .arg(workspace().join("tests/peers/serial_line.py"))
            .args([
                "--port",
                &companion.to_string(),
                "--bytes-per-s",
                &BYTES_PER_S.to_string(),
            ]),
    );
    until("the terminal", || line.screen().ends_with('\n'));
    let address = format!("serial:{}:57600", line.screen().trim());

    let link = format!("link.address=udpin:127.0.0.1:{relay}");
    let ground = format!("simulation.ground_station_port={station}");
    let beside = ["--config", folder.text(), "--set", &link, "--set", &ground];
    let _autopilot = System::up("serial_ap", &[&world[..], &beside].concat());
    let jink = System::up("serial_co", &[&world[..], &["--link", &address]].concat());

    let received = answer(
        Command::new(python)
            .arg(workspace().join("tests/peers/listener.py"))
            .args(["--autopilot-port", &relay.to_string()])
            .args(["--companion-port", &companion.to_string()])
            .args(["--station-port", &station.to_string()])
            .args(["--world", &world_file.to_string_lossy()])
            .args(["--waypoint", "20,0", "--timeout", "120"]),
    );
    let status = jink.status();
    drop(jink);
    let carried = line.close();
    let last = |text: &str| -> Value {
        let last = text.lines().last().unwrap_or_default();
        serde_json::from_str(last).unwrap_or_else(|_| panic!("{text}\n{received:?}"))
    };
    let (figures, carried) = (last(&received.stdout), last(&carried));
    let text = format!(
        "{}\n{figures:#}\n{carried:#}\n{:#}",
        received.stderr, status["link"]
    );
    println!("{text}");

    assert_eq!(figures["outcome"], "done", "{text}");
    assert_eq!(figures["faults"], Value::Array(Vec::new()), "{text}");
    assert_eq!(figures["holds"], 0, "{text}");
    assert!(figures["min_clearance_m"].as_f64().unwrap() > 0.0, "{text}");
    let rate_hz = |kind: &str| figures["rates_hz"][kind].as_f64().unwrap_or(0.0);
    // Both components together; what a busy machine may cost is allowed for.
    assert!(rate_hz("HEARTBEAT") > 2.0, "{text}");
    assert!(rate_hz("TRAJECTORY_REPRESENTATION_BEZIER") > 15.0, "{text}");
    assert!(rate_hz("OBSTACLE_DISTANCE") > 4.0, "{text}");
    // It was the line's pace, not more.
    for way in ["up", "down"] {
        let busiest = carried[way]["busiest_second"].as_f64().unwrap();
        assert!(busiest <= 1.06 * BYTES_PER_S, "{way}: {text}");
    }
    // Nothing that matters was left out.
    let dropped = &status["link"]["links"][0]["dropped"];
    assert_eq!(
        (&dropped["heartbeats"], &dropped["setpoints"]),
        (&0.into(), &0.into()),
        "{text}"
    );
}
