//! A pilot steers through jink, between trees, and the guard that keeps him from them is killed: the gateway stops the vehicle until the
//! next guard is there, and nothing is touched.

use jink_tests::campaign::{Cell, setup};
use jink_tests::pilot::Tablet;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, TempFolder, until};
use std::net::UdpSocket;
use std::time::{Duration, Instant};

const KILLS: u32 = 5;

#[test]
fn killed_again_and_again_at_full_stick_nothing_is_touched() {
    let cell = Cell {
        limit_s: 600.0,
        ..Cell::forest().unwrap()
    };
    let mut plan = setup(&cell, 3).unwrap().plan;
    plan.resume = false;
    let tablet_socket = UdpSocket::bind(("127.0.0.1", 0)).unwrap();
    let tablet_port = tablet_socket.local_addr().unwrap().port();
    let sets = [
        format!("link.address=udpin:127.0.0.1:{}", free_udp_port()),
        format!("simulation.ground_station_port={tablet_port}"),
        "simulation.autopilot=px4_current".to_owned(),
        "link.profile=px4_deviation".to_owned(),
        "params.CP_DIST=1.5".to_owned(),
        "params.MPC_VEL_MANUAL=5".to_owned(),
    ];
    let folder = TempFolder::with_config("stick");
    let mut arguments = vec!["--config", folder.text(), "--world", "forest", "--seed", "3"];
    for set in &sets {
        arguments.extend(["--set", set]);
    }
    let system = System::up("stick", &arguments);
    let tablet = Tablet::begin(tablet_socket, ("EAV_EN", 1), plan);
    system.until_it_flies();
    tablet.steer([1000, 0]);
    until("the pilot's mode", || system.truth()["mode"] == "position");
    for kill in 0..KILLS {
        // To all sides, among the trees.
        let turn = 1.3 * f64::from(kill);
        tablet.steer([(1000.0 * turn.cos()) as i16, (1000.0 * turn.sin()) as i16]);
        let before_m = system.flown_m();
        let begin = Instant::now();
        // Under way, or in front of something.
        until("motion", || {
            system.flown_m() - before_m > 1.0 || begin.elapsed() > Duration::from_secs(6)
        });
        let killed = system.kill("collision_guard");
        until("a new guard", || {
            let guard = system.service("collision_guard");
            guard["state"] == "active" && guard["pid"].as_i64().is_some_and(|pid| pid != killed)
        });
    }
    std::thread::sleep(Duration::from_secs(3));
    let number = |field: &str| system.truth_number(field).unwrap();
    println!(
        "{KILLS} kills: {} collisions, nearest {:.2} m of the hull, {:.1} m flown, in Hold {} times",
        number("collisions"),
        number("min_clearance_m"),
        number("flown_m"),
        number("hold_count")
    );
    assert_eq!(number("collisions"), 0.0);
    assert!(system.truth()["mode"] == "position", "the pilot's mode stays his");
    // It saw obstacles: the stick alone would have led into them.
    let reported = system.jink(&[
        "topic",
        "echo",
        "guard/prevented",
        "--count",
        "1",
        "--timeout",
        "2",
    ]);
    assert!(reported.stdout.contains("nearest_m"), "{reported:?}");
}
