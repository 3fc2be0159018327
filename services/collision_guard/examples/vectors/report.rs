//! What came of the scenarios, family by family.

use std::collections::BTreeMap;
use std::fmt;

/// Failing scenarios that are shown in full.
const SHOWN: usize = 20;

/// What came of one scenario.
#[derive(Clone, Debug, Default)]
pub struct ScenarioResult {
    /// Outputs that were compared.
    pub compared: usize,
    /// Outputs that marks in the file except from comparison.
    pub fragile: usize,
    /// Outputs that differ by design, for each reason.
    pub by_design: BTreeMap<&'static str, usize>,
    /// What is wrong.
    pub wrong: Vec<String>,
}

impl ScenarioResult {
    /// An output that is as PX4 has it.
    pub fn same(&mut self) {
        self.compared += 1;
    }

    /// An output that differs, and should.
    pub fn differs(&mut self, reason: &'static str) {
        self.compared += 1;
        *self.by_design.entry(reason).or_default() += 1;
    }

    /// An output that is wrong.
    pub fn wrong(&mut self, what: String) {
        self.compared += 1;
        self.wrong.push(what);
    }
}

#[derive(Clone, Debug, Default)]
struct Family {
    scenarios: usize,
    exact: usize,
    compared: usize,
    same: usize,
    fragile: usize,
    /// Scenarios and outputs for each reason.
    reasons: BTreeMap<&'static str, (usize, usize)>,
    failing: Vec<String>,
}

/// Everything.
#[derive(Clone, Debug, Default)]
pub struct VectorReport {
    families: BTreeMap<String, Family>,
}

impl VectorReport {
    /// Adds the verdict on scenario `id` of `family`.
    pub fn add(&mut self, family: &str, id: &str, result: &ScenarioResult) {
        let entry = self.families.entry(family.to_owned()).or_default();
        entry.scenarios += 1;
        entry.compared += result.compared;
        entry.fragile += result.fragile;
        let differing: usize = result.by_design.values().sum();
        entry.same += result.compared - differing - result.wrong.len();
        for (reason, count) in &result.by_design {
            let (scenarios, outputs) = entry.reasons.entry(reason).or_default();
            *scenarios += 1;
            *outputs += count;
        }
        match result.wrong.first() {
            Some(what) => entry.failing.push(format!("{id}: {what}")),
            None if result.by_design.is_empty() => entry.exact += 1,
            None => {}
        }
    }

    /// Scenarios that fail.
    pub fn failing(&self) -> usize {
        self.families.values().map(|family| family.failing.len()).sum()
    }

    /// Outputs that differ for `reason`.
    #[allow(dead_code, reason = "for tests")]
    pub fn outputs(&self, reason: &str) -> usize {
        let of = |family: &Family| family.reasons.get(reason).map_or(0, |(_, outputs)| *outputs);
        self.families.values().map(of).sum()
    }

    /// Scenarios.
    pub fn scenarios(&self) -> usize {
        self.families.values().map(|family| family.scenarios).sum()
    }
}

impl fmt::Display for VectorReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<24} {:>9} {:>6} {:>10} {:>8} {:>9} {:>9} {:>8}",
            "family", "scenarios", "exact", "by design", "failing", "outputs", "same", "fragile"
        )?;
        for (name, family) in &self.families {
            let by_design = family.scenarios - family.exact - family.failing.len();
            writeln!(
                f,
                "{name:<24} {:>9} {:>6} {by_design:>10} {:>8} {:>9} {:>9} {:>8}",
                family.scenarios,
                family.exact,
                family.failing.len(),
                family.compared,
                family.same,
                family.fragile
            )?;
        }
        for (name, family) in self
            .families
            .iter()
            .filter(|(_, family)| !family.reasons.is_empty())
        {
            writeln!(f, "\n{name}, differing by design (scenarios, outputs):")?;
            for (reason, (scenarios, outputs)) in &family.reasons {
                writeln!(f, "  {scenarios:>5} {outputs:>6}  {reason}")?;
            }
        }
        for (name, family) in self
            .families
            .iter()
            .filter(|(_, family)| !family.failing.is_empty())
        {
            writeln!(f, "\n{name}, failing:")?;
            for what in family.failing.iter().take(SHOWN) {
                writeln!(f, "  {what}")?;
            }
            if family.failing.len() > SHOWN {
                writeln!(f, "  and {} more", family.failing.len() - SHOWN)?;
            }
        }
        Ok(())
    }
}
