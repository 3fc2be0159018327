use super::*;
use crate::random::Random;
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

/// All kinds of solids, overlapping, some raised, some turned.
fn jumble(seed: u64) -> World {
    let mut random = Random::new(seed, 9);
    let obstacles = (0..40)
        .map(|index| {
            let (north_m, east_m) = (random.between(-20.0, 20.0), random.between(-20.0, 20.0));
            match index % 3 {
                0 => Obstacle::Cylinder(Cylinder {
                    north_m,
                    east_m,
                    radius_m: random.between(0.1, 1.5),
                    top_m: random.between(0.5, 8.0),
                }),
                1 => {
                    let bottom_m = random.between(0.0, 3.0);
                    let top_m = bottom_m + random.between(0.2, 5.0);
                    let (length_m, width_m) = (random.between(0.1, 9.0), random.between(0.1, 3.0));
                    let yaw_rad = random.between(-PI, PI);
                    Obstacle::Box(
                        YawedBox::new(north_m, east_m, length_m, width_m, yaw_rad, top_m).raised(bottom_m),
                    )
                }
                _ => Obstacle::Sphere(Sphere {
                    north_m,
                    east_m,
                    up_m: random.between(2.0, 7.0),
                    radius_m: random.between(0.1, 1.5),
                }),
            }
        })
        .collect();
    scene(obstacles, seed)
}

fn scene(obstacles: Vec<Obstacle>, seed: u64) -> World {
    World::new(Scene {
        seed,
        goals: vec![Point::new(10.0, 0.0, -2.5)],
        bounds: Bounds {
            north_min_m: -20.0,
            north_max_m: 20.0,
            east_min_m: -20.0,
            east_max_m: 20.0,
            up_max_m: 8.0,
        },
        ..Scene::of("test", obstacles)
    })
}

/// Straight over all obstacles, without the grid.
fn cast_at_all(world: &World, origin: Point<LocalNed>, direction: &Vector3<f64>, max_m: f64) -> Option<f64> {
    let ground_m = (direction.z > 0.0).then(|| (-origin.z_m / direction.z).max(0.0));
    world
        .obstacles()
        .iter()
        .filter_map(|o| o.meets(&origin.vector(), direction))
        .map(|contact| contact.range_m)
        .chain(ground_m)
        .filter(|range_m| *range_m <= max_m)
        .min_by(f64::total_cmp)
}

/// Sphere tracing: steps by the distance field alone, so it knows none of the ray formulas.
fn march(world: &World, origin: Point<LocalNed>, direction: &Vector3<f64>, max_m: f64) -> f64 {
    let mut range_m = 0.0;
    for _ in 0..200_000 {
        let at = Point::from_vector(origin.vector() + direction * range_m);
        let free_m = world
            .clearance_to_obstacles_m(at)
            .min(world.height_above_ground_m(at));
        if free_m < 1e-9 || range_m >= max_m {
            break;
        }
        range_m += free_m;
    }
    range_m.min(max_m)
}

fn distance_to_surface_m(world: &World, at: Point<LocalNed>, what: Target) -> f64 {
    match what {
        Target::Ground => world.height_above_ground_m(at),
        Target::Obstacle(index) => world.obstacles()[index].distance_m(&at.vector()),
        Target::Structure(index) => world.structures()[index].distance_m(&at.vector()),
    }
}

