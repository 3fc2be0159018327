//! An SF45/B that behaves as its manual says: it is set up, its sweeps are published in parts with the right times and
//! directions, and it is set up again when it has been reset.

use crate::encoder::device::Device;
use crate::encoder::spec;
use jink_rangefinder_driver::{RangefinderDriver, RangefinderService};
use jink_runtime::device::{DeviceChange, Driver};
use jink_shared_types::Timestamp;
use jink_shared_types::layout::Layout;
use jink_shared_types::ranges::RangeScan;

const STEP_NS: u64 = 1_000_000;

/// Driver and device over `ms` milliseconds; the scans, and what was reported to the pilot.
fn run(
    driver: &mut RangefinderDriver,
    device: &mut Device,
    start_ms: u64,
    ms: u64,
    connected: bool,
) -> (Vec<RangeScan>, Vec<DeviceChange>) {
    let (mut scans, mut update) = (Vec::new(), Vec::new());
    for step in start_ms..start_ms + ms {
        let now = Timestamp::from_ns(1_000_000_000 + step * STEP_NS);
        let mut publish = |view: &jink_rangefinder_driver::ScanView<'_>| {
            let mut scan = RangeScan::default();
            view.write(&mut scan);
            assert!(scan.is_plausible(), "{scan:?}");
            assert!(view.capture <= now && now.seconds_since(view.capture) < 0.06);
            scans.push(scan);
        };
        if connected {
            driver.bytes(now, &device.step(), &mut publish);
            while let Some(bytes) = driver.next_write(now) {
                device.take(bytes);
            }
        }
        driver.tick(now, &mut publish);
        update.extend(driver.take_change(now));
    }
    (scans, update)
}

fn start() -> (RangefinderDriver, Device) {
    let mut driver = RangefinderDriver::new(spec(
        "sf45b",
        "/dev/x",
        "scan_low_deg = -120\nscan_high_deg = 90\nrange_max_m = 20\n",
    ));
    driver.connected(Timestamp::from_ns(1_000_000_000));
    (driver, Device::default())
}

#[test]
fn it_is_set_up_once_and_streams() {
    let (mut driver, mut device) = start();
    let (scans, update) = run(&mut driver, &mut device, 0, 2_000, true);
    assert_eq!(device.commands, [30, 27, 66, 85, 98, 99, 96, 30]);
    assert_eq!((device.float(98), device.float(99)), (-120.0, 90.0));
    assert_eq!(
        (&device.settings[&66][..], &device.settings[&96][..]),
        (&[7][..], &[1][..])
    );
    assert!(update.is_empty(), "{update:?}");
    // 1600 deg/s: an eighth takes 28 ms; some 70 parts in two seconds.
    assert!(scans.len() > 60, "{}", scans.len());
}

#[test]
fn parts_say_where_and_when_and_how_far() {
    let (mut driver, mut device) = start();
    let (scans, _) = run(&mut driver, &mut device, 0, 2_000, true);
    let mut covered = [false; 360];
    for scan in &scans {
        assert!(scan.beams >= 2 && scan.range_max_m == 20.0);
        let duration_s = f64::from(scan.beam_interval_s) * f64::from(scan.beams - 1);
        assert!(duration_s <= 0.05 + 1e-6, "{duration_s}");
        for (beam, range_m) in scan.ranges().iter().enumerate().filter(|beam| !beam.1.is_nan()) {
            let yaw_deg = (scan.angle_first_rad + beam as f32 * scan.angle_step_rad).to_degrees();
            assert!((-120.5..=90.5).contains(&yaw_deg), "{yaw_deg}");
            if (yaw_deg - 5.0).abs() > 0.5 {
                assert_eq!(*range_m, if yaw_deg > 5.0 { 4.0 } else { 2.0 }, "{yaw_deg}");
            }
            covered[(yaw_deg + 180.0) as usize % 360] = true;
        }
    }
    let seen = covered.iter().filter(|covered| **covered).count();
    assert!(seen > 200, "{seen} of 210 degrees");
}

#[test]
fn after_a_reset_it_is_set_up_again_and_nothing_is_reported() {
    let (mut driver, mut device) = start();
    run(&mut driver, &mut device, 0, 1_000, true);
    device.reset();
    let (scans, update) = run(&mut driver, &mut device, 1_000, 1_500, true);
    assert_eq!(device.commands, [30, 27, 66, 85, 98, 99, 96, 30]);
    assert!(scans.len() > 20 && update.is_empty(), "{update:?}");
}

#[test]
fn silence_is_reported_once_and_so_is_its_end() {
    let (mut driver, mut device) = start();
    run(&mut driver, &mut device, 0, 1_000, true);
    let (_, lost) = run(&mut driver, &mut device, 1_000, 3_000, false);
    assert_eq!(lost, [DeviceChange::Lost]);
    device.reset();
    driver.connected(Timestamp::from_ns(5_000_000_000));
    let (scans, back) = run(&mut driver, &mut device, 4_000, 1_000, true);
    assert_eq!(back, [DeviceChange::Back]);
    assert!(scans.len() > 15);
}

#[test]
fn a_sensor_that_never_sends_is_reported_too() {
    let (mut driver, mut device) = start();
    let (scans, update) = run(&mut driver, &mut device, 0, 3_000, false);
    assert!(scans.is_empty() && device.commands.is_empty());
    assert_eq!(update, [DeviceChange::Lost]);
    assert_eq!(
        RangefinderService::event(DeviceChange::Lost, "front").text(),
        "jink: rangefinder front lost"
    );
    assert_eq!(
        RangefinderService::event(DeviceChange::Back, "front").text(),
        "jink: rangefinder front back"
    );
}
