//! pymavlink asks the gateway over a link for ground stations whatever docs/mavlink.md says can be asked: parameters, commands,
//! files. Every question gets its one answer, every refusal its reason, and what is reported agrees with `jink param`.

use jink_tests::peers::{GATEWAY_ONLY, Network, PYMAVLINK, Station, of, python_or_say, received};
use jink_tests::processes::{answer, until, workspace};
use serde_json::{Value, json};
use std::process::Command;

const VEHICLE: u8 = 1;
const AVOIDANCE: u8 = 196;
const COMPUTER: u8 = 191;

/// MAV_PARAM_TYPE_INT32 and MAV_PARAM_TYPE_REAL32.
const INT32: u64 = 6;
const REAL32: u64 = 9;

/// MAV_PARAM_ERROR.
const DOES_NOT_EXIST: u64 = 1;
const OUT_OF_RANGE: u64 = 2;

/// MAV_RESULT.
const ACCEPTED: u64 = 0;
const DENIED: u64 = 2;
const UNSUPPORTED: u64 = 3;

/// MAV_CMD.
const GET_INTERVAL: u64 = 510;
const SET_INTERVAL: u64 = 511;
const REQUEST_MESSAGE: u64 = 512;

fn acquainted(role: &str) -> Option<(Network, Station)> {
    let python = python_or_say(&PYMAVLINK)?;
    let network = Network::up(role, Some(GATEWAY_ONLY), &[("ground", "")], &[]);
    let mut station = Station::start(&python);
    station.open("ground", network.ports[0]);
    // Nothing is answered before the vehicle is known.
    until("the autopilot", || {
        network.status()["link"]["system_id"] == VEHICLE
    });
    Some((network, station))
}

/// What was sent to a link of 32-bit floats.
fn as_f32(value: &Value) -> Value {
    json!(f64::from(value.as_f64().unwrap() as f32))
}

