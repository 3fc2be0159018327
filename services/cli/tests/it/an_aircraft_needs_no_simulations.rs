//! `jink` operates an aircraft; what flies simulations is a program beside it, which may be absent.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The commands that another program carries out.
const SIMULATIONS: [&str; 5] = ["demo", "chaos", "campaign", "approach", "bench"];

/// `jink` alone in a folder of its own, which is removed with this.
struct Alone(PathBuf);

impl Alone {
    fn new(role: &str) -> Self {
        let folder =
            Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("alone_{role}_{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        // A link, not a copy: a file that was just written cannot be executed while a child of another test still has it open.
        fs::hard_link(env!("CARGO_BIN_EXE_jink"), folder.join("jink")).unwrap();
        Self(folder)
    }

    fn jink(&self, arguments: &[&str]) -> Output {
        Command::new(self.0.join("jink"))
            .args(arguments)
            .output()
            .unwrap()
    }
}

impl Drop for Alone {
    fn drop(&mut self) {
        let _gone_already = fs::remove_dir_all(&self.0);
    }
}

fn words(output: &[u8]) -> String {
    String::from_utf8(output.to_vec()).unwrap()
}

#[test]
fn without_the_program_beside_it_a_simulation_gets_one_clear_error() {
    let alone = Alone::new("absent");
    for command in SIMULATIONS {
        let answer = alone.jink(&[command, "--help"]);
        assert_eq!(answer.status.code(), Some(1), "{answer:?}");
        let said = words(&answer.stderr);
        let expected = format!("jink: jink {command} needs jink-lab, which is for simulations and not in ");
        assert!(said.starts_with(&expected) && said.lines().count() == 1, "{said}");
        assert!(said.contains("cargo build --release --bin jink-lab"), "{said}");
        assert!(answer.stdout.is_empty(), "{answer:?}");
    }
}

#[test]
fn the_help_lists_simulations_all_the_same() {
    let help = words(&Alone::new("help").jink(&["--help"]).stdout);
    for command in SIMULATIONS {
        let line = help.lines().find(|line| line.trim_start().starts_with(command));
        assert!(
            line.is_some_and(|line| line.split_whitespace().count() > 3),
            "{help}"
        );
    }
}

/// Written by a shell, for the same reason.
fn script(path: &Path, text: &str) {
    let written = Command::new("sh")
        .args(["-c", "printf %s \"$2\" > \"$1\" && chmod +x \"$1\"", "sh"])
        .args([path.as_os_str(), text.as_ref()])
        .status();
    assert!(written.unwrap().success());
}

#[test]
fn arguments_instance_and_exit_code_are_those_of_the_program_beside_it() {
    let beside = Alone::new("beside");
    script(&beside.0.join("jink-lab"), "#!/bin/sh\necho \"$@\"\nexit 7\n");
    for (arguments, passed_on) in [
        (&["demo", "--help"][..], "demo --help\n"),
        (
            &["chaos", "--flights", "3", "--version"],
            "chaos --flights 3 --version\n",
        ),
        (
            &["--instance", "x", "demo", "--json"],
            "--instance x demo --json\n",
        ),
        (
            &["demo", "--instance", "x", "--json"],
            "--instance x demo --json\n",
        ),
        (
            &["demo", "--json", "--instance", "x"],
            "demo --json --instance x\n",
        ),
        (&["bench", "map", "-h"], "bench map -h\n"),
    ] {
        let answer = beside.jink(arguments);
        assert_eq!(words(&answer.stdout), passed_on, "{answer:?}");
        assert_eq!(answer.status.code(), Some(7), "{answer:?}");
    }
}

#[test]
fn it_becomes_the_program_beside_it_so_that_signals_reach_that() {
    let beside = Alone::new("signals");
    script(&beside.0.join("jink-lab"), "#!/bin/sh\necho $$\n");
    let jink = Command::new(beside.0.join("jink"))
        .arg("demo")
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let own = jink.id().to_string();
    let answer = jink.wait_with_output().unwrap();
    assert_eq!(words(&answer.stdout).trim(), own);
}
