//! What the gateway promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_profile_that_does_not_fit_is_never_ready;
mod a_radio_carries_little;
mod a_serial_line_carries_what_a_flight_needs;
mod a_step_allocates_nothing;
mod an_assisted_pilot_has_a_way_out;
mod ground_stations_get_their_answers;
mod harness;
mod only_our_autopilot_moves_anything;
mod position_targets_fly_what_was_approved;
mod ranges_of_others_become_scans;
mod setpoints_fly_what_was_approved;
mod support;
mod the_gateway_is_a_good_citizen_on_the_link;
mod the_mode_table_is_kept;
mod the_setpoint_stream_never_falls_silent;
mod the_vehicle_is_reported_as_the_autopilot_sees_it;
mod waypoints_fly_what_was_approved;
mod whatever_comes_in_the_laws_hold;
