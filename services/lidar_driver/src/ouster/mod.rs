//! Ouster OS0, OS1, OS2: packets of every UDP profile, by the metadata of the sensor.
//!
//! Sources: Ouster's firmware user manual ("Lidar Data Packet Format", "Calculating XYZ Points from the Lidar Data")
//! and its hardware manuals; the vendor's SDK was read to compare, and decodes the recordings in the tests.
//!
//! | part | LEGACY | the others | FUSA |
//! |---|---|---|---|
//! | head | none | 32 bytes: type, frame id (16), serial number | 32 bytes: type, frame id (32), serial number |
//! | column | 16 bytes, pixels, 4 bytes of status | 12 bytes, pixels | 12 bytes, pixels |
//! | foot | none | 32 bytes, the last 8 a CRC-64 where the firmware has one | 32 bytes |
//!
//! **Position** of a range r in column m of row i, in the lidar frame, with the encoder's angle e = 2 pi (1 - m /
//! columns), the beam's azimuth a = -azimuth_i and altitude p, beams beginning at (b, 0, h) and n = |(b, h)|:
//!
//! x = (r - n) cos(e + a) cos(p) + b cos(e), y = (r - n) sin(e + a) cos(p) + b sin(e), z = (r - n) sin(p) + h
//!
//! and from there to the sensor frame with `lidar_to_sensor_transform`. The sensor frame is x away from the connector,
//! y left, z up.
//!
//! **What can be detected.** With the CRC-64 any damage. Without it (LEGACY, FUSA, firmware before 2.5): another
//! length, columns that do not follow each other, stamps that run backwards; a damaged range cannot be distinguished
//! from a sound one.

pub mod crc64;
pub mod http;
mod metadata;
mod profile;
pub mod request;

use crate::decode::{Decode, Echo, Fault, Item, Ray, u16_at, u32_at, u64_at};
use crc64::crc64;
pub use metadata::{Metadata, MetadataError};
pub use profile::{Header, PROFILES, Profile};

/// Head and foot of a packet that is not LEGACY (bytes).
const HEAD_BYTES: usize = 32;
const FOOT_BYTES: usize = 32;
/// Of an inertial packet of old profiles.
const IMU_BYTES: usize = 48;
/// Type of a lidar packet.
const LIDAR_PACKET: u16 = 1;
/// Other types of packets: inertial data, zones.
const OTHER_PACKETS: std::ops::RangeInclusive<u16> = 2..=4;
/// What stands in the place of the CRC in packets of firmware that computes none (seen in recordings of 2.2 and of
/// 2.3).
const NO_CRC: [u64; 2] = [0, 0xDEAD_BEEF_0000_C0DE];
/// Frames by which a sound stream may go ahead: whole frames may be lost.
const FRAMES_AHEAD: u32 = 3;
/// Frames by which a packet may be late.
const FRAMES_BEHIND: u32 = 2;
/// Longest time that the columns of one packet take (ns): at 5 Hz, 512 columns, 64 of them 25 ms.
const PACKET_NS: u64 = 50_000_000;

/// The constants of one row.
#[derive(Clone, Copy, Debug)]
struct Row {
    cos_cos: f32,
    cos_sin: f32,
    sin: f32,
}

/// The frame that is being received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct OusterFrame {
    id: u32,
    /// Columns that have come.
    columns: usize,
    /// All have come, or it was ended.
    ended: bool,
}

/// Decodes the packets of one sensor.
#[derive(Clone, Debug)]
pub struct Ouster {
    metadata: Metadata,
    rows: Vec<Row>,
    /// Cosine and sine of the encoder's angle of every column.
    encoder: Vec<[f32; 2]>,
    rotation: [f32; 9],
    translation_m: [f32; 3],
    beam_origin_m: [f32; 2],
    beam_distance_m: f32,
    packet_bytes: usize,
    column_bytes: usize,
    column_head_bytes: usize,
    frame: Option<OusterFrame>,
    /// Columns of the frame that have come, a bit for each.
    seen: Vec<u64>,
    /// A frame id that follows none; true if the next packet has it, too.
    jumped_to: Option<u32>,
}

