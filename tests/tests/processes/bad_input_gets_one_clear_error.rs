//! What a user may get wrong is answered with one line that names what and where, an exit code that scripts understand,
//! and nothing left behind.

use jink_runtime::Instance;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{Answer, System, TempFolder, answer, program};
use std::net::UdpSocket;
use std::sync::atomic::{AtomicU32, Ordering};

/// The exit code of what cannot start.
const CANNOT_START: i32 = 78;

/// `jink up` with the configuration in `folder` in an instance of its own.
fn up(folder: &TempFolder, arguments: &[&str]) -> Answer {
    static STARTS: AtomicU32 = AtomicU32::new(0);
    let start = STARTS.fetch_add(1, Ordering::Relaxed);
    let instance = format!("refused_{}_{start}", std::process::id());
    let mut command = program(
        "jink",
        &[
            "--instance",
            &instance,
            "up",
            "--detach",
            "--config",
            folder.text(),
        ],
    );
    let mut refused = answer(command.args(arguments));
    // The logs of a failed start are kept for the user; here nobody reads them.
    let folder = instance.parse::<Instance>().unwrap().folder();
    if std::fs::remove_dir_all(&folder).is_ok() {
        refused.stderr += LEFT;
    }
    refused
}

/// Behind the answer of a command that has left a folder.
const LEFT: &str = "something was left behind";

/// Exchanges `from` for `to` in a configuration file; answers in which line.
fn spoil(folder: &TempFolder, file: &str, from: &str, to: &str) -> usize {
    let text = std::fs::read_to_string(folder.path().join(file)).unwrap();
    let at = text
        .find(from)
        .unwrap_or_else(|| panic!("{file} holds no {from:?}"));
    folder.write(file, &text.replacen(from, to, 1));
    let breaks = |text: &str| text.bytes().filter(|byte| *byte == b'\n').count();
    // A text that begins with a line break is about the next line.
    1 + breaks(&text[..at]) + usize::from(from.starts_with('\n'))
}

#[test]
fn what_is_wrong_in_a_file_or_an_argument_is_named_with_its_place() {
    let simulated = ["--world", "forest"];
    // This one is found by a process of its own, while the gateway starts as well: on a port that nobody else has.
    let link = format!("link.address=udpin:127.0.0.1:{}", free_udp_port());
    let simulator = [
        "--world",
        "forest",
        "--set",
        "simulation.ground_station_port=0",
        "--set",
        &link,
    ];
    for (file, from, to, arguments, said) in [
        (
            "jink.toml",
            "\naddress =",
            "\naddres =",
            &simulated[..],
            "jink.toml:LINE: unknown key `addres`; did you mean `address`?",
        ),
        (
            "jink.toml",
            "pitch_deg = -90",
            "pich_deg = -90",
            &simulator[..],
            "/jink.toml:LINE: unknown key `pich_deg`; did you mean `pitch_deg`?",
        ),
        (
            "services.toml",
            "cycle_budget_us = 20000",
            "cycle_budget = 20000",
            &simulated[..],
            "services.toml:LINE: unknown key `cycle_budget`; did you mean `cycle_budget_us`?",
        ),
        (
            "services.toml",
            "\"jink-planner\"",
            "\"jink-planer\"",
            &simulated[..],
            ": the program of \"planner\" is missing",
        ),
        (
            "profiles/px4_trajectory.toml",
            "\nGW_RATE",
            "\nGW_RAT",
            &["--profile", "px4_trajectory"],
            "px4_trajectory.toml:LINE: unknown parameter GW_RAT; did you mean `GW_RATE`?",
        ),
        (
            "jink.toml",
            "",
            "",
            &["--set", "params.OA_SPD_MAX=99"],
            "--set params.OA_SPD_MAX=99: OA_SPD_MAX = 99 is outside 0.3 to 20",
        ),
        (
            "jink.toml",
            "",
            "",
            &["--profile", "px5_trajectory"],
            "there is no profile \"px5_trajectory\"; did you mean `px4_trajectory`?",
        ),
        (
            "jink.toml",
            "",
            "",
            &[],
            "jink.toml: sensor \"lidar\": no driver reads this lidar_3d",
        ),
        (
            "jink.toml",
            "",
            "",
            &["--sensor", "mid70"],
            "there is no set of sensors \"mid70\"; known are sphere",
        ),
        (
            "jink.toml",
            "",
            "",
            &["--link", "udp:14540", "--world", "forest"],
            "\"udp:14540\" is no link",
        ),
        (
            "jink.toml",
            "signing = \"off\"",
            "signing = \"required\"",
            &simulated[..],
            "jink.toml:LINE: unknown value `required`; did you mean `require`?",
        ),
        (
            "jink.toml",
            "signing = \"off\"",
            "signing = \"require\"",
            &["--link", "udpin:14540", "--world", "forest"],
            "link.key_file: signatures are asked for, and no file holds the key",
        ),
        (
            "jink.toml",
            "",
            "",
            &["--world", "forrest"],
            "no world is called \"forrest\"; there are forest, gap",
        ),
        (
            "jink.toml",
            "",
            "",
            &["--world", "gap", "--density", "0.1"],
            "the world \"gap\" has no trees, so it takes no density",
        ),
        (
            "jink.toml",
            "",
            "",
            &["--world", "forest", "--density", "-1"],
            "a forest of -1 trees/m2 cannot be drawn",
        ),
        (
            "jink.toml",
            "",
            "",
            &["--world", "/nowhere/own.toml"],
            "/nowhere/own.toml: ",
        ),
    ] {
        let folder = TempFolder::with_config("spoilt");
        let line = spoil(&folder, file, from, to);
        let said = &said.replace("LINE", &line.to_string());
        let refused = up(&folder, arguments);
        assert_eq!(refused.code, Some(CANNOT_START), "{said}: {refused:?}");
        let first = refused.stderr.lines().next().unwrap_or_default();
        assert!(first.starts_with("jink: cannot start: "), "{refused:?}");
        assert!(first.contains(said.as_str()), "expected {said:?}: {refused:?}");
        // A device is looked for by whoever opens it.
        let is_found_by_the_check = !said.contains("no such device");
        assert!(
            !is_found_by_the_check || !refused.stderr.contains(LEFT),
            "{refused:?}"
        );
    }
}

