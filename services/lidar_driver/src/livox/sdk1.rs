//! Point data of Livox's first protocol: the Avia.
//!
//! Source: Livox SDK communication protocol V1.3.0, "Sample Data".
//!
//! | bytes | hold |
//! |---|---|
//! | 1, 1, 1, 1 | version 5, slot, number of the lidar, reserved |
//! | 4 | status |
//! | 1, 1 | kind of the time stamp: 3 is UTC, all others count nanoseconds; data type |
//! | 8 | time of the first point |
//! | n | points |
//!
//! | data type | points of a packet | bytes of a point | returns of a point |
//! |---|---|---|---|
//! | 0, 1 Cartesian, spherical | 100 | 13, 9 | 1 |
//! | 2, 3 the same with a tag | 96 | 14, 10 | 1 |
//! | 4, 5 two returns | 48 | 28, 16 | 2 |
//! | 6 inertial | 1 | 24 | - |
//! | 7, 8 three returns | 30 | 42, 22 | 3 |
//!
//! An Avia fires 240,000 pulses a second; point i is of laser i modulo 6. A point at the origin is no return, and so is
//! one whose tag calls it noise with high confidence.
//!
//! **What can be detected.** Point data carry neither a checksum nor a number: lengths, types and stamps that do not
//! fit are.

use super::{ScanSplitter, polar, spherical};
use crate::decode::{Decode, Echo, Fault, Item, OVERTAKEN_US, Ray, i32_at, u16_at, u32_at, u64_at};

/// Head of a packet (bytes).
pub const HEAD_BYTES: usize = 18;
const VERSION: u8 = 5;
/// Lasers of an Avia.
const LINES: u32 = 6;
/// Time between two pulses (ns).
const PULSE_NS: f64 = 1e9 / 240_000.0;
const UTC: u8 = 3;
const IMU_DATA: u8 = 6;
/// Noise with high confidence, in one of the two lower fields of a tag.
const NOISE: u8 = 1;
/// A stamp that steps ahead further than this (ns) belongs to another clock.
const STEP_NS: u64 = 1_000_000_000;

/// One data type.
#[derive(Clone, Copy, Debug)]
struct PointLayout {
    points: usize,
    bytes: usize,
    returns: u8,
    spherical: bool,
    tagged: bool,
}

fn layout(data_type: u8) -> Option<PointLayout> {
    let (points, bytes, returns) = match data_type {
        0 => (100, 13, 1),
        1 => (100, 9, 1),
        2 => (96, 14, 1),
        3 => (96, 10, 1),
        4 => (48, 28, 2),
        5 => (48, 16, 2),
        7 => (30, 42, 3),
        8 => (30, 22, 3),
        _ => return None,
    };
    Some(PointLayout {
        points,
        bytes,
        returns,
        spherical: matches!(data_type, 1 | 3 | 5 | 8),
        tagged: data_type >= 2,
    })
}

/// Decodes the packets of one sensor.
#[derive(Clone, Debug)]
pub struct Livox1 {
    cutter: ScanSplitter,
    last_ns: Option<u64>,
}

impl Livox1 {
    /// For `rate_hz` scans per second.
    pub fn new(rate_hz: f64) -> Self {
        Self {
            cutter: ScanSplitter::new(rate_hz),
            last_ns: None,
        }
    }

    /// Whether the packet follows the one before; counts what is missing between them.
    fn follow(&mut self, first_ns: u64, packet_ns: f64) -> Result<(), Fault> {
        let last_ns = self.last_ns.unwrap_or(first_ns.saturating_sub(packet_ns as u64));
        if first_ns == last_ns {
            return Err(Fault::Doubled);
        }
        if first_ns < last_ns && last_ns - first_ns < OVERTAKEN_US.unsigned_abs() * 1_000 {
            return Err(Fault::Late);
        }
        let step_ns = first_ns.saturating_sub(last_ns);
        if step_ns < STEP_NS {
            let missing = (step_ns as f64 / packet_ns).round() - 1.0;
            let missing = missing.clamp(0.0, 10_000.0) as u32;
            self.cutter.lost = self.cutter.lost.saturating_add(missing);
        }
        self.last_ns = Some(first_ns);
        Ok(())
    }
}

