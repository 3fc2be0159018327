//! Who is there: an autopilot, one only, the right one, of a make, a kind and a version that fit, and does it answer.

use super::is_absent;
use crate::finding::Finding;
use crate::heard::Sender;
use crate::interview::Answer;
use crate::limits::SILENT_S;
use crate::{Examination, Interview, kind_name, make_name};
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::fit::{DEVIATION_SWITCH, MatchingProfile, TRAJECTORY_SWITCH};
use jink_mavlink_link::profile_name::{ProfileChoice, ProfileName};
use jink_mavlink_link::version::{fitting, is_too_old};
use jink_shared_types::Timestamp;
use mavlink::dialects::ardupilotmega::{MavModeFlag, MavType};

/// Answers the interview if its answers mean something: if it was the right autopilot that was asked.
pub(super) fn judge<'a>(
    examination: &'a Examination,
    now: Timestamp,
    findings: &mut Vec<Finding>,
) -> Option<&'a Interview> {
    let systems = examination.autopilots();
    let Some(interview) = examination
        .interview
        .as_ref()
        .filter(|_| !is_ambiguous(examination, &systems))
    else {
        findings.extend(nobody(examination, &systems));
        return None;
    };
    if now.seconds_since(interview.last) > SILENT_S {
        findings.push(Finding::blocker(
            "autopilot",
            format!(
                "the autopilot (system {}) was heard and is silent for {:.0} s",
                interview.system_id(),
                now.seconds_since(interview.last)
            ),
            "check its power and the line, then look again",
        ));
        return None;
    }
    findings.push(Finding::good(
        "autopilot",
        format!("{} is heard", examination.subject()),
    ));
    let profile = profile(examination, interview, findings);
    vehicle(interview, findings);
    let fits = profile.is_some_and(|profile| version(profile, interview, findings));
    fits.then_some(interview)
}

fn is_ambiguous(examination: &Examination, systems: &[u32]) -> bool {
    examination.plan.system_id.is_none() && systems.len() > 1
}

/// Why nobody could be asked; nothing, where a finding about the link says it already.
fn nobody(examination: &Examination, systems: &[u32]) -> Option<Finding> {
    let list = |systems: &[u32]| {
        let names: Vec<_> = systems.iter().map(u32::to_string).collect();
        names.join(" and ")
    };
    if let (Some(wanted), Some(first)) = (examination.plan.system_id, systems.first()) {
        return Some(Finding::blocker(
            "system id",
            format!(
                "link.system_id = {wanted}, and the autopilot that is heard has system id {}",
                list(systems)
            ),
            format!(
                "set link.system_id to {first} (or to 0: the only one heard), or the autopilot's own to {wanted} (PX4 MAV_SYS_ID, ArduPilot \
                 MAV_SYSID or SYSID_THISMAV)"
            ),
        ));
    }
    if is_ambiguous(examination, systems) {
        return Some(Finding::blocker(
            "system id",
            format!(
                "autopilots of systems {} are heard, and link.system_id = 0 does not say which one is meant",
                list(systems)
            ),
            "set link.system_id to that of this vehicle; every vehicle needs a system id of its own",
        ));
    }
    let listened = |sender: &&Sender| examination.plan.looks_on(sender.link);
    let heard: Vec<_> = examination
        .heard
        .senders()
        .iter()
        .filter(listened)
        .map(Sender::words)
        .collect();
    if heard.is_empty() {
        return None;
    }
    Some(Finding::blocker(
        "autopilot",
        format!(
            "MAVLink arrives, but no autopilot's heartbeat: only {}",
            heard.join(", ")
        ),
        "connect jink to the autopilot itself, or let the router between pass on the autopilot's messages (component 1)",
    ))
}

/// The profile that is examined, if it is for this make of autopilot.
fn profile(
    examination: &Examination,
    interview: &Interview,
    findings: &mut Vec<Finding>,
) -> Option<ProfileName> {
    let Some(make) = interview.make() else {
        findings.push(Finding::blocker(
            "profile",
            format!(
                "the autopilot is neither PX4 nor ArduPilot ({:?})",
                interview.heartbeat.autopilot
            ),
            "jink flies with PX4 and with ArduCopter",
        ));
        return None;
    };
    let Some(profile) = examination.profile else {
        findings.push(not_chosen(examination));
        return None;
    };
    if make == profile.autopilot_type() {
        if examination.plan.profile == ProfileChoice::Auto {
            findings.push(Finding::good(
                "profile",
                format!("link.profile = \"auto\" chooses \"{}\"", profile.name()),
            ));
        }
        return Some(profile);
    }
    let fitting = match make {
        AutopilotType::Px4 => "auto, or to px4_offboard, or px4_trajectory for PX4 1.11 to 1.15",
        AutopilotType::ArduPilot => "auto, or to ardupilot_guided",
    };
    findings.push(Finding::blocker(
        "profile",
        format!(
            "the autopilot is {}, and link.profile = \"{}\" is for {}",
            make_name(Some(make)),
            profile.name(),
            make_name(Some(profile.autopilot_type()))
        ),
        format!("set link.profile to {fitting}"),
    ));
    None
}

