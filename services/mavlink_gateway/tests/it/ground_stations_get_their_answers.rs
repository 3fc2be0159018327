//! What ground stations ask of our components, through real bytes: commands, parameters, files.
#![allow(deprecated)] // Ground stations still ask for PROTOCOL_VERSION.

use crate::support::*;
use jink_ground_services::computer::BoardReading;
use jink_mavlink_gateway::{COMPONENT_AVOIDANCE, COMPONENT_ONBOARD_COMPUTER};
use jink_parameter_server::ParameterServer;
use jink_shared_types::param_messages::{ParameterChange, TABLE_HASH};
use jink_shared_types::params::{GD_MARGIN, OA_ALT_MAX, OA_SPD_MAX, OA_YAW_MODE, Param, TABLE};
use mavlink::dialect::*;
use mavlink::types::CharArray;
use mavlink::{Message, MessageData};
use proptest::prelude::*;

const STATION: (u8, u8) = (255, 190);

/// A bench whose autopilot is known, with nothing logged yet.
fn acquainted(armed: bool) -> Bench {
    let mut bench = Bench::new();
    bench.receive_heartbeat(MODE_HOLD, armed);
    bench.step();
    bench.sent.clear();
    bench
}

fn ask(bench: &mut Bench, message: MavMessage) {
    bench.receive_from(STATION.0, STATION.1, message);
    bench.step();
}

fn command(command: MavCmd, params: [f32; 2], target_component: u8) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1: params[0],
        param2: params[1],
        command,
        target_system: SYSTEM,
        target_component,
        ..COMMAND_LONG_DATA::default()
    })
}

/// Everything of one kind that was sent, with its sender.
fn sent<T>(bench: &Bench, pick: impl Fn(&MavMessage) -> Option<T>) -> Vec<(u8, T)> {
    let of = |sent: &Sent| pick(&sent.message).map(|one| (sent.component_id, one));
    bench.sent.iter().filter_map(of).collect()
}

fn results(bench: &Bench) -> Vec<MavResult> {
    let acks = sent(bench, |message| match message {
        MavMessage::COMMAND_ACK(ack) => Some(ack.result),
        _ => None,
    });
    acks.into_iter().map(|(_, result)| result).collect()
}

fn values(bench: &Bench) -> Vec<PARAM_VALUE_DATA> {
    let values = sent(bench, |message| match message {
        MavMessage::PARAM_VALUE(value) => Some(value.clone()),
        _ => None,
    });
    assert!(
        values
            .iter()
            .all(|(component, _)| *component == COMPONENT_AVOIDANCE)
    );
    values.into_iter().map(|(_, value)| value).collect()
}

fn id(name: &str) -> CharArray<16> {
    let mut bytes = [0; 16];
    bytes[..name.len()].copy_from_slice(name.as_bytes());
    CharArray::new(bytes)
}

fn set(name: &str, param_value: f32, param_type: MavParamType) -> MavMessage {
    MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_value,
        target_system: SYSTEM,
        target_component: COMPONENT_AVOIDANCE,
        param_id: id(name),
        param_type,
    })
}

#[test]
fn every_message_that_can_be_asked_for_comes_at_once() {
    let mut bench = acquainted(false);
    bench.ground.board = Some(BoardReading::default());
    bench.idle_until(bench.now.plus_seconds(0.3));
    for (component, message_id) in [
        (COMPONENT_AVOIDANCE, HEARTBEAT_DATA::ID),
        (COMPONENT_AVOIDANCE, OBSTACLE_DISTANCE_DATA::ID),
        (COMPONENT_AVOIDANCE, AUTOPILOT_VERSION_DATA::ID),
        (COMPONENT_AVOIDANCE, PROTOCOL_VERSION_DATA::ID),
        (COMPONENT_AVOIDANCE, COMPONENT_METADATA_DATA::ID),
        (COMPONENT_ONBOARD_COMPUTER, HEARTBEAT_DATA::ID),
        (COMPONENT_ONBOARD_COMPUTER, ONBOARD_COMPUTER_STATUS_DATA::ID),
        (COMPONENT_ONBOARD_COMPUTER, AUTOPILOT_VERSION_DATA::ID),
    ] {
        bench.now = bench.now.plus_seconds(0.001);
        bench.step();
        bench.sent.clear();
        ask(
            &mut bench,
            command(
                MavCmd::MAV_CMD_REQUEST_MESSAGE,
                [message_id as f32, 0.0],
                component,
            ),
        );
        assert_eq!(results(&bench), [MavResult::MAV_RESULT_ACCEPTED], "{message_id}");
        let said = |sent: &Sent| sent.component_id == component && sent.message.message_id() == message_id;
        assert_eq!(
            bench.sent.iter().filter(|sent| said(sent)).count(),
            1,
            "{message_id}"
        );
    }
}

