//! The configuration space of maps with posts, walls and narrow places.

use super::{Clearance, ConfigurationSpace, Meeting};
use crate::moving::PredictedCylinder;
use crate::speed_tiers::{SLOW_TIER, TIERS, speed_tiers};
use jink_shared_types::frames::Point;
use jink_shared_types::map::{LocalMap, cell_of, center_of, set};
use jink_shared_types::params::ParamSet;
use jink_shared_types::tracking::Tracking;
use nalgebra::Vector3;

/// A map whose cells are all known free except where `occupied` says so.
pub(crate) fn known_map(occupied: impl Fn(Vector3<f64>) -> bool) -> Box<LocalMap> {
    let mut map = LocalMap::boxed();
    map.min_cell = [-64, -64, -32];
    for x in -64..64 {
        for y in -64..64 {
            for z in -32..32 {
                set(&mut map.known, [x, y, z]);
                if occupied(center_of([x, y, z]).vector()) {
                    set(&mut map.occupied, [x, y, z]);
                }
            }
        }
    }
    map.ranges_fresh = true.into();
    map
}

pub(crate) fn space_of(map: &LocalMap) -> ConfigurationSpace {
    space_with(&ParamSet::default(), map)
}

fn space_with(params: &ParamSet, map: &LocalMap) -> ConfigurationSpace {
    let mut space = ConfigurationSpace::new(
        &speed_tiers(params, &Tracking::PX4_TRAJECTORY),
        Clearance::from_params(params),
    );
    space.load(map);
    (0..TIERS).for_each(|tier| space.prepare(tier));
    space
}

#[test]
fn a_post_blocks_its_surroundings_and_less_of_them_in_a_lower_tier() {
    let map = known_map(|p| (p.x - 5.0).hypot(p.y) < 0.3);
    let space = space_of(&map);
    let radius = |tier: usize| {
        (0..200)
            .map(|i| f64::from(i) * 0.02)
            .find(|d| space.is_safe(tier, cell_of(Point::new(5.0 - d, 0.1, 0.1))))
            .unwrap()
    };
    assert!(radius(2) < radius(1) && radius(1) < radius(0));
    assert!(radius(0) > 0.3 + 0.4 + 0.4);
}

#[test]
fn an_autopilot_that_follows_closely_needs_less_room() {
    let params = ParamSet::default();
    let map = known_map(|p| (p.x - 5.0).hypot(p.y) < 0.3);
    let mut space = space_of(&map);
    let at = |distance_m: f64| cell_of(Point::new(4.7 - distance_m, 0.1, 0.1));
    assert!(!space.is_safe(0, at(0.7)) && space.is_safe(0, at(1.1)));
    let standoff_m = Clearance::from_params(&params).standoff_m;
    space.fit(&speed_tiers(&params, &Tracking::PX4_OFFBOARD), standoff_m);
    space.prepare(0);
    assert!(space.is_safe(0, at(0.9)), "a tube of 0.33 instead of 0.49 m");
    assert!(!space.is_safe(0, at(0.5)));
}

#[test]
fn with_collision_prevention_a_post_is_kept_away_from_and_who_is_too_near_may_leave() {
    let map = known_map(|p| (p.x - 5.0).hypot(p.y) < 0.3);
    let mut params = ParamSet::default();
    params.set("CP_DIST", 2.0).unwrap();
    let mut space = space_with(&params, &map);
    let at = |distance_m: f64| cell_of(Point::new(4.7 - distance_m, 0.1, 0.1));
    assert!(!space.is_safe(2, at(2.0)) && space.is_hit(2, at(2.0)));
    assert!(space.is_safe(2, at(2.8)));
    space.set_departure(&center_of(at(3.0)).vector(), SLOW_TIER, false, true);
    space.prepare(2);
    assert!(!space.is_safe(2, at(2.0)));
    space.set_departure(&center_of(at(1.5)).vector(), SLOW_TIER, false, true);
    space.prepare(2);
    assert!(space.is_safe(2, at(1.5)) && !space.is_safe(2, at(0.5)));
    // Without CP_DIST there is no standoff.
    params.set("CP_DIST", -1.0).unwrap();
    space.fit(
        &speed_tiers(&params, &Tracking::PX4_TRAJECTORY),
        Clearance::from_params(&params).standoff_m,
    );
    space.set_departure(&center_of(at(3.0)).vector(), SLOW_TIER, false, true);
    space.prepare(2);
    assert!(space.is_safe(2, at(1.2)));
}