#[test]
fn parameters_are_listed_read_and_set_as_the_board_knows_them() {
    let Some((network, mut station)) = acquainted("peer_params") else {
        return;
    };
    let us = json!({"target_system": VEHICLE, "target_component": AVOIDANCE});
    let known = network.parameters();
    let count = known.len();
    let said = station.send(
        "ground",
        "PARAM_REQUEST_LIST",
        &us,
        &json!({"PARAM_VALUE": count}),
    );
    let values = of(&said, AVOIDANCE, "PARAM_VALUE");
    assert_eq!(values.len(), count, "each once");
    for (index, row) in known.iter().enumerate() {
        let reported = values.iter().find(|reported| reported["param_index"] == index);
        let reported = reported.unwrap_or_else(|| panic!("number {index} is missing"));
        assert_eq!(reported["param_id"], row["name"]);
        assert_eq!(reported["param_count"], count);
        let kind = match row["kind"].as_str().unwrap() {
            "integer" => INT32,
            "boolean" => 1,
            _ => REAL32,
        };
        assert_eq!(reported["param_type"], kind, "{row}");
        assert_eq!(as_f32(&reported["value"]), as_f32(&row["value"]), "{row}");
    }
    println!("PARAM_REQUEST_LIST: {count} parameters, numbers, types and values as in `jink param list`");

    for (index, name) in [(0, ""), (count - 1, ""), (usize::MAX, "OA_SPD_MAX")] {
        let by_number = index != usize::MAX;
        let read = json!({"target_system": VEHICLE, "target_component": AVOIDANCE, "param_id": name,
            "param_index": if by_number { json!(index) } else { json!(-1) }});
        let said = station.send("ground", "PARAM_REQUEST_READ", &read, &json!({}));
        let reported = of(&said, AVOIDANCE, "PARAM_VALUE");
        assert_eq!(reported.len(), 1, "{read}: {said:?}");
        let wanted = if by_number {
            known[index]["name"].clone()
        } else {
            json!(name)
        };
        assert_eq!(reported[0]["param_id"], wanted);
    }
    for (index, name) in [(json!(-1), "NOT_THERE"), (json!(count), "")] {
        let read = json!({"target_system": VEHICLE, "target_component": AVOIDANCE, "param_id": name,
            "param_index": index});
        let said = station.send("ground", "PARAM_REQUEST_READ", &read, &json!({}));
        let errors = of(&said, AVOIDANCE, "PARAM_ERROR");
        assert_eq!(errors.len(), 1, "{read}: {said:?}");
        assert_eq!(errors[0]["error"], DOES_NOT_EXIST);
        assert!(of(&said, AVOIDANCE, "PARAM_VALUE").is_empty(), "{said:?}");
    }
    println!("PARAM_REQUEST_READ: by name and by number; unknown ones are PARAM_ERROR {DOES_NOT_EXIST}");

    for case in SETS {
        let order =
            json!({"do": "set", "line": "ground", "name": case.name, "value": case.value, "type": case.kind});
        let said = received(&station.ask(&order));
        let errors: Vec<_> = of(&said, AVOIDANCE, "PARAM_ERROR");
        let reported = of(&said, AVOIDANCE, "PARAM_VALUE");
        match case.refused {
            None => assert!(errors.is_empty(), "{said:?}"),
            Some(reason) => {
                assert_eq!(errors.len(), 1, "{said:?}");
                assert_eq!(errors[0]["error"], reason, "{said:?}");
                assert_eq!(errors[0]["target_component"], 190, "to whoever asked");
            }
        }
        println!(
            "PARAM_SET {} {}: error {:?}, in force {:?}",
            case.name, case.value, case.refused, case.in_force
        );
        let Some(in_force) = case.in_force else {
            assert!(reported.is_empty(), "{said:?}");
            continue;
        };
        assert_eq!(reported.len(), 1, "{said:?}");
        assert_eq!(
            as_f32(&reported[0]["value"]),
            as_f32(&json!(in_force)),
            "{said:?}"
        );
        let on_board = network.jink(&["param", "get", case.name]);
        let on_board: f64 = on_board
            .stdout
            .trim()
            .parse()
            .unwrap_or_else(|_| panic!("{on_board:?}"));
        assert!((on_board - in_force).abs() < 1e-6, "{}: {on_board}", case.name);
    }

    // A change made on the board is sent to ground stations without being asked for.
    let waits = json!({"do": "wait", "line": "ground", "kind": "PARAM_VALUE", "count": 1});
    let set = std::thread::scope(|scope| {
        let set = scope.spawn(|| network.jink(&["param", "set", "OA_SPD_MAX", "2.25"]));
        let reported = received(&station.ask(&waits));
        assert_eq!(
            of(&reported, AVOIDANCE, "PARAM_VALUE")[0]["value"],
            2.25,
            "{reported:?}"
        );
        set.join().unwrap()
    });
    assert_eq!(set.code, Some(0), "{set:?}");
}

/// One PARAM_SET and what becomes of it.
struct Set {
    name: &'static str,
    value: f64,
    kind: u64,
    refused: Option<u64>,
    /// The value that is reported, and that the board has; `None` = there is no such parameter.
    in_force: Option<f64>,
}

const fn set(name: &'static str, value: f64, kind: u64, refused: Option<u64>, in_force: Option<f64>) -> Set {
    Set {
        name,
        value,
        kind,
        refused,
        in_force,
    }
}

const SETS: [Set; 7] = [
    // At once, and after a restart.
    set("OA_SPD_MAX", 2.5, REAL32, None, Some(2.5)),
    set("GW_RATE", 25.0, REAL32, None, Some(25.0)),
    set("OA_SPD_MAX", 99.0, REAL32, Some(OUT_OF_RANGE), Some(2.5)),
    set("OA_SPD_MAX", -1.0, REAL32, Some(OUT_OF_RANGE), Some(2.5)),
    set("OA_BLOCKED", 2.0, REAL32, None, Some(2.0)),
    set("OA_BLOCKED", 7.0, REAL32, Some(OUT_OF_RANGE), Some(2.0)),
    set("NOT_THERE", 1.0, REAL32, Some(DOES_NOT_EXIST), None),
];

