//! The autopilot: one, only one, the right one, of a type, a vehicle and a version that fit, and whether it answers.

use super::is_absent;
use crate::active_probe::ProbeResult;
use crate::finding::Finding;
use crate::limits::SILENT_S;
use crate::observations::ObservedSender;
use crate::{ActiveProbe, LinkCheck, autopilot_name, vehicle_type_name};
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::fit::{DEVIATION_SWITCH, MatchingProfile, TRAJECTORY_SWITCH};
use jink_mavlink_link::profile_name::{ProfileChoice, ProfileName};
use jink_mavlink_link::version::{fitting, is_too_old};
use jink_shared_types::Timestamp;
use mavlink::dialect::{MavModeFlag, MavType};

/// Returns the probe if its results mean something: if the right autopilot was probed.
pub(super) fn judge<'a>(
    check: &'a LinkCheck,
    now: Timestamp,
    findings: &mut Vec<Finding>,
) -> Option<&'a ActiveProbe> {
    let systems = check.autopilots();
    let Some(probe) = check.probe.as_ref().filter(|_| !is_ambiguous(check, &systems)) else {
        findings.extend(missing_autopilot(check, &systems));
        return None;
    };
    if now.seconds_since(probe.last) > SILENT_S {
        findings.push(Finding::blocker(
            "autopilot",
            format!(
                "the autopilot (system {}) was connected and is silent for {:.0} s",
                probe.system_id(),
                now.seconds_since(probe.last)
            ),
            "check its power and the line, then look again",
        ));
        return None;
    }
    findings.push(Finding::good(
        "autopilot",
        format!("{} is connected", check.subject()),
    ));
    let profile = profile(check, probe, findings);
    vehicle(probe, findings);
    let fits = profile.is_some_and(|profile| version(profile, probe, findings));
    fits.then_some(probe)
}

fn is_ambiguous(check: &LinkCheck, systems: &[u32]) -> bool {
    check.plan.system_id.is_none() && systems.len() > 1
}

/// Why no autopilot could be probed; `None` where a finding about the link explains it.
fn missing_autopilot(check: &LinkCheck, systems: &[u32]) -> Option<Finding> {
    let list = |systems: &[u32]| {
        let names: Vec<_> = systems.iter().map(u32::to_string).collect();
        names.join(" and ")
    };
    if let (Some(wanted), Some(first)) = (check.plan.system_id, systems.first()) {
        return Some(Finding::blocker(
            "system id",
            format!(
                "link.system_id = {wanted}, and the autopilot that is connected has system id {}",
                list(systems)
            ),
            format!(
                "set link.system_id to {first} (or to 0: the only one connected), or the autopilot's own to {wanted} (PX4 MAV_SYS_ID, ArduPilot \
                 MAV_SYSID or SYSID_THISMAV)"
            ),
        ));
    }
    if is_ambiguous(check, systems) {
        return Some(Finding::blocker(
            "system id",
            format!(
                "autopilots of systems {} are connected, and link.system_id = 0 does not say which one is meant",
                list(systems)
            ),
            "set link.system_id to that of this vehicle; every vehicle needs a system id of its own",
        ));
    }
    let is_on_link = |sender: &&ObservedSender| check.plan.expects_autopilot_on(sender.link);
    let names: Vec<_> = check
        .observations
        .senders()
        .iter()
        .filter(is_on_link)
        .map(ObservedSender::words)
        .collect();
    if names.is_empty() {
        return None;
    }
    Some(Finding::blocker(
        "autopilot",
        format!(
            "MAVLink arrives, but no autopilot's heartbeat: only {}",
            names.join(", ")
        ),
        "connect jink to the autopilot itself, or let the router between pass on the autopilot's messages (component 1)",
    ))
}

/// The profile that is checked, if it is for this type of autopilot.
fn profile(check: &LinkCheck, probe: &ActiveProbe, findings: &mut Vec<Finding>) -> Option<ProfileName> {
    let Some(autopilot_type) = probe.autopilot_type() else {
        findings.push(Finding::blocker(
            "profile",
            format!(
                "the autopilot is neither PX4 nor ArduPilot ({:?})",
                probe.heartbeat.autopilot
            ),
            "jink flies with PX4 and with ArduCopter",
        ));
        return None;
    };
    let Some(profile) = check.profile else {
        findings.push(not_chosen(check));
        return None;
    };
    if autopilot_type == profile.autopilot_type() {
        if check.plan.profile == ProfileChoice::Auto {
            findings.push(Finding::good(
                "profile",
                format!("link.profile = \"auto\" chooses \"{}\"", profile.name()),
            ));
        }
        return Some(profile);
    }
    let fitting = match autopilot_type {
        AutopilotType::Px4 => "auto, or to px4_offboard, or px4_trajectory for PX4 1.11 to 1.15",
        AutopilotType::ArduPilot => "auto, or to ardupilot_guided",
    };
    findings.push(Finding::blocker(
        "profile",
        format!(
            "the autopilot is {}, and link.profile = \"{}\" is for {}",
            autopilot_name(Some(autopilot_type)),
            profile.name(),
            autopilot_name(Some(profile.autopilot_type()))
        ),
        format!("set link.profile to {fitting}"),
    ));
    None
}

/// Why none was chosen.
fn not_chosen(check: &LinkCheck) -> Finding {
    let about = "profile";
    match check.fit.matching_profile() {
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

fn vehicle(probe: &ActiveProbe, findings: &mut Vec<Finding>) {
    let heartbeat = &probe.heartbeat;
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
            format!("the vehicle is no multicopter: {}", vehicle_type_name(heartbeat.mavtype)),
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
fn version(profile: ProfileName, probe: &ActiveProbe, findings: &mut Vec<Finding>) -> bool {
    let name = autopilot_name(probe.autopilot_type());
    let ((major, minor), last) = fitting(profile);
    let span = match last {
        Some((_, last)) => format!("{name} {major}.{minor} to {major}.{last}"),
        None => format!("{name} {major}.{minor} and later"),
    };
    if let Some(version) = probe.version {
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
    } else if probe.answers() > 0 {
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
        if probe.desired_path() == ProbeResult::Denied {
            findings.push(no_trajectories(
                "this PX4 refuses TRAJECTORY_REPRESENTATION_WAYPOINTS: it has no trajectory interface"
                    .to_owned(),
            ));
            return false;
        }
        if is_absent(probe, "COM_OBS_AVOID") {
            findings.push(no_trajectories(
                "this PX4 has no parameter COM_OBS_AVOID: it has no trajectory interface".to_owned(),
            ));
            return false;
        }
    }
    if let Some(version) = probe.version {
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

/// Whether our requests reach it.
pub(super) fn answers(check: &LinkCheck, probe: &ActiveProbe, findings: &mut Vec<Finding>) {
    let signs = check.link_states.iter().any(|line| line.counts.signed > 0);
    if probe.answers() == 0 && !signs {
        findings.push(Finding::blocker(
            "answers",
            "the autopilot sends, but answers nothing: it does not receive us",
            "check the wire from the board's TX to the autopilot's RX, and routers on the way; if the autopilot requires signatures, set \
             link.signing and link.key_file",
        ));
    } else if probe.answers() > 0 && !probe.reads_parameters() {
        findings.push(Finding::warning(
            "parameters",
            "the autopilot reports no parameter: they could not be judged",
            "compare them with the page of this autopilot (docs/connect_*.md) in the ground station",
        ));
    }
}