#[test]
fn who_rests_in_a_narrow_place_has_the_clearance_there_is_and_comes_no_nearer_to_the_unknown() {
    // Walls on both sides, the left one too near.
    let mut map = known_map(|p| p.y < -0.4 || (0.8..1.0).contains(&p.y));
    let here = cell_of(Point::new(0.1, 0.1, 0.1));
    let mut space = space_of(&map);
    assert!(!space.is_safe(SLOW_TIER, here));
    space.set_departure(&center_of(here).vector(), SLOW_TIER, false, true);
    assert!(!space.is_narrow(), "in motion it is left alone");
    space.set_departure(&center_of(here).vector(), SLOW_TIER, true, true);
    assert!(space.is_narrow() && space.is_safe(SLOW_TIER, here) && !space.has_clearance(SLOW_TIER, here));
    let aside = |east_m: f64| cell_of(Point::new(0.1, east_m, 0.1));
    assert!(!space.is_safe(2, aside(-0.1)), "no nearer to what is near");
    for row in 0..map.known.len() {
        // Nothing is known within x = 0.4 to 1 m.
        for x in 2..5u32 {
            map.known[row][0] &= !(1 << x);
        }
    }
    space.load(&map);
    space.set_departure(&center_of(here).vector(), SLOW_TIER, true, true);
    assert!(space.is_safe(SLOW_TIER, here) && !space.has_clearance(SLOW_TIER, here));
    let along = |north_m: f64| cell_of(Point::new(north_m, 0.1, 0.1));
    assert!(!space.is_safe(2, along(0.3)), "no nearer to the unknown either");
    assert!(space.is_safe(2, along(-0.1)), "away from it");
}

#[test]
fn who_rests_nearer_to_something_than_its_radius_may_go_away_from_it_and_no_nearer() {
    let at = |north_m: f64, east_m: f64| cell_of(Point::new(north_m, east_m, 0.1));
    let (here, there) = (at(0.1, 0.1), at(0.1, 0.5));
    // Something small beside it, and a wall before it.
    let map = known_map(|p| cell_of(Point::from_vector(p)) == there || p.x > 1.0);
    let mut space = space_of(&map);
    space.set_departure(&center_of(here).vector(), SLOW_TIER, true, true);
    assert!(space.is_narrow() && space.is_safe(SLOW_TIER, here) && !space.has_clearance(SLOW_TIER, here));
    assert!(!space.is_safe(2, at(0.1, 0.3)) && !space.is_safe(2, there));
    assert!(space.is_safe(2, at(0.1, -0.1)) && space.is_safe(2, at(-0.1, 0.1)));
    assert!(space.is_safe(2, at(0.5, 0.1)) && !space.is_safe(2, at(0.9, 0.1)));
    space.set_departure(&center_of(here).vector(), SLOW_TIER, true, false);
    assert!(!space.is_narrow(), "on its take-off");
}

#[test]
fn nothing_outside_the_window_is_safe() {
    let space = space_of(&known_map(|_| false));
    assert!(space.is_safe(0, [0, 0, 0]));
    assert!(!space.is_safe(0, [64, 0, 0]));
    assert!(!space.is_safe(0, [63, 0, 0]), "one cell from the unknown");
}

#[test]
fn what_moves_is_painted_where_it_is_met_and_leaves_nothing_behind() {
    let map = known_map(|p| (p.x - 5.0).hypot(p.y) < 0.3);
    let loaded = space_of(&map);
    let mut space = space_of(&map);
    let meeting = |north_m: f64, between_m: [f64; 2]| Meeting {
        cylinder: PredictedCylinder {
            centre_m: Vector3::new(north_m, 0.0, 0.0),
            radius_m: 0.3,
            half_height_m: 1.0,
        },
        between_m,
    };
    let here = Vector3::zeros();
    let is_safe =
        |space: &ConfigurationSpace, north_m: f64| space.is_safe_at(0, &Vector3::new(north_m, 0.1, 0.1));
    // One that is met where it is, and one that has passed by then.
    let met = [meeting(-4.0, [2.0, 6.0]), meeting(-8.0, [1.0, 3.0])];
    space.paint(&here, met.into_iter());
    assert!(!is_safe(&space, -4.0) && is_safe(&space, -8.0));
    // Painted again, in other places, and inflated again while it is.
    space.paint(&here, [meeting(-8.0, [6.0, 9.0])].into_iter());
    space.discard_tiers();
    (0..TIERS).for_each(|tier| space.prepare(tier));
    assert!(is_safe(&space, -4.0) && !is_safe(&space, -8.0));
    space.unpaint();
    for tier in 0..TIERS {
        assert!(space.ready[tier], "it need not be inflated again");
        assert_eq!(space.hit[tier], loaded.hit[tier]);
        assert_eq!(space.blocked[tier], loaded.blocked[tier]);
    }
}
