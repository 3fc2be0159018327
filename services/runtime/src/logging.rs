//! `tracing` for people on a terminal, as JSON lines for journals and files.

use std::io::{Error, ErrorKind, IsTerminal};
use std::path::Path;
use tracing::Level;

/// Sends all further log records of this process to standard error: readable on a terminal, one JSON object per line
/// otherwise. A second call changes nothing.
pub fn init(process: &str, level: Level) {
    let terminal = std::io::stderr().is_terminal();
    let builder = tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr);
    // An already set subscriber (a test's, for example) stays: there is nothing better to do than to log through it.
    let _already_set = if terminal {
        builder.with_target(false).compact().try_init()
    } else {
        builder
            .json()
            .flatten_event(true)
            .with_current_span(false)
            .try_init()
    };
    // iceoryx2 has a logger of its own; below "error" it prints whole objects.
    iceoryx2::prelude::set_log_level(iceoryx2::prelude::LogLevel::Error);
    tracing::debug!(process, "logging");
}

/// Makes the folder of a log, if it is not there: the last part of its path and no more, since a path that is misspelt leads nowhere.
///
/// # Errors
/// What the system says, and that the folder is nowhere to be made in.
pub fn make_folder(folder: &Path) -> std::io::Result<()> {
    match std::fs::create_dir(folder) {
        Err(_) if folder.is_dir() => Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => Err(Error::new(
            ErrorKind::NotFound,
            "the folder that it would be in is not there: is it misspelt?",
        )),
        made => made,
    }
}

#[cfg(test)]
mod tests {
    use super::make_folder;

    #[test]
    fn only_the_last_part_of_a_path_is_made() {
        let place = std::env::temp_dir().join(format!("jink_make_folder_{}", std::process::id()));
        let misspelt = place.join("lgo/jink");
        make_folder(&place).unwrap();
        make_folder(&place).unwrap();
        let refused = make_folder(&misspelt).unwrap_err().to_string();
        let is_made = misspelt.parent().is_some_and(std::path::Path::exists);
        std::fs::write(place.join("file"), "").unwrap();
        let file = make_folder(&place.join("file"));
        std::fs::remove_dir_all(&place).unwrap();
        assert!(refused.contains("is it misspelt?") && !is_made, "{refused}");
        assert!(file.is_err());
    }
}
