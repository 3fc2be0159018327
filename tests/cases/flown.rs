//! A jink in an empty world beside the small autopilot of the cases.

use crate::given::Case;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, answer};

/// The port that is written in the programs of the cases.
const WRITTEN: &str = "14540";

/// How long a mission is flown (s): on a busy machine it takes its time.
const SECONDS: &str = "50";

/// Flies a mission of the folder; what was said meanwhile, the figures on the last line. `None` where that is impossible.
pub fn mission(file: &str, options: &[&str]) -> Option<String> {
    let (role, _) = file.split_once('.')?;
    let mut arguments = vec![file, "--seconds", SECONDS];
    arguments.extend(options);
    // The name of an instance has room for some letters only.
    let role: String = role.chars().filter(|c| *c != '_').take(8).collect();
    let make = if options.contains(&"px4") { "p" } else { "" };
    beside(&format!("{role}{make}"), "fly.py", &arguments)
}

/// Runs a program of the folder beside a jink; what it said.
pub fn beside(role: &str, script: &str, arguments: &[&str]) -> Option<String> {
    let case = Case::find()?;
    let python = case.python()?;
    let port = free_udp_port();
    let address = format!("udpin:127.0.0.1:{port}");
    let jink = System::up(
        role,
        &[
            "--world",
            "empty",
            // Where there is nothing, it sees that there is nothing.
            "--sensor",
            "sphere",
            "--link",
            &address,
            "--set",
            "params.OA_SPD_MAX=5",
        ],
    );
    let said = answer(&mut python.script(script, arguments, &[(WRITTEN, port)]));
    drop(jink);
    assert_eq!(said.code, Some(0), "{said:?}");
    Some(said.stdout)
}
