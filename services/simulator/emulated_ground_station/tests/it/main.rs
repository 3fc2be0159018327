//! What the ground station promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_ground_station_flies_a_whole_mission;
