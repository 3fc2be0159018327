//! Detects repeated data.

use crate::poses::Pose;
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{PointCloud, RangeScan, RayKind};
use nalgebra::Vector3;

/// Points of a cloud that are compared.
const POINTS: usize = 512;
/// Hits that a frame of many rays needs to be distinguished from another one: one or two may well repeat.
const HITS_MIN: u32 = 12;
/// A vehicle that has moved by so much (m, rad) sees other ranges: noise alone changes the last bits of a dozen.
const MOVED: (f64, f64) = (0.1, 0.03);
/// A single beam has a coarse resolution: it must have come nearer or gone farther by so much (m).
const MOVED_BEAM_M: f64 = 0.5;
/// Repetitions after which a sensor is stuck while the vehicle moves ...
const MOVING: u32 = 3;
/// ... and while it stands: so many, over so long (s). Coarse resolution without noise may repeat a frame now and then.
const STANDING: (u32, f64) = (25, 2.5);
/// Frames with the same time after which a sensor is stuck.
const SAME_TIME: u32 = 5;
/// Different frames after which it is no longer stuck.
const DIFFERENT: u32 = 10;
/// Offset basis and prime of FNV-1a, 64 bits.
const HASH: [u64; 2] = [0xcbf2_9ce4_8422_2325, 0x0000_0100_0000_01b3];

/// A fingerprint of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FrameFingerprint {
    hash: u64,
    hits: u32,
    /// The direction of a single beam (body).
    beam: Option<Vector3<f64>>,
}

impl FrameFingerprint {
    /// Of a part of the points, the same ones in each cloud of as many.
    pub fn of_cloud(cloud: &PointCloud) -> Self {
        let points = cloud.points();
        let step = points.len().div_ceil(POINTS).max(1);
        let (mut hash, mut hits) = (HASH[0] ^ points.len() as u64, 0);
        for point in points.iter().step_by(step) {
            let kind = point.kind.get();
            hits += u32::from(kind == RayKind::Hit);
            for bits in [point.forward_m, point.right_m, point.down_m].map(f32::to_bits) {
                hash = (hash ^ u64::from(bits)).wrapping_mul(HASH[1]);
            }
            hash = (hash ^ kind as u64).wrapping_mul(HASH[1]);
        }
        Self {
            hash,
            hits,
            beam: None,
        }
    }

    /// Of all beams.
    pub fn of_scan(scan: &RangeScan) -> Self {
        let ranges = scan.ranges();
        let hits = ranges.iter().filter(|range_m| range_m.is_finite()).count();
        let first = HASH[0] ^ u64::from(scan.angle_first_rad.to_bits());
        let mix = |hash: u64, range_m: &f32| (hash ^ u64::from(range_m.to_bits())).wrapping_mul(HASH[1]);
        Self {
            hash: ranges.iter().fold(first, mix),
            hits: u32::try_from(hits).unwrap_or(u32::MAX),
            beam: (scan.beams <= 1).then(|| axis(scan)).flatten(),
        }
    }

    fn is_distinctive(&self) -> bool {
        self.hits >= if self.beam.is_some() { 1 } else { HITS_MIN }
    }
}

/// One sensor.
#[derive(Default)]
pub(super) struct RepeatCheck {
    last: Option<FrameFingerprint>,
    /// When the first of equal frames was captured, and where the vehicle was.
    first: Timestamp,
    first_pose: Option<Pose>,
    repeated: u32,
    same_time: u32,
    different: u32,
    is_stuck: bool,
}

impl RepeatCheck {
    /// Takes a frame; `false` if it repeats the one before although the vehicle has moved.
    pub fn accepts(&mut self, fingerprint: FrameFingerprint, capture: Timestamp, pose: Option<Pose>) -> bool {
        self.same_time = 0;
        if self.last != Some(fingerprint) || !fingerprint.is_distinctive() {
            self.last = Some(fingerprint);
            (self.first, self.first_pose, self.repeated) = (capture, pose, 0);
            self.different += 1;
            self.is_stuck &= self.different < DIFFERENT;
            return true;
        }
        self.different = 0;
        self.repeated += 1;
        let has_moved = match (&self.first_pose, &pose) {
            (Some(from), Some(to)) => has_moved(from, to, fingerprint.beam),
            _ => false,
        };
        let (repetitions, seconds) = STANDING;
        let stands_for_long = fingerprint.beam.is_none()
            && self.repeated >= repetitions
            && capture.seconds_since(self.first) >= seconds;
        self.is_stuck |= (has_moved && self.repeated >= MOVING) || stands_for_long;
        // From the first repetition on: a measurement from elsewhere says nothing about this place.
        !(has_moved || self.is_stuck)
    }

    /// A frame has the time of the one before.
    pub fn count_same_time(&mut self) {
        self.same_time += 1;
        self.different = 0;
        self.is_stuck |= self.same_time >= SAME_TIME;
    }

    pub fn forget_pose(&mut self) {
        self.first_pose = None;
    }

    pub fn is_stuck(&self) -> bool {
        self.is_stuck
    }
}

/// Direction of the only beam of `scan` (body).
fn axis(scan: &RangeScan) -> Option<Vector3<f64>> {
    let (sin, cos) = f64::from(scan.angle_first_rad).sin_cos();
    Some(scan.mounting.rotation()? * Vector3::new(cos, sin, 0.0))
}

fn has_moved(from: &Pose, to: &Pose, beam: Option<Vector3<f64>>) -> bool {
    let way_m = to.position_m - from.position_m;
    if let Some(axis) = beam {
        return way_m.dot(&(from.rotation * axis)).abs() > MOVED_BEAM_M;
    }
    way_m.norm() > MOVED.0 || from.turned_rad(to) > MOVED.1
}
