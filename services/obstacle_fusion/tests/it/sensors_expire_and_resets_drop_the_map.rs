//! A silent, blind or covered sensor does not count as one, and a reset of the estimator leaves nothing of the map.

use crate::world;
use crate::world::{Lidar, VehicleMotion, WorldShape, at, header};
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_shared_types::map::LocalMap;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::{PointCloud, RangeScan, RayKind};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Flag, Timestamp};
use nalgebra::Vector3;

const GROUND: [WorldShape; 1] = [WorldShape::Ground { down_m: 0.0 }];

fn resting() -> VehicleMotion {
    VehicleMotion::still(Vector3::new(0.0, 0.0, -2.0))
}

fn cloud() -> Box<PointCloud> {
    let mut cloud = PointCloud::boxed();
    let lidar = Lidar {
        rays: 2_000,
        ..Lidar::default()
    };
    lidar.sweep(&GROUND, |_| resting(), 0.0, 0, &mut cloud);
    cloud
}

fn beam(range_m: f32) -> RangeScan {
    let mut scan = RangeScan {
        beams: 1,
        range_min_m: 0.1,
        range_max_m: 10.0,
        first_beam: at(0.0),
        ..RangeScan::default()
    };
    scan.range_m[0] = range_m;
    scan
}

/// A map maker for `sensors` sensors with states at 50 Hz from 0 to 1 s.
fn fusion(sensors: usize) -> Fusion {
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), sensors));
    for i in 0..=50 {
        let t_s = f64::from(i) * 0.02;
        fusion.vehicle(&resting().state(), &header(t_s));
    }
    fusion
}

fn written(fusion: &Fusion, now: Timestamp) -> Box<LocalMap> {
    let mut map = LocalMap::boxed();
    fusion.write(now, &mut map);
    map
}

#[test]
fn a_lidar_is_live_for_its_deadline() {
    let mut fusion = fusion(2);
    assert!(!written(&fusion, at(0.0)).ranges_fresh.is_set());
    fusion.cloud(1, &cloud(), &header(0.0));
    for (age_s, live) in [(0.0, 1), (0.25, 1), (0.26, 0)] {
        let map = written(&fusion, at(age_s));
        assert_eq!(map.live_sensors, live);
        assert_eq!(map.ranges_fresh.is_set(), live == 1);
        assert!(map.known_cells > 0, "the map itself stays");
    }
}

#[test]
fn a_lone_altimeter_does_not_vouch_for_a_silent_lidar() {
    let mut both = fusion(2);
    both.scan(0, &beam(2.0), &header(0.0));
    let map = written(&both, at(0.1));
    assert_eq!((map.live_sensors, map.ranges_fresh), (1, Flag::NO));

    let mut only = fusion(1);
    only.scan(0, &beam(2.0), &header(0.0));
    let map = written(&only, at(0.1));
    assert_eq!((map.live_sensors, map.ranges_fresh), (1, Flag::YES));
}

#[test]
fn a_sensor_that_says_nothing_sends_but_is_not_live() {
    let mut blind = cloud();
    blind
        .points
        .iter_mut()
        .for_each(|point| point.kind = RayKind::Unknown.into());
    let mut covered = cloud();
    covered.points.iter_mut().for_each(|point| {
        point.kind = RayKind::Hit.into();
        (point.forward_m, point.right_m, point.down_m) = (0.2, 0.0, 0.0);
    });
    let mut impossible = cloud();
    impossible.points.iter_mut().for_each(|point| {
        point.kind = RayKind::Hit.into();
        point.forward_m = 1_000.0;
    });
    for cloud in [blind, covered, impossible] {
        let mut fusion = fusion(1);
        fusion.cloud(0, &cloud, &header(0.0));
        let map = written(&fusion, at(0.0));
        assert_eq!(
            (map.live_sensors, map.ranges_fresh, map.occupied_cells),
            (0, Flag::NO, 0)
        );
        assert_eq!(map.sending_sensors.get(), Some(1));
        assert_eq!(
            written(&fusion, at(0.26)).sending_sensors.get(),
            None,
            "it is silent"
        );
    }
    let mut fusion = fusion(1);
    fusion.scan(0, &beam(f32::NAN), &header(0.0));
    assert_eq!(written(&fusion, at(0.0)).live_sensors, 0);
}

#[test]
fn a_frame_that_comes_twice_counts_once() {
    let mut fusion = fusion(1);
    fusion.cloud(0, &cloud(), &header(0.0));
    let before = written(&fusion, at(0.0));
    fusion.cloud(0, &cloud(), &header(0.0));
    fusion.cloud(7, &cloud(), &header(0.0));
    assert_eq!(fusion.counters().frames_refused, 2);
    assert!(before.known == written(&fusion, at(0.0)).known);
}

#[test]
fn a_reset_of_the_estimator_drops_map_poses_and_contributions() {
    let mut fusion = fusion(1);
    fusion.cloud(0, &cloud(), &header(0.5));
    let before = written(&fusion, at(0.5));
    assert!(before.known_cells > 0 && before.epoch == 0);

    let shifted = VehicleState {
        estimator_resets: 1,
        ..resting().state()
    };
    fusion.vehicle(&shifted, &header(1.02));
    let after = written(&fusion, at(0.6));
    assert_eq!((after.known_cells, after.occupied_cells, after.epoch), (0, 0, 1));
    assert_eq!((after.live_sensors, after.ranges_fresh), (0, Flag::NO));

    fusion.cloud(0, &cloud(), &header(0.6));
    assert_eq!(
        written(&fusion, at(0.6)).known_cells,
        0,
        "poses from before the reset are gone, too"
    );
    let mut now = cloud();
    now.first_point = at(1.02);
    fusion.cloud(0, &now, &header(1.03));
    assert!(written(&fusion, at(1.03)).known_cells > 0);
}

