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
fn every_wrong_argument_is_refused_with_what_is_possible() {
    for (line, cause) in [
        ("demo --timeout 0", "possible are 0.001 to 86400"),
        ("demo --timeout -5", "possible are 0.001 to 86400"),
        ("demo --seed -1", "possible are whole numbers from 0"),
        ("demo --legs 0", "0 is not in 1..=1000"),
        ("demo --speed fast", "invalid value 'fast'"),
        ("demo --sped 3", "'--speed'"),
        (
            "demo --kill planner@8",
            "is no time after the start of the mission, e.g. 8s",
        ),
        (
            "demo --kill planner@-1s",
            "is no time after the start of the mission, e.g. 8s",
        ),
        ("demo --kill @8s", "write NAME@TIMEs"),
        ("demo --wind 99,0", "at most 30 m/s"),
        ("chaos --flights -1", "-1"),
        ("chaos --apart 0", "possible are 0.001 to 86400"),
        ("chaos --faults kil", "choose of kill"),
        ("bench", "Usage: jink bench"),
        ("bench latency --points 1", "1 is not in 100..="),
        ("bench latency --rates 0", "possible are 1 to 100"),
        ("bench latency --seconds -3", "possible are 1 to 3600"),
        ("bench latency --sensors 0", "0 is not in 1..="),
    ] {
        let arguments: Vec<&str> = line.split(' ').collect();
        let refused = lab(&arguments);
        assert_eq!(refused.status.code(), Some(2), "{line}: {refused:?}");
        assert!(
            words(&refused.stderr).contains(cause),
            "{line}: {}",
            words(&refused.stderr)
        );
    }
}

#[test]
fn what_would_measure_nothing_is_wrong_usage() {
    assert_eq!(lab(&["chaos", "--flights", "0"]).status.code(), Some(2));
    let demo = lab(&["demo", "--report", "/nowhere/flight.html"]);
    assert_eq!(demo.status.code(), Some(1));
    assert!(
        words(&demo.stderr).starts_with("jink: --report /nowhere/flight.html: "),
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
