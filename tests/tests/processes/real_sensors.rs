//! What the tests of sensors at real devices share.

use jink_runtime::Instance;
use jink_testkit::pseudo_terminal::plug_in;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, TempFolder, answer, program};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// A TF-Luna at a pseudo-terminal, a hundred frames a second until it is unplugged.
pub struct Luna {
    stop: Arc<AtomicBool>,
    speaker: Option<JoinHandle<OwnedFd>>,
}

impl Luna {
    /// Plugged in under `path`; what it says of its `i`th measurement is `distance_cm(i)`.
    pub fn plug_in(path: &Path, distance_cm: impl Fn(u16) -> u16 + Send + 'static) -> Self {
        let control = plug_in(path);
        // A write to a line that nobody reads must not keep the test from its end.
        rustix::fs::fcntl_setfl(&control, rustix::fs::OFlags::NONBLOCK).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&stop);
        let speaker = std::thread::spawn(move || {
            let mut number = 0_u16;
            while !is_over.load(Ordering::Relaxed) {
                let [low, high] = distance_cm(number).to_le_bytes();
                let mut frame = vec![0x59, 0x59, low, high, 0xE8, 0x03, 0xC8, 0x08];
                frame.push(frame.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte)));
                let _full_while_nobody_reads = rustix::io::write(&control, &frame);
                number = number.wrapping_add(1);
                std::thread::sleep(Duration::from_millis(10));
            }
            control
        });
        Self {
            stop,
            speaker: Some(speaker),
        }
    }

    /// Says nothing any more, and is gone.
    pub fn unplug(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(speaker) = self.speaker.take() {
            drop(speaker.join());
        }
    }
}

impl Drop for Luna {
    fn drop(&mut self) {
        self.unplug();
    }
}

/// The log of the process called `name` in the instance that `System::up` makes for `role`.
pub fn log(role: &str, name: &str) -> String {
    let instance: Instance = format!("t_{role}_{}", std::process::id()).parse().unwrap();
    let entries = std::fs::read_dir(instance.log_folder()).unwrap().flatten();
    let mut logs: Vec<PathBuf> = entries
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(name))
        .map(|entry| entry.path())
        .collect();
    logs.sort();
    logs.iter()
        .map(|path| std::fs::read_to_string(path).unwrap_or_default())
        .collect()
}

/// The first line of what is said to these `sensors`, with which nothing starts.
pub fn refusal(role: &str, sensors: &str) -> String {
    let folder = TempFolder::with_sensors(role, sensors);
    let instance = format!("{role}_{}", std::process::id());
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
    refused.stderr.lines().next().unwrap_or_default().to_owned()
}

/// In a virtual world `sensors`, one called "front", are rendered: no process is started for it.
pub fn assert_rendered(role: &str, sensors: &str) {
    let folder = TempFolder::with_sensors(role, sensors);
    let link = format!("udpin:127.0.0.1:{}", free_udp_port());
    let jink = System::up(
        role,
        &["--config", folder.text(), "--link", &link, "--world", "forest"],
    );
    let status = jink.status();
    let names: Vec<&str> = (status["services"].as_array().unwrap().iter())
        .filter_map(|service| service["name"].as_str())
        .collect();
    assert!(
        names.contains(&"sensors") && !names.contains(&"front"),
        "{names:?}"
    );
}
