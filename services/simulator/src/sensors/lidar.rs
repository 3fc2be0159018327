//! A 3-D lidar whose pattern does not repeat: every sweep fills the gaps of the ones before.
//!
//! Directions come from the additive recurrence `R2` (M. Roberts, "The Unreasonable Effectiveness of Quasirandom
//! Sequences", 2018): `(i a mod 1, i a^2 mod 1)` with `1 / a` the plastic number 1.3247..., the two-dimensional
//! counterpart of the golden ratio. The first coordinate is the azimuth, the second the sine of the elevation,
//! which spreads the rays evenly over the solid angle (Archimedes' hat-box theorem). The index runs on over all
//! sweeps, in exact 64-bit fractions.

use super::error::SensorError;
use super::head::{Answer, Beam, Head, HeadDefaults};
use super::pose::PoseCursor;
use super::spec::SensorSpec;
use crate::world::World;
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{CLOUD_POINTS, CloudPoint, PointCloud};
use nalgebra::Vector3;

/// Time unit of a point's offset (ns).
const TICK_NS: u64 = 10_000;

/// 2^64 as a number: turns fractions of a turn into 64-bit fractions.
const FULL: f64 = 18_446_744_073_709_551_616.0;

/// `a` and `a^2` as 64-bit fractions.
const STEP: [u64; 2] = [
    (0.754_877_666_246_692_7 * FULL) as u64,
    (0.569_840_290_998_053_2 * FULL) as u64,
];

/// Places of the table of azimuths.
const AZIMUTHS: usize = 1024;

pub(super) const DEFAULT_RATE_HZ: f64 = 10.0;

#[derive(Clone, Debug)]
pub(super) struct Lidar3d {
    head: Head,
    beam: Beam,
    rays: u64,
    /// Sine and cosine of the azimuth at each [`AZIMUTHS`]th of the span.
    azimuths: Vec<[f64; 2]>,
    azimuth_span_rad: f64,
    /// Sine of the lowest elevation and its distance to the highest.
    sine_first: f64,
    sine_span: f64,
    /// Where the sequence stands, as 64-bit fractions.
    place: [u64; 2],
    /// The sweep under way: when it began, and what was measured so far.
    sweep_begin: Timestamp,
    sweep: Vec<CloudPoint>,
}

impl Lidar3d {
    pub fn new(spec: &SensorSpec, rig_seed: u64) -> Result<Self, SensorError> {
        let mut head = Head::new(
            spec,
            rig_seed,
            &HeadDefaults {
                range_m: [0.1, 12.0],
                sigma_m: 0.02,
                sigma_ratio: 0.0,
                sigma_per_m: 0.0,
                dropout: 0.0,
            },
        )?;
        let (low, high) = ("elevation_min_deg", "elevation_max_deg");
        let elevation_min_rad = spec.angle_rad(low, spec.elevation_min_deg, -45.0, [-90.0, 90.0])?;
        let elevation_max_rad = spec.angle_rad(high, spec.elevation_max_deg, 60.0, [-90.0, 90.0])?;
        spec.ordered([low, high], elevation_min_rad, elevation_max_rad)?;
        let azimuth_span_rad = spec.fov_horizontal_rad(360.0, [1.0, 360.0])?;
        let rays = spec.count("rays", spec.rays, 20_000, CLOUD_POINTS)?;
        Ok(Self {
            beam: Beam::new(spec)?,
            rays: rays as u64,
            sweep_begin: Timestamp::NEVER,
            sweep: Vec::with_capacity(rays),
            azimuths: (0..AZIMUTHS)
                .map(|part| azimuth_span_rad * (part as f64 / AZIMUTHS as f64 - 0.5))
                .map(|azimuth_rad| azimuth_rad.sin_cos().into())
                .collect(),
            azimuth_span_rad,
            sine_first: elevation_min_rad.sin(),
            sine_span: elevation_max_rad.sin() - elevation_min_rad.sin(),
            place: [head.random.bits(), head.random.bits()],
            head,
        })
    }

