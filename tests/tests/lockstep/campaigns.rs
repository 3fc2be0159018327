//! Every flight of the promises that many flights keep, each addressable by its name; `cargo test` flies some of them.
//!
//! ```text
//! cargo campaigns                                  # all
//! cargo campaigns --part 2/8                       # every eighth, from the second on
//! cargo campaigns bad_link                         # those with this in their name
//! cargo campaigns forest_flights::seed_7 --exact   # one
//! cargo campaigns --list
//! ```
//!
//! Whatever else the test harness of Rust understands (`--test-threads`, `--skip`, `--exact`) it understands, too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
// The files are those of the binary `lockstep`, whose tests use the rest of them.
#![allow(dead_code, unused_imports)]

mod a_bad_link_slows_and_never_crashes;
mod a_blocked_mission_item_is_helped_by_policy;
mod a_distance_to_keep_is_kept_by_every_motion;
mod a_forest_is_crossed_without_a_scratch;
mod a_goal_out_of_reach_is_told_and_not_circled;
mod a_mission_changed_in_flight_is_flown_as_changed;
mod a_mission_that_the_autopilot_flies_is_led_around;
mod a_narrow_place_is_left_again;
mod a_pilot_hands_over_in_motion;
mod a_pilot_is_kept_from_obstacles;
mod a_proposed_way_is_flown_when_it_is_certified;
mod a_restarted_gateway_leaves_the_plan_alone;
mod a_sensor_that_dies_in_flight_slows_and_never_crashes;
mod an_approach_ends_at_the_distance_kept;
mod an_assisted_pilot_is_kept_from_obstacles;
mod an_autopilot_whose_time_stands_still_is_followed;
mod both_representations_fly_on_both_firmwares;
mod every_cell_of_a_suite_is_flown;
mod every_set_of_sensors_finds_its_way;
mod every_way_that_the_autopilot_wants_to_fly_is_planned;
mod nothing_that_nobody_asked_for_is_flown;
mod services_are_killed_stopped_swapped_and_tuned_in_lockstep;
mod the_mission_is_flown_in_the_autopilots_stead;
mod who_walks_across_a_mission_is_let_pass;

use jink_tests::flights::Flights;
use libtest_mimic::{Arguments, Trial};
use std::collections::BTreeSet;
use std::process::ExitCode;

/// The flights of each promise, under its name.
macro_rules! campaigns {
    ($($module:ident: $($flights:ident),+;)+) => {
        [$($((concat!(stringify!($module), "::", stringify!($flights)), $module::$flights as fn() -> Flights),)+)+]
    };
}

fn main() -> ExitCode {
    let (part, arguments) = match part(std::env::args().collect()) {
        Ok(reported) => reported,
        Err(error) => {
            eprintln!("campaigns: {error}");
            return ExitCode::from(2);
        }
    };
    let arguments = Arguments::from_iter(arguments);
    let promises = campaigns! {
        a_bad_link_slows_and_never_crashes: forest_flights;
        a_blocked_mission_item_is_helped_by_policy: skip_flights, stop_flights, reported_once_and_waited_for;
        a_distance_to_keep_is_kept_by_every_motion: forest_flights;
        a_forest_is_crossed_without_a_scratch: forest_flights, trap_flights, world_flights, the_same_seed_gives_the_same_flight_to_the_bit;
        a_goal_out_of_reach_is_told_and_not_circled: closed_flights;
        a_mission_changed_in_flight_is_flown_as_changed:
            same_length_flights, other_length_flights, item_flights, chosen_flights, no_mission_any_more;
        a_mission_that_the_autopilot_flies_is_led_around: forest_flights, a_gateway_that_is_restarted_leads_on;
        a_narrow_place_is_left_again: wall_flights, at_arms_length_it_rests;
        a_pilot_hands_over_in_motion: forest_flights;
        a_pilot_is_kept_from_obstacles: forest_flights;
        a_proposed_way_is_flown_when_it_is_certified: detour_flights, tree_flights, a_speed_wished_is_not_exceeded, the_same_proposals_give_the_same_flight, a_proposer_that_stays_silent_half_way_leaves_the_rest_to_the_planner, a_way_that_leads_nowhere_ends_at_the_goal_all_the_same, a_proposer_that_is_killed_in_flight_leaves_no_gap_and_is_received_again;
        a_restarted_gateway_leaves_the_plan_alone: forest_flights;
        a_sensor_that_dies_in_flight_slows_and_never_crashes:
            one_of_two_flights, all_around_flights, without_any_flights;
        an_approach_ends_at_the_distance_kept:
            speed_flights, heading_flights, corner_flights, slide_flights, passage_flights;
        an_assisted_pilot_is_kept_from_obstacles: forest_flights, a_mode_that_the_pilot_changes_is_never_asked_for_back, what_is_steered_is_flown_and_released_sticks_hold_the_place;
        an_autopilot_whose_time_stands_still_is_followed: a_clock_that_is_slower_by_a_hundredth_leads_to_the_goal;
        both_representations_fly_on_both_firmwares: radio_flights, forest_flights;
        every_cell_of_a_suite_is_flown: cell_flights, narrow_passage_flights;
        every_set_of_sensors_finds_its_way: flights;
        every_way_that_the_autopilot_wants_to_fly_is_planned: go_to_flights, gap_aside_flights, landing_flights, circle_flights, a_return, hold_at_speed;
        nothing_that_nobody_asked_for_is_flown: hold_flights, early_flights, restart_flights, a_mission_that_begins_anew_in_auto_is_flown_once;
        services_are_killed_stopped_swapped_and_tuned_in_lockstep: kill_flights, swap_flights, a_speed_that_is_lowered_on_the_way_is_kept_from_then_on, a_flight_whose_planner_is_killed_is_the_same_to_the_bit_the_second_time, ranges_are_dated_from_sensor_to_wire;
        the_mission_is_flown_in_the_autopilots_stead: forest_flights, restart_flights, takeover_flights, whoever_chooses_the_mode_himself_gets_the_mission_flown_only_where_none_is_taken_over;
        who_walks_across_a_mission_is_let_pass: walk_flights;
    };
    let mut trials = Vec::new();
    let mut names = BTreeSet::new();
    for (promise, flights) in promises {
        for flight in flights() {
            let name = format!("{promise}::{}", flight.name);
            assert!(names.insert(name.clone()), "two flights are called {name}");
            trials.push(Trial::test(name, move || {
                flight.fly();
                Ok(())
            }));
        }
    }
    // Neighbours of a promise cost about the same: every n-th of all is a like part of each.
    let (number, of) = part;
    let mine = trials.into_iter().enumerate();
    let mine = mine.filter(|(index, _)| index % of == number - 1);
    libtest_mimic::run(&arguments, mine.map(|(_, trial)| trial).collect()).exit_code()
}

/// The part that is asked for, I of N, and the other arguments.
fn part(mut arguments: Vec<String>) -> Result<((usize, usize), Vec<String>), String> {
    let Some(at) = arguments.iter().position(|argument| argument == "--part") else {
        return Ok(((1, 1), arguments));
    };
    let reported = arguments.get(at + 1).ok_or("--part needs I/N")?.clone();
    arguments.drain(at..=at + 1);
    let numbers = reported.split_once('/').and_then(|(number, of)| {
        let numbers: (usize, usize) = (number.parse().ok()?, of.parse().ok()?);
        (1..=numbers.1).contains(&numbers.0).then_some(numbers)
    });
    let numbers = numbers.ok_or_else(|| format!("--part {reported}: expected I/N with 1 <= I <= N"))?;
    Ok((numbers, arguments))
}
