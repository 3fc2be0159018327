//! A jink with a real rangefinder, a pseudo-terminal in its place: a process for it is started and called by its name, its scans
//! arrive, it is unplugged and plugged in again without a restart, and a mistake in its table is one line.

use jink_runtime::Instance;
use jink_testkit::pseudo_terminal::plug_in;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, TempFolder, answer, program, until};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// A TF-Luna that sees something at one distance, a hundred times a second, until it is unplugged.
struct Luna {
    plugged: Arc<AtomicBool>,
    speaker: Option<JoinHandle<()>>,
}

impl Luna {
    /// Plugged in at a line that is reachable under `path`.
    fn plug_in(path: &Path, distance_cm: u16) -> Self {
        let control = plug_in(path);
        // A write to a line that nobody reads must not keep the test from its end.
        rustix::fs::fcntl_setfl(&control, rustix::fs::OFlags::NONBLOCK).unwrap();
        let plugged = Arc::new(AtomicBool::new(true));
        let is_plugged = Arc::clone(&plugged);
        let speaker = std::thread::spawn(move || {
            let [low, high] = distance_cm.to_le_bytes();
            let mut frame = vec![0x59, 0x59, low, high, 0xE8, 0x03, 0xC8, 0x08];
            frame.push(frame.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte)));
            while is_plugged.load(Ordering::Relaxed) {
                let _full_while_nobody_reads = rustix::io::write(&control, &frame);
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        Self {
            plugged,
            speaker: Some(speaker),
        }
    }
}

impl Drop for Luna {
    fn drop(&mut self) {
        self.plugged.store(false, Ordering::Relaxed);
        if let Some(speaker) = self.speaker.take() {
            let _ended = speaker.join();
        }
    }
}

fn rangefinder(model: &str, device: &Path) -> String {
    format!(
        "[[sensor]]\nname = \"front\"\nkind = \"rangefinder\"\nmodel = \"{model}\"\ndevice = {device:?}\norientation = \"forward\"\n"
    )
}

/// The log of the process called "front" in the instance that `System::up` makes for `role`.
fn log(role: &str) -> String {
    let instance: Instance = format!("t_{role}_{}", std::process::id()).parse().unwrap();
    let mut logs: Vec<PathBuf> = std::fs::read_dir(instance.log_folder())
        .unwrap()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| {
            path.file_name()
                .and_then(|name| name.to_str())
                .is_some_and(|name| name.starts_with("front"))
        })
        .collect();
    logs.sort();
    logs.iter()
        .map(|path| std::fs::read_to_string(path).unwrap_or_default())
        .collect()
}

#[test]
fn its_scans_arrive_and_a_loose_plug_is_reported_and_survived() {
    let role = "luna";
    let place = TempFolder::new("luna_line");
    let device = place.path().join("ttyLUNA");
    let luna = Luna::plug_in(&device, 300);
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
    until("a scan", || scan().contains("range_m: [ 3.0,"));
    let said = scan();
    assert!(
        said.contains("beams: 1") && said.contains("range_max_m: 8.0"),
        "{said}"
    );
    let before = jink.service("front");
    assert!(before["pid"].as_u64().is_some_and(|pid| pid > 0), "{before:#}");

    drop(luna);
    until("the loss", || log(role).contains("jink: rangefinder front lost"));
    let _again = Luna::plug_in(&device, 450);
    until("the return", || {
        log(role).contains("jink: rangefinder front back")
    });
    until("a scan of the new line", || scan().contains("range_m: [ 4.5,"));

    let after = jink.service("front");
    assert_eq!(
        (&after["pid"], &after["restarts"]),
        (&before["pid"], &0.into()),
        "{after:#}"
    );
    assert_eq!(
        log(role).matches("rangefinder front lost").count(),
        1,
        "reported once"
    );
}

#[test]
fn a_mistake_in_its_table_is_one_line_that_says_what_is_possible() {
    let folder = TempFolder::with_sensors("luno", &rangefinder("tf_luno", Path::new("/dev/nothing")));
    let instance = format!("luno_{}", std::process::id());
    let link = format!("udpin:127.0.0.1:{}", free_udp_port());
    let arguments = [
        "--instance",
        &instance,
        "up",
        "--detach",
        "--config",
        folder.text(),
        "--link",
        &link,
    ];
    let refused = answer(&mut program("jink", &arguments));
    if refused.code == Some(0) {
        answer(&mut program("jink", &["--instance", &instance, "down"]));
    }
    // The logs of a failed start are kept for the user; here nobody reads them.
    let _none_was_made = std::fs::remove_dir_all(instance.parse::<Instance>().unwrap().folder());
    assert_eq!(refused.code, Some(78), "{refused:?}");
    let first = refused.stderr.lines().next().unwrap_or_default();
    assert!(first.starts_with("jink: cannot start: "), "{refused:?}");
    let said = "sensor \"front\": model = \"tf_luno\" is not possible; possible: sf45b, cm8jl65, tfmini";
    assert!(first.contains(said), "{refused:?}");
}

#[test]
fn in_a_virtual_world_it_is_rendered_and_no_process_is_started_for_it() {
    let folder = TempFolder::with_sensors("virtual", &rangefinder("tf_luna", Path::new("/dev/nothing")));
    let link = format!("udpin:127.0.0.1:{}", free_udp_port());
    let jink = System::up(
        "virt",
        &["--config", folder.text(), "--link", &link, "--world", "forest"],
    );
    let status = jink.status();
    let names: Vec<&str> = status["services"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|service| service["name"].as_str())
        .collect();
    assert!(
        names.contains(&"sensors") && !names.contains(&"front"),
        "{names:?}"
    );
}