impl Ouster {
    /// For the sensor that `metadata` describe.
    pub fn new(metadata: Metadata) -> Self {
        let rows =
            metadata
                .altitude_deg
                .iter()
                .zip(&metadata.azimuth_deg)
                .map(|(altitude_deg, azimuth_deg)| {
                    let (sin, cos) = altitude_deg.to_radians().sin_cos();
                    let (azimuth_sin, azimuth_cos) = (-azimuth_deg).to_radians().sin_cos();
                    Row {
                        cos_cos: (cos * azimuth_cos) as f32,
                        cos_sin: (cos * azimuth_sin) as f32,
                        sin: sin as f32,
                    }
                });
        let encoder = (0..metadata.columns).map(|column| {
            let angle = std::f64::consts::TAU * (1.0 - column as f64 / metadata.columns as f64);
            [angle.cos() as f32, angle.sin() as f32]
        });
        let matrix = metadata.sensor_t_lidar_mm;
        let [along_mm, up_mm] = metadata.beam_origin_mm;
        let legacy = metadata.header == Header::Legacy;
        let column_head_bytes = if legacy { 16 } else { 12 };
        let column_foot_bytes = if legacy { 4 } else { 0 };
        let column_bytes =
            column_head_bytes + metadata.rows * metadata.profile.pixel_bytes + column_foot_bytes;
        let frame_bytes = if legacy { 0 } else { HEAD_BYTES + FOOT_BYTES };
        Self {
            rows: rows.collect(),
            encoder: encoder.collect(),
            rotation: [0, 1, 2, 4, 5, 6, 8, 9, 10].map(|index: usize| matrix[index] as f32),
            translation_m: [3, 7, 11].map(|index: usize| (matrix[index] * 1e-3) as f32),
            beam_origin_m: [(along_mm * 1e-3) as f32, (up_mm * 1e-3) as f32],
            beam_distance_m: (along_mm
                .hypot(up_mm)
                .copysign(if up_mm == 0.0 { along_mm } else { 1.0 })
                * 1e-3) as f32,
            packet_bytes: frame_bytes + metadata.columns_per_packet * column_bytes,
            column_bytes,
            column_head_bytes,
            frame: None,
            seen: vec![0; metadata.columns.div_ceil(64)],
            jumped_to: None,
            metadata,
        }
    }

    /// What it decodes by.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Length of a packet (bytes).
    pub fn packet_bytes(&self) -> usize {
        self.packet_bytes
    }

