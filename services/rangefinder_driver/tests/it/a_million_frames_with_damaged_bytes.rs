//! A long run on a bad line: of a million frames per device one byte in a hundred is damaged, and some are lost or come
//! twice. How many frames are read, how many readings are wrong, and what is left of those in the scans.

use crate::encoder::{benewake, cm8jl65, model, sf45, spec, text};
use jink_rangefinder_driver::{Decoder, FrameContent, RangeReading, RangefinderDriver};
use jink_shared_types::Timestamp;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;

const FRAMES: u64 = 1_000_000;
/// One byte in this many is another one than was sent ...
const DAMAGED: u32 = 100;
/// ... one in this many is missing, and one in this many is there twice.
const LOST: u32 = 10_000;

/// The distance of frame `index` (cm): to and fro between 0.5 and 5.5 m, 1 cm per frame, 1 m/s at 100 Hz.
fn distance_cm(index: u64) -> i16 {
    let phase = (index % 1_000) as i16;
    50 + if phase < 500 { phase } else { 1_000 - phase }
}

fn frame(name: &str, index: u64) -> Vec<u8> {
    let cm = distance_cm(index);
    match name {
        "sf45b" => sf45(cm, 0),
        "cm8jl65" => cm8jl65(cm as u16 * 10),
        "sf11c" => text(cm.into()),
        _ => benewake(cm, 800, 30.0),
    }
}

/// What comes out of the line for `sent`; whether it is what was sent.
fn over_a_bad_line(sent: &[u8], random: &mut SplitMix64, out: &mut Vec<u8>) -> bool {
    out.clear();
    for byte in sent {
        if random.random_ratio(1, LOST) {
            continue;
        }
        let damage = if random.random_ratio(1, DAMAGED) {
            random.random_range(1..=255)
        } else {
            0
        };
        out.push(byte ^ damage);
        if random.random_ratio(1, LOST) {
            out.push(byte ^ damage);
        }
    }
    out == sent
}

struct ReadingCounts {
    sound: u64,
    read: u64,
    /// Readings that were not sent within the last frames.
    wrong: u64,
    damaged: u64,
}

/// A device that is decoded frame by frame.
fn decode_all(name: &str, seed: u64) -> ReadingCounts {
    let mut random = SplitMix64::seed_from_u64(seed);
    let mut decoder = Decoder::new(model(name).format);
    let mut wire = Vec::new();
    let mut day = ReadingCounts {
        sound: 0,
        read: 0,
        wrong: 0,
        damaged: 0,
    };
    for index in 0..FRAMES {
        day.sound += u64::from(over_a_bad_line(&frame(name, index), &mut random, &mut wire));
        for byte in &wire {
            decoder.push(*byte, |frame| {
                let FrameContent::Measured { answer, .. } = frame.item else {
                    day.wrong += 1;
                    return;
                };
                day.read += 1;
                // A frame behind a false start is read with the next one.
                let recent = index.saturating_sub(2)..=index;
                let sent = recent.into_iter().any(|index| {
                    matches!(answer, RangeReading::Distance(m) if (m - f32::from(distance_cm(index)) / 100.0).abs() < 1e-3)
                });
                day.wrong += u64::from(!sent);
            });
        }
    }
    day.damaged = decoder.counts().damaged;
    day
}

/// What a whole driver publishes.
#[derive(Debug, Default)]
struct Published {
    scans: u64,
    known: u64,
    /// Farther than anything that was sent in its time.
    too_far: u64,
    /// Nearer than that, by no more than two answers may differ that confirm each other ...
    nearer: u64,
    /// ... and by more.
    too_near: u64,
    worst_m: f32,
}

