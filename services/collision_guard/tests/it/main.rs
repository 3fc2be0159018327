//! What the guard promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_part_of_a_sweep_leaves_the_others_alone;
mod a_planar_scan_is_seen_where_it_looks;
mod a_restarted_guard_takes_over_in_flight;
mod a_slalom_with_a_noisy_lidar_is_never_braked;
mod common;
mod damaged_samples_never_pass;
mod nothing_is_allocated_after_new;
mod the_guard_brakes_in_time;
mod the_guard_passes_only_what_fits;
mod the_reference_vectors_are_met;
mod the_ring_shows_what_stands_around;
mod the_same_inputs_give_the_same_outputs;
mod what_moves_is_braked_for;
mod what_nobody_sees_is_not_free;
