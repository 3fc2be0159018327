//! What holds for both emulated autopilots, and what the documentation says of them, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod either_autopilot_is_observed_alike;
mod every_test_the_documentation_names_exists;
