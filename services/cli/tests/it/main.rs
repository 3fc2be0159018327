//! What the commands promise, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod an_aircraft_needs_no_simulations;
mod other_languages_read_the_same_bytes;
mod scripts_can_rely_on_exit_codes;
mod wrong_commands_are_refused;
