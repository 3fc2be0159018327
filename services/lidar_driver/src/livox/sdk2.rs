//! Point data of Livox's second protocol: the Mid-360.
//!
//! Source: Livox LiDAR communication protocol of the Mid-360, "Point Cloud & IMU Data Protocol".
//!
//! | bytes | hold |
//! |---|---|
//! | 1, 2 | version 0, length of the packet |
//! | 2, 2 | time that its points take (0.1 us), number of points |
//! | 2, 1 | number of the packet, number of the frame |
//! | 1, 1 | data type: 0 inertial, 1 Cartesian in mm, 2 Cartesian in cm, 3 spherical; kind of the time stamp |
//! | 12, 4 | reserved; CRC-32 of what follows |
//! | 8 | time of the first point (ns) |
//! | n | points: 14, 8 or 10 bytes, reflectivity and tag at their ends |
//!
//! The points of a packet are evenly spread over its time. Point i is of laser i modulo 4. A point at the origin is no
//! return, and so is one whose tag gives it the lowest confidence of being a thing at all (rain, fog, dust, or between
//! two edges).
//!
//! **What can be detected.** Any damage behind the head where the firmware fills in the CRC; a packet whose CRC is zero
//! is accepted.

use super::crc::SDK2_CRC32;
use super::{ScanSplitter, polar, spherical};
use crate::decode::{Decode, Echo, Fault, Item, Ray, i16_at, i32_at, u16_at, u32_at, u64_at};

/// Head of a packet (bytes), and where its parts begin.
pub const HEAD_BYTES: usize = 36;
const CRC_AT: usize = 24;
const STAMP_AT: usize = 28;
/// Lasers of a Mid-360.
const LINES: u32 = 4;
/// Most points of a packet: a datagram of Ethernet.
const POINTS: usize = 128;
/// Packets in a row whose CRC must agree before one that does not counts as damaged: a firmware that computes it
/// otherwise is believed rather than refused.
const AGREEING: u32 = 16;
/// Lowest confidence in one of the three fields of a tag.
const LOW_CONFIDENCE: u8 = 2;

/// Decodes the packets of one sensor.
#[derive(Clone, Debug)]
pub struct Livox2 {
    cutter: ScanSplitter,
    /// Number of the next packet.
    next: Option<u16>,
    agreed: u32,
}

impl Livox2 {
    /// For `rate_hz` scans per second.
    pub fn new(rate_hz: f64) -> Self {
        Self {
            cutter: ScanSplitter::new(rate_hz),
            next: None,
            agreed: 0,
        }
    }

    /// Bytes of a point of this data type.
    fn point_bytes(data_type: u8) -> Option<usize> {
        match data_type {
            1 => Some(14),
            2 => Some(8),
            3 => Some(10),
            _ => None,
        }
    }

    fn check(&mut self, bytes: &[u8]) -> Result<(usize, usize), Fault> {
        if bytes.len() < HEAD_BYTES || bytes[0] != 0 || usize::from(u16_at(bytes, 1)) != bytes.len() {
            return Err(Fault::Foreign);
        }
        if bytes[10] == 0 {
            return Err(Fault::Other);
        }
        let points = usize::from(u16_at(bytes, 5));
        let point_bytes = Self::point_bytes(bytes[10]).ok_or(Fault::Foreign)?;
        if points == 0 || points > POINTS || bytes.len() != HEAD_BYTES + points * point_bytes {
            return Err(Fault::Damaged);
        }
        let said = u32_at(bytes, CRC_AT);
        if said != 0 {
            if said == SDK2_CRC32.checksum(&bytes[STAMP_AT..]) {
                self.agreed = self.agreed.saturating_add(1);
            } else if self.agreed >= AGREEING {
                return Err(Fault::Damaged);
            } else {
                self.agreed = 0;
            }
        }
        Ok((points, point_bytes))
    }

    /// Whether the packet is the next one; counts what is missing before it.
    fn follow(&mut self, number: u16) -> Result<(), Fault> {
        let next = self.next.unwrap_or(number);
        let ahead = number.wrapping_sub(next);
        match ahead {
            0..=0x7FFF => {
                self.cutter.lost = self.cutter.lost.saturating_add(u32::from(ahead));
                self.next = Some(number.wrapping_add(1));
                Ok(())
            }
            u16::MAX => Err(Fault::Doubled),
            // Hundreds behind: the sensor has started anew.
            0x8000..=0xFE00 => {
                self.next = Some(number.wrapping_add(1));
                Ok(())
            }
            _ => Err(Fault::Late),
        }
    }
}

fn is_noise(tag: u8) -> bool {
    [tag, tag >> 2, tag >> 4]
        .iter()
        .any(|field| field & 3 == LOW_CONFIDENCE)
}

/// Range (m) and direction of the point at `at`.
fn point(bytes: &[u8], data_type: u8, at: usize) -> Option<(f32, [f32; 3])> {
    match data_type {
        1 => polar([0, 4, 8].map(|part| i32_at(bytes, at + part) as f32 * 1e-3)),
        2 => polar([0, 2, 4].map(|part| f32::from(i16_at(bytes, at + part)) * 1e-2)),
        _ => {
            let range_m = u32_at(bytes, at) as f32 * 1e-3;
            Some((range_m, spherical(u16_at(bytes, at + 4), u16_at(bytes, at + 6)))).filter(|_| range_m > 0.0)
        }
    }
}

impl Decode for Livox2 {
    fn packet(&mut self, bytes: &[u8], sink: &mut dyn FnMut(Item)) -> Result<(), Fault> {
        let (points, point_bytes) = self.check(bytes)?;
        self.follow(u16_at(bytes, 7))?;
        let first_ns = u64_at(bytes, STAMP_AT);
        let spacing_ns = f64::from(u16_at(bytes, 3)) * 100.0 / points as f64;
        self.cutter.packet(first_ns, sink);
        let stamp_ns = |index: usize| first_ns.saturating_add((index as f64 * spacing_ns) as u64);
        sink(Item::Packet {
            first_ns,
            last_ns: stamp_ns(points - 1),
        });
        for index in 0..points {
            let at = HEAD_BYTES + index * point_bytes;
            let number = self.cutter.points;
            self.cutter.points += 1;
            let tag = bytes[at + point_bytes - 1];
            let Some((range_m, direction)) = point(bytes, bytes[10], at).filter(|_| !is_noise(tag)) else {
                continue;
            };
            sink(Item::Ray(Ray {
                row: (number % LINES) as u16,
                column: number / LINES,
                stamp_ns: stamp_ns(index),
                range_m,
                base_m: [0.0; 3],
                direction,
                echo: Echo::ONLY,
            }));
        }
        Ok(())
    }

    fn restart(&mut self) {
        self.next = None;
    }

    fn finish(&mut self, sink: &mut dyn FnMut(Item)) {
        self.cutter.finish(sink);
    }
}