/// Why none was chosen.
fn not_chosen(examination: &Examination) -> Finding {
    let about = "profile";
    match examination.fit.matching_profile() {
        MatchingProfile::None => Finding::blocker(
            about,
            "no profile is for this version of the autopilot's firmware",
            "update the autopilot's firmware",
        ),
        _ => Finding::blocker(
            about,
            format!(
                "link.profile = \"auto\", and the autopilot does not tell what decides: {TRAJECTORY_SWITCH} and {DEVIATION_SWITCH}"
            ),
            "check the wire from the board's TX to the autopilot's RX, and routers on the way; if the autopilot requires signatures, set \
             link.signing and link.key_file",
        ),
    }
}

fn vehicle(interview: &Interview, findings: &mut Vec<Finding>) {
    let heartbeat = &interview.heartbeat;
    let is_multicopter = matches!(
        heartbeat.mavtype,
        MavType::MAV_TYPE_QUADROTOR
            | MavType::MAV_TYPE_TRICOPTER
            | MavType::MAV_TYPE_HEXAROTOR
            | MavType::MAV_TYPE_OCTOROTOR
            | MavType::MAV_TYPE_COAXIAL
            | MavType::MAV_TYPE_DECAROTOR
            | MavType::MAV_TYPE_DODECAROTOR
    );
    if !is_multicopter {
        findings.push(Finding::blocker(
            "vehicle",
            format!("the vehicle is no multicopter: {}", kind_name(heartbeat.mavtype)),
            "jink flies multicopters only; if this is one, correct the autopilot's airframe (PX4 MAV_TYPE, ArduPilot FRAME_CLASS)",
        ));
    }
    if heartbeat
        .base_mode
        .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED)
    {
        findings.push(Finding::warning(
            "vehicle",
            "the motors are armed",
            "examine a link on the ground with disarmed motors",
        ));
    }
}

/// Whether the profile fits the version, as far as it is known.
fn version(profile: ProfileName, interview: &Interview, findings: &mut Vec<Finding>) -> bool {
    let name = make_name(interview.make());
    let ((major, minor), last) = fitting(profile);
    let span = match last {
        Some((_, last)) => format!("{name} {major}.{minor} to {major}.{last}"),
        None => format!("{name} {major}.{minor} and later"),
    };
    if let Some(version) = interview.version {
        if is_too_old(version, profile) {
            findings.push(Finding::blocker(
                "version",
                format!(
                    "{name} {version} is too old for link.profile = \"{}\" ({span})",
                    profile.name()
                ),
                match profile {
                    ProfileName::Px4Deviation => {
                        "set link.profile to auto: the proposed interface is part of no release"
                    }
                    ProfileName::Px4Offboard => {
                        "update the autopilot's firmware; PX4 1.11 to 1.15 with COM_OBS_AVOID = 1 can be flown with \"px4_trajectory\""
                    }
                    _ => "update the autopilot's firmware",
                },
            ));
            return false;
        }
        if last.is_some_and(|last| version.numbers() > last) {
            findings.push(no_trajectories(format!(
                "{name} {version} has no trajectory interface any more ({span})"
            )));
            return false;
        }
    } else if interview.answers() > 0 {
        findings.push(Finding::warning(
            "version",
            format!(
                "the autopilot does not tell its version; \"{}\" needs {span}",
                profile.name()
            ),
            "compare it with the ground station's",
        ));
    }
    if profile == ProfileName::Px4Trajectory {
        if interview.desired_path() == Answer::Refused {
            findings.push(no_trajectories(
                "this PX4 refuses TRAJECTORY_REPRESENTATION_WAYPOINTS: it has no trajectory interface"
                    .to_owned(),
            ));
            return false;
        }
        if is_absent(interview, "COM_OBS_AVOID") {
            findings.push(no_trajectories(
                "this PX4 has no parameter COM_OBS_AVOID: it has no trajectory interface".to_owned(),
            ));
            return false;
        }
    }
    if let Some(version) = interview.version {
        findings.push(Finding::good(
            "version",
            format!("{name} {version} fits \"{}\" ({span})", profile.name()),
        ));
    }
    true
}

fn no_trajectories(is: String) -> Finding {
    Finding::blocker(
        "version",
        is,
        "set link.profile to \"px4_offboard\"; boards with little flash lack the interface in every version",
    )
}

/// Whether what we ask reaches it.
pub(super) fn answers(examination: &Examination, interview: &Interview, findings: &mut Vec<Finding>) {
    let signs = examination.lines.iter().any(|line| line.counts.signed > 0);
    if interview.answers() == 0 && !signs {
        findings.push(Finding::blocker(
            "answers",
            "the autopilot is heard, but answers nothing: it does not hear us",
            "check the wire from the board's TX to the autopilot's RX, and routers on the way; if the autopilot requires signatures, set \
             link.signing and link.key_file",
        ));
    } else if interview.answers() > 0 && !interview.reads_parameters() {
        findings.push(Finding::warning(
            "parameters",
            "the autopilot tells no parameter: they could not be judged",
            "compare them with the page of this autopilot (docs/connect_*.md) in the ground station",
        ));
    }
}
