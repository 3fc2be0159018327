//! What assisted flight needs of the autopilot, where a switch chooses it.

use super::arducopter::renamed;
use super::value;
use crate::finding::Finding;
use crate::{ActiveProbe, Braking};
use jink_mavlink_link::fit::{OVERRIDE_BITS, OVERRIDE_IN_OFFBOARD, OVERRIDE_SPEED};
use jink_mavlink_link::profile_name::ProfileName;

/// For the profiles that follow setpoints.
pub(super) fn judge(
    probe: &ActiveProbe,
    profile: Option<ProfileName>,
    braking: Braking,
    findings: &mut Vec<Finding>,
) {
    match profile {
        Some(ProfileName::Px4Offboard) => sticks_end_offboard(probe, findings),
        Some(ProfileName::ArdupilotGuided) => brakes_as_expected(probe, braking, findings),
        Some(ProfileName::Px4Trajectory | ProfileName::Px4Deviation) | None => {}
    }
}

/// In assisted flight the sticks move all the time.
fn sticks_end_offboard(probe: &ActiveProbe, findings: &mut Vec<Finding>) {
    if let Some(speed) = value(probe, OVERRIDE_SPEED).filter(|speed| *speed >= 0.0) {
        findings.push(Finding::warning(
            OVERRIDE_SPEED,
            format!(
                "{OVERRIDE_SPEED} = {speed:.1}: sticks that move end OFFBOARD, so assisted flight is refused"
            ),
            format!("set {OVERRIDE_SPEED} to -1, or OA_ASSIST_CH to 0"),
        ));
    }
    if let Some(bits) = value(probe, OVERRIDE_BITS).filter(|bits| *bits as i64 & OVERRIDE_IN_OFFBOARD != 0) {
        let without = bits as i64 & !OVERRIDE_IN_OFFBOARD;
        findings.push(Finding::warning(
            OVERRIDE_BITS,
            format!("{OVERRIDE_BITS} = {bits:.0} has bit 1: sticks that move end OFFBOARD, so assisted flight is refused"),
            format!("set {OVERRIDE_BITS} to {without}, or OA_ASSIST_CH to 0"),
        ));
    }
}

/// ArduCopter shapes velocities within these; collision prevention must not count on more.
fn brakes_as_expected(probe: &ActiveProbe, braking: Braking, findings: &mut Vec<Finding>) {
    for (names, old_unit, ours, expected, unit) in [
        (
            ["WPNAV_ACCEL", "WP_ACC"],
            0.01,
            "MPC_ACC_HOR",
            braking.acceleration_mps2,
            "m/s2",
        ),
        (
            ["PSC_JERK_XY", "PSC_JERK_NE"],
            1.0,
            "MPC_JERK_MAX",
            braking.jerk_mps3,
            "m/s3",
        ),
    ] {
        if let Some((name, now)) = renamed(probe, names, old_unit).filter(|(_, now)| *now < expected - 1e-6) {
            findings.push(Finding::warning(
                name,
                format!("{name} lets ArduCopter brake with {now:.1} {unit}, and collision prevention counts on {ours} = {expected:.1}: assisted flight stops too late"),
                format!("set {ours} to {now:.1}, or raise {name}"),
            ));
        }
    }
}
