//! What range sensors say. Points are already in the body frame: the driver applies the sensor's mounting.
//!
//! Three answers exist for every direction: a hit, "nothing up to my range", and "I do not know". Only the first
//! two carry information; the third never opens space.

use crate::clock::Timestamp;
use crate::coded::Coded;
use crate::frames::{Attitude, BodyFrd, Point};
use nalgebra::Vector3;

/// Greatest angle between a beam of a scan and the body's horizontal plane (rad): 60 degrees, beyond which it looks up or down rather
/// than around, however the vehicle tilts.
pub const STEEPEST_RAD: f64 = std::f64::consts::FRAC_PI_3;

/// Most beams in one [`RangeScan`].
pub const SCAN_BEAMS: usize = 1_024;

/// Most points in one [`PointCloud`].
pub const CLOUD_POINTS: usize = 131_072;

crate::wire_enum! {
    /// What the beams of a scan turn with.
    pub enum ScanFrame {
        /// The body: they tilt with it.
        Body = 0 "body",
        /// The heading: they are level, and their ranges horizontal.
        Level = 1 "level",
        /// Nothing: they are level, angles count from north, and their ranges are horizontal.
        North = 2 "north",
    }
}

crate::sample! {
    /// A planar scan (rotating 2-D lidar), a single beam (`beams == 1`), or a row of level distances.
    ///
    /// Beam `i` points along `angle_first_rad + i * angle_step_rad`, clockwise seen from above in the sensor's own
    /// plane. `range_m[i]`: a number up to `range_max_m` is a hit, infinity is "nothing up to `range_max_m`", NaN is
    /// "unknown"; a number below `range_min_m` is an obstacle at that range or nearer.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct RangeScan: 4208 {
        /// Sensor position in the body.
        pub origin: Point<BodyFrd>,
        /// `body_q_sensor`: takes sensor components to body components. Only for [`ScanFrame::Body`].
        pub mounting: Attitude,
        /// When the first beam was measured.
        pub first_beam: Timestamp,
        /// Time between two beams (s); 0 for a scan taken at once.
        pub beam_interval_s: f32,
        /// Direction of beam 0 (rad).
        pub angle_first_rad: f32,
        /// Angle between beams (rad), positive clockwise.
        pub angle_step_rad: f32,
        /// Full opening angle of one beam (rad).
        pub beam_width_rad: f32,
        /// Shortest range the sensor measures (m).
        pub range_min_m: f32,
        /// Longest range the sensor measures (m).
        pub range_max_m: f32,
        /// One standard deviation of a range (m).
        pub range_sigma_m: f32,
        /// Beams in use, at most [`SCAN_BEAMS`].
        pub beams: u32,
        /// What the beams turn with.
        pub frame: Coded<ScanFrame>,
        /// Explicit padding, zero.
        pub reserved: [u8; 15],
        /// The ranges.
        pub range_m: [f32; SCAN_BEAMS],
    }
}

impl RangeScan {
    /// The beams in use.
    pub fn ranges(&self) -> &[f32] {
        &self.range_m[..(self.beams as usize).min(SCAN_BEAMS)]
    }

    /// Where beam `beam` of a level vehicle with heading `heading_rad` points, in the body; `None` if it looks up or down rather than
    /// around ([`STEEPEST_RAD`]).
    pub fn axis(&self, beam: usize, heading_rad: f64) -> Option<Vector3<f64>> {
        let toward_rad = f64::from(self.angle_first_rad) + beam as f64 * f64::from(self.angle_step_rad);
        let level = |bearing_rad: f64| Vector3::new(bearing_rad.cos(), bearing_rad.sin(), 0.0);
        match self.frame.get() {
            ScanFrame::Level => Some(level(toward_rad)),
            ScanFrame::North => Some(level(toward_rad - heading_rad)),
            ScanFrame::Body => {
                let along = self.mounting.rotation() * level(toward_rad);
                // False for NaN, too.
                (along.xy().norm() >= STEEPEST_RAD.cos()).then_some(along)
            }
        }
    }
}

crate::wire_enum! {
    /// What one ray of a point cloud says.
    pub enum RayKind {
        /// Nothing: skip it.
        Unknown = 0 "unknown",
        /// An obstacle at the point.
        Hit = 1 "hit",
        /// Nothing between the sensor and the point, which lies at the sensor's range.
        Clear = 2 "clear",
    }
}