#[test]
fn a_board_that_nobody_has_read_yet_is_reported_later() {
    let mut bench = acquainted(false);
    let asked = [ONBOARD_COMPUTER_STATUS_DATA::ID as f32, 0.0];
    let ask_for_it = || command(MavCmd::MAV_CMD_REQUEST_MESSAGE, asked, COMPONENT_ONBOARD_COMPUTER);
    ask(&mut bench, ask_for_it());
    assert_eq!(results(&bench), [MavResult::MAV_RESULT_TEMPORARILY_REJECTED]);
    bench.sent.clear();
    bench.ground.board = Some(BoardReading::default());
    ask(&mut bench, ask_for_it());
    assert_eq!(results(&bench), [MavResult::MAV_RESULT_ACCEPTED]);
}

#[test]
fn the_version_announces_what_is_true_of_each_component() {
    for (autopilot, encoding, other) in [
        (
            MavAutopilot::MAV_AUTOPILOT_PX4,
            MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE,
            MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
        ),
        (
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
            MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE,
        ),
    ] {
        let mut bench = acquainted(false);
        bench.receive(MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot,
            ..HEARTBEAT_DATA::default()
        }));
        for component in [COMPONENT_AVOIDANCE, COMPONENT_ONBOARD_COMPUTER] {
            ask(
                &mut bench,
                command(MavCmd::MAV_CMD_REQUEST_MESSAGE, [148.0, 0.0], component),
            );
        }
        ask(
            &mut bench,
            set("OA_YAW_MODE", 0.0, MavParamType::MAV_PARAM_TYPE_INT32),
        );
        bench.step();
        let capabilities = sent(&bench, |message| match message {
            MavMessage::AUTOPILOT_VERSION(version) => Some(version.capabilities),
            _ => None,
        });
        let ftp = MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_FTP;
        let [(avoidance, of_avoidance), (_, of_computer)] = capabilities[..] else {
            panic!("{capabilities:?}");
        };
        assert_eq!(avoidance, COMPONENT_AVOIDANCE);
        assert!(of_avoidance.contains(encoding | ftp) && !of_avoidance.contains(other));
        assert!(!of_computer.intersects(encoding | other | ftp));
        assert_eq!(bench.ground.services.params().get(&OA_YAW_MODE), 0.0);
    }
}

#[test]
fn the_obstacle_map_comes_in_the_rhythm_that_was_asked_for_and_is_never_silenced() {
    let mut bench = acquainted(false);
    let rhythm = |us| {
        command(
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            [330.0, us],
            COMPONENT_AVOIDANCE,
        )
    };
    let maps = |bench: &mut Bench| {
        bench.sent.clear();
        bench.idle_until(bench.now.plus_seconds(4.0));
        let maps = |sent: &&Sent| matches!(sent.message, MavMessage::OBSTACLE_DISTANCE(_));
        bench.sent.iter().filter(maps).count()
    };
    ask(&mut bench, rhythm(100_000.0));
    ask(&mut bench, rhythm(-1.0));
    assert_eq!(
        results(&bench),
        [MavResult::MAV_RESULT_ACCEPTED, MavResult::MAV_RESULT_DENIED]
    );
    assert!((39..=41).contains(&maps(&mut bench)));
    ask(
        &mut bench,
        command(
            MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL,
            [330.0, 0.0],
            COMPONENT_AVOIDANCE,
        ),
    );
    let reported = sent(&bench, |message| match message {
        MavMessage::MESSAGE_INTERVAL(reported) => Some((reported.message_id, reported.interval_us)),
        _ => None,
    });
    assert_eq!(reported, [(COMPONENT_AVOIDANCE, (330, 100_000))]);
    ask(&mut bench, rhythm(0.0));
    assert!((19..=21).contains(&maps(&mut bench)));
}

