//! What is counted per family, and what counts as the same.

use std::collections::BTreeMap;
use std::fmt;

/// Accelerations, distances and directions agree within this, relative to one more than their size.
const TOLERANCE: f64 = 1e-3;
/// Mismatches that are described; all are counted.
const DESCRIBED: usize = 20;

/// Counts of one family.
#[derive(Clone, Copy, Debug, Default)]
pub struct Family {
    pub scenarios: u64,
    pub steps: u64,
    pub compared: u64,
    pub fragile: u64,
    pub mismatches: u64,
}

/// Counts of all families.
#[derive(Clone, Debug, Default)]
pub struct Report {
    pub families: BTreeMap<String, Family>,
    pub described: Vec<String>,
    family: String,
    scenario: String,
    step: u64,
}

impl Report {
    /// A scenario begins.
    pub fn begin(&mut self, family: &str, scenario: &str) {
        family.clone_into(&mut self.family);
        scenario.clone_into(&mut self.scenario);
        self.step = 0;
        self.counts().scenarios += 1;
    }

    /// A step of it was made.
    pub fn step(&mut self) {
        self.step += 1;
        self.counts().steps += 1;
    }

    /// `count` values may differ and are passed over.
    pub fn pass_over(&mut self, count: u64) {
        self.counts().fragile += count;
    }

    /// Exactly equal.
    pub fn exact<T: PartialEq + fmt::Debug>(&mut self, what: &str, ours: T, expected: T) {
        let same = ours == expected;
        self.judge(what, same, || format!("{ours:?}, expected {expected:?}"));
    }

    /// Equal within the tolerance. NaN expects NaN; the sign of an infinity does not matter.
    pub fn close(&mut self, what: &str, ours: f32, expected: f64) {
        let ours = f64::from(ours);
        let same = if expected.is_nan() {
            ours.is_nan()
        } else if expected.is_infinite() {
            !ours.is_finite()
        } else {
            (ours - expected).abs() <= TOLERANCE * (1.0 + expected.abs())
        };
        self.judge(what, same, || format!("{ours}, expected {expected}"));
    }

    fn judge(&mut self, what: &str, same: bool, difference: impl Fn() -> String) {
        self.counts().compared += 1;
        if same {
            return;
        }
        self.counts().mismatches += 1;
        if self.described.len() < DESCRIBED {
            let (scenario, step) = (&self.scenario, self.step);
            self.described
                .push(format!("{scenario} step {step}: {what} {}", difference()));
        }
    }

    fn counts(&mut self) -> &mut Family {
        self.families.entry(self.family.clone()).or_default()
    }

    /// All families together.
    pub fn total(&self) -> Family {
        self.families.values().fold(Family::default(), |sum, f| Family {
            scenarios: sum.scenarios + f.scenarios,
            steps: sum.steps + f.steps,
            compared: sum.compared + f.compared,
            fragile: sum.fragile + f.fragile,
            mismatches: sum.mismatches + f.mismatches,
        })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<24}{:>10}{:>8}{:>10}{:>9}{:>12}",
            "family", "scenarios", "steps", "compared", "fragile", "mismatches"
        )?;
        let families = self
            .families
            .iter()
            .map(|(name, family)| (name.as_str(), *family));
        for (name, c) in families.chain([("all", self.total())]) {
            let Family {
                scenarios,
                steps,
                compared,
                fragile,
                mismatches,
            } = c;
            writeln!(
                f,
                "{name:<24}{scenarios:>10}{steps:>8}{compared:>10}{fragile:>9}{mismatches:>12}"
            )?;
        }
        self.described.iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}