    /// The next direction of the pattern, in the sensor's frame.
    fn next_direction(&mut self) -> Vector3<f64> {
        self.place = [
            self.place[0].wrapping_add(STEP[0]),
            self.place[1].wrapping_add(STEP[1]),
        ];
        let [u, v] = self.place.map(|fraction| fraction as f64 * (1.0 / FULL));
        let [sine, cosine] = self.azimuth(u);
        let up = self.sine_first + self.sine_span * v;
        let level = (1.0 - up * up).max(0.0).sqrt();
        Vector3::new(level * cosine, level * sine, -up)
    }

    /// Sine and cosine of the azimuth at part `u` (0 to 1) of the span: from the table, by addition of an angle below 0.0062 rad, of
    /// which five terms of the series are exact. A twentieth of a campaign's time was spent on these two functions.
    fn azimuth(&self, u: f64) -> [f64; 2] {
        let part = u * AZIMUTHS as f64;
        let index = (part as usize).min(AZIMUTHS - 1);
        let [sine, cosine] = self.azimuths[index];
        let rest = self.azimuth_span_rad * (part - index as f64) / AZIMUTHS as f64;
        let square = rest * rest;
        let rest_sine = rest * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0)));
        let rest_cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0)));
        [
            sine * rest_cosine + cosine * rest_sine,
            cosine * rest_cosine - sine * rest_sine,
        ]
    }

    /// One sweep from `begin` to `end`. Rays are spread evenly over it, each from the pose at its own time as told
    /// by its offset.
    pub fn render(
        &mut self,
        world: &World,
        poses: &mut PoseCursor<'_>,
        begin: Timestamp,
        end: Timestamp,
        cloud: &mut PointCloud,
    ) {
        self.advance(world, poses, [begin, end], end);
        self.head.begin_cloud(cloud);
        cloud.first_point = begin;
        for point in &self.sweep {
            cloud.push(*point);
        }
        self.sweep.clear();
    }

    /// Measures the rays of the sweep over `span` that are due by `until` and were not measured yet: a real lidar, too,
    /// has most of a sweep behind it when the sweep ends.
    pub fn advance(
        &mut self,
        world: &World,
        poses: &mut PoseCursor<'_>,
        span: [Timestamp; 2],
        until: Timestamp,
    ) {
        let [begin, end] = span;
        if self.sweep_begin != begin {
            self.sweep_begin = begin;
            self.sweep.clear();
        }
        let ticks = end.ns_since(begin) / TICK_NS;
        let due_ticks = until.min(end).ns_since(begin) / TICK_NS;
        let mut view = None;
        for ray in self.sweep.len() as u64..self.rays {
            let tick = ray * ticks / self.rays;
            if tick > due_ticks {
                break;
            }
            let view = match &view {
                Some((at, view)) if *at == tick => view,
                _ => {
                    let time = Timestamp::from_ns(begin.ns + tick * TICK_NS);
                    &view.insert((tick, self.head.view(&poses.at(time)))).1
                }
            };
            let direction = self.next_direction();
            let direction = self.head.to_body(&direction);
            let answer = match self.head.cast_beam(world, view, &direction, &self.beam) {
                _ if self.head.drops_out() => Answer::Unknown,
                None => Answer::Clear,
                // Too near to be measured: that something is there is lost, so nothing may be called clear.
                Some(hit) if hit.range_m < self.head.range_min_m => Answer::Unknown,
                Some(hit) => Answer::Hit(self.head.measured_m(hit.range_m)),
            };
            self.sweep.push(self.head.point(&direction, answer, tick as u16));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Lidar3d;
    use crate::sensors::{SensorKind, SensorSpec};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn azimuths_from_the_table_are_those_of_the_functions(u in 0.0..1.0f64, span_deg in 1.0..360.0f64) {
            let spec = SensorSpec {
                fov_horizontal_deg: Some(span_deg),
                ..SensorSpec::new("lidar", SensorKind::Lidar3d)
            };
            let lidar = Lidar3d::new(&spec, 1).unwrap();
            let azimuth_rad = span_deg.to_radians() * (u - 0.5);
            let [sine, cosine] = lidar.azimuth(u);
            prop_assert!((sine - azimuth_rad.sin()).abs() < 1e-14);
            prop_assert!((cosine - azimuth_rad.cos()).abs() < 1e-14);
        }
    }
}