/// A question and what is to be received: the result of its one COMMAND_ACK, and the message that comes with it.
struct Question {
    component: u8,
    command: u64,
    params: [f64; 2],
    result: u64,
    said: &'static str,
}

const fn question(
    component: u8,
    command: u64,
    params: [f64; 2],
    result: u64,
    said: &'static str,
) -> Question {
    Question {
        component,
        command,
        params,
        result,
        said,
    }
}

const QUESTIONS: [Question; 19] = [
    question(
        AVOIDANCE,
        REQUEST_MESSAGE,
        [148.0, 0.0],
        ACCEPTED,
        "AUTOPILOT_VERSION",
    ),
    question(
        AVOIDANCE,
        REQUEST_MESSAGE,
        [300.0, 0.0],
        ACCEPTED,
        "PROTOCOL_VERSION",
    ),
    question(
        AVOIDANCE,
        REQUEST_MESSAGE,
        [397.0, 0.0],
        ACCEPTED,
        "COMPONENT_METADATA",
    ),
    question(
        AVOIDANCE,
        REQUEST_MESSAGE,
        [244.0, 330.0],
        ACCEPTED,
        "MESSAGE_INTERVAL",
    ),
    question(AVOIDANCE, REQUEST_MESSAGE, [0.0, 0.0], ACCEPTED, "HEARTBEAT"),
    question(AVOIDANCE, REQUEST_MESSAGE, [30.0, 0.0], UNSUPPORTED, ""),
    question(
        COMPUTER,
        REQUEST_MESSAGE,
        [148.0, 0.0],
        ACCEPTED,
        "AUTOPILOT_VERSION",
    ),
    question(
        COMPUTER,
        REQUEST_MESSAGE,
        [300.0, 0.0],
        ACCEPTED,
        "PROTOCOL_VERSION",
    ),
    question(
        COMPUTER,
        REQUEST_MESSAGE,
        [390.0, 0.0],
        ACCEPTED,
        "ONBOARD_COMPUTER_STATUS",
    ),
    question(COMPUTER, REQUEST_MESSAGE, [397.0, 0.0], UNSUPPORTED, ""),
    question(AVOIDANCE, SET_INTERVAL, [330.0, 100_000.0], ACCEPTED, ""),
    question(AVOIDANCE, SET_INTERVAL, [330.0, -1.0], DENIED, ""),
    question(AVOIDANCE, SET_INTERVAL, [0.0, 100_000.0], DENIED, ""),
    question(COMPUTER, SET_INTERVAL, [390.0, -1.0], ACCEPTED, ""),
    question(
        AVOIDANCE,
        GET_INTERVAL,
        [330.0, 0.0],
        ACCEPTED,
        "MESSAGE_INTERVAL",
    ),
    question(COMPUTER, GET_INTERVAL, [390.0, 0.0], ACCEPTED, "MESSAGE_INTERVAL"),
    // Arming, a shutdown, take-off.
    question(AVOIDANCE, 400, [1.0, 0.0], DENIED, ""),
    question(AVOIDANCE, 246, [2.0, 0.0], DENIED, ""),
    question(AVOIDANCE, 22, [0.0, 0.0], UNSUPPORTED, ""),
];

fn is_ack_of_ours(message: &Value) -> bool {
    let is_ours = message["component"] == AVOIDANCE || message["component"] == COMPUTER;
    is_ours && message["kind"] == "COMMAND_ACK"
}

