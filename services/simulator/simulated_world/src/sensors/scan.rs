//! Sensors that fill a range scan: a rotating planar lidar, and a rangefinder with one wide beam.

use super::error::SensorError;
use super::head::{Answer, Beam, Head, HeadDefaults};
use super::pose::{Pose, PoseCursor};
use super::spec::SensorSpec;
use crate::world::{Hit, World};
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{RangeScan, SCAN_BEAMS};
use nalgebra::Vector3;
use std::f64::consts::FRAC_PI_4;

pub(super) const LIDAR_RATE_HZ: f64 = 10.0;
pub(super) const RANGEFINDER_RATE_HZ: f64 = 20.0;

/// Rays a rangefinder's cone is made of.
const CONE_RAYS: usize = 9;

/// Writes a scan's fixed part; all ranges unknown.
fn begin_scan(head: &Head, beams: usize, scan: &mut RangeScan) {
    *scan = RangeScan {
        origin: head.origin(),
        mounting: head.mounting(),
        range_min_m: head.range_min_m as f32,
        range_max_m: head.range_max_m as f32,
        beams: beams as u32,
        ..RangeScan::default()
    };
}

/// A rotating lidar: one turn per frame, clockwise seen from above, beam by beam.
#[derive(Clone, Debug)]
pub(super) struct Lidar2d {
    head: Head,
    beam: Beam,
    beams: usize,
    angle_first_rad: f32,
    angle_step_rad: f32,
    /// Directions of the beams in the body.
    directions: Vec<Vector3<f64>>,
}

impl Lidar2d {
    pub fn new(spec: &SensorSpec, rig_seed: u64) -> Result<Self, SensorError> {
        let head = Head::new(
            spec,
            rig_seed,
            &HeadDefaults {
                range_m: [0.1, 12.0],
                sigma_m: 0.01,
                sigma_ratio: 0.0,
                sigma_per_m: 0.0,
                dropout: 0.0,
            },
        )?;
        let beams = spec.count("beams", spec.beams, 360, SCAN_BEAMS)?;
        let fov_rad = spec.fov_horizontal_rad(360.0, [1.0, 360.0])?;
        let step_rad = fov_rad / beams as f64;
        // Beams look where the sample's own numbers say, to the last bit a reader can know.
        let angle_first_rad = (-0.5 * (fov_rad - step_rad)) as f32;
        let angle_step_rad = step_rad as f32;
        let directions = (0..beams)
            .map(|beam| {
                let angle_rad = f64::from(angle_first_rad) + beam as f64 * f64::from(angle_step_rad);
                head.to_body(&Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0))
            })
            .collect();
        Ok(Self {
            beam: Beam::new(spec)?,
            beams,
            angle_first_rad,
            angle_step_rad,
            directions,
            head,
        })
    }

    /// One turn from `begin` to `end`, each beam from the pose at its own time.
    pub fn render(
        &mut self,
        world: &World,
        poses: &mut PoseCursor<'_>,
        begin: Timestamp,
        end: Timestamp,
        scan: &mut RangeScan,
    ) {
        begin_scan(&self.head, self.beams, scan);
        let interval_s = end.seconds_since(begin) / self.beams as f64;
        scan.first_beam = begin;
        scan.beam_interval_s = interval_s as f32;
        scan.angle_first_rad = self.angle_first_rad;
        scan.angle_step_rad = self.angle_step_rad;
        scan.beam_width_rad = self.beam.width_rad as f32;
        scan.range_sigma_m = self.head.sigma_at_m(self.head.range_max_m) as f32;
        for (index, (direction, range_m)) in self.directions.iter().zip(&mut scan.range_m).enumerate() {
            let view = self
                .head
                .view(&poses.at(begin.plus_seconds(index as f64 * interval_s)));
            let hit = self.head.cast_beam(world, &view, direction, &self.beam);
            *range_m = answer_m(&mut self.head, world, hit.as_ref());
        }
    }
}

/// A rangefinder: the nearest thing in a cone around the sensor's forward axis.
#[derive(Clone, Debug)]
pub(super) struct Rangefinder {
    head: Head,
    width_rad: f64,
    /// Directions of the rays in the body: the axis, and eight around it, alternately at the whole and the half of
    /// the cone's half angle, so that neither its rim nor its inside goes unseen.
    directions: [Vector3<f64>; CONE_RAYS],
}

impl Rangefinder {
    pub fn new(spec: &SensorSpec, rig_seed: u64) -> Result<Self, SensorError> {
        let head = Head::new(
            spec,
            rig_seed,
            &HeadDefaults {
                range_m: [0.1, 8.0],
                sigma_m: 0.02,
                sigma_ratio: 0.01,
                sigma_per_m: 0.0,
                dropout: 0.01,
            },
        )?;
        let width_rad = spec.angle_rad("beam_width_deg", spec.beam_width_deg, 27.0, [0.0, 90.0])?;
        let directions = std::array::from_fn(|ray| {
            let share = match ray {
                0 => 0.0,
                _ if ray % 2 == 0 => 0.5,
                _ => 1.0,
            };
            let (around, off) = (ray as f64 * FRAC_PI_4, 0.5 * width_rad * share);
            head.to_body(&Vector3::new(
                off.cos(),
                off.sin() * around.cos(),
                off.sin() * around.sin(),
            ))
        });
        Ok(Self {
            head,
            width_rad,
            directions,
        })
    }

    /// One measurement, taken at `time`.
    pub fn render(&mut self, world: &World, pose: &Pose, time: Timestamp, scan: &mut RangeScan) {
        begin_scan(&self.head, 1, scan);
        let view = self.head.view(pose);
        let nearest = self
            .directions
            .iter()
            .filter_map(|direction| self.head.cast(world, &view, direction))
            .min_by(|one, other| one.range_m.total_cmp(&other.range_m));
        scan.first_beam = time;
        scan.beam_width_rad = self.width_rad as f32;
        scan.range_sigma_m =
            self.head
                .sigma_at_m(nearest.map_or(self.head.range_max_m, |hit| hit.range_m)) as f32;
        scan.range_m[0] = answer_m(&mut self.head, world, nearest.as_ref());
    }
}

/// A beam's entry in the scan (m): NaN for a drop-out, infinity for nothing within range.
fn answer_m(head: &mut Head, world: &World, hit: Option<&Hit>) -> f32 {
    match head.answer(world, hit) {
        _ if head.drops_out() => f32::NAN,
        Answer::Hit(range_m) => head.measured_m(range_m) as f32,
        Answer::Clear => f32::INFINITY,
        Answer::Unknown => f32::NAN,
    }
}
