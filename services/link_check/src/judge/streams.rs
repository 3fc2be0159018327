//! The messages that jink needs, and the time.

use crate::ActiveProbe;
use crate::finding::Finding;
use crate::limits::{PX4_ROUND_TRIP_MAX_S, STATE_RATE_MIN_HZ};
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::streams::StreamRate;
#[allow(deprecated)] // Of the trajectory interface.
use mavlink::dialect::TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA;
use mavlink::dialect::{
    ALTITUDE_DATA, ATTITUDE_QUATERNION_DATA, CURRENT_MODE_DATA, EXTENDED_SYS_STATE_DATA,
    GLOBAL_POSITION_INT_DATA, HOME_POSITION_DATA, LOCAL_POSITION_NED_DATA, MISSION_CURRENT_DATA, MavMessage,
    POSITION_TARGET_GLOBAL_INT_DATA, POSITION_TARGET_LOCAL_NED_DATA,
};
use mavlink::{Message, MessageData};

/// What a stream is for.
#[allow(deprecated)]
fn purpose(message_id: u32) -> &'static str {
    match message_id {
        LOCAL_POSITION_NED_DATA::ID => "where the vehicle is",
        ATTITUDE_QUATERNION_DATA::ID => "how it is turned",
        EXTENDED_SYS_STATE_DATA::ID => "whether it has landed",
        HOME_POSITION_DATA::ID => "where home is, which heights are counted from",
        ALTITUDE_DATA::ID => "how far the ground is",
        GLOBAL_POSITION_INT_DATA::ID => "where it is on the globe, for missions",
        MISSION_CURRENT_DATA::ID => "which mission item is flown",
        CURRENT_MODE_DATA::ID => "a change of mode, at once",
        POSITION_TARGET_LOCAL_NED_DATA::ID => "whether setpoints are taken",
        TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::ID => "where PX4 wants to go",
        _ => "the flight",
    }
}

/// Without these nothing flies.
#[allow(deprecated)]
fn is_vital(message_id: u32) -> bool {
    matches!(
        message_id,
        LOCAL_POSITION_NED_DATA::ID
            | ATTITUDE_QUATERNION_DATA::ID
            | TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::ID
    )
}

/// Positions and attitudes make `vehicle/state`.
fn is_state(message_id: u32) -> bool {
    matches!(
        message_id,
        LOCAL_POSITION_NED_DATA::ID | ATTITUDE_QUATERNION_DATA::ID
    )
}

fn name(message_id: u32) -> &'static str {
    MavMessage::default_message_from_id(message_id).map_or("a message", |message| message.message_name())
}

pub(super) fn judge(probe: &ActiveProbe, findings: &mut Vec<Finding>) {
    let rates: Vec<StreamRate> = probe.streams().collect();
    let mut good = Vec::new();
    for rate in &rates {
        // PX4 sends it while it flies to a place; on the ground there is none.
        let is_for_later = rate.message_id == POSITION_TARGET_GLOBAL_INT_DATA::ID && rate.came_hz == 0.0;
        if is_for_later {
            continue;
        }
        if !rate.is_short {
            if rate.is_steady && rate.came_hz == 0.0 {
                continue; // It comes when it is needed.
            }
            good.push(match rate.is_steady {
                true if rate.came_hz < 2.0 => format!("{} {:.1} Hz", name(rate.message_id), rate.came_hz),
                true => format!("{} {:.0} Hz", name(rate.message_id), rate.came_hz),
                false => name(rate.message_id).to_owned(),
            });
        } else if rate.came_hz == 0.0 {
            findings.push(missing(probe, rate));
        } else {
            findings.push(slow(probe, rate));
        }
    }
    if rates.is_empty() {
        findings.push(Finding::warning(
            "streams",
            "there was not enough time to count the autopilot's messages",
            "look longer: --seconds 15",
        ));
    } else if !good.is_empty() {
        findings.push(Finding::good(
            "streams",
            format!("come often enough: {}", good.join(", ")),
        ));
    }
}

