//! Evidence over several frames: a single miss never clears a thin post, a removed obstacle is cleared, and every
//! order of hits and misses keeps a post that one frame in seven sees.

use crate::world::{Lidar, VehicleMotion, WorldShape, at, header};
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_shared_types::map::{Cell, LocalMap, cell_of};
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};
use jink_shared_types::{LocalNed, Point};
use nalgebra::Vector3;
use proptest::prelude::*;

struct TestFusion {
    fusion: Fusion,
    map: Box<LocalMap>,
    cloud: Box<PointCloud>,
    sweep: usize,
}

impl TestFusion {
    fn new() -> Self {
        let mut cloud = PointCloud::boxed();
        cloud.range_min_m = 0.1;
        cloud.range_max_m = 20.0;
        Self {
            fusion: Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1)),
            map: LocalMap::boxed(),
            cloud,
            sweep: 0,
        }
    }

    /// One frame, 100 ms after the last, of a vehicle resting 2 m above the origin.
    fn frame(&mut self, fill: impl FnOnce(&mut PointCloud, f64, usize)) -> &LocalMap {
        self.sweep += 1;
        let t_s = self.sweep as f64 * 0.1;
        self.fusion.vehicle(&resting().state(), &header(t_s));
        fill(&mut self.cloud, t_s, self.sweep);
        self.cloud.first_point = at(t_s);
        self.fusion.cloud(0, &self.cloud, &header(t_s));
        self.fusion.write(at(t_s), &mut self.map);
        &self.map
    }

    /// A frame of a single ray to 4 m ahead: a hit, or a miss with a hit at 8 m.
    fn single_ray(&mut self, hit: bool) -> &LocalMap {
        self.frame(|cloud, _, _| {
            cloud.len = 0;
            let forward_m = if hit { 4.1 } else { 8.1 };
            let kind = RayKind::Hit.into();
            assert!(cloud.push(CloudPoint {
                forward_m,
                kind,
                ..CloudPoint::default()
            }));
        })
    }
}

fn resting() -> VehicleMotion {
    VehicleMotion::still(Vector3::new(0.0, 0.0, -2.0))
}

fn post_cell() -> Cell {
    cell_of(Point::<LocalNed>::new(4.1, 0.0, -2.0))
}

#[test]
fn a_removed_post_is_cleared_after_several_frames() {
    let post = WorldShape::Post {
        north_m: 4.0,
        east_m: 0.5,
        radius_m: 0.2,
    };
    let wall = WorldShape::Block {
        center_m: Vector3::new(8.0, 0.0, -2.0),
        half_m: Vector3::new(0.3, 9.0, 9.0),
    };
    let lidar = Lidar {
        rays: 40_000,
        range_max_m: 20.0,
        ..Lidar::default()
    };
    let mut bench = TestFusion::new();
    let place: Vec<Cell> = (15..=24)
        .flat_map(|x| (-2..=6).flat_map(move |y| (-15..-5).map(move |z| [x, y, z])))
        .collect();
    let count = |map: &LocalMap| place.iter().filter(|cell| map.is_occupied(**cell)).count();
    for _ in 0..30 {
        bench.frame(|cloud, t_s, sweep| lidar.sweep(&[post, wall], |_| resting(), t_s, sweep, cloud));
    }
    assert!(count(&bench.map) >= 10);
    let mut gone = |_| {
        let map = bench.frame(|cloud, t_s, sweep| lidar.sweep(&[wall], |_| resting(), t_s, sweep, cloud));
        (
            count(map),
            place.iter().filter(|cell| map.is_free(**cell)).count(),
        )
    };
    let after_first = gone(0);
    assert!(
        after_first.0 >= 10,
        "one frame clears nothing that thirty have seen"
    );
    let last = (0..40).map(&mut gone).last();
    assert_eq!(last, Some((0, place.len())), "all of it is free again");
}

