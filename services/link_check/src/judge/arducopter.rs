//! ArduCopter's parameters that affect what jink does.

use super::{is_absent, speed, value};
use crate::ActiveProbe;
use crate::finding::Finding;
use crate::limits::{
    ANGLE_MAX_MIN_DEG, FAST_MPS, GUID_TIMEOUT_MAX_S, GUID_TIMEOUT_MIN_S, PSC_JERK_MIN_MPS3, WP_ACC_MIN_MPS2,
};

/// GUID_OPTIONS: errors of the position are not corrected.
const NO_POSITION_CONTROL: i64 = 1 << 4;
/// GUID_OPTIONS: errors of position and velocity are not corrected.
const NO_VELOCITY_CONTROL: i64 = 1 << 5;
/// GUID_OPTIONS: positions are flown to by waypoint navigation.
const BY_WAYPOINT_NAVIGATION: i64 = 1 << 6;
/// PRX1_TYPE: OBSTACLE_DISTANCE and OBSTACLE_DISTANCE_3D.
const PROXIMITY_BY_MAVLINK: f64 = 2.0;
/// AVOID_ENABLE: proximity counts.
const BY_PROXIMITY: i64 = 1 << 1;

/// For `ardupilot_guided`.
pub(super) fn guided(probe: &ActiveProbe, speed_max_mps: f64, findings: &mut Vec<Finding>) {
    if let Some(timeout_s) = value(probe, "GUID_TIMEOUT") {
        findings.push(timeout(timeout_s));
    } else if is_absent(probe, "GUID_TIMEOUT") {
        findings.push(Finding::warning(
            "GUID_TIMEOUT",
            "this ArduCopter has no GUID_TIMEOUT: if the board dies, the last setpoint is flown on for 3 s",
            "update the firmware, and set GUID_TIMEOUT to 0.5",
        ));
    }
    options(value(probe, "GUID_OPTIONS"), findings);
    let limit = renamed(probe, ["WPNAV_SPEED", "WP_SPD"], 0.01);
    let name = limit.map_or("WPNAV_SPEED", |(name, _)| name);
    speed(
        name,
        limit.map(|(_, limit_mps)| limit_mps),
        speed_max_mps,
        findings,
    );
    tracking(probe, speed_max_mps, findings);
    if value(probe, "MIS_RESTART").is_some_and(|now| now != 0.0) {
        findings.push(Finding::warning(
            "MIS_RESTART",
            "MIS_RESTART = 1: whenever AUTO is chosen the mission begins at its first item again, also when jink gives it back for landing",
            "set MIS_RESTART to 0",
        ));
    }
    match value(probe, "PRX1_TYPE") {
        Some(PROXIMITY_BY_MAVLINK) => proximity(probe, findings),
        Some(_) => findings.push(Finding::good(
            "PRX1_TYPE",
            "the autopilot does not use jink's obstacle maps (PRX1_TYPE is not 2): in LOITER nothing keeps the pilot from obstacles",
        )),
        None => {}
    }
    if value(probe, "OA_TYPE").is_some_and(|now| now != 0.0) {
        findings.push(Finding::warning(
            "OA_TYPE",
            "the autopilot plans ways around obstacles itself in AUTO, before jink takes the mission over",
            "set OA_TYPE to 0",
        ));
    }
    if value(probe, "FS_GCS_ENABLE").is_some_and(|now| now != 0.0) {
        findings.push(Finding::warning(
            "FS_GCS_ENABLE",
            "when the ground station is lost the autopilot leaves GUIDED within 5 s and flies by itself, unguarded, whether or not jink goes on",
            "set FS_GCS_ENABLE to 0, unless that is what you want",
        ));
    }
}

