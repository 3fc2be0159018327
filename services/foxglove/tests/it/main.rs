//! The promises of `jink-foxglove`, each in a file of its own.
#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used)]

mod a_recording_is_converted_or_refused_in_one_line;
