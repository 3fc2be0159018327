//! What the driver of lidars promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_sensors_clock_that_is_set_is_followed;
mod a_vlp16_is_decoded_as_velodyne_decoder_does;
mod an_ouster_is_asked_for_its_metadata;
mod clouds_say_what_is_known_and_nothing_more;
mod common;
mod encoder;
mod livox_packets_are_read_as_the_protocols_say;
mod no_packet_makes_a_decoder_panic;
mod nothing_is_allocated_after_start;
mod ouster_recordings_are_decoded_as_the_makers_sdk_does;
mod recordings_of_every_kind_are_read;
mod scanners_are_set_up_and_read;
mod tables_to_copy_are_those_of_the_sets;
