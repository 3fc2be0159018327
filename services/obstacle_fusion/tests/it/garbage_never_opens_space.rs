//! Whatever a broken producer writes, nothing panics, and nothing outside of the room that the vehicle is in becomes
//! free: the vehicle rests in a closed room, so that every cell beyond its walls must stay closed.

use crate::world;
use crate::world::{Lidar, VehicleMotion, WorldShape, at, header};
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_shared_types::frames::Mounting;
use jink_shared_types::layout::Layout;
use jink_shared_types::map::{CELL_M, LocalMap, center_of};
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::{CLOUD_POINTS, PointCloud, RangeScan, RayKind, SCAN_BEAMS};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Timestamp};
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;

/// Half edge of the room (m); its walls are 2 m thick and nothing is behind them.
const ROOM_M: f64 = 3.1;

fn room() -> Vec<WorldShape> {
    let wall = |axis: usize, side: f64| {
        let mut center_m = Vector3::new(0.0, 0.0, -2.0);
        center_m[axis] += side * (ROOM_M + 1.0);
        let mut half_m = Vector3::repeat(ROOM_M + 2.0);
        half_m[axis] = 1.0;
        WorldShape::Block { center_m, half_m }
    };
    (0..3)
        .flat_map(|axis| [wall(axis, 1.0), wall(axis, -1.0)])
        .collect()
}

fn motion() -> VehicleMotion {
    VehicleMotion {
        attitude: UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7),
        ..VehicleMotion::still(Vector3::new(0.3, -0.4, -2.2))
    }
}

/// Everything one update is made of.
struct Inputs {
    state: VehicleState,
    state_header: SampleHeader,
    cloud: Box<PointCloud>,
    cloud_header: SampleHeader,
    scan: RangeScan,
    scan_header: SampleHeader,
}

fn inputs(t_s: f64) -> Inputs {
    let mut cloud = PointCloud::boxed();
    let lidar = Lidar {
        rays: 1_500,
        sweep_s: 0.05,
        range_max_m: 12.0,
        ..Lidar::default()
    };
    lidar.sweep(&room(), |_| motion(), t_s, (t_s * 10.0) as usize, &mut cloud);
    let body_q_sensor = UnitQuaternion::from_euler_angles(0.3, 0.2, 0.1);
    let mut scan = RangeScan {
        mounting: Mounting::from_rotation(body_q_sensor),
        first_beam: at(t_s - 0.036),
        beam_interval_s: 1e-3,
        angle_step_rad: 0.1745,
        beam_width_rad: 0.02,
        range_min_m: 0.2,
        range_max_m: 12.0,
        beams: 36,
        ..RangeScan::default()
    };
    let local_q_sensor = motion().attitude * body_q_sensor;
    for beam in 0..36 {
        let (sin, cos) = (beam as f64 * f64::from(scan.angle_step_rad)).sin_cos();
        let along = local_q_sensor * Vector3::new(cos, sin, 0.0);
        scan.range_m[beam] = world::cast_m(&room(), &motion().position_m, &along) as f32;
    }
    Inputs {
        state: motion().state(),
        state_header: header(t_s),
        cloud,
        cloud_header: header(t_s),
        scan,
        scan_header: header(t_s),
    }
}

type Corruption = fn(&mut Inputs, f64, usize);

/// One entry per float field; the number selects the point or beam where there are many.
const FLOATS: &[Corruption] = &[
    |i, bad, _| i.state.position.x_m = bad,
    |i, bad, _| i.state.position.z_m = bad,
    |i, bad, _| i.state.velocity.x_mps = bad,
    |i, bad, _| i.state.velocity.z_mps = bad,
    |i, bad, _| i.state.attitude.w = bad,
    |i, bad, _| i.state.attitude.y = bad,
    |i, bad, _| i.state.rates.x_radps = bad,
    |i, bad, _| i.state.rates.z_radps = bad,
    |i, bad, _| i.state.home_down_m = bad,
    |i, bad, _| i.state.ground_distance_m = bad,
    |i, bad, _| i.cloud.origin.x_m = bad,
    |i, bad, _| i.cloud.origin.z_m = bad,
    |i, bad, _| i.cloud.range_min_m = bad as f32,
    |i, bad, _| i.cloud.range_max_m = bad as f32,
    |i, bad, _| i.cloud.range_sigma_m = bad as f32,
    |i, bad, n| i.cloud.points[n % 1_500].forward_m = bad as f32,
    |i, bad, n| i.cloud.points[n % 1_500].right_m = bad as f32,
    |i, bad, n| i.cloud.points[n % 1_500].down_m = bad as f32,
    |i, bad, _| {
        for point in &mut i.cloud.points[..1_500] {
            point.forward_m = bad as f32;
        }
    },
    |i, bad, _| {
        for point in &mut i.cloud.points[..1_500] {
            point.kind = RayKind::Clear.into();
            point.down_m = bad as f32;
        }
    },
    |i, bad, _| i.scan.origin.x_m = bad,
    |i, bad, _| i.scan.origin.y_m = bad,
    |i, bad, _| i.scan.mounting.w = bad,
    |i, bad, _| i.scan.mounting.z = bad,
    |i, bad, _| i.scan.beam_interval_s = bad as f32,
    |i, bad, _| i.scan.angle_first_rad = bad as f32,
    |i, bad, _| i.scan.angle_step_rad = bad as f32,
    |i, bad, _| i.scan.beam_width_rad = bad as f32,
    |i, bad, _| i.scan.range_min_m = bad as f32,
    |i, bad, _| i.scan.range_max_m = bad as f32,
    |i, bad, _| i.scan.range_sigma_m = bad as f32,
    // Infinity is the one garbage that has a meaning here: "nothing up to the longest range".
    |i, bad, n| {
        i.scan.range_m[n % 36] = if bad as f32 == f32::INFINITY {
            f32::NAN
        } else {
            bad as f32
        }
    },
];

