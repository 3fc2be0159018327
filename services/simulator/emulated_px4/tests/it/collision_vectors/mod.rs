//! Replays what PX4's own collision prevention answered, and counts where ours answers otherwise.
//!
//! | file | idea |
//! |---|---|
//! | `report` | what is counted, what counts as the same |
//! | `scenario` | steps of a whole instance |
//! | `unit` | single functions |
//!
//! A family has its name in `family`. Marks named `fragile` list outputs that a disturbance
//! of a millionth changes: they are not compared.

pub mod report;
mod scenario;
mod unit;

use jink_testkit::vectors::{number, numbers, scenarios};
use nalgebra::Vector2;
use report::Report;
use serde_json::Value;
use std::path::Path;

/// Replays every scenario of `folder`, the curves aside: they are no part of collision prevention.
pub fn replay_folder(folder: &Path) -> Report {
    let mut report = Report::default();
    let vectors = scenarios(folder);
    let ours = vectors.iter().filter(|vector| vector["family"] != "bezier");
    ours.for_each(|vector| replay(vector, &mut report));
    report
}

/// Replays one scenario.
pub fn replay(vector: &Value, report: &mut Report) {
    let family = vector["family"].as_str().expect("a family");
    report.begin(family, vector["id"].as_str().unwrap_or("?"));
    match family {
        "map_fusion" | "rangefinder_projection" | "setpoint_constraint" => {
            scenario::replay(vector, report);
        }
        "unit_enter_data" => unit::enter_data(vector, report),
        "unit_scale" => unit::scale(vector, report),
        "unit_max_speed" => unit::max_speed(vector, report),
        "unit_guidance" => unit::guidance(vector, report),
        other => panic!("unknown family {other}"),
    }
}

/// The input that PX4 had.
fn single(value: &Value) -> f32 {
    number(value) as f32
}

/// North and east.
fn vector(value: &Value) -> Vector2<f32> {
    Vector2::from(numbers::<2>(value)).cast()
}
