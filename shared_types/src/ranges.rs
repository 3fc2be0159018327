//! What range sensors say. Points are already in the body frame: the driver applies the sensor's mounting.
//!
//! Three answers exist for every direction: a hit, "nothing up to my range", and "I do not know". Only the first
//! two carry information; the third never opens space.

use crate::clock::Timestamp;
use crate::coded::Coded;
use crate::frames::{BodyFrd, Mounting, Point};
use crate::reserved::Reserved;
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Greatest angle between a beam of a scan and the body's horizontal plane (rad): 60 degrees, beyond which it looks up or down rather
/// than around, however the vehicle tilts.
pub const STEEPEST_RAD: f64 = std::f64::consts::FRAC_PI_3;

/// Most sensors of one vehicle: sixteen single beams around it, or any smaller number of better ones.
pub const SENSORS: usize = 16;

/// Age, from its capture, at which a frame of a sensor is stale (us, [`crate::SampleHeader::deadline_us`]): two and a half periods of
/// its `rate_hz` and the `delay_s` from capture to publication, and the deadline of its topic (ms) at least. `rate_hz` zero: not known.
pub fn deadline_us(topic_deadline_ms: f64, rate_hz: f64, delay_s: f64) -> u32 {
    let periods_s = if rate_hz > 0.0 { 2.5 / rate_hz } else { 0.0 };
    // A cast of a float stops at the ends.
    ((periods_s.max(topic_deadline_ms * 1e-3) + delay_s) * 1e6) as u32
}

/// Most beams in one [`RangeScan`].
pub const SCAN_BEAMS: usize = 1_024;

/// Largest turn a scan covers (rad): one revolution, and as much again for odd conventions of the first angle.
const MAX_TURN_RAD: f64 = 2.0 * TAU;

/// Longest scan (s). The slowest sensor that turns takes a second; readers may ask for less.
const MAX_DURATION_S: f64 = 10.0;

/// No sensor is mounted further from the centre of gravity (m): the largest vehicle radius is 3 m.
const MAX_LEVER_M: f64 = 5.0;

/// No range sensor of a multicopter reaches further (m).
pub const MAX_RANGE_M: f64 = 1_000.0;

/// Most points in one [`PointCloud`].
pub const CLOUD_POINTS: usize = 131_072;

/// Most points that a depth image is reduced to unless its table says otherwise: at 5 m and 87 deg they lie 5 cm apart, a quarter
/// of a map cell. More of them cost fusion time and show nothing more.
pub const IMAGE_POINTS: usize = 25_000;

/// Edge (px) of the square blocks of pixels of which one point each is made, so that an image of `width_px` times `height_px`
/// has [`IMAGE_POINTS`] points at most.
pub fn image_bin_px(width_px: u16, height_px: u16) -> u16 {
    let points = |bin_px: u16| usize::from(width_px / bin_px) * usize::from(height_px / bin_px);
    (1..=u16::MAX)
        .find(|bin_px| points(*bin_px) <= IMAGE_POINTS)
        .unwrap_or(u16::MAX)
}

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
        pub mounting: Mounting,
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
        /// Room for later fields, zero.
        pub reserved: Reserved<15>,
        /// The ranges.
        pub range_m: [f32; SCAN_BEAMS],
    }
    plausible if Self::is_consistent
}

impl RangeScan {
    /// Whether the numbers that describe it can be those of a sensor. The ranges are not looked at: every number
    /// means something.
    pub fn is_consistent(&self) -> bool {
        let beams = f64::from(self.beams);
        let is_turn = |rad: f64| rad.abs() <= MAX_TURN_RAD;
        let duration_s = f64::from(self.beam_interval_s) * beams;
        // NaN fails every one of these comparisons.
        self.beams as usize <= SCAN_BEAMS
            && is_turn(f64::from(self.angle_first_rad))
            && is_turn(f64::from(self.angle_step_rad) * beams)
            && (0.0..=MAX_DURATION_S).contains(&duration_s)
            && (0.0..=TAU + 1e-6).contains(&f64::from(self.beam_width_rad))
            && self.mounting.is_rotation()
            && is_sensor(
                self.origin,
                [self.range_min_m, self.range_max_m, self.range_sigma_m],
            )
    }

