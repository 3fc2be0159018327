//! Single functions.

use super::report::Report;
use super::{single, vector};
use jink_emulated_px4::collision_prevention::{Settings, accepts, authority, guide, speed_to_stop_mps};
use jink_testkit::vectors::{distances_cm, number, whole};
use serde_json::Value;

pub fn enter_data(vector: &Value, report: &mut Report) {
    let ours = accepts(
        whole(&vector["bin_cm"]) as u16,
        whole(&vector["bin_max_range_cm"]) as u16,
        single(&vector["sensor_range_m"]),
        single(&vector["reading_m"]),
    );
    report.exact("accept", Some(ours), vector["expect"]["accept"].as_bool());
}

pub fn scale(vector: &Value, report: &mut Report) {
    let settings = Settings {
        manual_speed_mps: single(&vector["MPC_VEL_MANUAL"]),
        position_gain_per_s: single(&vector["MPC_XY_P"]),
        ..Settings::default()
    };
    let keep_m = single(&vector["min_keep_m"]);
    let ours = authority(single(&vector["distance_m"]), keep_m, &settings);
    report.close("scale", ours, number(&vector["expect"]["scale"]));
}

pub fn max_speed(vector: &Value, report: &mut Report) {
    let ours = speed_to_stop_mps(
        single(&vector["jerk"]),
        single(&vector["accel"]),
        single(&vector["distance_m"]),
        single(&vector["final_speed"]),
    );
    report.close("speed", ours, number(&vector["expect"]["speed"]));
}

pub fn guidance(case: &Value, report: &mut Report) {
    let settings = Settings {
        distance_m: single(&case["CP_DIST"]),
        guide_deg: single(&case["CP_GUIDE_ANG"]),
        ..Settings::default()
    };
    let ours = guide(
        &distances_cm(&case["distances_cm"]),
        vector(&case["setpoint"]),
        single(&case["yaw_rad"]),
        &settings,
    );
    let expect = &case["expect"];
    report.exact(
        "original bin",
        i64::from(ours.original_bin),
        whole(&expect["original_bin"]),
    );
    report.exact("guided bin", i64::from(ours.bin), whole(&expect["guided_bin"]));
    report.close("guided north", ours.direction.x, number(&expect["guided_dir"][0]));
    report.close("guided east", ours.direction.y, number(&expect["guided_dir"][1]));
}
