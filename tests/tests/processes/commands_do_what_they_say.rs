//! The `jink` command on a jink that runs: what one command says that another one does, it does.

use jink_testkit::pseudo_terminal::plug_in;
use jink_tests::permit;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{Answer, System, TempFolder, answer, program, until};
use serde_json::Value;
use std::net::UdpSocket;
use std::os::unix::process::CommandExt;
use std::process::Stdio;

const NOBODY: u32 = 65_534;

/// A vehicle in an empty world, on a port of its own.
fn simulated(role: &str, further: &[&str]) -> System {
    let address = format!("link.address=udpin:127.0.0.1:{}", free_udp_port());
    let arguments = [
        // In an empty world nothing ahead answers a lidar that stands on the ground: the companion is not active.
        "--world",
        "forest",
        "--set",
        &address,
        "--set",
        "simulation.ground_station_port=0",
    ];
    System::up(role, &[&arguments[..], further].concat())
}

fn json(reported: &Answer) -> Value {
    serde_json::from_str(&reported.stdout).unwrap_or_else(|error| panic!("{error}: {reported:?}"))
}

#[test]
fn a_stopped_service_is_no_failure_and_a_restart_starts_it() {
    let jink = simulated("stop", &[]);
    let first = jink.service("planner")["pid"].clone();
    let stopped = jink.jink(&["stop", "planner"]);
    assert_eq!(stopped.code, Some(0), "{stopped:?}");
    assert!(
        stopped.stdout.contains("`jink restart planner` starts it again"),
        "{stopped:?}"
    );
    until("a stopped planner", || {
        jink.service("planner")["state"] == "stopped"
    });
    let planner = jink.service("planner");
    assert_eq!(planner["reason"], "asked", "{planner}");
    // On the user's own wish nobody calls for the end of the flight.
    let status = jink.status();
    assert_eq!(status["health"], "degraded", "{status:#}");
    until("a word about it", || {
        jink.status()["link"]["avoidance"] == "critical"
    });

    let swapped = jink.jink(&["swap", "planner", "/bin/true"]);
    assert_eq!(swapped.code, Some(1), "{swapped:?}");
    assert!(swapped.stderr.contains("`jink restart` starts it"), "{swapped:?}");
    let started = jink.jink(&["restart", "planner"]);
    assert_eq!(started.code, Some(0), "{started:?}");
    assert!(started.stdout.contains("planner is started"), "{started:?}");
    until("good health", || jink.status()["health"] == "healthy");
    assert_ne!(jink.service("planner")["pid"], first);

    for (binary, said) in [
        ("/etc/passwd", "is not executable"),
        ("/bin/true", "is it this service's program?"),
    ] {
        let refused = jink.jink(&["swap", "planner", binary]);
        assert_eq!(refused.code, Some(1), "{refused:?}");
        assert!(refused.stderr.contains(said), "{binary}: {refused:?}");
    }
    for (name, said) in [
        (
            "nosuch",
            "there is no process \"nosuch\"; there are simulator, mavlink_gateway",
        ),
        ("planer", "did you mean `planner`?"),
        ("supervisor", "`jink swap supervisor BINARY`"),
    ] {
        let refused = jink.jink(&["stop", name]);
        assert_eq!(refused.code, Some(1), "{refused:?}");
        assert!(refused.stderr.contains(said), "{name}: {refused:?}");
        assert!(
            name == "planer" || !refused.stderr.contains("did you mean"),
            "{refused:?}"
        );
    }
}