/// One entry per number that is no float.
const INTEGERS: &[fn(&mut Inputs, u64, usize)] = &[
    |i, bad, _| i.state_header.capture = Timestamp::from_ns(bad),
    |i, bad, _| i.state.position_time = Timestamp::from_ns(bad),
    |i, bad, _| i.state.estimator_resets = bad as u32,
    |i, bad, _| i.cloud_header.capture = Timestamp::from_ns(bad),
    |i, bad, _| i.cloud.first_point = Timestamp::from_ns(bad),
    |i, bad, _| i.cloud.len = bad as u32,
    |i, bad, _| i.cloud.len = CLOUD_POINTS as u32 + (bad as u32 & 1),
    |i, bad, n| i.cloud.points[n % 1_500].offset_10us = bad as u16,
    |i, bad, _| i.scan_header.capture = Timestamp::from_ns(bad),
    |i, bad, _| i.scan.first_beam = Timestamp::from_ns(bad),
    |i, bad, _| i.scan.beams = bad as u32,
];

fn bad_float() -> impl Strategy<Value = f64> {
    prop::sample::select(vec![
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        1e30,
        -1e30,
        f64::MAX,
        f64::MIN,
    ])
}

fn bad_integer() -> impl Strategy<Value = u64> {
    prop_oneof![
        Just(0),
        Just(1),
        Just(u64::MAX),
        Just(u64::MAX >> 1),
        Just(1 << 40),
        any::<u64>()
    ]
}

fn update(fusion: &mut Fusion, inputs: &Inputs) {
    fusion.vehicle(&inputs.state, &inputs.state_header);
    fusion.cloud(0, &inputs.cloud, &inputs.cloud_header);
    fusion.scan(1, &inputs.scan, &inputs.scan_header);
}

/// A cell that a ray has crossed has its centre within half a diagonal of the room.
const SLACK_M: f64 = 0.5 * CELL_M * 1.733;

fn free_outside_of_the_room(map: &LocalMap) -> usize {
    world::known(map)
        .filter(|cell| map.is_free(*cell))
        .filter(|cell| {
            let from_middle = center_of(*cell).vector() - Vector3::new(0.0, 0.0, -2.0);
            from_middle.amax() > ROOM_M + SLACK_M
        })
        .count()
}

fn fly(corrupt: impl Fn(&mut Inputs)) -> (Fusion, Box<LocalMap>) {
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 2));
    update(&mut fusion, &inputs(0.0));
    let mut spoilt = inputs(0.1);
    corrupt(&mut spoilt);
    update(&mut fusion, &spoilt);
    update(&mut fusion, &inputs(0.2));
    let mut map = LocalMap::boxed();
    fusion.write(at(0.2), &mut map);
    assert!(map.is_plausible(), "{map:?}");
    (fusion, map)
}

#[test]
fn the_room_itself_is_seen() {
    let (fusion, map) = fly(|_| {});
    assert_eq!(free_outside_of_the_room(&map), 0);
    assert!(map.known_cells > 10_000 && map.live_sensors == 2);
    let counters = fusion.counters();
    assert_eq!(
        (
            counters.rays_malformed,
            counters.frames_refused,
            counters.states_refused
        ),
        (0, 0, 0)
    );
}

#[test]
fn a_hole_in_the_wall_would_be_noticed() {
    let (_, map) = fly(|inputs| inputs.cloud.points[700].kind = RayKind::Clear.into());
    assert_eq!(
        free_outside_of_the_room(&map),
        0,
        "clear up to the wall is no hole"
    );
    let (_, map) = fly(|inputs| {
        let point = &mut inputs.cloud.points[700];
        (point.forward_m, point.right_m, point.down_m) =
            (point.forward_m * 2.0, point.right_m * 2.0, point.down_m * 2.0);
    });
    assert!(free_outside_of_the_room(&map) > 0, "the check can fail");
}

#[test]
fn more_points_or_beams_than_fit_are_refused_as_a_whole() {
    let (fusion, _) = fly(|inputs| inputs.cloud.len = CLOUD_POINTS as u32 + 1);
    assert_eq!(fusion.counters().frames_refused, 1);
    let (fusion, _) = fly(|inputs| inputs.scan.beams = SCAN_BEAMS as u32 + 1);
    assert_eq!(fusion.counters().frames_refused, 1);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn in_floats(which in 0..FLOATS.len(), bad in bad_float(), n in any::<usize>()) {
        let (_, map) = fly(|inputs| FLOATS[which](inputs, bad, n));
        prop_assert_eq!(free_outside_of_the_room(&map), 0);
        prop_assert!(map.ranges_fresh.is_set(), "one bad frame does not blind the map");
    }

    #[test]
    fn in_integers(which in 0..INTEGERS.len(), bad in bad_integer(), n in any::<usize>()) {
        let (_, map) = fly(|inputs| INTEGERS[which](inputs, bad, n));
        prop_assert_eq!(free_outside_of_the_room(&map), 0);
    }

    #[test]
    fn in_many_fields_at_once(
        floats in prop::collection::vec((0..FLOATS.len(), bad_float(), any::<usize>()), 0..8),
        integers in prop::collection::vec((0..INTEGERS.len(), bad_integer(), any::<usize>()), 0..4),
    ) {
        let (_, map) = fly(|inputs| {
            floats.iter().for_each(|(which, bad, n)| FLOATS[*which](inputs, *bad, *n));
            integers.iter().for_each(|(which, bad, n)| INTEGERS[*which](inputs, *bad, *n));
        });
        prop_assert_eq!(free_outside_of_the_room(&map), 0);
    }
}
