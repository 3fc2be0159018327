//! The supervisor with real processes: what dies or hangs is replaced, and what cannot be helped is given up.

use crate::rig::{Rig, is_alive, row, send, stand_in, wait_for};
use jink_runtime::Session;
use jink_runtime::request::Request;
use jink_shared_types::health::{Health, ServiceState};
use rustix::process::Signal;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

#[test]
fn a_killed_process_is_replaced_and_the_status_says_so() {
    let mut rig = Rig::new(&[row("one", "[]", ""), row("two", "[]", "")]);
    rig.start();
    rig.wait_health(Health::Healthy);
    let before = rig.wait_active("two");
    send(before.pid, Signal::KILL);
    let after = rig.wait_process("two", |process| {
        process.state == ServiceState::Active && process.pid != before.pid
    });
    assert_eq!(
        (after.restarts, after.last_exit, after.heartbeat.generation),
        (1, 256 + 9, 2)
    );
    assert!(after.recovery_us > 0);
    let status = rig.wait_health(Health::Healthy);
    assert_eq!(status.restarts, 1);
    assert_eq!(rig.wait_active("one").restarts, 0, "nobody else was touched");
    println!("death to first heartbeat of the loop: {} us", after.recovery_us);
}

#[test]
fn a_stopped_process_is_a_hang_and_is_replaced() {
    let rows = [row("one", "[]", "heartbeat_timeout_ms = 200")];
    let mut rig = Rig::new(&rows);
    rig.start();
    let before = rig.wait_active("one");
    send(before.pid, Signal::STOP);
    let after = rig.wait_process("one", |process| {
        process.state == ServiceState::Active && process.pid != before.pid
    });
    assert_eq!(after.last_exit, 256 + 9, "a hang ends with SIGKILL");
    let (_, log) = rig.stop();
    assert!(log.contains(" hung, replaced"), "{log}");
}

#[test]
fn a_process_that_dies_again_and_again_is_given_up() {
    let restart = "restart = { intensity = 3, period_s = 600 }";
    let rows = [
        row("steady", "[]", ""),
        row("crasher", "[\"crash_after_ms=20\"]", restart),
    ];
    let mut rig = Rig::new(&rows);
    rig.start();
    let crasher = rig.wait_process("crasher", |process| process.state == ServiceState::Failed);
    assert_eq!(
        (crasher.restarts, crasher.pid, crasher.last_exit),
        (3, 0, 256 + 6)
    );
    rig.wait_health(Health::Failed);
    assert!(is_alive(rig.wait_active("steady").pid), "the others go on");
    let (status, log) = rig.stop();
    assert!(status.success());
    assert!(
        log.contains("stand-in crashes as asked"),
        "the last words are repeated: {log}"
    );
    let kept = rig.instance.log_folder().join("crasher.log");
    assert!(log.contains("logs are kept in") && kept.exists());
}

#[test]
fn what_cannot_start_ends_the_start_with_its_own_words() {
    let rows = [
        row("one", "[]", ""),
        row("two", "[\"cannot_start\"]", ""),
        row("three", "[]", ""),
    ];
    let mut rig = Rig::new(&rows);
    rig.start();
    let (status, log) = rig.ended();
    assert_eq!(status.code(), Some(78));
    let reason =
        "cannot start: two ended with exit code 78: stand_in cannot start: a device: it is not plugged in";
    assert!(log.contains(reason), "{log}");
    let folder = rig.instance.folder();
    assert!(!folder.exists(), "nothing is left of it: {}", folder.display());
}

#[test]
fn a_folder_that_others_may_write_to_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let rig = Rig::new(&[row("one", "[]", "")]);
    let folder = rig.instance.folder();
    std::fs::create_dir(&folder).unwrap();
    std::fs::set_permissions(&folder, PermissionsExt::from_mode(0o777)).unwrap();
    let output = rig.command().output().unwrap();
    let log = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(78));
    let reason = "can be written by other users; remove it";
    assert!(log.contains(reason), "{log}");
    assert_eq!(
        std::fs::read_dir(&folder).unwrap().count(),
        0,
        "nothing is written there"
    );
    std::fs::remove_dir(&folder).unwrap();
}

