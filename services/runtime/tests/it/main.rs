//! What every service relies on, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_topic_delivers_the_newest_sample_with_its_age;
mod builds_that_disagree_refuse_to_meet;
mod dead_processes_leave_nothing;
mod what_makes_no_sense_is_refused_once_for_all;