/// A device that sends a new value every 10 ms, or every 25 ms the value before every other time.
fn publish_all(name: &str, seed: u64, frame_ms: u64, copies: u64) -> Published {
    let mut random = SplitMix64::seed_from_u64(seed);
    let mut driver = RangefinderDriver::new(spec(name, "/dev/x", ""));
    let tolerance_m = (20.0 * 0.05 + 4.0 * driver.spec().sigma_m) as f32;
    let (mut wire, mut published) = (Vec::new(), Published::default());
    let (start_ns, frame_ns) = (1_000_000_000, frame_ms * 1_000_000);
    for index in 0..FRAMES {
        over_a_bad_line(&frame(name, index / copies), &mut random, &mut wire);
        let now = Timestamp::from_ns(start_ns + index * frame_ns);
        driver.bytes(now, &wire, &mut |view| {
            published.scans += 1;
            let range_m = view.range_m[0];
            if range_m.is_nan() {
                return;
            }
            published.known += 1;
            let at = (view.capture.ns + frame_ns / 2 - start_ns) / frame_ns / copies;
            let sent = (at.saturating_sub(2)..=at + 2).map(|index| f32::from(distance_cm(index)) / 100.0);
            let (low_m, high_m) = sent.fold((f32::MAX, 0.0f32), |(low, high), m| (low.min(m), high.max(m)));
            let short_m = low_m - range_m;
            published.worst_m = published.worst_m.max(short_m);
            published.too_far += u64::from(range_m > high_m + 0.01);
            published.nearer += u64::from((0.01..=tolerance_m).contains(&short_m));
            published.too_near += u64::from(short_m > tolerance_m);
        });
    }
    published
}

/// Readings that must be expected to slip through a sum of eight bits: two of the seven bytes behind the head are
/// damaged, one of them of the distance, the others are not, and the two damages cancel in the sum, which one pair of
/// 255 does.
fn expected_behind_a_sum() -> f64 {
    let p = 1.0 / DAMAGED as f64;
    let pairs_with_distance = 11.0;
    FRAMES as f64 * pairs_with_distance * p.powi(2) * (1.0 - p).powi(7) / 255.0
}

/// The same behind a checksum of 16 bits over a frame of `bytes` whose first `head` bytes must be right: two damaged
/// bytes further apart than the 16 bits of a burst, which is always found, and one checksum in 65536 right by chance.
fn expected_behind_a_crc(bytes: u32, head: u32) -> f64 {
    let p = 1.0 / DAMAGED as f64;
    let open = f64::from(bytes - head);
    let pairs = open * (open - 1.0) / 2.0 - (open - 1.0);
    FRAMES as f64 * pairs * p.powi(2) / 65_536.0
}

#[test]
fn checksums_of_sixteen_bits_let_nothing_wrong_through() {
    for (name, expected) in [
        ("sf45b", expected_behind_a_crc(10, 1)),
        ("cm8jl65", expected_behind_a_crc(6, 2)),
    ] {
        let day = decode_all(name, 11);
        println!(
            "{name}: {FRAMES} frames, {} sound, {} read, {} damaged, {} wrong ({expected:.3} expected)",
            day.sound, day.read, day.damaged, day.wrong
        );
        assert_eq!(day.wrong, 0);
        // A frame that noise has run into may be lost with it; no more than one in a thousand is.
        assert!(
            day.read >= day.sound - FRAMES / 1_000,
            "{name}: {} of {}",
            day.read,
            day.sound
        );
    }
}

#[test]
fn what_slips_through_a_sum_of_eight_bits_does_not_reach_a_scan() {
    let day = decode_all("tf_luna", 12);
    let expected = expected_behind_a_sum();
    println!(
        "tf_luna: {FRAMES} frames, {} sound, {} read, {} damaged, {} wrong ({expected:.1} expected)",
        day.sound, day.read, day.damaged, day.wrong
    );
    assert!(day.read >= day.sound - FRAMES / 1_000);
    assert!((day.wrong as f64) < 6.0 * expected + 10.0, "{}", day.wrong);
    let published = publish_all("tf_luna", 12, 10, 1);
    println!("tf_luna: {published:?}");
    assert_eq!(
        (published.too_far, published.nearer, published.too_near),
        (0, 0, 0)
    );
    assert!(published.known as f64 > 0.999 * published.scans as f64);
}

#[test]
fn text_without_a_checksum_is_accepted_only_when_sent_twice() {
    let day = decode_all("sf11c", 13);
    println!(
        "sf11c: {FRAMES} lines, {} sound, {} read, {} damaged, {} wrong",
        day.sound, day.read, day.damaged, day.wrong
    );
    let published = publish_all("sf11c", 13, 25, 2);
    println!("sf11c: {published:?}");
    assert_eq!(
        published.too_far, 0,
        "nothing is opened that was not seen to be open"
    );
    assert!(published.too_near <= 2, "two damaged lines that agree");
    assert!(published.nearer as f64 <= 1e-3 * published.scans as f64);
    assert!(published.known as f64 > 0.95 * published.scans as f64);
}
