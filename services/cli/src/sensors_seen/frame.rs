//! One sample of a sensor, cut down to what an examination asks of it.
//!
//! Directions are those of a level vehicle. A ray of a point cloud counts for the horizon if it is nearly level
//! ([`HORIZON_RAD`]); a beam of a scan if it is mounted to look around at all, and then all its width, as in the guard's ring.

use super::circle::Sectors;
use jink_shared_types::ranges::{PointCloud, RangeScan, RayKind, ScanFrame};
use jink_shared_types::ring::{SECTORS, sector_of, sectors_of_arc};
use nalgebra::Vector3;

/// Rays of a cloud up to this far above or below the vehicle's horizon count for it (rad): 10 degrees. A steeper one
/// leaves the guard's band of half a metre within 3 m, and the ground under a vehicle that stands is not the horizon.
const HORIZON_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Readings up to this far above the shortest range (m) are at it: what lies in front of a sensor reads as that, with its noise.
const NEAR_M: f64 = 0.02;
/// Of FNV-1a, 64 bits: its beginning, and its factor.
const HASH: [u64; 2] = [0xcbf2_9ce4_8422_2325, 0x0000_0100_0000_01b3];

/// What sort of sensor it comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SensorType {
    /// One beam.
    #[default]
    Beam,
    /// Beams in a plane.
    Scan,
    /// Distances that somebody else has computed.
    Row,
    /// A cloud.
    Cloud,
}

/// One sample.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Where it comes from.
    pub sort: SensorType,
    /// Rays in it.
    pub rays: u64,
    /// Rays that say nothing.
    pub unknown: u64,
    /// Rays that say an obstacle.
    pub hits: u64,
    /// Of these, those that say it at the shortest range or below.
    pub too_near: u64,
    /// Directions that it looks into, whatever it says of them.
    pub covered: Sectors,
    /// Lowest and highest ray above the horizon (deg); clouds only.
    pub elevation_deg: Option<[f64; 2]>,
    /// Nearest obstacle from the vehicle's centre (m); infinity = nothing up to the reach; NaN = nothing is said of the sector.
    pub nearest_m: [f32; SECTORS],
    /// Sectors with an obstacle as near as the vehicle itself.
    pub own: Sectors,
    /// Shortest and longest range (m).
    pub reach_m: [f32; 2],
    /// The same for samples that say the same, to the last bit.
    pub fingerprint: u64,
    /// The range of all hits (m), if they have but one.
    pub one_range_m: Option<f32>,
}

impl Frame {
    fn new(sort: SensorType, reach_m: [f32; 2]) -> Self {
        Self {
            sort,
            rays: 0,
            unknown: 0,
            hits: 0,
            too_near: 0,
            covered: Sectors::NONE,
            elevation_deg: None,
            nearest_m: [f32::NAN; SECTORS],
            own: Sectors::NONE,
            reach_m,
            fingerprint: HASH[0],
            one_range_m: None,
        }
    }

    /// Of `scan`, by a vehicle with heading `heading_rad`; what is nearer to its centre than `own_m` is the vehicle.
    pub fn of_scan(scan: &RangeScan, heading_rad: f64, own_m: f64) -> Self {
        let sort = match (scan.frame.get(), scan.beams) {
            (ScanFrame::Level | ScanFrame::North, _) => SensorType::Row,
            (ScanFrame::Body, 0 | 1) => SensorType::Beam,
            (ScanFrame::Body, _) => SensorType::Scan,
        };
        let mut frame = Self::new(sort, [scan.range_min_m, scan.range_max_m]);
        let width_rad = f64::from(scan.beam_width_rad).max(0.0);
        for (beam, range_m) in scan.ranges().iter().enumerate() {
            let kind = kind_of(*range_m, scan.range_max_m);
            frame.count(kind, *range_m);
            frame.mix(range_m.to_bits());
            let Some(axis) = scan.axis(beam, heading_rad) else {
                continue;
            };
            let end_m = match sort {
                SensorType::Row => axis * f64::from(*range_m),
                _ => scan.origin.vector() + axis * f64::from(*range_m),
            };
            let from_rad = axis.y.atan2(axis.x) - 0.5 * width_rad;
            for sector in sectors_of_arc(from_rad, width_rad) {
                frame.covered.0[sector] = true;
                frame.note(sector, kind, end_m, own_m);
            }
        }
        frame
    }