#[test]
fn every_command_gets_exactly_one_acknowledgement_and_none_for_others() {
    let Some((_network, mut station)) = acquainted("peer_ask") else {
        return;
    };
    // The board is read for the first time in the gateway's first second.
    let beat = json!({"type": 6, "autopilot": 8});
    station.send(
        "ground",
        "HEARTBEAT",
        &beat,
        &json!({"ONBOARD_COMPUTER_STATUS 191": 1}),
    );
    for message in ["COMMAND_LONG", "COMMAND_INT"] {
        for question in &QUESTIONS {
            let [param1, param2] = question.params;
            let fields = json!({"target_system": VEHICLE, "target_component": question.component,
                "command": question.command, "param1": param1, "param2": param2});
            let wanted = match question.said {
                // Has a beat of its own and only comes sooner, at the latest with the next one.
                "HEARTBEAT" => json!({"COMMAND_ACK": 1, "HEARTBEAT 196": 1}),
                _ => json!({"COMMAND_ACK": 1}),
            };
            let said = station.send("ground", message, &fields, &wanted);
            // Those of the autopilot, to what was its own before, may still come.
            let acks: Vec<_> = said.iter().filter(|one| is_ack_of_ours(one)).collect();
            let text = format!("{message} {fields}: {acks:?}");
            assert_eq!(acks.len(), 1, "{text}");
            assert_eq!(acks[0]["component"], question.component, "{text}");
            assert_eq!(acks[0]["command"], question.command, "{text}");
            assert_eq!(acks[0]["result"], question.result, "{text}");
            assert_eq!(
                (&acks[0]["target_system"], &acks[0]["target_component"]),
                (&json!(255), &json!(190)),
                "{text}"
            );
            if !question.said.is_empty() {
                assert!(
                    !of(&said, question.component, question.said).is_empty(),
                    "{text} {said:?}"
                );
            }
            let interval = of(&said, question.component, "MESSAGE_INTERVAL");
            if let [interval] = interval.as_slice() {
                let wanted = if question.component == COMPUTER {
                    -1
                } else {
                    100_000
                };
                // The first question comes before the rhythm was set, if it was not set in the other message.
                let usual = question.command == REQUEST_MESSAGE && message == "COMMAND_LONG";
                assert_eq!(
                    interval["interval_us"],
                    if usual { 200_000 } else { wanted },
                    "{text}"
                );
            }
            println!(
                "{message:12} to {}: command {:3} {:?}: 1 ack, result {} {}",
                question.component, question.command, question.params, question.result, question.said
            );
        }
        // The autopilot, a camera of the vehicle, everybody, and another system: not ours to answer.
        for (system, component) in [(VEHICLE, 1), (VEHICLE, 100), (VEHICLE, 0), (9, AVOIDANCE)] {
            let fields = json!({"target_system": system, "target_component": component,
                "command": REQUEST_MESSAGE, "param1": 148.0});
            let said = station.send("ground", message, &fields, &json!({}));
            let ours: Vec<_> = said.iter().filter(|one| is_ack_of_ours(one)).collect();
            assert!(ours.is_empty(), "{fields}: {ours:?}");
            println!("{message:12} to {system}/{component}: no ack of ours");
        }
    }
}

