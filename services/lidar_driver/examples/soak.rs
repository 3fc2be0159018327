//! A long stream of damaged, doubled, lost and reordered packets through the whole step, with what became of it, and
//! the time that a packet takes.
//!
//! `cargo run --release -p jink-lidar-driver --example soak -- [FRAMES]`: frames of an Ouster OS1-128 at 1024x10,
//! 10,000 without a number.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a measurement that cannot be made has no result"
)]

#[path = "../tests/it/encoder/mod.rs"]
mod encoder;

use encoder::{ouster_metadata, ouster_standard, spec};
use jink_lidar_driver::ouster::Metadata;
use jink_lidar_driver::{CloudAssembler, Decoder, NetworkLidarDriver};
use jink_shared_types::Timestamp;
use jink_shared_types::quantile::quantiles;
use jink_shared_types::ranges::PointCloud;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::net::{IpAddr, Ipv4Addr};
use std::time::Instant;

const ROWS: usize = 128;
const COLUMNS: usize = 1_024;
const PACKETS: usize = COLUMNS / 16;

fn main() {
    let frames: usize = std::env::args()
        .nth(1)
        .map_or(10_000, |text| text.parse().expect("a number of frames"));
    let metadata = Metadata::parse(&ouster_metadata(ROWS, COLUMNS, "RNG19_RFL8_SIG16_NIR16")).unwrap();
    let spec = spec("lidar_3d", "ouster", "udp:127.0.0.1:0", "metadata = \"/x\"\n");
    let mut driver = NetworkLidarDriver::new(spec, Some(Decoder::ouster(metadata)));
    // Checksums take longer than decoding: packets are made once for a few frames.
    let made: Vec<Vec<u8>> = (0..8 * PACKETS)
        .map(|index| {
            let (frame, first) = (index / PACKETS, index % PACKETS * 16);
            ouster_standard(
                frame as u16,
                first,
                ROWS,
                index as u64 * 1_562_500,
                &|row, column| 1_000 + (row * 37 + column * 11 + frame) as u32 % 20_000,
            )
        })
        .collect();
    let sensor = IpAddr::V4(Ipv4Addr::LOCALHOST);
    let mut random = Xoshiro256PlusPlus::seed_from_u64(17);
    let mut cloud = PointCloud::boxed();
    let (mut points, mut times_us, mut sent) = (0u64, Vec::with_capacity(frames * PACKETS), [0u64; 5]);
    for frame in 0..frames {
        for place in 0..PACKETS {
            let index = frame * PACKETS + place;
            let now = Timestamp::from_ns(1_000_000_000 + index as u64 * 1_562_500);
            let mut bytes = made[index % made.len()].clone();
            let mut times = 1;
            match random.random_range(0..1_000) {
                0..5 => {
                    sent[0] += 1;
                    continue;
                }
                5..10 => (sent[1], times) = (sent[1] + 1, 2),
                10..20 => {
                    let at = random.random_range(0..bytes.len());
                    bytes[at] ^= 1 << random.random_range(0..8);
                    sent[2] += 1;
                }
                20..25 => {
                    bytes.truncate(random.random_range(0..bytes.len()));
                    sent[3] += 1;
                }
                25..30 => {
                    bytes.clone_from(&made[(index + made.len() - 1) % made.len()]);
                    sent[4] += 1;
                }
                _ => {}
            }
            for _ in 0..times {
                let begun = Instant::now();
                driver.datagram(now, sensor, &bytes, &mut |assembler: &CloudAssembler| {
                    assembler.write(&mut cloud);
                    points += u64::from(cloud.len);
                });
                times_us.push(begun.elapsed().as_nanos() as f64 * 1e-3);
            }
        }
    }
    let [p50, p99, p999, max] = quantiles(&times_us, [0.5, 0.99, 0.999, 1.0]).unwrap_or_default();
    let [lost, doubled, flipped, cut, repeated] = sent;
    println!(
        "{frames} frames: {lost} packets left out, {doubled} sent twice, {flipped} with a flipped bit, {cut} cut, {repeated} replaced by the one before"
    );
    println!("{:?}", driver.counters(Timestamp::from_seconds(1e6)));
    println!("{points} points");
    println!(
        "us per packet of {} bytes: p50 {p50:.1}, p99 {p99:.1}, p99.9 {p999:.1}, max {max:.1} (a cloud is written in one of 64)",
        made[0].len()
    );
}
