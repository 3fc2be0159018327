//! A planner that is a program of somebody else's proposes ways in a campaign, whose time stands still while it thinks: the flight is
//! the same to the bit, in Rust and in Python, and one that is killed comes back.

use jink_emulated_ground_station::Outcome;
use jink_shared_types::motion::RouteMode;
use jink_tests::lockstep::{LockStep, UserPlanner};
use jink_tests::pairing::PX4_TRAJECTORY;
use jink_tests::processes::{TempFolder, answer, program, programs, workspace};
use std::path::PathBuf;

/// Longest flight (s).
const LONGEST_S: f64 = 120.0;
const SEED: u64 = 3;

fn flight(program: PathBuf) -> LockStep {
    let mut setup = PX4_TRAJECTORY.forest(SEED).unwrap();
    setup.planner = Some(UserPlanner {
        name: "own".to_owned(),
        program,
    });
    LockStep::new(setup).unwrap()
}

/// Where the vehicle was (bits of m) each time that a route was made of a proposal, of `routes` of them or up to the goal.
fn fly(flight: &mut LockStep, routes: usize) -> Vec<[u64; 3]> {
    let (mut route, mut places) = (0, Vec::new());
    while flight.outcome().is_none() && places.len() < routes {
        flight.step();
        let newest = flight.route();
        let is_proposed = newest.mode == RouteMode::Plan && newest.proposal_id.get().is_some();
        let before = std::mem::replace(&mut route, newest.id);
        if is_proposed && route != before {
            let at = flight.truth().position;
            places.push([at.x_m, at.y_m, at.z_m].map(f64::to_bits));
        }
        assert!(flight.truth().time_s < LONGEST_S, "{:?}", flight.truth());
    }
    places
}

#[test]
fn in_rust_twice_the_same_to_the_bit() {
    let planner = || fly(&mut flight(programs().join("jink-minimal-planner")), 30);
    let first = planner();
    assert_eq!(first.len(), 30);
    assert_eq!(first, planner());
}

#[test]
fn in_python_killed_in_flight() {
    let found = std::process::Command::new("python3").arg("--version").output();
    if !found.is_ok_and(|found| found.status.success()) {
        println!("NOT TESTED: there is no python3 here");
        return;
    }
    let folder = TempFolder::new("own_planner_in_lockstep");
    for file in ["foreign.py", "minimal.py"] {
        let text = std::fs::read_to_string(workspace().join("tests/own_planner").join(file)).unwrap();
        folder.write(file, &text);
    }
    folder.write(
        "jink.py",
        &answer(&mut program("jink", &["schema", "--python"])).stdout,
    );
    let script = format!(
        "#!/bin/sh\nexec python3 {} \"$@\"\n",
        folder.path().join("minimal.py").display()
    );
    let path = folder.write("planner", &script);
    std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let mut flight = flight(path);
    assert_eq!(fly(&mut flight, 10).len(), 10);
    flight.board().kill("user_own");
    let places = fly(&mut flight, usize::MAX);
    assert!(places.len() > 20, "{} routes are of proposals", places.len());
    assert_eq!(flight.outcome(), Some(&Outcome::Done));
    assert_eq!(flight.truth().collisions, 0);
}
