//! What the sensors can see, learned from what they answer.
//!
//! | in | out |
//! |---|---|
//! | answers (hits and "nothing there") in the body frame | [`FieldOfView`] of the last seconds |
//!
//! A part of each frame's rays is looked at, another part in every frame, so that the cost does not depend on how many there are.

use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{PointCloud, RangeScan, RayKind};
use jink_shared_types::view::FieldOfView;
use nalgebra::{UnitQuaternion, Vector3};

/// Rays of a frame that are looked at.
const RAYS: usize = 1_024;
/// A direction in which nothing was answered for this long is not seen any more (s); it is seen for twice as long at most. Long
/// enough for a sensor of 2 Hz to look everywhere some times.
const KEPT_S: f64 = 5.0;

/// The field of view.
pub(crate) struct View {
    /// Seen in this period and in the one before.
    now: FieldOfView,
    before: FieldOfView,
    began: Timestamp,
    near_m: f32,
    far_m: f32,
    band_m: [f32; 2],
    /// Bit per sensor that has answered.
    sensors: u64,
}

impl View {
    pub fn new() -> Self {
        Self {
            now: FieldOfView::default(),
            before: FieldOfView::default(),
            began: Timestamp::NEVER,
            near_m: 0.0,
            far_m: 0.0,
            band_m: [0.0; 2],
            sensors: 0,
        }
    }

    /// Looks at the rays of `cloud`; frame number `number`, which clears the map up to `reach_m`.
    pub fn cloud(
        &mut self,
        sensor: usize,
        cloud: &PointCloud,
        capture: Timestamp,
        number: u64,
        reach_m: f64,
    ) {
        self.advance(capture);
        let points = cloud.points();
        // Odd: lidars list their rows in columns of a power of two, and every row is to be looked at in every frame.
        let step = points.len().div_ceil(RAYS) | 1;
        let origin = cloud.origin.vector();
        let mut answered = false;
        for point in points.iter().skip(number as usize % step).step_by(step) {
            if point.kind.get() != RayKind::Unknown {
                let end = Vector3::new(point.forward_m, point.right_m, point.down_m).cast::<f64>();
                self.now.add(&(end - origin));
                answered = true;
            }
        }
        if answered {
            self.note(sensor, cloud.range_min_m, reach_m);
        }
    }

    /// The same of a planar scan whose mounting is `body_q_sensor` and that stands for `band_m` above and below its plane; a single
    /// beam sees no area, and says nothing of how near and how far that is seen.
    pub fn scan(
        &mut self,
        sensor: usize,
        scan: &RangeScan,
        body_q_sensor: &UnitQuaternion<f64>,
        capture: Timestamp,
        reach_m: f64,
        band_m: [f64; 2],
    ) {
        self.advance(capture);
        let mut answered = false;
        for (beam, range_m) in scan.ranges().iter().enumerate() {
            if !range_m.is_nan() {
                let angle_rad =
                    f64::from(scan.angle_first_rad) + beam as f64 * f64::from(scan.angle_step_rad);
                let (sin, cos) = angle_rad.sin_cos();
                self.now.add(&(body_q_sensor * Vector3::new(cos, sin, 0.0)));
                answered = true;
            }
        }
        if answered && scan.beams > 1 {
            self.note(sensor, scan.range_min_m, reach_m);
            self.band_m = [0, 1].map(|side| self.band_m[side].max(band_m[side] as f32));
        } else if answered {
            self.sensors |= 1 << (sensor & 63);
        }
    }

    fn note(&mut self, sensor: usize, near_m: f32, reach_m: f64) {
        self.near_m = self.near_m.max(near_m);
        self.far_m = self.far_m.max(reach_m as f32);
        self.sensors |= 1 << (sensor & 63);
    }

    fn advance(&mut self, capture: Timestamp) {
        if !self.began.is_set() || capture.seconds_since(self.began).abs() > KEPT_S {
            self.before = std::mem::take(&mut self.now);
            self.began = capture;
        }
    }

    /// What is seen.
    pub fn write(&self, out: &mut FieldOfView) {
        *out = self.now;
        out.join(&self.before);
        out.near_m = self.near_m;
        out.far_m = self.far_m;
        [out.band_up_m, out.band_down_m] = self.band_m;
        out.sensors = self.sensors.count_ones();
    }
}