#[test]
fn its_file_client_gets_the_metadata_and_whoever_wants_more_is_refused() {
    let Some((network, mut station)) = acquainted("peer_files") else {
        return;
    };
    let ask = json!({"target_system": VEHICLE, "target_component": AVOIDANCE, "command": REQUEST_MESSAGE, "param1": 397.0});
    let said = station.send("ground", "COMMAND_LONG", &ask, &json!({"COMPONENT_METADATA": 1}));
    let reported = of(&said, AVOIDANCE, "COMPONENT_METADATA")[0].clone();
    let general = reported["uri"].as_str().unwrap().strip_prefix("mftp://").unwrap();

    let read = answer(
        Command::new(python_or_say(&PYMAVLINK).unwrap())
            .arg(workspace().join("tests/peers/files.py"))
            .args([&network.ports[0].to_string(), general, "/parameters.json"]),
    );
    let last = read.stdout.lines().last().unwrap_or_default();
    let found: Value = serde_json::from_str(last).unwrap_or_else(|_| panic!("{read:?}"));
    assert_eq!(found["list_error"], 0, "{found}");
    let listed = found["listed"].as_object().unwrap();
    assert_eq!(listed.len(), 2, "{listed:?}");
    for (name, size) in listed {
        let file = &found["files"][format!("/{name}")];
        assert_eq!((&file["error"], &file["size"]), (&json!(0), size), "{name}");
    }
    let text = |path: &str| -> Value {
        serde_json::from_str(found["files"][path]["text"].as_str().unwrap()).unwrap()
    };
    assert_eq!(found["files"][general]["crc"], reported["file_crc"], "{reported}");
    let index = text(general);
    let row = &index["metadataTypes"][0];
    assert_eq!(
        (&row["type"], &row["uri"]),
        (&json!(1), &json!("mftp:///parameters.json"))
    );
    assert_eq!(row["fileCrc"], found["files"]["/parameters.json"]["crc"]);

    let described = text("/parameters.json")["parameters"].as_array().unwrap().clone();
    let known = network.parameters();
    assert_eq!(described.len(), known.len());
    for (row, reported) in known.iter().zip(&described) {
        assert_eq!(reported["name"], row["name"]);
        for (here, there) in [("min", "min"), ("max", "max"), ("default", "default")] {
            assert_eq!(
                reported[here].as_f64(),
                row[there].as_f64(),
                "{here} of {row}: {reported}"
            );
        }
        let unit = reported["units"].as_str().unwrap_or_default();
        assert_eq!(unit, row["unit"].as_str().unwrap(), "{reported}");
        let restart = reported["rebootRequired"].as_bool().unwrap_or(false);
        assert_eq!(restart, row["apply"] != "live", "{reported}");
    }
    println!(
        "files {listed:?}; checksum {:#010x} as COMPONENT_METADATA says; {} parameters as in `jink param list`",
        reported["file_crc"].as_u64().unwrap(),
        described.len()
    );
    assert_ne!(found["refused"], 0, "{found}");
    assert_eq!(found["refused_made_a_file"], false);

    // Operation, session, size, path or data, and what it is refused with.
    let (file_not_found, protected, unknown, bad_session, bad_size) = (10, 9, 7, 4, 3);
    for (opcode, session, size, path, reason) in [
        (4, 0, None, "../../etc/passwd", file_not_found),
        (4, 0, None, "/../../../etc/passwd", file_not_found),
        (4, 0, None, "parameters.json/../../etc/passwd", file_not_found),
        (4, 0, None, "/dev/shm", file_not_found),
        (4, 0, None, "", file_not_found),
        (14, 0, None, "../secret", file_not_found),
        (5, 99, Some(80), "", bad_session),
        (15, 99, Some(80), "", bad_session),
        (1, 99, None, "", bad_session),
        (4, 0, Some(255), "parameters.json", bad_size),
        (6, 0, None, "new", protected),
        (7, 0, None, "data", protected),
        (8, 0, None, "parameters.json", protected),
        (9, 0, None, "folder", protected),
        (13, 0, None, "parameters.json", protected),
        (77, 0, None, "", unknown),
    ] {
        let mut payload = vec![0u8; 251];
        payload[0] = opcode;
        payload[2] = session;
        payload[3] = opcode;
        payload[4] = size.unwrap_or(path.len() as u8);
        payload[12..12 + path.len()].copy_from_slice(path.as_bytes());
        let fields = json!({"target_system": VEHICLE, "target_component": AVOIDANCE, "payload": payload});
        let wanted = json!({"FILE_TRANSFER_PROTOCOL": 1});
        let said = station.send("ground", "FILE_TRANSFER_PROTOCOL", &fields, &wanted);
        let answers = of(&said, AVOIDANCE, "FILE_TRANSFER_PROTOCOL");
        assert_eq!(answers.len(), 1, "{opcode} {path:?}");
        let byte = |at: usize| answers[0]["payload"][at].as_u64().unwrap();
        println!("file operation {opcode:2} {path:?}: NAK {}", byte(12));
        assert_eq!(
            (byte(3), byte(5)),
            (129, u64::from(opcode)),
            "{path:?}: a refusal"
        );
        assert_eq!(byte(12), reason, "operation {opcode} {path:?}");
    }
}