#[test]
fn what_is_not_essential_and_cannot_start_yet_is_tried_again() {
    // The first replacement finds its device missing, the second one has it back.
    let arguments = "[\"cannot_start\", \"generations=2\"]";
    let optional = "essential = false\nrestart = { ceiling_ms = 50 }";
    let mut rig = Rig::new(&[row("one", "[]", ""), row("device", arguments, optional)]);
    rig.start();
    let device = rig.wait_active("device");
    assert_eq!((device.heartbeat.generation, device.last_exit), (3, 78));
}

#[test]
fn processes_start_in_order_and_stop_in_reverse_order() {
    let names = ["one", "two", "three"];
    let mut rig = Rig::new(&names.map(|name| row(name, "[]", "")));
    rig.start();
    let status = rig.wait_health(Health::Healthy);
    let starts: Vec<u64> = status
        .processes()
        .iter()
        .map(|process| process.started.ns)
        .collect();
    assert!(starts.is_sorted(), "{starts:?}");
    let (status, log) = rig.stop();
    assert!(status.success());
    let stopped: Vec<&str> = log
        .lines()
        .filter(|line| line.contains("\"message\":\"stopped\"") && line.contains("\"process\""))
        .filter_map(|line| {
            names
                .into_iter()
                .find(|name| line.contains(&format!("\"process\":\"{name}\"")))
        })
        .collect();
    assert_eq!(stopped, ["three", "two", "one"], "{log}");
}

#[test]
fn nothing_is_left_in_memory_after_a_stop() {
    let mut rig = Rig::new(&[row("one", "[]", "")]);
    rig.start();
    let pid = rig.wait_active("one").pid;
    assert!(!rig.stale_resources().is_empty());
    let (status, _) = rig.stop();
    assert!(status.success());
    assert_eq!(rig.stale_resources(), [""; 0]);
    assert!(!is_alive(pid));
}

#[test]
fn a_process_that_ignores_sigterm_is_killed_at_a_stop() {
    let deaf = row("deaf", "[\"hang_after_ms=50\"]", "heartbeat_timeout_ms = 60000");
    let mut rig = Rig::new(&[row("one", "[]", ""), deaf]);
    rig.start();
    let pids = ["one", "deaf"].map(|name| rig.wait_process(name, |process| process.pid != 0).pid);
    let (status, _) = rig.stop();
    assert!(status.success());
    assert!(!pids.into_iter().any(is_alive));
}

#[test]
fn a_second_supervisor_is_refused_with_the_id_of_the_first() {
    let mut rig = Rig::new(&[row("one", "[]", "")]);
    rig.start();
    let status = rig.wait_health(Health::Healthy);
    let second = rig.command().output().unwrap();
    assert_eq!(second.status.code(), Some(78));
    let log = String::from_utf8(second.stderr).unwrap();
    assert!(
        log.contains(&format!("held by the supervisor with process id {}", status.pid)),
        "{log}"
    );
    assert!(is_alive(rig.wait_active("one").pid), "the first one goes on");
    assert!(rig.stop().0.success());
}

#[test]
fn a_malformed_table_or_setting_is_refused_with_its_place() {
    let rig = Rig::new(&[row("one", "[]", "esential = true")]);
    let refused = rig.command().output().unwrap();
    assert_eq!(refused.status.code(), Some(78));
    let log = String::from_utf8(refused.stderr).unwrap();
    assert!(
        log.contains("services.toml:8: unknown key `esential`; did you mean `essential`?"),
        "{log}"
    );
    assert!(rig.stale_resources().is_empty(), "nothing has been created");

    let rig = Rig::new(&[row("one", "[]", "")]);
    let refused = rig
        .command()
        .args(["--set", "params.OA_SPD_MAX=99"])
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(78));
    let log = String::from_utf8(refused.stderr).unwrap();
    assert!(log.contains("OA_SPD_MAX = 99 is outside"), "{log}");
}

