//! Frames of every device, also its special values, come out as jink interprets them.

use crate::encoder::{benewake, cm8jl65, decode, lightware_packet, model, sf45, spec, text};
use jink_rangefinder_driver::decode::RangeReading::{Distance, Nothing, Unreliable};
use jink_rangefinder_driver::{FrameContent, Range, RangeReading};
use proptest::prelude::*;

fn answers(name: &str, bytes: &[u8]) -> Vec<RangeReading> {
    let items = decode(model(name), bytes);
    items
        .into_iter()
        .filter_map(|item| match item {
            FrameContent::Measured { answer, .. } => Some(answer),
            FrameContent::Acknowledged(_) => None,
        })
        .collect()
}

#[test]
fn frames_written_down_by_hand() {
    // 1.00 m at a strength of 1000 and 25 degrees Celsius: 0x59 + 0x59 + 0x64 + 0xE8 + 0x03 + 0xC8 + 0x08 = 0x2D1.
    let tf = [0x59, 0x59, 0x64, 0x00, 0xE8, 0x03, 0xC8, 0x08, 0xD1];
    assert_eq!(answers("tf_luna", &tf), [Distance(1.0)]);
    assert_eq!(benewake(100, 1000, 25.0), tf);
    assert_eq!(answers("sf11c", b"\n98.67\r\n"), [Distance(98.67)]);
    // The request for the product name, as every program for LightWare's devices begins: AA 40 00 00 and its checksum.
    assert_eq!(lightware_packet(0, false, &[])[..4], [0xAA, 0x40, 0x00, 0x00]);
    // Stream 5: flags of five bytes of payload in a write are 0x0141.
    assert_eq!(
        lightware_packet(30, true, &[5, 0, 0, 0])[..4],
        [0xAA, 0x41, 0x01, 30]
    );
}

#[test]
fn the_special_answers_of_the_manuals() {
    let one = |name: &str, bytes: Vec<u8>| {
        let found = answers(name, &bytes);
        assert_eq!(found.len(), 1, "{name}: {bytes:?}");
        found[0]
    };
    // TFmini: weak below 20, saturated above 2000, 1200 = farther than 12 m.
    assert_eq!(one("tfmini", benewake(300, 19, 0.0)), Unreliable);
    assert_eq!(one("tfmini", benewake(300, 20, 0.0)), Distance(3.0));
    assert_eq!(one("tfmini", benewake(300, 2_001, 0.0)), Unreliable);
    assert_eq!(one("tfmini", benewake(-1, 10, 0.0)), Unreliable);
    assert_eq!(one("tfmini", benewake(1_200, 60, 0.0)), Nothing);
    // TFmini-S and Plus: weak up to 100, -1 weak, -2 saturated, -4 ambient light.
    for name in ["tfmini_s", "tfmini_plus"] {
        assert_eq!(one(name, benewake(300, 100, 20.0)), Unreliable);
        assert_eq!(one(name, benewake(300, 101, 20.0)), Distance(3.0));
        for special_cm in [-1, -2, -4] {
            assert_eq!(one(name, benewake(special_cm, 500, 20.0)), Unreliable);
        }
        assert_eq!(one(name, benewake(1_200, 500, 20.0)), Distance(12.0));
    }
    // TF-Luna: weak below 100, overexposed at 65535, 0 = no signal.
    assert_eq!(one("tf_luna", benewake(0, 50, 20.0)), Unreliable);
    assert_eq!(one("tf_luna", benewake(250, 65_535, 20.0)), Unreliable);
    assert_eq!(one("tf_luna", benewake(250, 100, 20.0)), Distance(2.5));
    // LightWare: lost signals.
    assert_eq!(one("sf45b", sf45(-100, 0)), Nothing);
    for lost in ["130.00", "160.00", "230.00", "250.00", "-1.00"] {
        assert_eq!(one("lw20c", format!("\n{lost}\r\n").into_bytes()), Nothing);
    }
}

