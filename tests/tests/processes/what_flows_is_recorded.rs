//! A flight is recorded while services are killed and swapped: pip `mcap` finds every sample that the topics count, the recorder costs no
//! setpoint when it is killed or its disk is full, and what it could not keep is said.

use jink_testkit::not_tested;
use jink_tests::peers::{self, MCAP};
use jink_tests::processes::{Flight, TempFolder, answer, program, programs, until};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Reads recordings with the library of others: for each topic how many messages, how many sequence numbers are skipped between them.
const COUNT: &str = r#"
import json, struct, sys
from mcap.reader import make_reader
topics = {}
for path in sys.argv[1:]:
    reader = make_reader(open(path, "rb"))
    counted = {}
    for schema, channel, message in reader.iter_messages():
        if channel.topic == "recorder/lost":
            lost = json.loads(message.data)
            topics.setdefault(lost["topic"], [0, 0, 0])[2] += lost["samples"]
            continue
        topic = topics.setdefault(channel.topic, [0, 0, 0])
        topic[0] += 1
        counted[channel.topic] = counted.get(channel.topic, 0) + 1
        sequence = struct.unpack_from("<Q", message.data)[0]
        starts = topic[1] if isinstance(topic[1], dict) else {}
        starts.setdefault(sequence >> 32, []).append(sequence & 0xffffffff)
        topic[1] = starts
    summary = reader.get_summary()
    if summary is not None:
        for id, count in summary.statistics.channel_message_counts.items():
            name = summary.channels[id].topic
            assert name == "recorder/lost" or counted.get(name, 0) == count, name
out = {}
for name, (count, starts, lost) in topics.items():
    skipped = sum(max(s) - min(s) + 1 - len(set(s)) for s in (starts or {}).values())
    out[name] = {"count": count, "skipped": skipped, "lost": lost}
print(json.dumps(out))
"#;

fn recordings(folder: &Path) -> Vec<PathBuf> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    files.map(|entry| entry.path()).collect()
}

#[test]
fn every_sample_that_the_topics_count_is_there() {
    let folder = TempFolder::new("recorded");
    let flight = Flight::begin(&[
        "--seed",
        "1",
        "--set",
        &format!("recorder.folder={}", folder.text()),
        "--set",
        "recorder.clouds=true",
    ]);
    flight.until_it_flies();
    flight.kill("planner");
    until("another planner", || {
        flight.service("planner")["state"] == "active"
    });
    let generator = programs().join("jink-bezier-generator");
    // A takeover is rolled back where the machine stands still behind it: no process has the inputs that it needs then.
    let mut generators = 1;
    until("a takeover", || {
        generators += 1;
        let swapped = flight.jink(&["swap", "bezier_generator", generator.to_str().unwrap()]);
        let is_over = swapped.code == Some(0);
        assert!(is_over || swapped.stderr.contains("rolled back"), "{swapped:?}");
        is_over
    });
    let figures = flight.end();
    assert_eq!(figures["outcome"], "goal", "{figures}");
    let files = recordings(folder.path());
    assert_eq!(files.len(), 1, "{files:?}");
    let ours = answer(&mut program(
        "jink",
        &["recording", "info", "--json", files[0].to_str().unwrap()],
    ));
    let ours: Value = serde_json::from_str(&ours.stdout).unwrap_or_else(|_| panic!("{ours:?}"));
    assert_eq!(ours["cut_off"], false, "{ours}");
    let (recording, config) = (files[0].to_str().unwrap(), folder.path().join("config"));
    let config = config.to_str().unwrap();
    let written = answer(&mut program("jink", &["recording", "config", recording, config]));
    assert_eq!(written.code, Some(0), "{written:?}");
    let checked = answer(&mut program(
        "jink",
        &["check", "config", "--config", config, "--world", "forest"],
    ));
    assert_eq!(checked.code, Some(0), "{checked:?}");
    let again = answer(&mut program("jink", &["recording", "config", recording, config]));
    assert_eq!(again.code, Some(1), "nothing is overwritten: {again:?}");
    let is_whole = ours["topics"]
        .as_object()
        .unwrap()
        .values()
        .all(|topic| topic["missing"] == 0);
    is_flown_again_bit_by_bit(recording, is_whole, generators);
    let Some(python) = peers::python_or_say(&MCAP) else {
        return;
    };
    let theirs = answer(Command::new(python).args(["-c", COUNT]).args(&files));
    let theirs: Value = serde_json::from_str(&theirs.stdout).unwrap_or_else(|_| panic!("{theirs:?}"));
    let topics = theirs.as_object().unwrap();
    for name in [
        "range/cloud/mid360",
        "map/local",
        "plan/route",
        "plan/trajectory",
        "guard/approved",
        "vehicle/state",
        "health/planner",
        "system/status",
        "parameters",
        "sim/truth",
        "event",
    ] {
        let topic = topics
            .get(name)
            .unwrap_or_else(|| panic!("{name} is not in {theirs}"));
        assert_eq!(
            topic["count"], ours["topics"][name]["samples"],
            "{name}: {theirs}"
        );
    }
    for (name, topic) in topics.iter().filter(|(name, _)| *name != "event") {
        // What is not there is said.
        assert_eq!(topic["skipped"], topic["lost"], "{name}: {theirs}");
    }
}

