//! Single laws against PX4's: scale, speed, guidance. The rule by which PX4 lets a source into a bin is not ours:
//! sources have bins of their own.

use super::VectorReport;
use jink_collision_guard::prevention::{PreventionConfig, SectorStates, guide, scale, speed_limit};
use jink_shared_types::Timestamp;
use jink_shared_types::frames::Attitude;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ring::SectorRing;
use jink_testkit::vectors::{BINS, distances_cm, number, numbers, whole};
use nalgebra::{UnitQuaternion, Vector2};
use serde_json::Value;

/// The tolerance: relative, and absolute for small numbers.
const SAME: f64 = 1e-3;

/// Compares one.
pub fn judge(family: &str, scenario: &Value, report: &mut VectorReport) {
    let of = |name| number(&scenario[name]);
    let expect = &scenario["expect"];
    match family {
        "unit_scale" => {
            let config = PreventionConfig {
                manual_mps: of("MPC_VEL_MANUAL"),
                position_gain_per_s: of("MPC_XY_P"),
                ..plain()
            };
            let ours = scale(&config, of("min_keep_m"), of("distance_m"));
            close("scale", ours, number(&expect["scale"]), report);
        }
        "unit_max_speed" => {
            let end_mps = of("final_speed");
            let (way_m, a, jerk) = (of("distance_m"), of("accel"), of("jerk"));
            // A vehicle that need not stop is as fast as one that has v^2 / 2a more distance.
            let ours = speed_limit(way_m + end_mps * end_mps / (2.0 * a), a, jerk, 0.0).max(end_mps);
            close("speed", ours, number(&expect["speed"]), report);
        }
        "unit_guidance" => guidance(scenario, expect, report),
        _ => report.differs("each source has its own sectors: there is no rule to let it in"),
    }
}

fn close(what: &str, ours: f64, px4: f64, report: &mut VectorReport) {
    let is_same = (ours - px4).abs() <= SAME * (1.0 + px4.abs());
    if !is_same {
        report.wrong(&format!("{what} {ours}, PX4 {px4}"));
    }
}

fn guidance(scenario: &Value, expect: &Value, report: &mut VectorReport) {
    let config = PreventionConfig {
        distance_m: number(&scenario["CP_DIST"]),
        guide_rad: number(&scenario["CP_GUIDE_ANG"]).to_radians(),
        ..plain()
    };
    let yaw_rad = number(&scenario["yaw_rad"]);
    let now = Timestamp::from_seconds(1.0);
    let distance_m = |cm| {
        if cm == u16::MAX {
            f32::NAN
        } else {
            f32::from(cm) / 100.0
        }
    };
    let ring = SectorRing {
        attitude: Attitude::from_rotation(UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad)),
        distance_m: distances_cm(&scenario["distances_cm"]).map(distance_m),
        range_max_m: [100.0; BINS],
        seen: [now; BINS],
        ..SectorRing::default()
    };
    let wanted = Vector2::from(numbers::<2>(&scenario["setpoint"]));
    let guided = guide(&config, &SectorStates::of(&ring, now), wanted.normalize());
    let bins = ["original_bin", "guided_bin"].map(|name| whole(&expect[name]));
    let ours = [guided.original as i64, guided.sector as i64];
    let direction = Vector2::from(numbers::<2>(&expect["guided_dir"]));
    // PX4 calls a tiny negative angle bin 72.
    if ours.map(|bin| bin % 72) != bins.map(|bin| bin % 72) {
        report.wrong(&format!("sectors {ours:?}, PX4 {bins:?}"));
    } else if (guided.direction - direction).norm() > SAME {
        report.wrong(&format!("direction {:?}, PX4 {direction:?}", guided.direction));
    }
}

fn plain() -> PreventionConfig {
    PreventionConfig::from_params(&ParamSet::default())
}
