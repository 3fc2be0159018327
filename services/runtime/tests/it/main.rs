//! What every service relies on, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_process_has_the_priority_that_it_was_granted;
mod a_reader_follows_whoever_owns_the_topic;
mod a_sweep_removes_the_dead_and_nothing_else;
mod a_topic_delivers_the_newest_sample_with_its_age;
mod a_wrong_configuration_names_its_place;
mod builds_that_disagree_refuse_to_meet;
mod dead_processes_leave_nothing;
mod each_input_has_one_owner;
mod memory_is_there_before_the_flight;
mod other_users_open_nothing;
mod spectators_leave_the_services_their_places;
mod what_makes_no_sense_is_refused_once_for_all;
