//! MAVProxy on the gateway's link for ground stations: it lists, reads and sets the parameters of component 196,
//! receives messages of all components, and its telemetry log and ours can be read by its makers' tools without a bad
//! byte.

use jink_tests::peers::{GATEWAY_ONLY, MAVPROXY, Network, Terminal, python_or_say};
use jink_tests::processes::{TempFolder, answer, until, workspace};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

#[test]
fn and_both_telemetry_logs_are_sound() {
    let Some(python) = python_or_say(&MAVPROXY) else {
        return;
    };
    let folder = TempFolder::new("peer_mavproxy_logs");
    let (ours, theirs) = (folder.path().join("ours"), folder.path().join("theirs"));
    std::fs::create_dir(&theirs).unwrap();
    let set = format!("link.tlog={}", ours.display());
    let network = Network::up("mavproxy", Some(GATEWAY_ONLY), &[("ground", "")], &[&set]);
    until("the autopilot", || network.status()["link"]["system_id"] == 1);
    let count = network.parameters().len();

    let log = theirs.join("mavproxy.tlog");
    let mut mavproxy = Terminal::start(
        Command::new(&python)
            .arg(python.with_file_name("mavproxy.py"))
            .arg(format!("--master=udpout:127.0.0.1:{}", network.ports[0]))
            .args([
                "--default-modules=param,cmdlong,misc",
                "--target-system=1",
                "--target-component=196",
            ])
            .arg(format!("--state-basedir={}", theirs.display()))
            .arg(format!("--logfile={}", log.display()))
            .env("PYTHONUNBUFFERED", "1")
            .current_dir(&theirs),
    );
    let board = |name: &str| network.jink(&["param", "get", name]).stdout.trim().to_owned();
    mavproxy.types_until("param status", &format!("Have {count}/{count} params"));
    mavproxy.types_until("param show OA_SPD_MAX", "OA_SPD_MAX       3.0");
    mavproxy.types("param set OA_SPD_MAX 2.5");
    until("the new value on the board", || board("OA_SPD_MAX") == "2.5");
    mavproxy.types("param set OA_BLOCKED 2");
    until("a whole number", || board("OA_BLOCKED") == "2");
    mavproxy.types_until("param fetch OA_SPD_MAX", "OA_SPD_MAX = 2.5");
    mavproxy.types("param set OA_SPD_MAX 99");
    mavproxy.types_until("", "Failed to set OA_SPD_MAX to 99");
    assert_eq!(board("OA_SPD_MAX"), "2.5");
    mavproxy.types_until("status HEARTBEAT", "HEARTBEAT {");
    let screen = mavproxy.close();
    println!("{screen}");
    // It ends the log before it ends.
    drop(network);

    let ours = std::fs::read_dir(&ours).unwrap().next().unwrap().unwrap().path();
    for log in [&log, &ours] {
        let read = read_log(&python, log);
        println!("{}: {read}", log.file_name().unwrap().display());
        let count = |what: &str| read["messages"][what].as_u64().unwrap_or(0);
        for message in [
            "HEARTBEAT 1",
            "HEARTBEAT 191",
            "HEARTBEAT 196",
            "PARAM_VALUE 196",
            "PARAM_ERROR 196",
        ] {
            assert!(count(message) > 0, "{message}: {read}");
        }
        assert_eq!(
            (&read["bad"], &read["backwards"]),
            (&0.into(), &0.into()),
            "{read}"
        );

        let dump = answer(
            Command::new(&python)
                .arg(python.with_file_name("mavlogdump.py"))
                .args(["--robust", "--show-source", "--types", "PARAM_ERROR,BAD_DATA"])
                .arg(log),
        );
        assert_eq!(dump.code, Some(0), "{dump:?}");
        assert!(
            dump.stdout.contains("PARAM_ERROR") && !dump.stdout.contains("BAD_DATA"),
            "{dump:?}"
        );
    }
}

fn read_log(python: &Path, log: &Path) -> Value {
    let reader = workspace().join("tests/peers/read_tlog.py");
    let read = answer(Command::new(python).arg(reader).arg(log));
    serde_json::from_str(read.stdout.lines().last().unwrap_or_default())
        .unwrap_or_else(|_| panic!("{read:?}"))
}