#[test]
fn children_of_a_killed_supervisor_fly_on_and_the_next_one_goes_on_with_them() {
    let mut rig = Rig::new(&[row("one", "[]", ""), row("two", "[]", "")]);
    rig.start();
    rig.wait_health(Health::Healthy);
    let pids = ["one", "two"].map(|name| rig.wait_active(name).pid);
    rig.signal_supervisor(Signal::KILL);
    rig.ended();
    std::thread::sleep(Duration::from_millis(300));
    assert!(pids.into_iter().all(is_alive), "nobody depends on the supervisor");

    // What it was made from does not matter while they fly: an edit with a mistake, or an upgrade that is not finished.
    std::fs::write(rig.config.join("jink.toml"), "half a line = [").unwrap();
    std::fs::remove_file(rig.config.join("services.toml")).unwrap();
    rig.start();
    rig.wait_health(Health::Healthy);
    assert_eq!(["one", "two"].map(|name| rig.wait_active(name).pid), pids);
    // It sees the death of what is not its own child, too.
    send(pids[0], Signal::KILL);
    let again = rig.wait_process("one", |one| {
        one.restarts == 1 && one.state == ServiceState::Active
    });
    assert_ne!(again.pid, pids[0]);
    assert_eq!(rig.wait_active("two").pid, pids[1]);
    let (status, log) = rig.stop();
    assert!(status.success(), "{log}");
    assert!(!pids.into_iter().any(is_alive));
}

#[test]
fn where_everything_was_killed_the_first_start_works() {
    let mut rig = Rig::new(&[row("one", "[]", "")]);
    rig.start();
    let first = rig.wait_active("one").pid;
    rig.signal_supervisor(Signal::KILL);
    send(first, Signal::KILL);
    rig.ended();
    wait_for("the end", || (!is_alive(first)).then_some(()));
    // Somebody looks at it meanwhile, as commands do.
    let looks = Session::open(&rig.instance, "cli").unwrap();
    rig.start();
    assert_ne!(rig.wait_active("one").pid, first);
    drop(looks);
    let (status, log) = rig.stop();
    assert!(status.success(), "{log}");
}

#[test]
fn what_a_killed_supervisor_has_left_can_be_swept_away() {
    let mut rig = Rig::new(&[row("one", "[]", "")]);
    rig.start();
    let pid = rig.wait_active("one").pid;
    rig.signal_supervisor(Signal::KILL);
    rig.ended();
    let swept = rig.command().arg("--sweep").status().unwrap();
    assert!(swept.success());
    wait_for("the end", || (!is_alive(pid)).then_some(()));
    assert_eq!(rig.stale_resources(), [""; 0]);
}

#[test]
fn a_swap_goes_all_the_way_and_a_bad_candidate_leaves_the_owner_alone() {
    let mut rig = Rig::new(&[row("one", "[]", "")]);
    rig.start();
    let first = rig.wait_active("one");
    let swap = |program: &str| Request::Swap {
        process: "one".to_owned(),
        program: Some(program.into()),
        cycles: Some(5),
        dry_run: false,
    };
    let refused = rig.ask(&swap("/bin/true"));
    let last = refused.last().unwrap();
    assert!(!last.good && last.text.contains("never touched"), "{refused:?}");
    assert_eq!(rig.wait_active("one").pid, first.pid);

    let answers = rig.ask(&swap(&stand_in()));
    assert!(answers.last().unwrap().good, "{answers:?}");
    let second = rig.wait_process("one", |one| {
        one.pid != first.pid && one.state == ServiceState::Active
    });
    assert_eq!(second.restarts, 0);
    wait_for("the end of the old one", || (!is_alive(first.pid)).then_some(()));
    let (status, log) = rig.stop();
    assert!(status.success(), "{log}");
    assert_eq!(rig.stale_resources(), [""; 0]);
}

/// The file that process `pid` runs.
fn file_of(pid: u32) -> std::path::PathBuf {
    std::fs::read_link(format!("/proc/{pid}/exe")).unwrap()
}

#[test]
fn a_death_brings_the_swapped_program_back_and_a_restart_the_one_of_the_table() {
    for alone in ["", "shadow = false"] {
        let mut rig = Rig::new(&[row("one", "[]", alone)]);
        rig.start();
        let first = rig.wait_active("one").pid;
        let own = file_of(first);
        let other = rig.config.join("other");
        std::fs::copy(stand_in(), &other).unwrap();
        let swap = |program: Option<std::path::PathBuf>| Request::Swap {
            process: "one".to_owned(),
            program,
            cycles: Some(5),
            dry_run: false,
        };
        let answers = rig.ask(&swap(Some(other.clone())));
        assert!(answers.last().unwrap().good, "{answers:?}");
        let second = rig
            .wait_process("one", |one| {
                one.pid != first && one.pid != 0 && one.state == ServiceState::Active
            })
            .pid;
        assert_eq!(file_of(second), other);
        send(second, Signal::KILL);
        let third = rig
            .wait_process("one", |one| {
                one.pid != second && one.pid != 0 && one.state == ServiceState::Active
            })
            .pid;
        assert_eq!(file_of(third), other);
        let answers = rig.ask(&swap(None));
        assert!(answers.last().unwrap().good, "{answers:?}");
        let fourth = rig
            .wait_process("one", |one| {
                one.pid != third && one.pid != 0 && one.state == ServiceState::Active
            })
            .pid;
        assert_eq!(file_of(fourth), own, "{alone}");
        let (status, log) = rig.stop();
        assert!(status.success(), "{log}");
    }
}

