//! Single laws against PX4's: scale, speed, guidance. The rule by which PX4 lets a source into a bin is not ours:
//! sources have bins of their own.

use super::report::ScenarioResult;
use super::schema::{BINS, Node, Unreadable};
use jink_collision_guard::prevention::{PreventionConfig, SectorStates, guide, scale, speed_limit};
use jink_shared_types::Timestamp;
use jink_shared_types::frames::Attitude;
use jink_shared_types::ring::SectorRing;
use nalgebra::{UnitQuaternion, Vector2};

/// The tolerance: relative, and absolute for small numbers.
const SAME: f64 = 1e-3;

/// Compares one.
pub fn judge(family: &str, scenario: &Node<'_>, result: &mut ScenarioResult) -> Result<(), Unreadable> {
    let number = |name| scenario.get(name)?.number();
    let expect = scenario.get("expect")?;
    match family {
        "unit_scale" => {
            let config = PreventionConfig {
                manual_mps: number("MPC_VEL_MANUAL")?,
                position_gain_per_s: number("MPC_XY_P")?,
                ..plain()
            };
            let ours = scale(&config, number("min_keep_m")?, number("distance_m")?);
            close("scale", ours, expect.get("scale")?.number()?, result);
        }
        "unit_max_speed" => {
            let end_mps = number("final_speed")?;
            let (way_m, a, jerk) = (number("distance_m")?, number("accel")?, number("jerk")?);
            // A vehicle that need not stop is as fast as one that has v^2 / 2a more distance.
            let ours = speed_limit(way_m + end_mps * end_mps / (2.0 * a), a, jerk, 0.0).max(end_mps);
            close("speed", ours, expect.get("speed")?.number()?, result);
        }
        "unit_guidance" => guidance(scenario, expect, result)?,
        _ => result.differs("each source has its own sectors: there is no rule to let it in"),
    }
    Ok(())
}

fn close(what: &str, ours: f64, px4: f64, result: &mut ScenarioResult) {
    if (ours - px4).abs() <= SAME * (1.0 + px4.abs()) {
        result.same();
    } else {
        result.wrong(format!("{what} {ours}, PX4 {px4}"));
    }
}

fn guidance(scenario: &Node<'_>, expect: Node<'_>, result: &mut ScenarioResult) -> Result<(), Unreadable> {
    let is_fragile = match scenario.find("fragile") {
        Some(fragile) => fragile
            .find("guided_bin")
            .is_some_and(|bin| bin.flag().unwrap_or(true)),
        None => false,
    };
    if is_fragile {
        result.fragile += 1;
        return Ok(());
    }
    let config = PreventionConfig {
        distance_m: scenario.get("CP_DIST")?.number()?,
        guide_rad: scenario.get("CP_GUIDE_ANG")?.number()?.to_radians(),
        ..plain()
    };
    let yaw_rad = scenario.get("yaw_rad")?.number()?;
    let distances_cm = scenario.get("distances_cm")?.bins()?;
    let now = Timestamp::from_seconds(1.0);
    let ring = SectorRing {
        attitude: Attitude::from_rotation(UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad)),
        distance_m: distances_cm.map(|cm| if cm == 65535 { f32::NAN } else { cm as f32 / 100.0 }),
        range_max_m: [100.0; BINS],
        seen: [now; BINS],
        ..SectorRing::default()
    };
    let wanted = Vector2::from(scenario.get("setpoint")?.numbers::<2>()?);
    let guided = guide(&config, &SectorStates::of(&ring, now), wanted.normalize());
    let bins = [
        expect.get("original_bin")?.integer()?,
        expect.get("guided_bin")?.integer()?,
    ];
    let ours = [guided.original as i64, guided.sector as i64];
    let direction = Vector2::from(expect.get("guided_dir")?.numbers::<2>()?);
    // PX4 calls a tiny negative angle bin 72.
    if ours.map(|bin| bin % 72) != bins.map(|bin| bin % 72) {
        result.wrong(format!("sectors {ours:?}, PX4 {bins:?}"));
    } else if (guided.direction - direction).norm() > SAME {
        result.wrong(format!("direction {:?}, PX4 {direction:?}", guided.direction));
    } else {
        result.same();
    }
    Ok(())
}

fn plain() -> PreventionConfig {
    PreventionConfig::from_params(&jink_shared_types::params::ParamSet::default())
}
