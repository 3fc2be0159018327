//! What the driver of rangefinders promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_million_frames_with_damaged_bytes;
mod a_scanning_device_is_set_up_and_read;
mod a_serial_port_comes_and_goes;
mod encoder;
mod every_format_is_read_as_its_manual_says;
mod measurements_are_dated_to_the_beginning_of_their_frame;
mod noise_never_becomes_a_reading;
mod nothing_is_allocated_after_start;
