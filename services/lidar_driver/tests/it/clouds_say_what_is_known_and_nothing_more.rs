//! From packets to clouds: mounting, time, limits, missing answers, several answers, and frames that are too large for
//! a cloud.

use crate::encoder::{ouster_metadata, ouster_standard, spec, vlp16};
use jink_lidar_driver::ouster::Metadata;
use jink_lidar_driver::{CloudAssembler, Decoder, NetworkLidarDriver};
use jink_runtime::device::DeviceChange;
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{CLOUD_POINTS, PointCloud, RayKind};
use std::net::{IpAddr, Ipv4Addr};

const SENSOR: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 168, 1, 150));
const ROWS: usize = 32;
const COLUMNS: usize = 512;
const COLUMN_NS: u64 = 97_656;

/// A cloud as it is published.
struct Published {
    cloud: Box<PointCloud>,
    capture: Timestamp,
}

fn take(published: &mut Vec<Published>) -> impl FnMut(&CloudAssembler) + '_ {
    |assembler| {
        let mut cloud = PointCloud::boxed();
        assembler.write(&mut cloud);
        assert!(cloud.is_consistent());
        published.push(Published {
            cloud,
            capture: assembler.capture(),
        });
    }
}

fn ouster(rows: usize, columns: usize, keys: &str) -> NetworkLidarDriver {
    let metadata = Metadata::parse(&ouster_metadata(rows, columns, "RNG19_RFL8_SIG16_NIR16")).unwrap();
    let keys = format!("metadata = \"/x\"\n{keys}");
    let spec = spec("lidar_3d", "ouster", "udp:127.0.0.1:0", &keys);
    NetworkLidarDriver::new(spec, Some(Decoder::ouster(metadata)))
}

/// A packet of frame `frame` that begins with column `first`, and when it arrives.
fn packet(frame: u16, first: usize, range_mm: &dyn Fn(usize, usize) -> u32) -> (Timestamp, Vec<u8>) {
    let stamp_ns = (u64::from(frame) * COLUMNS as u64 + first as u64) * COLUMN_NS;
    let arrived = Timestamp::from_ns(5_000_000_000 + stamp_ns + 16 * COLUMN_NS + 200_000);
    (arrived, ouster_standard(frame, first, ROWS, stamp_ns, range_mm))
}

fn flown(
    driver: &mut NetworkLidarDriver,
    frames: u16,
    range_mm: &dyn Fn(usize, usize) -> u32,
) -> Vec<Published> {
    let mut published = Vec::new();
    for frame in 0..frames {
        for first in (0..COLUMNS).step_by(16) {
            let (arrived, bytes) = packet(frame, first, range_mm);
            driver.datagram(arrived, SENSOR, &bytes, &mut take(&mut published));
        }
    }
    published
}

#[test]
fn a_frame_is_a_cloud_in_the_body_frame_with_the_time_of_every_point() {
    // Upside down, and turned to the right.
    let mut driver = ouster(
        ROWS,
        COLUMNS,
        "roll_deg = 180\nyaw_deg = 90\nforward_m = 0.2\nrange_max_m = 50\n",
    );
    let published = flown(&mut driver, 2, &|_, _| 10_000);
    assert_eq!(published.len(), 2);
    for Published { cloud, capture } in &published {
        assert_eq!(cloud.len as usize, ROWS * COLUMNS);
        let frame_s = capture.seconds_since(cloud.first_point);
        assert!((frame_s - 511.0 * 97.656e-6).abs() < 20e-6, "{frame_s}");
        for (index, point) in cloud.points().iter().enumerate() {
            let (row, column) = (index % ROWS, index / ROWS);
            let offset_us = f64::from(point.offset_10us) * 10.0;
            assert!((offset_us - column as f64 * 97.656).abs() <= 10.0);
            // By the formula of the manual, in degrees: the lidar's frame is turned half about its vertical axis in the
            // sensor's.
            let elevation = (20.0 - 40.0 * row as f64 / ROWS as f64).to_radians();
            let encoder = (360.0 * (1.0 - column as f64 / COLUMNS as f64)).to_radians();
            let azimuth = encoder - [4.2f64, 1.4, -1.4, -4.2][row % 4].to_radians();
            let (r, n) = (10.0 - 0.015_806, 0.015_806);
            let x = -(r * azimuth.cos() * elevation.cos() + n * encoder.cos());
            let y = -(r * azimuth.sin() * elevation.cos() + n * encoder.sin());
            let z = r * elevation.sin() + 0.036_18;
            // Upside down: forward stays, left becomes right, up becomes down; then all turns to the right.
            let (forward, right, down) = (x, y, z);
            let expected = [0.2 - right, forward, down];
            let is = [point.forward_m, point.right_m, point.down_m];
            for (is, expected) in is.iter().zip(expected) {
                assert!(
                    (f64::from(*is) - expected).abs() < 1e-4,
                    "{row} {column}: {is} {expected}"
                );
            }
        }
    }
    // Packets arrive 0.2 ms after their last column.
    let behind_s = Timestamp::from_ns(5_000_000_000 + 200_000).seconds_since(published[0].cloud.first_point);
    assert!((behind_s + 97.656e-6).abs() < 120e-6, "{behind_s}");
}

