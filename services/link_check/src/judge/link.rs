//! The links themselves: open, something comes, it is MAVLink, in version 2, and its signatures fit.

use crate::finding::Finding;
use crate::limits::{GARBAGE_PART, LOST_PART, NO_MAVLINK_BYTES, PART_OF_AT_LEAST};
use crate::{Counts, LinkCheck, LinkState};
use jink_mavlink_link::link::Endpoint;
use jink_mavlink_link::links::LinkSetup;
use jink_runtime::config::{Purpose, Signing};

pub(super) fn judge(check: &LinkCheck, findings: &mut Vec<Finding>) {
    let several = check.plan.links.len() > 1;
    for (setup, line) in check.plan.links.iter().zip(&check.link_states) {
        let about = if several {
            format!("link {}", setup.name)
        } else {
            "link".to_owned()
        };
        if setup.purpose == Purpose::GroundStation {
            findings.push(ground_station(about, setup, line));
            continue;
        }
        let counts = &line.counts;
        if let Some(cause) = &line.failure {
            findings.push(Finding::blocker(
                about,
                cause.clone(),
                open_remedy(&setup.endpoint),
            ));
        } else if counts.bytes() == 0 {
            findings.push(silent(about, setup, counts));
        } else if counts.frames == 0 {
            findings.push(no_mavlink(about, setup, counts));
        } else {
            quality(&about, setup, counts, findings);
            protocol(counts, findings);
            let answers = check.probe.as_ref().map_or(0, |probe| probe.answers());
            signatures(setup.signing, counts, answers, findings);
        }
    }
}

/// It need not be there for a flight.
fn ground_station(about: String, setup: &LinkSetup, line: &LinkState) -> Finding {
    match &line.failure {
        Some(cause) => Finding::warning(about, cause.clone(), open_remedy(&setup.endpoint)),
        None if line.counts.frames == 0 => Finding::good(
            about,
            format!("nobody speaks on {} yet; it is not needed to fly", setup.endpoint),
        ),
        None => Finding::good(about, format!("somebody speaks on {}", setup.endpoint)),
    }
}

fn open_remedy(endpoint: &Endpoint) -> &'static str {
    match endpoint {
        Endpoint::Serial { .. } => {
            "name the device that the autopilot is connected to (`ls -l /dev/serial/by-id /dev/tty*`), and let this user open it \
             (group dialout)"
        }
        Endpoint::UdpIn { .. } | Endpoint::TcpIn { .. } => {
            "end the program that holds the port, or give jink another one; if that program is a router, let it send to a port of \
             jink's own"
        }
        Endpoint::UdpOut { .. } | Endpoint::TcpOut { .. } => {
            "check that host and port are right, that the other end runs, and that this board reaches it (ping)"
        }
        Endpoint::Unix { .. } => {
            "start the program at the other end first: it makes the socket, and this user must be allowed to write to it"
        }
    }
}

fn silent(about: String, setup: &LinkSetup, counts: &Counts) -> Finding {
    let endpoint = &setup.endpoint;
    if counts.unknown_peers > 0 {
        return Finding::blocker(
            about,
            format!(
                "{} datagrams or connections on {endpoint} came from addresses that are not in link.peers, and none from one that is",
                counts.unknown_peers
            ),
            "add the autopilot's address to link.peers, or empty the list to hear everybody",
        );
    }
    let remedy = match endpoint {
        Endpoint::Serial { .. } => {
            "check the wires (TX to RX and RX to TX, a common ground), the device's name, and that the autopilot speaks MAVLink on this \
             port: PX4 MAV_1_CONFIG, ArduPilot SERIALn_PROTOCOL = 2"
        }
        Endpoint::UdpIn { .. } | Endpoint::TcpIn { .. } => {
            "let the autopilot or its router send to this port: PX4 in simulation sends to 14540 on the same host; over a network give \
             0.0.0.0 for the host"
        }
        Endpoint::UdpOut { .. } | Endpoint::TcpOut { .. } => {
            "check that something listens there and answers to the address that we send from: PX4 in simulation listens on 14580"
        }
        Endpoint::Unix { .. } => {
            "check that the program at the other end sends to the path with \".jink\" behind it"
        }
    };
    Finding::blocker(about, format!("nothing arrives on {endpoint}"), remedy)
}

