//! Where programs and configuration lie.

use crate::Problem;
use jink_runtime::programs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Folder of this program; the others lie beside it.
pub fn program_folder() -> Result<PathBuf, Problem> {
    let own = std::env::current_exe().map_err(Problem::io("own program"))?;
    let folder = own.parent().map(Path::to_owned);
    folder.ok_or_else(|| Problem::Other("jink's own program has no folder".to_owned()))
}

/// A command that starts the program called `name` in `folder`.
pub fn program(folder: &Path, name: &str) -> Result<Command, Problem> {
    let file = programs::file_of(&folder.join(name));
    if file.is_file() {
        return Ok(programs::command(&file, name.as_ref()));
    }
    let bin = file.file_name().unwrap_or_default().display();
    Err(Problem::Other(format!(
        "{} is missing: build it with `cargo build --release --bin {bin}`, or install the package",
        file.display()
    )))
}

/// The configuration folder: the one asked for, else ./config, else /etc/jink, else the `config` folder nearest above
/// the program (a checkout).
pub fn config_folder(asked_for: Option<&Path>) -> Result<PathBuf, Problem> {
    if let Some(folder) = asked_for {
        return Ok(folder.to_owned());
    }
    let program = program_folder()?;
    let mut candidates = vec![PathBuf::from("config"), PathBuf::from("/etc/jink")];
    candidates.extend(program.ancestors().map(|folder| folder.join("config")));
    let found = candidates
        .into_iter()
        .find(|folder| folder.join(jink_runtime::config::CONFIG_FILE).is_file());
    found.ok_or_else(|| {
        Problem::Other(
            "no configuration: neither ./config nor /etc/jink holds a jink.toml; give --config".to_owned(),
        )
    })
}

/// Where demonstrations are recorded: `jink/recordings` in the user's folder for what programs leave behind (XDG Base Directory
/// Specification). `None`: the user has no folder.
pub fn recordings_folder() -> Option<PathBuf> {
    let absolute = |name: &str| {
        std::env::var_os(name)
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
    };
    let state = absolute("XDG_STATE_HOME").or_else(|| Some(absolute("HOME")?.join(".local/state")))?;
    Some(state.join("jink/recordings"))
}

/// The checkout that `folder` lies in: the nearest one above with a Cargo.lock.
pub fn workspace(folder: &Path) -> Option<&Path> {
    folder
        .ancestors()
        .find(|folder| folder.join("Cargo.lock").is_file())
}
/// Tries whether `file` can be written, before the flight whose results it is to hold. Its content stays.
///
/// # Errors
/// What the system says.
pub fn writable(file: &Path) -> std::io::Result<()> {
    let is_new = !file.exists();
    std::fs::File::options().create(true).append(true).open(file)?;
    if is_new {
        std::fs::remove_file(file)?;
    }
    Ok(())
}
