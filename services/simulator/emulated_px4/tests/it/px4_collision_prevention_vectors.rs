//! PX4's collision prevention, emulated, answers what PX4 itself answered.

use crate::collision_vectors::report::Report;
use crate::collision_vectors::{FILES, replay_folder, replay_line};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

const FAMILIES: [&str; 7] = [
    "map_fusion",
    "rangefinder_projection",
    "setpoint_constraint",
    "unit_enter_data",
    "unit_guidance",
    "unit_max_speed",
    "unit_scale",
];

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/collision_prevention")
}

/// All vectors, where they are at hand: beside the workspace.
fn everything() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/vectors/collision_prevention")
}

fn assert_the_same(report: &Report) {
    println!("{report}");
    for family in FAMILIES {
        let counts = report.families.get(family).copied().unwrap_or_default();
        assert!(counts.compared > 0, "nothing of {family} was compared");
    }
    assert_eq!(report.total().mismatches, 0, "{report}");
}

#[test]
fn the_sample_of_every_family_is_answered_as_px4_answered_it() {
    assert_the_same(&replay_folder(&sample()));
}

#[test]
fn every_vector_at_hand_is_answered_as_px4_answered_it() {
    let folder = everything();
    if FILES.iter().all(|file| !folder.join(file).is_file()) {
        println!("no vectors in {}", folder.display());
        return;
    }
    assert_the_same(&replay_folder(&folder));
}

#[test]
fn the_sample_has_every_oddity() {
    let mut tags = BTreeSet::new();
    for file in FILES {
        let text = std::fs::read_to_string(sample().join(file)).unwrap();
        for line in text.lines() {
            let vector: serde_json::Value = serde_json::from_str(line).unwrap();
            let own = vector["tags"].as_array().map(Vec::as_slice).unwrap_or_default();
            tags.extend(own.iter().map(|tag| tag.as_str().unwrap().to_owned()));
        }
    }
    for tag in [
        "px4_out_of_bounds_guarded",
        "nan_output",
        "px4_nan_output_possible",
        "increment_does_not_divide_360",
        "increment_below_bin_size",
        "offset_not_multiple_of_bin",
        "odd_reading",
        "odd_orientation",
        "odd_fov",
        "odd_quaternion",
        "bad_increment",
        "bad_offset",
        "future_timestamp",
        "zero_max_range",
        "all_unknown",
        "unsupported_frame",
        "nonfinite",
        "hold",
        "reactivate",
    ] {
        assert!(tags.contains(tag), "{tag}");
    }
}

#[test]
fn an_answer_that_differs_is_reported() {
    let text = std::fs::read_to_string(sample().join("setpoint_constraint.jsonl")).unwrap();
    let line = text.lines().find(|line| line.contains("\"plain\"")).unwrap();
    let mut vector: serde_json::Value = serde_json::from_str(line).unwrap();
    vector["steps"][0]["expect"]["map_min_cm"] = 12_345.into();
    vector["steps"][0]["expect"]["active"] = false.into();
    let mut report = Report::default();
    replay_line(&vector.to_string(), &mut report);
    assert_eq!(report.total().mismatches, 2, "{report}");
    assert!(report.to_string().contains("map minimum (cm)"), "{report}");
}