    /// Of `cloud`, as above.
    pub fn of_cloud(cloud: &PointCloud, own_m: f64) -> Self {
        let mut frame = Self::new(SensorType::Cloud, [cloud.range_min_m, cloud.range_max_m]);
        let origin_m = cloud.origin.vector();
        let (mut low_rad, mut high_rad) = (f64::INFINITY, f64::NEG_INFINITY);
        for point in cloud.points() {
            let end_m = Vector3::new(
                f64::from(point.forward_m),
                f64::from(point.right_m),
                f64::from(point.down_m),
            );
            let ray_m = end_m - origin_m;
            let kind = point.kind.get();
            frame.count(kind, ray_m.norm() as f32);
            frame.mix(u32::from(kind == RayKind::Hit));
            if kind == RayKind::Unknown {
                continue;
            }
            for part_m in [point.forward_m, point.right_m, point.down_m] {
                frame.mix(part_m.to_bits());
            }
            let elevation_rad = (-ray_m.z).atan2(ray_m.xy().norm());
            low_rad = low_rad.min(elevation_rad);
            high_rad = high_rad.max(elevation_rad);
            if elevation_rad.abs() <= HORIZON_RAD {
                let sector = sector_of(end_m.y.atan2(end_m.x));
                frame.covered.0[sector] = true;
                frame.note(sector, kind, end_m, own_m);
            }
        }
        if low_rad <= high_rad {
            frame.elevation_deg = Some([low_rad.to_degrees(), high_rad.to_degrees()]);
        }
        // Points are computed from ranges: those of one range differ in their last bits.
        frame.one_range_m = None;
        frame
    }

    fn count(&mut self, kind: RayKind, range_m: f32) {
        self.rays += 1;
        match kind {
            RayKind::Unknown => self.unknown += 1,
            RayKind::Clear => {}
            RayKind::Hit => {
                let is_other = self.hits > 0 && self.one_range_m != Some(range_m);
                self.one_range_m = if is_other { None } else { Some(range_m) };
                self.hits += 1;
                let near_m = f64::from(self.reach_m[0]) + NEAR_M;
                self.too_near += u64::from(f64::from(range_m) <= near_m);
            }
        }
    }

    fn mix(&mut self, bits: u32) {
        self.fingerprint = (self.fingerprint ^ u64::from(bits)).wrapping_mul(HASH[1]);
    }

    fn note(&mut self, sector: usize, kind: RayKind, end_m: Vector3<f64>, own_m: f64) {
        let nearest_m = &mut self.nearest_m[sector];
        match kind {
            RayKind::Unknown => {}
            RayKind::Clear => *nearest_m = nearest_m.min(f32::INFINITY),
            RayKind::Hit => {
                *nearest_m = nearest_m.min(end_m.xy().norm() as f32);
                self.own.0[sector] |= end_m.norm() < own_m;
            }
        }
    }
}

fn kind_of(range_m: f32, range_max_m: f32) -> RayKind {
    if range_m.is_nan() || range_m < 0.0 {
        RayKind::Unknown
    } else if range_m > range_max_m {
        RayKind::Clear
    } else {
        RayKind::Hit
    }
}

#[cfg(test)]
mod tests {
    use super::{Frame, SensorType};
    use jink_shared_types::ranges::{CloudPoint, PointCloud, RangeScan, RayKind};
    use jink_shared_types::ring::{SECTORS, sector_of};
    use jink_shared_types::{Coded, Point};
    use proptest::prelude::*;

    fn scan(angle_first_rad: f32, range_m: &[f32]) -> RangeScan {
        let mut scan = RangeScan {
            angle_first_rad,
            angle_step_rad: 0.02,
            beam_width_rad: 0.02,
            range_min_m: 0.2,
            range_max_m: 10.0,
            beams: range_m.len() as u32,
            ..RangeScan::default()
        };
        scan.range_m[..range_m.len()].copy_from_slice(range_m);
        scan
    }

