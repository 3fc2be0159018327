//! `jink bench map` measures with and without OctoMap, and where both maps differ it says why.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_testkit::temp_folder::TempFolder;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn bench(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_jink-map-bench"));
    command.args(arguments);
    command
}

/// A short run of two sensors.
const SHORT: [&str; 7] = [
    "--json",
    "--seconds",
    "0.4",
    "--repeats",
    "1",
    "--clouds",
    "20k,d435",
];

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn parsed(output: &Output) -> Value {
    assert_eq!(output.status.code(), Some(0), "{}", said(output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Every figure that does not need OctoMap.
fn assert_measured(report: &Value) {
    assert!(report["p50_ms_20k"].as_f64().unwrap() > 0.0);
    assert!(report["p50_ms_100k"].is_null(), "not asked for");
    assert_eq!(report["seed"], 1);
    let clouds = report["clouds"].as_array().unwrap();
    let names: Vec<&str> = clouds
        .iter()
        .map(|cloud| cloud["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["20k", "d435"]);
    for cloud in clouds {
        assert!(cloud["points_per_second"].as_f64().unwrap() > 0.0);
        for stage in ["insert", "write", "inflate", "inflate_others"] {
            for clock in ["wall", "cpu"] {
                let times = &cloud["stages"][stage][clock];
                let [p50, p90, p99, max] =
                    ["p50_ms", "p90_ms", "p99_ms", "max_ms"].map(|name| times[name].as_f64().unwrap());
                assert!(p50 <= p90 && p90 <= p99 && p99 <= max, "{stage}: {times}");
            }
        }
    }
}

/// Where there is no OctoMap, nothing can be compared.
fn has_octomap(report: &Value) -> bool {
    if let Some(why) = report["octomap_missing"].as_str() {
        jink_testkit::not_tested(why);
        return false;
    }
    true
}

#[test]
fn no_cell_is_free_here_that_octomap_holds_occupied_without_a_reason() {
    let report = parsed(&bench(&SHORT).output().unwrap());
    assert_measured(&report);
    if !has_octomap(&report) {
        return;
    }
    assert!(report["octomap_ratio"].as_f64().unwrap() > 0.0);
    assert!((0.5..=1.0).contains(&report["agreement"].as_f64().unwrap()));
    assert_eq!(report["free_here_occupied_there_unexplained"], 0);
    for cloud in report["clouds"].as_array().unwrap() {
        let agreement = &cloud["agreement"];
        let of = |pair: &str| agreement["confusion"][pair].as_u64().unwrap_or(0);
        assert!(
            of("free_free") > 10_000 && of("occupied_occupied") > 100,
            "{agreement}"
        );
        let differences = agreement["differences"].as_object().unwrap();
        let differing: u64 = differences.values().map(|cells| cells.as_u64().unwrap()).sum();
        let same = of("free_free") + of("occupied_occupied") + of("unknown_unknown");
        assert_eq!(differing + same, 128 * 128 * 64, "every cell is counted once");
        let unexplained = differences
            .iter()
            .filter(|(name, _)| name.ends_with("unexplained"));
        let unexplained: u64 = unexplained.map(|(_, cells)| cells.as_u64().unwrap()).sum();
        assert!(unexplained * 1_000 <= differing, "{agreement}");
    }
}

#[test]
fn a_recording_of_a_real_ouster_is_measured() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let found = ["../../../shared/data", "../../../../shared/data"].map(|data| folder.join(data));
    let Some(data) = found
        .iter()
        .find(|data| data.join("ouster_os1_128.pcap").is_file())
    else {
        jink_testkit::not_tested("there is no ../shared/data/ouster_os1_128.pcap");
        return;
    };
    let path = |name: &str| data.join(name).to_str().unwrap().to_owned();
    let report = parsed(
        &bench(&["--json", "--repeats", "1", "--seconds", "0.3", "--clouds", "d435"])
            .args([
                "--pcap",
                &path("ouster_os1_128.pcap"),
                "--metadata",
                &path("ouster_os1_128.json"),
            ])
            .output()
            .unwrap(),
    );
    let recording = &report["clouds"][1];
    assert_eq!(recording["name"], "recording");
    assert!(
        recording["points_per_scan"].as_f64().unwrap() > 20_000.0,
        "{recording}"
    );
    if has_octomap(&report) {
        assert_eq!(report["free_here_occupied_there_unexplained"], 0, "{recording}");
    }
}

#[test]
fn without_a_compiler_or_the_library_the_map_alone_is_measured_and_the_package_named() {
    use std::os::unix::fs::PermissionsExt;
    let empty = TempFolder::new("map_bench_empty");
    let fake = TempFolder::new("map_bench_fake");
    let compiler = fake.join("c++");
    let script = "#!/bin/sh\necho 'insert.cpp:9:10: fatal error: octomap/OcTree.h: No such file or directory' >&2\nexit 1\n";
    std::fs::write(&compiler, script).unwrap();
    std::fs::set_permissions(&compiler, std::fs::Permissions::from_mode(0o755)).unwrap();
    for (folder, package) in [(&empty, "build-essential"), (&fake, "liboctomap-dev")] {
        let report = parsed(&bench(&SHORT).env("PATH", &**folder).output().unwrap());
        assert_measured(&report);
        for figure in [
            "octomap_ratio",
            "agreement",
            "free_here_occupied_there_unexplained",
        ] {
            assert!(report[figure].is_null(), "{figure}");
        }
        let why = report["octomap_missing"].as_str().unwrap();
        assert!(why.contains("apt install") && why.contains(package), "{why}");
    }
}

#[test]
fn bad_input_gets_one_clear_error() {
    for arguments in [
        ["--seconds", "0"],
        ["--repeats", "0"],
        ["--clouds", "os2"],
        ["--pcap", "alone.pcap"],
    ] {
        let output = bench(&arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(said(&output).contains(arguments[0]), "{}", said(&output));
    }
    let nowhere = [
        "--no-octomap",
        "--clouds",
        "d435",
        "--seconds",
        "0.3",
        "--repeats",
        "1",
    ];
    let recording = ["--pcap", "/nowhere/a.pcap", "--metadata", "/nowhere/a.json"];
    let output = bench(&nowhere).args(recording).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        said(&output).contains("jink: /nowhere/a.json: "),
        "{}",
        said(&output)
    );
    let long = bench(&["--no-octomap", "--clouds", "d435", "--seconds", "60"])
        .output()
        .unwrap();
    assert_eq!(long.status.code(), Some(1));
    assert!(
        said(&long).contains("--seconds 60: the flight of seed 1 takes"),
        "{}",
        said(&long)
    );
}
