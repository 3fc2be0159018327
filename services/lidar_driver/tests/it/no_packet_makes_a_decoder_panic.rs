//! Garbage, truncation and damage: no decoder panics, and what a checksum covers is never wrong.

use crate::encoder::{livox1, livox2, ouster_metadata, ouster_standard, vlp16};
use jink_lidar_driver::Decoder;
use jink_lidar_driver::config::SensorTable;
use jink_lidar_driver::decode::{Decode, Item};
use jink_lidar_driver::models::{self, Connection, NetworkProtocol};
use jink_lidar_driver::ouster::{Metadata, PROFILES};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::BTreeSet;

fn decoders() -> Vec<(String, Decoder)> {
    let of_models = models::TABLE.iter().filter_map(|model| match model.connection {
        Connection::Network(protocol) => Some((model.name.to_owned(), Decoder::of(protocol, 10.0)?)),
        Connection::Serial(_) => None,
    });
    let of_profiles = PROFILES.iter().map(|profile| {
        let metadata = Metadata::parse(&ouster_metadata(16, 512, profile.name)).unwrap();
        (profile.name.to_owned(), Decoder::ouster(metadata))
    });
    of_models.chain(of_profiles).collect()
}

/// Lengths at which decoders look further.
fn lengths() -> Vec<usize> {
    let mut lengths = vec![
        1206,
        512,
        48,
        36 + 96 * 14,
        36 + 96 * 8,
        36 + 96 * 10,
        1318,
        918,
        1362,
        978,
        786,
        1278,
        678,
    ];
    for (_, decoder) in decoders() {
        if let Decoder::Ouster(ouster) = decoder {
            lengths.push(ouster.packet_bytes());
        }
    }
    lengths
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn garbage_of_any_length_is_survived(seed in 1u64.., length in prop::sample::select(lengths()), marks in any::<[u8; 8]>()) {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        for (_, mut decoder) in decoders() {
            for _ in 0..4 {
                let mut bytes: Vec<u8> = (0..length).map(|_| random.random::<u8>()).collect();
                for (place, mark) in bytes.iter_mut().zip(marks) {
                    *place = mark;
                }
                let _ = decoder.packet(&bytes, &mut |_| {});
            }
            decoder.finish(&mut |_| {});
        }
    }

    #[test]
    fn any_text_as_metadata_is_refused_or_taken_without_a_panic(text in ".{0,200}", at in 0usize..600, byte in any::<u8>()) {
        let _ = Metadata::parse(&text);
        let mut good = ouster_metadata(16, 512, "LEGACY").into_bytes();
        let at = at % good.len();
        good[at] = byte;
        if let Ok(metadata) = Metadata::parse(&String::from_utf8_lossy(&good)) {
            let _ = Decoder::ouster(metadata);
        }
    }

    #[test]
    fn any_values_in_a_table_are_refused_or_taken_without_a_panic(key in "[a-z_]{1,14}", number in any::<f64>(), word in ".{0,12}") {
        for value in [toml::Value::Float(number), toml::Value::String(word.clone())] {
            let text = "name = \"top\"\nkind = \"lidar_3d\"\nmodel = \"vlp16\"\ndevice = \"udp:0.0.0.0:2368\"\n";
            let mut table: SensorTable = text.parse::<toml::Table>().unwrap().into_iter().collect();
            for name in [key.as_str(), "range_max_m", "returns", "blind_deg", "quaternion", "device"] {
                table.insert(name.to_owned(), value.clone());
                let _ = jink_lidar_driver::LidarSpec::find(std::slice::from_ref(&table), "top");
            }
        }
    }
}

/// Sound packets of a stream.
fn stream(name: &str, count: usize) -> Vec<Vec<u8>> {
    (0..count)
        .map(|index| match name {
            "ouster" => {
                let (frame, first) = (index / 32, index % 32 * 16);
                ouster_standard(
                    frame as u16,
                    first,
                    16,
                    index as u64 * 1_562_500,
                    &|row, column| 2_000 + (row * 512 + column) as u32 % 997 * 8,
                )
            }
            "vlp16" => vlp16(
                index as u32 * 1_327,
                index as f64 * 24.0 * 20.0,
                20.0,
                false,
                0x22,
                &|firing, laser, _| 1_000 + (firing * 16 + laser) as u16 * 8,
            ),
            "livox2" => {
                let point = |at: usize| [1_000 + 16 * at as i32, 500, 250].map(i32::to_le_bytes).concat();
                let points: Vec<Vec<u8>> = (0..96).map(|at| [point(at), vec![9, 0]].concat()).collect();
                livox2(index as u16, index as u64 * 480_000, 4_800, 1, &points)
            }
            _ => {
                let point = |at: usize| [1_000 + 16 * at as i32, 500, 250].map(i32::to_le_bytes).concat();
                let points: Vec<Vec<u8>> = (0..96).map(|at| [point(at), vec![9, 0]].concat()).collect();
                livox1(1 + index as u64 * 400_000, 2, &points)
            }
        })
        .collect()
}

/// What identifies a ray: place and range in tenths of millimetres.
fn rays_of(decoder: &mut Decoder, packet: &[u8]) -> Vec<[i64; 3]> {
    let mut rays = Vec::new();
    let _ = decoder.packet(packet, &mut |item| {
        if let Item::Ray(ray) = item {
            rays.push(
                ray.at(ray.range_m)
                    .map(|part| (f64::from(part) * 1e4).round() as i64),
            );
        }
    });
    rays
}

#[test]
fn of_a_stream_with_one_byte_in_a_hundred_damaged_checksums_let_nothing_wrong_through() {
    for (name, protocol) in [
        ("ouster", None),
        ("livox2", Some(NetworkProtocol::Livox2)),
        (
            "vlp16",
            Some(NetworkProtocol::Velodyne(
                &jink_lidar_driver::velodyne::VLP16_LASERS,
            )),
        ),
        ("livox1", Some(NetworkProtocol::Livox1)),
    ] {
        let new = || match protocol {
            Some(protocol) => Decoder::of(protocol, 10.0).unwrap(),
            None => {
                Decoder::ouster(Metadata::parse(&ouster_metadata(16, 512, "RNG19_RFL8_SIG16_NIR16")).unwrap())
            }
        };
        let packets = stream(name, 3_000);
        let (mut sound, mut decoder) = (new(), new());
        let mut random = Xoshiro256PlusPlus::seed_from_u64(11);
        let (mut wrong, mut right, mut damaged) = (0u64, 0u64, 0u64);
        for (index, packet) in packets.iter().enumerate() {
            let expected: BTreeSet<[i64; 3]> = rays_of(&mut sound, packet).into_iter().collect();
            let mut bytes = packet.clone();
            // The first packets show that the checksum is one. One of three is then damaged, in one byte of a hundred.
            if index > 40 && random.random_ratio(1, 3) {
                damaged += 1;
                for byte in &mut bytes {
                    if random.random_ratio(1, 100) {
                        *byte = random.random();
                    }
                }
            }
            if random.random_ratio(1, 20) {
                bytes.truncate(random.random_range(0..bytes.len()));
            }
            for ray in rays_of(&mut decoder, &bytes) {
                if expected.contains(&ray) {
                    right += 1;
                } else {
                    wrong += 1;
                }
            }
        }
        println!(
            "{name}: of {damaged} damaged packets of 3000 came {wrong} wrong points beside {right} right ones"
        );
        assert!(right > 100_000, "{name}: {right}");
        if matches!(name, "ouster" | "livox2") {
            assert_eq!(wrong, 0, "{name}");
        }
    }
}