#[test]
fn topics_and_the_ring_are_read_by_machines() {
    let jink = simulated("topics", &[]);
    for (topic, field) in [
        ("vehicle/state", "position"),
        ("plan/route", "corridor"),
        ("range/cloud/lidar", "points"),
        ("system/status", "processes"),
    ] {
        let reported = jink.jink(&[
            "topic",
            "echo",
            topic,
            "--json",
            "--count",
            "2",
            "--timeout",
            "20",
        ]);
        assert_eq!(reported.code, Some(0), "{topic}: {reported:?}");
        let samples: Vec<Value> = reported
            .stdout
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        assert_eq!(samples.len(), 2, "{topic}");
        let [before, after] = [&samples[0], &samples[1]];
        assert_eq!(before["topic"], topic);
        assert!(
            !before["sample"][field].is_null(),
            "{topic}: {}",
            before["sample"]
        );
        let published = |sample: &Value| sample["header"]["publish"].as_f64().unwrap();
        assert!(published(before) < published(after), "{topic}");
        assert!(!reported.stdout.contains("reserved"), "{topic}");
    }
    let ring = json(&jink.jink(&["ring", "--json"]));
    let bearings = ring["sectors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|sector| &sector["bearing_deg"]);
    assert!(
        bearings
            .enumerate()
            .all(|(n, bearing)| *bearing == 5.0 * n as f64),
        "{ring}"
    );
    // Nothing has been measured yet, and nothing is what is shown.
    assert_eq!(jink.status()["link"]["capture_to_wire_p50_ms"], Value::Null);
    assert!(jink.jink(&["status"]).stdout.contains("capture to wire -\n"));
}

#[test]
fn another_supervisor_goes_on_and_nobody_notices() {
    // On a busy machine the companion is not active all the time, whoever supervises it: once it is, across a swap.
    assert!((0..4).any(|attempt| another_supervisor_goes_on_unnoticed(&format!("super{attempt}"))));
}

fn another_supervisor_goes_on_unnoticed(role: &str) -> bool {
    let jink = simulated(role, &[]);
    until("an active companion", || {
        jink.status()["link"]["avoidance"] == "active"
    });
    // What the status says of a killed service survives, too.
    jink.kill("planner");
    until("a planner that is back", || {
        let planner = jink.service("planner");
        planner["restarts"] == 1 && planner["state"] == "active"
    });
    until("an active companion", || {
        jink.status()["link"]["avoidance"] == "active"
    });
    let unnoticed = supervisor_is_swapped_unnoticed(&jink);
    let down = jink.jink(&["down", "--now"]);
    assert_eq!(down.code, Some(0), "{down:?}");
    unnoticed
}

/// Lets another supervisor go on, and says whether the companion has been active all the time.
fn supervisor_is_swapped_unnoticed(jink: &System) -> bool {
    let before = jink.service("planner");
    let mut watch = jink.command(&[
        "topic",
        "echo",
        "link/status",
        "--json",
        "--count",
        "15",
        "--timeout",
        "6",
    ]);
    let watching = std::thread::spawn(move || answer(&mut watch));
    let supervisor = jink_tests::processes::programs().join("jink-supervisor");
    let swapped = jink.jink(&["swap", "supervisor", supervisor.to_str().unwrap()]);
    assert_eq!(swapped.code, Some(0), "{swapped:?}");
    until("the next supervisor", || jink.status()["health"] == "healthy");
    let after = jink.service("planner");
    for same in ["pid", "restarts", "last_exit", "reason"] {
        assert_eq!(after[same], before[same], "{same}");
    }
    assert!(
        after["uptime_s"].as_f64() >= before["uptime_s"].as_f64(),
        "{before} {after}"
    );
    let seen = watching.join().unwrap();
    let states: Vec<Value> = seen
        .stdout
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect();
    println!("{} samples of the link", states.len());
    states.len() >= 8 && states.iter().all(|one| one["sample"]["avoidance"] == "active")
}

#[test]
fn a_second_vehicle_finds_a_port_of_its_own() {
    let _permit = permit::share();
    // As the configuration names it, and taken.
    let taken = UdpSocket::bind(("127.0.0.1", 0)).unwrap();
    let port = taken.local_addr().unwrap().port();
    let folder = TempFolder::with_config("second");
    let file = folder.path().join("jink.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(text.contains("udpin:127.0.0.1:14540"));
    std::fs::write(
        &file,
        text.replace("udpin:127.0.0.1:14540", &format!("udpin:127.0.0.1:{port}")),
    )
    .unwrap();
    let instance = format!("t_second_{}", std::process::id());
    let reported = answer(&mut program(
        "jink",
        &[
            "--instance",
            &instance,
            "up",
            "--detach",
            "--world",
            "empty",
            "--config",
            folder.text(),
            "--set",
            "simulation.ground_station_port=0",
        ],
    ));
    let down = answer(&mut program("jink", &["--instance", &instance, "down", "--now"]));
    assert_eq!(
        (reported.code, down.code),
        (Some(0), Some(0)),
        "{reported:?} {down:?}"
    );
    assert!(
        reported.stdout.contains(&format!(
            "port {port} is taken: this vehicle's autopilot speaks on port"
        )),
        "{reported:?}"
    );
    assert!(reported.stdout.contains("is ready;"), "{reported:?}");
    // A good start says nothing that reads like a failure.
    assert!(
        !reported.stdout.contains("starting\n") && !reported.stdout.contains("have not come"),
        "{reported:?}"
    );
}

#[test]
fn instances_are_listed_and_what_ended_ones_left_is_removed() {
    let jink = simulated("listed", &[]);
    let name = jink.instance().to_owned();
    let left = format!("t_left_{}", std::process::id());
    let folder = format!("/dev/shm/jink_{left}/log");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(format!("{folder}/planner.log"), "a log\n").unwrap();
    let all = json(&jink.jink(&["instances", "--json"]));
    let of = |all: &Value, name: &str| {
        let all = all.as_array().unwrap();
        all.iter()
            .find(|one| one["name"] == name)
            .cloned()
            .unwrap_or(Value::Null)
    };
    assert_eq!(of(&all, &name)["state"], "running", "{all:#}");
    assert_eq!(of(&all, &name)["supervisor"], jink.status()["supervisor_pid"]);
    assert_eq!(of(&all, &left)["state"], "ended");
    // Not `--remove`: what other tests have left is theirs to look at.
    std::fs::remove_dir_all(format!("/dev/shm/jink_{left}")).unwrap();
    assert_eq!(
        of(&json(&jink.jink(&["instances", "--json"])), &left),
        Value::Null
    );
}

#[test]
fn logs_on_a_disk_outlive_the_instance_and_are_read_in_plain_words() {
    let logs = TempFolder::new("logs");
    let config = TempFolder::new("logs_config");
    config.write("jink.toml", &format!("log_dir = {:?}\n", logs.text()));
    let set = format!("log_dir={}", logs.text());
    let jink = simulated("logs", &["--set", &set]);
    let while_up = jink.jink(&["log", "supervisor"]);
    assert!(
        while_up.stdout.contains("supervisor          started"),
        "{while_up:?}"
    );
    let name = jink.instance().to_owned();
    drop(jink);
    assert!(!std::path::Path::new(&format!("/dev/shm/jink_{name}")).exists());
    let log = |arguments: &[&str]| {
        let mut command = program("jink", &["--instance", &name, "log", "--config", config.text()]);
        answer(command.args(arguments))
    };
    let all = log(&[]);
    for service in ["supervisor", "mavlink_gateway"] {
        assert!(
            all.stdout.contains(&format!("  {service} ")),
            "{service}: {all:?}"
        );
    }
    assert!(!log(&["planner"]).stdout.contains("  supervisor "));
    let unknown = log(&["planer"]);
    assert_eq!(unknown.code, Some(1));
    assert!(unknown.stderr.contains("did you mean `planner`?"), "{unknown:?}");
    assert_eq!(log(&["--before", "1"]).code, Some(1), "there was one run");
}

#[test]
fn an_autopilot_that_is_plugged_in_after_the_start_is_waited_for() {
    let folder = TempFolder::new("plug");
    let device = folder.path().join("ttyACM0");
    let link = format!("serial:{}:57600", device.display());
    let jink = System::up("plug", &["--world", "forest", "--link", &link]);
    let waits = || jink.status()["link"]["links"][0]["is_waited_for"].clone();
    until("the wait for a device", || waits() == true);
    let _control = plug_in(&device);
    until("the device", || waits() == false);
    assert_eq!(jink.service("mavlink_gateway")["restarts"], 0);
}

#[test]
fn another_user_reads_at_once_whose_it_is() {
    if !rustix::process::geteuid().is_root() {
        jink_tests::not_tested("only root can become another user");
        return;
    }
    let jink = simulated("user", &[]);
    for arguments in [
        &["status"][..],
        &["down"],
        &["param", "set", "OA_SPD_MAX", "2"],
        &["top", "--once"],
    ] {
        let mut command = jink.command(arguments);
        command.uid(NOBODY).gid(NOBODY);
        let Ok(reported) = command.output() else {
            jink_tests::not_tested("another user may not run the programs of this folder");
            return;
        };
        let said = String::from_utf8_lossy(&reported.stderr).into_owned();
        assert_eq!(reported.status.code(), Some(1), "{arguments:?}: {said}");
        assert!(
            said.contains("belongs to the user with id 0"),
            "{arguments:?}: {said}"
        );
    }
    until("good health", || jink.status()["health"] == "healthy");
}

#[test]
fn what_root_asks_of_another_users_instance_leaves_nothing_behind() {
    if !rustix::process::geteuid().is_root() {
        jink_tests::not_tested("only root can become another user");
        return;
    }
    let _permit = permit::share();
    let instance = format!("t_nobody_{}", std::process::id());
    let of_root = |arguments: &[&str]| {
        let mut command = program("jink", &["--instance", &instance]);
        command.args(arguments);
        command
    };
    let of_nobody = |arguments: &[&str]| {
        let mut command = of_root(arguments);
        command.uid(NOBODY).gid(NOBODY);
        command
    };
    let address = format!("link.address=udpin:127.0.0.1:{}", free_udp_port());
    let up = ["up", "--detach", "--world", "forest", "--set", &address];
    let up = [&up[..], &["--set", "simulation.ground_station_port=0"]].concat();
    if of_nobody(&["--version"]).output().is_err() {
        jink_tests::not_tested("another user may not run the programs of this folder");
        return;
    }
    let up = answer(&mut of_nobody(&up));
    let asked = [
        &["status"][..],
        &["top", "--once"],
        &["topic", "echo", "vehicle/state", "--count", "1"],
    ]
    .map(|arguments| answer(&mut of_root(arguments)));
    let down = answer(&mut of_nobody(&["down"]));
    let mut left: Vec<_> = std::fs::read_dir("/dev/shm").unwrap().flatten().collect();
    left.retain(|entry| entry.file_name().to_string_lossy().contains(&instance));
    assert_eq!(up.code, Some(0), "{up:?}");
    assert_eq!(down.code, Some(0), "{down:?}");
    assert!(left.is_empty(), "{left:?} after {asked:?}");
    // 1: a service is late just now.
    let is_answer = |reported: &Answer| matches!(reported.code, Some(0 | 1)) && reported.stderr.is_empty();
    assert!(asked.iter().all(is_answer), "{asked:?}");
}

#[test]
fn a_world_is_described_for_people_and_its_reader_may_leave() {
    let table = answer(&mut program(
        "jink",
        &["world", "--world", "forest", "--seed", "7"],
    ))
    .stdout;
    assert!(
        table.contains(" m north ") && table.contains("cylinder"),
        "{table}"
    );
    assert!(!table.contains("Cylinder(") && !table.contains("_m:"), "{table}");
    let mut child = program("jink", &["world", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), said.as_str()), (Some(0), ""));
}

#[test]
fn campaigns_and_approaches_are_commands_of_jink() {
    for command in ["campaign", "approach"] {
        let help = answer(&mut program("jink", &[command, "--help"]));
        assert_eq!(help.code, Some(0), "{help:?}");
        assert!(
            help.stdout.contains(&format!("Usage: jink {command}")),
            "{help:?}"
        );
        let nobody_flies = answer(&mut program("jink", &[command, "--jobs", "0"]));
        assert_eq!(nobody_flies.code, Some(2), "{nobody_flies:?}");
        assert!(
            nobody_flies.stderr.contains("0 is not in 1..=1024"),
            "{nobody_flies:?}"
        );
    }
}
