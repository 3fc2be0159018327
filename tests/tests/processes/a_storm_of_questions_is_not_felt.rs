//! A ground station floods our components with questions while the ground services are killed under it: the gateway is not
//! touched, its setpoints go on, the flight reaches its goal, and whoever asks again is answered.
//!
//! `JINK_STORM_KILLS` kills more often.

use jink_mavlink_link::encoder::Encoder;
use jink_mavlink_link::frame::Splitter;
use jink_mavlink_link::message::{
    Body, COMPONENT_AUTOPILOT, COMPONENT_AVOIDANCE, COMPONENT_ONBOARD_COMPUTER,
};
use jink_tests::peers::Network;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{program, until};
use mavlink::MessageData;
use mavlink::dialect::*;
use mavlink::types::CharArray;
use std::collections::BTreeMap;
use std::net::UdpSocket;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Kills of one flight.
const KILLS: u64 = 8;
/// From one kill to the next at least: a process that dies eight times within ten seconds is given up.
const BETWEEN_KILLS: Duration = Duration::from_millis(1400);
/// PX4 flies on without setpoints after half a second (s).
const PX4_PATIENCE_S: f64 = 0.5;
const STATION: (u8, u8) = (255, 190);
const SYSTEM: u8 = 1;

/// A ground station that asks a thousand times a second, from a thread of its own.
struct Storm {
    end: Arc<AtomicBool>,
    /// Answers so far, by sending component and message id.
    answers: Arc<Mutex<BTreeMap<(u8, u32), u64>>>,
    thread: Option<JoinHandle<u64>>,
}

impl Storm {
    fn begin(port: u16) -> Self {
        let end = Arc::new(AtomicBool::new(false));
        let answers = Arc::default();
        let (thread_end, thread_answers) = (Arc::clone(&end), Arc::clone(&answers));
        let thread = std::thread::spawn(move || ask(port, &thread_end, &thread_answers));
        Self {
            end,
            answers,
            thread: Some(thread),
        }
    }

    /// Messages of one kind that our component has sent.
    fn answered(&self, component: u8, message_id: u32) -> u64 {
        let answers = self.answers.lock().unwrap();
        answers.get(&(component, message_id)).copied().unwrap_or(0)
    }

    /// Questions asked.
    fn end(mut self) -> u64 {
        self.end.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap()
    }
}

impl Drop for Storm {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
    }
}

fn ask(port: u16, end: &AtomicBool, answers: &Mutex<BTreeMap<(u8, u32), u64>>) -> u64 {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(("127.0.0.1", port)).unwrap();
    socket.set_nonblocking(true).unwrap();
    let (mut encoder, mut splitter) = (Encoder::new(), Splitter::new());
    let mut buffer = [0; 2048];
    let mut asked = 0;
    while !end.load(Ordering::Relaxed) {
        let body = Body::Message(question(asked));
        // A full buffer loses some: the next ones are as good.
        let _lost = socket.send(encoder.encode(STATION.0, STATION.1, &body));
        asked += 1;
        while let Ok(len) = socket.recv(&mut buffer) {
            splitter.load_datagram(&buffer[..len]);
            while let Some(frame) = splitter.next_frame() {
                let key = (frame.header.component_id, frame.message_id);
                *answers.lock().unwrap().entry(key).or_default() += 1;
            }
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    asked
}

/// One of everything that a ground station asks, some of it nonsense.
fn question(number: u64) -> MavMessage {
    let (target_system, target_component) = (SYSTEM, COMPONENT_AVOIDANCE);
    let turn = number / 12;
    let command = |target_component, command, param1: f32, param2: f32| {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            command,
            target_system,
            target_component,
            ..COMMAND_LONG_DATA::default()
        })
    };
    match number % 12 {
        0 => MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_GCS,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            ..HEARTBEAT_DATA::default()
        }),
        1 => MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
            target_system,
            target_component: 0,
        }),
        2 => MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
            param_index: (turn % 50) as i16,
            target_system,
            target_component,
            ..PARAM_REQUEST_READ_DATA::default()
        }),
        3 => MavMessage::PARAM_SET(PARAM_SET_DATA {
            param_value: 1.0 + (turn % 20) as f32,
            target_system,
            target_component,
            param_id: CharArray::new(*b"GW_OBST_RATE\0\0\0\0"),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        }),
        4 | 5 => files(turn),
        6 => command(
            COMPONENT_AVOIDANCE,
            MavCmd::MAV_CMD_REQUEST_MESSAGE,
            [
                AUTOPILOT_VERSION_DATA::ID,
                COMPONENT_METADATA_DATA::ID,
                HEARTBEAT_DATA::ID,
            ][turn as usize % 3] as f32,
            0.0,
        ),
        7 => command(
            COMPONENT_ONBOARD_COMPUTER,
            MavCmd::MAV_CMD_REQUEST_MESSAGE,
            ONBOARD_COMPUTER_STATUS_DATA::ID as f32,
            0.0,
        ),
        8 => command(
            COMPONENT_AVOIDANCE,
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            OBSTACLE_DISTANCE_DATA::ID as f32,
            100_000.0 - (turn % 3) as f32 * 200_000.0,
        ),
        // We have no motors.
        9 => command(
            COMPONENT_AVOIDANCE,
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            0.0,
            21_196.0,
        ),
        10 => MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
            target_system,
            target_component: COMPONENT_AUTOPILOT,
            ..MISSION_REQUEST_LIST_DATA::default()
        }),
        _ => MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
            seq: (turn % 4) as u16,
            target_system,
            target_component: COMPONENT_AUTOPILOT,
            ..MISSION_REQUEST_INT_DATA::default()
        }),
    }
}

