//! How the cost grows with the load: lines of least squares over loads that differ in one thing.

use super::load::Load;
use super::recorder::Measured;
use std::fmt::Write;

/// Fewer loads make no line worth showing: two always lie on one.
const LOADS_MIN: usize = 3;

/// In what the loads of a line differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// Thousands of points of a frame.
    Points,
    /// Frames per second (Hz).
    Rate,
    /// Sensors.
    Sensors,
    /// Additional readers of every large topic.
    Readers,
}

impl Dimension {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Points, Self::Rate, Self::Sensors, Self::Readers];

    /// What stands along the axis.
    pub fn words(self) -> &'static str {
        match self {
            Self::Points => "1,000 points of a frame",
            Self::Rate => "Hz",
            Self::Sensors => "sensor",
            Self::Readers => "reader",
        }
    }

    fn value(self, load: &Load) -> f64 {
        match self {
            Self::Points => f64::from(load.points) / 1e3,
            Self::Rate => load.rate_hz,
            Self::Sensors => f64::from(load.sensors),
            Self::Readers => f64::from(load.readers),
        }
    }

    /// The load without it.
    fn others(self, load: &Load) -> Load {
        let mut load = *load;
        match self {
            Self::Points => load.points = 0,
            Self::Rate => load.rate_hz = 0.0,
            Self::Sensors => load.sensors = 0,
            Self::Readers => load.readers = 0,
        }
        load
    }
}

/// What grows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cost {
    /// Median from the sensor's publication to the wire (ms).
    SensorToWire,
    /// Median of what fusion computes for a map (ms).
    Fusion,
    /// CPU of the chain (percent of a core).
    Cpu,
}

impl Cost {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::SensorToWire, Self::Fusion, Self::Cpu];

    /// Its name and unit.
    pub fn words(self) -> &'static str {
        match self {
            Self::SensorToWire => "sensor..wire p50 (ms)",
            Self::Fusion => "fusion compute p50 (ms)",
            Self::Cpu => "CPU of the chain (%)",
        }
    }

    fn value(self, measured: &Measured) -> Option<f64> {
        match self {
            Self::SensorToWire => Some(measured.after_sensor.p50_ms),
            Self::Fusion => {
                let fusion = measured.stages.iter().find(|stage| stage.stage == "fusion");
                fusion.map(|fusion| fusion.compute.p50_ms)
            }
            Self::Cpu => Some(measured.chain_cpu_percent()),
        }
    }
}

/// A line through what was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// In what the loads differ.
    pub dimension: Dimension,
    /// In what they do not: what is at zero is what differs.
    pub others: Load,
    /// What grows.
    pub cost: Cost,
    /// Each load's value and cost.
    pub points: Vec<(f64, f64)>,
    /// Cost at zero.
    pub base: f64,
    /// Cost of each one more.
    pub slope: f64,
    /// Share of the variance that the line explains (0 to 1).
    pub r2: f64,
}

/// The line of least squares through `points`: its value at zero, its slope, and the share of the variance that it explains.
/// `None` where all lie above one place.
fn line(points: &[(f64, f64)]) -> Option<(f64, f64, f64)> {
    let n = points.len() as f64;
    let mean = |value: fn(&(f64, f64)) -> f64| points.iter().map(value).sum::<f64>() / n;
    let (x, y) = (mean(|point| point.0), mean(|point| point.1));
    let sum = |product: &dyn Fn(f64, f64) -> f64| -> f64 {
        points.iter().map(|point| product(point.0 - x, point.1 - y)).sum()
    };
    let (xx, xy, yy) = (sum(&|x, _| x * x), sum(&|x, y| x * y), sum(&|_, y| y * y));
    if xx < 1e-12 {
        return None;
    }
    let slope = xy / xx;
    let r2 = if yy < 1e-12 { 1.0 } else { xy * xy / (xx * yy) };
    Some((y - slope * x, slope, r2))
}

/// Every line through at least three loads that differ in one thing.
pub fn fits(loads: &[Measured]) -> Vec<Fit> {
    let mut fits = Vec::new();
    for dimension in Dimension::ALL {
        let mut seen: Vec<Load> = Vec::new();
        for first in loads {
            let others = dimension.others(&first.load);
            if seen.contains(&others) {
                continue;
            }
            seen.push(others);
            let group: Vec<&Measured> = loads
                .iter()
                .filter(|measured| dimension.others(&measured.load) == others)
                .collect();
            if group.len() < LOADS_MIN {
                continue;
            }
            for cost in Cost::ALL {
                let points: Vec<(f64, f64)> = group
                    .iter()
                    .filter_map(|measured| Some((dimension.value(&measured.load), cost.value(measured)?)))
                    .collect();
                if let Some((base, slope, r2)) = line(&points) {
                    fits.push(Fit {
                        dimension,
                        others,
                        cost,
                        points,
                        base,
                        slope,
                        r2,
                    });
                }
            }
        }
    }
    fits
}

