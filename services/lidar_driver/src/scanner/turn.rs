//! The samples of one turn become one scan: beams at equal angles, clockwise from the scanner's front.
//!
//! Of what falls into a beam the nearest counts. A sample beyond `range_max_m` means that there is nothing up to there,
//! an invalid one leaves it unknown, or means the same where the table declares `no_return = "clear"`; a beam is free
//! only if every sample in it is.

use super::Sample;
use crate::config::{CloudSpec, NoReturn};
use jink_shared_types::ranges::SCAN_BEAMS;
use jink_shared_types::ranges::{RangeScan, ScanFrame};
use jink_shared_types::{Coded, Reserved, Timestamp};

/// Samples of a turn, at least, that are worth a scan: the rest of a turn after a pause of the line is not.
const SAMPLES: u32 = 32;
/// A turn that lasts longer (s) is none: the line was interrupted.
const TURN_S: f64 = 1.0;
/// A step backwards by more than this (deg) is the end of a turn; corrections of angles are smaller.
const WRAP_DEG: f32 = 180.0;

/// What is known of one beam.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ScannerBeam {
    nearest_m: f32,
    free: bool,
    unknown: bool,
}

const NOTHING: ScannerBeam = ScannerBeam {
    nearest_m: f32::INFINITY,
    free: false,
    unknown: false,
};

/// Collects one turn.
#[derive(Clone, Debug)]
pub struct Turn {
    spec: CloudSpec,
    beams: Vec<ScannerBeam>,
    samples: u32,
    first: Timestamp,
    last: Timestamp,
    /// Greatest angle so far (deg): that of the present turn, zero where it has just begun, `None` where it is not
    /// known.
    last_deg: Option<f32>,
}

impl Turn {
    /// Of `beams` beams.
    pub fn new(spec: &CloudSpec, beams: u32) -> Self {
        Self {
            spec: spec.clone(),
            beams: vec![NOTHING; (beams as usize).clamp(1, SCAN_BEAMS)],
            samples: 0,
            first: Timestamp::NEVER,
            last: Timestamp::NEVER,
            last_deg: None,
        }
    }

    /// Whether the sample belongs to the next turn: then [`Self::finish`] comes first.
    pub fn ends_before(&self, sample: &Sample) -> bool {
        self.samples > 0
            && (self
                .last_deg
                .is_some_and(|last_deg| sample.angle_deg < last_deg - WRAP_DEG)
                || sample.time.seconds_since(self.first) > TURN_S)
    }

    /// Takes a sample.
    pub fn take(&mut self, sample: &Sample) {
        if self.samples == 0 {
            self.first = sample.time;
            self.beams.fill(NOTHING);
        }
        self.samples += 1;
        self.last = self.last.max(sample.time);
        // A correction may lead back over the front: the turn has not ended for that.
        let last_deg = self.last_deg.get_or_insert(sample.angle_deg);
        if sample.angle_deg < *last_deg + WRAP_DEG {
            *last_deg = last_deg.max(sample.angle_deg);
        }
        let angle_rad = sample.angle_deg.to_radians();
        if self.spec.blind.iter().any(|sector| sector.contains(angle_rad)) {
            return;
        }
        let count = self.beams.len();
        let index = (sample.angle_deg / 360.0 * count as f32) as usize % count;
        let beam = &mut self.beams[index];
        let answered = sample.range_m > 0.0;
        if sample.range_m > self.spec.range_max_m || (!answered && self.spec.no_return == NoReturn::Clear) {
            beam.free = true;
        } else if answered {
            beam.nearest_m = beam.nearest_m.min(sample.range_m);
        } else {
            beam.unknown = true;
        }
    }

    /// Ends the turn; whether it makes a scan, which [`Self::write`] then writes.
    pub fn finish(&mut self) -> bool {
        self.last_deg = Some(0.0);
        std::mem::take(&mut self.samples) >= SAMPLES
    }

    /// When the last sample was measured.
    pub fn capture(&self) -> Timestamp {
        self.last
    }

    /// The line was interrupted.
    pub fn clear(&mut self) {
        self.samples = 0;
        self.last_deg = None;
        self.last = Timestamp::NEVER;
    }

    /// Writes the scan where its readers will find it. Every field that counts is written.
    pub fn write(&self, scan: &mut RangeScan) {
        let count = self.beams.len();
        let step_rad = std::f32::consts::TAU / count as f32;
        scan.origin = self.spec.position;
        scan.mounting = self.spec.mounting;
        scan.first_beam = self.first;
        scan.beam_interval_s = (self.last.seconds_since(self.first).max(0.0) / count as f64) as f32;
        scan.angle_first_rad = 0.5 * step_rad;
        scan.angle_step_rad = step_rad;
        scan.beam_width_rad = step_rad;
        scan.range_min_m = self.spec.range_min_m;
        scan.range_max_m = self.spec.range_max_m;
        scan.range_sigma_m = self.spec.sigma_m;
        scan.beams = count as u32;
        scan.frame = Coded::new(ScanFrame::Body);
        scan.reserved = Reserved::ZERO;
        for (range_m, beam) in scan.range_m.iter_mut().zip(&self.beams) {
            *range_m = beam.range_m();
        }
    }
}

impl ScannerBeam {
    /// The range as in a scan (m).
    fn range_m(&self) -> f32 {
        match self {
            Self { nearest_m, .. } if nearest_m.is_finite() => *nearest_m,
            Self {
                free: true,
                unknown: false,
                ..
            } => f32::INFINITY,
            _ => f32::NAN,
        }
    }
}
