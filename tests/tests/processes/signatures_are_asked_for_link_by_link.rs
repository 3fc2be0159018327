//! What pymavlink signs, or does not, on links that ask for signatures, accept them, or do not look: who is let in, whom it can
//! verify, that no stamp comes twice whatever becomes of the gateway, and that no key is ever passed on or written down.

use jink_runtime::Instance;
use jink_tests::peers::{GATEWAY_ONLY, Network, PYMAVLINK, Station, of, python_or_say, received};
use jink_tests::processes::{TempFolder, until};
use serde_json::json;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

const PASSPHRASE: &str = "correct horse battery staple";
/// SHA-256 of it.
const KEY_HEX: &str = "c4bbcb1fbec99d65bf59d85c8cb62ee2db963f0fe106f483d9afa73bd4e39a8a";
/// A key that somebody wants to give us over the air.
const OFFERED: [u8; 32] = *b"offered-key-offered-key-offered-";

const LINES: [&str; 3] = ["off", "accept", "require"];
/// How a request may be signed; `station.py` explains each.
const SIGNED: [&str; 5] = ["no", "right", "wrong", "old", "again"];
/// Who is let in: a row per link, a column per way to sign.
const LET_IN: [[bool; 5]; 3] = [
    [true, true, true, true, true],
    [true, true, false, false, false],
    [false, true, false, false, false],
];

/// Links of all three kinds, with a key and a telemetry log in `folder`.
fn up(role: &str, folder: &TempFolder) -> Option<(Network, Station)> {
    let python = python_or_say(&PYMAVLINK)?;
    let key_file = folder.write("key", &format!("passphrase:{PASSPHRASE}\n"));
    std::fs::set_permissions(&key_file, std::fs::Permissions::from_mode(0o600)).unwrap();
    let with_key = |signing: &str, link_id: u8| {
        let key_file = key_file.display();
        format!("signing = \"{signing}\"\nkey_file = \"{key_file}\"\nlink_id = {link_id}")
    };
    let tables = [String::new(), with_key("accept", 1), with_key("require", 2)];
    let links: Vec<_> = LINES.into_iter().zip(tables.iter().map(String::as_str)).collect();
    let set = format!("link.tlog={}", tlog_in(folder).display());
    let network = Network::up(role, Some(GATEWAY_ONLY), &links, &[&set]);
    let mut station = Station::start(&python);
    for ((line, port), link_id) in LINES.into_iter().zip(&network.ports).zip(5..) {
        let order =
            json!({"do": "open", "line": line, "port": port, "passphrase": PASSPHRASE, "link_id": link_id});
        station.ask(&order);
    }
    until("the autopilot", || network.status()["link"]["system_id"] == 1);
    // Requests are answered by another process than the gateway, which may start after it.
    until("an answer", || is_answered(&mut station, "off", "no"));
    Some((network, station))
}

fn tlog_in(folder: &TempFolder) -> PathBuf {
    folder.path().join("tlog")
}

/// Asks for a message; whether that was answered.
fn is_answered(station: &mut Station, line: &str, signed: &str) -> bool {
    let fields = json!({"target_system": 1, "target_component": 196, "command": 512, "param1": 300});
    let order =
        json!({"do": "send", "line": line, "kind": "COMMAND_LONG", "fields": fields, "signed": signed});
    let said = received(&station.ask(&order));
    !of(&said, 196, "COMMAND_ACK").is_empty()
}

#[test]
fn whoever_is_let_in_is_let_in_and_nobody_else() {
    let folder = TempFolder::new("sign_matrix_files");
    let Some((network, mut station)) = up("sign_matrix", &folder) else {
        return;
    };
    println!("in        {SIGNED:>8?}");
    for (line, wanted) in LINES.into_iter().zip(LET_IN) {
        let found = SIGNED.map(|signed| is_answered(&mut station, line, signed));
        println!("{line:8}  {found:?}");
        assert_eq!(found, wanted, "{line}: {SIGNED:?}");
    }

    println!("out       frames, verified with the key, played back, with another key");
    for line in LINES {
        let mut verify = |passphrase: &str| {
            let order = json!({"do": "verify", "line": line, "passphrase": passphrase});
            station.ask(&order)
        };
        let (ours, other) = (verify(PASSPHRASE), verify("another"));
        let of = ours["of"].as_u64().unwrap();
        println!(
            "{line:8}  {of} {} {} {}",
            ours["taken"], ours["taken_again"], other["taken"]
        );
        assert!(of > 5, "{line}: {ours}");
        assert_eq!(
            ours["taken"],
            if line == "off" { 0 } else { of },
            "{line}: {ours}"
        );
        assert_eq!(
            (&ours["taken_again"], &other["taken"]),
            (&json!(0), &json!(0)),
            "{line}"
        );
    }

    // Every refusal is counted where it happened, and shown.
    let status = network.status();
    let links = status["link"]["links"].as_array().unwrap();
    let refused: Vec<_> = links.iter().map(|link| link["refused"].clone()).collect();
    let counts = |unsigned, wrong, replayed| json!({"unsigned": unsigned, "wrong_signature": wrong, "replayed": replayed});
    assert_eq!(
        refused,
        [counts(0, 0, 0), counts(0, 0, 0), counts(0, 1, 2), counts(1, 1, 2)]
    );
    let text = network.jink(&["status"]).stdout;
    print!("{text}");
    for line in [
        "refused 1 wrongly signed, 2 played back\n",
        "refused 1 wrongly signed, 2 played back, 1 unsigned\n",
    ] {
        assert!(text.contains(line), "{text}");
    }
}