fn ray(north_m: f64, east_m: f64, up_m: f64, azimuth_rad: f64, sine: f64) -> (Point<LocalNed>, Vector3<f64>) {
    let level = (1.0 - sine * sine).sqrt();
    let direction = Vector3::new(level * azimuth_rad.cos(), level * azimuth_rad.sin(), -sine);
    (Point::new(north_m, east_m, -up_m), direction)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn a_ray_ends_on_the_first_surface_it_meets(
        seed in 0..50u64, north in -30.0..30.0f64, east in -30.0..30.0f64, up in 0.01..12.0f64,
        azimuth in 0.0..TAU, sine in -1.0..1.0f64, max_m in 1.0..80.0f64,
    ) {
        let world = jumble(seed);
        let (origin, direction) = ray(north, east, up, azimuth, sine);
        let hit = world.cast(origin, &direction, max_m);
        prop_assert_eq!(hit.map(|h| h.range_m), cast_at_all(&world, origin, &direction, max_m));
        if world.clearance_to_obstacles_m(origin) <= 0.0 {
            prop_assert_eq!(hit.map(|h| h.range_m), Some(0.0));
            return Ok(());
        }
        if let Some(hit) = hit {
            let at = Point::from_vector(origin.vector() + direction * hit.range_m);
            prop_assert!(distance_to_surface_m(&world, at, hit.what).abs() < 1e-6);
            prop_assert!((0.0..=1.0 + 1e-12).contains(&hit.incidence_cos));
        }
        // At a grazing contact the distance field is nearly flat along the ray, hence the millimetre.
        let marched_m = march(&world, origin, &direction, max_m);
        prop_assert!((marched_m - hit.map_or(max_m, |h| h.range_m)).abs() < 1e-3, "{marched_m} {hit:?}");
    }

    #[test]
    fn axis_parallel_rays_are_no_exception(
        seed in 0..50u64, north in -30.0..30.0f64, east in -30.0..30.0f64, up in 0.01..12.0f64, axis in 0..6usize,
    ) {
        let world = jumble(seed);
        let direction = [
            Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z(),
        ][axis];
        // On the grid's borders too: whole metres are.
        for origin in [Point::new(north, east, -up), Point::new(north.round(), east.round(), -up)] {
            let hit = world.cast(origin, &direction, 70.0);
            prop_assert_eq!(hit.map(|h| h.range_m), cast_at_all(&world, origin, &direction, 70.0));
        }
    }

    #[test]
    fn the_distance_is_that_of_the_nearest_surface_point(
        seed in 0..50u64, north in -20.0..20.0f64, east in -20.0..20.0f64, up in 0.0..9.0f64,
        azimuth in 0.0..TAU, sine in -1.0..1.0f64, step in 0.0..5.0f64,
    ) {
        // A distance changes by no more than the way gone, and every point a distance away is still free.
        let world = jumble(seed);
        let (from, direction) = ray(north, east, up, azimuth, sine);
        let to = Point::from_vector(from.vector() + direction * step);
        let (here_m, there_m) = (world.clearance_to_obstacles_m(from), world.clearance_to_obstacles_m(to));
        prop_assert!((there_m - here_m).abs() <= step + 1e-9);
        if step < here_m {
            prop_assert!(there_m > 0.0);
        }
    }

    #[test]
    fn what_is_ignored_is_not_hit(
        seed in 0..50u64, azimuth in 0.0..TAU, sine in -0.3..0.3f64,
    ) {
        let world = jumble(seed);
        let (origin, direction) = ray(0.0, 0.0, 3.0, azimuth, sine);
        if let Some(Hit { what: Target::Obstacle(index), range_m, .. }) = world.cast(origin, &direction, 60.0) {
            let behind = world.cast_ignoring(origin, &direction, 60.0, Some(index));
            prop_assert!(behind.is_none_or(|hit| hit.range_m >= range_m && hit.what != Target::Obstacle(index)));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(36))]

    #[test]
    fn worlds_keep_their_word(kind in 0..WorldKind::ALL.len(), seed in 0..10_000u64) {
        let kind = WorldKind::ALL[kind].clone();
        let world = World::generate(kind.clone(), seed).unwrap();
        let again = World::generate(kind.clone(), seed).unwrap();
        // The corridor of the building is narrow.
        let apart_m = if kind == WorldKind::Building { 0.6 } else { 2.5 };
        prop_assert_eq!(world.obstacles(), again.obstacles());
        prop_assert_eq!(world.json(), again.json());
        prop_assert!(world.clearance_to_obstacles_m(world.start()) >= apart_m);
        for goal in world.goals() {
            prop_assert!(world.clearance_to_obstacles_m(*goal) >= apart_m);
            prop_assert_eq!(world.height_above_ground_m(*goal), world.flight_height_m());
        }
        prop_assert!(world.way(0.5).is_some());
    }
}

#[test]
fn distances_have_the_known_values() {
    let pillar = Obstacle::Cylinder(Cylinder {
        north_m: 10.0,
        east_m: 0.0,
        radius_m: 1.0,
        top_m: 5.0,
    });
    let crate_ = Obstacle::Box(YawedBox::new(0.0, 10.0, 4.0, 2.0, PI / 2.0, 3.0).raised(1.0));
    let ball = Obstacle::Sphere(Sphere {
        north_m: 0.0,
        east_m: -10.0,
        up_m: 4.0,
        radius_m: 2.0,
    });
    for (obstacle, at, expected_m) in [
        (pillar, [6.0, 0.0, -2.0], 3.0),
        (pillar, [10.0, 0.0, -7.0], 2.0),
        (pillar, [6.0, 0.0, -9.0], 5.0),
        (pillar, [10.0, 0.5, -2.0], -0.5),
        (crate_, [0.0, 6.0, -2.0], 2.0),
        (crate_, [4.0, 10.0, -2.0], 3.0),
        (crate_, [0.0, 10.0, 0.0], 1.0),
        (crate_, [4.0, 16.0, -2.0], 5.0),
        (crate_, [0.0, 10.0, -2.0], -1.0),
        (ball, [0.0, -10.0, -9.0], 3.0),
        (ball, [0.0, -10.0, -4.0], -2.0),
    ] {
        let distance_m = obstacle.distance_m(&Vector3::from(at));
        assert!(
            (distance_m - expected_m).abs() < 1e-12,
            "{obstacle:?} {at:?} {distance_m}"
        );
    }
    assert_eq!(pillar.thickness_m(), 2.0);
    assert_eq!(crate_.thickness_m(), 2.0);
    assert_eq!(ball.top_m(), 6.0);
}