fn missing(probe: &ActiveProbe, rate: &StreamRate) -> Finding {
    let name = name(rate.message_id);
    let is = format!(
        "{name} does not come, and not when asked for; it reports {}",
        purpose(rate.message_id)
    );
    let remedy = if rate.message_id == LOCAL_POSITION_NED_DATA::ID {
        "the autopilot has no position yet: wait for GPS (or another source) until the ground station shows one, then look again"
    } else if rate.message_id == HOME_POSITION_DATA::ID {
        "home is set with the first position: wait for it, then look again"
    } else if rate.message_id == CURRENT_MODE_DATA::ID {
        "PX4 before 1.15 does not know it, and reports its mode once a second: update the firmware, or give changes of mode that second"
    } else if probe.autopilot_type() == Some(AutopilotType::Px4) {
        // In Onboard mode all these come; a network's port is in that mode by itself.
        "set the MAVLink mode of this port to Onboard (MAV_1_MODE = 2) and restart the autopilot"
    } else {
        "let nothing between jink and the autopilot filter it, and update the firmware if it does not know the message"
    };
    match is_vital(rate.message_id) {
        true => Finding::blocker(name, is, remedy),
        false => Finding::warning(name, is, remedy),
    }
}

fn slow(probe: &ActiveProbe, rate: &StreamRate) -> Finding {
    let name = name(rate.message_id);
    let is = format!(
        "{name} comes {:.1} times a second, and {:.0} are needed; it reports {}",
        rate.came_hz,
        rate.needed_hz,
        purpose(rate.message_id)
    );
    let remedy = match probe.autopilot_type() {
        Some(AutopilotType::Px4) => {
            "give the port more: SER_TEL2_BAUD = 921600 (and link.address the same), MAV_1_RATE = 0, MAV_1_MODE = 2 (Onboard)"
        }
        _ => {
            "give the port more: SERIALn_BAUD = 921 (and link.address 921600), and take away what else is streamed there"
        }
    };
    match is_state(rate.message_id) && rate.came_hz < STATE_RATE_MIN_HZ {
        true => Finding::blocker(name, is, remedy),
        false => Finding::warning(name, is, remedy),
    }
}

pub(super) fn time(probe: &ActiveProbe, findings: &mut Vec<Finding>) {
    let clock = probe.clock();
    let about = "TIMESYNC";
    let round_trip_s = clock.round_trip_ns() as f64 * 1e-9;
    if clock.samples() == 0 {
        findings.push(Finding::warning(
            about,
            "the autopilot does not answer TIMESYNC: its time stamps cannot be put on the board's clock, and are taken as they arrive",
            "let routers pass TIMESYNC on; a range is placed by the vehicle's pose of that moment, so an unsteady line blurs the map",
        ));
    } else if !clock.is_converged() {
        findings.push(Finding::warning(
            about,
            format!(
                "time is not synchronised: only {} answers to TIMESYNC that can be used",
                clock.samples()
            ),
            "look longer (--seconds 30); if it stays so, the autopilot's clock jumps, or the line is too slow or too unsteady",
        ));
    } else if probe.autopilot_type() == Some(AutopilotType::Px4) && round_trip_s > PX4_ROUND_TRIP_MAX_S {
        findings.push(Finding::warning(
            about,
            format!(
                "the shortest round trip is {:.1} ms, and PX4 synchronises below {:.0} ms only: it dates our messages by their arrival",
                round_trip_s * 1e3,
                PX4_ROUND_TRIP_MAX_S * 1e3
            ),
            "use a faster line (921600 bit/s), with nothing between that collects messages",
        ));
    } else {
        findings.push(Finding::good(
            about,
            format!(
                "clocks are synchronised, shortest round trip {:.1} ms{}",
                round_trip_s * 1e3,
                match clock.rate_error() {
                    0.0 => String::new(),
                    error => format!(
                        "; the autopilot's runs at {:.4} of the board's, as in simulations",
                        1.0 + error
                    ),
                }
            ),
        ));
    }
}
