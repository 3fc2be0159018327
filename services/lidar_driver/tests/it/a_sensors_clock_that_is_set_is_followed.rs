//! PTP, GPS and restarts set a lidar's clock, in either direction: its clouds go on, none is dated later than it was
//! measured, and within a second all are dated rightly again, which is reported once.

use crate::encoder::{livox1, livox2, ouster_metadata, ouster_standard, spec, vlp16};
use jink_lidar_driver::ouster::Metadata;
use jink_lidar_driver::{CloudAssembler, Decoder, NetworkLidarDriver};
use jink_shared_types::Timestamp;
use std::net::{IpAddr, Ipv4Addr};

const SENSOR: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 168, 1, 150));
/// Delay of a packet after its last measurement (ns), and half of a packet that is delayed more.
const DELAY_NS: u64 = 300_000;
const JITTER_NS: u64 = 2_000_000;
const START_NS: u64 = 900_000_000_000;

/// One lidar: the time of a packet, the clouds a second, and a packet by its number and stamp.
struct Lidar {
    name: &'static str,
    driver: NetworkLidarDriver,
    packet_ns: u64,
    clouds_hz: f64,
    packet: fn(u64, u64) -> Vec<u8>,
}

fn points(count: usize) -> Vec<Vec<u8>> {
    let point = |at: usize| [1_000 + 16 * at as i32, 500, 250].map(i32::to_le_bytes).concat();
    (0..count).map(|at| [point(at), vec![9, 0]].concat()).collect()
}

fn lidars() -> Vec<Lidar> {
    let driver = |model: &str, keys: &str, decoder: Option<Decoder>| {
        let spec = spec("lidar_3d", model, "udp:127.0.0.1:0", keys);
        let decoder = decoder.or_else(|| match spec.model.connection {
            jink_lidar_driver::models::Connection::Network(protocol) => Decoder::of(protocol, 10.0),
            jink_lidar_driver::models::Connection::Serial(_) => None,
        });
        NetworkLidarDriver::new(spec, decoder)
    };
    let metadata = Metadata::parse(&ouster_metadata(16, 512, "RNG19_RFL8_SIG16_NIR16")).unwrap();
    vec![
        Lidar {
            name: "ouster",
            driver: driver("ouster", "metadata = \"/x\"\n", Some(Decoder::ouster(metadata))),
            packet_ns: 3_125_000,
            clouds_hz: 10.0,
            packet: |number, stamp_ns| {
                let (frame, first) = (number / 32, number as usize % 32 * 16);
                ouster_standard(frame as u16, first, 16, stamp_ns, &|_, _| 5_000)
            },
        },
        Lidar {
            name: "vlp16",
            driver: driver("vlp16", "", None),
            packet_ns: 1_327_104,
            clouds_hz: 10.0,
            packet: |number, stamp_ns| {
                let stamp_us = (stamp_ns / 1_000 % 3_600_000_000) as u32;
                vlp16(
                    stamp_us,
                    number as f64 * 24.0 * 20.0,
                    20.0,
                    false,
                    0x22,
                    &|_, _, _| 1_000,
                )
            },
        },
        Lidar {
            name: "livox_mid360",
            driver: driver("livox_mid360", "", None),
            packet_ns: 480_000,
            clouds_hz: 10.0,
            packet: |number, stamp_ns| livox2(number as u16, stamp_ns, 4_800, 1, &points(4)),
        },
        Lidar {
            name: "livox_avia",
            driver: driver("livox_avia", "", None),
            packet_ns: 400_000,
            clouds_hz: 10.0,
            packet: |_, stamp_ns| livox1(stamp_ns, 2, &points(96)),
        },
        Lidar {
            name: "livox_avia by GPS",
            driver: driver("livox_avia", "", None),
            packet_ns: 400_000,
            clouds_hz: 10.0,
            packet: |_, stamp_ns| {
                let mut packet = livox1(0, 2, &points(96));
                packet[8] = 3;
                let (hours, us) = (stamp_ns / 3_600_000_000_000, stamp_ns / 1_000 % 3_600_000_000);
                packet[10..14].copy_from_slice(&[26, 11, (hours / 24) as u8, (hours % 24) as u8]);
                packet[14..18].copy_from_slice(&(us as u32).to_le_bytes());
                packet
            },
        },
    ]
}