#[test]
fn stamps_only_grow_whatever_becomes_of_the_gateway() {
    let folder = TempFolder::new("sign_stamps_files");
    let Some((network, mut station)) = up("sign_stamps", &folder) else {
        return;
    };
    for line in LINES {
        let signed = if line == "off" { "no" } else { "right" };
        assert!(is_answered(&mut station, line, signed), "{line}");
    }
    let pid = || network.service("mavlink_gateway")["pid"].as_i64();
    let restart = || {
        let restarted = network.jink(&["restart", "mavlink_gateway", "--hard"]);
        assert_eq!(restarted.code, Some(0), "{restarted:?}");
    };
    let kill = || {
        let killed = network.kill("mavlink_gateway");
        until("another gateway", || pid().is_some_and(|pid| pid != killed));
    };
    let changes: [(&str, &dyn Fn()); 2] = [("a restart", &restart), ("a crash", &kill)];
    for (what, change) in changes {
        let tally = |station: &mut Station, line: &str| {
            station.ask(&json!({"do": "tally", "line": line}))["196"].clone()
        };
        let before = LINES.map(|line| tally(&mut station, line));
        change();
        for (line, before) in LINES.into_iter().zip(&before).skip(1) {
            // The new one does not know where its peers are before they send.
            until("an answer", || is_answered(&mut station, line, "right"));
            let after = tally(&mut station, line);
            println!(
                "{line:8} stamps before and after {what}: {} {}",
                before["last_stamp"], after["last_stamp"]
            );
            assert_eq!(
                (&after["not_later"], &after["unsigned"]),
                (&json!(0), &json!(0)),
                "{line}: {after}"
            );
            assert!(
                after["last_stamp"].as_u64() > before["last_stamp"].as_u64(),
                "{line}: {after}"
            );
        }
    }
}

#[test]
fn a_key_is_neither_passed_on_nor_taken_nor_written_down() {
    let folder = TempFolder::new("sign_key_files");
    let Some((network, mut station)) = up("sign_key", &folder) else {
        return;
    };
    for line in LINES {
        assert!(
            is_answered(&mut station, line, if line == "off" { "no" } else { "right" }),
            "{line}"
        );
    }
    for (from, signed) in [("off", "no"), ("accept", "right"), ("require", "right")] {
        for (system, component) in [(0, 0), (1, 0), (1, 1), (1, 196)] {
            let fields = json!({"target_system": system, "target_component": component, "secret_key": OFFERED,
                "initial_timestamp": 1});
            let order = json!({"do": "send", "line": from, "kind": "SETUP_SIGNING", "fields": fields, "signed": signed});
            station.ask(&order);
        }
        let order = json!({"do": "send", "line": from, "kind": "STATUSTEXT", "fields": {"text": from}, "signed": signed});
        station.ask(&order);
    }
    for line in LINES {
        // What others say is passed on, a key is not.
        let mut kinds = || station.ask(&json!({"do": "tally", "line": line}))["kinds"].clone();
        until("the texts of both others", || {
            kinds()["STATUSTEXT"].as_u64() >= Some(2)
        });
        assert!(kinds().get("SETUP_SIGNING").is_none(), "{line}");
    }
    for line in ["accept", "require"] {
        assert!(
            is_answered(&mut station, line, "right"),
            "{line}: the key stays what it was"
        );
        assert!(!is_answered(&mut station, line, "wrong"), "{line}");
    }

    let status = network.status();
    let instance: Instance = status["instance"].as_str().unwrap().parse().unwrap();
    let key: Vec<u8> = KEY_HEX
        .as_bytes()
        .chunks(2)
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect();
    let secrets: [&[u8]; 4] = [PASSPHRASE.as_bytes(), KEY_HEX.as_bytes(), &key, &OFFERED];
    let mut read = 0;
    for folder in [instance.folder(), tlog_in(&folder)] {
        read += look_for(&secrets, &folder);
    }
    assert!(read > 10_000, "{read} bytes are no log");
    println!("no key in {read} bytes of logs, state and telemetry log");
}

/// Bytes read in a folder and those in it, none of which holds a secret.
fn look_for(secrets: &[&[u8]], folder: &Path) -> usize {
    let mut read = 0;
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        let kind = entry.file_type().unwrap();
        if kind.is_dir() {
            read += look_for(secrets, &path);
        } else if kind.is_file() {
            let bytes = std::fs::read(&path).unwrap_or_default();
            read += bytes.len();
            for (index, secret) in secrets.iter().enumerate() {
                let is_there = bytes.windows(secret.len()).any(|window| window == *secret);
                assert!(!is_there, "secret {index} is in {}", path.display());
            }
        }
    }
    read
}
