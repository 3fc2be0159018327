//! Searches in maps with trees and walls, and the memory behind their cells.

use super::window::{cell_at, index_of};
use super::{PathEnd, Search, SearchQuery};
use crate::configuration_space::tests::{known_map, space_of};
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

#[test]
fn a_start_inside_an_obstacle_has_no_path() {
    let space = space_of(&known_map(|p| p.norm() < 0.5));
    assert!(Search::default().run(&space, &query(0, [40, 0, 0])).is_none());
}