#[test]
fn a_station_loosens_safety_only_while_the_vehicle_is_disarmed() {
    for (armed, value_in_force) in [(true, GD_MARGIN.default), (false, 0.0)] {
        let mut bench = acquainted(armed);
        ask(
            &mut bench,
            MavMessage::PARAM_SET(PARAM_SET_DATA {
                param_value: 0.0,
                target_system: SYSTEM,
                target_component: COMPONENT_AVOIDANCE,
                param_id: GD_MARGIN.name.into(),
                param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
            }),
        );
        bench.idle_until(bench.now.plus_seconds(2.0));
        let errors = sent(&bench, |message| match message {
            MavMessage::PARAM_ERROR(error) => Some(error.error),
            _ => None,
        });
        let told = sent(&bench, |message| match message {
            MavMessage::STATUSTEXT(line) => line.text.to_str().ok().map(str::to_owned),
            _ => None,
        });
        let text = "jink: GD_MARGIN only while disarmed";
        let told = told.iter().filter(|(_, line)| line == text).count();
        assert_eq!((errors.len(), told), (usize::from(armed), usize::from(armed)));
        let last = values(&bench).pop().unwrap();
        assert!((f64::from(last.param_value) - value_in_force).abs() < 1e-6);
        assert!((bench.ground.services.params().get(&GD_MARGIN) - value_in_force).abs() < 1e-6);
    }
}

#[test]
fn a_restart_waits_for_a_disarmed_vehicle_and_is_done_once() {
    let reboot = command(
        MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
        [1.0, 0.0],
        COMPONENT_AVOIDANCE,
    );
    let restarts = |bench: &mut Bench| {
        let end = bench.now.plus_seconds(2.0);
        let mut count = 0;
        while bench.now < end {
            bench.now = bench.now.plus_seconds(0.01);
            bench.step();
            count += usize::from(bench.outputs.restart);
        }
        count
    };
    let mut armed = acquainted(true);
    ask(&mut armed, reboot.clone());
    assert_eq!(results(&armed), [MavResult::MAV_RESULT_TEMPORARILY_REJECTED]);
    assert_eq!(restarts(&mut armed), 0);
    let lines = sent(&armed, |message| match message {
        MavMessage::STATUSTEXT(line) => line.text.to_str().map(str::to_owned).ok(),
        _ => None,
    });
    assert!(
        lines
            .iter()
            .any(|(_, line)| line == "jink: restart refused, vehicle is armed"),
        "{lines:?}"
    );

    let mut disarmed = acquainted(false);
    ask(&mut disarmed, reboot.clone());
    ask(&mut disarmed, reboot.clone());
    assert_eq!(
        results(&disarmed),
        [
            MavResult::MAV_RESULT_ACCEPTED,
            MavResult::MAV_RESULT_TEMPORARILY_REJECTED
        ]
    );
    assert_eq!(restarts(&mut disarmed), 1);

    let mut armed_since = acquainted(false);
    ask(&mut armed_since, reboot);
    armed_since.receive_heartbeat(MODE_HOLD, true);
    assert_eq!(restarts(&mut armed_since), 0, "it took off before the restart");
}

#[test]
fn all_parameters_are_listed_for_whoever_asks_all_components() {
    for (system, component) in [(SYSTEM, COMPONENT_AVOIDANCE), (SYSTEM, 0), (0, 0)] {
        let mut bench = acquainted(false);
        ask(
            &mut bench,
            MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
                target_system: system,
                target_component: component,
            }),
        );
        bench.idle_until(bench.now.plus_seconds(4.0));
        let names: Vec<String> = values(&bench)
            .iter()
            .map(|value| value.param_id.to_str().unwrap().to_owned())
            .collect();
        assert!(names.iter().eq(TABLE.iter().map(|row| row.name)), "{names:?}");
    }
    for (system, component) in [(SYSTEM, 1), (SYSTEM, COMPONENT_ONBOARD_COMPUTER), (7, 0)] {
        let mut bench = acquainted(false);
        ask(
            &mut bench,
            MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
                target_system: system,
                target_component: component,
            }),
        );
        bench.idle_until(bench.now.plus_seconds(3.0));
        assert!(values(&bench).is_empty());
    }
}

