//! Estimates the sensors' field of view from their answers.
//!
//! | in | out |
//! |---|---|
//! | answers (hits and "nothing there") in the body frame | [`FieldOfView`] of the last seconds |
//!
//! A part of each frame's rays is used, another part in every frame, so that the cost does not depend on their number.

use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{PointCloud, RangeScan, RayKind, SENSORS};
use jink_shared_types::view::FieldOfView;
use nalgebra::{UnitQuaternion, Vector3};

/// Rays of a frame that are used.
const RAYS: usize = 1_024;
/// The golden ratio less one: (sqrt(5) - 1) / 2.
const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_9;
/// A direction without an answer for this long is no longer in view (s); it stays for twice as long at most. Long
/// enough for a sensor of 2 Hz to cover its field of view several times.
const PERIOD_S: f64 = 5.0;

/// The field of view of all sensors.
pub(crate) struct FieldOfViewEstimator {
    /// Seen in this period and in the one before.
    now: FieldOfView,
    before: FieldOfView,
    /// Per sensor that measures clouds: the directions of all its answers so far.
    ever: Box<[FieldOfView; SENSORS]>,
    began: Timestamp,
    near_m: f32,
    far_m: f32,
    band_m: [f32; 2],
    /// Bit per sensor that has answered.
    sensors: u64,
}

impl FieldOfViewEstimator {
    pub fn new() -> Self {
        Self {
            now: FieldOfView::default(),
            before: FieldOfView::default(),
            ever: jink_shared_types::sample::zeroed_box(),
            began: Timestamp::NEVER,
            near_m: 0.0,
            far_m: 0.0,
            band_m: [0.0; 2],
            sensors: 0,
        }
    }

    /// Adds rays of `cloud`; frame number `number`, which clears the map up to `reach_m`.
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
        // Odd: lidars list their rows in columns of a power of two, and every row is to be used in every frame.
        let step = points.len().div_ceil(RAYS) | 1;
        // Multiples of the golden ratio fill the step evenly from the first frames on: with the next ray of the step in
        // each frame, the same rows of a column would be used for seconds.
        let first = (number as f64 * GOLDEN_RATIO).fract() * step as f64;
        let origin = cloud.origin.vector();
        let mut answered = false;
        for point in points.iter().skip(first as usize).step_by(step) {
            if point.kind.get() != RayKind::Unknown {
                let end = Vector3::new(point.forward_m, point.right_m, point.down_m).cast::<f64>();
                let direction = end - origin;
                self.now.add(&direction);
                if let Some(ever) = self.ever.get_mut(sensor) {
                    ever.add(&direction);
                }
                answered = true;
            }
        }
        if answered {
            self.note(sensor, cloud.range_min_m, reach_m);
        }
    }

    /// The same for a planar scan whose mounting is `body_q_sensor` and that stands for `band_m` above and below its
    /// plane; a single beam sees no area, and does not change the nearest and farthest range.
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

    /// The directions of all answers so far of `sensor`, which measures clouds.
    pub fn ever(&self, sensor: usize) -> &FieldOfView {
        &self.ever[sensor.min(SENSORS - 1)]
    }

    fn note(&mut self, sensor: usize, near_m: f32, reach_m: f64) {
        self.near_m = self.near_m.max(near_m);
        self.far_m = self.far_m.max(reach_m as f32);
        self.sensors |= 1 << (sensor & 63);
    }

    fn advance(&mut self, capture: Timestamp) {
        if !self.began.is_set() || capture.seconds_since(self.began).abs() > PERIOD_S {
            self.before = std::mem::take(&mut self.now);
            self.began = capture;
        }
    }

    /// Writes the field of view.
    pub fn write(&self, out: &mut FieldOfView) {
        *out = self.now;
        out.join(&self.before);
        out.near_m = self.near_m;
        out.far_m = self.far_m;
        [out.band_up_m, out.band_down_m] = self.band_m;
        out.sensors = self.sensors.count_ones();
    }
}

#[cfg(test)]
mod tests {
    use super::FieldOfViewEstimator;
    use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};
    use jink_shared_types::view::FieldOfView;
    use jink_shared_types::{Coded, Timestamp};
    use nalgebra::Vector3;

    /// A turn of a lidar of 45 degrees up and down whose points come column by column, with nothing in reach.
    fn turn(rows: usize, columns: usize) -> Box<PointCloud> {
        let mut cloud = PointCloud::boxed();
        for column in 0..columns {
            for row in 0..rows {
                let right = (column as f64 + 0.5) / columns as f64 * std::f64::consts::TAU;
                let up = ((row as f64 + 0.5) / rows as f64 - 0.5) * std::f64::consts::FRAC_PI_2;
                let place = 10.0 * Vector3::new(up.cos() * right.cos(), up.cos() * right.sin(), -up.sin());
                cloud.push(CloudPoint {
                    forward_m: place.x as f32,
                    right_m: place.y as f32,
                    down_m: place.z as f32,
                    kind: Coded::new(RayKind::Clear),
                    ..CloudPoint::default()
                });
            }
        }
        cloud
    }

    #[test]
    fn every_direction_that_a_lidar_measures_is_in_view_within_two_seconds() {
        for (rows, columns) in [(128, 1024), (128, 512), (64, 1024), (64, 2048), (32, 1024)] {
            let cloud = turn(rows, columns);
            let mut view = FieldOfViewEstimator::new();
            let mut seen = FieldOfView::default();
            for frame in 0..20u32 {
                let capture = Timestamp::from_seconds(1.0 + 0.1 * f64::from(frame));
                view.cloud(0, &cloud, capture, u64::from(frame), 12.0);
            }
            view.write(&mut seen);
            assert!(seen.is_all_around(), "{rows} x {columns}");
            let low = (0..72).filter_map(|column| seen.height_rad(column));
            let full = low.filter(|[down, up]| *down < -0.75 && *up > 0.75).count();
            assert!(full >= 71, "{rows} x {columns}: {full} of 72 columns in full");
        }
    }
}
