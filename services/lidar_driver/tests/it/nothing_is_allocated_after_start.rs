//! The hot path allocates nothing: not for packets, clouds, damage, serial lines, scans, set-ups.

use crate::encoder::{ldrobot, livox1, livox2, ouster_metadata, ouster_standard, spec, vlp16};
use allocation_counter::measure;
use jink_lidar_driver::models::{self, Connection};
use jink_lidar_driver::ouster::Metadata;
use jink_lidar_driver::{CloudAssembler, Decoder, NetworkLidarDriver, ScannerDriver, Turn};
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{PointCloud, RangeScan};
use std::net::{IpAddr, Ipv4Addr};

#[test]
fn seconds_of_every_network_protocol_with_damage_in_them() {
    let source = IpAddr::V4(Ipv4Addr::LOCALHOST);
    for model in ["ouster", "vlp16", "livox_mid360", "livox_avia"] {
        let points = vec![vec![7u8; 14]; 96];
        let packets: Vec<Vec<u8>> = (0..3_000usize)
            .map(|index| {
                let mut packet = match model {
                    "ouster" => ouster_standard(
                        (index / 32) as u16,
                        index % 32 * 16,
                        16,
                        index as u64 * 1_562_500,
                        &|_, _| 9_000,
                    ),
                    "vlp16" => vlp16(
                        index as u32 * 1_327,
                        index as f64 * 480.0,
                        20.0,
                        index % 2 == 0,
                        0x22,
                        &|_, _, _| 900,
                    ),
                    "livox_mid360" => livox2(index as u16, index as u64 * 480_000, 4_800, 1, &points),
                    _ => livox1(1 + index as u64 * 400_000, 2, &points),
                };
                if index % 10 == 9 {
                    packet[700] ^= 0x55;
                }
                packet
            })
            .collect();
        let metadata = if model == "ouster" {
            "metadata = \"/x\"\n"
        } else {
            ""
        };
        let spec = spec("lidar_3d", model, "udp:127.0.0.1:0", metadata);
        let decoder = Decoder::of(spec.network().unwrap(), 10.0).unwrap_or_else(|| {
            Decoder::ouster(Metadata::parse(&ouster_metadata(16, 512, "RNG19_RFL8_SIG16_NIR16")).unwrap())
        });
        let mut driver = NetworkLidarDriver::new(spec, Some(decoder));
        let mut cloud = PointCloud::boxed();
        let mut clouds = 0;
        let allocations = measure(|| {
            for (index, packet) in packets.iter().enumerate() {
                let now = Timestamp::from_ns(1_000_000_000 + index as u64 * 1_400_000);
                let mut publish = |assembler: &CloudAssembler| {
                    assembler.write(&mut cloud);
                    clouds += 1;
                };
                driver.datagram(now, source, packet, &mut publish);
                driver.tick(now, &mut publish);
                driver.take_change(now);
                driver.counters(now);
            }
        });
        assert!(clouds > 8, "{model}: {clouds}");
        assert_eq!(allocations.count_total, 0, "{model}");
    }
}

#[test]
fn seconds_of_a_scanner_and_of_one_that_never_answers() {
    for model in ["ld06", "rplidar_a1"] {
        let Connection::Serial(protocol) = models::find(model).unwrap().connection else {
            panic!("{model}");
        };
        let mut driver = ScannerDriver::new(spec("lidar_2d", model, "/dev/x", ""), protocol);
        let wire: Vec<Vec<u8>> = (0..4_000u32)
            .map(|index| ldrobot(3_600, f64::from(index) * 9.6 % 360.0, 0.8, [1_234; 12], 0))
            .collect();
        let mut scan = RangeScan::default();
        let mut scans = 0;
        let allocations = measure(|| {
            for (index, bytes) in wire.iter().enumerate() {
                let now = Timestamp::from_ns(1_000_000_000 + index as u64 * 2_666_667);
                if index == 0 {
                    driver.connected(now);
                }
                driver.bytes(now, bytes, &mut |turn: &Turn| {
                    turn.write(&mut scan);
                    scans += 1;
                });
                while driver.next_write(now).is_some() {}
                driver.take_change(now);
                driver.counters(now);
            }
        });
        assert_eq!(allocations.count_total, 0, "{model}");
        assert_eq!(scans > 90, model == "ld06", "{model}: {scans}");
    }
}