    fn column<'a>(&self, bytes: &'a [u8], index: usize) -> &'a [u8] {
        let head = if self.metadata.header == Header::Legacy {
            0
        } else {
            HEAD_BYTES
        };
        let at = head + index * self.column_bytes;
        bytes.get(at..at + self.column_bytes).unwrap_or_default()
    }

    fn is_valid(&self, column: &[u8]) -> bool {
        let status = match self.metadata.header {
            Header::Legacy => u32_at(column, self.column_bytes - 4),
            Header::Standard | Header::Fusa => u32::from(u16_at(column, 10)),
        };
        status & 1 == 1
    }

    /// Frame id of a packet of the right kind, sound as far as can be checked.
    fn check(&self, bytes: &[u8]) -> Result<u32, Fault> {
        let header = self.metadata.header;
        if bytes.len() != self.packet_bytes {
            let other = bytes.len() == IMU_BYTES
                || header != Header::Legacy
                    && OTHER_PACKETS.contains(&u16_at(bytes, 0))
                    && bytes.len() > HEAD_BYTES;
            return Err(if other { Fault::Other } else { Fault::Foreign });
        }
        let (kind, serial, frame_id) = match header {
            Header::Legacy => (LIDAR_PACKET, 0, u32::from(u16_at(bytes, 10))),
            Header::Standard => (
                u16_at(bytes, 0),
                u64_at(bytes, 7) & 0xFF_FFFF_FFFF,
                u32::from(u16_at(bytes, 2)),
            ),
            Header::Fusa => (
                u16::from(bytes[0]),
                u64_at(bytes, 11) & 0xFF_FFFF_FFFF,
                u32_at(bytes, 4),
            ),
        };
        if header == Header::Standard {
            let (body, foot) = bytes.split_at(bytes.len() - 8);
            let said = u64_at(foot, 0);
            if !NO_CRC.contains(&said) && said != crc64(body) {
                return Err(Fault::Damaged);
            }
        }
        if OTHER_PACKETS.contains(&kind) {
            return Err(Fault::Other);
        }
        let known = self.metadata.serial;
        if kind != LIDAR_PACKET || (known != 0 && serial != 0 && serial != known) {
            return Err(Fault::Foreign);
        }
        self.check_columns(bytes)?;
        Ok(frame_id)
    }

    /// Columns of a packet follow each other, and so do their stamps.
    fn check_columns(&self, bytes: &[u8]) -> Result<(), Fault> {
        let mut before: Option<(usize, u64, u16)> = None;
        for index in 0..self.metadata.columns_per_packet {
            let column = self.column(bytes, index);
            if !self.is_valid(column) {
                continue;
            }
            let (stamp_ns, id) = (u64_at(column, 0), usize::from(u16_at(column, 8)));
            // In every column of LEGACY, elsewhere in none.
            let frame_id = if self.metadata.header == Header::Legacy {
                u16_at(column, 10)
            } else {
                0
            };
            let follows = before.is_none_or(|(first, last_ns, of_frame)| {
                id == first + index
                    && (last_ns..=last_ns.saturating_add(PACKET_NS)).contains(&stamp_ns)
                    && frame_id == of_frame
            });
            if id >= self.metadata.columns || !follows || id < index {
                return Err(Fault::Damaged);
            }
            before = Some((id - index, stamp_ns, frame_id));
        }
        Ok(())
    }

    /// Makes the packet's frame the present one, and ends the one before it.
    fn enter(&mut self, id: u32, sink: &mut dyn FnMut(Item)) -> Result<(), Fault> {
        let wraps = if self.metadata.header == Header::Fusa {
            u32::MAX
        } else {
            u32::from(u16::MAX)
        };
        let Some(frame) = self.frame else {
            self.begin(id);
            return Ok(());
        };
        let ahead = id.wrapping_sub(frame.id) & wraps;
        let behind = frame.id.wrapping_sub(id) & wraps;
        let follows = (1..=FRAMES_AHEAD).contains(&ahead) || self.jumped_to == Some(id);
        if ahead == 0 {
            self.jumped_to = None;
            return Ok(());
        }
        if !follows {
            if behind <= FRAMES_BEHIND {
                return Err(Fault::Late);
            }
            // A damaged id, or a sensor that has restarted: then the next packet has the same id.
            self.jumped_to = Some(id);
            return Err(Fault::Damaged);
        }
        self.finish(sink);
        self.begin(id);
        Ok(())
    }

    fn begin(&mut self, id: u32) {
        self.frame = Some(OusterFrame {
            id,
            columns: 0,
            ended: false,
        });
        self.seen.fill(0);
        self.jumped_to = None;
    }

    fn is_seen(&self, column: usize) -> bool {
        self.seen
            .get(column / 64)
            .is_some_and(|word| word >> (column % 64) & 1 == 1)
    }

    /// The ray of one range, before its range is known: base and direction in the sensor frame.
    fn ray(&self, row: &Row, [cos, sin]: [f32; 2]) -> ([f32; 3], [f32; 3]) {
        let direction = [
            cos * row.cos_cos - sin * row.cos_sin,
            sin * row.cos_cos + cos * row.cos_sin,
            row.sin,
        ];
        let [along_m, up_m] = self.beam_origin_m;
        let origin = [along_m * cos, along_m * sin, up_m];
        let base = [0, 1, 2].map(|axis: usize| origin[axis] - self.beam_distance_m * direction[axis]);
        let turned = |v: [f32; 3]| {
            let r = &self.rotation;
            [0, 3, 6].map(|at: usize| r[at] * v[0] + r[at + 1] * v[1] + r[at + 2] * v[2])
        };
        let base = turned(base);
        let base = [0, 1, 2].map(|axis: usize| base[axis] + self.translation_m[axis]);
        (base, turned(direction))
    }

    fn pass_on(&mut self, column: &[u8], sink: &mut dyn FnMut(Item)) {
        let (stamp_ns, id) = (u64_at(column, 0), usize::from(u16_at(column, 8)));
        let profile = self.metadata.profile;
        let mask = (1u32 << profile.bits) - 1;
        let encoder = self.encoder[id];
        for (index, row) in self.rows.iter().enumerate() {
            let pixel = self.column_head_bytes + index * profile.pixel_bytes;
            let (base_m, direction) = self.ray(row, encoder);
            for (echo, at) in profile
                .range_at
                .iter()
                .take(usize::from(profile.returns))
                .enumerate()
            {
                let range = u32_at(column, pixel + at) & mask;
                sink(Item::Ray(Ray {
                    row: index as u16,
                    column: id as u32,
                    stamp_ns,
                    range_m: (range * profile.unit_mm) as f32 * 1e-3,
                    base_m,
                    direction,
                    echo: Echo {
                        index: echo as u8,
                        count: profile.returns,
                    },
                }));
            }
        }
    }
}

