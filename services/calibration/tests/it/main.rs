//! What the calibration promises.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod mountings_are_found_again;
