//! Measurements of a scanning device: partial sweeps, each published as soon as it is complete.
//!
//! The beam goes to and fro. A part ends when the beam enters the next eighth of the turn, when it turns back, or after
//! a fixed time: consumers need not wait for the whole sweep, and keep what a part does not cover. Ends at fixed
//! directions let a part of one sweep replace the same part of the sweep before.
//!
//! A scan has its beams at equal angles. Directions are rounded to half a degree (at 10 m less than 5 cm off); of
//! several measurements in one such step the nearest counts, and a step without one is unknown. The beam turns at a
//! constant speed, so that the times of the beams are as evenly spaced as their angles.

use crate::devices::Range;
use jink_shared_types::Timestamp;

/// Angle between the beams of a part (deg).
const STEP_DEG: f32 = 0.5;
/// Steps in an eighth of a turn.
const STEPS: usize = 90;

/// Where one part stands.
#[derive(Clone, Copy, Debug)]
struct OpenPart {
    /// Number of its eighth, counted from straight ahead clockwise.
    eighth: i32,
    /// Step of the first and of the latest answer in the eighth.
    first_step: usize,
    last_step: usize,
    /// Lowest and highest step so far.
    low: usize,
    high: usize,
    first: Timestamp,
    last: Timestamp,
}

impl OpenPart {
    /// Whether the step goes against the direction of the part so far.
    fn turns_back_at(&self, step: usize) -> bool {
        (self.last_step > self.first_step && step < self.last_step)
            || (self.last_step < self.first_step && step > self.last_step)
    }
}

/// The part that is being collected.
#[derive(Clone, Debug)]
pub struct ScanAssembler {
    part_s: f64,
    part: Option<OpenPart>,
    /// Ranges (m) of the steps of the eighth.
    range_m: [f32; STEPS],
    /// The finished part in the order in which it was measured.
    out_m: [f32; STEPS],
}

/// A finished part.
#[derive(Clone, Copy, Debug)]
pub struct ScanPart<'a> {
    /// When its first beam was measured.
    pub first_beam: Timestamp,
    /// When its last beam was measured.
    pub capture: Timestamp,
    /// Direction of its first beam (rad).
    pub angle_first_rad: f32,
    /// Angle between its beams (rad).
    pub angle_step_rad: f32,
    /// Its ranges (m).
    pub range_m: &'a [f32],
}

impl ScanAssembler {
    /// Parts of at most `part_s`.
    pub fn new(part_s: f64) -> Self {
        Self {
            part_s,
            part: None,
            range_m: [f32::NAN; STEPS],
            out_m: [f32::NAN; STEPS],
        }
    }

    /// Whether a measurement at `yaw_rad` does not belong to the present part any more: then [`Self::close`] comes
    /// first.
    pub fn ends_before(&self, time: Timestamp, yaw_rad: f32) -> bool {
        let Some(part) = &self.part else {
            return false;
        };
        let (eighth, step) = place(yaw_rad);
        eighth != part.eighth || part.turns_back_at(step) || time >= self.end_of(part)
    }

    /// Adds a measurement in direction `yaw_rad` made at `time`.
    pub fn take(&mut self, time: Timestamp, yaw_rad: f32, range: Range) {
        let (eighth, step) = place(yaw_rad);
        let part = self.part.get_or_insert_with(|| {
            self.range_m.fill(f32::NAN);
            OpenPart {
                eighth,
                first_step: step,
                last_step: step,
                low: step,
                high: step,
                first: time,
                last: time,
            }
        });
        part.last_step = step;
        part.low = part.low.min(step);
        part.high = part.high.max(step);
        part.last = time;
        let cell = &mut self.range_m[step];
        // NaN, nothing known yet, is nearer than nothing.
        *cell = cell.min(range.metres());
    }

    /// When the part ends at the latest; never while there is none.
    pub fn due(&self) -> Timestamp {
        self.part
            .as_ref()
            .map_or(Timestamp::from_ns(u64::MAX), |part| self.end_of(part))
    }

    /// Ends the part, if there is one.
    pub fn close(&mut self) -> Option<ScanPart<'_>> {
        let part = self.part.take()?;
        // A lone beam would look like a rangefinder that watches one direction all the time.
        let (low, high) = match (part.low, part.high) {
            (low, high) if low < high => (low, high),
            (0, _) => (0, 1),
            (low, _) => (low - 1, low),
        };
        let steps = &self.range_m[low..=high];
        let out = &mut self.out_m[..steps.len()];
        out.copy_from_slice(steps);
        let clockwise = part.last_step >= part.first_step;
        let (begin, way) = if clockwise { (low, 1.0) } else { (high, -1.0) };
        if !clockwise {
            out.reverse();
        }
        let centre_deg = (part.eighth * STEPS as i32) as f32 + begin as f32 + 0.5;
        Some(ScanPart {
            first_beam: part.first,
            capture: part.last,
            angle_first_rad: (centre_deg * STEP_DEG).to_radians(),
            angle_step_rad: way * STEP_DEG.to_radians(),
            range_m: out,
        })
    }

    /// The line was interrupted.
    pub fn clear(&mut self) {
        self.part = None;
    }

    fn end_of(&self, part: &OpenPart) -> Timestamp {
        part.first.plus_seconds(self.part_s)
    }
}

/// Eighth of the turn, and step in it, of a direction.
fn place(yaw_rad: f32) -> (i32, usize) {
    let steps = (yaw_rad.to_degrees() / STEP_DEG).floor() as i32;
    let eighth = steps.div_euclid(STEPS as i32);
    (eighth, steps.rem_euclid(STEPS as i32) as usize)
}

