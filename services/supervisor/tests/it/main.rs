//! What the supervisor promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod processes_are_kept_running;
mod rig;
mod the_configuration_that_is_shipped_is_valid;
