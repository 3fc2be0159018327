//! Packets made after the VLP-16 manual come to the points that velodyne-decoder makes of them, and to the ranges that
//! went in.

use crate::common::{Oracle, Row, ethernet, ipv4, pcap, rows};
use crate::encoder::vlp16;
use jink_lidar_driver::dump::{DumpRequest, Summary, dump};
use jink_testkit::temp_folder::TempFolder;
use std::path::Path;

/// Two turns and a half at 10 Hz, as a recording. Of every firing and laser another range.
fn recording(path: &Path, dual: bool, product: u8) {
    let firings = if dual { 12.0 } else { 24.0 };
    let step_cdeg = 360.0 * 10.0 * 55.296e-6 * 100.0;
    let packet_us = firings * 55.296;
    let count = (2.5 * 36_000.0 / step_cdeg / firings) as usize;
    let frames: Vec<(u64, Vec<u8>)> = (0..count)
        .map(|packet| {
            let ranges = |firing: usize, laser: usize, echo: usize| {
                let number = (packet * 24 + firing) * 16 + laser;
                if number.is_multiple_of(11) {
                    0
                } else {
                    (500 + number * 13 % 40_000 + echo * 900) as u16
                }
            };
            let stamp_us = (3_599_900_000.0 + packet as f64 * packet_us) as u64 % 3_600_000_000;
            let azimuth = packet as f64 * firings * step_cdeg;
            let packet_bytes = vlp16(stamp_us as u32, azimuth, step_cdeg, dual, product, &ranges);
            let time_ns = 1_600_000_000_000_000_000 + (packet as f64 * packet_us * 1e3) as u64;
            (
                time_ns,
                ethernet(&ipv4(&packet_bytes, 2368, packet as u16, 1_480)[0], 0),
            )
        })
        .collect();
    std::fs::write(path, pcap(false, false, 1, &frames)).unwrap();
}

fn dumped(folder: &TempFolder, pcap: &Path, model: Option<&str>) -> (Vec<Row>, Summary) {
    let csv = folder.join("out.csv");
    let request = DumpRequest {
        pcap: pcap.to_owned(),
        metadata: None,
        model: model.map(str::to_owned),
        csv: csv.clone(),
    };
    let summary = dump(&request, &mut |_, _| {}).unwrap();
    (rows(&std::fs::read_to_string(csv).unwrap()), summary)
}

#[test]
fn single_and_dual_returns_of_both_models_are_where_velodyne_decoder_puts_them() {
    let Some(oracle) = Oracle::find() else {
        return;
    };
    for (name, dual, product, model) in [
        ("single", false, 0x22, "VLP16"),
        ("dual", true, 0x22, "VLP16"),
        ("hires", false, 0x24, "PuckHiRes"),
    ] {
        let folder = TempFolder::new(&format!("vlp_{name}"));
        let path = folder.join("in.pcap");
        recording(&path, dual, product);
        let (ours, _) = dumped(&folder, &path, None);
        let theirs = rows(&oracle.run("with_velodyne_decoder.py", &[&path, Path::new(model)]));
        // Scans are cut elsewhere, and a pair of equal returns counts once there: each point of theirs is one of ours.
        let key = |row: &Row| {
            (
                row.key[1],
                (row.range_m * 500.0).round() as i64,
                (row.point_m[0] * 2.0).round() as i64,
            )
        };
        let mut by_key = std::collections::BTreeMap::<_, Vec<&Row>>::new();
        for row in &ours {
            by_key.entry(key(row).0).or_default().push(row);
        }
        assert!(theirs.len() > 20_000, "{name}: {}", theirs.len());
        let (mut worst_m, mut worst_deg) = (0.0f64, 0.0f64);
        let mut begin = [0usize; 16];
        for theirs in &theirs {
            let row = theirs.key[1] as usize;
            let candidates = &by_key[&theirs.key[1]];
            // Both go through the packets in the same order: the next one that is meant is not far.
            let found = (begin[row]..candidates.len().min(begin[row] + 400)).find(|at| {
                let ours = candidates[*at];
                let off_m = [0, 1, 2].map(|axis: usize| (ours.point_m[axis] - theirs.point_m[axis]).abs());
                off_m.iter().all(|off_m| *off_m < 0.02 + 2e-4 * theirs.range_m)
                    && ours.angle_to_deg(theirs) < 0.02
            });
            let at = found.unwrap_or_else(|| panic!("{name}: {theirs:?} is not among ours"));
            begin[row] = at.saturating_sub(1);
            let ours = candidates[at];
            let level = |row: &Row| row.point_m[0].hypot(row.point_m[1]);
            worst_m = worst_m
                .max((level(ours) - level(theirs)).abs())
                .max((ours.point_m[2] - theirs.point_m[2]).abs());
            worst_deg = worst_deg.max(ours.angle_to_deg(theirs));
        }
        println!(
            "{name}: {} of our {} returns, at most {:.2} mm and {worst_deg:.4} deg off",
            theirs.len(),
            ours.len(),
            worst_m * 1e3
        );
        assert!(
            worst_m <= 0.001 && worst_deg <= 0.011,
            "{name}: {worst_m} m, {worst_deg} deg"
        );
    }
}

#[test]
fn every_range_that_was_sent_comes_back_and_turns_are_scans() {
    let folder = TempFolder::new("vlp_all");
    let path = folder.join("in.pcap");
    recording(&path, false, 0x22);
    let (rows, summary) = dumped(&folder, &path, Some("vlp16"));
    assert_eq!((summary.scans, summary.lost, summary.passed_over), (3, 0, [0; 5]));
    // One of eleven pixels is none.
    let pixels = summary.packets * 384;
    assert_eq!(rows.len() as u64, pixels - pixels.div_ceil(11));
    for scan in 0..2 {
        let columns = rows.iter().filter(|row| row.key[0] == scan).map(|row| row.key[2]);
        let last = columns.max().unwrap();
        assert!(
            (1_800..=1_812).contains(&last),
            "{last} firings in a turn of 100 ms"
        );
    }
}

#[test]
fn another_product_a_position_packet_and_a_wrong_model_are_passed_over() {
    let folder = TempFolder::new("vlp_other");
    let path = folder.join("in.pcap");
    recording(&path, false, 0x21);
    let request = DumpRequest {
        pcap: path.clone(),
        metadata: None,
        model: Some("vlp16".to_owned()),
        csv: folder.join("out.csv"),
    };
    let said = dump(&request, &mut |_, _| {}).unwrap_err().to_string();
    assert!(said.contains("is a packet of a vlp16; does the model"), "{said}");
}