/// Opens, reads, bursts, lists and closes, in sessions of its own and in those of nobody.
fn files(turn: u64) -> MavMessage {
    let mut payload = [0; 251];
    payload[..2].copy_from_slice(&(turn as u16).to_le_bytes());
    payload[2] = (turn % 3) as u8;
    payload[3] = [4, 15, 5, 3, 1, 2, 7][turn as usize % 7];
    let path = b"/general.json";
    payload[4] = path.len() as u8;
    payload[12..12 + path.len()].copy_from_slice(path);
    if payload[3] == 15 || payload[3] == 5 {
        payload[4] = 239;
    }
    MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
        target_network: 0,
        target_system: SYSTEM,
        target_component: COMPONENT_AVOIDANCE,
        payload,
    })
}

#[test]
fn however_often_the_ground_services_are_killed_under_it() {
    let kills =
        std::env::var("JINK_STORM_KILLS").map_or(KILLS, |kills| kills.parse().expect("a number of kills"));
    let station = free_udp_port();
    let sets = [format!("simulation.ground_station_port={station}")];
    let jink = Network::up("storm", None, &[("ground", "")], &[&sets[0]]);
    let storm = Storm::begin(jink.ports[0]);
    let answers = || storm.answered(COMPONENT_AVOIDANCE, PARAM_VALUE_DATA::ID);
    let acks = || storm.answered(COMPONENT_AVOIDANCE, COMMAND_ACK_DATA::ID);
    until("answers on the ground", || answers() > 20 && acks() > 20);
    let port = station.to_string();
    let mut mission = program("jink-simulator", &["fly", "--port", &port, "--world", "empty"]);
    let mission = mission.stdout(Stdio::piped()).spawn().unwrap();
    jink.until_it_flies();
    for kill in 1..=kills {
        let begin = Instant::now();
        jink.kill("ground_services");
        until("the next instance", || {
            let service = jink.service("ground_services");
            service["restarts"] == kill && service["state"] == "active"
        });
        let (values, acknowledged) = (answers(), acks());
        until("answers again", || answers() > values && acks() > acknowledged);
        std::thread::sleep(BETWEEN_KILLS.saturating_sub(begin.elapsed()));
    }
    let status = jink.status();
    let flown = mission.wait_with_output().unwrap();
    assert_eq!(flown.status.code(), Some(0), "{flown:?}\n{status:#}");
    let gateway = jink.service("mavlink_gateway");
    assert_eq!(gateway["restarts"], 0, "{gateway}");
    assert_eq!(jink.truth_number("collisions"), Some(0.0), "{}", jink.truth());
    assert_eq!(jink.truth_number("hold_count"), Some(0.0), "{}", jink.truth());
    // On the autopilot's clock, which stands still with the machine.
    let gap_s = jink.truth_number("setpoint_gap_max_s").unwrap();
    let missions = storm.answered(COMPONENT_AUTOPILOT, MISSION_COUNT_DATA::ID);
    let files = storm.answered(COMPONENT_AVOIDANCE, FILE_TRANSFER_PROTOCOL_DATA::ID);
    let (values, acknowledged) = (answers(), acks());
    let asked = storm.end();
    println!(
        "{kills} kills under {asked} questions: {values} PARAM_VALUE, {acknowledged} COMMAND_ACK, {files} FILE_TRANSFER_PROTOCOL, \
         {missions} MISSION_COUNT; largest gap between setpoints {gap_s} s"
    );
    assert!(missions > 0 && files > 0, "{missions} {files}");
    assert!(gap_s < PX4_PATIENCE_S, "silent for {gap_s} s");
}
