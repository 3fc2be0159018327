//! Scanners as their manuals describe them: every range comes back in its beam, RPLIDARs are commanded to scan, and
//! what is damaged is dropped.

use crate::encoder::{ldrobot, rplidar_capsule, rplidar_dense, rplidar_descriptor, rplidar_sample, spec};
use jink_lidar_driver::models::{self, Connection};
use jink_lidar_driver::{ScannerDriver, Turn};
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::RangeScan;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

fn driver(model: &str, keys: &str) -> ScannerDriver {
    let Connection::Serial(protocol) = models::find(model).unwrap().connection else {
        panic!("{model} is no scanner");
    };
    ScannerDriver::new(spec("lidar_2d", model, "/dev/x", keys), protocol)
}

/// What stands around the scanner (mm): different in every direction, nothing behind, something beyond a 12 m range on
/// the left.
fn range_mm(angle_deg: f64) -> u16 {
    match angle_deg {
        170.0..190.0 => 0,
        260.0..280.0 => 14_000,
        _ => (1_000.0 + 10.0 * angle_deg) as u16,
    }
}

/// Feeds bytes at these times, and returns the scans.
fn scans(driver: &mut ScannerDriver, wire: &[(f64, Vec<u8>)]) -> Vec<RangeScan> {
    let mut scans = Vec::new();
    for (time_s, bytes) in wire {
        let now = Timestamp::from_seconds(100.0 + time_s);
        driver.bytes(now, bytes, &mut |turn: &Turn| {
            let mut scan = RangeScan::default();
            turn.write(&mut scan);
            assert!(scan.is_consistent());
            assert!(turn.capture() <= now);
            scans.push(scan);
        });
    }
    scans
}

fn judge(name: &str, scan: &RangeScan, tolerance_deg: f64) {
    assert_eq!(scan.ranges().len(), scan.beams as usize);
    for (beam, range_m) in scan.ranges().iter().enumerate() {
        let angle_deg = f64::from(scan.angle_first_rad + beam as f32 * scan.angle_step_rad).to_degrees();
        let near_edge = [170.0, 190.0, 260.0, 280.0, 0.0, 360.0]
            .iter()
            .any(|edge: &f64| (angle_deg - edge).abs() <= 2.0 * tolerance_deg);
        match range_mm(angle_deg) {
            _ if near_edge => {}
            0 => assert!(
                range_m.is_nan(),
                "{name}: nothing is known at {angle_deg}: {range_m}"
            ),
            14_000 => assert_eq!(
                *range_m,
                f32::INFINITY,
                "{name}: nothing up to 12 m at {angle_deg}"
            ),
            expected => {
                let off_mm = (f64::from(*range_m) * 1e3 - f64::from(expected)).abs();
                assert!(
                    off_mm <= 10.0 * tolerance_deg + 1.0,
                    "{name}: {range_m} at {angle_deg}, not {expected}"
                );
            }
        }
    }
}

/// Turns of an LDROBOT scanner: degrees between samples, and turns per second.
fn ldrobot_wire(step_deg: f64, rate_hz: f64, packets: usize) -> Vec<(f64, Vec<u8>)> {
    let speed_dps = (360.0 * rate_hz) as u16;
    (0..packets)
        .map(|packet| {
            let first_deg = packet as f64 * 12.0 * step_deg % 360.0;
            let ranges = std::array::from_fn(|index| range_mm((first_deg + index as f64 * step_deg) % 360.0));
            let time_s = (packet + 1) as f64 * 12.0 * step_deg / f64::from(speed_dps);
            (
                time_s,
                ldrobot(
                    speed_dps,
                    first_deg,
                    step_deg,
                    ranges,
                    (time_s * 1e3) as u16 % 30_000,
                ),
            )
        })
        .collect()
}

#[test]
fn ldrobot_scanners_show_what_stands_around_them() {
    for (model, step_deg, beams) in [("ld06", 0.8, 360), ("ld19", 0.8, 360), ("stl27l", 1.0 / 6.0, 720)] {
        let mut driver = driver(model, "range_max_m = 12\n");
        let packets = (3.2 * 360.0 / step_deg / 12.0) as usize;
        let scans = scans(&mut driver, &ldrobot_wire(step_deg, 10.0, packets));
        assert_eq!(scans.len(), 3, "{model}");
        for scan in &scans {
            assert_eq!(scan.beams, beams);
            judge(model, scan, 360.0 / f64::from(beams));
            let turn_s = f64::from(scan.beam_interval_s) * f64::from(beams);
            assert!((turn_s - 0.1).abs() < 0.005, "{model}: a turn of {turn_s} s");
        }
        assert!(
            driver.next_write(Timestamp::from_seconds(200.0)).is_none(),
            "it streams by itself"
        );
    }
}

#[test]
fn rplidars_are_asked_to_scan_and_every_kind_of_answer_is_read() {
    for model in [
        "rplidar_a1",
        "rplidar_a2",
        "rplidar_a3",
        "rplidar_s1",
        "rplidar_s2",
        "rplidar_c1",
    ] {
        for kind in [0x81, 0x82, 0x85] {
            let mut driver = driver(model, "range_max_m = 12\n");
            let start = Timestamp::from_seconds(99.0);
            driver.connected(start);
            let mut written = Vec::new();
            for tick in 0..20 {
                while let Some(bytes) = driver.next_write(start.plus_seconds(0.05 * f64::from(tick))) {
                    written.push(bytes.to_vec());
                }
            }
            let mut expected = vec![vec![0xA5, 0x25], vec![0xA5, 0x52]];
            if matches!(model, "rplidar_a2" | "rplidar_a3") {
                expected.push(vec![0xA5, 0xF0, 2, 0x94, 0x02, 0xA5 ^ 0xF0 ^ 2 ^ 0x94 ^ 0x02]);
            }
            expected.push(vec![0xA5, 0x82, 5, 0, 0, 0, 0, 0, 0xA5 ^ 0x82 ^ 5]);
            assert_eq!(written, expected, "{model}");
            let scans = scans(&mut driver, &rplidar_wire(kind));
            assert!(scans.len() >= 3, "{model} {kind:#x}: {} scans", scans.len());
            for scan in &scans[1..] {
                judge(&format!("{model} {kind:#x}"), scan, 1.0);
            }
        }
    }
}

