//! Where a lidar's rays point, one after the other.
//!
//! | pattern | directions |
//! |---|---|
//! | [`Pattern::Even`] | the additive recurrence `R2` (M. Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018): `(i a mod 1, i a^2 mod 1)` with `1 / a` the plastic number 1.3247..., as azimuth and sine of the elevation, which spreads them evenly over the solid angle (Archimedes' hat-box theorem) |
//! | [`Pattern::Rings`] | columns of rings that turn; where a turn begins differs from frame to frame, as with a sensor whose turn is not in phase with its frames |
//! | [`Pattern::Swing`] | four lines a fifth of a swing apart that turn once a frame and swing 47.3 times meanwhile |
//! | [`Pattern::Rosette`] | two prisms: the sum of two turning deflections of the same size (Liu, Wu, Zhang, "Low-cost Retina-like Robotic Lidars Based on Incommensurable Scanning", IEEE/ASME T-Mech 2022) |
//!
//! The index runs on over all sweeps, in exact 64-bit fractions: no frame is like another.

use super::error::SensorError;
use super::head::Head;
use super::products::Pattern;
use super::spec::SensorSpec;
use jink_shared_types::ranges::CLOUD_POINTS;
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// 2^64 as a number: turns fractions of a turn into 64-bit fractions.
const FULL: f64 = 18_446_744_073_709_551_616.0;
/// `a` and `a^2` of the recurrence as 64-bit fractions.
const EVEN_STEP: [u64; 2] = [
    (0.754_877_666_246_692_7 * FULL) as u64,
    (0.569_840_290_998_053_2 * FULL) as u64,
];
/// Places of the table of azimuths.
const AZIMUTHS: usize = 1024;
/// Lines of a [`Pattern::Swing`], and swings in a turn.
const LINES: u64 = 4;
const SWINGS: f64 = 47.309_017;
/// Turns of the two prisms in a frame of a tenth of a second: 7,294 and 4,664 rpm in opposite directions (Livox Mid-40).
const PRISMS: [f64; 2] = [12.156_7, -7.773_3];

/// The directions of one lidar.
#[derive(Clone, Debug)]
pub(super) struct Directions {
    pattern: Pattern,
    /// Rays in a frame.
    rays: u64,
    /// Rays in a column of a pattern with rings.
    rings: u64,
    /// Sine and cosine of the azimuth at each [`AZIMUTHS`]th of the span.
    azimuths: Vec<[f64; 2]>,
    azimuth_span_rad: f64,
    elevation_rad: [f64; 2],
    /// Sine of the lowest elevation and its distance to the highest.
    sine_first: f64,
    sine_span: f64,
    /// Sine and cosine of each ring's elevation.
    ring_elevations: Vec<[f64; 2]>,
    /// Where the sequence stands, as 64-bit fractions, and what a step adds.
    place: [u64; 2],
    step: [u64; 2],
    /// Rays so far in this column.
    in_column: u64,
}