/// Each start of each service that can be replayed (of the generator so many) puts out the same again, and with another parameter it does
/// not. Where samples are missing, beside much load, they are replayed as far as it goes.
fn is_flown_again_bit_by_bit(recording: &str, is_whole: bool, generators: usize) {
    let replay = |more: &[&str]| {
        let all: Vec<&str> = ["replay", recording, "--json"]
            .into_iter()
            .chain(more.iter().copied())
            .collect();
        let answer = answer(&mut program("jink", &all));
        let report: Value = serde_json::from_str(&answer.stdout).unwrap_or_else(|_| panic!("{answer:?}"));
        (answer.code, report)
    };
    let (code, report) = replay(&[]);
    assert_eq!(report["first"], Value::Null, "{report}");
    assert!(code == Some(0) || !is_whole, "{report}");
    let instances = report["instances"].as_array().unwrap();
    for (process, starts) in [
        ("planner", 2),
        ("bezier_generator", generators),
        ("collision_guard", 1),
        ("obstacle_fusion", 1),
        ("parameter_server", 1),
    ] {
        let of_it: Vec<&Value> = instances.iter().filter(|one| one["process"] == process).collect();
        assert_eq!(of_it.len(), starts, "{process}: {report}");
        for one in of_it {
            assert!(one["ends"].is_null() || !is_whole, "{report}");
            assert!(one["cycles"].as_u64() > Some(0) || !is_whole, "{report}");
        }
    }
    let (code, report) = replay(&["--service", "planner", "--param", "OA_SPD_MAX=0.5"]);
    assert!(code == Some(4) || !is_whole, "{report}");
    if let Some(first) = report["first"].as_str() {
        assert!(first.starts_with("plan/route at"), "{first}");
    }
}

#[test]
fn nothing_of_the_flight_hangs_on_it() {
    let folder = TempFolder::new("kills");
    let flight = Flight::begin(&[
        "--seed",
        "1",
        "--legs",
        "2",
        "--set",
        &format!("recorder.folder={}", folder.text()),
    ]);
    flight.until_it_flies();
    for _ in 0..3 {
        let killed = flight.kill("recorder");
        until("another recorder", || {
            let recorder = flight.service("recorder");
            recorder["state"] == "active" && recorder["pid"].as_i64() != Some(killed)
        });
    }
    let figures = flight.end();
    let files = recordings(folder.path());
    assert_eq!(files.len(), 4, "{files:?}");
    for file in &files {
        let info = answer(&mut program(
            "jink",
            &["recording", "info", file.to_str().unwrap()],
        ));
        assert_eq!(info.code, Some(0), "{info:?}");
    }
    assert_eq!(figures["outcome"], "goal", "{figures}");
    assert_eq!(figures["fcu_hold_count"], 0, "{figures}");
}

#[test]
fn a_full_disk_is_said_and_a_recording_goes_on_when_there_is_room() {
    let folder = TempFolder::new("full");
    let mounted = Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=3m", "tmpfs", folder.text()])
        .status();
    if !mounted.is_ok_and(|status| status.success()) {
        not_tested("no small disk can be mounted: that needs root");
        return;
    }
    let flight = Flight::begin(&[
        "--seed",
        "1",
        "--legs",
        "4",
        "--set",
        &format!("recorder.folder={}", folder.text()),
    ]);
    let says = |text: &str| flight.jink(&["log", "recorder"]).stdout.contains(text);
    until("a full disk", || says("jink: nothing is recorded"));
    for file in recordings(folder.path()) {
        std::fs::remove_file(file).unwrap();
    }
    until("another file", || says("jink: recording again"));
    until("good health", || flight.status()["link"]["avoidance"] == "active");
    drop(flight);
    let unmounted = Command::new("umount").args(["-l", folder.text()]).status();
    assert!(unmounted.is_ok_and(|status| status.success()));
}
