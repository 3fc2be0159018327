//! What the messages of a scenario say of a bin: evaluated from the messages alone, by intervals of angles, without
//! our ring.
//!
//! | message | touches a bin if |
//! |---|---|
//! | rangefinder | its opening angle, edges included, has an angle in common with the bin: PX4's rule |
//! | row | the element and the bin overlap by more than an edge, around the circle |

use super::replay::{AcceptedMessage, Content};
use jink_shared_types::Timestamp;
use jink_shared_types::beams::{BeamReading, ObstacleDistance};
use jink_shared_types::ranges::ScanFrame;
use jink_testkit::vectors::BINS;
use nalgebra::{UnitQuaternion, Vector3};

/// How long a message counts (s).
const KEPT_S: f64 = 0.5;
/// Width of a bin (deg).
const BIN_DEG: f64 = 5.0;
/// Elements overlap a bin that they share more than this with (deg): rounding.
const EDGE_DEG: f64 = 1e-3;

/// The reading of one message for one bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SectorReading {
    /// Nothing.
    Silent,
    /// No obstacle within this (cm).
    Clear(f64),
    /// An obstacle (cm).
    Hit(f64),
}

/// A message with its readings.
#[derive(Clone, Debug)]
pub struct ReceivedMessage {
    /// Whose it is.
    pub layer: usize,
    /// When it was sent.
    pub at: Timestamp,
    /// Heading when it was taken (rad).
    pub yaw_rad: f64,
    /// Per bin, from that heading.
    pub readings: [SectorReading; BINS],
    /// The same as PX4 reads it, the side of the seam and the last element of a row aside.
    pub px4: [SectorReading; BINS],
    /// It, if it is a row.
    pub row: Option<ObstacleDistance>,
}

impl ReceivedMessage {
    /// The readings of an accepted message.
    pub fn of(accepted: &AcceptedMessage) -> Self {
        let (_, _, yaw_rad) = accepted.attitude.euler_angles();
        let ([ours, px4], row) = match &accepted.message.content {
            Content::Beam(reading) => (beam(reading, &accepted.attitude), None),
            Content::Row { row, .. } => ([of_row(row, yaw_rad); 2], Some(*row)),
        };
        Self {
            layer: accepted.message.layer,
            at: accepted.message.at,
            yaw_rad,
            readings: if accepted.is_taken {
                ours
            } else {
                [SectorReading::Silent; BINS]
            },
            px4,
            row,
        }
    }

    /// Whether it is a row with an element that reads so.
    pub fn has_element(&self, reading_of: SectorReading) -> bool {
        self.row.is_some_and(|row| {
            row.distances_cm.map(f64::from).iter().any(|cm| match reading_of {
                SectorReading::Silent => false,
                SectorReading::Hit(px4) => (cm - px4).abs() < 0.5,
                SectorReading::Clear(px4) => (cm - px4).abs() < 0.5 || *cm > f64::from(row.max_cm),
            })
        })
    }

    /// Whether it counts at `now`.
    pub fn is_live(&self, now: Timestamp) -> bool {
        now.seconds_since(self.at) <= KEPT_S
    }

    /// Whether PX4 reads something in it that is none.
    pub fn is_refused(&self) -> bool {
        let is_silent = |readings: &[SectorReading; BINS]| {
            readings
                .iter()
                .all(|reading_of| *reading_of == SectorReading::Silent)
        };
        is_silent(&self.readings) && !is_silent(&self.px4)
    }

    /// Its reading of the bin around `bin` from the heading `yaw_rad`.
    pub fn reading_of(&self, bin: usize, yaw_rad: f64) -> SectorReading {
        self.readings[self.turned(bin, yaw_rad)]
    }

    /// The bin from its own heading that holds the centre of `bin` from `yaw_rad`.
    pub fn turned(&self, bin: usize, yaw_rad: f64) -> usize {
        let turn = (yaw_rad - self.yaw_rad).to_degrees() / BIN_DEG;
        ((bin as f64 + turn).round().rem_euclid(BINS as f64) as usize) % BINS
    }

    /// Whether its bins are those of the heading `yaw_rad`.
    pub fn is_unturned(&self, yaw_rad: f64) -> bool {
        let turn = (yaw_rad - self.yaw_rad).sin().abs();
        turn < 1e-9 && (yaw_rad - self.yaw_rad).cos() > 0.0
    }
}

fn of_row(row: &ObstacleDistance, yaw_rad: f64) -> [SectorReading; BINS] {
    let mut readings = [SectorReading::Silent; BINS];
    let increment = f64::from(row.increment_deg);
    if !(increment > 0.0 && increment <= 360.0) {
        return readings;
    }
    let elements = ((360.0 / increment + 1e-4) as usize).min(BINS);
    let north = if row.frame == ScanFrame::North {
        yaw_rad.to_degrees()
    } else {
        0.0
    };
    for (element, distance) in row.distances_cm[..elements].iter().enumerate() {
        if *distance == u16::MAX {
            continue;
        }
        let reading_of = if *distance > row.max_cm {
            SectorReading::Clear(f64::from(row.max_cm) + 1.0)
        } else {
            SectorReading::Hit(f64::from(*distance))
        };
        let centre = f64::from(row.offset_deg) - north + element as f64 * increment;
        for (bin, slot) in readings.iter_mut().enumerate() {
            let apart = (bin as f64 * BIN_DEG - centre).rem_euclid(360.0);
            let apart = apart.min(360.0 - apart);
            if apart < 0.5 * (increment + BIN_DEG) - EDGE_DEG {
                *slot = nearer(*slot, reading_of);
            }
        }
    }
    readings
}