impl Directions {
    /// Those of `spec`; where they begin is drawn from the random numbers of `head`.
    pub fn new(spec: &SensorSpec, pattern: Pattern, head: &mut Head) -> Result<Self, SensorError> {
        let (low, high) = ("elevation_min_deg", "elevation_max_deg");
        let lowest_rad = spec.angle_rad(low, spec.elevation_min_deg, -45.0, [-90.0, 90.0])?;
        let highest_rad = spec.angle_rad(high, spec.elevation_max_deg, 60.0, [-90.0, 90.0])?;
        spec.ordered([low, high], lowest_rad, highest_rad)?;
        let azimuth_span_rad = spec.fov_horizontal_rad(360.0, [1.0, 360.0])?;
        let pattern = if spec.rings.is_some() {
            Pattern::Rings
        } else {
            pattern
        };
        let rings = spec.count("rings", spec.rings, 1, 128)?;
        let beams = spec.count("beams", spec.beams, 1_024, CLOUD_POINTS / rings)?;
        let rays = match pattern {
            Pattern::Rings => rings * beams,
            _ => spec.count("rays", spec.rays, 20_000, CLOUD_POINTS)?,
        };
        let place = [head.random.bits(), head.random.bits()];
        let part = |turns: f64| (turns.rem_euclid(1.0) * FULL) as u64;
        let per_ray = 1.0 / rays as f64;
        let ring_rad = |ring: usize| {
            let share = if rings > 1 {
                ring as f64 / (rings - 1) as f64
            } else {
                0.5
            };
            highest_rad + (lowest_rad - highest_rad) * share
        };
        Ok(Self {
            pattern,
            rays: rays as u64,
            rings: rings as u64,
            azimuths: (0..AZIMUTHS)
                .map(|part| azimuth_span_rad * (part as f64 / AZIMUTHS as f64 - 0.5))
                .map(|azimuth_rad| azimuth_rad.sin_cos().into())
                .collect(),
            azimuth_span_rad,
            elevation_rad: [lowest_rad, highest_rad],
            sine_first: lowest_rad.sin(),
            sine_span: highest_rad.sin() - lowest_rad.sin(),
            ring_elevations: (0..rings).map(|ring| ring_rad(ring).sin_cos().into()).collect(),
            place,
            step: match pattern {
                Pattern::Even => EVEN_STEP,
                // A little more than a turn a frame, so that columns do not fall on those of the frame before.
                Pattern::Rings => [part(rings as f64 * per_ray * (1.0 + 0.381_966 * per_ray)), 0],
                Pattern::Swing => [
                    part(LINES as f64 * per_ray * 1.003_819_66),
                    part(LINES as f64 * per_ray * SWINGS),
                ],
                Pattern::Rosette => PRISMS.map(|turns| part(turns * per_ray)),
            },
            in_column: 0,
        })
    }

    /// Rays in a frame.
    pub fn rays(&self) -> u64 {
        self.rays
    }

    /// The next direction, in the sensor's frame.
    pub fn next(&mut self) -> Vector3<f64> {
        match self.pattern {
            Pattern::Even => {
                self.advance();
                let [u, v] = self.fractions();
                self.toward_sine(u, self.sine_first + self.sine_span * v)
            }
            Pattern::Rings => {
                let ring = self.in_column;
                self.next_in_column(self.rings);
                let [sine, cosine] = self.ring_elevations[ring as usize];
                let [azimuth_sine, azimuth_cosine] = self.azimuth(self.fractions()[0]);
                Vector3::new(cosine * azimuth_cosine, cosine * azimuth_sine, -sine)
            }
            Pattern::Swing => {
                let line = self.in_column;
                self.next_in_column(LINES);
                let [u, v] = self.fractions();
                // A triangle: up and down at the same pace, so that the lines are as dense at the ends as in the middle.
                let swing = (2.0 * (v + line as f64 / 5.0).fract() - 1.0).abs();
                let [lowest_rad, highest_rad] = self.elevation_rad;
                let up_rad = lowest_rad + (highest_rad - lowest_rad) * swing;
                let turned = (u + line as f64 / (LINES as f64 * SWINGS * 2.0)).fract();
                self.toward_sine(turned, up_rad.sin())
            }
            Pattern::Rosette => {
                self.advance();
                let [(a_sine, a_cosine), (b_sine, b_cosine)] =
                    self.fractions().map(|turns| (TAU * turns).sin_cos());
                let azimuth_rad = 0.25 * self.azimuth_span_rad * (a_cosine + b_cosine);
                let [lowest_rad, highest_rad] = self.elevation_rad;
                let up_rad =
                    0.5 * (lowest_rad + highest_rad) + 0.25 * (highest_rad - lowest_rad) * (a_sine + b_sine);
                let (sine, cosine) = up_rad.sin_cos();
                Vector3::new(cosine * azimuth_rad.cos(), cosine * azimuth_rad.sin(), -sine)
            }
        }
    }

    /// The next ray of a column of `most`, the next column after the last one.
    fn next_in_column(&mut self, most: u64) {
        self.in_column += 1;
        if self.in_column == most {
            self.in_column = 0;
            self.advance();
        }
    }

    fn advance(&mut self) {
        self.place = [0, 1].map(|i| self.place[i].wrapping_add(self.step[i]));
    }

    fn fractions(&self) -> [f64; 2] {
        self.place.map(|fraction| fraction as f64 * (1.0 / FULL))
    }

