//! Tests that lack what they need on this machine: they say so, pass, and are listed.

use std::io::Write;
use std::path::PathBuf;

/// Says that the test that calls it does not test, and why. A test that passes is silent, so the line goes also into `not_tested` in the
/// target folder, which `.ci/run` empties at its begin and shows at its end.
pub fn not_tested(why: &str) {
    let thread = std::thread::current();
    let line = format!("NOT TESTED: {}: {}\n", thread.name().unwrap_or("?"), why.trim());
    eprint!("{line}");
    // Where it cannot be written it has been said.
    let _unlisted = list().and_then(|file| {
        let listed = std::fs::read_to_string(&file).unwrap_or_default();
        if listed.contains(&line) {
            return Some(());
        }
        let mut file = std::fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(file)
            .ok()?;
        file.write_all(line.as_bytes()).ok()
    });
}

/// The list, in the target folder of the test that runs: target/<profile>/deps/<test>.
fn list() -> Option<PathBuf> {
    let test = std::env::current_exe().ok()?;
    Some(test.ancestors().nth(3)?.join("not_tested"))
}
