//! A jink with a real rangefinder, a pseudo-terminal in its place: a process for it is started and called by its name, its scans
//! arrive, it is unplugged and plugged in again without a restart, and a mistake in its table is one line.

use crate::real_sensors::{Luna, assert_rendered, log, refusal};
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, TempFolder, until};
use std::path::Path;

fn rangefinder(model: &str, device: &Path) -> String {
    format!(
        "[[sensor]]\nname = \"front\"\nkind = \"rangefinder\"\nmodel = \"{model}\"\ndevice = {device:?}\norientation = \"forward\"\n"
    )
}

#[test]
fn its_scans_arrive_and_a_loose_plug_is_reported_and_survived() {
    let role = "luna";
    let place = TempFolder::new("luna_line");
    let device = place.path().join("ttyLUNA");
    let luna = Luna::plug_in(&device, |_| 300);
    let folder = TempFolder::with_sensors("luna", &rangefinder("tf_luna", &device));
    let link = format!("udpin:127.0.0.1:{}", free_udp_port());
    let jink = System::up(role, &["--config", folder.text(), "--link", &link]);
    // The newest scan on one line.
    let scan = || {
        let echo = [
            "topic",
            "echo",
            "range/scan/front",
            "--count",
            "1",
            "--timeout",
            "2",
        ];
        let said = jink.jink(&echo).stdout;
        said.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    until("a scan", || scan().contains("range_m: [3.000]"));
    let said = scan();
    assert!(
        said.contains("beams: 1") && said.contains("range_max_m: 8.0"),
        "{said}"
    );
    let before = jink.service("front");
    assert!(before["pid"].as_u64().is_some_and(|pid| pid > 0), "{before:#}");

    drop(luna);
    until("the loss", || {
        log(role, "front").contains("jink: rangefinder front lost")
    });
    let _again = Luna::plug_in(&device, |_| 450);
    until("the return", || {
        log(role, "front").contains("jink: rangefinder front back")
    });
    until("a scan of the new line", || scan().contains("range_m: [4.500]"));

    let after = jink.service("front");
    assert_eq!(after["pid"], before["pid"], "{after:#}");
    assert_eq!(
        log(role, "front").matches("rangefinder front lost").count(),
        1,
        "reported once"
    );
}

#[test]
fn a_mistake_in_its_table_is_one_line_that_says_what_is_possible() {
    let refused = refusal("luno", &rangefinder("tf_luno", Path::new("/dev/nothing")));
    let said = "sensor \"front\": model = \"tf_luno\" is not possible; possible: sf45b, cm8jl65, tfmini";
    assert!(
        refused.starts_with("jink: cannot start: ") && refused.contains(said),
        "{refused}"
    );
}

#[test]
fn in_a_virtual_world_it_is_rendered_and_no_process_is_started_for_it() {
    assert_rendered("virt", &rangefinder("tf_luna", Path::new("/dev/nothing")));
}
