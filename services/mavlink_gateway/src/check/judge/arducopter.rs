//! ArduCopter's parameters that bear on what jink does.

use super::{is_absent, speed, value};
use crate::check::Interview;
use crate::check::finding::Finding;
use crate::check::limits::{GUID_TIMEOUT_MAX_S, GUID_TIMEOUT_MIN_S};

/// GUID_OPTIONS: errors of the position are not corrected.
const NO_POSITION_CONTROL: i64 = 1 << 4;
/// GUID_OPTIONS: errors of position and velocity are not corrected.
const NO_VELOCITY_CONTROL: i64 = 1 << 5;
/// GUID_OPTIONS: positions are flown to by waypoint navigation.
const BY_WAYPOINT_NAVIGATION: i64 = 1 << 6;
/// PRX1_TYPE: OBSTACLE_DISTANCE and OBSTACLE_DISTANCE_3D.
const PROXIMITY_BY_MAVLINK: f64 = 2.0;

/// For `ardupilot_guided`.
pub(super) fn guided(interview: &Interview, speed_max_mps: f64, findings: &mut Vec<Finding>) {
    if let Some(timeout_s) = value(interview, "GUID_TIMEOUT") {
        findings.push(timeout(timeout_s));
    } else if is_absent(interview, "GUID_TIMEOUT") {
        findings.push(Finding::warning(
            "GUID_TIMEOUT",
            "this ArduCopter has no GUID_TIMEOUT: if the board dies, the last setpoint is flown on for 3 s",
            "update the firmware, and set GUID_TIMEOUT to 0.5",
        ));
    }
    options(value(interview, "GUID_OPTIONS"), findings);
    let limit_mps = value(interview, "WPNAV_SPEED").map(|limit_cmps| limit_cmps * 0.01);
    speed("WPNAV_SPEED", limit_mps, speed_max_mps, findings);
    match value(interview, "PRX1_TYPE") {
        Some(PROXIMITY_BY_MAVLINK) => findings.push(Finding::good(
            "PRX1_TYPE",
            "PRX1_TYPE = 2: LOITER avoids what jink sees; arming is refused (\"PRX1: No Data\") until jink runs",
        )),
        Some(_) => findings.push(Finding::good(
            "PRX1_TYPE",
            "the autopilot does not use jink's obstacle maps (PRX1_TYPE is not 2): in LOITER nothing keeps the pilot from obstacles",
        )),
        None => {}
    }
    if value(interview, "OA_TYPE").is_some_and(|now| now != 0.0) {
        findings.push(Finding::warning(
            "OA_TYPE",
            "the autopilot plans ways around obstacles itself in AUTO, before jink takes the mission over",
            "set OA_TYPE to 0",
        ));
    }
    if value(interview, "FS_GCS_ENABLE").is_some_and(|now| now != 0.0) {
        findings.push(Finding::warning(
            "FS_GCS_ENABLE",
            "when the ground station is lost the autopilot leaves GUIDED within 5 s and flies by itself, unguarded, whether or not jink goes on",
            "set FS_GCS_ENABLE to 0, unless that is what you want",
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
