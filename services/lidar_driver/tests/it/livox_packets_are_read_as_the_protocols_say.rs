//! Point data of both Livox protocols, and the messages that make a sensor send them.

use crate::encoder::{crc16, crc32, livox1, livox2};
use jink_lidar_driver::decode::{Decode, Fault, Item, Ray};
use jink_lidar_driver::livox::control::{Addresses, Control, ControlReply, SdkVersion};
use jink_lidar_driver::livox::sdk1::Livox1;
use jink_lidar_driver::livox::sdk2::Livox2;
use jink_shared_types::Timestamp;
use std::net::Ipv4Addr;

/// Rays of a packet, and how many scans it has ended.
fn decoded(decoder: &mut dyn Decode, packet: &[u8]) -> Result<(Vec<Ray>, u32), Fault> {
    let (mut rays, mut ends) = (Vec::new(), 0);
    decoder.packet(packet, &mut |item| match item {
        Item::Ray(ray) => rays.push(ray),
        Item::ScanEnds { .. } => ends += 1,
        Item::Packet { .. } => {}
    })?;
    Ok((rays, ends))
}

/// A point at 5 m, 30 deg to the left, 20 deg up, in the layout of a data type.
fn point(data_type: u8, tag: u8, first: bool) -> Vec<u8> {
    let (azimuth, elevation) = (30f64.to_radians(), 20f64.to_radians());
    let [x, y, z] = [
        5.0 * elevation.cos() * azimuth.cos(),
        5.0 * elevation.cos() * azimuth.sin(),
        5.0 * elevation.sin(),
    ];
    let mm = |metres: f64| ((metres * 1e3).round() as i32).to_le_bytes();
    let cm = |metres: f64| ((metres * 1e2).round() as i16).to_le_bytes();
    let angles = [7_000u16.to_le_bytes(), 3_000u16.to_le_bytes()].concat();
    let cartesian = [mm(x), mm(y), mm(z)].concat();
    let depth = 5_000u32.to_le_bytes();
    let mut bytes = match (first, data_type) {
        (false, 1) | (true, 2) | (true, 0) => cartesian,
        (false, 2) => [cm(x), cm(y), cm(z)].concat(),
        (false, 3) | (true, 1 | 3) => [depth.to_vec(), angles].concat(),
        (true, 4) => return [cartesian.clone(), vec![9, tag], cartesian, vec![9, tag]].concat(),
        (true, 7) => {
            return [0; 3]
                .iter()
                .flat_map(|_| [cartesian.clone(), vec![9, tag]].concat())
                .collect();
        }
        (true, 5) => return [angles, depth.to_vec(), vec![9, tag], depth.to_vec(), vec![9, tag]].concat(),
        (true, 8) => {
            let one = [depth.to_vec(), vec![9, tag]].concat();
            return [angles, one.clone(), one.clone(), one].concat();
        }
        _ => panic!("data type {data_type}"),
    };
    bytes.push(9);
    if !(first && data_type < 2) {
        bytes.push(tag);
    }
    bytes
}

fn judge(rays: &[Ray], tolerance_m: f32) {
    for ray in rays {
        assert!((ray.range_m - 5.0).abs() <= tolerance_m, "{ray:?}");
        let expected = [0.813_8, 0.469_85, 0.342_02];
        for (is, expected) in ray.direction.iter().zip(expected) {
            assert!((is - expected).abs() < 0.002, "{ray:?}");
        }
    }
}

#[test]
fn every_data_type_of_the_second_protocol_says_where_the_point_is() {
    for (data_type, tolerance_m) in [(1, 0.001), (2, 0.01), (3, 0.000_1)] {
        let mut decoder = Livox2::new(10.0);
        let points = vec![point(data_type, 0, false); 96];
        let (rays, _) = decoded(&mut decoder, &livox2(7, 1_000_000, 4_800, data_type, &points)).unwrap();
        assert_eq!(rays.len(), 96);
        judge(&rays, tolerance_m);
        // 480 us for 96 points.
        assert_eq!((rays[0].stamp_ns, rays[95].stamp_ns), (1_000_000, 1_475_000));
        assert_eq!((rays[5].row, rays[5].column), (1, 1));
    }
}

#[test]
fn every_data_type_of_the_first_protocol_says_where_the_point_is() {
    for (data_type, points, returns) in [
        (0, 100, 1),
        (1, 100, 1),
        (2, 96, 1),
        (3, 96, 1),
        (4, 48, 2),
        (5, 48, 2),
        (7, 30, 3),
        (8, 30, 3),
    ] {
        let mut decoder = Livox1::new(10.0);
        let packet = livox1(5_000_000, data_type, &vec![point(data_type, 0, true); points]);
        let (rays, _) = decoded(&mut decoder, &packet).unwrap();
        assert_eq!(rays.len(), points * returns, "data type {data_type}");
        judge(&rays, 0.001);
        assert_eq!((rays[0].echo.count, rays[returns].row), (returns as u8, 1));
    }
}

