//! `tracing` for people on a terminal, as JSON lines for journals and files.

use std::io::IsTerminal;
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