#[test]
fn a_changed_parameter_is_reported_to_everybody() {
    let mut bench = acquainted(false);
    ask(
        &mut bench,
        set("OA_SPD_MAX", 4.5, MavParamType::MAV_PARAM_TYPE_REAL32),
    );
    assert!(
        values(&bench).is_empty(),
        "nothing is in force before its owner says so"
    );
    bench.step();
    assert_eq!(values(&bench).len(), 1);
    // Somebody on the board changes it as well.
    let row = TABLE.iter().position(|row| row.name == "OA_SPD_MAX").unwrap();
    let server = bench.server.as_mut().unwrap();
    assert!(server.take(&ParameterChange {
        table: TABLE_HASH,
        id: 3,
        value: 5.5,
        row: row as u32,
        reserved: jink_shared_types::Reserved::ZERO,
    }));
    bench.parameters = Some(server.publish(bench.now));
    bench.step();
    let reported: Vec<f32> = values(&bench).iter().map(|value| value.param_value).collect();
    assert_eq!(reported, [4.5, 5.5]);
    assert_eq!(bench.ground.services.params().get(&OA_SPD_MAX), 5.5);
    // Refused: an answer of both kinds.
    bench.sent.clear();
    ask(
        &mut bench,
        set("OA_SPD_MAX", 1e9, MavParamType::MAV_PARAM_TYPE_REAL32),
    );
    let errors = sent(&bench, |message| match message {
        MavMessage::PARAM_ERROR(error) => Some((error.error, (error.target_system, error.target_component))),
        _ => None,
    });
    let expected = (MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE, STATION);
    assert_eq!(errors, [(COMPONENT_AVOIDANCE, expected)]);
    assert_eq!(values(&bench)[0].param_value, 5.5);
}

#[test]
fn without_the_parameters_owner_a_station_gets_the_value_that_stays() {
    let mut bench = acquainted(false);
    bench.server = None;
    let float = MavParamType::MAV_PARAM_TYPE_REAL32;
    for (name, value) in [("OA_SPD_MAX", 4.5), ("OA_ALT_MAX", 40.0), ("OA_SPD_MAX", 5.0)] {
        ask(&mut bench, set(name, value, float));
    }
    bench.fly(1.5, |_, _| {});
    let reported: Vec<_> = values(&bench);
    let stays = |row: &Param| {
        let named = reported
            .iter()
            .filter(|one| one.param_id.to_str() == Ok(row.name));
        named.map(|one| f64::from(one.param_value)).collect::<Vec<_>>()
    };
    // The first was with the owner when he died; the third came behind it.
    assert_eq!(stays(&OA_SPD_MAX), [OA_SPD_MAX.default; 2]);
    assert_eq!(stays(&OA_ALT_MAX), [OA_ALT_MAX.default]);
    // It is back, and has what is asked from now on.
    bench.server = Some(ParameterServer::new(bench.ground.services.params()));
    bench.sent.clear();
    ask(&mut bench, set("OA_SPD_MAX", 4.5, float));
    bench.step();
    assert_eq!(values(&bench)[0].param_value, 4.5);
}

/// One request of the file transfer, and the answers that come within the given time.
fn transfer(bench: &mut Bench, request: &[u8], wait_s: f64) -> Vec<[u8; 251]> {
    let mut payload = [0; 251];
    payload[..request.len()].copy_from_slice(request);
    bench.sent.clear();
    ask(
        bench,
        MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
            target_network: 0,
            target_system: SYSTEM,
            target_component: COMPONENT_AVOIDANCE,
            payload,
        }),
    );
    bench.idle_until(bench.now.plus_seconds(wait_s));
    let answers = sent(bench, |message| match message {
        MavMessage::FILE_TRANSFER_PROTOCOL(answer) => {
            assert_eq!((answer.target_system, answer.target_component), STATION);
            Some(answer.payload)
        }
        _ => None,
    });
    answers.into_iter().map(|(_, payload)| payload).collect()
}

