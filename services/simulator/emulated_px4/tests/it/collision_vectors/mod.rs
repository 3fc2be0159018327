//! Replays what PX4's own collision prevention answered, and counts where ours answers otherwise.
//!
//! | file | idea |
//! |---|---|
//! | `report` | what is counted, what counts as the same |
//! | `read` | numbers and run-length coded arrays |
//! | `scenario` | steps of a whole instance |
//! | `unit` | single functions |
//!
//! One JSON object per line; a family has its name in `family`. Marks named `fragile` list outputs that a disturbance
//! of a millionth changes: they are not compared.

#![allow(dead_code, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod read;
pub mod report;
mod scenario;
mod unit;

use report::Report;
use serde_json::Value;
use std::path::Path;

/// Files of a folder of vectors; any may be missing.
pub const FILES: [&str; 4] = [
    "map_fusion.jsonl",
    "rangefinder_projection.jsonl",
    "setpoint_constraint.jsonl",
    "units.jsonl",
];

/// Replays every file of [`FILES`] that `folder` has.
pub fn replay_folder(folder: &Path) -> Report {
    let mut report = Report::default();
    for file in FILES {
        if let Ok(text) = std::fs::read_to_string(folder.join(file)) {
            text.lines().for_each(|line| replay_line(line, &mut report));
        }
    }
    report
}

/// Replays one scenario.
pub fn replay_line(line: &str, report: &mut Report) {
    let vector: Value = serde_json::from_str(line).expect("a JSON object per line");
    let family = vector["family"].as_str().expect("a family");
    report.begin(family, vector["id"].as_str().unwrap_or("?"));
    match family {
        "map_fusion" | "rangefinder_projection" | "setpoint_constraint" => {
            scenario::replay(&vector, report);
        }
        "unit_enter_data" => unit::enter_data(&vector, report),
        "unit_scale" => unit::scale(&vector, report),
        "unit_max_speed" => unit::max_speed(&vector, report),
        "unit_guidance" => unit::guidance(&vector, report),
        other => panic!("unknown family {other}"),
    }
}
