//! Searches in maps with trees and walls, and the memory behind their cells.

use super::window::{cell_at, index_of};
use super::{PathEnd, Search, SearchQuery};
use crate::configuration_space::tests::{known_map, space_of};
use jink_shared_types::far_map::{FAR_CELL_M, FarMap, set};
use jink_shared_types::frames::Point;
use jink_shared_types::map::cell_of;
use nalgebra::Vector3;
use proptest::prelude::*;

fn query(tier: usize, goal: [i32; 3]) -> SearchQuery {
    SearchQuery {
        tier,
        start: [0, 0, 0],
        goal,
        z_range: (-20, 20),
        height_cost: 0.5,
    }
}

proptest! {
    #[test]
    fn memory_and_cells_map_onto_each_other(
        min in proptest::array::uniform3(-1000..1000i32), offset in (0..128i32, 0..128i32, 0..64i32),
    ) {
        let cell = [min[0] + offset.0, min[1] + offset.1, min[2] + offset.2];
        prop_assert_eq!(cell_at(index_of(cell), min), cell);
    }
}

#[test]
fn an_open_field_is_crossed_straight() {
    let space = space_of(&known_map(|_| false));
    let mut search = Search::default();
    let found = search.run(&space, &query(0, [40, 0, 0])).unwrap();
    assert_eq!(found.end, PathEnd::Goal);
    assert_eq!(search.path().cells.len(), 41);
    assert!(
        search
            .path()
            .cells
            .iter()
            .all(|cell| cell[1] == 0 && cell[2] == 0)
    );
}

#[test]
fn a_path_keeps_clear_of_every_obstacle_and_no_step_cuts_a_corner() {
    let map = known_map(|p| (p.x - 4.0).hypot(p.y) < 0.5 || (p.x - 6.0).hypot(p.y - 2.0) < 0.5);
    let space = space_of(&map);
    let mut search = Search::default();
    let found = search.run(&space, &query(0, [50, 3, 0])).unwrap();
    assert_eq!(found.end, PathEnd::Goal);
    for pair in search.path().cells.windows(2) {
        for x in [pair[0][0], pair[1][0]] {
            for y in [pair[0][1], pair[1][1]] {
                for z in [pair[0][2], pair[1][2]] {
                    assert!(!space.is_hit(0, [x, y, z]));
                }
            }
        }
    }
}

#[test]
fn a_goal_beyond_the_window_is_approached_through_its_border() {
    let space = space_of(&known_map(|_| false));
    let mut search = Search::default();
    let found = search.run(&space, &query(0, [400, 0, 0])).unwrap();
    assert_eq!(found.end, PathEnd::Window);
    assert!(search.path().cells.last().unwrap()[0] >= 60);
}

#[test]
fn a_walled_in_goal_is_approached_as_near_as_possible() {
    let wall = known_map(|p| (p.x - 6.0).abs() < 0.3);
    let space = space_of(&wall);
    let mut search = Search::default();
    let found = search.run(&space, &query(2, [45, 0, 0])).unwrap();
    assert_eq!(found.end, PathEnd::NearestPoint);
    let end = search.path().cells.last().unwrap();
    assert!((20..28).contains(&end[0]), "{end:?}");
}

#[test]
fn a_goal_inside_an_obstacle_is_approached_without_flooding_the_map() {
    let space = space_of(&known_map(|p| (p.x - 8.1).hypot(p.y - 0.1) < 0.5));
    let mut search = Search::default();
    for tier in 0..3 {
        let found = search.run(&space, &query(tier, [40, 0, 0])).unwrap();
        assert_eq!(found.end, PathEnd::NearestPoint);
        // In a straight line up to the trunk: a path that is cheap only after expanding everything would not be
        // straight.
        let end = search.path().cells.last().unwrap();
        let reach = (0..40).filter(|x| space.is_hit(tier, [*x, 0, 0])).count() as i32;
        let off = f64::from((end[0] - 40).pow(2) + (end[1]).pow(2) + end[2].pow(2)).sqrt();
        assert!(off <= f64::from(reach) + 2.0, "{end:?}, {reach}");
        assert!(search.expansions < 2_000, "{}", search.expansions);
    }
}

#[test]
fn where_a_path_ends_short_of_its_goal_stays_the_same_while_the_map_wobbles() {
    let mut search = Search::default();
    let mut first = None;
    for noise in 0..8 {
        let angle = f64::from(noise) * 0.8;
        let (x, y) = (8.1 + 0.1 * angle.cos(), 0.1 + 0.1 * angle.sin());
        let space = space_of(&known_map(|p| (p.x - x).hypot(p.y - y) < 0.5));
        let found = search.run(&space, &query(1, [40, 0, 0])).unwrap();
        assert!(found.goal_is_occupied);
        let end = *search.path().cells.last().unwrap();
        assert_eq!(end, *first.get_or_insert(end));
    }
}

/// The walls of a house of 6 m by 6 m north of the start, of which the farthest one is left out if it is open.
fn is_wall(p: Vector3<f64>, is_open: bool) -> bool {
    let (x, y) = (p.x - 6.5, p.y);
    let side = |across: f64, along: f64| (across.abs() - 3.0).abs() < 0.3 && along.abs() < 3.3;
    side(x, y) && !(is_open && x > 0.0) || side(y, x)
}

fn far_house(is_open: bool) -> Box<FarMap> {
    let mut far = FarMap::boxed();
    far.min_cell = [-128, -128, -16];
    for x in 0..40 {
        for y in -20..20 {
            let centre = Vector3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 0.0) * FAR_CELL_M;
            if is_wall(centre, is_open) {
                (-16..16).for_each(|z| set(&mut far.occupied, [x, y, z]));
            }
        }
    }
    far
}

#[test]
fn a_goal_in_a_closed_house_is_waited_for_at_its_wall_and_one_in_an_open_house_is_reached() {
    for is_open in [false, true] {
        let space = space_of(&known_map(|p| is_wall(p, is_open)));
        let mut search = Search::default();
        let goal = Point::new(6.5, 0.1, 0.1);
        let far = far_house(is_open);
        let here = Point::new(0.1, 0.1, 0.1);
        search.detours_mut().make(&far, 1, &goal, &here, true);
        assert!(search.detour_m([0; 3]) > 2.0);
        for tier in 0..3 {
            let found = search.run(&space, &query(tier, cell_of(goal))).unwrap();
            let end = *search.path().cells.last().unwrap();
            if is_open {
                assert_eq!(found.end, PathEnd::Goal, "{tier} {end:?}");
                assert!((6.0..20.0).contains(&found.round_m), "{}", found.round_m);
            } else {
                // Round the border it would be no nearer.
                assert_eq!(found.end, PathEnd::NearestPoint, "{tier} {end:?}");
                assert!((5..18).contains(&end[0]) && end[1].abs() < 8, "{tier} {end:?}");
            }
        }
    }
}

#[test]
fn a_goal_beyond_any_map_is_no_overflow() {
    let space = space_of(&known_map(|_| false));
    let mut search = Search::default();
    let goal = Point::new(1e9, -1e9, 0.1);
    search
        .detours_mut()
        .make(&far_house(false), 1, &goal, &Point::ZERO, true);
    let found = search.run(&space, &query(0, cell_of(goal))).unwrap();
    assert_eq!(found.end, PathEnd::Window);
}

#[test]
fn a_start_inside_an_obstacle_has_no_path() {
    let space = space_of(&known_map(|p| p.norm() < 0.5));
    assert!(Search::default().run(&space, &query(0, [40, 0, 0])).is_none());
}
