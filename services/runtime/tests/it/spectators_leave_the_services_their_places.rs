//! Who only looks on never takes the place of a service, and a service that finds all places taken waits for one.

use jink_runtime::{Instance, OpenError, Session, StartError};
use jink_shared_types::SampleHeader;
use jink_shared_types::topics::{self, SPECTATOR};
use jink_shared_types::vehicle::VehicleState;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Names the instance, and the program to be, to a process that reads a topic until it is killed.
const CHILD: &str = "JINK_TEST_READER";

/// An instance of its own that leaves nothing behind.
struct Isolated(Instance);

impl Isolated {
    fn new(test: &str) -> Self {
        let instance: Instance = format!("rt_{test}_{}", std::process::id()).parse().unwrap();
        instance.make_folder().unwrap();
        Self(instance)
    }

    fn session(&self, program: &str) -> Session {
        Session::open(&self.0, program).unwrap()
    }

    /// A process that reads the topic as `program`, and whether it could.
    fn reader(&self, program: &str) -> (Child, bool) {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "spectators_leave_the_services_their_places::child",
                "--nocapture",
            ])
            .env(CHILD, format!("{} {program}", self.0))
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let place = self.0.folder().join(format!("opened.{}", child.id()));
        loop {
            if place.exists() {
                return (child, true);
            }
            if child.try_wait().unwrap().is_some() {
                return (child, false);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

impl Drop for Isolated {
    fn drop(&mut self) {
        self.0.wipe().unwrap();
        std::fs::remove_dir_all(self.0.folder()).unwrap();
    }
}

/// Not a test: a reader as a process of its own, when one of those below starts it.
#[test]
fn child() {
    let Ok(text) = std::env::var(CHILD) else { return };
    let (instance, program) = text.split_once(' ').unwrap();
    let instance: Instance = instance.parse().unwrap();
    let session = Session::open(&instance, program).unwrap();
    let Ok(_input) = session.input(topics::APPROVED, "") else {
        return;
    };
    std::fs::write(
        instance.folder().join(format!("opened.{}", std::process::id())),
        "",
    )
    .unwrap();
    loop {
        std::thread::sleep(Duration::from_secs(1));
    }
}

#[test]
fn as_many_look_on_as_the_row_has_room_for_and_every_service_still_comes_back() {
    let isolated = Isolated::new("spectators");
    let supervisor = isolated.session("supervisor");
    let _held = supervisor.hold(topics::APPROVED, "").unwrap();
    let row = topics::APPROVED.row;
    let (mut services, mut spectators) = (Vec::new(), Vec::new());
    for program in row.consumers {
        services.push((*program, isolated.reader(program).0));
    }
    // Many more want to look on than there is room for.
    for _ in 0..row.spectators() + 17 {
        let (mut child, came) = isolated.reader(SPECTATOR);
        match came {
            true => spectators.push(child),
            false => assert!(child.wait().unwrap().success()),
        }
    }
    assert_eq!(spectators.len(), row.spectators());
    for (program, child) in &mut services {
        for _ in 0..3 {
            child.kill().unwrap();
            child.wait().unwrap();
            let (next, came) = isolated.reader(program);
            assert!(came, "{program} found no place");
            *child = next;
        }
    }
    // The dead do not look on.
    for mut child in spectators {
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let session = isolated.session(SPECTATOR);
    assert!(session.input(topics::APPROVED, "").is_ok());
    for (_, mut child) in services {
        child.kill().unwrap();
        child.wait().unwrap();
    }
}

#[test]
fn one_more_is_told_so_and_a_service_without_a_place_tries_again_at_once() {
    let isolated = Isolated::new("taken");
    let row = topics::APPROVED.row;
    let open = |program: &str| {
        let session = isolated.session(program);
        let input = session.input(topics::APPROVED, "");
        input.map(|input| (input, session))
    };
    let spectators: Vec<_> = (0..row.spectators()).map(|_| open(SPECTATOR).unwrap()).collect();
    let refused = open(SPECTATOR).unwrap_err();
    assert!(
        matches!(&refused, OpenError::TooManySpectators { most, .. } if *most == row.spectators()),
        "{refused}"
    );
    let _services: Vec<_> = (0..2 * row.consumers.len())
        .map(|_| open("planner").unwrap())
        .collect();
    let taken = StartError::from(open("planner").unwrap_err());
    assert!(taken.passes(), "{taken}");
    drop(spectators);
    assert!(open("planner").is_ok());
}

#[test]
fn a_command_that_publishes_leaves_the_services_their_places_as_well() {
    let isolated = Isolated::new("changes");
    let row = topics::PARAMETER_CHANGE.row;
    let open = |program: &str| {
        let session = isolated.session(program);
        let output = session.output(topics::PARAMETER_CHANGE, "", 1);
        output.map(|output| (output, session))
    };
    let _commands: Vec<_> = (0..row.spectators()).map(|_| open(SPECTATOR).unwrap()).collect();
    assert!(open(SPECTATOR).is_err());
    let programs = ["ground_services", "planner", "ground_services", "planner"];
    let services: Vec<_> = programs.iter().map(|program| open(program).unwrap()).collect();
    assert_eq!(services.len(), programs.len());
}

/// Somebody left a command open over the end of a run and the begin of the next one.
#[test]
fn a_spectator_of_the_run_before_takes_no_topic_away_when_it_ends() {
    let system = Isolated::new("run_before");
    let before = system.session("mavlink_gateway");
    let published = before.output(topics::VEHICLE_STATE, "", 1).unwrap();
    let spectator = system.session(SPECTATOR);
    let read = spectator.input(topics::VEHICLE_STATE, "").unwrap();
    drop((published, before));
    system.0.wipe().unwrap();
    let gateway = system.session("mavlink_gateway");
    let mut output = gateway.output(topics::VEHICLE_STATE, "", 1).unwrap();
    drop((read, spectator));
    let guard = system.session("collision_guard");
    let mut input = guard.input(topics::VEHICLE_STATE, "").unwrap();
    let now = jink_runtime::now();
    output.send(SampleHeader::at(now), &VehicleState::default());
    assert!(input.latest(now).is_fresh());
}
