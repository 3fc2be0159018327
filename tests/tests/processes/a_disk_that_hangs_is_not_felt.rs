//! Every log of a flight is on a disk that stands still for a quarter of a minute, as an SD card does that tidies up or fails: no process
//! of the flight waits for it, killed ones come back, and what was written meanwhile is there afterwards.

use jink_testkit::not_tested;
use jink_tests::processes::{Flight, TempFolder, until};
use std::path::Path;
use std::process::Command;

/// A file system of its own, which can be frozen.
struct Disk {
    folder: TempFolder,
}

impl Disk {
    fn new() -> Option<Self> {
        let folder = TempFolder::new("hanging_disk");
        let image = folder.path().join("image");
        let disk = Self { folder };
        std::fs::File::create(&image).unwrap().set_len(256 << 20).unwrap();
        std::fs::create_dir(disk.path()).unwrap();
        let run = |program: &str, arguments: &[&str]| {
            let ran = Command::new(program).args(arguments).output();
            ran.is_ok_and(|output| output.status.success())
        };
        let (image, mounted) = (image.to_str().unwrap(), disk.path());
        let is_there = run("mkfs.ext4", &["-q", "-F", image])
            && run("mount", &["-o", "loop", image, mounted.to_str().unwrap()]);
        is_there.then_some(disk)
    }

    fn path(&self) -> std::path::PathBuf {
        self.folder.path().join("disk")
    }

    fn freeze(&self, how: &str) -> bool {
        let ran = Command::new("fsfreeze").arg(how).arg(self.path()).output();
        ran.is_ok_and(|output| output.status.success())
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // It may not be frozen.
        let _thawed = self.freeze("--unfreeze");
        let _unmounted = Command::new("umount").arg("-l").arg(self.path()).output();
    }
}

/// All that the files below a folder hold.
fn all_text(folder: &Path) -> String {
    let mut text = String::new();
    for path in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = path.path();
        match path.is_dir() {
            true => text += &all_text(&path),
            false => text += &String::from_utf8_lossy(&std::fs::read(path).unwrap()),
        }
    }
    text
}

#[test]
fn logs_telemetry_log_and_recordings_are_on_it() {
    let Some(disk) = Disk::new() else {
        not_tested("no disk that can be frozen can be made: that needs root, mkfs.ext4 and a loop device");
        return;
    };
    let place = disk.path();
    let sets = [
        ("log_dir", "logs"),
        ("link.tlog", "tlog"),
        ("recorder.folder", "recordings"),
    ]
    .map(|(key, folder)| format!("{key}={}", place.join(folder).display()));
    let mut arguments = vec!["--seed", "1", "--legs", "4"];
    arguments.extend(sets.iter().flat_map(|set| ["--set", set.as_str()]));
    let flight = Flight::begin(&arguments);
    flight.until_it_flies();
    if !disk.freeze("--freeze") {
        not_tested("no fsfreeze");
        return;
    }
    for service in ["mavlink_gateway", "collision_guard", "planner", "obstacle_fusion"] {
        let killed = flight.kill(service);
        until("another one, while the disk hangs", || {
            let now = flight.service(service);
            now["state"] == "active" && now["pid"].as_i64() != Some(killed)
        });
    }
    let recorder_says = |text: &str| flight.jink(&["log", "recorder"]).stdout.contains(text);
    until("the text about the logs", || {
        recorder_says("jink: no room for logs")
    });
    until("good health", || flight.status()["link"]["avoidance"] == "active");
    let table = flight.jink(&["status"]).stdout;
    assert!(table.contains("logs: full"), "{table}");
    assert!(disk.freeze("--unfreeze"));
    until("logs on the disk", || recorder_says("jink: logs are kept again"));
    let figures = flight.end();
    assert_eq!(figures["outcome"], "goal", "{figures}");
    assert_eq!(figures["collisions"], 0, "{figures}");
    assert_eq!(figures["fcu_hold_count"], 0, "{figures}");
    let logs = all_text(&place.join("logs"));
    for text in ["collision_guard", "ended: signal 9", "stopped"] {
        assert!(logs.contains(text), "{text}: {logs}");
    }
    let size = |folder: &str| all_text(&place.join(folder)).len();
    assert!(
        size("tlog") > 100_000 && size("recordings") > 1_000_000,
        "{} {}",
        size("tlog"),
        size("recordings")
    );
}
