//! What the map promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod faults_of_sensors_are_found;
mod flights;
mod garbage_never_opens_space;
mod motion_is_compensated_per_point;
mod nothing_is_allocated_after_construction;
mod rays_open_only_what_they_cross;
mod sensors_expire_and_resets_drop_the_map;
mod single_beams_are_conservative;
mod thin_things_stay_and_gone_things_go;
mod two_runs_agree_to_the_bit;
mod what_moves_is_tracked;
mod world;