/// Four turns at 10 Hz and a half-degree between samples.
fn rplidar_wire(kind: u8) -> Vec<(f64, Vec<u8>)> {
    let (samples, length) = match kind {
        0x81 => (1, 5),
        0x82 => (32, 84),
        _ => (40, 84),
    };
    let step_deg = 0.5;
    let mut wire = vec![(0.0, rplidar_descriptor(kind, length, true))];
    for frame in 0..4 * 720 / samples {
        let first_deg = (frame * samples) as f64 * step_deg % 360.0;
        let at = |index: usize| (first_deg + index as f64 * step_deg) % 360.0;
        let bytes = match kind {
            0x81 => rplidar_sample(first_deg == 0.0, first_deg, range_mm(first_deg).into()),
            0x82 => {
                // A correction of half a degree: the sample was measured before its even place.
                let ranges = std::array::from_fn(|index| range_mm((at(index) + 359.5) % 360.0));
                rplidar_capsule(frame == 0, first_deg, &ranges, &[4; 32])
            }
            _ => rplidar_dense(
                frame == 0,
                first_deg,
                &std::array::from_fn(|index| range_mm(at(index))),
            ),
        };
        wire.push(((frame + 1) as f64 * samples as f64 / 7_200.0, bytes));
    }
    wire
}

#[test]
fn an_rplidar_that_stays_silent_is_asked_again_in_the_other_way_and_one_that_protects_itself_is_reset() {
    let mut driver = driver("rplidar_a1", "");
    let start = Timestamp::from_seconds(10.0);
    driver.connected(start);
    let mut commands = Vec::new();
    for tick in 0..400 {
        let now = start.plus_seconds(0.05 * f64::from(tick));
        while let Some(bytes) = driver.next_write(now) {
            commands.push(bytes[1]);
            if commands.len() == 2 {
                // GET_HEALTH: protection stop.
                let answer = [rplidar_descriptor(6, 3, false), vec![2, 1, 0]].concat();
                driver.bytes(now, &answer, &mut |_| {});
            }
        }
    }
    assert_eq!(commands[..6], [0x25, 0x52, 0x40, 0x25, 0x52, 0x82]);
    assert!(
        commands.contains(&0x20),
        "SCAN instead of EXPRESS_SCAN: {commands:x?}"
    );
}

#[test]
fn garbage_and_damage_on_the_line_never_panic_and_pass_as_seldom_as_eight_bits_allow() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
    for (model, wire) in [
        ("ld06", ldrobot_wire(0.8, 10.0, 40_000)),
        ("rplidar_a1", (0..400).flat_map(|_| rplidar_wire(0x82)).collect()),
        ("rplidar_s2", (0..400).flat_map(|_| rplidar_wire(0x85)).collect()),
        ("rplidar_a1", (0..20).flat_map(|_| rplidar_wire(0x81)).collect()),
    ] {
        let mut driver = driver(model, "range_max_m = 12\n");
        driver.connected(Timestamp::from_seconds(1.0));
        let single = wire[1].1.len() == 5;
        let (mut wrong, mut beams, mut damaged, mut time_s) = (0u64, 0u64, 0u64, 100.0);
        for (index, (_, bytes)) in wire.iter().enumerate() {
            let mut bytes = bytes.clone();
            for byte in &mut bytes {
                // A descriptor that is lost is another story: the scanner is set up anew.
                if bytes_may_break(index) && random.random_ratio(1, 100) {
                    *byte = random.random();
                    damaged += 1;
                }
            }
            if random.random_ratio(1, 50) {
                bytes.truncate(random.random_range(0..=bytes.len()));
            }
            time_s += bytes.len() as f64 * 1e-4;
            driver.bytes(Timestamp::from_seconds(time_s), &bytes, &mut |turn: &Turn| {
                let mut scan = RangeScan::default();
                turn.write(&mut scan);
                for (beam, range_m) in scan.ranges().iter().enumerate() {
                    let angle_deg = (beam as f64 + 0.5) * 360.0 / f64::from(scan.beams);
                    let window =
                        (-3..=3).map(|off| range_mm((angle_deg + f64::from(off) * 0.7).rem_euclid(360.0)));
                    let nearest_mm = window.filter(|mm| *mm > 0).min().unwrap_or(0);
                    beams += 1;
                    wrong += u64::from(
                        range_m.is_finite() && f64::from(*range_m) * 1e3 + 60.0 < f64::from(nearest_mm),
                    );
                }
            });
        }
        let share = wrong as f64 / beams.max(1) as f64;
        println!(
            "{model}: {damaged} damaged bytes in {} frames; {wrong} of {beams} beams too near ({:.4} %)",
            wire.len(),
            share * 100.0
        );
        assert!(beams > 1_000, "{model}");
        // Three bits protect a single sample: a damaged byte of it often passes.
        assert!(share < if single { 0.02 } else { 0.002 }, "{model}: {share}");
    }
}

/// The first frame holds the descriptor.
fn bytes_may_break(index: usize) -> bool {
    index > 0
}