#[test]
fn what_did_not_answer_is_not_free_unless_the_table_says_so() {
    let range_mm = |_: usize, column: usize| match column % 4 {
        0 => 0,
        1 => 5_000,
        2 => 40_000,
        _ => 100,
    };
    for (keys, clear) in [("", 1), ("no_return = \"clear\"\n", 2)] {
        let mut driver = ouster(ROWS, COLUMNS, &format!("range_max_m = 12\n{keys}"));
        let published = flown(&mut driver, 1, &range_mm);
        let points = published[0].cloud.points();
        let count =
            |kind| points.iter().filter(|point| point.kind.get() == kind).count() * 4 / (ROWS * COLUMNS);
        assert_eq!((count(RayKind::Hit), count(RayKind::Clear)), (2, clear), "{keys}");
        for point in points.iter().filter(|point| point.kind.get() == RayKind::Clear) {
            let range_m = (point.forward_m.powi(2) + point.right_m.powi(2) + point.down_m.powi(2)).sqrt();
            assert!((11.85..=12.0).contains(&range_m), "{range_m}");
        }
        // What is nearer than the shortest range is an obstacle all the same.
        let near = points
            .iter()
            .filter(|point| point.forward_m.hypot(point.right_m).hypot(point.down_m) < 0.3);
        assert_eq!(near.count(), ROWS * COLUMNS / 4);
    }
}

#[test]
fn a_blind_sector_says_nothing() {
    let mut driver = ouster(ROWS, COLUMNS, "blind_deg = [[90, 180]]\n");
    let published = flown(&mut driver, 1, &|_, _| 5_000);
    let points = published[0].cloud.points();
    assert!((points.len() as f64 / (ROWS * COLUMNS) as f64 - 0.75).abs() < 0.01);
    for point in points {
        let bearing_deg = point.right_m.atan2(point.forward_m).to_degrees();
        assert!(!(92.0..178.0).contains(&bearing_deg), "{bearing_deg}");
    }
}

#[test]
fn of_two_returns_the_nearer_counts_or_the_strongest_or_both() {
    // The last return stands behind the strongest.
    let ranges = |_: usize, laser: usize, echo: usize| if laser == 3 { 0 } else { [4_000, 2_500][echo] };
    for (keys, expected) in [
        ("", vec![5.0]),
        ("returns = \"strongest\"\n", vec![5.0]),
        ("returns = \"both\"\n", vec![8.0, 5.0]),
    ] {
        let spec = spec("lidar_3d", "vlp16", "udp:127.0.0.1:0", keys);
        let mut driver = NetworkLidarDriver::new(spec.clone(), Decoder::of(spec.network().unwrap(), 10.0));
        let mut published = Vec::new();
        for index in 0..3u32 {
            let bytes = vlp16(
                1_000 + index * 663,
                f64::from(index) * 240.0,
                20.0,
                true,
                0x22,
                &ranges,
            );
            let arrived = Timestamp::from_seconds(1.0 + f64::from(index) * 663e-6);
            driver.datagram(arrived, SENSOR, &bytes, &mut take(&mut published));
        }
        driver.tick(Timestamp::from_seconds(2.0), &mut take(&mut published));
        let points = published[0].cloud.points();
        assert_eq!(points.len(), 3 * 12 * 15 * expected.len(), "{keys}");
        for (index, point) in points.iter().enumerate() {
            let range_m = f64::from(point.forward_m.hypot(point.right_m).hypot(point.down_m));
            assert!(
                (range_m - expected[index % expected.len()]).abs() < 0.02,
                "{keys} {range_m}"
            );
        }
    }
}

