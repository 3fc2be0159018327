//! `jink demo` and its kin as a script sees them where nothing flies.

use std::process::{Command, Output};

fn lab(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_jink-lab"));
    command.args(arguments).output().unwrap()
}

fn words(output: &[u8]) -> String {
    String::from_utf8(output.to_vec()).unwrap()
}

#[test]
fn what_cannot_be_understood_is_two_and_says_how_to_write_it() {
    let demo = lab(&["demo", "--kill", "planner"]);
    assert_eq!(demo.status.code(), Some(2));
    assert!(words(&demo.stderr).contains("write NAME@TIMEs, e.g. planner@8s"));
}

#[test]
fn what_would_measure_nothing_is_wrong_usage() {
    assert_eq!(lab(&["chaos", "--flights", "0"]).status.code(), Some(2));
    let demo = lab(&["demo", "--svg", "/nowhere/flight.svg"]);
    assert_eq!(demo.status.code(), Some(1));
    assert!(
        words(&demo.stderr).starts_with("jink: --svg /nowhere/flight.svg: "),
        "{demo:?}"
    );
}

#[test]
fn every_command_explains_itself_as_one_of_jink() {
    for command in ["demo", "chaos", "bench"] {
        let help = lab(&[command, "--help"]);
        assert!(help.status.success());
        assert!(
            words(&help.stdout).contains(&format!("Usage: jink {command}")),
            "{command}"
        );
    }
}
