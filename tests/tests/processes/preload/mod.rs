//! Libraries in C that are loaded before the C library of the programs under test (LD_PRELOAD).

use jink_tests::processes::workspace;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The library `name`, compiled into `folder`.
pub fn library(folder: &Path, name: &str) -> Result<PathBuf, String> {
    let library = folder.join(format!("{name}.so"));
    let compiled = Command::new("cc")
        .args(["-O1", "-shared", "-fPIC", "-o"])
        .arg(&library)
        .arg(workspace().join(format!("tests/tests/processes/preload/{name}.c")))
        .status();
    match compiled {
        Ok(status) if status.success() => Ok(library),
        other => Err(format!("no C compiler: {other:?}")),
    }
}
