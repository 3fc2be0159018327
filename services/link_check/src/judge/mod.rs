//! From observations to findings, in the order of causes.

mod arducopter;
mod assist;
mod autopilot;
mod link;
mod px4;
mod streams;

use super::active_probe::ProbeResult;
use super::finding::Finding;
use super::observations::ObservedSender;
use super::{ActiveProbe, LinkCheck};
use jink_mavlink_link::message::COMPONENT_AVOIDANCE;
use jink_mavlink_link::profile_name::ProfileName;
use jink_shared_types::Timestamp;

/// All findings.
pub(super) fn judge(check: &LinkCheck, now: Timestamp) -> Vec<Finding> {
    let mut findings = Vec::new();
    link::judge(check, &mut findings);
    let probe = autopilot::judge(check, now, &mut findings);
    if let Some(probe) = probe {
        autopilot::answers(check, probe, &mut findings);
        if probe.answers() > 0 {
            streams::judge(probe, &mut findings);
            streams::time(probe, &mut findings);
            let speed_max_mps = check.plan.speed_max_mps;
            match check.profile {
                Some(ProfileName::Px4Trajectory) => px4::trajectory(probe, speed_max_mps, &mut findings),
                Some(ProfileName::Px4Offboard) => px4::offboard(probe, speed_max_mps, &mut findings),
                Some(ProfileName::Px4Deviation) => px4::deviation(probe, speed_max_mps, &mut findings),
                Some(ProfileName::ArdupilotGuided) => {
                    arducopter::guided(probe, speed_max_mps, &mut findings);
                }
                None => {}
            }
            if let Some(braking) = check.plan.assist {
                assist::judge(probe, check.profile, braking, &mut findings);
            }
        }
    }
    others(check, &mut findings);
    findings
}

/// Other senders that do what jink is about to do.
fn others(check: &LinkCheck, findings: &mut Vec<Finding>) {
    let system_id = check.probe.as_ref().map(ActiveProbe::system_id);
    let senders = check.observations.senders();
    let is_avoidance = |sender: &&ObservedSender| {
        sender.component_id == COMPONENT_AVOIDANCE && Some(sender.system_id) == system_id.map(u32::from)
    };
    if let Some(other) = senders.iter().find(is_avoidance) {
        findings.push(Finding::blocker(
            "other senders",
            format!(
                "somebody else speaks as obstacle avoidance ({}/{}), which is jink's own component",
                other.system_id, other.component_id
            ),
            "end the other program (a second jink, MAVROS with an avoidance node, a script); the autopilot must hear one only",
        ));
    }
    for sender in senders {
        if let Some(message) = sender.setpoints
            && !is_avoidance(&sender)
        {
            findings.push(Finding::blocker(
                "other senders",
                format!(
                    "{} sends setpoints, too: {message}; the autopilot would follow both in turn",
                    sender.words()
                ),
                "end that program before jink starts: autopilots do not check who sends setpoints",
            ));
        }
    }
}

/// The value of a parameter, or a warning that it could not be read where others could.
fn value(probe: &ActiveProbe, name: &'static str) -> Option<f64> {
    match probe.parameter(name) {
        ProbeResult::Value(value) => Some(value),
        ProbeResult::Pending | ProbeResult::Unanswered | ProbeResult::Denied | ProbeResult::Accepted => None,
    }
}

/// Whether the firmware has no parameter of this name: others are answered, this one is not.
fn is_absent(probe: &ActiveProbe, name: &'static str) -> bool {
    let unanswered = matches!(
        probe.parameter(name),
        ProbeResult::Unanswered | ProbeResult::Denied
    );
    unanswered && probe.reads_parameters()
}

/// That the autopilot flies as fast as jink plans.
fn speed(name: &'static str, limit_mps: Option<f64>, speed_max_mps: f64, findings: &mut Vec<Finding>) {
    let Some(limit_mps) = limit_mps else { return };
    findings.push(if limit_mps < speed_max_mps {
        Finding::blocker(
            name,
            format!(
                "{name} lets the vehicle fly {limit_mps:.1} m/s, and jink plans for {speed_max_mps:.1}: it would fall behind its plan"
            ),
            format!("raise {name}, or lower OA_SPD_MAX to {limit_mps:.1} or less"),
        )
    } else {
        Finding::good(name, format!("{name} allows {limit_mps:.1} m/s; jink plans for {speed_max_mps:.1}"))
    });
}
