//! A jink with a real lidar, a socket in its place: a process for it is started and called by its name, its clouds arrive, silence is
//! reported and survived, and a mistake in its table is one line.

use crate::real_sensors::{log, refusal};
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, TempFolder, until};
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A VLP-16 that turns ten times a second in a round room, until it is switched off.
struct Puck {
    on: Arc<AtomicBool>,
    sender: Option<JoinHandle<()>>,
}

impl Puck {
    fn switch_on(port: u16, range_m: f64) -> Self {
        let on = Arc::new(AtomicBool::new(true));
        let is_on = Arc::clone(&on);
        let sender = std::thread::spawn(move || {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            let begun = Instant::now();
            let mut number = 0u32;
            while is_on.load(Ordering::Relaxed) {
                // A packet covers 24 firings of 55.296 us.
                while f64::from(number) * 1_327.104e-6 < begun.elapsed().as_secs_f64() {
                    let _nobody_listens = socket.send_to(&packet(number, range_m), ("127.0.0.1", port));
                    number += 1;
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        });
        Self {
            on,
            sender: Some(sender),
        }
    }
}

impl Drop for Puck {
    fn drop(&mut self) {
        self.on.store(false, Ordering::Relaxed);
        if let Some(sender) = self.sender.take() {
            let _ended = sender.join();
        }
    }
}

fn packet(number: u32, range_m: f64) -> Vec<u8> {
    let mut packet = Vec::new();
    for block in 0..12u32 {
        let azimuth = (f64::from(number * 12 + block) * 39.813) as u32 % 36_000;
        packet.extend([0xFF, 0xEE]);
        packet.extend((azimuth as u16).to_le_bytes());
        for _ in 0..32 {
            packet.extend(((range_m / 0.002) as u16).to_le_bytes());
            packet.push(50);
        }
    }
    packet.extend(((f64::from(number) * 1_327.104) as u32).to_le_bytes());
    packet.extend([0x37, 0x22]);
    packet
}

fn lidar(keys: &str) -> String {
    format!("[[sensor]]\nname = \"top\"\nkind = \"lidar_3d\"\n{keys}\n")
}

#[test]
fn its_clouds_arrive_and_silence_is_reported_and_survived() {
    let role = "puck";
    let port = free_udp_port();
    let keys = format!("model = \"vlp16\"\ndevice = \"udp:127.0.0.1:{port}\"\nrange_max_m = 60");
    let folder = TempFolder::with_sensors(role, &lidar(&keys));
    let puck = Puck::switch_on(port, 4.0);
    let link = format!("udpin:127.0.0.1:{}", free_udp_port());
    let jink = System::up(role, &["--config", folder.text(), "--link", &link]);
    let cloud = || {
        let echo = [
            "topic",
            "echo",
            "range/cloud/top",
            "--count",
            "1",
            "--timeout",
            "2",
        ];
        jink.jink(&echo)
            .stdout
            .split_whitespace()
            .collect::<Vec<_>>()
            .join(" ")
    };
    until("a cloud", || cloud().contains("range_max_m: 60.000"));
    let before = jink.service("top");
    assert!(before["pid"].as_u64().is_some_and(|pid| pid > 0), "{before:#}");
    drop(puck);
    until("the loss", || log(role, "top").contains("jink: lidar top lost"));
    let _again = Puck::switch_on(port, 5.0);
    until("the return", || log(role, "top").contains("jink: lidar top back"));
    until("a cloud again", || cloud().contains("range_max_m: 60.000"));
    let after = jink.service("top");
    assert_eq!(
        (&after["pid"], &after["restarts"]),
        (&before["pid"], &0.into()),
        "{after:#}"
    );
    assert_eq!(
        log(role, "top").matches("lidar top lost").count(),
        1,
        "reported once"
    );
}

#[test]
fn a_mistake_in_its_table_is_one_line_with_file_and_line() {
    let refused = refusal(
        "pack",
        &lidar("model = \"vlp61\"\ndevice = \"udp:127.0.0.1:2368\""),
    );
    let said = "sensor \"top\": model = \"vlp61\" is not possible; possible: ouster, ";
    assert!(
        refused.contains(said) && refused.contains("jink.toml:"),
        "{refused}"
    );
}