    #[test]
    fn each_answer_is_counted_once() {
        let frame = Frame::of_scan(
            &scan(0.0, &[f32::NAN, -1.0, f32::INFINITY, 11.0, 0.0, 0.21, 5.0]),
            0.0,
            0.5,
        );
        assert_eq!(
            (frame.rays, frame.unknown, frame.hits, frame.too_near),
            (7, 2, 3, 2)
        );
        assert_eq!(frame.sort, SensorType::Scan);
        assert_eq!(frame.one_range_m, None);
        assert_eq!(
            Frame::of_scan(&scan(0.0, &[3.0, f32::NAN, 3.0]), 0.0, 0.5).one_range_m,
            Some(3.0)
        );
    }

    proptest! {
        #[test]
        fn a_scan_covers_its_width_and_says_the_nearest_of_it(
            first_rad in -7.0..7.0f32, range_m in proptest::collection::vec(0.6..9.0f32, 1..300),
        ) {
            let frame = Frame::of_scan(&scan(first_rad, &range_m), 0.0, 0.5);
            let width_deg = (range_m.len() as f64 * 0.02).to_degrees().min(360.0);
            // A sector counts when it is touched: up to one more at either end.
            prop_assert!(frame.covered.width_deg() >= width_deg - 0.01);
            prop_assert!(frame.covered.width_deg() <= width_deg + 10.0);
            let nearest_m = range_m.iter().copied().fold(f32::INFINITY, f32::min);
            let said_m = frame.nearest_m.iter().copied().fold(f32::NAN, f32::min);
            prop_assert!((said_m - nearest_m).abs() < 1e-4);
            prop_assert!(frame.own.is_empty());
            for sector in 0..SECTORS {
                prop_assert_eq!(frame.covered.0[sector], !frame.nearest_m[sector].is_nan());
            }
        }

        #[test]
        fn a_ray_of_a_cloud_counts_for_its_sector_if_it_is_level(
            bearing_rad in -3.1..3.1f64, elevation_deg in -89.0..89.0f64, range_m in 0.6..9.0f64,
        ) {
            let (sin, cos) = elevation_deg.to_radians().sin_cos();
            let origin = Point::new(0.1, -0.05, 0.2);
            let mut cloud = PointCloud::boxed();
            cloud.origin = origin;
            cloud.range_max_m = 10.0;
            cloud.push(CloudPoint {
                forward_m: (origin.x_m + range_m * cos * bearing_rad.cos()) as f32,
                right_m: (origin.y_m + range_m * cos * bearing_rad.sin()) as f32,
                down_m: (origin.z_m - range_m * sin) as f32,
                kind: Coded::new(RayKind::Hit),
                ..CloudPoint::default()
            });
            let frame = Frame::of_cloud(&cloud, 0.3);
            let end = cloud.points()[0];
            let expected = sector_of(f64::from(end.right_m).atan2(f64::from(end.forward_m)));
            prop_assume!((elevation_deg.abs() - 10.0).abs() > 0.01);
            if elevation_deg.abs() < 10.0 {
                prop_assert_eq!(frame.covered.each().collect::<Vec<_>>(), vec![expected]);
            } else {
                prop_assert!(frame.covered.is_empty());
            }
            let [low_deg, high_deg] = frame.elevation_deg.unwrap();
            prop_assert!((low_deg - elevation_deg).abs() < 1e-3 && low_deg == high_deg);
        }
    }

    #[test]
    fn what_says_the_same_has_the_same_fingerprint_and_what_does_not_has_another() {
        let of = |range_m: &[f32]| Frame::of_scan(&scan(0.0, range_m), 0.0, 0.5).fingerprint;
        assert_eq!(of(&[1.0, 2.0]), of(&[1.0, 2.0]));
        assert_ne!(of(&[1.0, 2.0]), of(&[2.0, 1.0]));
        assert_ne!(of(&[1.0, 2.0]), of(&[1.0, 2.000_000_2]));
    }

    #[test]
    fn what_is_as_near_as_the_vehicle_is_its_own() {
        let frame = Frame::of_scan(&scan(-0.01, &[0.4]), 0.0, 0.5);
        assert!(frame.own.0[0]);
        let mut ahead = scan(-0.01, &[0.4]);
        ahead.origin = Point::new(0.3, 0.0, 0.0);
        assert!(
            Frame::of_scan(&ahead, 0.0, 0.5).own.is_empty(),
            "0.7 m from the centre"
        );
    }
}