impl Decode for Ouster {
    fn packet(&mut self, bytes: &[u8], sink: &mut dyn FnMut(Item)) -> Result<(), Fault> {
        let id = self.check(bytes)?;
        self.enter(id, sink)?;
        let (mut fresh, mut valid) = (0, 0);
        let (mut first_ns, mut last_ns) = (0, 0);
        for index in 0..self.metadata.columns_per_packet {
            let column = self.column(bytes, index);
            if self.is_valid(column) {
                let stamp_ns = u64_at(column, 0);
                if valid == 0 {
                    first_ns = stamp_ns;
                }
                last_ns = stamp_ns;
                valid += 1;
                fresh += u32::from(!self.is_seen(usize::from(u16_at(column, 8))));
            }
        }
        if valid == 0 {
            return Ok(());
        }
        if fresh == 0 {
            return Err(Fault::Doubled);
        }
        if self.frame.is_some_and(|frame| frame.ended) {
            return Err(Fault::Late);
        }
        sink(Item::Packet { first_ns, last_ns });
        for index in 0..self.metadata.columns_per_packet {
            let column = self.column(bytes, index);
            let id = usize::from(u16_at(column, 8));
            if !self.is_valid(column) || self.is_seen(id) {
                continue;
            }
            self.seen[id / 64] |= 1 << (id % 64);
            if let Some(frame) = &mut self.frame {
                frame.columns += usize::from(self.metadata.sends(id));
            }
            self.pass_on(column, sink);
        }
        // A frame that is whole need not wait for the next one.
        if self
            .frame
            .is_some_and(|frame| frame.columns >= self.metadata.columns_sent())
        {
            self.finish(sink);
        }
        Ok(())
    }

    fn restart(&mut self) {
        self.frame = None;
        self.jumped_to = None;
    }

    fn finish(&mut self, sink: &mut dyn FnMut(Item)) {
        let sent = self.metadata.columns_sent();
        let per_packet = self.metadata.columns_per_packet;
        if let Some(frame) = self.frame.as_mut().filter(|frame| !frame.ended) {
            frame.ended = true;
            let lost = sent.saturating_sub(frame.columns) / per_packet;
            sink(Item::ScanEnds { lost: lost as u32 });
        }
    }
}