#[test]
fn a_single_miss_does_not_clear_a_thin_post() {
    for free_frames_before in [0, 30] {
        let mut bench = TestFusion::new();
        for _ in 0..free_frames_before {
            assert!(!bench.single_ray(false).is_occupied(post_cell()));
        }
        assert!(bench.single_ray(true).is_occupied(post_cell()));
        assert!(bench.single_ray(false).is_occupied(post_cell()));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_post_seen_by_one_frame_in_seven_never_disappears(gaps in prop::collection::vec(0..=6usize, 1..12)) {
        let mut bench = TestFusion::new();
        for misses in gaps {
            prop_assert!(bench.single_ray(true).is_occupied(post_cell()));
            for _ in 0..misses {
                prop_assert!(bench.single_ray(false).is_occupied(post_cell()));
            }
        }
    }
}

#[test]
fn a_false_hit_in_open_space_goes_away() {
    let mut bench = TestFusion::new();
    for _ in 0..20 {
        assert!(!bench.single_ray(false).is_occupied(post_cell()));
    }
    assert!(bench.single_ray(true).is_occupied(post_cell()));
    let frames = (1..50).find(|_| bench.single_ray(false).is_free(post_cell()));
    assert_eq!(frames, Some(7));
}

#[test]
fn hovering_beside_a_post_in_the_blind_zone_does_not_wear_it_away() {
    // Seen once from afar, then in a cell that the vehicle's sphere covers in part, inside the sensor's shortest range.
    let mut bench = TestFusion::new();
    assert!(bench.single_ray(true).is_occupied(post_cell()));
    let beside = VehicleMotion::still(Vector3::new(4.1 - 0.25, 0.1, -1.9));
    for i in 0..100 {
        let t_s = 1.0 + f64::from(i) * 0.1;
        bench.fusion.vehicle(&beside.state(), &header(t_s));
        bench.cloud.len = 0;
        bench.fusion.cloud(0, &bench.cloud, &header(t_s));
    }
    bench.fusion.write(at(20.0), &mut bench.map);
    assert!(bench.map.is_occupied(post_cell()));
    assert!(
        bench.map.is_free(cell_of(beside.state().position)),
        "where the vehicle is, is free"
    );
}

#[test]
fn the_vehicles_own_parts_are_not_obstacles() {
    let mut bench = TestFusion::new();
    let map = bench.frame(|cloud, _, _| {
        cloud.len = 0;
        for (forward_m, right_m) in [(0.25, 0.0), (0.0, -0.29), (0.1, 0.1)] {
            let kind = RayKind::Hit.into();
            assert!(cloud.push(CloudPoint {
                forward_m,
                right_m,
                kind,
                ..CloudPoint::default()
            }));
        }
    });
    assert_eq!(map.occupied_cells, 0);
    assert!(map.is_free(cell_of(resting().state().position)));
    assert_eq!(bench.fusion.counters().self_hits, 3);
    let just_outside = bench.frame(|cloud, _, _| {
        cloud.len = 0;
        let kind = RayKind::Hit.into();
        assert!(cloud.push(CloudPoint {
            forward_m: 0.31,
            kind,
            ..CloudPoint::default()
        }));
    });
    assert_eq!(
        just_outside.occupied_cells, 1,
        "a hit outside the radius wins over the body"
    );
}

/// Where nothing answers from behind it: 1.1 m ahead, half a metre up. A hit there is withdrawn after 0.8 s, two at
/// three metres.
const NEAR: Vector3<f64> = Vector3::new(1.1, 0.1, -0.5);

fn near_cell() -> Cell {
    cell_of(Point::<LocalNed>::from_vector(resting().position_m + NEAR))
}

impl TestFusion {
    /// A lidar that hits near obstacles in nearly every frame.
    fn of_lidar() -> Self {
        let mut config = FusionConfig::from_params(&ParamSet::default(), 1);
        config.declared[0].repeats_hits = true;
        Self {
            fusion: Fusion::new(config),
            ..Self::new()
        }
    }

    /// A frame whose rays pass through the near cell.
    fn looked_through(&mut self) -> &LocalMap {
        self.frame(|cloud, _, _| {
            cloud.len = 0;
            let end = (NEAR * 4.0).map(|m| m as f32);
            assert!(cloud.push(CloudPoint {
                forward_m: end.x,
                right_m: end.y,
                down_m: end.z,
                kind: RayKind::Hit.into(),
                ..CloudPoint::default()
            }));
        })
    }

    /// A frame that hits the near cell, or not, and something ahead in any case.
    fn near_hit(&mut self, hit: bool) -> &LocalMap {
        self.frame(|cloud, _, _| {
            cloud.len = 0;
            let ends = [Some(Vector3::new(8.1, 0.1, 0.0)), hit.then_some(NEAR)];
            for end in ends.into_iter().flatten() {
                let end = end.map(|m| m as f32);
                assert!(cloud.push(CloudPoint {
                    forward_m: end.x,
                    right_m: end.y,
                    down_m: end.z,
                    kind: RayKind::Hit.into(),
                    ..CloudPoint::default()
                }));
            }
        })
    }
}

#[test]
fn a_lidars_hit_near_the_vehicle_that_does_not_come_again_is_withdrawn() {
    let mut bench = TestFusion::of_lidar();
    bench.near_hit(false);
    assert!(bench.near_hit(true).is_occupied(near_cell()));
    for _ in 0..7 {
        assert!(bench.near_hit(false).is_occupied(near_cell()));
    }
    for _ in 0..3 {
        bench.near_hit(false);
    }
    assert!(!bench.map.is_occupied(near_cell()) && !bench.map.is_free(near_cell()));
    // What was free before is free again.
    let mut bench = TestFusion::of_lidar();
    assert!(bench.looked_through().is_free(near_cell()));
    assert!(bench.near_hit(true).is_occupied(near_cell()));
    for _ in 0..10 {
        bench.near_hit(false);
    }
    assert!(bench.map.is_free(near_cell()));
    // A camera loses a blank surface; a scan leaves its plane.
    let mut bench = TestFusion::new();
    bench.near_hit(true);
    for _ in 0..60 {
        assert!(bench.near_hit(false).is_occupied(near_cell()));
    }
}

#[test]
fn a_hit_that_has_come_four_times_is_not_withdrawn() {
    let mut bench = TestFusion::of_lidar();
    for _ in 0..4 {
        assert!(bench.near_hit(true).is_occupied(near_cell()));
        for _ in 0..6 {
            assert!(bench.near_hit(false).is_occupied(near_cell()));
        }
    }
    for _ in 0..60 {
        assert!(bench.near_hit(false).is_occupied(near_cell()));
    }
}

#[test]
fn a_hit_is_not_withdrawn_where_the_lidar_cannot_see_it() {
    let from_above = VehicleMotion::still(resting().position_m + Vector3::new(0.9, 0.1, -1.0));
    type Change = fn(&mut TestFusion, VehicleMotion, f64);
    let changes: [(&str, Change); 3] = [
        ("below its view", |bench, above, t_s| {
            bench.fusion.vehicle(&above.state(), &header(t_s));
        }),
        ("nearer than its shortest range", |bench, _, _| {
            bench.cloud.range_min_m = 1.2;
        }),
        ("behind something else", |bench, _, _| {
            let half = NEAR * 0.6;
            let half = half.map(|m| m as f32);
            assert!(bench.cloud.push(CloudPoint {
                forward_m: half.x,
                right_m: half.y,
                down_m: half.z,
                kind: RayKind::Hit.into(),
                ..CloudPoint::default()
            }));
        }),
    ];
    for (why, change) in changes {
        let mut bench = TestFusion::of_lidar();
        bench.near_hit(false);
        bench.near_hit(true);
        for frame in 0..60 {
            let t_s = 0.3 + 0.1 * f64::from(frame);
            bench.fusion.vehicle(&resting().state(), &header(t_s));
            bench.cloud.len = 0;
            let kind = RayKind::Hit.into();
            assert!(bench.cloud.push(CloudPoint {
                forward_m: 8.1,
                kind,
                ..CloudPoint::default()
            }));
            change(&mut bench, from_above, t_s + 0.001);
            bench.cloud.first_point = at(t_s + 0.001);
            bench.fusion.cloud(0, &bench.cloud, &header(t_s + 0.001));
        }
        bench.fusion.write(at(7.0), &mut bench.map);
        assert!(bench.map.is_occupied(near_cell()), "{why}");
    }
}
