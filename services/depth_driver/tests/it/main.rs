//! What the driver of depth cameras promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_camera_comes_and_goes;
mod flying_pixels_are_removed;
mod garbage_never_panics;
mod images;
mod nothing_is_allocated_after_start;
mod points_lie_where_the_camera_saw_them;
mod the_structures_are_those_of_the_kernel;
