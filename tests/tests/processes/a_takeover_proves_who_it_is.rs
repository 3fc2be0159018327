//! Programs of the build as candidates for services that they are not: each is refused, or the former program is back at once, and a
//! flight does not feel it.

use jink_runtime::programs::{IN_JINK, JINK, LAB, SIMULATOR, service_of};
use jink_tests::processes::{Answer, Flight, programs, until};
use std::os::unix::fs::PermissionsExt;

/// The services of a flight in simulation, each with its program.
const SERVICES: [(&str, &str); 9] = [
    ("mavlink_gateway", "jink-mavlink-gateway"),
    ("collision_guard", "jink-collision-guard"),
    ("bezier_generator", "jink-bezier-generator"),
    ("planner", "jink-planner"),
    ("obstacle_fusion", "jink-obstacle-fusion"),
    ("sensors", SIMULATOR),
    ("simulator", SIMULATOR),
    ("parameter_server", "jink-parameter-server"),
    ("ground_services", "jink-ground-services"),
];

/// Has `program` take the place of `service`; it must not, and the service must fly on. The answer.
fn refused(flight: &Flight, service: &str, program: &str) -> String {
    let owner = flight.service(service);
    let candidate = programs().join(program);
    let Answer { stdout, stderr, code } = flight.jink(&["swap", service, candidate.to_str().unwrap()]);
    let text = format!("{stdout}{stderr}");
    assert_eq!(code, Some(1), "{service} <- {program}: {text}");
    assert!(
        text.contains("refused") || text.contains("rolled back"),
        "{service} <- {program}: {text}"
    );
    if text.contains("refused") {
        let now = flight.service(service);
        assert_eq!(now["pid"], owner["pid"], "{service} <- {program}: {text}");
    }
    until("its work", || flight.service(service)["state"] == "active");
    text
}

fn is_unharmed(flight: &Flight) {
    assert_eq!(flight.truth_number("collisions"), Some(0.0), "{}", flight.truth());
    assert_eq!(flight.truth_number("hold_count"), Some(0.0), "{}", flight.truth());
}

#[test]
fn the_program_of_another_service_is_refused_by_its_name() {
    let flight = Flight::begin(&["--seed", "6", "--legs", "6"]);
    flight.until_it_flies();
    for (service, program) in [
        ("planner", "jink-bezier-generator"),
        ("bezier_generator", "jink-planner"),
        ("mavlink_gateway", "jink-ground-services"),
        ("sensors", "jink-obstacle-fusion"),
        ("ground_services", "jink-planner"),
    ] {
        let text = refused(&flight, service, program);
        let own = service_of(program.as_ref()).unwrap();
        assert!(
            text.contains(&format!("{own} cannot start: another program")) || text.contains("rolled back"),
            "{service} <- {program}: {text}"
        );
    }
    // A candidate that the machine makes late is refused, too, and the owner flies on.
    until("the planner's own program to take over", || {
        flight.jink(&["restart", "planner"]).code == Some(0)
    });
    is_unharmed(&flight);
}

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn every_program_of_the_build_as_every_service() {
    let mut candidates: Vec<String> = IN_JINK.iter().map(|name| (*name).to_owned()).collect();
    candidates.push(SIMULATOR.to_owned());
    for file in std::fs::read_dir(programs()).unwrap().flatten() {
        let name = file.file_name().to_str().unwrap().to_owned();
        let is_program = file.metadata().unwrap().permissions().mode() & 0o111 != 0;
        // The first flight builds all of them.
        let is_one = name.starts_with(JINK) && file.path().is_file() && is_program;
        if is_one && name != "jink-first-flight" && !candidates.contains(&name) {
            candidates.push(name);
        }
    }
    candidates.sort();
    let flight = Flight::begin(&["--seed", "6", "--legs", "200"]);
    flight.until_it_flies();
    let gap_ms = || flight.truth_number("setpoint_gap_max_s").unwrap_or(0.0) * 1e3;
    println!("largest gap between setpoints before: {:.0} ms", gap_ms());
    for (service, own) in SERVICES {
        let file = if own == SIMULATOR { LAB } else { JINK };
        for candidate in &candidates {
            let is_right = candidate == own || candidate == file;
            // One that is of the service's name and bad is another test's.
            if is_right || (candidate == "jink-bad-candidate" && service == "planner") {
                continue;
            }
            let text = refused(&flight, service, candidate);
            let last = text.lines().last().unwrap_or_default();
            println!("| {service} | {candidate} | {last} | {:.0} ms |", gap_ms());
        }
    }
    is_unharmed(&flight);
}