fn no_mavlink(about: String, setup: &LinkSetup, counts: &Counts) -> Finding {
    let endpoint = &setup.endpoint;
    let bytes = counts.bytes();
    if bytes < NO_MAVLINK_BYTES {
        return Finding::blocker(
            about,
            format!("{bytes} bytes arrive on {endpoint}, too few to tell what they are"),
            "look longer (--seconds 30); if it stays so, the line is loose or something else speaks there",
        );
    }
    let remedy = match endpoint {
        Endpoint::Serial { baud, .. } => format!(
            "{baud} bit/s is probably the wrong speed: give link.address that of the autopilot's port (PX4 SER_TEL2_BAUD, ArduPilot \
             SERIALn_BAUD)"
        ),
        _ => "something else speaks to this port: find it (`ss -lunp`, `ss -ltnp`) and give jink another one"
            .to_owned(),
    };
    Finding::blocker(
        about,
        format!("{bytes} bytes arrive on {endpoint}, but no MAVLink message among them"),
        remedy,
    )
}

fn quality(about: &str, setup: &LinkSetup, counts: &Counts, findings: &mut Vec<Finding>) {
    let endpoint = &setup.endpoint;
    let garbage = counts.garbage_bytes as f64 / counts.bytes() as f64;
    let received = counts.version_1 + counts.version_2;
    let lost = counts.lost as f64 / (received + counts.lost).max(1) as f64;
    let remedy = match endpoint {
        Endpoint::Serial { .. } => {
            "check the ground wire and the length of the line, use flow control on neither side, or a lower baud rate on both"
        }
        _ => {
            "look for what the line loses: a weak radio, a router that is overloaded, two programs on one port"
        }
    };
    if counts.frames >= PART_OF_AT_LEAST && garbage > GARBAGE_PART {
        findings.push(Finding::warning(
            about,
            format!(
                "{:.0} % of the bytes on {endpoint} belong to no message",
                garbage * 100.0
            ),
            remedy,
        ));
    } else if received >= PART_OF_AT_LEAST && lost > LOST_PART {
        findings.push(Finding::warning(
            about,
            format!(
                "{:.0} % of the autopilot's messages are lost before {endpoint}",
                lost * 100.0
            ),
            remedy,
        ));
    } else {
        findings.push(Finding::good(about, format!("MAVLink arrives on {endpoint}")));
    }
}

fn protocol(counts: &Counts, findings: &mut Vec<Finding>) {
    if counts.version_1 > 0 && counts.version_2 == 0 {
        findings.push(Finding::blocker(
            "MAVLink 2",
            "the autopilot speaks MAVLink 1 only, which has no room for what jink exchanges",
            "PX4: set MAV_PROTO_VER to 2; ArduPilot: set SERIALn_PROTOCOL of this port to 2",
        ));
    } else if counts.version_2 > 0 {
        findings.push(Finding::good("MAVLink 2", "the autopilot speaks MAVLink 2"));
    }
}

fn signatures(signing: Signing, counts: &Counts, answers: u32, findings: &mut Vec<Finding>) {
    let about = "signatures";
    if counts.signature_refused > 0 {
        findings.push(Finding::blocker(
            about,
            format!("{} messages are signed with another key than link.key_file holds", counts.signature_refused),
            "give both sides the same key: set it up anew on the autopilot (ground station, MAVLink 2 signing), or correct the key file",
        ));
    } else if counts.unsigned_refused > 0 && counts.signed == 0 {
        findings.push(Finding::blocker(
            about,
            format!(
                "link.signing = \"require\", and what arrives is not signed: {} messages refused",
                counts.unsigned_refused
            ),
            "give the autopilot the key (ground station, MAVLink 2 signing), or set link.signing to \"accept\" or \"off\"",
        ));
    } else if counts.replayed > 0 {
        findings.push(Finding::warning(
            about,
            format!(
                "{} signed messages were refused as not newer than what was received",
                counts.replayed
            ),
            "look for a line that delivers twice; if a clock was wrong once, set up the key anew",
        ));
    } else if signing == Signing::Off && counts.signed > 0 && answers == 0 {
        findings.push(Finding::blocker(
            about,
            "the autopilot signs and answers nothing that is not signed, and jink has no key (link.signing = \"off\")",
            "set link.signing to \"accept\" and link.key_file to the file with the autopilot's key (docs/links.md)",
        ));
    } else if signing == Signing::Off && counts.signed > 0 {
        findings.push(Finding::warning(
            about,
            "the autopilot signs, and jink does not look at it (link.signing = \"off\")",
            "set link.signing to \"accept\" and link.key_file to the file with the autopilot's key (docs/links.md)",
        ));
    } else if signing != Signing::Off && counts.signed > 0 {
        findings.push(Finding::good(about, "the autopilot's signatures fit the key"));
    } else if signing == Signing::Accept {
        findings.push(Finding::good(
            about,
            "the autopilot does not sign; that is accepted",
        ));
    }
}