    /// The beams in use.
    pub fn ranges(&self) -> &[f32] {
        &self.range_m[..(self.beams as usize).min(SCAN_BEAMS)]
    }

    /// Where beam `beam` of a level vehicle with heading `heading_rad` points, in the body; `None` if it looks up or down rather than
    /// around ([`STEEPEST_RAD`]), or if its mounting is no rotation.
    pub fn axis(&self, beam: usize, heading_rad: f64) -> Option<Vector3<f64>> {
        let toward_rad = f64::from(self.angle_first_rad) + beam as f64 * f64::from(self.angle_step_rad);
        let level = |bearing_rad: f64| Vector3::new(bearing_rad.cos(), bearing_rad.sin(), 0.0);
        match self.frame.get() {
            ScanFrame::Level => Some(level(toward_rad)),
            ScanFrame::North => Some(level(toward_rad - heading_rad)),
            ScanFrame::Body => {
                let along = self.mounting.rotation()? * level(toward_rad);
                // False for NaN, too.
                (along.xy().norm() >= STEEPEST_RAD.cos()).then_some(along)
            }
        }
    }
}

/// Whether a sensor may sit at `origin` and have this shortest range, longest range and deviation (m). NaN fails
/// every comparison.
fn is_sensor(origin: Point<BodyFrd>, [min_m, max_m, sigma_m]: [f32; 3]) -> bool {
    let reach = 0.0..=MAX_RANGE_M as f32;
    origin.is_finite()
        && origin.vector().amax() <= MAX_LEVER_M
        && reach.contains(&min_m)
        && reach.contains(&max_m)
        && max_m > 0.0
        && reach.contains(&sigma_m)
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
        pub reserved: Reserved<1>,
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
        /// Room for later fields, zero.
        pub reserved: Reserved<16>,
        /// The points.
        pub points: [CloudPoint; CLOUD_POINTS],
    }
    plausible if Self::is_consistent
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
    /// Whether the numbers that describe it can be those of a sensor. The points are not looked at: drivers put NaN
    /// where a pixel has no depth, and whoever enters a point looks at it anyway.
    pub fn is_consistent(&self) -> bool {
        self.len as usize <= CLOUD_POINTS
            && is_sensor(
                self.origin,
                [self.range_min_m, self.range_max_m, self.range_sigma_m],
            )
    }

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
            mounting: Mounting::default(),
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
            reserved: Reserved::ZERO,
            range_m: [f32::NAN; SCAN_BEAMS],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{IMAGE_POINTS, RangeScan, ScanFrame, image_bin_px};
    use crate::coded::Coded;
    use crate::frames::Mounting;
    use nalgebra::{UnitQuaternion, Vector3};

    #[test]
    fn an_image_is_reduced_as_little_as_its_points_allow() {
        for (size_px, bin_px) in [
            ((160, 120), 1),
            ((640, 480), 4),
            ((848, 480), 5),
            ((1280, 720), 7),
            ((25_000, 1), 1),
            ((0, 0), 1),
        ] {
            assert_eq!(image_bin_px(size_px.0, size_px.1), bin_px, "{size_px:?}");
        }
        let bin_px = image_bin_px(u16::MAX, u16::MAX);
        assert!(usize::from(u16::MAX / bin_px).pow(2) <= IMAGE_POINTS);
    }

    #[test]
    fn a_beam_points_where_it_is_mounted_and_to_no_side_if_it_looks_down() {
        let at = |pitch_deg: f64, frame: ScanFrame| RangeScan {
            mounting: Mounting::from_rotation(UnitQuaternion::from_euler_angles(
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
