//! The promises of `jink-foxglove`, each in a file of its own.

mod a_recording_is_converted_or_refused_in_one_line;
