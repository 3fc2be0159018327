//! Whatever bytes arrive: no panic, nothing that is not finite is approved, no damaged range opens space.
#![allow(unsafe_code, reason = "damage is made by writing bytes over samples")]

use crate::common;
use crate::common::{
    VehiclePose, World, beam, hovering_guard, look, on, points, ring, step, straight, time, view,
};
use jink_shared_types::layout::Layout;
use jink_shared_types::motion::{Trajectory, TrajectoryMode, Verdict};
use jink_shared_types::ranges::{PointCloud, RangeScan, RayKind};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Timestamp};
use proptest::prelude::*;

const NOW_S: f64 = 10.0;

/// Writes `bytes` over `sample`, from `offset` on, as far as there is room.
fn damage<T: Layout>(sample: &mut T, offset: usize, bytes: &[u8]) {
    let size = size_of::<T>();
    let offset = offset % size;
    let len = bytes.len().min(size - offset);
    // SAFETY: `Layout` promises that every bit pattern is a valid value; the range lies inside the sample.
    unsafe {
        let start = std::ptr::from_mut(sample).cast::<u8>().add(offset);
        std::slice::from_raw_parts_mut(start, len).copy_from_slice(&bytes[..len]);
    }
}

fn bytes() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        proptest::collection::vec(any::<u8>(), 1..64),
        proptest::collection::vec(any::<u8>(), 1..6_000),
        // Numbers that are none, one after the other.
        (
            1..40usize,
            prop_oneof![
                Just(f64::NAN),
                Just(f64::INFINITY),
                Just(1e300),
                Just(-1e300),
                Just(0.0)
            ]
        )
            .prop_map(|(count, value)| value.to_le_bytes().repeat(count)),
        (
            1..40usize,
            prop_oneof![
                Just(f32::NAN),
                Just(f32::INFINITY),
                Just(3e38),
                Just(-3e38),
                Just(0.0)
            ]
        )
            .prop_map(|(count, value)| value.to_le_bytes().repeat(count)),
    ]
}

