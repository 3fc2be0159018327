//! What reports promise, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_flight_becomes_a_page;
mod logs_of_autopilots_are_read;