#[test]
fn a_reset_counts_even_if_the_position_is_not_valid_yet() {
    let mut fusion = fusion(1);
    fusion.cloud(0, &cloud(), &header(0.0));
    let sick = VehicleState {
        estimator_resets: 1,
        position_valid: Flag::NO,
        ..resting().state()
    };
    fusion.vehicle(&sick, &header(1.02));
    let map = written(&fusion, at(1.02));
    assert_eq!((map.known_cells, map.epoch), (0, 1));
    assert_eq!(fusion.counters().states_refused, 1);
}

#[test]
fn a_state_that_comes_late_is_refused_and_a_wrong_clock_is_forgotten() {
    let mut fusion = fusion(1);
    fusion.vehicle(&resting().state(), &header(0.5));
    assert_eq!(fusion.counters().states_refused, 1);
    fusion.vehicle(&resting().state(), &header(5_000.0));
    fusion.vehicle(&resting().state(), &header(1.02));
    let mut now = cloud();
    now.first_point = at(1.05);
    fusion.cloud(0, &now, &header(1.05));
    assert!(
        written(&fusion, at(1.05)).ranges_fresh.is_set(),
        "one wrong time does not blind the map"
    );
}

#[test]
fn the_first_epoch_is_the_callers() {
    let config = FusionConfig {
        first_epoch: 7,
        ..FusionConfig::from_params(&ParamSet::default(), 1)
    };
    assert_eq!(written(&Fusion::new(config), at(0.0)).epoch, 7);
}

/// The map of a cloud at 0.5 s, and of a state 20 ms after the last one whose position has moved by `jump_m`.
fn reset_by(jump_m: Vector3<f64>, yaw_rad: f64, at_s: f64) -> (Fusion, Box<LocalMap>, Box<LocalMap>) {
    let mut fusion = fusion(1);
    fusion.cloud(0, &cloud(), &header(0.5));
    let before = written(&fusion, at(0.5));
    let moved = VehicleMotion {
        attitude: nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad),
        ..VehicleMotion::still(resting().position_m + jump_m)
    };
    let state = VehicleState {
        estimator_resets: 1,
        ..moved.state()
    };
    fusion.vehicle(&state, &header(at_s));
    let after = written(&fusion, at(0.6));
    (fusion, before, after)
}

#[test]
fn a_known_jump_moves_the_map_as_if_it_had_been_built_there() {
    let jump_m = Vector3::new(3.0, -1.6, 0.4);
    let (mut moved, before, after) = reset_by(jump_m, 0.0, 1.02);
    assert_eq!((after.epoch, after.known_cells), (0, before.known_cells));
    assert_eq!(after.occupied_cells, before.occupied_cells);
    assert!(after.ranges_fresh.is_set(), "the sensors go on");
    let jump_cells = [15, -8, 2];
    for cell in world::cells(&before) {
        let there = [0, 1, 2].map(|axis| cell[axis] + jump_cells[axis]);
        assert_eq!(before.is_occupied(cell), after.is_occupied(there), "{cell:?}");
        assert_eq!(before.is_free(cell), after.is_free(there), "{cell:?}");
    }
    // A cloud from before the reset still finds its poses, in the new frame.
    let mut late = cloud();
    late.first_point = at(0.9);
    moved.cloud(0, &late, &header(0.9));
    let map = written(&moved, at(1.02));
    let added = map.known_cells.abs_diff(after.known_cells);
    assert!(
        moved.counters().rays_without_pose == 0 && added < after.known_cells / 5,
        "{added}"
    );
}

#[test]
fn after_a_jump_by_parts_of_cells_nothing_is_free_that_was_not_and_no_obstacle_is_lost() {
    let (_, before, after) = reset_by(Vector3::new(0.67, 0.33, 0.08), 0.0, 1.02);
    assert_eq!(after.epoch, 0);
    assert!(after.known_cells > before.known_cells / 20 && after.occupied_cells >= before.occupied_cells);
    // 3 cells and 7 cm, 2 cells less 7 cm, 8 cm.
    for cell in world::cells(&after) {
        let old = |corner: usize| {
            let reach = [1, -1, 1];
            let cells = [3, 2, 0];
            [0, 1, 2]
                .map(|axis| cell[axis] - cells[axis] - if corner >> axis & 1 == 1 { reach[axis] } else { 0 })
        };
        if after.is_free(cell) {
            assert!((0..8).all(|corner| before.is_free(old(corner))), "{cell:?}");
        }
        if (0..8).any(|corner| before.is_occupied(old(corner))) {
            assert!(after.is_occupied(cell), "{cell:?}");
        }
    }
}

#[test]
fn a_reset_with_a_turn_or_after_a_gap_drops_the_map() {
    let jump_m = Vector3::new(3.0, 0.0, 0.0);
    for (yaw_rad, at_s) in [(0.1, 1.02), (0.0, 1.2)] {
        let (_, before, after) = reset_by(jump_m, yaw_rad, at_s);
        assert!(before.known_cells > 0);
        assert_eq!((after.known_cells, after.epoch), (0, 1), "{yaw_rad} {at_s}");
    }
}
