//! What the planner promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_plan_that_nobody_flies_is_made_again;
mod a_proposed_path_is_flown_only_as_far_as_it_is_certified;
mod common;
mod nothing_is_allocated_after_new;
mod nothing_is_planned_that_does_not_end_in_known_free_space;
mod what_comes_is_evaded;
mod what_the_planner_does_is_reported;
mod what_was_not_seen_yet_is_not_missing;