#[test]
fn the_metadata_lead_from_the_message_to_every_parameter() {
    let mut bench = acquainted(false);
    ask(
        &mut bench,
        command(MavCmd::MAV_CMD_REQUEST_MESSAGE, [397.0, 0.0], COMPONENT_AVOIDANCE),
    );
    let metadata = sent(&bench, |message| match message {
        MavMessage::COMPONENT_METADATA(metadata) => Some(metadata.clone()),
        _ => None,
    });
    let (_, metadata) = &metadata[0];
    let mut address = metadata.uri.to_str().unwrap().to_owned();
    let mut crc = metadata.file_crc;
    let mut seq = 0u16;
    let mut files = Vec::new();
    for _ in 0..2 {
        let path = address.strip_prefix("mftp://").unwrap().to_owned();
        let header = |seq: u16, session: u8, opcode: u8, size: u8, offset: u32| {
            let [s0, s1] = seq.to_le_bytes();
            let [o0, o1, o2, o3] = offset.to_le_bytes();
            vec![s0, s1, session, opcode, size, 0, 0, 0, o0, o1, o2, o3]
        };
        let mut open = header(seq, 0, 4, path.len() as u8, 0);
        open.extend(path.as_bytes());
        let [opened] = transfer(&mut bench, &open, 0.0)[..] else {
            panic!("not opened");
        };
        let size = u32::from_le_bytes(opened[12..16].try_into().unwrap()) as usize;
        let mut content = Vec::new();
        while content.len() < size {
            seq += 100;
            let burst = header(seq, opened[2], 15, 239, content.len() as u32);
            let pieces = transfer(&mut bench, &burst, 4.0);
            assert!(!pieces.is_empty());
            for (i, piece) in pieces.iter().enumerate() {
                assert_eq!(u16::from_le_bytes([piece[0], piece[1]]), seq + 1 + i as u16);
                assert_eq!(
                    piece[6] != 0,
                    i + 1 == pieces.len(),
                    "the burst ends with its last piece"
                );
                content.extend(&piece[12..12 + usize::from(piece[4])]);
            }
        }
        seq += 100;
        assert_eq!(
            transfer(&mut bench, &header(seq, opened[2], 1, 0, 0), 0.0)[0][3],
            128
        );
        assert_eq!(mavlink_crc(&content), crc);
        let file: serde_json::Value = serde_json::from_slice(&content).unwrap();
        if let Some(next) = file["metadataTypes"][0]["uri"].as_str() {
            address = next.to_owned();
            crc = file["metadataTypes"][0]["fileCrc"].as_u64().unwrap() as u32;
        }
        files.push(file);
        seq += 100;
    }
    assert_eq!(files[1]["parameters"].as_array().unwrap().len(), TABLE.len());
}

/// Bit by bit, for the comparison.
fn mavlink_crc(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 * (crc & 1))
        })
    })
}

#[test]
fn the_board_is_described_every_five_seconds_by_the_computer_component() {
    let mut bench = acquainted(false);
    bench.ground.board = Some(BoardReading {
        temperature_c: 55,
        ..BoardReading::default()
    });
    bench.step();
    bench.idle_until(bench.now.plus_seconds(22.5));
    let reported = sent(&bench, |message| match message {
        MavMessage::ONBOARD_COMPUTER_STATUS(status) => Some(status.temperature_board),
        _ => None,
    });
    assert_eq!(reported, [(COMPONENT_ONBOARD_COMPUTER, 55); 5]);
}

/// Messages to us with anything in every field.
fn garbage() -> impl Strategy<Value = Vec<u8>> {
    let ids = prop_oneof![Just(20u8), Just(21), Just(23), Just(75), Just(76), Just(110)];
    (ids, proptest::collection::vec(any::<u8>(), 254), any::<bool>()).prop_map(
        |(message_id, mut payload, aim)| {
            let (len, target_at) = match message_id {
                20 => (20, 2),
                21 => (2, 0),
                23 => (23, 4),
                75 => (35, 30),
                76 => (33, 30),
                _ => (254, 1),
            };
            payload.truncate(len);
            if aim {
                payload[target_at] = SYSTEM;
                payload[target_at + 1] = COMPONENT_AVOIDANCE;
            }
            let mut frame = vec![0xfd, len as u8, 0, 0, 0, STATION.0, STATION.1, message_id, 0, 0];
            frame.extend(payload);
            let seed = <MavMessage as mavlink::Message>::extra_crc(u32::from(message_id));
            let crc = mavlink::calculate_crc(&frame[1..], seed);
            frame.extend(crc.to_le_bytes());
            frame
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn anything_in_any_field_gets_at_most_one_answer_and_never_stops_the_setpoints(
        frames in proptest::collection::vec(garbage(), 1..40),
    ) {
        let mut bench = Bench::new();
        let still = nalgebra::Vector3::zeros();
        let mut frames = frames.into_iter();
        bench.fly(2.0, |bench, t| {
            bench.telemetry(t, MODE_HOLD, still, still);
            if t > 0.5 && let Some(frame) = frames.next() {
                let acks = results(bench).len();
                bench.step();
                bench.receive_bytes(&frame);
                bench.step();
                let is_command = matches!(frame[7], 75 | 76);
                assert!(results(bench).len() - acks <= usize::from(is_command));
            }
        });
        prop_assert!(bench.curves().len() > 25, "{} setpoints", bench.curves().len());
        for (row, value) in bench.ground.services.params().rows() {
            prop_assert!((row.min..=row.max).contains(&value));
        }
    }
}