#[test]
fn no_return_and_noise_are_no_points() {
    let mut decoder = Livox2::new(10.0);
    let mut points = vec![point(1, 0, false); 4];
    points[1] = vec![0; 14];
    points[2] = point(1, 0b10_0000, false);
    let (rays, _) = decoded(&mut decoder, &livox2(0, 0, 20, 1, &points)).unwrap();
    assert_eq!(rays.len(), 2);
    let mut decoder = Livox1::new(10.0);
    let mut points = vec![point(2, 0, true); 96];
    points[3] = point(2, 0b0101, true);
    points[4] = point(2, 0b01_0000, true);
    let (rays, _) = decoded(&mut decoder, &livox1(1, 2, &points)).unwrap();
    assert_eq!(rays.len(), 95, "the number of a return is no noise");
}

#[test]
fn a_scan_ends_every_tenth_of_a_second_and_missing_packets_are_counted() {
    let mut decoder = Livox2::new(10.0);
    let (mut ends, mut lost) = (0, 0);
    for number in 0..2_000u16 {
        if number % 100 == 50 {
            continue;
        }
        let packet = livox2(
            number.wrapping_add(65_000),
            u64::from(number) * 480_000,
            4_800,
            1,
            &vec![point(1, 0, false); 96],
        );
        let mut sink = |item| {
            if let Item::ScanEnds { lost: missing } = item {
                ends += 1;
                lost += missing;
            }
        };
        decoder.packet(&packet, &mut sink).unwrap();
        assert_eq!(decoder.packet(&packet, &mut sink), Err(Fault::Doubled));
    }
    assert_eq!((ends, lost), (9, 19));
}

#[test]
fn a_checksum_that_has_agreed_is_enforced() {
    let mut decoder = Livox2::new(10.0);
    for number in 0..50u16 {
        let packet = livox2(
            number,
            u64::from(number) * 480_000,
            4_800,
            1,
            &vec![point(1, 0, false); 96],
        );
        let mut broken = packet.clone();
        broken[100] ^= 4;
        assert!(decoded(&mut decoder, &packet).is_ok());
        if number > 20 {
            assert_eq!(decoded(&mut decoder, &broken), Err(Fault::Damaged));
        }
    }
}

/// Parts of a message of the second protocol: command, data.
fn opened2(bytes: &[u8]) -> (u16, Vec<u8>) {
    assert_eq!((bytes[0], bytes[1], bytes[10], bytes[11]), (0xAA, 0, 0, 0));
    assert_eq!(usize::from(u16::from_le_bytes([bytes[2], bytes[3]])), bytes.len());
    assert_eq!(
        u16::from_le_bytes([bytes[18], bytes[19]]),
        crc16(&bytes[..18], 0xFFFF, false)
    );
    let data = bytes[24..].to_vec();
    let crc = if data.is_empty() { 0 } else { crc32(&data, 0) };
    assert_eq!(u32::from_le_bytes(bytes[20..24].try_into().unwrap()), crc);
    (u16::from_le_bytes([bytes[8], bytes[9]]), data)
}

fn answer2(command: u16, data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xAA, 0];
    bytes.extend((24 + data.len() as u16).to_le_bytes());
    bytes.extend([0; 4]);
    bytes.extend(command.to_le_bytes());
    bytes.extend([1, 1, 0, 0, 0, 0, 0, 0]);
    bytes.extend(crc16(&bytes, 0xFFFF, false).to_le_bytes());
    bytes.extend(crc32(data, 0).to_le_bytes());
    bytes.extend(data);
    bytes
}

fn addresses(sensor: Option<Ipv4Addr>) -> Addresses {
    Addresses {
        sensor,
        control_port: 0,
        point_port: 56_301,
        command_port: 50_001,
    }
}

