//! Capture times come from the arrival of the bytes, less their time on the wire, however the bytes were cut up on
//! their way.

use crate::encoder::{benewake, spec, text};
use jink_rangefinder_driver::RangefinderDriver;
use jink_shared_types::Timestamp;
use proptest::prelude::*;

const BYTE_NS: f64 = 10.0e9 / 115_200.0;

fn at(ns: f64) -> Timestamp {
    Timestamp::from_ns(1_000_000_000 + ns as u64)
}

proptest! {
    #[test]
    fn however_the_bytes_are_cut_up(cuts in prop::collection::vec(1..20usize, 1..60)) {
        let mut driver = RangefinderDriver::new(spec("tf_luna", "/dev/x", ""));
        // A thousand frames a second for a fifth of a second; each distance identifies its frame.
        let mut wire = Vec::new();
        for index in 0..200i16 {
            let begin_ns = f64::from(index) * 1e6;
            for (place, byte) in benewake(200 + index, 500, 20.0).into_iter().enumerate() {
                wire.push((begin_ns + (place as f64 + 1.0) * BYTE_NS, byte));
            }
        }
        let mut captures = Vec::new();
        let mut rest = &wire[..];
        for cut in cuts.iter().cycle() {
            let (read, later) = rest.split_at((*cut).min(rest.len()));
            let Some((end_ns, _)) = read.last() else { break };
            let bytes: Vec<u8> = read.iter().map(|(_, byte)| *byte).collect();
            driver.bytes(at(*end_ns), &bytes, &mut |view| captures.push((view.capture, view.range_m[0])));
            rest = later;
        }
        prop_assert!(captures.len() >= 3);
        for (capture, range_m) in captures {
            let index = f64::from((range_m * 100.0).round()) - 200.0;
            let error_s = capture.seconds_since(at(index * 1e6));
            // A read that spans a pause of the line takes the bytes before it for later than they were: by the pause.
            prop_assert!((-1e-7..=2.0 * 1e-3).contains(&error_s), "frame {index}: {error_s} s");
        }
    }
}

#[test]
fn a_frame_read_alone_is_dated_to_the_bit() {
    let mut driver = RangefinderDriver::new(spec("tf_luna", "/dev/x", ""));
    let mut captures = Vec::new();
    for index in 0..20 {
        let arrived = at(f64::from(index) * 10e6 + 9.0 * BYTE_NS);
        driver.bytes(arrived, &benewake(300, 500, 20.0), &mut |view| {
            captures.push(view.capture);
        });
    }
    assert_eq!(captures.len(), 3);
    for capture in captures {
        let since_ns = capture.ns as i64 - 1_000_000_000;
        assert!((since_ns % 10_000_000).abs() < 10, "{since_ns}");
    }
}

#[test]
fn a_text_device_is_asked_and_its_answers_are_dated_alike() {
    let mut driver = RangefinderDriver::new(spec("sf11c", "/dev/x", ""));
    let (mut requests, mut scans, mut answer) = (0, Vec::new(), Vec::new());
    driver.connected(at(0.0));
    for ms in 0..1_000 {
        let now = at(f64::from(ms) * 1e6);
        while let Some(bytes) = driver.next_write(now).map(<[u8]>::to_vec) {
            if bytes == b"d" {
                requests += 1;
                answer = text(750);
            }
        }
        driver.bytes(now, &std::mem::take(&mut answer), &mut |view| {
            scans.push(view.range_m[0]);
        });
        driver.tick(now, &mut |view| scans.push(view.range_m[0]));
    }
    assert!((38..=40).contains(&requests), "{requests}");
    assert!((18..=21).contains(&scans.len()), "{}", scans.len());
    // The first line of all is not whole for certain.
    assert!(scans[1..].iter().all(|range_m| *range_m == 7.5), "{scans:?}");
}
