//! A second autopilot on the port of a vehicle in flight: it gets nothing, and a gateway that is killed beside it flies on with its own.

use jink_tests::processes::{Flight, until};
use mavlink::dialect::{HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavMessage, MavType};
use mavlink::{MAVLinkV2MessageRaw, MavHeader};
use std::net::UdpSocket;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The second one's system.
const OTHER: u32 = 7;

fn frame(message: &MavMessage) -> Vec<u8> {
    let mut frame = MAVLinkV2MessageRaw::new();
    let header = MavHeader {
        system_id: OTHER,
        component_id: 1,
        sequence: 0,
    };
    frame.serialize_message(header, message);
    frame.raw_bytes().to_vec()
}

/// The address on which the gateway of `flight` waits for its autopilot.
fn address(flight: &Flight) -> Option<String> {
    let file = format!("/dev/shm/jink_{}/config/jink.toml", flight.instance());
    let text = std::fs::read_to_string(Path::new(&file)).ok()?;
    let line = text.lines().find(|line| line.starts_with("address = \"udpin:"))?;
    Some(
        line.trim_start_matches("address = \"udpin:")
            .trim_end_matches('"')
            .to_owned(),
    )
}

#[test]
fn a_gateway_killed_beside_a_second_autopilot_flies_on_with_its_own() {
    let flight = Flight::begin(&[
        "--seed",
        "4",
        "--autopilot",
        "px4_current",
        "--kill",
        "mavlink_gateway@4s",
    ]);
    let mut to = None;
    until("the address of the link", || {
        to = address(&flight);
        to.is_some()
    });
    until("jink flies the mission", || flight.truth()["mode"] == "offboard");
    let other = UdpSocket::bind("127.0.0.1:0").unwrap();
    other.connect(to.unwrap()).unwrap();
    other.set_nonblocking(true).unwrap();
    let (ends, mut answers) = (AtomicBool::new(false), 0);
    let figures = std::thread::scope(|scope| {
        let speaks = scope.spawn(|| {
            let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_QUADROTOR,
                autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
                ..HEARTBEAT_DATA::default()
            });
            let place = MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                x: 70.0,
                ..LOCAL_POSITION_NED_DATA::default()
            });
            let mut datagram = [0; 300];
            while !ends.load(Ordering::Relaxed) {
                for message in [&beat, &place] {
                    // Refused while the gateway is being started again.
                    let _nobody_there = other.send(&frame(message));
                }
                while other.recv(&mut datagram).is_ok() {
                    answers += 1;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        until("the restart", || {
            flight.service("mavlink_gateway")["restarts"] == 1
        });
        let figures = flight.end();
        ends.store(true, Ordering::Relaxed);
        speaks.join().unwrap();
        figures
    });
    assert_eq!(answers, 0, "the second autopilot was answered");
    assert_eq!(figures["outcome"], "goal", "{figures}");
    assert_eq!(figures["collisions"], 0, "{figures}");
    assert_eq!(figures["faults"][0]["survived"], true, "{figures}");
}
