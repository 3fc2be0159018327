//! PX4's parameters that affect what jink does.

use super::{is_absent, speed, value};
use crate::ActiveProbe;
use crate::finding::Finding;
use crate::limits::{
    COM_OF_LOSS_T_MAX_S, COM_OF_LOSS_T_MIN_S, EAV_TIMEOUT_MIN_S, MPC_ACC_HOR_MIN_MPS2,
    MPC_JERK_AUTO_MIN_MPS3, NAV_ACC_RAD_MAX_M,
};

/// The first version in which collision prevention acts in the default Position mode.
const CP_IN_EVERY_POSITION_MODE: (u8, u8) = (1, 16);
/// The demand for Hold after trajectories have stopped is addressed to this system, whatever the vehicle's own is
/// (PX4's source).
const HOLDS_BY_ITSELF: u8 = 1;
/// MPC_POS_MODE: by acceleration, the default.
const POS_MODE_BY_ACCELERATION: f64 = 4.0;

/// For `px4_trajectory`.
pub(super) fn trajectory(probe: &ActiveProbe, speed_max_mps: f64, findings: &mut Vec<Finding>) {
    match value(probe, "COM_OBS_AVOID") {
        Some(0.0) => findings.push(Finding::blocker(
            "COM_OBS_AVOID",
            "COM_OBS_AVOID = 0: PX4 flies its missions without asking jink",
            "set COM_OBS_AVOID to 1",
        )),
        Some(_) => findings.push(Finding::good(
            "COM_OBS_AVOID",
            "COM_OBS_AVOID = 1: PX4 asks jink for trajectories and arms only while jink is ready",
        )),
        None => {}
    }
    let system_id = probe.system_id();
    if system_id != HOLDS_BY_ITSELF {
        findings.push(Finding::warning(
            "MAV_SYS_ID",
            format!("the vehicle's system id is {system_id}, and PX4 addresses its own demand for Hold to system 1: it does not hold when trajectories stop"),
            "set MAV_SYS_ID to 1",
        ));
    }
    speed(
        "MPC_XY_CRUISE",
        value(probe, "MPC_XY_CRUISE"),
        speed_max_mps,
        findings,
    );
    for (name, least, unit) in [
        ("MPC_ACC_HOR", MPC_ACC_HOR_MIN_MPS2, "m/s2"),
        ("MPC_JERK_AUTO", MPC_JERK_AUTO_MIN_MPS3, "m/s3"),
    ] {
        if let Some(now) = value(probe, name).filter(|now| *now < least) {
            findings.push(Finding::warning(
                name,
                format!(
                    "{name} = {now:.1} {unit}: PX4 smooths curves more than jink allows for, and cuts corners"
                ),
                format!("set {name} to {least:.0} {unit} or more"),
            ));
        }
    }
    acceptance_radius(probe, findings);
    let ignored = value(probe, "MPC_POS_MODE") == Some(POS_MODE_BY_ACCELERATION)
        && probe
            .version
            .is_some_and(|version| version.numbers() < CP_IN_EVERY_POSITION_MODE);
    collision_prevention(probe, ignored, findings);
}

/// For `px4_offboard`.
pub(super) fn offboard(probe: &ActiveProbe, speed_max_mps: f64, findings: &mut Vec<Finding>) {
    if value(probe, "COM_OBS_AVOID").is_some_and(|now| now != 0.0) {
        findings.push(Finding::blocker(
            "COM_OBS_AVOID",
            "COM_OBS_AVOID = 1: in automatic modes PX4 waits for trajectories, which \"px4_offboard\" does not send, and falls to Hold",
            "set COM_OBS_AVOID to 0, or link.profile to \"px4_trajectory\"",
        ));
    }
    if let Some(loss_s) = value(probe, "COM_OF_LOSS_T") {
        findings.push(loss_time(loss_s));
    }
    let without_sticks = value(probe, "COM_OBL_ACT");
    if let Some(action) = without_sticks {
        findings.push(loss_action_without_sticks(action));
    }
    if let Some(action) = value(probe, "COM_OBL_RC_ACT") {
        findings.push(loss_action(action, without_sticks.is_some()));
    } else if is_absent(probe, "COM_OBL_RC_ACT") {
        findings.push(Finding::warning(
            "COM_OBL_RC_ACT",
            "this PX4 has no COM_OBL_RC_ACT: what follows when jink falls silent is not known",
            "look up what this version does when OFFBOARD setpoints stop",
        ));
    }
    speed_and_pilot(probe, speed_max_mps, findings);
}

