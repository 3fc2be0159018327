//! Processes killed at any moment of their start leave nothing in memory that a sweep would not remove.

use jink_runtime::{Instance, Session, cleanup, now};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::topics::MAX_PUBLISHERS;
use jink_shared_types::{SampleHeader, topics};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Names the instance to the process that is to be killed.
const CHILD: &str = "JINK_TEST_DYING_CHILD";
/// How many processes are killed; more for a figure than for a test.
const KILLS: &str = "JINK_TEST_KILLS";

/// Not a test: what the killed processes do, when the one below starts them.
#[test]
fn child() {
    let Ok(instance) = std::env::var(CHILD) else {
        return;
    };
    let instance: Instance = instance.parse().unwrap();
    let session = Session::open(&instance, "mavlink_gateway").unwrap();
    let mut output = session.output(topics::LINK_STATUS, "", 2).unwrap();
    let _input = session.input(topics::APPROVED, "").unwrap();
    loop {
        output.send(SampleHeader::at(now()), &LinkStatus::default());
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn whenever_they_are_killed() {
    let instance: Instance = format!("rt_dying_{}", std::process::id()).parse().unwrap();
    instance.make_folder().unwrap();
    let supervisor = Session::open(&instance, "supervisor").unwrap();
    let _held = [
        supervisor.hold(topics::LINK_STATUS, "").unwrap(),
        supervisor.hold(topics::APPROVED, "").unwrap(),
    ];
    let kills: u64 = std::env::var(KILLS).map_or(60, |kills| kills.parse().unwrap());
    let mut swept = cleanup::Swept::default();
    let mut most = 0;
    for n in 0..kills {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "dead_processes_leave_nothing::child", "--nocapture"])
            .env(CHILD, instance.to_string())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        // From before it has a node until it is in its loop.
        std::thread::sleep(Duration::from_micros(100 * (n % 80)));
        child.kill().unwrap();
        child.wait().unwrap();
        most = most.max(cleanup::node_count(&instance));
        let now = cleanup::sweep(&instance);
        swept.cleaned += now.cleaned;
        swept.zombies += now.zombies;
    }
    println!(
        "{kills} killed: {} nodes cleaned up, {} of them zombies; at most {most} nodes at a time",
        swept.cleaned + swept.zombies,
        swept.zombies
    );
    assert!(swept.cleaned + swept.zombies > 0, "none had a node");
    // The abandoned folders of nodes that nobody knows are left until they are old: at most the last few.
    let left = cleanup::node_count(&instance);
    assert!(
        left <= 1 + kills as usize / 10,
        "{left} nodes of {kills} are left"
    );
    let fresh = Session::open(&instance, "mavlink_gateway").unwrap();
    assert!(fresh.output(topics::LINK_STATUS, "", 3).is_ok());
    drop((fresh, _held, supervisor));
    instance.wipe().unwrap();
    std::fs::remove_dir_all(instance.folder()).unwrap();
}

#[test]
fn their_places_are_for_whoever_comes_next() {
    let instance: Instance = format!("rt_places_{}", std::process::id()).parse().unwrap();
    instance.make_folder().unwrap();
    let supervisor = Session::open(&instance, "supervisor").unwrap();
    let held = supervisor.hold(topics::LINK_STATUS, "").unwrap();
    let input = supervisor.input(topics::LINK_STATUS, "").unwrap();
    let mut input = input.of_all_producers();
    for _ in 0..3 * MAX_PUBLISHERS {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "dead_processes_leave_nothing::child", "--nocapture"])
            .env(CHILD, instance.to_string())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        // Until it has its place.
        let begin = Instant::now();
        let mut came = false;
        while !came && begin.elapsed() < Duration::from_secs(60) {
            input.each(|_| came = true);
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(came, "no place was free");
        // What it sent last is not the next one's.
        input.each(|_| ());
    }
    drop((input, held, supervisor));
    instance.wipe().unwrap();
    std::fs::remove_dir_all(instance.folder()).unwrap();
}