#[test]
fn a_forest_has_its_density_its_sizes_and_its_seed() {
    let (mut trees, seeds) = (0, 200);
    for seed in 0..seeds {
        let world = World::generate(WorldKind::ALL[0].clone(), seed).unwrap();
        trees += world.obstacles().len();
        for obstacle in world.obstacles() {
            let Obstacle::Cylinder(tree) = obstacle else {
                panic!("{obstacle:?} is no tree")
            };
            assert!((0.0..60.0).contains(&tree.north_m) && (-15.0..15.0).contains(&tree.east_m));
            assert!((0.2..0.4).contains(&tree.radius_m) && tree.top_m == 6.0);
            // The clear discs are clear up to the bark.
            for goal_north_m in [0.0, 60.0] {
                assert!((tree.north_m - goal_north_m).hypot(tree.east_m) - tree.radius_m >= 2.5);
            }
        }
    }
    // 1,800 m2 at 1/25, less the two half discs of 2.5 m plus a trunk; one standard deviation of the mean is 0.6.
    let mean = trees as f64 / seeds as f64;
    let expected = (1_800.0 - PI * 2.8 * 2.8) / 25.0;
    assert!((mean - expected).abs() < 2.4, "{mean} trees, {expected} expected");
    assert_ne!(
        World::generate(WorldKind::ALL[0].clone(), 1).unwrap().obstacles(),
        World::generate(WorldKind::ALL[0].clone(), 2).unwrap().obstacles()
    );
}

#[test]
fn the_gap_is_as_wide_as_promised_and_the_rest_is_closed() {
    for seed in 0..50 {
        let world = World::generate(WorldKind::Gap, seed).unwrap();
        let open: Vec<f64> = (-15_000..15_000)
            .map(|mm| f64::from(mm) * 1e-3 + 0.0005)
            .filter(|east_m| world.clearance_to_obstacles_m(Point::new(15.0, *east_m, -2.5)) > 0.0)
            .collect();
        let (first, last) = (open[0], open[open.len() - 1]);
        assert!((last - first - 2.0).abs() < 0.003 && open.len().abs_diff(2_000) <= 2);
        assert!((0.5 * (first + last)).abs() <= 4.0);
    }
}

#[test]
fn the_corridor_leaves_more_than_two_metres_everywhere() {
    for seed in 0..16 {
        let world = World::generate(WorldKind::Corridor, seed).unwrap();
        assert!(world.obstacles().len() >= 6);
        for cm in 500..3_500 {
            let north_m = f64::from(cm) * 0.01;
            let free = (-199..200)
                .filter(|e| {
                    let at = Point::new(north_m, f64::from(*e) * 0.01, -2.5);
                    world.clearance_to_obstacles_m(at) > 0.0
                })
                .count();
            assert!(free >= 219, "{free} cm free at {north_m} m");
        }
        // Between boxes on opposite sides too: a disc of 2.2 m gets through, less what the search grid cannot
        // resolve.
        assert!(world.way(1.1 - 0.18).is_some());
    }
}

#[test]
fn the_trap_stands_across_the_straight_line_and_opens_to_the_start() {
    for seed in 0..50 {
        let world = World::generate(WorldKind::UTrap, seed).unwrap();
        let start = Point::new(0.0, 0.0, -2.5);
        let ahead = world.cast(start, &Vector3::x(), 30.0).unwrap();
        assert!((16.0..=20.0).contains(&ahead.range_m), "{ahead:?}");
        let inside = Point::new(ahead.range_m - 3.0, 0.0, -2.5);
        let sides: Vec<f64> = [Vector3::y(), -Vector3::y()]
            .iter()
            .map(|side| world.cast(inside, side, 30.0).unwrap().range_m)
            .collect();
        assert!((sides[0] + sides[1] - 8.0).abs() < 1e-9);
        let before = Point::new(ahead.range_m - 6.1, 0.0, -2.5);
        assert!(world.cast(before, &Vector3::y(), 30.0).is_none());
        let length_m: f64 = world
            .way(0.5)
            .unwrap()
            .windows(2)
            .map(|leg| (leg[1].vector() - leg[0].vector()).norm())
            .sum();
        assert!((30.2..40.0).contains(&length_m), "{length_m}");
    }
}

