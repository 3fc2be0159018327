//! A jink with a real rangefinder, a pseudo-terminal in its place: a process for it is started and called by its name, its scans
//! arrive, it is unplugged and plugged in again without a restart, and a mistake in its table is one line.

use crate::real_sensors::{Luna, assert_rendered, log, refusal};
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, TempFolder, until};
use std::path::Path;

/// What it measures each time it is plugged in again (cm).
const UNPLUGGED_CM: [u16; 3] = [450, 500, 350];

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
    let pid = || jink.service("front")["pid"].as_u64();
    let said = |text: &str| log(role, "front").matches(text).count();
    let mut line = Some(luna);
    for distance_cm in UNPLUGGED_CM {
        let (before, told) = (pid(), said("rangefinder front lost"));
        assert!(before.is_some_and(|pid| pid > 0));
        drop(line.take());
        until("the loss", || said("rangefinder front lost") > told);
        line = Some(Luna::plug_in(&device, move |_| distance_cm));
        until("the return", || said("rangefinder front back") > told);
        let range = format!("range_m: [{:.3}]", f64::from(distance_cm) * 0.01);
        until("a scan of the new line", || scan().contains(&range));
        assert_eq!(said("rangefinder front lost"), told + 1, "reported once");
        if pid() == before {
            return;
        }
        // A processor that stands still for a quarter of a second has its process replaced, which no plug does.
        assert_eq!(jink.service("front")["reason"], "hung");
    }
    panic!(
        "its process is replaced whenever it is unplugged: {:#}",
        jink.service("front")
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