#[cfg(test)]
mod tests {
    use super::ScanAssembler;
    use crate::devices::Range::{self, Clear, Hit, Unknown};
    use jink_shared_types::Timestamp;
    use proptest::prelude::*;

    /// A finished part as values.
    #[derive(Clone, Debug)]
    struct CollectedPart {
        first: Timestamp,
        last: Timestamp,
        /// Directions (deg) and ranges (m).
        beams: Vec<(f32, f32)>,
    }

    fn collect(answers: &[(u64, f32, Range)], part_s: f64) -> Vec<CollectedPart> {
        let mut sweep = ScanAssembler::new(part_s);
        let mut parts = Vec::new();
        let mut close = |sweep: &mut ScanAssembler| {
            if let Some(part) = sweep.close() {
                let angle_deg =
                    |beam| (part.angle_first_rad + beam as f32 * part.angle_step_rad).to_degrees();
                let beams = part.range_m.iter().enumerate();
                parts.push(CollectedPart {
                    first: part.first_beam,
                    last: part.capture,
                    beams: beams.map(|(beam, range_m)| (angle_deg(beam), *range_m)).collect(),
                });
            }
        };
        for (us, yaw_deg, range) in answers {
            let time = Timestamp::from_ns(1_000_000_000 + us * 1_000);
            if sweep.ends_before(time, yaw_deg.to_radians()) {
                close(&mut sweep);
            }
            sweep.take(time, yaw_deg.to_radians(), *range);
        }
        close(&mut sweep);
        parts
    }

    /// To and fro between both limits at 1600 deg/s, an answer every millisecond.
    fn to_and_fro(low_deg: f32, high_deg: f32, count: u64) -> Vec<(u64, f32, Range)> {
        let span_deg = high_deg - low_deg;
        (0..count)
            .map(|index| {
                let way_deg = (index as f32 * 1.6) % (2.0 * span_deg);
                let yaw_deg = low_deg
                    + if way_deg < span_deg {
                        way_deg
                    } else {
                        2.0 * span_deg - way_deg
                    };
                (index * 1_000, yaw_deg, Hit(index as f32 * 0.001))
            })
            .collect()
    }

    #[test]
    fn every_answer_of_a_sweep_is_in_a_part_where_and_when_it_was_measured() {
        let answers = to_and_fro(-160.0, 160.0, 1_000);
        let parts = collect(&answers, 0.05);
        let mut found = 0;
        for part in &parts {
            assert!(part.last.seconds_since(part.first) <= 0.05);
            let steps = (part.beams.len() - 1) as f64;
            for (beam, (angle_deg, range_m)) in
                part.beams.iter().enumerate().filter(|(_, beam)| !beam.1.is_nan())
            {
                let (us, yaw_deg, _) = answers[(range_m * 1000.0).round() as usize];
                assert!((yaw_deg - angle_deg).abs() <= 0.26, "{yaw_deg} {angle_deg}");
                let time_s = part.last.seconds_since(part.first) * beam as f64 / steps;
                let true_s = Timestamp::from_ns(1_000_000_000 + us * 1_000).seconds_since(part.first);
                assert!((time_s - true_s).abs() < 1e-3, "{time_s} {true_s}");
                found += 1;
            }
        }
        assert_eq!(found, answers.len());
    }

    #[test]
    fn a_part_ends_at_an_eighth_when_the_beam_turns_back_and_in_time() {
        let parts = collect(&to_and_fro(-20.0, 20.0, 50), 1.0);
        let ends: Vec<(f32, f32)> = parts
            .iter()
            .map(|part| {
                (
                    part.beams[0].0.round(),
                    part.beams[part.beams.len() - 1].0.round(),
                )
            })
            .collect();
        assert_eq!(ends[..3], [(-20.0, -1.0), (1.0, 20.0), (18.0, 1.0)]);
        let slow: Vec<(u64, f32, Range)> = (0..20u16)
            .map(|index| (u64::from(index) * 10_000, f32::from(index), Clear))
            .collect();
        assert_eq!(collect(&slow, 0.05).len(), 4);
    }

    #[test]
    fn of_several_answers_in_one_direction_the_nearest_counts() {
        for (answers, expected_m) in [
            ([Clear, Hit(3.0), Hit(2.0)], 2.0),
            ([Unknown, Clear, Unknown], f32::INFINITY),
            ([Hit(1.0), Unknown, Clear], 1.0),
        ] {
            let answers: Vec<(u64, f32, Range)> = answers.iter().map(|range| (0, 10.1, *range)).collect();
            let parts = collect(&answers, 0.05);
            let known: Vec<f32> = parts[0]
                .beams
                .iter()
                .map(|beam| beam.1)
                .filter(|m| !m.is_nan())
                .collect();
            assert_eq!(known, [expected_m]);
            assert!(parts[0].beams.len() > 1, "a lone beam is no rangefinder");
        }
    }

    proptest! {
        #[test]
        fn any_directions_in_any_order_are_taken_without_a_panic(
            answers in prop::collection::vec((0..1000u64, -330.0..330.0f32, 0.0..50.0f32), 0..200),
        ) {
            let answers: Vec<(u64, f32, Range)> =
                answers.iter().map(|(us, yaw, range_m)| (us * 100, *yaw, Hit(*range_m))).collect();
            for part in collect(&answers, 0.05) {
                prop_assert!((2..=90).contains(&part.beams.len()));
            }
        }
    }
}