    fn toward_sine(&self, u: f64, up: f64) -> Vector3<f64> {
        let [sine, cosine] = self.azimuth(u);
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
}

#[cfg(test)]
mod tests {
    use super::Directions;
    use crate::sensors::head::{Head, HeadDefaults};
    use crate::sensors::products::{Pattern, filled, product};
    use crate::sensors::{SensorKind, SensorSpec};
    use proptest::prelude::*;

    fn directions(spec: &SensorSpec) -> Directions {
        let pattern = product(spec).map_or(Pattern::Even, |product| product.pattern);
        let defaults = HeadDefaults {
            range_m: [0.1, 12.0],
            sigma_m: 0.0,
            sigma_ratio: 0.0,
            sigma_per_m: 0.0,
            dropout: 0.0,
        };
        let spec = filled(spec);
        let mut head = Head::new(&spec, 1, &defaults).unwrap();
        Directions::new(&spec, pattern, &mut head).unwrap()
    }

    fn of_product(model: &str) -> Directions {
        directions(&SensorSpec {
            model: Some(model.to_owned()),
            ..SensorSpec::new("lidar", SensorKind::Lidar3d)
        })
    }

    proptest! {
        #[test]
        fn azimuths_from_the_table_are_those_of_the_functions(u in 0.0..1.0f64, span_deg in 1.0..360.0f64) {
            let lidar = directions(&SensorSpec {
                fov_horizontal_deg: Some(span_deg),
                ..SensorSpec::new("lidar", SensorKind::Lidar3d)
            });
            let azimuth_rad = span_deg.to_radians() * (u - 0.5);
            let [sine, cosine] = lidar.azimuth(u);
            prop_assert!((sine - azimuth_rad.sin()).abs() < 1e-14);
            prop_assert!((cosine - azimuth_rad.cos()).abs() < 1e-14);
        }
    }

    #[test]
    fn a_product_sees_what_its_data_sheet_says_and_nothing_else() {
        for (model, lowest_deg, highest_deg, aside_deg) in [
            ("livox_mid360", -7.0, 52.0, 180.0),
            ("livox_avia", -38.6, 38.6, 35.2),
            ("ouster_os0", -45.0, 45.0, 180.0),
            ("ouster_os1", -22.5, 22.5, 180.0),
            ("vlp16", -15.0, 15.0, 180.0),
        ] {
            let mut lidar = of_product(model);
            let (mut low, mut high, mut aside) = (90.0f64, -90.0f64, 0.0f64);
            for _ in 0..10 * lidar.rays() {
                let direction = lidar.next();
                assert!((direction.norm() - 1.0).abs() < 1e-9);
                let up_deg = (-direction.z).asin().to_degrees();
                (low, high) = (low.min(up_deg), high.max(up_deg));
                aside = aside.max(direction.y.atan2(direction.x).abs().to_degrees());
            }
            for (is, should) in [(low, lowest_deg), (high, highest_deg), (aside, aside_deg)] {
                assert!((is - should).abs() < 0.6, "{model}: {is} instead of {should} deg");
            }
        }
    }

    #[test]
    fn no_frame_is_like_the_one_before_and_a_second_of_them_leaves_no_hole() {
        for model in ["livox_mid360", "ouster_os1", "vlp16"] {
            let mut lidar = of_product(model);
            let rays = lidar.rays();
            let first = lidar.next();
            (1..rays).for_each(|_| {
                lidar.next();
            });
            assert!((lidar.next() - first).norm() > 1e-6, "{model}");
        }
        // One degree by one degree.
        let mut lidar = of_product("livox_mid360");
        let mut seen = vec![false; 360 * 57];
        for _ in 0..10 * lidar.rays() {
            let direction = lidar.next();
            let up_deg = (-direction.z).asin().to_degrees();
            let azimuth_deg = direction.y.atan2(direction.x).to_degrees().rem_euclid(360.0);
            let (row, column) = ((up_deg + 6.0).floor(), azimuth_deg.floor().min(359.0));
            if (0.0..57.0).contains(&row) {
                seen[row as usize * 360 + column as usize] = true;
            }
        }
        let holes = seen.iter().filter(|seen| !**seen).count();
        assert!(holes * 100 < seen.len(), "{holes} of {}", seen.len());
    }
}
