//! A campaign of the real processes in which services are swapped, stopped, killed and fed garbage: the goal is reached, nothing is touched,
//! the autopilot never falls back to Hold.

use jink_tests::permit;
use jink_tests::processes::{answer, program};
use serde_json::Value;

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn a_short_campaign_of_faults_drawn_by_lot_ends_at_the_goal() {
    // Whoever is not back in time is counted, whatever keeps him.
    let _permit = permit::for_judging_time();
    let campaign = answer(&mut program(
        "jink",
        &[
            "chaos",
            "--flights",
            "1",
            "--seed",
            "11",
            "--faults",
            "kill,stop,swap,garbage",
            "--json",
            "--services",
            "planner,bezier_generator,collision_guard,obstacle_fusion,sensors",
        ],
    ));
    let last = campaign.stdout.lines().last().unwrap_or_default();
    let figures: Value = serde_json::from_str(last).unwrap_or_else(|_| panic!("{campaign:?}"));
    assert_eq!(campaign.code, Some(0), "{campaign:?}");
    assert_eq!(figures["collisions"], 0, "{campaign:?}");
    assert_eq!(figures["fcu_hold_count"], 0, "{campaign:?}");
    assert_eq!(figures["not_back"], 0, "{campaign:?}");
    assert!(figures["faults"].as_u64().unwrap() >= 4, "{campaign:?}");
}
