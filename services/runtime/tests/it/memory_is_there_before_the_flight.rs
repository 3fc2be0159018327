//! Shared memory that is full, in flight or before, ends nobody by a signal: what the services need was taken when they were opened,
//! and what is not there is said. In a process with a small /dev/shm of its own.

use jink_runtime::{Instance, OpenError, Session, now};
use jink_shared_types::SampleHeader;
use jink_shared_types::ranges::{CLOUD_POINTS, PointCloud};
use jink_shared_types::topics::{self, RANGE_CLOUD, SPECTATOR};
use std::io::Write;
use std::process::Command;

/// Says to a process that its /dev/shm is its own.
const CHILD: &str = "JINK_TEST_SMALL_MEMORY";

/// Runs the test `name` in a process with `megabytes` of shared memory of its own; false if that is not to be had here.
fn with_memory(name: &str, megabytes: usize) -> bool {
    let script = format!(
        "mount --make-rprivate / && mount -t tmpfs -o size={megabytes}m tmpfs /dev/shm || exit 77; exec \"$0\" --exact \"$1\" --nocapture"
    );
    let output = Command::new("unshare")
        .args(["--mount", "--propagation", "unchanged", "sh", "-c", &script])
        .arg(std::env::current_exe().unwrap())
        .arg(format!("memory_is_there_before_the_flight::{name}"))
        .env(CHILD, "")
        .output();
    let may = output.as_ref().is_ok_and(|output| {
        let refused = String::from_utf8_lossy(&output.stderr).contains("Operation not permitted");
        output.status.code() != Some(77) && !refused
    });
    if !may {
        jink_testkit::not_tested("only root can have a /dev/shm of its own, and nobody in a chroot");
        return false;
    }
    let output = output.unwrap();
    let said =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && said.contains("1 passed"),
        "{}: {said}",
        output.status
    );
    true
}

fn is_child() -> bool {
    std::env::var_os(CHILD).is_some()
}

fn instance() -> Instance {
    "small".parse().unwrap()
}

/// Takes all that is left.
fn fill() -> std::fs::File {
    let mut file = std::fs::File::create("/dev/shm/filler").unwrap();
    for size in [1 << 20, 4096, 1] {
        while file.write_all(&vec![1; size]).is_ok() {}
    }
    file
}

/// A sweep with every point that there is room for.
fn write_all(cloud: &mut PointCloud) {
    cloud.len = CLOUD_POINTS as u32;
    (cloud.range_min_m, cloud.range_max_m, cloud.range_sigma_m) = (0.1, 100.0, 0.02);
    for point in &mut cloud.points {
        point.forward_m = 1.0;
    }
}

#[test]
fn child_in_flight() {
    if !is_child() {
        return;
    }
    let instance = instance();
    let supervisor = Session::open(&instance, "supervisor").unwrap();
    let _held = supervisor.hold(RANGE_CLOUD, "lidar").unwrap();
    let driver = Session::open(&instance, "lidar_driver").unwrap();
    let mut clouds = driver.output(RANGE_CLOUD, "lidar", 1).unwrap();
    driver.reserve().unwrap();
    let readers = RANGE_CLOUD.row.consumers.iter().map(|program| {
        let session = Session::open(&instance, program).unwrap();
        (session.input(RANGE_CLOUD, "lidar").unwrap(), session)
    });
    let mut readers: Vec<_> = readers.collect();
    clouds.announce();
    let _full = fill();
    // Nobody reads, then everybody holds one, and each is written in full.
    for _ in 0..2 {
        for _ in 0..20 {
            let header = SampleHeader::at(now());
            assert!(clouds.write(header, write_all), "what the services need is there");
        }
        for (input, _) in &mut readers {
            input.latest(now());
            assert!(input.newest().is_some());
        }
    }
    let refused = Session::open(&instance, SPECTATOR).map(|_| ()).unwrap_err();
    assert!(matches!(refused, OpenError::NoRoom { .. }), "{refused}");
}

#[test]
fn memory_that_is_full_in_flight_stops_no_sample() {
    with_memory("child_in_flight", 40);
}

#[test]
fn child_with_spectators() {
    if !is_child() {
        return;
    }
    let instance = instance();
    let driver = Session::open(&instance, "lidar_driver").unwrap();
    let mut clouds = driver.output(RANGE_CLOUD, "lidar", 1).unwrap();
    let programs = RANGE_CLOUD.row.consumers.iter();
    let programs = programs.chain([&SPECTATOR; 3]);
    let readers: Vec<_> = programs
        .map(|program| {
            let session = Session::open(&instance, program).unwrap();
            (session.input(RANGE_CLOUD, "lidar").unwrap(), session)
        })
        .collect();
    clouds.announce();
    let _full = fill();
    // Nobody ever reads: more is held than the services need, and there is no memory for that.
    let sent = (0..100)
        .filter(|_| clouds.write(SampleHeader::at(now()), write_all))
        .count();
    assert!(sent >= RANGE_CLOUD.row.reserved_slots() - 2, "{sent}");
    drop(readers);
}

#[test]
fn what_spectators_hold_besides_is_not_written_where_there_is_no_memory() {
    with_memory("child_with_spectators", 40);
}

#[test]
fn child_at_the_start() {
    if !is_child() {
        return;
    }
    let driver = Session::open(&instance(), "lidar_driver").unwrap();
    let refused = driver.output(RANGE_CLOUD, "lidar", 1).map(|_| ()).unwrap_err();
    assert!(matches!(refused, OpenError::NoRoom { .. }), "{refused}");
    let text = refused.to_string();
    assert!(
        text.contains("range/cloud/lidar: 23.") && text.contains("available in /dev/shm"),
        "{text}"
    );
    assert!(
        driver.output(topics::LINK_STATUS, "", 1).is_err(),
        "of another row"
    );
}

#[test]
fn too_little_is_said_when_the_topic_is_opened() {
    with_memory("child_at_the_start", 8);
}