#[test]
fn the_way_is_short_and_keeps_its_distance() {
    for seed in 0..20 {
        let world = World::generate(WorldKind::ALL[0].clone(), seed).unwrap();
        let way = world.way(0.5).unwrap();
        let mut length_m = 0.0;
        for leg in way.windows(2) {
            let (from, to) = (leg[0].vector(), leg[1].vector());
            length_m += (to - from).norm();
            for i in 0..=100 {
                let at = Point::from_vector(from.lerp(&to, f64::from(i) / 100.0));
                // Half a cell's diagonal is what a grid cannot see.
                assert!(world.clearance_to_obstacles_m(at) > 0.5 - 0.18);
            }
        }
        assert!((60.0..66.0).contains(&length_m), "{length_m}");
    }
}

#[test]
fn an_empty_world_has_ground_only() {
    let world = World::generate(WorldKind::Empty, 3).unwrap();
    assert_eq!(world.clearance_to_obstacles_m(Point::ZERO), f64::INFINITY);
    let origin = Point::new(0.0, 0.0, -2.0);
    assert_eq!(world.cast(origin, &Vector3::x(), 1e3), None);
    let down = world.cast(origin, &Vector3::z(), 3.0).unwrap();
    assert_eq!((down.range_m, down.what), (2.0, Target::Ground));
    assert_eq!(world.cast(origin, &Vector3::z(), 1.9), None);
}

#[test]
fn the_json_is_what_a_viewer_expects() {
    let world = jumble(1);
    let json = world.json();
    let keys = |value: &Value| -> Vec<String> { value.as_object().unwrap().keys().cloned().collect() };
    let mut top = keys(&json);
    top.sort();
    assert_eq!(
        top,
        [
            "bounds",
            "boxes",
            "cylinders",
            "goals",
            "seed",
            "spheres",
            "start",
            "world"
        ]
    );
    let count: usize = ["cylinders", "boxes", "spheres"]
        .iter()
        .map(|k| json[k].as_array().unwrap().len())
        .sum();
    assert_eq!(count, world.obstacles().len());
    assert_eq!(
        json["goals"][0],
        json!({"north_m": 10.0, "east_m": 0.0, "up_m": 2.5})
    );
    assert_eq!(json["start"], json!({"north_m": 0.0, "east_m": 0.0, "up_m": 0.0}));
    for (list, expected) in [
        ("cylinders", vec!["east_m", "north_m", "radius_m", "top_m"]),
        (
            "boxes",
            vec![
                "bottom_m", "east_m", "length_m", "north_m", "top_m", "width_m", "yaw_rad",
            ],
        ),
        ("spheres", vec!["east_m", "north_m", "radius_m", "up_m"]),
    ] {
        let mut names = keys(&json[list][0]);
        names.sort();
        assert_eq!(names, expected);
    }
}

#[test]
fn wrong_requests_say_what_is_possible() {
    let error = "jungle".parse::<WorldKind>().unwrap_err();
    assert_eq!(
        error.to_string(),
        "no world is called \"jungle\"; there are forest, gap, corridor, utrap, building, empty, and files that end in .toml"
    );
    for kind in WorldKind::ALL {
        assert_eq!(kind.name().parse::<WorldKind>(), Ok(kind));
    }
    let spec = |kind, density_per_m2| WorldSpec {
        kind,
        seed: 1,
        density_per_m2,
    };
    let error = World::from_spec(&spec(WorldKind::Gap, Some(0.1))).unwrap_err();
    assert_eq!(
        error,
        WorldError::DensityWithoutTrees {
            kind: "gap".to_owned()
        }
    );
    for density_per_m2 in [0.0, -1.0, 0.5, f64::NAN] {
        let error = World::from_spec(&spec(WorldKind::ALL[0].clone(), Some(density_per_m2))).unwrap_err();
        assert!(matches!(error, WorldError::DensityOutOfRange { .. }), "{error}");
    }
    let denser = World::from_spec(&spec(WorldKind::ALL[0].clone(), Some(1.0 / 12.0))).unwrap();
    let sparser = World::from_spec(&spec(WorldKind::ALL[0].clone(), Some(1.0 / 49.0))).unwrap();
    assert!(denser.obstacles().len() > 2 * sparser.obstacles().len());
}
