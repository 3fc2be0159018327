//! From what was heard to findings, in the order of causes.

mod arducopter;
mod assist;
mod autopilot;
mod line;
mod px4;
mod streams;

use super::finding::Finding;
use super::heard::Sender;
use super::interview::Answer;
use super::{Examination, Interview};
use jink_mavlink_link::message::COMPONENT_AVOIDANCE;
use jink_mavlink_link::profile_name::ProfileName;
use jink_shared_types::Timestamp;

/// All findings.
pub(super) fn judge(examination: &Examination, now: Timestamp) -> Vec<Finding> {
    let mut findings = Vec::new();
    line::judge(examination, &mut findings);
    let interview = autopilot::judge(examination, now, &mut findings);
    if let Some(interview) = interview {
        autopilot::answers(examination, interview, &mut findings);
        if interview.answers() > 0 {
            streams::judge(interview, &mut findings);
            streams::time(interview, &mut findings);
            let speed_max_mps = examination.plan.speed_max_mps;
            match examination.profile {
                Some(ProfileName::Px4Trajectory) => px4::trajectory(interview, speed_max_mps, &mut findings),
                Some(ProfileName::Px4Offboard) => px4::offboard(interview, speed_max_mps, &mut findings),
                Some(ProfileName::Px4Deviation) => px4::deviation(interview, speed_max_mps, &mut findings),
                Some(ProfileName::ArdupilotGuided) => {
                    arducopter::guided(interview, speed_max_mps, &mut findings);
                }
                None => {}
            }
            if let Some(braking) = examination.plan.assist {
                assist::judge(interview, examination.profile, braking, &mut findings);
            }
        }
    }
    others(examination, &mut findings);
    findings
}

/// Whoever does what jink is about to do.
fn others(examination: &Examination, findings: &mut Vec<Finding>) {
    let system_id = examination.interview.as_ref().map(Interview::system_id);
    let senders = examination.heard.senders();
    let is_avoidance = |sender: &&Sender| {
        sender.component_id == COMPONENT_AVOIDANCE && Some(sender.system_id) == system_id.map(u32::from)
    };
    if let Some(rival) = senders.iter().find(is_avoidance) {
        findings.push(Finding::blocker(
            "other senders",
            format!(
                "somebody else speaks as obstacle avoidance ({}/{}), which is jink's own component",
                rival.system_id, rival.component_id
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
fn value(interview: &Interview, name: &'static str) -> Option<f64> {
    match interview.parameter(name) {
        Answer::Value(value) => Some(value),
        Answer::Open | Answer::None | Answer::Refused | Answer::Granted => None,
    }
}

/// Whether the firmware has no parameter of this name: others are answered, this one is not.
fn is_absent(interview: &Interview, name: &'static str) -> bool {
    let unanswered = matches!(interview.parameter(name), Answer::None | Answer::Refused);
    unanswered && interview.reads_parameters()
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
