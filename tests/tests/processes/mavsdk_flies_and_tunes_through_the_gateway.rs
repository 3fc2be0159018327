//! MAVSDK, whose only link is that of the gateway: it finds the autopilot behind it and our components beside, reads telemetry,
//! tunes component 196, downloads its files, and flies a mission.

use jink_tests::peers::{MAVSDK, Network, python_or_say};
use jink_tests::processes::{answer, workspace};
use serde_json::{Value, json};
use std::process::Command;

const STEPS: [&str; 7] = [
    "discovers",
    "reads_telemetry",
    "reads_the_autopilots_parameters",
    "tunes_our_component",
    "reads_our_files",
    "reads_our_metadata",
    "flies",
];

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn it_finds_reads_tunes_and_flies() {
    let Some(python) = python_or_say(&MAVSDK) else {
        return;
    };
    let network = Network::up("mavsdk", None, &[("ground", "")], &[]);
    let known = network.parameters();
    let said = answer(
        Command::new(python)
            .arg(workspace().join("tests/peers/mavsdk_station.py"))
            .arg(network.ports[0].to_string())
            .args(STEPS),
    );
    let last = said.stdout.lines().last().unwrap_or_default();
    let found: Value = serde_json::from_str(last).unwrap_or_else(|_| panic!("{said:?}"));
    for step in STEPS {
        let error = found[step]["error"].as_str();
        assert!(
            error.is_none(),
            "{step}: {}\n{}",
            error.unwrap_or_default(),
            said.stderr
        );
        let mut text = found[step].to_string();
        text.truncate(400);
        println!("{step}: {text}");
    }
    println!("MAVSDK {}", found["version"]);

    let discovered = json!({"system": 1, "components": [1, 191, 196], "autopilot": true});
    assert_eq!(found["discovers"], discovered);
    let telemetry = &found["reads_telemetry"];
    assert!(
        telemetry["latitude_deg"].as_f64().unwrap().abs() > 1.0,
        "{telemetry}"
    );
    assert_eq!(telemetry["armed"], false);
    assert!(
        telemetry["mode"].is_string() && telemetry["health"]["is_local_position_ok"].is_boolean(),
        "{telemetry}"
    );
    assert_eq!(found["reads_the_autopilots_parameters"]["avoid"], 1);

    let tuned = &found["tunes_our_component"];
    let all = tuned["all"].as_object().unwrap();
    assert_eq!(all.len(), known.len());
    for row in &known {
        let reported = all[row["name"].as_str().unwrap()].as_f64().unwrap();
        assert!(
            (reported - row["value"].as_f64().unwrap()).abs() < 1e-5,
            "{row}: {reported}"
        );
    }
    assert_eq!(
        (&tuned["after"], &tuned["integer_after"]),
        (&json!(2.5), &json!(2))
    );
    assert_eq!(
        (&tuned["out_of_range"], &tuned["unknown"], &tuned["at_last"]),
        (
            &json!("VALUE_OUT_OF_RANGE"),
            &json!("DOES_NOT_EXIST"),
            &json!(2.5)
        ),
        "{tuned}"
    );
    assert_eq!(network.jink(&["param", "get", "OA_SPD_MAX"]).stdout.trim(), "2.5");

    let files = &found["reads_our_files"];
    assert_eq!(files["listed"], json!(["general.json", "parameters.json"]));
    for way in ["piece by piece", "burst"] {
        assert_eq!(files[way], found["reads_our_metadata"], "{way}");
        assert_eq!(files[way]["parameters"].as_array().unwrap().len(), known.len());
    }

    let flown = &found["flies"];
    assert_eq!((&flown["up"], &flown["down"]), (&json!(2), &json!(2)), "{flown}");
    // The first place was passed, and the second one reached as near as PX4 asks for.
    assert!(flown["north_m"].as_f64().unwrap() > 6.0, "{flown}");
}