/// The lines as text; empty without any.
pub fn text(fits: &[Fit]) -> String {
    let mut text = String::new();
    for (n, fit) in fits.iter().enumerate() {
        if n == 0 {
            // Writing to a text cannot fail.
            let _written = writeln!(
                text,
                "scaling, lines of least squares      at zero     each more   loads    R2"
            );
        }
        let is_first = n == 0 || !fits[n - 1].is_of_same_loads(fit);
        if is_first {
            let _written = writeln!(text, "per {}: {}", fit.dimension.words(), fit.title());
        }
        let _written = writeln!(
            text,
            "  {:<32} {:>9.3} {:>13.4} {:>7} {:>5.2}",
            fit.cost.words(),
            fit.base,
            fit.slope,
            fit.points.len(),
            fit.r2
        );
    }
    text
}

impl Fit {
    /// Whether `other` is of the same loads, and of another cost at most.
    pub fn is_of_same_loads(&self, other: &Self) -> bool {
        self.dimension == other.dimension && self.others == other.others
    }

    /// What the loads have in common.
    pub fn title(&self) -> String {
        let Load {
            points,
            rate_hz,
            sensors,
            readers,
            realtime,
            ..
        } = self.others;
        let is = |dimension| self.dimension == dimension;
        let mut words = Vec::new();
        if !is(Dimension::Points) {
            words.push(format!("{points} points"));
        }
        if !is(Dimension::Rate) {
            words.push(format!("{rate_hz} Hz"));
        }
        if !is(Dimension::Sensors) {
            words.push(if sensors == 1 {
                "1 sensor".to_owned()
            } else {
                format!("{sensors} sensors")
            });
        }
        if !is(Dimension::Readers) && readers > 0 {
            words.push(format!("{readers} readers"));
        }
        let beside = self.others.beside.words();
        if !beside.is_empty() {
            words.push(beside.to_owned());
        }
        if realtime {
            words.push("FIFO and mlock".to_owned());
        }
        words.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::{Cost, Dimension, fits, line, text};
    use crate::latency::report::tests::measured_with;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_line_is_found_again(base in -10.0..10.0f64, slope in -5.0..5.0f64, at in proptest::collection::vec(0.0..100.0f64, 3..20)) {
            let spread = at.iter().fold(0.0f64, |most, x| most.max((x - at[0]).abs()));
            prop_assume!(spread > 1.0);
            let points: Vec<(f64, f64)> = at.iter().map(|x| (*x, base + slope * x)).collect();
            let (found, each, r2) = line(&points).unwrap();
            prop_assert!((found - base).abs() < 1e-6 && (each - slope).abs() < 1e-6 && r2 > 0.999_999);
        }
    }

    #[test]
    fn loads_that_differ_in_one_thing_make_a_line_and_others_none() {
        let mut loads: Vec<_> = [10_000, 20_000, 40_000]
            .iter()
            .map(|points| measured_with(1e-4 * f64::from(*points), |load| load.points = *points))
            .collect();
        // Another rate: it belongs to no line.
        loads.push(measured_with(50.0, |load| load.rate_hz = 30.0));
        let fits = fits(&loads);
        assert_eq!(fits.len(), 3, "{fits:?}");
        assert!(
            fits.iter()
                .all(|fit| fit.dimension == Dimension::Points && fit.points.len() == 3)
        );
        let wire = &fits[0];
        assert_eq!(wire.cost, Cost::SensorToWire);
        // The median of 1, 2 and 4 times the scale.
        assert!(
            (wire.slope - 0.2).abs() < 1e-6 && wire.base.abs() < 1e-6,
            "{wire:?}"
        );
        let text = text(&fits);
        assert!(
            text.contains("per 1,000 points of a frame: 10 Hz, 1 sensor") && text.contains("0.2000"),
            "{text}"
        );
    }

    #[test]
    fn a_place_that_is_alone_has_no_line() {
        assert_eq!(line(&[(1.0, 2.0), (1.0, 3.0), (1.0, 4.0)]), None);
        assert_eq!(text(&[]), "");
    }
}
