//! PX4's modes, from its heartbeat and, faster, from the path it asks for.
//!
//! HEARTBEAT reports the mode for certain but only once a second. TRAJECTORY_REPRESENTATION_WAYPOINTS comes 0.02 s
//! after a mode is entered and carries the command of the current item, from which the entry can be inferred:
//!
//! | last heartbeat | command of point 0 | taken for |
//! |---|---|---|
//! | mission or return | any | the heartbeat's mode: both fly take-off, loiter and landing items themselves |
//! | any other | take-off (22) | take-off |
//! | any other | loiter (17) | hold |
//! | any other | land (21) | land |
//! | any other | none, points 0 and 1 finite | mission: only a mission or a return flies plain waypoints, and both are planned |
//! | follow me, an automatic mode without a name here | any | the heartbeat's mode |
//!
//! The last but one row is the one that matters: without it a mission entered from hold would look like a hold whose
//! target is the raw waypoint for up to a second, and would be sent back unplanned. An inference stands until the next
//! heartbeat.

use jink_shared_types::vehicle::{
    COMMAND_LAND, COMMAND_LOITER, COMMAND_NONE, COMMAND_TAKEOFF, DesiredPoint, NavMode,
};

/// `PX4_CUSTOM_MAIN_MODE_AUTO`.
const MAIN_AUTO: u8 = 4;

/// PX4's mode as its heartbeat reports it: `custom_mode = main << 16 | sub << 24`.
pub fn nav_mode(custom_mode: u32) -> NavMode {
    let [_, _, main, sub] = custom_mode.to_le_bytes();
    match (main, sub) {
        (3, 1) => NavMode::Orbit,
        (3, _) => NavMode::Position,
        // Manual, altitude, acro, stabilized, rattitude, simple, termination: the pilot flies, or nobody does.
        (1 | 2 | 5 | 7..=10, _) => NavMode::Manual,
        (6, _) => NavMode::Offboard,
        (MAIN_AUTO, 2 | 10) => NavMode::Takeoff,
        (MAIN_AUTO, 3) => NavMode::Hold,
        (MAIN_AUTO, 4) => NavMode::Mission,
        (MAIN_AUTO, 5) => NavMode::Return,
        (MAIN_AUTO, 6 | 9) => NavMode::Land,
        (MAIN_AUTO, 8) => NavMode::Follow,
        _ => NavMode::Unknown,
    }
}

/// Whether a heartbeat with this mode says that PX4 is in some automatic mode.
pub fn is_auto(custom_mode: u32) -> bool {
    custom_mode.to_le_bytes()[2] == MAIN_AUTO
}

/// The mode in which a path with these points was asked for, given the mode of the last heartbeat (see the module's
/// table). `named` is false for an automatic mode that [`nav_mode`] has no name for.
pub fn infer(heartbeat: NavMode, named: bool, points: &[DesiredPoint; 3]) -> NavMode {
    if matches!(heartbeat, NavMode::Mission | NavMode::Return | NavMode::Follow) || !named {
        return heartbeat;
    }
    let [current, waypoint, _] = points;
    match current.command {
        COMMAND_TAKEOFF => NavMode::Takeoff,
        COMMAND_LOITER => NavMode::Hold,
        COMMAND_LAND => NavMode::Land,
        COMMAND_NONE
            if waypoint.command == COMMAND_NONE
                && waypoint.valid.is_set()
                && current.position.is_finite()
                && waypoint.position.is_finite() =>
        {
            NavMode::Mission
        }
        _ => heartbeat,
    }
}

#[cfg(test)]
mod tests {
    use super::{infer, nav_mode};
    use jink_shared_types::vehicle::{
        COMMAND_LAND, COMMAND_LOITER, COMMAND_NONE, COMMAND_TAKEOFF, DesiredPath, DesiredPoint, NavMode,
    };
    use jink_shared_types::{Coded, Flag, Point};

    fn custom(main: u32, sub: u32) -> u32 {
        main << 16 | sub << 24
    }

    fn points(command: u16) -> [DesiredPoint; 3] {
        [DesiredPoint {
            position: Point::new(30.0, 0.0, -5.0),
            command,
            valid: Flag::YES,
            ..DesiredPoint::default()
        }; 3]
    }

    #[test]
    fn the_modes_that_were_observed_are_known() {
        for (main, sub, mode) in [
            (4, 2, NavMode::Takeoff),
            (4, 3, NavMode::Hold),
            (4, 4, NavMode::Mission),
            (4, 5, NavMode::Return),
            (4, 6, NavMode::Land),
            (3, 0, NavMode::Position),
            (3, 1, NavMode::Orbit),
            (1, 0, NavMode::Manual),
            (6, 0, NavMode::Offboard),
            (4, 8, NavMode::Follow),
            (4, 11, NavMode::Unknown),
            (0, 0, NavMode::Unknown),
        ] {
            assert_eq!(nav_mode(custom(main, sub)), mode);
        }
    }

    #[test]
    fn a_mission_entered_between_two_heartbeats_is_planned_not_mirrored() {
        for before in [
            NavMode::Hold,
            NavMode::Takeoff,
            NavMode::Position,
            NavMode::Unknown,
        ] {
            let mode = infer(before, true, &points(COMMAND_NONE));
            assert_eq!(mode, NavMode::Mission);
            let path = DesiredPath {
                points: points(COMMAND_NONE),
                mode: Coded::new(mode),
                ..DesiredPath::default()
            };
            assert!(path.wants_planning());
        }
    }

    #[test]
    fn items_of_a_mission_do_not_end_it() {
        for command in [COMMAND_TAKEOFF, COMMAND_LOITER, COMMAND_LAND, COMMAND_NONE] {
            assert_eq!(infer(NavMode::Mission, true, &points(command)), NavMode::Mission);
            assert_eq!(infer(NavMode::Return, true, &points(command)), NavMode::Return);
        }
    }

    #[test]
    fn takeoff_hold_and_land_are_seen_before_the_heartbeat_reports_them() {
        let from_hold = |command| infer(NavMode::Hold, true, &points(command));
        assert_eq!(from_hold(COMMAND_TAKEOFF), NavMode::Takeoff);
        assert_eq!(from_hold(COMMAND_LAND), NavMode::Land);
        assert_eq!(
            infer(NavMode::Takeoff, true, &points(COMMAND_LOITER)),
            NavMode::Hold
        );
    }

    #[test]
    fn an_automatic_mode_without_a_name_is_not_renamed() {
        assert_eq!(
            infer(NavMode::Unknown, false, &points(COMMAND_NONE)),
            NavMode::Unknown
        );
    }
}