#[test]
fn where_there_is_no_second_instance_a_wrong_program_gives_way_to_the_right_one() {
    let mut rig = Rig::new(&[row("one", "[]", "shadow = false")]);
    rig.start();
    let first = rig.wait_active("one").pid;
    let own = file_of(first);
    let answers = rig.ask(&Request::Swap {
        process: "one".to_owned(),
        program: Some("/bin/false".into()),
        cycles: None,
        dry_run: false,
    });
    let last = answers.last().unwrap();
    assert!(!last.good && last.text.contains("rolled back"), "{answers:?}");
    let back = rig.wait_process("one", |one| {
        one.pid != first && one.pid != 0 && one.state == ServiceState::Active
    });
    assert_eq!(file_of(back.pid), own);
    let (status, log) = rig.stop();
    assert!(status.success(), "{log}");
}

#[test]
fn the_supervisor_itself_is_upgraded_and_nobody_notices() {
    let mut rig = Rig::new(&[row("one", "[]", "")]);
    rig.start();
    let one = rig.wait_active("one").pid;
    let upgrade = |program: &str| Request::Upgrade {
        program: program.into(),
    };
    let refused = rig.ask(&upgrade("/bin/true"));
    assert!(refused.last().is_some_and(|answer| !answer.good), "{refused:?}");
    // One that hangs is not waited for by anybody who needs the supervisor.
    let hangs = rig.config.join("hangs");
    std::fs::write(&hangs, "#!/bin/sh\nexec sleep 1000\n").unwrap();
    std::fs::set_permissions(&hangs, std::fs::Permissions::from_mode(0o755)).unwrap();
    let asked = rig.ask_beside(&upgrade(hangs.to_str().unwrap()));
    send(one, Signal::KILL);
    let one = rig.wait_process("one", |now| {
        now.restarts == 1 && now.state == ServiceState::Active
    });
    let refused = asked.join().unwrap();
    let last = refused.last().unwrap();
    assert!(
        !last.good && last.text.contains("has not answered"),
        "{refused:?}"
    );
    let one = one.pid;
    let answers = rig.ask(&upgrade(&crate::rig::supervisor()));
    assert!(answers.last().is_some_and(|answer| answer.good), "{answers:?}");
    rig.reconnect();
    assert_eq!(rig.wait_active("one").pid, one);
    send(one, Signal::KILL);
    let again = rig.wait_process("one", |now| {
        now.restarts == 2 && now.state == ServiceState::Active
    });
    assert_ne!(again.pid, one);
    let (status, log) = rig.stop();
    assert!(status.success(), "{log}");
}

#[test]
fn the_service_manager_receives_ready_alive_and_stopping() {
    let mut rig = Rig::new(&[row("one", "[]", "")]);
    let path = rig.config.join("notify");
    let manager = UnixDatagram::bind(&path).unwrap();
    manager.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let mut command = rig.command();
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "200000");
    rig.start_as(command);
    let mut received = String::new();
    let mut receive_until = |wanted: &str| {
        let mut buffer = [0; 512];
        while !received.contains(wanted) {
            let len = manager
                .recv(&mut buffer)
                .unwrap_or_else(|_| panic!("no {wanted} in {received}"));
            received.push_str(std::str::from_utf8(&buffer[..len]).unwrap());
        }
    };
    receive_until("READY=1\n");
    receive_until("STATUS=healthy\n");
    receive_until("WATCHDOG=1\n");
    rig.signal_supervisor(Signal::TERM);
    receive_until("STOPPING=1\n");
    let (status, _) = rig.ended();
    assert!(status.success());
    assert!(received.find("READY=1") < received.find("STOPPING=1"));
}