/// For `px4_deviation`.
pub(super) fn deviation(probe: &ActiveProbe, speed_max_mps: f64, findings: &mut Vec<Finding>) {
    let about = "EAV_EN";
    match value(probe, about) {
        Some(0.0) => findings.push(Finding::blocker(
            about,
            "EAV_EN = 0: PX4 flies its missions without looking at what jink sends",
            "set EAV_EN to 1",
        )),
        Some(_) => findings.push(Finding::good(
            about,
            "EAV_EN = 1: PX4 takes velocities and accelerations in its missions",
        )),
        None if is_absent(probe, about) => findings.push(Finding::blocker(
            about,
            "this PX4 has no EAV_EN: it takes setpoints in OFFBOARD only",
            "set link.profile to \"px4_offboard\", or install a PX4 with external avoidance",
        )),
        None => {}
    }
    if let Some(timeout_s) = value(probe, "EAV_TIMEOUT") {
        findings.push(eav_timeout(timeout_s));
    }
    acceptance_radius(probe, findings);
    speed_and_pilot(probe, speed_max_mps, findings);
}

/// What both profiles need that send velocities: that they may be flown, and what keeps a pilot from obstacles.
fn speed_and_pilot(probe: &ActiveProbe, speed_max_mps: f64, findings: &mut Vec<Finding>) {
    speed(
        "MPC_XY_VEL_MAX",
        value(probe, "MPC_XY_VEL_MAX"),
        speed_max_mps,
        findings,
    );
    collision_prevention(probe, false, findings);
}

/// How far off PX4 counts an item as reached, where PX4 itself flies the mission.
fn acceptance_radius(probe: &ActiveProbe, findings: &mut Vec<Finding>) {
    let about = "NAV_ACC_RAD";
    let Some(radius_m) = value(probe, about).filter(|radius_m| *radius_m > NAV_ACC_RAD_MAX_M) else {
        return;
    };
    findings.push(Finding::warning(
        about,
        format!(
            "NAV_ACC_RAD = {radius_m:.0} m: PX4 counts waypoints as reached so far off, and begins there what follows, a landing for example"
        ),
        format!("set NAV_ACC_RAD to {NAV_ACC_RAD_MAX_M:.0} m or less, or give waypoints a radius of their own"),
    ));
}

fn eav_timeout(timeout_s: f64) -> Finding {
    let about = "EAV_TIMEOUT";
    if timeout_s < EAV_TIMEOUT_MIN_S {
        Finding::warning(
            about,
            format!("EAV_TIMEOUT = {timeout_s:.2} s: while the gateway restarts, PX4 flies straight on"),
            "set EAV_TIMEOUT to 0.5 s",
        )
    } else {
        Finding::good(about, format!("EAV_TIMEOUT = {timeout_s:.1} s"))
    }
}

fn loss_time(loss_s: f64) -> Finding {
    let about = "COM_OF_LOSS_T";
    if loss_s < COM_OF_LOSS_T_MIN_S {
        Finding::warning(
            about,
            format!("COM_OF_LOSS_T = {loss_s:.2} s: a restart of the gateway may end OFFBOARD"),
            "set COM_OF_LOSS_T to 0.5 to 1.0 s",
        )
    } else if loss_s > COM_OF_LOSS_T_MAX_S {
        Finding::warning(
            about,
            format!(
                "COM_OF_LOSS_T = {loss_s:.1} s: if the board dies, PX4 flies the last setpoint on for so long"
            ),
            "set COM_OF_LOSS_T to 0.5 to 1.0 s",
        )
    } else {
        Finding::good(about, format!("COM_OF_LOSS_T = {loss_s:.1} s"))
    }
}

