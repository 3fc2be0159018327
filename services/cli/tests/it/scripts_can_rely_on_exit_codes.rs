//! The `jink` program as a script sees it where nothing runs.

use std::process::{Command, Output};

fn jink(arguments: &[&str]) -> Output {
    let instance = format!("cli{}", std::process::id());
    let mut command = Command::new(env!("CARGO_BIN_EXE_jink"));
    command
        .args(["--instance", &instance])
        .args(arguments)
        .output()
        .unwrap()
}

fn words(output: &[u8]) -> String {
    String::from_utf8(output.to_vec()).unwrap()
}

#[test]
fn nothing_running_is_three() {
    let status = jink(&["status"]);
    assert_eq!(status.status.code(), Some(3));
    assert!(words(&status.stderr).contains("not running"));
    let list = jink(&["param", "list"]);
    assert_eq!(list.status.code(), Some(3));
    let down = jink(&["down"]);
    assert_eq!(down.status.code(), Some(3));
    assert!(words(&down.stdout).contains("nothing is running"));
}

#[test]
fn what_cannot_be_understood_is_two_and_says_how_to_write_it() {
    let up = jink(&["up", "--seed", "3"]);
    assert_eq!(up.status.code(), Some(2));
    assert!(
        words(&up.stderr).contains("--world"),
        "a seed without a world means nothing"
    );
}

#[test]
fn what_cannot_be_done_is_an_error_of_one_line() {
    let up = jink(&["up", "--detach", "--config", "/nowhere"]);
    assert!(!up.status.success());
    let said = words(&up.stderr);
    assert!(said.starts_with("jink: ") && said.lines().count() == 1, "{said}");
}

#[test]
fn a_name_like_no_other_gets_no_suggestion() {
    let similar_to_nothing = jink(&["param", "set", "NOPE", "3"]);
    assert!(!words(&similar_to_nothing.stderr).contains("did you mean"));
}

#[test]
fn a_parameter_that_is_not_or_may_not_be_is_refused_before_anybody_is_asked() {
    let unknown = jink(&["param", "set", "OA_SPEED_MAX", "3"]);
    assert_eq!(unknown.status.code(), Some(1));
    assert!(words(&unknown.stderr).contains("did you mean `OA_SPD_MAX`?"));
    let too_fast = jink(&["param", "set", "OA_SPD_MAX", "99"]);
    assert_eq!(too_fast.status.code(), Some(1));
    assert!(words(&too_fast.stderr).contains("outside 0.3 to 20"));
}

#[test]
fn every_command_explains_itself() {
    for command in ["up", "down", "status", "param", "world", "instances"] {
        let help = jink(&[command, "--help"]);
        assert!(help.status.success());
        assert!(words(&help.stdout).contains("Usage: jink"), "{command}");
    }
}
