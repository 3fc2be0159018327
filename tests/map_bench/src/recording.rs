//! Clouds of a real Ouster out of a recording, as its driver makes them; the sensor is taken to rest.

use crate::clouds::{Series, Shot, taken};
use crate::flight::{Motion, at};
use jink_lidar_driver::capture::Capture;
use jink_lidar_driver::config::{CloudSpec, NoReturn, Returns};
use jink_lidar_driver::decode::{Decode, Item};
use jink_lidar_driver::ouster::Metadata;
use jink_lidar_driver::{CloudAssembler, Decoder};
use jink_shared_types::Timestamp;
use jink_shared_types::frames::{Mounting, Point};
use nalgebra::Vector3;
use std::path::Path;

/// Range of an OS1 that is looked at (m).
const RANGE_M: [f32; 2] = [0.3, 90.0];
/// Height of the sensor (m), which no recording says.
const HEIGHT_M: f64 = 2.0;

/// The scans of the recording `pcap` of the sensor that `metadata` describes.
///
/// # Errors
/// A sentence naming the file and what is wrong with it.
pub fn series(pcap: &Path, metadata: &Path) -> Result<Series, String> {
    let text =
        std::fs::read_to_string(metadata).map_err(|error| format!("{}: {error}", metadata.display()))?;
    let metadata = Metadata::parse(&text).map_err(|error| format!("{}: {error}", metadata.display()))?;
    let mut decoder = Decoder::ouster(metadata);
    let spec = CloudSpec {
        position: Point::ZERO,
        mounting: Mounting::default(),
        range_min_m: RANGE_M[0],
        range_max_m: RANGE_M[1],
        sigma_m: 0.015,
        no_return: NoReturn::Unknown,
        returns: Returns::Nearest,
        strongest: 0,
        blind: Vec::new(),
    };
    let mut assembler = CloudAssembler::new(spec, decoder.directions());
    let mut capture = Capture::open(pcap).map_err(|error| error.to_string())?;
    let mut shots: Vec<Shot> = Vec::new();
    let mut first_ns = None;
    let mut take = |item: Item| match item {
        Item::ScanEnds { .. } => {
            if !assembler.is_empty() {
                shots.push(taken(&mut assembler));
            }
        }
        Item::Packet {
            first_ns: from,
            last_ns,
        } => {
            let first_ns = *first_ns.get_or_insert(from);
            assembler.packet(since(from, first_ns), since(last_ns, first_ns));
        }
        Item::Ray(ray) => assembler.ray(since(ray.stamp_ns, first_ns.unwrap_or(ray.stamp_ns)), &ray),
    };
    while let Some(datagram) = capture.next_datagram().map_err(|error| error.to_string())? {
        // What is no packet of this sensor is passed over, as by the driver.
        let _passed_over = decoder.packet(datagram.payload, &mut take);
    }
    decoder.finish(&mut take);
    if shots.is_empty() {
        return Err(format!(
            "{}: no packet is of the sensor that the metadata describe",
            pcap.display()
        ));
    }
    let seconds = shots
        .last()
        .map_or(0.0, |shot| shot.header.capture.seconds_since(at(0.0)));
    let motion = Motion::Rest(Vector3::new(0.0, 0.0, -HEIGHT_M));
    Ok(Series {
        name: "recording".to_owned(),
        track: motion.track(seconds),
        motion,
        clouds_per_scan: 1,
        shots,
    })
}

/// The stamp `ns` of a sensor whose first one was `first_ns`, on the clock of the flight; 50 ms after its start, because points may
/// come before the first packet.
fn since(ns: u64, first_ns: u64) -> Timestamp {
    at(0.05 + (ns as f64 - first_ns as f64) * 1e-9)
}