#[test]
fn a_mid360_is_found_and_asked_to_send_until_points_come() {
    let host = Ipv4Addr::new(192, 168, 1, 50);
    let sensor = Ipv4Addr::new(192, 168, 1, 112);
    let mut control = Control::new(SdkVersion::Second, addresses(None));
    let now = Timestamp::from_seconds(10.0);
    let search = control.next(now, 1.0).unwrap();
    assert_eq!(
        (opened2(search.bytes()), search.to.to_string()),
        ((0, vec![]), "255.255.255.255:56000".to_owned())
    );
    assert!(control.next(now, 1.0).is_none(), "once a second");
    let mut found = vec![0, 9];
    found.extend(*b"47MDK1234567890\0");
    found.extend(sensor.octets());
    found.extend(56_100u16.to_le_bytes());
    let mut damaged = answer2(0, &found);
    damaged[30] ^= 1;
    assert_eq!(control.received(sensor.into(), &damaged), None);
    assert_eq!(
        control.received(sensor.into(), &answer2(0, &found)),
        Some(ControlReply::Found(sensor))
    );
    control.set_host(host);
    for second in 1..4 {
        let set = control.next(now.plus_seconds(f64::from(second)), 1.0).unwrap();
        assert_eq!(set.to.to_string(), "192.168.1.112:56100");
        let (command, data) = opened2(set.bytes());
        let expected = [
            &[3, 0, 0, 0, 0x00, 0x00, 1, 0, 1, 0x06, 0x00, 8, 0, 192, 168, 1, 50][..],
            &56_301u16.to_le_bytes(),
            &56_300u16.to_le_bytes(),
            &[0x1A, 0x00, 1, 0, 1],
        ]
        .concat();
        assert_eq!((command, data), (0x0100, expected));
        assert!(control.next(now.plus_seconds(f64::from(second)), 1.0).is_none());
    }
    assert!(
        control.next(now.plus_seconds(4.5), 0.0).is_none(),
        "points come: nothing more to say"
    );
    assert_eq!(
        control.received(sensor.into(), &answer2(0x0100, &[0, 0, 0])),
        Some(ControlReply::Accepted)
    );
    assert_eq!(
        control.received(sensor.into(), &answer2(0x0100, &[3, 6, 0])),
        Some(ControlReply::Refused { code: 3, of: 6 })
    );
}

/// Parts of a message of the first protocol: type, command, data.
fn opened1(bytes: &[u8]) -> (u8, u8, Vec<u8>) {
    let end = bytes.len() - 4;
    assert_eq!((bytes[0], bytes[1], bytes[9]), (0xAA, 1, 0));
    assert_eq!(usize::from(u16::from_le_bytes([bytes[2], bytes[3]])), bytes.len());
    assert_eq!(
        u16::from_le_bytes([bytes[7], bytes[8]]),
        crc16(&bytes[..7], 0x4C49, true)
    );
    assert_eq!(
        u32::from_le_bytes(bytes[end..].try_into().unwrap()),
        crc32(&bytes[..end], 0x564F_580A)
    );
    (bytes[4], bytes[10], bytes[11..end].to_vec())
}

fn message1(kind: u8, command: u8, data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xAA, 1];
    bytes.extend((15 + data.len() as u16).to_le_bytes());
    bytes.extend([kind, 0, 0]);
    bytes.extend(crc16(&bytes, 0x4C49, true).to_le_bytes());
    bytes.extend([0, command]);
    bytes.extend(data);
    bytes.extend(crc32(&bytes, 0x564F_580A).to_le_bytes());
    bytes
}

#[test]
fn an_avia_is_shaken_hands_with_started_and_kept_awake() {
    let sensor = Ipv4Addr::new(192, 168, 1, 119);
    let mut control = Control::new(SdkVersion::First, addresses(None));
    let now = Timestamp::from_seconds(10.0);
    assert!(control.next(now, 1.0).is_none(), "it announces itself");
    assert_eq!(
        control.received(sensor.into(), &message1(2, 0, b"3JEDK1234567890\0\x07\0\0")),
        Some(ControlReply::Found(sensor))
    );
    control.set_host(Ipv4Addr::new(192, 168, 1, 50));
    let mut said = Vec::new();
    while let Some(message) = control.next(now, 1.0) {
        assert_eq!(message.to.to_string(), "192.168.1.119:65000");
        said.push(opened1(message.bytes()));
    }
    let ports = [56_301u16, 50_001, 56_301].map(u16::to_le_bytes).concat();
    let handshake = [vec![192, 168, 1, 50], ports].concat();
    assert_eq!(
        said,
        [
            (0, 1, handshake),
            (0, 5, vec![0]),
            (0, 4, vec![1]),
            (0, 3, vec![])
        ]
    );
    for second in 1..5 {
        let heartbeat = control.next(now.plus_seconds(f64::from(second)), 0.0).unwrap();
        assert_eq!(opened1(heartbeat.bytes()), (0, 3, vec![]));
        assert!(control.next(now.plus_seconds(f64::from(second)), 0.0).is_none());
    }
}
