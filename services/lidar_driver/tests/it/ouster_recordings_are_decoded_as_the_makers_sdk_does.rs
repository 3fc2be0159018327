//! Every return of recordings of real Ouster sensors comes out where the vendor's SDK puts it: range, direction,
//! number.

use crate::common::{Oracle, Row, here, rows, shared};
use jink_lidar_driver::dump::{DumpRequest, dump};
use jink_testkit::temp_folder::TempFolder;
use std::path::Path;

/// The table of a recording, as the dump writes it.
fn dumped(name: &str, pcap: &Path, metadata: &Path) -> Vec<Row> {
    let folder = TempFolder::new(name);
    let csv = folder.join("out.csv");
    let request = DumpRequest {
        pcap: pcap.to_owned(),
        metadata: Some(metadata.to_owned()),
        model: None,
        csv: csv.clone(),
    };
    let summary = dump(&request, &mut |_, _| {}).unwrap();
    let text = std::fs::read_to_string(csv).unwrap();
    assert_eq!(text.lines().next(), Some("scan,row,column,range_m,x_m,y_m,z_m"));
    let rows = rows(&text);
    assert_eq!(rows.len() as u64, summary.returns);
    rows
}

/// Number of returns, and the sums of range, x, y and z (m), of the returns of each recording as ouster-sdk 1.0.1
/// decodes it.
const DECODED_BY_THE_SDK: [(&str, &str, usize, [f64; 4]); 7] = [
    (
        "shot_limiting_test",
        "shot_limiting_test",
        2_048,
        [82.618, -78.757, 11.441, 77.892],
    ),
    (
        "duplicate_id",
        "duplicate_id",
        1_779,
        [68_317.528, 61_279.787, 29_209.675, 2_510.503],
    ),
    (
        "windowed_frame2",
        "windowed_frame2_0",
        8_447,
        [10_370.432, -6_637.439, -4_537.113, 1_171.058],
    ),
    (
        "same_ports_legacy",
        "same_ports_legacy.1",
        486,
        [783.844, 316.733, -629.978, 159.855],
    ),
    (
        "same_ports_legacy",
        "same_ports_legacy.2",
        63,
        [24.46, -18.896, 15.066, 5.471],
    ),
    (
        "same_ports_nonlegacy",
        "same_ports_nonlegacy.1",
        1_573,
        [3_776.632, -2_983.055, 1_035.843, 1_608.607],
    ),
    (
        "same_ports_nonlegacy",
        "same_ports_nonlegacy.2",
        1_046,
        [1_031.29, 1_019.053, 50.513, 147.444],
    ),
];

#[test]
fn packets_of_every_profile_come_to_the_returns_of_the_sdk() {
    for (pcap, metadata, returns, sums) in DECODED_BY_THE_SDK {
        let rows = dumped(
            metadata,
            &here(&format!("tests/data/{pcap}.pcap")),
            &here(&format!("tests/data/{metadata}.json")),
        );
        assert_eq!(rows.len(), returns, "{metadata}");
        let sum = |of: fn(&Row) -> f64| rows.iter().map(of).sum::<f64>();
        let ours = [
            sum(|row| row.range_m),
            sum(|row| row.point_m[0]),
            sum(|row| row.point_m[1]),
            sum(|row| row.point_m[2]),
        ];
        for (ours, theirs) in ours.iter().zip(sums) {
            // Rounding of single precision: at most 20 um each.
            assert!(
                (ours - theirs).abs() < 0.001 + 2e-5 * returns as f64,
                "{metadata}: {ours} {theirs}"
            );
        }
    }
}

#[test]
fn every_return_of_an_os1_128_is_where_the_sdk_puts_it() {
    let (Some(pcap), Some(metadata)) = (
        shared("data/ouster_os1_128.pcap"),
        shared("data/ouster_os1_128.json"),
    ) else {
        return;
    };
    compared("os1_128", &pcap, &metadata);
}

#[test]
fn every_return_of_a_sensor_with_two_returns_is_where_the_sdk_puts_it() {
    for name in ["same_ports_nonlegacy.1", "same_ports_nonlegacy.2"] {
        compared(
            name,
            &here("tests/data/same_ports_nonlegacy.pcap"),
            &here(&format!("tests/data/{name}.json")),
        );
    }
}

/// Compares point by point with the SDK; reports where there is none.
fn compared(name: &str, pcap: &Path, metadata: &Path) {
    let Some(oracle) = Oracle::find() else {
        return;
    };
    let theirs = oracle.run("with_ouster_sdk.py", &[pcap, metadata]);
    let mut theirs = rows(&theirs);
    let mut ours = dumped(name, pcap, metadata);
    assert_eq!(ours.len(), theirs.len(), "{name}");
    let order = |a: &Row, b: &Row| a.key.cmp(&b.key).then(a.range_m.total_cmp(&b.range_m));
    ours.sort_by(order);
    theirs.sort_by(order);
    let (mut range_m, mut angle_deg) = (0.0f64, 0.0f64);
    for (ours, theirs) in ours.iter().zip(&theirs) {
        assert_eq!(ours.key, theirs.key, "{name}");
        range_m = range_m.max((ours.range_m - theirs.range_m).abs());
        angle_deg = angle_deg.max(ours.angle_to_deg(theirs));
    }
    println!(
        "{name}: {} returns, at most {:.4} mm and {angle_deg:.5} deg off",
        ours.len(),
        range_m * 1e3
    );
    assert!(range_m <= 0.001, "{name}: {range_m} m");
    assert!(angle_deg <= 0.01, "{name}: {angle_deg} deg");
}