#[test]
fn a_demonstration_that_cannot_start_says_why_and_nothing_else() {
    for (arguments, code, said) in [
        (
            &["--world", "forrest"][..],
            CANNOT_START,
            "did you mean `forest`?",
        ),
        (
            &["--speed", "-3"],
            CANNOT_START,
            "OA_SPD_MAX = -3 is outside 0.3 to 20",
        ),
        (&["--sensor", "mid70"], CANNOT_START, "did you mean `mid360`?"),
        (&["--timeout", "0"], 2, "possible are 0.001 to 86400"),
        (&["--seed", "-1"], 2, "possible are whole numbers from 0"),
        (&["--legs", "0"], 2, "0 is not in 1..=1000"),
        (
            &["--kill", "planner@8"],
            2,
            "is no time after the start of the mission, e.g. 8s",
        ),
    ] {
        let refused = answer(program("jink", &["demo", "--headless"]).args(arguments));
        assert_eq!(refused.code, Some(code), "{refused:?}");
        assert!(refused.stderr.contains(said), "expected {said:?}: {refused:?}");
        assert!(refused.stdout.is_empty(), "a summary of no flight: {refused:?}");
    }
}

#[test]
fn a_second_start_says_that_there_is_one_before_anything_else() {
    let jink = System::up("twice", &["--world", "empty"]);
    let again = jink.jink(&["up", "--world", "empty"]);
    assert_eq!(again.code, Some(CANNOT_START), "{again:?}");
    assert!(again.stderr.contains("is already up"), "{again:?}");
    assert!(again.stdout.is_empty(), "{again:?}");
}

#[test]
fn a_port_that_is_taken_is_named_with_a_way_to_find_out_by_whom() {
    let taken = UdpSocket::bind(("127.0.0.1", 0)).unwrap();
    let port = taken.local_addr().unwrap().port();
    let link = format!("udpin:127.0.0.1:{port}");
    let refused = up(
        &TempFolder::with_config("taken"),
        &["--link", &link, "--world", "forest"],
    );
    assert_eq!(refused.code, Some(CANNOT_START), "{refused:?}");
    assert!(
        refused
            .stderr
            .contains(&format!("port {port} is taken by another program")),
        "{refused:?}"
    );
}

#[test]
fn commands_for_nobody_and_for_unknown_processes_say_so_at_once() {
    let nobody = format!("test_nobody_{}", std::process::id());
    for command in ["status", "down"] {
        let said = answer(&mut program("jink", &["--instance", &nobody, command]));
        assert_eq!(said.code, Some(3), "{said:?}");
    }
    let demo = answer(&mut program(
        "jink",
        &["demo", "--headless", "--kill", "planer@3s"],
    ));
    assert_eq!(demo.code, Some(1), "{demo:?}");
    assert!(
        demo.stderr
            .contains("there is no process \"planer\"; did you mean `planner`?"),
        "{demo:?}"
    );
    assert!(demo.stdout.is_empty(), "something was started: {demo:?}");
}

#[test]
fn without_an_autopilot_it_stands_by_and_garbage_on_the_link_changes_nothing() {
    let port = free_udp_port();
    let link = format!("udpin:127.0.0.1:{port}");
    let jink = System::up("waiting", &["--link", &link, "--world", "forest"]);
    let before = jink.status();
    assert_eq!(before["link"]["autopilot_alive"], false, "{before:#}");
    assert_eq!(before["health"], "starting", "{before:#}");

    let socket = UdpSocket::bind(("127.0.0.1", 0)).unwrap();
    let mut random = 0x2545_f491_4f6c_dd1d_u64;
    let mut sent = 0;
    for datagram in 0..2_000usize {
        let bytes: Vec<u8> = (0..datagram % 1_400 + 1)
            .map(|_| {
                random ^= random << 13;
                random ^= random >> 7;
                random ^= random << 17;
                random as u8
            })
            .collect();
        sent += socket.send_to(&bytes, ("127.0.0.1", port)).unwrap();
    }
    let received = loop {
        let status = jink.status();
        // Datagrams that arrive faster than they are read are dropped by the kernel.
        if status["link"]["garbage_bytes"].as_u64().unwrap_or(0) > sent as u64 / 20 {
            break status;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    };
    assert_eq!(received["link"]["autopilot_alive"], false, "{received:#}");
    for service in received["services"].as_array().unwrap() {
        assert_eq!(service["restarts"], 0, "{received:#}");
    }
    let text = jink.jink(&["status"]);
    assert!(
        text.stdout.contains("the autopilot is not connected ("),
        "{}",
        text.stdout
    );
}