fn beam(reading: &BeamReading, attitude: &UnitQuaternion<f64>) -> [[SectorReading; BINS]; 2] {
    let reach_cm = 100.0 * f64::from(reading.range_max_m);
    let range_cm = 100.0 * f64::from(reading.range_m);
    let is_nothing = reading.range_m == -1.0 && reading.quality == 0;
    let is_clear = is_nothing || reading.range_m >= reading.range_max_m;
    let flat = |v: &Vector3<f64>| (attitude * v).xy().norm();
    let level = |yaw_deg: f64| {
        let (y, x) = yaw_deg.to_radians().sin_cos();
        Vector3::new(x, y, 0.0)
    };
    let ours = match axis(reading.orientation, reading.quaternion) {
        Some(axis) if is_clear || reading.range_m >= 0.0 => {
            let yaw_deg = axis.y.atan2(axis.x).to_degrees();
            let share = flat(&level(yaw_deg)).min(flat(&axis));
            let reading_of = if is_clear {
                SectorReading::Clear(reach_cm * share)
            } else {
                SectorReading::Hit(range_cm * share)
            };
            touched(yaw_deg, reading.opening_rad, reading_of)
        }
        _ => [SectorReading::Silent; BINS],
    };
    let yaw_deg = yaw_of_px4_deg(reading.orientation, reading.quaternion);
    let px4 = if is_clear || reading.range_m.is_nan() {
        touched(yaw_deg, reading.opening_rad, SectorReading::Clear(reach_cm))
    } else if reading.range_m > reading.range_min_m {
        let reading_of = SectorReading::Hit(range_cm * flat(&level(yaw_deg)));
        touched(yaw_deg, reading.opening_rad, reading_of)
    } else {
        [SectorReading::Silent; BINS]
    };
    [ours, px4]
}

/// `word` in every bin that has an angle in common with an opening around `yaw_deg`.
fn touched(yaw_deg: f64, opening_rad: f32, reading_of: SectorReading) -> [SectorReading; BINS] {
    let mut readings = [SectorReading::Silent; BINS];
    if !opening_rad.is_finite() || !yaw_deg.is_finite() {
        return readings;
    }
    let half = 0.5 * f64::from(opening_rad).to_degrees().clamp(0.0, 360.0);
    let centre = yaw_deg.rem_euclid(360.0);
    let (first, last) = (
        ((centre - half) / BIN_DEG).round() as i64,
        ((centre + half) / BIN_DEG).round() as i64,
    );
    for bin in first..=last {
        readings[bin.rem_euclid(BINS as i64) as usize] = reading_of;
    }
    readings
}

/// The axis of a rangefinder in the body; `None` if it is not known or looks up or down.
fn axis(code: u8, q: [f32; 4]) -> Option<Vector3<f64>> {
    let level = |yaw_deg: u32| {
        let (y, x) = f64::from(yaw_deg).to_radians().sin_cos();
        Vector3::new(x, y, 0.0)
    };
    let axis = match code {
        // Yaw, then the same with the sensor rolled by 180, 90 and 270 degrees.
        0..=15 => level(45 * (u32::from(code) % 8)),
        16..=23 => level(45 * (u32::from(code) % 4)),
        // Pitched by 180 degrees: it looks back from where its yaw points.
        26 | 36 => level(270),
        27 => level(90),
        31 | 32 => level(180),
        37 => level(270),
        // Pitched by 315 degrees: down by 45.
        39 | 40 => Vector3::new(0.5f64.sqrt(), 0.0, 0.5f64.sqrt()),
        100 => {
            let [w, x, y, z] = q.map(f64::from);
            let q = nalgebra::Quaternion::new(w, x, y, z);
            let is_rotation = (q.norm() - 1.0).abs() < 0.1;
            is_rotation.then(|| UnitQuaternion::from_quaternion(q) * Vector3::x())?
        }
        _ => return None,
    };
    (axis.xy().norm() >= 0.5).then_some(axis)
}

/// The yaw of a rangefinder as PX4 takes it (deg): what it does not know is forward.
fn yaw_of_px4_deg(code: u8, q: [f32; 4]) -> f64 {
    match code {
        0..=7 => 45.0 * f64::from(code),
        100 => {
            let [w, x, y, z] = q.map(f64::from);
            f64::atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)).to_degrees()
        }
        _ => 0.0,
    }
}

fn nearer(a: SectorReading, b: SectorReading) -> SectorReading {
    match (a, b) {
        (SectorReading::Silent, reading_of) | (reading_of, SectorReading::Silent) => reading_of,
        (SectorReading::Hit(a), SectorReading::Hit(b)) => SectorReading::Hit(a.min(b)),
        (SectorReading::Hit(a), SectorReading::Clear(_))
        | (SectorReading::Clear(_), SectorReading::Hit(a)) => SectorReading::Hit(a),
        (SectorReading::Clear(a), SectorReading::Clear(b)) => SectorReading::Clear(a.max(b)),
    }
}

/// The reading of all received messages for `bin` from the heading `yaw_rad`: of each source its newest that is not
/// silent, of all sources the nearest.
pub fn fused(received: &[ReceivedMessage], now: Timestamp, bin: usize, yaw_rad: f64) -> SectorReading {
    let mut fused = SectorReading::Silent;
    for layer in 0..=10 {
        let newest = received
            .iter()
            .filter(|received| received.layer == layer && received.is_live(now))
            .filter(|received| received.reading_of(bin, yaw_rad) != SectorReading::Silent)
            .max_by_key(|received| received.at);
        fused = nearer(
            fused,
            newest.map_or(SectorReading::Silent, |received| {
                received.reading_of(bin, yaw_rad)
            }),
        );
    }
    fused
}