/// What PX4 up to 1.13 does when the board dies and no sticks are received; later ones have COM_OBL_RC_ACT only.
fn loss_action_without_sticks(action: f64) -> Finding {
    let about = "COM_OBL_ACT";
    let then = match action as i64 {
        -1 => "nothing is done about it",
        0 => "the vehicle lands where it is, whatever is below",
        1 => {
            return Finding::good(
                about,
                "COM_OBL_ACT = 1: if the board dies and no sticks are received, PX4 holds",
            );
        }
        2 => "the vehicle climbs to RTL_RETURN_ALT and flies home unguarded",
        _ => {
            return Finding::blocker(
                about,
                format!(
                    "COM_OBL_ACT = {action:.0}: if the board dies and no sticks are received, PX4 stops the motors in the air"
                ),
                "set COM_OBL_ACT to 1 (Hold)",
            );
        }
    };
    Finding::warning(
        about,
        format!("COM_OBL_ACT = {action:.0}: if the board dies and no sticks are received, {then}"),
        "set COM_OBL_ACT to 1 (Hold), unless that is what you want",
    )
}

/// What PX4 does when the board dies; `with_sticks_only`: this version has another parameter for flying without them.
fn loss_action(action: f64, with_sticks_only: bool) -> Finding {
    let about = "COM_OBL_RC_ACT";
    let then = match action as i64 {
        -1 if with_sticks_only => "nothing is done about it",
        0 if with_sticks_only => "the vehicle drifts in Position mode until a pilot takes over",
        0 => "without a remote control the vehicle climbs to RTL_RETURN_ALT and flies home unguarded",
        1 => "the vehicle drifts in Altitude mode until a pilot takes over",
        2 => "the vehicle drifts in Stabilized mode until a pilot takes over",
        3 => "the vehicle climbs to RTL_RETURN_ALT and flies home unguarded",
        4 => "the vehicle lands where it is, whatever is below",
        5 => return Finding::good(about, "COM_OBL_RC_ACT = 5: if the board dies, PX4 holds"),
        _ => {
            return Finding::blocker(
                about,
                format!("COM_OBL_RC_ACT = {action:.0}: if the board dies, PX4 stops the motors in the air"),
                "set COM_OBL_RC_ACT to 5 (Hold)",
            );
        }
    };
    Finding::warning(
        about,
        format!("COM_OBL_RC_ACT = {action:.0}: if the board dies, {then}"),
        "set COM_OBL_RC_ACT to 5 (Hold), unless that is what you want",
    )
}

/// PX4's own, for manual flight. It needs the obstacle maps that jink sends.
fn collision_prevention(probe: &ActiveProbe, ignored: bool, findings: &mut Vec<Finding>) {
    let Some(distance_m) = value(probe, "CP_DIST") else {
        return;
    };
    let about = "CP_DIST";
    findings.push(if distance_m <= 0.0 {
        Finding::good(about, "collision prevention is off: in Position mode nothing keeps the pilot from obstacles")
    } else if ignored {
        Finding::warning(
            about,
            format!("CP_DIST = {distance_m:.1} m has no effect: this version ignores it in Position mode with MPC_POS_MODE = 4"),
            "set MPC_POS_MODE to 3, or CP_DIST to -1",
        )
    } else {
        Finding::good(
            about,
            format!(
                "CP_DIST = {distance_m:.1} m: in Position mode PX4 keeps away from what jink sees, and stops moving when jink is silent"
            ),
        )
    });
}
