//! Whatever bytes come: nothing panics, nothing with a wrong checksum is read, and behind the noise the next frames
//! are.

use crate::encoder::{benewake, cm8jl65, decode, lightware_packet, sf45, text};
use jink_rangefinder_driver::{Decoder, FrameContent, RangeReading, devices};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;

/// Whether a frame with a right checksum ends at the end of `bytes`, by the manual's own arithmetic.
fn ends_in_a_sound_frame(name: &str, bytes: &[u8]) -> bool {
    let last = |count: usize| bytes.len().checked_sub(count).map(|at| &bytes[at..]);
    match name {
        "sf45b" => (6..=10).filter_map(last).any(|frame| {
            let data = &frame[4..frame.len() - 2];
            frame[0] == 0xAA && {
                let mut again = lightware_packet(frame[3], frame[1] & 1 == 1, data);
                // Reserved bits of the flags may be set: the checksum covers them, too.
                if again[1] != frame[1] {
                    again.clear();
                }
                again == frame || frame[1] & 0x3E != 0
            }
        }),
        "cm8jl65" => last(6).is_some_and(|frame| cm8jl65(u16::from_be_bytes([frame[2], frame[3]])) == frame),
        "sf11c" | "lw20c" => bytes.ends_with(b"\r\n"),
        _ => last(9).is_some_and(|frame| {
            let sum: u32 = frame[..8].iter().map(|byte| u32::from(*byte)).sum();
            frame[..2] == [0x59, 0x59] && (sum % 256) as u8 == frame[8]
        }),
    }
}

/// Bytes that look like pieces of frames more often than chance would have it.
fn noise() -> impl Strategy<Value = Vec<u8>> {
    let piece = prop_oneof![
        prop::collection::vec(any::<u8>(), 0..12),
        (any::<i16>(), any::<i16>(), 0..11usize).prop_map(|(d, y, cut)| sf45(d, y)[..cut.min(10)].to_vec()),
        (any::<u16>(), 0..7usize).prop_map(|(mm, cut)| cm8jl65(mm)[..cut.min(6)].to_vec()),
        (any::<i16>(), any::<u16>(), 0..10usize)
            .prop_map(|(d, s, cut)| benewake(d, s, 20.0)[..cut.min(9)].to_vec()),
        (0..20_000i32, 0..8usize).prop_map(|(cm, cut)| {
            let line = text(cm);
            line[..cut.min(line.len())].to_vec()
        }),
        Just(vec![0x59, 0x59, 0x59]),
        Just(vec![0xAA, 0xAA]),
        Just(vec![0xA5, 0x5A]),
    ];
    prop::collection::vec(piece, 0..8).prop_map(|pieces| pieces.concat())
}

/// Two frames of model `name` with two distances, and the distances (m).
fn two_frames(name: &str, cm: [i16; 2]) -> ([Vec<u8>; 2], [f32; 2]) {
    let frames = cm.map(|cm| match name {
        "sf45b" => sf45(cm, 4_500),
        "cm8jl65" => cm8jl65(cm as u16 * 10),
        "sf11c" | "lw20c" => text(cm.into()),
        _ => benewake(cm, 500, 30.0),
    });
    (frames, cm.map(|cm| f32::from(cm) / 100.0))
}

fn says(item: &FrameContent, m: f32) -> bool {
    matches!(item, FrameContent::Measured { answer: RangeReading::Distance(d), .. } if (d - m).abs() < 1e-3)
}

proptest! {
    #[test]
    fn only_what_has_a_right_checksum_is_read(bytes in noise()) {
        for model in devices::TABLE {
            let mut decoder = Decoder::new(model.format);
            for end in 0..bytes.len() {
                let mut frames = Vec::new();
                decoder.push(bytes[end], |frame| frames.push(frame));
                for frame in frames {
                    // A frame behind a false start is found a little later than it ended.
                    let sound = (0..=16.min(end)).any(|late| ends_in_a_sound_frame(model.name, &bytes[..=end - late]));
                    prop_assert!(sound, "{}: {:?} at {}", model.name, frame, end);
                }
            }
        }
    }

    #[test]
    fn behind_any_noise_a_good_frame_is_read_and_the_one_after_it_too(
        before in noise(), cm in [20..1_100i16, 20..1_100i16]
    ) {
        for model in devices::TABLE {
            let (frames, distances_m) = two_frames(model.name, cm);
            let found = decode(model, &[&before[..], &frames[0], &frames[1]].concat());
            prop_assert!(found.last().is_some_and(|item| says(item, distances_m[1])), "{}: {:?}", model.name, found);
            let noise_alone = decode(model, &before).len();
            let swallowed = decode(model, &[&before[..], &frames[0]].concat()).len() > noise_alone
                && !found.iter().any(|item| says(item, distances_m[0]));
            // Text has no beginning of its own: what noise has left in a line spoils that line. A sum of eight bits
            // lets one noise in 256 make a frame with the first bytes of a good one.
            let is_text = matches!(model.name, "sf11c" | "lw20c");
            if !is_text && !swallowed {
                prop_assert!(found.iter().any(|item| says(item, distances_m[0])), "{}: {:?}", model.name, found);
            }
        }
    }
}

#[test]
fn millions_of_random_bytes_make_hardly_a_reading_and_no_panic() {
    for model in devices::TABLE {
        let mut random = SplitMix64::seed_from_u64(7);
        let mut decoder = Decoder::new(model.format);
        let mut found = 0u64;
        for _ in 0..2_000_000 {
            // Half of the bytes are such as frames begin with: chance alone would seldom get past them.
            let byte = match random.random_range(0..16) {
                0 => 0x59,
                1 => 0xAA,
                2 => 0xA5,
                3 => 0x5A,
                4 => b'\n',
                5 => b'\r',
                6 => b'.',
                7 => random.random_range(b'0'..=b'9'),
                _ => random.random(),
            };
            decoder.push(byte, |_| found += 1);
        }
        let counts = decoder.counts();
        println!(
            "{}: {found} readings, {} damaged, {} bytes skipped",
            model.name, counts.damaged, counts.skipped_bytes
        );
        assert_eq!(found, counts.good);
        assert!(found < 200, "{}: {found}", model.name);
    }
}
