//! The gateway is swapped while two ground stations listen on links of their own: neither misses a sequence number, and no
//! signature's stamp comes twice.

use jink_tests::peers::{Network, PYMAVLINK, Station, python_or_say};
use jink_tests::processes::{TempFolder, programs, until};
use serde_json::{Value, json};
use std::os::unix::fs::PermissionsExt;

const LINES: [&str; 2] = ["ground", "second"];
const PASSPHRASE: &str = "two links and one key";
const SWAPS: u64 = 3;

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn three_times() {
    let Some(python) = python_or_say(&PYMAVLINK) else {
        return;
    };
    let key = TempFolder::new("swap_links_key");
    let key_file = key.write("key", &format!("passphrase:{PASSPHRASE}\n"));
    std::fs::set_permissions(&key_file, std::fs::Permissions::from_mode(0o600)).unwrap();
    let table = |link_id| {
        format!(
            "signing = \"accept\"\nkey_file = \"{}\"\nlink_id = {link_id}",
            key_file.display()
        )
    };
    let tables = [table(1), table(2)];
    let links: Vec<_> = LINES.into_iter().zip(tables.iter().map(String::as_str)).collect();
    let network = Network::up("swap_links", None, &links, &[]);
    let mut station = Station::start(&python);
    for ((line, port), link_id) in LINES.into_iter().zip(&network.ports).zip(5..) {
        station.ask(
            &json!({"do": "open", "line": line, "port": port, "passphrase": PASSPHRASE, "link_id": link_id}),
        );
        let fields = json!({"target_system": 1, "target_component": 196, "command": 512, "param1": 300});
        station.ask(
            &json!({"do": "send", "line": line, "kind": "COMMAND_LONG", "fields": fields, "signed": "right"}),
        );
    }
    let tally = |station: &mut Station, line: &str, component: &str| -> Value {
        station.ask(&json!({"do": "tally", "line": line}))[component].clone()
    };
    let count = |tally: &Value| tally["count"].as_u64().unwrap_or(0);
    let gateway = programs().join("jink-mavlink-gateway");
    let gateway = gateway.to_str().unwrap();
    for swap in 1..=SWAPS {
        let before = network.service("mavlink_gateway")["pid"].clone();
        let swapped = network.jink(&["swap", "mavlink_gateway", gateway]);
        assert_eq!(swapped.code, Some(0), "{swapped:?}\n{:#}", network.status());
        let after = network.service("mavlink_gateway")["pid"].clone();
        assert_ne!(before, after, "swap {swap}: {swapped:?}");
        for line in LINES {
            for component in ["191", "196"] {
                let so_far = count(&tally(&mut station, line, component));
                until("more", || {
                    count(&tally(&mut station, line, component)) > so_far + 2
                });
            }
        }
    }
    for line in LINES {
        for component in ["191", "196"] {
            let found = tally(&mut station, line, component);
            println!("{line:8} {component} after {SWAPS} swaps: {found}");
            assert_eq!(found["gaps"], json!([]), "{line} {component}: {found}");
            assert_eq!(found["not_later"], 0, "{line} {component}: {found}");
            assert_eq!(found["unsigned"], 0, "{line} {component}: {found}");
        }
        assert_eq!(
            station.ask(&json!({"do": "tally", "line": line}))["bad"],
            0,
            "{line}"
        );
        let verified = station.ask(&json!({"do": "verify", "line": line, "passphrase": PASSPHRASE}));
        assert_eq!(verified["taken"], verified["of"], "{line}: {verified}");
    }
}