/// A parameter under its old name, in units of `old_unit`, or under its new one, in SI units or degrees.
pub(super) fn renamed(
    probe: &ActiveProbe,
    [old, new]: [&'static str; 2],
    old_unit: f64,
) -> Option<(&'static str, f64)> {
    let of_old = value(probe, old).map(|number| (old, number * old_unit));
    of_old.or_else(|| value(probe, new).map(|number| (new, number)))
}

/// Errors against the setpoints are corrected within these limits.
fn tracking(probe: &ActiveProbe, speed_max_mps: f64, findings: &mut Vec<Finding>) {
    let is_fast = speed_max_mps > FAST_MPS;
    for (names, old_unit, [least, least_fast], unit) in [
        (["WPNAV_ACCEL", "WP_ACC"], 0.01, WP_ACC_MIN_MPS2, "m/s2"),
        (["PSC_JERK_XY", "PSC_JERK_NE"], 1.0, PSC_JERK_MIN_MPS3, "m/s3"),
        (["ANGLE_MAX", "ATC_ANGLE_MAX"], 0.01, ANGLE_MAX_MIN_DEG, "degrees"),
    ] {
        let least = if is_fast { least_fast } else { least };
        let Some((name, now)) = renamed(probe, names, old_unit).filter(|(_, now)| *now < least - 1e-6) else {
            continue;
        };
        let in_its_unit = if name == names[0] { least / old_unit } else { least };
        findings.push(Finding::warning(
            name,
            format!(
                "{name} allows {now:.1} {unit}: ArduCopter corrects errors against jink's setpoints too slowly for {speed_max_mps:.1} m/s, \
                 which needs {least:.1}"
            ),
            format!("set {name} to {in_its_unit:.0}, or lower OA_SPD_MAX"),
        ));
    }
}

/// What makes of obstacle maps an avoidance for the pilot.
fn proximity(probe: &ActiveProbe, findings: &mut Vec<Finding>) {
    let avoids = value(probe, "AVOID_ENABLE").is_none_or(|set| set as i64 & BY_PROXIMITY != 0);
    let filter_hz = value(probe, "PRX_FILT").unwrap_or(0.0);
    if !avoids {
        findings.push(Finding::warning(
            "AVOID_ENABLE",
            "AVOID_ENABLE has bit 1 off: PRX1_TYPE = 2 takes jink's obstacle maps, and LOITER does not look at them",
            "set AVOID_ENABLE to 3, or PRX1_TYPE to 0",
        ));
    } else if filter_hz > 0.0 {
        findings.push(Finding::warning(
            "PRX_FILT",
            format!("PRX_FILT = {filter_hz:.2} Hz smooths the distances: LOITER stops too late"),
            "set PRX_FILT to 0",
        ));
    } else {
        findings.push(Finding::good(
            "PRX1_TYPE",
            "PRX1_TYPE = 2: LOITER avoids what jink sees; arming is refused (\"PRX1: No Data\") until jink runs",
        ));
    }
}

fn timeout(timeout_s: f64) -> Finding {
    let about = "GUID_TIMEOUT";
    if timeout_s < GUID_TIMEOUT_MIN_S {
        Finding::blocker(
            about,
            format!(
                "GUID_TIMEOUT = {timeout_s:.2} s is too short: one late setpoint (jink sends 50 a second) stops the vehicle"
            ),
            "set GUID_TIMEOUT to 0.5",
        )
    } else if timeout_s > GUID_TIMEOUT_MAX_S {
        Finding::warning(
            about,
            format!(
                "GUID_TIMEOUT = {timeout_s:.1} s is too long: if the board dies, ArduCopter flies the last setpoint on for so long"
            ),
            "set GUID_TIMEOUT to 0.5: from 4.5 m/s that is 8 m instead of 19",
        )
    } else {
        Finding::good(about, format!("GUID_TIMEOUT = {timeout_s:.1} s"))
    }
}

fn options(options: Option<f64>, findings: &mut Vec<Finding>) {
    let Some(options) = options else { return };
    let set = options as i64;
    let about = "GUID_OPTIONS";
    if set & (NO_POSITION_CONTROL | NO_VELOCITY_CONTROL) != 0 {
        findings.push(Finding::blocker(
            about,
            format!("GUID_OPTIONS = {set}: ArduCopter does not correct errors against the positions it is sent (bits 4 and 5)"),
            format!(
                "set GUID_OPTIONS to {}",
                set & !(NO_POSITION_CONTROL | NO_VELOCITY_CONTROL | BY_WAYPOINT_NAVIGATION)
            ),
        ));
    } else if set & BY_WAYPOINT_NAVIGATION != 0 {
        findings.push(Finding::warning(
            about,
            format!("GUID_OPTIONS = {set}: positions are flown to as waypoints (bit 6), which gets stuck when they are streamed"),
            format!("set GUID_OPTIONS to {}", set & !BY_WAYPOINT_NAVIGATION),
        ));
    } else {
        findings.push(Finding::good(
            about,
            format!("GUID_OPTIONS = {set}: setpoints are followed as they are sent"),
        ));
    }
}
