//! With `hot_shadow = true` a second instance of a service computes beside the first and owns its outputs from the moment the
//! first is seen to be dead.

use jink_tests::processes::{TempFolder, demo};
use std::fs::read_to_string;

const SERVICES: [&str; 6] = [
    "mavlink_gateway",
    "collision_guard",
    "bezier_generator",
    "planner",
    "obstacle_fusion",
    "sensors",
];

#[test]
fn each_service_in_one_flight() {
    let config = TempFolder::with_config("hot_shadow");
    let mut table = read_to_string(config.path().join("services.toml")).unwrap();
    for service in SERVICES {
        let row = format!("name = \"{service}\"\n");
        assert!(table.contains(&row), "{service}");
        table = table.replace(&row, &format!("{row}hot_shadow = true\n"));
    }
    config.write("services.toml", &table);
    let mut arguments = vec![
        "--seed".to_owned(),
        "3".to_owned(),
        "--config".to_owned(),
        config.text().to_owned(),
    ];
    for (index, service) in SERVICES.iter().enumerate() {
        arguments.push("--kill".to_owned());
        arguments.push(format!("{service}@{}s", 3 + 3 * index));
    }
    // Its successor takes over as well.
    arguments.push("--kill".to_owned());
    arguments.push(format!("planner@{}s", 3 + 3 * SERVICES.len()));
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let flight = demo(&arguments);
    assert_eq!(flight.figures["outcome"], "goal", "{}", flight.text);
    assert_eq!(flight.figures["collisions"], 0, "{}", flight.text);
    assert_eq!(flight.figures["fcu_hold_count"], 0, "{}", flight.text);
    let faults = flight.figures["faults"].as_array().unwrap();
    assert_eq!(faults.len(), SERVICES.len() + 1, "{}", flight.text);
    for fault in faults {
        assert_eq!(fault["survived"], true, "{fault}\n{}", flight.text);
        assert!(fault["recovery_ms"].as_f64().unwrap() >= 0.0, "{fault}");
    }
    for service in SERVICES {
        let reported = format!("{service} ended with signal 9, its second instance took over (restart 1)");
        assert!(flight.text.contains(&reported), "{service}\n{}", flight.text);
    }
}
