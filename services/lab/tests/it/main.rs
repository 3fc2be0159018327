//! What the program of simulated flights promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod scripts_can_rely_on_exit_codes;