#[test]
fn a_frame_that_is_too_large_keeps_the_nearer_of_two_neighbouring_columns() {
    let (rows, columns) = (128, 2_048);
    let mut driver = ouster(rows, columns, "");
    assert!(driver.merges());
    let mut published = Vec::new();
    for first in (0..columns).step_by(16) {
        let stamp_ns = first as u64 * 48_828;
        let range_mm = |row: usize, column: usize| 5_000 + (column * 37 + row * 11) as u32 % 1_000;
        let bytes = ouster_standard(1, first, rows, stamp_ns, &range_mm);
        driver.datagram(
            Timestamp::from_ns(1_000_000_000 + stamp_ns),
            SENSOR,
            &bytes,
            &mut take(&mut published),
        );
    }
    let cloud = &published[0].cloud;
    assert_eq!(cloud.len as usize, CLOUD_POINTS);
    assert_eq!(driver.counters(Timestamp::from_seconds(3.0)).overflow, 0);
    let sum: f64 = cloud
        .points()
        .iter()
        .map(|point| f64::from(point.forward_m.hypot(point.right_m).hypot(point.down_m - 0.0)))
        .sum();
    let nearer = |pair: usize, row: usize| {
        let range_mm = |column: usize| 5_000 + (column * 37 + row * 11) as u32 % 1_000;
        f64::from(range_mm(2 * pair).min(range_mm(2 * pair + 1))) * 1e-3
    };
    let expected: f64 = (0..rows)
        .flat_map(|row| (0..columns / 2).map(move |pair| nearer(pair, row)))
        .sum();
    assert!((sum / expected - 1.0).abs() < 0.003, "{sum} {expected}");
}

#[test]
fn lost_doubled_late_foreign_and_damaged_packets_are_counted_and_survived() {
    let mut driver = ouster(ROWS, COLUMNS, "");
    let mut published = Vec::new();
    let foreign = IpAddr::V4(Ipv4Addr::new(10, 0, 0, 9));
    let mut held = None;
    for frame in 0..10u16 {
        for first in (0..COLUMNS).step_by(16) {
            let (arrived, bytes) = packet(frame, first, &|_, _| 7_000);
            let mut send =
                |source, bytes: &[u8]| driver.datagram(arrived, source, bytes, &mut take(&mut published));
            match (frame, first) {
                (2, 64) => continue,
                (3, 80) => send(SENSOR, &bytes),
                (4, 96) => {
                    let mut broken = bytes.clone();
                    broken[500] ^= 0x10;
                    send(SENSOR, &broken);
                    continue;
                }
                (5, 112) => send(foreign, &bytes),
                (6, 496) => {
                    held = Some(bytes);
                    continue;
                }
                (7, 16) => send(SENSOR, &held.take().unwrap()),
                (8, 0) => send(SENSOR, &bytes[..1_000]),
                _ => {}
            }
            send(SENSOR, &bytes);
        }
    }
    let counters = driver.counters(Timestamp::from_seconds(9.0));
    assert_eq!(
        (
            counters.published,
            counters.lost,
            counters.doubled,
            counters.late,
            counters.foreign,
            counters.damaged
        ),
        (10, 3, 1, 1, 2, 1)
    );
    assert_eq!(counters.good, 10 * 32 - 3);
    let lengths: Vec<usize> = published
        .iter()
        .map(|published| published.cloud.len as usize / ROWS)
        .collect();
    assert_eq!(lengths, [512, 512, 496, 512, 496, 512, 496, 512, 512, 512]);
}

