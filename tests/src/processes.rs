//! The real programs, run as a user runs them.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The folder of the workspace.
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .map_or_else(PathBuf::new, Path::to_path_buf)
}

/// The folder with all programs of the profile this test was built in; builds what is missing there.
///
/// # Panics
/// If the programs cannot be built: without them there is nothing to test.
pub fn programs() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let test = std::env::current_exe().unwrap_or_default();
        // target/<profile>/deps/<test>
        let folder = test
            .ancestors()
            .nth(2)
            .map_or_else(PathBuf::new, Path::to_path_buf);
        let mut build = Command::new(env!("CARGO"));
        build
            .args(["build", "--workspace", "--bins", "--quiet"])
            .current_dir(workspace());
        if folder.ends_with("release") {
            build.arg("--release");
        }
        let built = build.status().is_ok_and(|status| status.success());
        assert!(
            built,
            "the programs could not be built: cargo build --workspace --bins"
        );
        folder
    })
}

/// One program of ours with `arguments`, started in the workspace.
pub fn program(name: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(programs().join(name));
    command.args(arguments).current_dir(workspace());
    command
}

/// What a demonstration flight said: its whole output, and the JSON object on the last line.
#[derive(Debug)]
pub struct Demo {
    /// Standard output and error.
    pub text: String,
    /// The figures; null if there are none.
    pub figures: Value,
    /// Its exit code.
    pub code: Option<i32>,
}

/// Flies `jink demo --headless --json` with further `arguments`.
pub fn demo(arguments: &[&str]) -> Demo {
    let mut all = vec!["demo", "--headless", "--json"];
    all.extend(arguments);
    let output = program("jink", &all).output();
    let Ok(Output {
        status,
        stdout,
        stderr,
    }) = output
    else {
        return Demo {
            text: format!("jink demo could not be started: {:?}", output.err()),
            figures: Value::Null,
            code: None,
        };
    };
    let stdout = String::from_utf8_lossy(&stdout).into_owned();
    let last = stdout.lines().last().unwrap_or_default();
    Demo {
        figures: serde_json::from_str(last).unwrap_or(Value::Null),
        text: format!("{stdout}\n{}", String::from_utf8_lossy(&stderr)),
        code: status.code(),
    }
}
