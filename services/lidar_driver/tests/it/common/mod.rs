//! What the tests share: tables of returns, scratch folders, recordings that are written, and the Python decoders to
//! compare with.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a helper that cannot do its work fails the test"
)]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, PoisonError};

/// A file of this crate.
pub fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// A file of ../shared beside the checkout; reports where there is none.
pub fn shared(path: &str) -> Option<PathBuf> {
    let found = here("../../../shared").join(path);
    let found = if found.is_file() {
        found
    } else {
        here("../../../../shared").join(path)
    };
    if found.is_file() {
        return Some(found);
    }
    jink_testkit::not_tested(&format!("there is no ../shared/{path}"));
    None
}

/// One line of a table of returns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Scan, row, column.
    pub key: [u32; 3],
    /// Range (m).
    pub range_m: f64,
    /// Point in the sensor frame (m).
    pub point_m: [f64; 3],
}

impl Row {
    /// Angle between both directions (deg).
    pub fn angle_to_deg(&self, other: &Self) -> f64 {
        let (a, b) = (self.point_m, other.point_m);
        let cross =
            [0, 1, 2].map(|i: usize| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]);
        let sine = cross.iter().map(|part| part * part).sum::<f64>().sqrt();
        let cosine: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        sine.atan2(cosine).to_degrees()
    }
}

/// The lines of a table, its head aside.
pub fn rows(text: &str) -> Vec<Row> {
    let lines = text.lines().filter(|line| !line.starts_with("scan"));
    lines
        .map(|line| {
            let numbers: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
            let [scan, row, column, range_m, x, y, z] = numbers[..] else {
                panic!("{line}");
            };
            Row {
                key: [scan as u32, row as u32, column as u32],
                range_m,
                point_m: [x, y, z],
            }
        })
        .collect()
}

/// The decoders of others, in a Python environment in the target folder.
pub struct Oracle(PathBuf);

static MAKING: Mutex<()> = Mutex::new(());

impl Oracle {
    /// Makes the environment if there is none; reports where that is impossible.
    pub fn find() -> Option<Self> {
        let _guard = MAKING.lock().unwrap_or_else(PoisonError::into_inner);
        let venv = here("../../target/python_lidar");
        let python = venv.join("bin/python");
        let works = || {
            let imports = "import ouster.sdk, velodyne_decoder";
            let status = Command::new(&python).args(["-c", imports]).output();
            status.is_ok_and(|output| output.status.success())
        };
        if !works() {
            let script = "python3 -m venv \"$0\" && \"$0/bin/pip\" install --quiet ouster-sdk==1.0.1 velodyne-decoder==3.1.0";
            let made = Command::new("sh").arg("-c").arg(script).arg(&venv).output();
            let answer = made.map_or_else(
                |error| error.to_string(),
                |output| String::from_utf8_lossy(&output.stderr).into_owned(),
            );
            if !works() {
                jink_testkit::not_tested(&format!(
                    "no Python with ouster-sdk and velodyne-decoder: {answer}"
                ));
                return None;
            }
        }
        Some(Self(python))
    }

    /// Standard output of a script in tests/oracle.
    pub fn run(&self, script: &str, arguments: &[&Path]) -> String {
        let mut command = Command::new(&self.0);
        command.arg(here("tests/oracle").join(script)).args(arguments);
        let output = command.output().unwrap();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout).unwrap()
    }
}

/// Header checksum of IPv4.
fn ip_sum(header: &[u8]) -> u16 {
    let sum: u32 = header
        .chunks(2)
        .map(|pair| u32::from(u16::from_be_bytes([pair[0], pair[1]])))
        .sum();
    let folded = (sum & 0xFFFF) + (sum >> 16);
    !((folded & 0xFFFF) + (folded >> 16)) as u16
}

