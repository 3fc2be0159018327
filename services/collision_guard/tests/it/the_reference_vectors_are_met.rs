//! What PX4's own collision prevention answered, and what ours does: the same, or safer for a reason that the messages
//! bear out.
//!
//! The whole set lies beside the project (`../shared/vectors`) where it is developed; a sample of it is committed.

#[path = "../../examples/vectors/bezier.rs"]
mod bezier;
#[path = "../../examples/vectors/map.rs"]
mod map;
#[path = "../../examples/vectors/oracle.rs"]
mod oracle;
#[path = "../../examples/vectors/replay.rs"]
mod replay;
#[path = "../../examples/vectors/report.rs"]
mod report;
#[path = "../../examples/vectors/run.rs"]
mod run;
#[path = "../../examples/vectors/schema.rs"]
mod schema;
#[path = "../../examples/vectors/setpoint.rs"]
mod setpoint;
#[path = "../../examples/vectors/units.rs"]
mod units;

use std::path::{Path, PathBuf};

fn judged(directory: &Path) -> report::VectorReport {
    let report = run::run(directory).unwrap();
    println!("{}\n{report}", directory.display());
    assert_eq!(report.failing(), 0, "\n{report}");
    report
}

fn crate_folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The sample is the one that the emulated autopilot is held to, some curves, and scenarios made with the emulated
/// autopilot (`px4_scenarios` of the simulator), whose seeds are in their names.
#[test]
fn the_committed_sample() {
    let sample = judged(&crate_folder().join("../simulator/emulated_px4/tests/data/collision_prevention"));
    assert!(sample.scenarios() > 150, "{}", sample.scenarios());
    let own = judged(&crate_folder().join("tests/data"));
    assert!(own.scenarios() > 28, "{}", own.scenarios());
    // Rows under a turning vehicle, and rows with few known elements: PX4's map has obstacles where nothing is, seldom
    // in the path.
    let carried = own.outputs("what PX4 carries along with the nose does not stand there");
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
    assert!(report.scenarios() > 1500, "{}", report.scenarios());
}