#[test]
fn what_becomes_of_an_answer() {
    let luna = spec("tf_luna", "/dev/x", "range_max_m = 5\n").reach;
    assert_eq!(
        luna.range(Distance(0.05)),
        Range::Hit(0.2f32.next_down()),
        "too near is an obstacle"
    );
    assert_eq!(luna.range(Distance(0.2)), Range::Hit(0.2));
    assert_eq!(luna.range(Distance(5.0)), Range::Hit(5.0));
    assert_eq!(
        luna.range(Distance(5.01)),
        Range::Clear,
        "what answers is behind the range that is looked at"
    );
    assert_eq!(
        luna.range(Distance(8.01)),
        Range::Unknown,
        "the device itself does not measure so far"
    );
    assert_eq!(luna.range(Nothing), Range::Clear);
    assert_eq!(luna.range(Unreliable), Range::Unknown);
    let lanbao = spec("cm8jl65", "/dev/x", "").reach;
    assert_eq!(
        lanbao.range(Distance(7.5)),
        Range::Unknown,
        "as it answers towards the sky"
    );
}

#[test]
fn a_text_counts_only_in_its_one_form() {
    for refused in [
        "",
        "12",
        "12.3",
        "12.345",
        "1234.56",
        ".50",
        "12,34",
        "12.34 m",
        " 12.34",
        "12.34\r",
        "--1.00",
        "+1.00",
        "ld,0:12.34",
    ] {
        assert_eq!(
            answers("sf11c", format!("\n{refused}\r\n").as_bytes()),
            [],
            "{refused:?}"
        );
    }
    assert_eq!(answers("sf11c", b"12.34\r\n"), [], "its beginning was not seen");
    assert_eq!(answers("sf11c", b"\n12.34\n"), [], "no carriage return");
    assert_eq!(
        answers("sf11c", b"\n0.00\r\n9.99\r\n"),
        [Distance(0.0), Distance(9.99)]
    );
}

#[test]
fn an_acknowledgement_is_distinguished_from_a_measurement_and_other_packets_are_skipped() {
    let mut bytes = lightware_packet(30, false, &[5, 0, 0, 0]);
    bytes.extend(lightware_packet(0, false, b"SF45\0\0\0\0\0\0\0\0\0\0\0\0"));
    bytes.extend(lightware_packet(44, false, &[1, 0, 2, 0, 3, 0]));
    bytes.extend(sf45(321, -9_000));
    assert_eq!(
        decode(model("sf45b"), &bytes),
        [
            FrameContent::Acknowledged(30),
            FrameContent::Measured {
                yaw_rad: -std::f32::consts::FRAC_PI_2,
                answer: Distance(3.21)
            }
        ]
    );
}

proptest! {
    #[test]
    fn every_measurement_comes_back_as_it_was_sent(
        cm in 0..i16::MAX, yaw_cdeg in -16_000..16_000i16, mm in 0..u16::MAX, strength in 101..2_000u16, temperature in -20.0..60.0f32
    ) {
        let near = |answer: &RangeReading, m: f32| matches!(answer, Distance(d) if (d - m).abs() <= 1e-5 * m.max(1.0));
        let turned = |yaw_rad: &f32| (yaw_rad.to_degrees() - f32::from(yaw_cdeg) / 100.0).abs() < 1e-3;
        let items = decode(model("sf45b"), &sf45(cm, yaw_cdeg));
        let is_same = matches!(&items[..], [FrameContent::Measured { yaw_rad, answer }]
            if near(answer, f32::from(cm) / 100.0) && turned(yaw_rad));
        prop_assert!(is_same, "{items:?}");
        let one = |name: &str, bytes: &[u8], m: f32| {
            let found = answers(name, bytes);
            found.len() == 1 && near(&found[0], m)
        };
        prop_assert!(one("cm8jl65", &cm8jl65(mm), f32::from(mm) / 1000.0));
        prop_assert!(one("tf_luna", &benewake(cm, strength, temperature), f32::from(cm) / 100.0));
        let cm = i32::from(cm);
        prop_assume!(![13_000, 16_000, 23_000, 25_000].contains(&cm));
        prop_assert!(one("sf11c", &[b"\n".to_vec(), text(cm)].concat(), cm as f32 / 100.0));
    }
}
