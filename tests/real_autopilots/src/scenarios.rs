//! The table: what is flown, on which setups, in which world, with which expectation. In this order it is flown.

use crate::flight::{Flight, Trouble};
use crate::judge::Expectation::{self, *};
use crate::script::{assist, changes, faults, missions, modes};
use crate::setup::Setup::{self, *};

/// A row.
#[derive(Clone, Copy, Debug)]
pub struct Scenario {
    /// Its name.
    pub name: &'static str,
    /// Where it is flown.
    pub setups: &'static [Setup],
    /// World and seed.
    pub world: (&'static str, u64),
    /// What the pilot does.
    pub script: fn(&mut Flight) -> Result<(), Trouble>,
    /// What is expected.
    pub expectation: Expectation,
    /// Parameters of the autopilot besides those of the setup.
    pub parameters: &'static [(&'static str, f64)],
    /// `section.key=value` for jink besides the setup's.
    pub settings: &'static [&'static str],
    /// Wind towards north and east (m/s).
    pub wind_mps: [f64; 2],
    /// Modes may change unasked: a failsafe of the autopilot is part of the situation.
    pub allows_modes: bool,
    /// More time than the expectation's (s).
    pub extra_s: f64,
}

impl Scenario {
    const fn parameters(self, parameters: &'static [(&'static str, f64)]) -> Self {
        Self { parameters, ..self }
    }
    const fn settings(self, settings: &'static [&'static str]) -> Self {
        Self { settings, ..self }
    }
    const fn wind(self, wind_mps: [f64; 2]) -> Self {
        Self { wind_mps, ..self }
    }
    const fn failsafe(self) -> Self {
        Self {
            allows_modes: true,
            ..self
        }
    }
    /// Set up for assisted flight: PX4 does not have what is set for ArduCopter, and the other way round.
    const fn assisted(self) -> Self {
        Self {
            settings: &[
                "params.CP_DIST=1.5",
                "params.MPC_VEL_MANUAL=5",
                "params.MPC_ACC_HOR=2.5",
                "params.MPC_JERK_MAX=5",
                "params.OA_ASSIST_CH=6",
            ],
            parameters: &[("MAN_OVERRIDE_SPD", -1.0)],
            ..self
        }
    }
    const fn longer(self, extra_s: f64) -> Self {
        Self { extra_s, ..self }
    }
}