#[test]
fn a_sensor_that_falls_silent_is_reported_once_and_so_is_its_return() {
    let mut driver = ouster(ROWS, COLUMNS, "");
    let begin = Timestamp::from_seconds(5.0);
    assert_eq!(driver.take_change(begin), None);
    let mut update = Vec::new();
    for ms in 0..6_000u64 {
        let now = begin.plus_seconds(ms as f64 * 1e-3);
        if !(1_000..4_000).contains(&ms) {
            let (_, bytes) = packet((ms / 32) as u16, (ms % 32) as usize * 16, &|_, _| 3_000);
            driver.datagram(now, SENSOR, &bytes, &mut |_| {});
        }
        update.extend(driver.take_change(now).map(|update| (ms, update)));
    }
    assert_eq!(update.len(), 2, "{update:?}");
    assert!(
        matches!(update[0], (2_000..=2_002, DeviceChange::Lost))
            && matches!(update[1], (4_000..=4_002, DeviceChange::Back)),
        "{update:?}"
    );
}

#[test]
fn a_narrow_window_is_published_when_its_last_column_has_come() {
    let text = ouster_metadata(ROWS, COLUMNS, "RNG19_RFL8_SIG16_NIR16").replace("[0, 511]", "[480, 31]");
    let spec = spec("lidar_3d", "ouster", "udp:127.0.0.1:0", "metadata = \"/x\"\n");
    let mut driver = NetworkLidarDriver::new(spec, Some(Decoder::ouster(Metadata::parse(&text).unwrap())));
    let mut published = Vec::new();
    for first in [480, 496, 0, 16] {
        assert!(published.is_empty());
        let (arrived, bytes) = packet(1, first, &|_, _| 3_000);
        driver.datagram(arrived, SENSOR, &bytes, &mut take(&mut published));
    }
    assert_eq!(published.len(), 1);
}

#[test]
fn a_sensor_or_a_recording_that_begins_anew_is_followed() {
    let mut driver = ouster(ROWS, COLUMNS, "");
    assert_eq!(flown(&mut driver, 3, &|_, _| 3_000).len(), 3);
    // A recording that is played again says so.
    driver.connected();
    assert_eq!(flown(&mut driver, 3, &|_, _| 3_000).len(), 3);
    // A sensor does not: its packets are late at first.
    let again: usize = (0..10).map(|_| flown(&mut driver, 3, &|_, _| 3_000).len()).sum();
    assert!(again >= 6, "{again}");
}

#[test]
fn a_flood_of_strangers_and_of_garbage_changes_no_cloud() {
    let stranger = IpAddr::V4(Ipv4Addr::new(192, 168, 1, 66));
    let undisturbed = flown(&mut ouster(ROWS, COLUMNS, ""), 3, &|_, _| 10_000);
    let mut driver = ouster(ROWS, COLUMNS, "");
    let mut published = Vec::new();
    for frame in 0..3 {
        for first in (0..COLUMNS).step_by(16) {
            let (arrived, bytes) = packet(frame, first, &|_, _| 10_000);
            driver.datagram(arrived, SENSOR, &bytes, &mut take(&mut published));
            // Sound packets of another sensor, of this one's past, and whatever has its address.
            let (_, sound) = packet(frame + 7, first, &|_, _| 1_000);
            let torn = &sound[..first * bytes.len() / COLUMNS];
            for (source, flood) in [
                (stranger, &sound[..]),
                (stranger, &bytes),
                (SENSOR, torn),
                (SENSOR, &[0xFF; 1_206]),
            ] {
                for _ in 0..20 {
                    driver.datagram(arrived, source, flood, &mut take(&mut published));
                }
            }
        }
    }
    assert_eq!(published.len(), undisturbed.len());
    for (published, undisturbed) in published.iter().zip(&undisturbed) {
        assert_eq!(published.capture, undisturbed.capture);
        assert_eq!(published.cloud.points(), undisturbed.cloud.points());
    }
    let counters = driver.counters(Timestamp::from_seconds(1.0));
    assert_eq!((counters.lost, counters.foreign), (0, 3 * 32 * 80));
}
