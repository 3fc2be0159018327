//! The curve solver beside an independent one, and what it asks of the allocator.

#[path = "../common/cases.rs"]
mod cases;
#[path = "../common/with_clarabel.rs"]
mod with_clarabel;

mod curves_are_those_of_an_independent_solver;
mod nothing_is_allocated_after_the_first_step;