type World = (&'static str, u64);
const fn row(
    name: &'static str,
    setups: &'static [Setup],
    world: World,
    script: fn(&mut Flight) -> Result<(), Trouble>,
    expectation: Expectation,
) -> Scenario {
    Scenario {
        name,
        setups,
        world,
        script,
        expectation,
        parameters: &[],
        settings: &[],
        wind_mps: [0.0; 2],
        allows_modes: false,
        extra_s: 0.0,
    }
}

/// Every setup.
const ALL: &[Setup] = &Setup::ALL;
/// PX4 flies, jink's trajectories lead.
const TRAJECTORY: &[Setup] = &[Bezier, Waypoints];
/// One of the two: what differs between them is how a curve is sent, not what is planned.
const CURVES: &[Setup] = &[Bezier];
/// One of each profile.
const EACH: &[Setup] = &[Bezier, Offboard2021, Offboard, Guided];
/// One of each profile, and a mission of PX4's own with its setpoints corrected.
const PLANNED: &[Setup] = &[Bezier, Offboard2021, Offboard, Deviation, Guided];
/// Jink flies in the autopilot's setpoint mode.
const SETPOINTS: &[Setup] = &[Offboard2021, Offboard, Guided];
/// All PX4 that plan.
const PX4: &[Setup] = &[Bezier, Offboard2021, Offboard];
const GUIDED: &[Setup] = &[Guided];
/// What follows setpoints and is released today.
const FOLLOWERS: &[Setup] = &[Offboard, Guided];
const TODAY: &[Setup] = &[Offboard];

const F31: World = ("forest", 900_031);
const F32: World = ("forest", 900_032);
const F33: World = ("forest", 900_033);
const F34: World = ("forest", 900_034);
const GAP: World = ("gap", 900_031);
const EMPTY: World = ("empty", 1);

/// What is reported before a motion that cannot be guarded.
const HELD: &[&str] = &["unguarded", "held", "holding"];
/// What is reported when there is nothing to fly to.
const WAITS: &[&str] = &["waits for mission or go-to"];
/// What is reported about a place out of reach.
const BLOCKED: &[&str] = &["blocked", "no path", "impossible", "out of reach"];
/// So that a flight need not wait half a minute.
const SOON: &[&str] = &["params.OA_BLOCKED_T=8"];

/// Everything.
pub const TABLE: &[Scenario] = &[
    row("plain", ALL, F31, missions::plain, Goal),
    // Go-to, hold, return, land.
    row("go_to", EACH, F34, modes::go_to, ArrivesOrHolds(HELD, 10.0)),
    row(
        "go_to_in_mission",
        EACH,
        F31,
        modes::go_to_in_mission,
        ArrivesOrHolds(HELD, 10.0),
    ),
    row(
        "go_to_twice",
        EACH,
        F34,
        modes::go_to_twice,
        ArrivesOrHolds(HELD, 10.0),
    ),
    row(
        "other_position_target",
        SETPOINTS,
        F31,
        modes::other_position_target,
        ArrivesOrHolds(&[], 10.0),
    ),
    row("hold_at_speed", EACH, F31, modes::hold_at_speed, Rests),
    row("orbit", PX4, F31, modes::orbit, Holds(HELD, 10.0)),
    row("circle", GUIDED, F31, modes::circle, Holds(HELD, 10.0)),
    row("return", EACH, F31, modes::return_home, Lands).longer(80.0),
    row("return_low", CURVES, F31, modes::return_home, Lands)
        .parameters(&[("RTL_RETURN_ALT", 3.0), ("RTL_DESCEND_ALT", 3.0)])
        .longer(40.0),
    row(
        "return_to_rally",
        &[Bezier, Offboard, Guided],
        F31,
        modes::return_to_rally,
        Lands,
    )
    .longer(80.0),
    row("land_here", EACH, F31, modes::land_here, Lands),
    // The end of a mission, and items.
    row("behind_the_wall", EACH, GAP, missions::behind_the_wall, Goal).parameters(&[("NAV_ACC_RAD", 10.0)]),
    row("ends_in_the_air", EACH, GAP, missions::ends_in_the_air, Arrives)
        .parameters(&[("NAV_ACC_RAD", 10.0)]),
    row(
        "land_elsewhere",
        PLANNED,
        F33,
        missions::land_elsewhere,
        GoalOrHolds(HELD, 30.0),
    ),
    row(
        "loiter_time",
        EACH,
        F31,
        missions::loiter_time,
        GoalOrHolds(HELD, 40.0),
    ),
    row(
        "loiter_turns",
        // PX4 refuses the item itself.
        GUIDED,
        F31,
        missions::loiter_turns,
        GoalOrHolds(HELD, 40.0),
    ),
    row(
        "loiter_unlimited",
        EACH,
        F31,
        missions::loiter_unlimited,
        ArrivesOrHolds(HELD, 40.0),
    ),
    row("spline", GUIDED, F31, missions::spline, GoalOrHolds(HELD, 40.0)),
    row(
        "takeoff_elsewhere",
        EACH,
        F31,
        missions::takeoff_elsewhere,
        GoalOrHolds(HELD, 30.0),
    ),
    row("land_start", EACH, F31, missions::land_start, Goal),
    row("jump", EACH, F31, missions::jump, Goal).longer(20.0),
    // Out of reach; a PX4 that flies its mission itself counts an item within NAV_ACC_RAD as reached, and goes on.
    row(
        "inside_trunk",
        EACH,
        F34,
        missions::inside_obstacle,
        GoalOrHolds(BLOCKED, 25.0),
    )
    .settings(SOON),
    row(
        "inside_wall",
        EACH,
        GAP,
        missions::inside_obstacle,
        GoalOrHolds(BLOCKED, 25.0),
    )
    .settings(SOON),
    row(
        "below_ground",
        EACH,
        F31,
        missions::below_ground,
        Holds(BLOCKED, 25.0),
    )
    .settings(SOON),
    row(
        "above_ceiling",
        EACH,
        F31,
        missions::above_ceiling,
        GoalOrHolds(BLOCKED, 25.0),
    )
    .settings(&["params.OA_BLOCKED_T=8", "params.OA_ALT_MAX=6"]),
    // Missions changed in flight.
    row("new_mission_same_length", EACH, F31, changes::same_length, Goal),
    row("new_mission_other_length", EACH, F31, changes::other_length, Goal),
    row("mission_cleared", EACH, F31, changes::cleared, Rests),
    row("current_set", EACH, F31, changes::current_set, Goal),
    row("resumed", EACH, F31, changes::resumed, Goal),
    row("begins_anew", GUIDED, F32, changes::begins_anew, Goal).parameters(&[("MIS_RESTART", 1.0)]),
    row("second_station", EACH, F31, changes::second_station, Goal),
    // The setpoint mode.
    row(
        "setpoint_mode_on_the_ground",
        SETPOINTS,
        F31,
        modes::setpoint_mode_on_the_ground,
        StaysDown(&[], 8.0),
    ),
    row(
        "setpoint_mode_in_the_air",
        SETPOINTS,
        F31,
        modes::setpoint_mode_in_the_air,
        Holds(WAITS, 6.0),
    ),
    row(
        "mission_from_setpoint_mode",
        SETPOINTS,
        F31,
        modes::mission_from_setpoint_mode,
        Goal,
    ),
    row("guided_take_off", GUIDED, F31, modes::guided_take_off, Rests),
    row(
        "guided_take_off_with_mission",
        GUIDED,
        F31,
        modes::guided_take_off_with_mission,
        Rests,
    ),
    row(
        "guided_take_off_without_gateway",
        GUIDED,
        F31,
        modes::guided_take_off_without_gateway,
        Rests,
    ),
    row("item_home", GUIDED, EMPTY, modes::item_home, Arrives),
    row(
        "wrong_profile",
        TODAY,
        F31,
        modes::wrong_profile,
        StaysDown(&["profile"], 15.0),
    )
    .settings(&["link.profile=px4_trajectory"]),
    row(
        "wrong_profile_of_px4",
        GUIDED,
        F31,
        modes::wrong_profile,
        StaysDown(&["profile"], 15.0),
    )
    .settings(&["link.profile=px4_offboard"]),
    // A pilot who is assisted.
    row("assist_into_trees", FOLLOWERS, F31, assist::into_trees, Rests).assisted(),
    row("assist_into_trees_34", FOLLOWERS, F34, assist::into_trees, Rests).assisted(),
    row("assist_mode_changed", FOLLOWERS, F31, assist::mode_changed, Rests).assisted(),
    row(
        "assist_gateway_killed",
        FOLLOWERS,
        F31,
        assist::gateway_killed,
        Rests,
    )
    .assisted(),
    row(
        "assist_sticks_lost",
        FOLLOWERS,
        F31,
        assist::sticks_lost,
        AsTheScriptSays,
    )
    .assisted()
    .failsafe(),
    // Faults.
    row("cut_0.6", EACH, F33, faults::cut::<6>, Goal),
    row("cut_3", EACH, F33, faults::cut::<30>, Goal).failsafe(),
    row("cut_8", EACH, F33, faults::cut::<80>, Goal).failsafe(),
    row("jink_down_and_up", EACH, F33, faults::down_and_up, Goal).failsafe(),
    row(
        "autopilot_restarted",
        EACH,
        F31,
        faults::autopilot_restarted,
        Goal,
    )
    .failsafe(),
    row("killed_all", ALL, F32, faults::all_killed, Goal),
    row("killed_gateway", EACH, F34, faults::killed::<0>, Goal),
    row("killed_guard", EACH, F34, faults::killed::<1>, Goal),
    row("killed_generator", EACH, F34, faults::killed::<2>, Goal),
    row("killed_planner", EACH, F34, faults::killed::<3>, Goal),
    row("killed_fusion", EACH, F34, faults::killed::<4>, Goal),
    row("killed_sensors", EACH, F34, faults::killed::<5>, Goal),
    // Worlds, speeds, wind.
    row("gap", ALL, ("gap", 900_041), missions::plain, Goal),
    row("corridor", ALL, ("corridor", 900_031), missions::plain, Goal),
    row("utrap", ALL, ("utrap", 900_031), missions::plain, Goal),
    row("speed_2", EACH, F33, missions::plain, Goal).settings(&["params.OA_SPD_MAX=2"]),
    row("speed_5", EACH, F33, missions::plain, Goal).settings(&["params.OA_SPD_MAX=5"]),
    row("speed_8", EACH, F33, missions::plain, Goal).settings(&["params.OA_SPD_MAX=8"]),
    row("wind", &[Offboard, Guided], F33, missions::plain, Goal).wind([3.0, 3.0]),
    // Seeds; the waypoints' own row of everything that differs there is among them.
    row("seed_32", EACH, F32, missions::plain, Goal),
    row("seed_33", EACH, F33, missions::plain, Goal),
    row("seed_34", ALL, F34, missions::plain, Goal),
    row("seed_35", EACH, ("forest", 900_035), missions::plain, Goal),
    row("seed_36", EACH, ("forest", 900_036), missions::plain, Goal),
    row("seed_41", EACH, ("forest", 900_041), missions::plain, Goal),
    row("seed_42", EACH, ("forest", 900_042), missions::plain, Goal),
    row("seed_43", EACH, ("forest", 900_043), missions::plain, Goal),
    row("seed_44", EACH, ("forest", 900_044), missions::plain, Goal),
    row(
        "behind_the_wall_in_waypoints",
        TRAJECTORY,
        GAP,
        missions::behind_the_wall,
        Goal,
    )
    .parameters(&[("NAV_ACC_RAD", 10.0)]),
];

/// One flight of the table.
#[derive(Clone, Copy, Debug)]
pub struct Planned {
    /// The row.
    pub scenario: &'static Scenario,
    /// On what.
    pub setup: Setup,
}

impl Planned {
    /// Autopilot, profile and flight in one word, which `--only` looks into.
    pub fn name(&self) -> String {
        format!("{}/{}", self.setup.name(), self.scenario.name)
    }
}

/// Every flight in the order of the table, those whose name holds one of `filters` (all without any).
pub fn planned(filters: &[String]) -> Vec<Planned> {
    let all = TABLE.iter().flat_map(|scenario| {
        scenario.setups.iter().map(move |setup| Planned {
            scenario,
            setup: *setup,
        })
    });
    all.filter(|planned| filters.is_empty() || filters.iter().any(|filter| matches(&planned.name(), filter)))
        .collect()
}

/// Whether all parts of `filter`, separated by commas, are in `name`; a part with `$` at its end must be the end of the name.
fn matches(name: &str, filter: &str) -> bool {
    filter.split(',').all(|part| match part.strip_suffix('$') {
        Some(end) => name.ends_with(end),
        None => name.contains(part),
    })
}

#[cfg(test)]
mod tests {
    use super::{TABLE, matches, planned};
    use std::collections::BTreeSet;

    #[test]
    fn no_two_flights_have_one_name() {
        let names: BTreeSet<String> = planned(&[]).iter().map(super::Planned::name).collect();
        assert_eq!(names.len(), planned(&[]).len());
        assert!(TABLE.len() > 60, "{}", TABLE.len());
    }

    #[test]
    fn a_filter_names_parts() {
        assert!(
            matches("ardupilot/guided/plain", "guided,plain$") && !matches("px4/offboard/plain", "guided")
        );
    }
}