/// IPv4 packets that carry a UDP datagram from 192.168.1.201:2368 to port `port`, in fragments of at most `most` bytes.
pub fn ipv4(payload: &[u8], port: u16, number: u16, most: usize) -> Vec<Vec<u8>> {
    let mut udp = [
        2368u16.to_be_bytes(),
        port.to_be_bytes(),
        (payload.len() as u16 + 8).to_be_bytes(),
        [0; 2],
    ]
    .concat();
    udp.extend(payload);
    let most = most / 8 * 8;
    let count = udp.len().div_ceil(most);
    let parts = udp.chunks(most).enumerate();
    parts
        .map(|(index, part)| {
            let mut ip = vec![0x45, 0];
            ip.extend((part.len() as u16 + 20).to_be_bytes());
            ip.extend(number.to_be_bytes());
            let more = u16::from(index + 1 < count) << 13;
            ip.extend((more | (index * most / 8) as u16).to_be_bytes());
            ip.extend([64, 17, 0, 0, 192, 168, 1, 201, 192, 168, 1, 77]);
            let sum = ip_sum(&ip);
            ip[10..12].copy_from_slice(&sum.to_be_bytes());
            ip.extend(part);
            ip
        })
        .collect()
}

/// A frame of Ethernet, with as many VLAN tags.
pub fn ethernet(ip: &[u8], tags: usize) -> Vec<u8> {
    let mut frame = vec![0xFF; 12];
    for _ in 0..tags {
        frame.extend([0x81, 0x00, 0x00, 0x05]);
    }
    frame.extend([0x08, 0x00]);
    frame.extend(ip);
    frame
}

/// A classic pcap file: link type, and frames with their time (ns).
pub fn pcap(big_endian: bool, nanoseconds: bool, link: u32, frames: &[(u64, Vec<u8>)]) -> Vec<u8> {
    let word = |value: u32| {
        if big_endian {
            value.to_be_bytes()
        } else {
            value.to_le_bytes()
        }
    };
    let half = |value: u16| {
        if big_endian {
            value.to_be_bytes()
        } else {
            value.to_le_bytes()
        }
    };
    let mut file = word(if nanoseconds { 0xA1B2_3C4D } else { 0xA1B2_C3D4 }).to_vec();
    file.extend(half(2));
    file.extend(half(4));
    for value in [0, 0, 262_144, link] {
        file.extend(word(value));
    }
    for (time_ns, frame) in frames {
        let unit = if nanoseconds { 1 } else { 1_000 };
        file.extend(word((time_ns / 1_000_000_000) as u32));
        file.extend(word((time_ns % 1_000_000_000 / unit) as u32));
        file.extend(word(frame.len() as u32));
        file.extend(word(frame.len() as u32));
        file.extend(frame);
    }
    file
}

/// A pcapng file in little endian; `resolution`: decimal places of a second.
pub fn pcapng(resolution: u8, link: u16, frames: &[(u64, Vec<u8>)]) -> Vec<u8> {
    let frames: Vec<_> = frames
        .iter()
        .map(|(time_ns, frame)| (0, *time_ns, frame.clone()))
        .collect();
    pcapng_of_interfaces(resolution, &[link], &frames)
}

/// The same of several interfaces, each with its link type; a frame has the number of its interface.
pub fn pcapng_of_interfaces(resolution: u8, links: &[u16], frames: &[(u32, u64, Vec<u8>)]) -> Vec<u8> {
    fn block(kind: u32, body: &[u8]) -> Vec<u8> {
        let padded = body.len().div_ceil(4) * 4;
        let length = padded as u32 + 12;
        let mut bytes = [kind.to_le_bytes(), length.to_le_bytes()].concat();
        bytes.extend(body);
        bytes.resize(8 + padded, 0);
        bytes.extend(length.to_le_bytes());
        bytes
    }
    let mut section = 0x1A2B_3C4Du32.to_le_bytes().to_vec();
    section.extend([1, 0, 0, 0]);
    section.extend(u64::MAX.to_le_bytes());
    let mut file = block(0x0A0D_0D0A, &section);
    for link in links {
        let mut interface = link.to_le_bytes().to_vec();
        interface.extend([0, 0, 0, 0, 4, 0]);
        interface.extend([9, 0, 1, 0, resolution, 0, 0, 0, 0, 0, 0, 0]);
        file.extend(block(1, &interface));
    }
    for (interface, time_ns, frame) in frames {
        let units = u128::from(*time_ns) * 10u128.pow(resolution.into()) / 1_000_000_000;
        let mut packet = interface.to_le_bytes().to_vec();
        packet.extend(((units >> 32) as u32).to_le_bytes());
        packet.extend((units as u32).to_le_bytes());
        packet.extend((frame.len() as u32).to_le_bytes());
        packet.extend((frame.len() as u32).to_le_bytes());
        packet.extend(frame);
        file.extend(block(6, &packet));
    }
    file
}