/// A stamp in nanoseconds. UTC counts year, month, day, hour, and the microseconds of the hour.
fn stamp_ns(bytes: &[u8]) -> u64 {
    let bits = u64_at(bytes, 10);
    if bytes[8] != UTC {
        return bits;
    }
    let [year, month, day, hour, ..] = bits.to_le_bytes().map(u64::from);
    let us = bits >> 32;
    // A clock that runs within the month is enough; a step at its end is a clock that was set.
    let hours = ((year * 12 + month) * 31 + day) * 24 + hour;
    (hours * 3_600_000_000 + us).saturating_mul(1_000)
}

/// Range (m), direction and tag of return `index` of the point at `at`.
fn answer(bytes: &[u8], layout: &PointLayout, at: usize, index: usize) -> (Option<(f32, [f32; 3])>, u8) {
    // Of two and three returns the spherical angles stand once, before them.
    let shared = if layout.spherical && layout.returns > 1 {
        4
    } else {
        0
    };
    let each = (layout.bytes - shared) / usize::from(layout.returns);
    let begin = at + shared + index * each;
    let tag = if layout.tagged { bytes[begin + each - 1] } else { 0 };
    let found = if layout.spherical {
        let range_m = u32_at(bytes, begin) as f32 * 1e-3;
        let angles_at = if shared > 0 { at } else { begin + 4 };
        let direction = spherical(u16_at(bytes, angles_at), u16_at(bytes, angles_at + 2));
        Some((range_m, direction)).filter(|_| range_m > 0.0)
    } else {
        polar([0, 4, 8].map(|part| i32_at(bytes, begin + part) as f32 * 1e-3))
    };
    (found, tag)
}

impl Decode for Livox1 {
    fn packet(&mut self, bytes: &[u8], sink: &mut dyn FnMut(Item)) -> Result<(), Fault> {
        if bytes.len() < HEAD_BYTES || bytes[0] != VERSION {
            return Err(Fault::Foreign);
        }
        if bytes[9] == IMU_DATA {
            return Err(Fault::Other);
        }
        let layout = layout(bytes[9]).ok_or(Fault::Foreign)?;
        if bytes.len() != HEAD_BYTES + layout.points * layout.bytes {
            return Err(Fault::Damaged);
        }
        let first_ns = stamp_ns(bytes);
        self.follow(first_ns, layout.points as f64 * PULSE_NS)?;
        self.cutter.packet(first_ns, sink);
        let at_ns = |index: usize| first_ns.saturating_add((index as f64 * PULSE_NS) as u64);
        sink(Item::Packet {
            first_ns,
            last_ns: at_ns(layout.points - 1),
        });
        for index in 0..layout.points {
            let number = self.cutter.points;
            self.cutter.points += 1;
            for echo in 0..layout.returns {
                let at = HEAD_BYTES + index * layout.bytes;
                let (found, tag) = answer(bytes, &layout, at, usize::from(echo));
                let noise = [tag, tag >> 2].iter().any(|field| field & 3 == NOISE);
                let Some((range_m, direction)) = found.filter(|_| !noise) else {
                    continue;
                };
                sink(Item::Ray(Ray {
                    row: (number % LINES) as u16,
                    column: number / LINES,
                    stamp_ns: at_ns(index),
                    range_m,
                    base_m: [0.0; 3],
                    direction,
                    echo: Echo {
                        index: echo,
                        count: layout.returns,
                    },
                }));
            }
        }
        Ok(())
    }

    fn restart(&mut self) {
        self.last_ns = None;
    }

    fn finish(&mut self, sink: &mut dyn FnMut(Item)) {
        self.cutter.finish(sink);
    }
}