crate::sample! {
    /// The end of one ray, in the body frame as it stood when the ray was measured.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct CloudPoint: 16 {
        /// Forward (m).
        pub forward_m: f32,
        /// Right (m).
        pub right_m: f32,
        /// Down (m).
        pub down_m: f32,
        /// When it was measured: time after [`PointCloud::first_point`] in units of 10 us.
        pub offset_10us: u16,
        /// What the ray says.
        pub kind: Coded<RayKind>,
        /// Explicit padding, zero.
        pub reserved: u8,
    }
}

crate::sample! {
    /// A 3-D lidar sweep or a depth image as points. Written in place: never copy one.
    pub struct PointCloud: 2097216 {
        /// Sensor position in the body.
        pub origin: Point<BodyFrd>,
        /// When the first point was measured; the header's `capture` is the time of the last.
        pub first_point: Timestamp,
        /// Shortest range the sensor measures (m).
        pub range_min_m: f32,
        /// Longest range the sensor measures (m).
        pub range_max_m: f32,
        /// One standard deviation of a range (m).
        pub range_sigma_m: f32,
        /// Points in use, at most [`CLOUD_POINTS`].
        pub len: u32,
        /// Explicit padding, zero.
        pub reserved: [u64; 2],
        /// The points.
        pub points: [CloudPoint; CLOUD_POINTS],
    }
}

/// Short: nobody wants to read all cells or points.
impl std::fmt::Debug for PointCloud {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "PointCloud({} points, range {}..{} m)",
            self.len, self.range_min_m, self.range_max_m
        )
    }
}

impl PointCloud {
    /// The points in use.
    pub fn points(&self) -> &[CloudPoint] {
        &self.points[..(self.len as usize).min(CLOUD_POINTS)]
    }

    /// Appends a point; `false` if the cloud is full.
    pub fn push(&mut self, point: CloudPoint) -> bool {
        let index = self.len as usize;
        match self.points.get_mut(index) {
            Some(slot) => {
                *slot = point;
                self.len += 1;
                true
            }
            None => false,
        }
    }

    /// An empty cloud on the heap, for tests and for simulations within one process.
    pub fn boxed() -> Box<Self> {
        crate::sample::zeroed_box()
    }
}

impl Default for RangeScan {
    fn default() -> Self {
        Self {
            origin: Point::ZERO,
            mounting: Attitude::default(),
            first_beam: Timestamp::NEVER,
            beam_interval_s: 0.0,
            angle_first_rad: 0.0,
            angle_step_rad: 0.0,
            beam_width_rad: 0.0,
            range_min_m: 0.0,
            range_max_m: 0.0,
            range_sigma_m: 0.0,
            beams: 0,
            frame: Coded::new(ScanFrame::Body),
            reserved: [0; 15],
            range_m: [f32::NAN; SCAN_BEAMS],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{RangeScan, ScanFrame};
    use crate::coded::Coded;
    use crate::frames::Attitude;
    use nalgebra::{UnitQuaternion, Vector3};

    #[test]
    fn a_beam_points_where_it_is_mounted_and_to_no_side_if_it_looks_down() {
        let at = |pitch_deg: f64, frame: ScanFrame| RangeScan {
            mounting: Attitude::from_rotation(UnitQuaternion::from_euler_angles(
                0.0,
                pitch_deg.to_radians(),
                0.0,
            )),
            angle_first_rad: 90.0_f32.to_radians(),
            angle_step_rad: -90.0_f32.to_radians(),
            beams: 2,
            frame: Coded::new(frame),
            ..RangeScan::default()
        };
        let is = |axis: Option<Vector3<f64>>, x: f64, y: f64, z: f64| {
            axis.is_some_and(|axis| (axis - Vector3::new(x, y, z)).norm() < 1e-6)
        };
        let down = at(-90.0, ScanFrame::Body);
        assert!(
            is(down.axis(0, 0.0), 0.0, 1.0, 0.0),
            "the axis it is turned about"
        );
        assert_eq!(down.axis(1, 0.0), None);
        assert!(at(59.0, ScanFrame::Body).axis(1, 0.0).is_some());
        assert!(at(61.0, ScanFrame::Body).axis(1, 0.0).is_none());
        // Rows know no mounting; what counts from north turns with the heading.
        let quarter = std::f64::consts::FRAC_PI_2;
        assert!(is(at(-90.0, ScanFrame::Level).axis(1, quarter), 1.0, 0.0, 0.0));
        assert!(is(at(-90.0, ScanFrame::North).axis(0, quarter), 1.0, 0.0, 0.0));
    }
}