/// What a lidar published before and after its clock was set ahead by `ahead_ns`, 2 s each, by the true time and that
/// of the cloud.
fn clouds(lidar: &mut Lidar, ahead_ns: i64) -> (Vec<[f64; 2]>, Vec<f64>) {
    let (mut clouds, mut told_s) = (Vec::new(), Vec::new());
    let count = 4_000_000_000 / lidar.packet_ns;
    for number in 0..count {
        let since_ns = number * lidar.packet_ns;
        let shift_ns = if number > count / 2 { ahead_ns } else { 0 };
        // Late in the hour of the sensor's clock, which passes on the way.
        let stamp_ns = (27 * 3_600_000_000_000 - 1_000_000_000 + since_ns).saturating_add_signed(shift_ns);
        let bytes = (lidar.packet)(number, stamp_ns);
        let delay_ns = DELAY_NS + number * 7_919 % JITTER_NS;
        let arrived = Timestamp::from_ns(START_NS + since_ns + lidar.packet_ns + delay_ns);
        let mut publish = |cloud: &CloudAssembler| {
            let true_s = (since_ns as f64 - lidar.packet_ns as f64) * 1e-9;
            let dated_s = cloud.capture().seconds_since(Timestamp::from_ns(START_NS));
            clouds.push([true_s, dated_s]);
        };
        lidar.driver.datagram(arrived, SENSOR, &bytes, &mut publish);
        told_s.extend(lidar.driver.take_clock_step());
    }
    (clouds, told_s)
}

#[test]
fn in_either_direction_by_little_and_by_much() {
    std::thread::scope(|scope| {
        for ahead_ms in [0, -25, -300, 300, -5_000, 1_500_000] {
            scope.spawn(move || is_followed(ahead_ms));
        }
    });
}

fn is_followed(ahead_ms: i64) {
    for mut lidar in lidars() {
        let what = format!("{} set by {ahead_ms} ms", lidar.name);
        let (clouds, told_s) = clouds(&mut lidar, ahead_ms * 1_000_000);
        let expected = 4.0 * lidar.clouds_hz;
        assert!(
            clouds.len() as f64 > expected - 4.0,
            "{what}: {} clouds",
            clouds.len()
        );
        let slack_s = 2e-3 + 1e-9 * (DELAY_NS + JITTER_NS + 2 * lidar.packet_ns) as f64;
        for [true_s, dated_s] in clouds {
            assert!(
                dated_s <= true_s + slack_s,
                "{what}: measured at {true_s}, dated {dated_s}"
            );
            let is_settling = (1.9..3.1).contains(&true_s);
            assert!(
                is_settling || dated_s >= true_s - slack_s,
                "{what}: measured at {true_s}, dated {dated_s}"
            );
        }
        if ahead_ms.abs() >= 100 {
            assert!(matches!(told_s[..], [_]), "{what}: {told_s:?}");
            assert!(
                (told_s[0] - ahead_ms as f64 * 1e-3).abs() < 0.01,
                "{what}: {told_s:?}"
            );
        }
        if ahead_ms == 0 {
            assert!(told_s.is_empty(), "{what}: {told_s:?}");
        }
        let counters = lidar.driver.counters(Timestamp::from_ns(START_NS));
        // An Avia has neither a number nor an angle by which a packet that is missing differs from a clock that is set.
        if !lidar.name.contains("avia") || ahead_ms.abs() >= 1_000 {
            assert_eq!(counters.lost, 0, "{what}");
        }
        let unused = counters.late + counters.doubled + counters.damaged;
        assert!(
            unused as f64 * lidar.packet_ns as f64 <= 21e6,
            "{what}: {unused} packets not used"
        );
    }
}
