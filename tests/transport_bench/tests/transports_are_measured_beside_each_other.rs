//! `jink bench transport` as a user runs it: every transport passes every message whole, and nothing is left behind.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use serde_json::Value;
use std::path::PathBuf;
use std::process::{Command, Output};

fn bench(arguments: &[&str]) -> Output {
    let config = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config");
    Command::new(env!("CARGO_BIN_EXE_jink-transport-bench"))
        .arg("--config")
        .arg(config)
        .args(arguments)
        .output()
        .unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn each_transport_passes_whole_messages_and_leaves_nothing() {
    let child = Command::new(env!("CARGO_BIN_EXE_jink-transport-bench"))
        .arg("--config")
        .arg(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config"))
        .args([
            "--json",
            "--rounds",
            "1",
            "--seconds",
            "0.5",
            "--rate",
            "20",
            "--points",
            "2000",
        ])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mark = format!("bench_{}_", child.id());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    let report: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let transports = report["transports"].as_array().unwrap();
    let mut names: Vec<&str> = transports
        .iter()
        .map(|one| one["name"].as_str().unwrap())
        .collect();
    names.sort_unstable();
    assert_eq!(names, ["iceoryx2", "jink", "shm-futex", "udp", "unix"]);
    for one in transports {
        assert_eq!(one["torn"], 0, "{one}");
        assert!(one["n"].as_u64().unwrap() > 0, "{one}");
        let times =
            ["p50_us", "p90_us", "p99_us", "p999_us", "max_us"].map(|name| one[name].as_f64().unwrap());
        assert!(times.is_sorted() && times[0] > 0.0, "{one}");
        assert!(
            one["ratio_p50"].is_array() && one["ratio_p99"].is_array(),
            "{one}"
        );
    }
    // Those that keep a queue lose nothing, however busy the machine is.
    let unix = transports.iter().find(|one| one["name"] == "unix").unwrap();
    assert_eq!(unix["lost"], 0, "{unix}");
    assert!(report["ratio_p50"].as_f64().unwrap() > 0.0);
    assert_eq!(report["bytes"][0], 32_064);
    let left: Vec<_> = std::fs::read_dir("/dev/shm")
        .unwrap()
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().contains(&mark))
        .collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn what_cannot_be_measured_is_said() {
    for (arguments, part, code) in [
        (
            &["--transports", "carrier_pigeon"][..],
            "no transport is called carrier_pigeon: jink, iceoryx2",
            1,
        ),
        (&["--with", "/nowhere/program"], "/nowhere/program", 1),
        (&["--with", "/bin/true"], "/bin/true list: no array of names", 1),
        (&["--seconds", "0"], "0.5 to 3600", 2),
        (&["--points", "200000"], "131072", 2),
    ] {
        let output = bench(arguments);
        let text = said(&output);
        assert!(text.contains(part), "{arguments:?}: {text}");
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        assert_eq!(
            text.matches("jink: ").count() + text.matches("error: ").count(),
            1,
            "{text}"
        );
    }
}
