//! A scan that is ready to be published, before it is written into shared memory.

use crate::config::RangefinderSpec;
use jink_shared_types::ranges::{RangeScan, ScanFrame};
use jink_shared_types::{Coded, Reserved, Timestamp};

/// A scan of one beam, or a part of a sweep.
#[derive(Clone, Copy, Debug)]
pub struct ScanView<'a> {
    /// The sensor.
    pub spec: &'a RangefinderSpec,
    /// When its first beam was measured.
    pub first_beam: Timestamp,
    /// When its last beam was measured.
    pub capture: Timestamp,
    /// Direction of its first beam (rad), positive clockwise.
    pub angle_first_rad: f32,
    /// Angle between beams (rad), positive clockwise.
    pub angle_step_rad: f32,
    /// Ranges (m) as [`RangeScan`] has them.
    pub range_m: &'a [f32],
}

impl ScanView<'_> {
    /// Writes the scan where its readers will find it. Every field that counts is written.
    pub fn write(&self, scan: &mut RangeScan) {
        let beams = self.range_m.len().min(scan.range_m.len());
        let steps = beams.saturating_sub(1).max(1);
        scan.origin = self.spec.position;
        scan.mounting = self.spec.mounting;
        scan.first_beam = self.first_beam;
        scan.beam_interval_s = (self.capture.seconds_since(self.first_beam) / steps as f64) as f32;
        scan.angle_first_rad = self.angle_first_rad;
        scan.angle_step_rad = self.angle_step_rad;
        scan.beam_width_rad = self.spec.beam_width_rad as f32;
        scan.range_min_m = self.spec.reach.min_m;
        scan.range_max_m = self.spec.reach.max_m;
        scan.range_sigma_m = self.spec.sigma_m as f32;
        scan.beams = beams as u32;
        scan.frame = Coded::new(ScanFrame::Body);
        scan.reserved = Reserved::ZERO;
        scan.range_m[..beams].copy_from_slice(&self.range_m[..beams]);
    }
}
