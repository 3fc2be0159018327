//! The curve solver beside an independent one, and what it asks of the allocator.

mod cases;
mod curves_are_those_of_an_independent_solver;
mod nothing_is_allocated_after_the_first_step;
mod with_clarabel;
