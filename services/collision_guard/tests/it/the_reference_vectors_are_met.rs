//! What PX4's own collision prevention answered, and what ours does: the same, or safer for a reason that the messages
//! bear out.
//!
//! The whole set lies beside the project (`../shared/vectors`) where it is developed; a sample of it is committed.

mod bezier;
mod map;
mod oracle;
mod replay;
mod setpoint;
mod units;

use jink_testkit::vectors::{indices, list, scenarios};
use oracle::ReceivedMessage;
use replay::Replay;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What came of the scenarios.
#[derive(Default)]
struct VectorReport {
    scenarios: usize,
    /// Family and name of the scenario at hand.
    at_hand: String,
    /// Outputs that differ by design, for each reason.
    by_design: BTreeMap<&'static str, usize>,
    /// Outputs that are wrong.
    wrong: Vec<String>,
}

impl VectorReport {
    /// An output differs, and should.
    fn differs(&mut self, reason: &'static str) {
        *self.by_design.entry(reason).or_default() += 1;
    }

    /// An output is wrong.
    fn wrong(&mut self, what: &str) {
        self.wrong.push(format!("{}: {what}", self.at_hand));
    }
}

fn judged(directory: &Path) -> VectorReport {
    let mut report = VectorReport::default();
    for scenario in scenarios(directory) {
        report.scenarios += 1;
        let family = scenario["family"].as_str().unwrap();
        report.at_hand = format!("{family} {}", scenario["id"]);
        match family {
            "bezier" => bezier::judge(&scenario, &mut report),
            unit if unit.starts_with("unit_") => units::judge(unit, &scenario, &mut report),
            _ => fly(&scenario, family == "setpoint_constraint", &mut report),
        }
    }
    println!(
        "{}: {} scenarios, differing by design {:#?}",
        directory.display(),
        report.scenarios,
        report.by_design
    );
    assert!(
        report.wrong.is_empty(),
        "{} outputs are wrong, such as {:#?}",
        report.wrong.len(),
        report.wrong.iter().take(20).collect::<Vec<_>>()
    );
    report
}

fn fly(scenario: &Value, with_setpoint: bool, report: &mut VectorReport) {
    let mut replay = Replay::new(scenario);
    let mut received = Vec::new();
    for step in list(&scenario["steps"]) {
        let replayed = replay.step(step);
        received.extend(replayed.accepted.iter().map(ReceivedMessage::of));
        let fragile_bins = indices(&step["fragile"], "map_bins");
        let comparison = map::MapComparison {
            replayed: &replayed,
            received: &received,
        };
        if replay.config.is_active() {
            comparison.judge(&step["expect"], &fragile_bins, report);
        }
        let is_fragile = !fragile_bins.is_empty() || step["fragile"]["setpoint"] == true;
        if with_setpoint && !is_fragile {
            let has_turned = comparison.has_turned();
            setpoint::judge(&step["expect"], &replayed, &replay.config, has_turned, report);
        }
    }
}

fn crate_folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The sample is the one that the emulated autopilot is held to, some curves, and scenarios made with the emulated
/// autopilot, whose seeds are in their names.
#[test]
fn the_committed_sample() {
    let sample = judged(&crate_folder().join("../simulator/emulated_px4/tests/data/collision_prevention"));
    assert!(sample.scenarios > 150, "{}", sample.scenarios);
    let own = judged(&crate_folder().join("tests/data"));
    assert!(own.scenarios > 28, "{}", own.scenarios);
    // Rows under a turning vehicle, and rows with few known elements: PX4's map has obstacles where nothing is, seldom
    // in the path.
    let carried = own.by_design["what PX4 carries along with the nose does not stand there"];
    assert!((1..=6).contains(&carried), "{carried}");
}

#[test]
fn the_whole_set_where_it_is_at_hand() {
    let directory = crate_folder().join("../../../shared/vectors/collision_prevention");
    if !directory.is_dir() {
        println!("not run: {} is not there", directory.display());
        return;
    }
    let report = judged(&directory);
    assert!(report.scenarios > 1500, "{}", report.scenarios);
}