fn is_finite(trajectory: &Trajectory) -> bool {
    let times = std::iter::successors(Some(0.0), |share| Some(share + 0.05)).take(21);
    trajectory.is_sound()
        && times.into_iter().all(|share| {
            let time = trajectory.start.plus_seconds(share * trajectory.duration_s());
            trajectory.at(time).is_some_and(|state| {
                state.position.is_finite() && state.velocity.is_finite() && state.acceleration.is_finite()
            })
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn a_damaged_trajectory_is_approved_only_if_it_is_sound(
        offset in any::<usize>(), bytes in bytes(), while_flying in any::<bool>(),
    ) {
        let (mut guard, ring) = hovering_guard(NOW_S);
        let first = straight(7, NOW_S, 2.0, 2.0, 10.0);
        if while_flying {
            step(&mut guard, NOW_S, Some(&first), &ring, VehiclePose::at(0.0, 0.0));
        }
        let t = NOW_S + 0.1;
        let mut candidate = first;
        (candidate.id, candidate.base_id) = (8, if while_flying { 7 } else { 0 });
        candidate.splice = time(t + 0.1);
        damage(&mut candidate, offset, &bytes);
        let (out, _) = step(&mut guard, t, Some(&candidate), &ring, VehiclePose::at(0.0, 0.0));
        if out.trajectory.mode.get() != TrajectoryMode::Mirror {
            prop_assert!(is_finite(&out.trajectory));
            let end = out.trajectory.at(out.trajectory.end().plus_seconds(1.0)).unwrap();
            prop_assert!(end.velocity.vector().norm() == 0.0);
        } else {
            prop_assert_eq!(out.trajectory.len, 0);
        }
        // And the step after that.
        step(&mut guard, t + 0.05, None, &ring, VehiclePose::at(0.0, 0.0));
    }

    #[test]
    fn a_damaged_state_neither_panics_nor_passes_anything(offset in any::<usize>(), bytes in bytes()) {
        let mut state = VehiclePose::at(0.0, 0.0).state();
        damage(&mut state, offset, &bytes);
        let mut ring = ring();
        let _ = ring.vehicle(&state, &SampleHeader::at(time(NOW_S - 0.3)));
        // Sound states heal it, though the damaged one may count as another origin.
        look(&mut ring, &World::default(), VehiclePose::at(0.0, 0.0), NOW_S);
        prop_assert!(ring.is_fresh(time(NOW_S)));
        let start = straight(7, NOW_S, 2.0, 2.0, 10.0);
        let header = SampleHeader::at(time(NOW_S));
        let inputs = jink_collision_guard::guard::GuardInputs {
            trajectory: Some(&start),
            state: jink_shared_types::Reading::Fresh(jink_shared_types::Stamped { sample: &state, header: &header }),
            ring: &ring,
            moving: jink_shared_types::Reading::Never,
        };
        let mut out = jink_shared_types::motion::ApprovedTrajectory::default();
        common::guard().step(time(NOW_S), &inputs, &mut out);
        let is_there = state.position_valid.is_set() && state.position.vector().norm() < 35.0;
        prop_assert!(out.verdict != Verdict::Passed || is_there);
    }

    #[test]
    fn a_damaged_header_neither_panics_nor_blocks_what_comes_after(
        capture in any::<u64>(), publish in any::<u64>(),
    ) {
        let mut header = SampleHeader::at(Timestamp::from_ns(capture));
        header.publish = Timestamp::from_ns(publish);
        let mut ring = ring();
        let _ = ring.vehicle(&VehiclePose::at(0.0, 0.0).state(), &header);
        let (cloud, _) = points(&[([4.0, 0.0, 0.0], RayKind::Hit)], 20.0, NOW_S);
        let _ = ring.cloud(0, &cloud, &header);
        view(&ring, NOW_S);
        // Two seconds, so that even a stamp shortly before now is overtaken.
        look(&mut ring, &World(vec![[5.0, 0.0, 0.3]]), VehiclePose::at(0.0, 0.0), NOW_S);
        look(&mut ring, &World(vec![[5.0, 0.0, 0.3]]), VehiclePose::at(0.0, 0.0), NOW_S + 2.0);
        prop_assert!((view(&ring, NOW_S + 2.0).distance_m[0] - 4.7).abs() < 0.05);
    }

    #[test]
    fn a_damaged_scan_opens_no_space_beyond_its_reach(offset in 0..200usize, bytes in bytes()) {
        let mut ring = ring();
        look(&mut ring, &World(vec![[5.0, 0.0, 0.3]]), VehiclePose::at(0.0, 0.0), NOW_S);
        let mut scan: RangeScan = beam(4.0, 0.2, 1.0);
        damage(&mut scan, offset, &bytes);
        let _ = ring.scan(1, &scan, &SampleHeader::at(time(NOW_S)));
        let seen = view(&ring, NOW_S);
        prop_assert!(seen.distance_m[0] <= 4.75, "the other sensor's obstacle stays");
        for range in seen.range_max_m {
            prop_assert!(range.is_finite() && f64::from(range) <= f64::from(scan.range_max_m).max(12.1));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_damaged_cloud_opens_no_space_beyond_its_reach(offset in 0..1_000usize, bytes in bytes()) {
        let mut ring = ring();
        look(&mut ring, &World(vec![[5.0, 0.0, 0.3]]), VehiclePose::at(0.0, 0.0), NOW_S);
        let ends: Vec<_> = (0..50).map(|i| ([3.0, 0.1 * f64::from(i), 0.0], RayKind::Hit)).collect();
        let (mut cloud, header) = points(&ends, 20.0, NOW_S);
        damage::<PointCloud>(&mut cloud, offset, &bytes);
        let _ = ring.cloud(1, &cloud, &header);
        let seen = view(&ring, NOW_S);
        prop_assert!(seen.distance_m[0] <= 4.75, "the other sensor's obstacle stays");
        for range in seen.range_max_m {
            prop_assert!(range.is_finite() && f64::from(range) <= f64::from(cloud.range_max_m).max(12.1));
        }
        for [north, east] in ring.query(time(NOW_S)).obstacles() {
            prop_assert!(north.is_finite() && east.is_finite());
        }
    }
}

#[test]
fn a_state_of_nothing_but_ones_is_refused() {
    let mut state = VehicleState::default();
    damage(&mut state, 0, &[0xff; 144]);
    assert!(ring().vehicle(&state, &SampleHeader::at(time(NOW_S))).is_err());
}

#[test]
fn a_cloud_of_nothing_but_ones_is_refused() {
    let mut ring = ring();
    let first = straight(7, NOW_S, 2.0, 2.0, 10.0);
    look(&mut ring, &World::default(), on(&first, NOW_S), NOW_S);
    let mut cloud = PointCloud::boxed();
    damage::<PointCloud>(&mut cloud, 0, &vec![0xff; size_of::<PointCloud>()]);
    assert!(ring.cloud(0, &cloud, &SampleHeader::at(time(NOW_S))).is_err());
}
