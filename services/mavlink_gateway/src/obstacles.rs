//! The guard's sector ring as OBSTACLE_DISTANCE.
//!
//! | sector | distance on the wire (cm) |
//! |---|---|
//! | not known, or the ring is stale | 65535 |
//! | obstacle | rounded down, but not below `min_distance`: nearer ones count for nothing (PX4) or vanish (ArduPilot) |
//! | nothing seen up to `max_distance` | `max_distance + 1` |
//! | nothing seen, but looked less far | as far as was looked: what lies beyond is not known to be free |
//!
//! Autopilots take every distance up to `max_distance` for an obstacle: PX4 steers and brakes for it. So the last row is for directions
//! in which the sensor really sees less far. Single sectors end sooner only because no beam happens to run level there: beams that
//! rise or fall leave the height band. A gap of one or two sectors between two that look farther is reported like them.
//!
//! `max_distance` stays the same from message to message, as stations and PX4 expect of a sensor (PX4 lets nothing clear an obstacle
//! that was reported with another `max_distance`): the reach of the farthest-seeing sector, less a twentieth, in steps
//! of half a metre.
//!
//! The message is sent in any case: to PX4 every bin that is reported "unknown" blocks motion at once, while silence
//! does so only after half a second. (To ArduPilot "unknown" is free; it stops at neither.)
//!
//! ArduPilot keeps the nearest obstacle of each eighth of the circle, and takes for the eighth ahead whatever is
//! reported of it last. To it the sectors are reported from the border of that eighth on (`angle_offset`), so that each
//! eighth is reported in one piece. It reads OBSTACLE_DISTANCE as fixed to the body whatever its `frame` says; so it
//! is, here.

use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_shared_types::ring::{SECTORS, SectorRing};
use jink_shared_types::{Reading, Timestamp};
use mavlink::dialect::{MavDistanceSensor, MavFrame, MavMessage, OBSTACLE_DISTANCE_DATA};

/// Distance of a sector that nothing is known about (cm).
const UNKNOWN_CM: u16 = u16::MAX;
/// Largest `max_distance` that leaves room for "max + 1" below "unknown" (cm).
const LONGEST_CM: u16 = u16::MAX - 2;
/// No obstacle is reported nearer than this (m): ArduPilot takes zero for "nothing there".
const LEAST_M: f32 = 0.01;
/// `min_distance` and `max_distance` while nothing is known (cm): a range that no receiver takes for nonsense.
const SILENT_RANGE_CM: [u16; 2] = [20, 1200];
/// Steps of `max_distance` (cm).
const REACH_STEP_CM: u16 = 50;
/// Sectors from the middle of the eighth ahead to its border.
const HALF_EIGHTH: usize = SECTORS / 8 / 2;
/// Width of a sector (degrees).
const SECTOR_DEG: f32 = 360.0 / SECTORS as f32;

/// The message for `ring` at `now`, to an autopilot of `make`.
pub fn message(now: Timestamp, ring: Reading<'_, SectorRing>, make: Option<AutopilotType>) -> MavMessage {
    let mut data = OBSTACLE_DISTANCE_DATA {
        time_usec: now.ns / 1000,
        distances: [UNKNOWN_CM; SECTORS],
        min_distance: SILENT_RANGE_CM[0],
        max_distance: SILENT_RANGE_CM[1],
        sensor_type: MavDistanceSensor::MAV_DISTANCE_SENSOR_UNKNOWN,
        increment: SECTOR_DEG as u8,
        increment_f: SECTOR_DEG,
        angle_offset: 0.0,
        frame: MavFrame::MAV_FRAME_BODY_FRD,
    };
    if let Some(ring) = ring.fresh() {
        data.time_usec = ring.header.capture.ns / 1000;
        fill(&mut data, &ring);
    }
    if make == Some(AutopilotType::ArduPilot) {
        data.distances.rotate_right(HALF_EIGHTH);
        data.angle_offset = -(HALF_EIGHTH as f32) * SECTOR_DEG;
    }
    MavMessage::OBSTACLE_DISTANCE(data)
}

fn fill(data: &mut OBSTACLE_DISTANCE_DATA, ring: &SectorRing) {
    let reaches_m = without_gaps(ring);
    let longest_cm = reaches_m.iter().map(|reach_m| centimetres(*reach_m)).max();
    let Some(longest_cm) = longest_cm.filter(|longest_cm| *longest_cm > 1) else {
        return; // Every sector unknown, or known no farther than it can be reported.
    };
    let steady_cm = (longest_cm - longest_cm / 20) / REACH_STEP_CM * REACH_STEP_CM;
    data.max_distance = if steady_cm > REACH_STEP_CM {
        steady_cm
    } else {
        longest_cm
    };
    data.min_distance = centimetres(ring.range_min_m.max(LEAST_M)).min(data.max_distance - 1);
    let sectors = ring.distance_m.iter().zip(&ring.range_max_m).zip(&reaches_m);
    for (slot, ((distance_m, own_reach_m), reach_m)) in data.distances.iter_mut().zip(sectors) {
        let is_obstacle = *distance_m < *own_reach_m;
        let reported_cm = centimetres(if is_obstacle { *distance_m } else { *reach_m });
        *slot = if distance_m.is_nan() {
            UNKNOWN_CM
        } else if reported_cm > data.max_distance || !is_obstacle && reported_cm == data.max_distance {
            data.max_distance + 1
        } else if is_obstacle {
            reported_cm.max(data.min_distance)
        } else {
            reported_cm
        };
    }
}

/// How far each sector looks (m), zero for unknown ones; gaps of one or two sectors as their neighbours on both sides look.
fn without_gaps(ring: &SectorRing) -> [f32; SECTORS] {
    let known = |sector: usize| {
        let [distance_m, reach_m] = [ring.distance_m[sector], ring.range_max_m[sector]];
        if distance_m.is_nan() { 0.0 } else { reach_m }
    };
    let around = |sector: usize, steps: usize| (sector + steps) % SECTORS;
    let has_obstacle = |sector: usize| ring.distance_m[sector] < ring.range_max_m[sector];
    // What is free up to an obstacle says nothing of what lies behind it.
    let free = |sector: usize| known(sector).min(ring.distance_m[sector]);
    // From the neighbour on this side, or the one after that if the neighbour is part of the gap.
    let beside = |near: usize, far: usize| match has_obstacle(near) {
        true => [free(near); 2],
        false => [free(near), free(far)],
    };
    std::array::from_fn(|sector| {
        let own_m = known(sector);
        if own_m <= 0.0 {
            return 0.0;
        }
        let left = beside(around(sector, SECTORS - 1), around(sector, SECTORS - 2));
        let right = beside(around(sector, 1), around(sector, 2));
        let pairs = [(left[0], right[0]), (left[1], right[0]), (left[0], right[1])];
        pairs
            .into_iter()
            .map(|(left_m, right_m)| left_m.min(right_m))
            .fold(own_m, f32::max)
    })
}

/// Rounded down, within what the message can say; NaN becomes 0.
fn centimetres(metres: f32) -> u16 {
    (metres * 100.0).clamp(0.0, f32::from(LONGEST_CM)) as u16
}

#[cfg(test)]
mod tests {
    use super::{UNKNOWN_CM, message};
    use jink_mavlink_link::autopilot_type::AutopilotType;
    use jink_shared_types::ring::{SECTORS, SectorRing};
    use jink_shared_types::{Reading, SampleHeader, Stamped, Timestamp};
    use mavlink::dialect::{MavFrame, MavMessage, OBSTACLE_DISTANCE_DATA};
    use proptest::prelude::*;

    fn sent_to(make: AutopilotType, ring: &SectorRing) -> OBSTACLE_DISTANCE_DATA {
        let header = SampleHeader::at(Timestamp::from_seconds(3.0));
        let reading = Reading::Fresh(Stamped {
            sample: ring,
            header: &header,
        });
        match message(Timestamp::from_seconds(3.1), reading, Some(make)) {
            MavMessage::OBSTACLE_DISTANCE(data) => data,
            other => panic!("{other:?}"),
        }
    }

    fn sent(ring: &SectorRing) -> OBSTACLE_DISTANCE_DATA {
        sent_to(AutopilotType::Px4, ring)
    }

    fn ring(reach_m: f32) -> SectorRing {
        SectorRing {
            distance_m: [f32::INFINITY; SECTORS],
            range_max_m: [reach_m; SECTORS],
            range_min_m: 0.2,
            ..SectorRing::default()
        }
    }

    #[test]
    fn obstacles_free_and_unknown_sectors_look_different() {
        let mut ring = ring(15.0);
        ring.distance_m[0] = 3.456;
        ring.distance_m[1] = f32::NAN;
        let data = sent(&ring);
        assert_eq!(data.distances[..3], [345, 65535, 1401]);
        assert_eq!((data.min_distance, data.max_distance), (20, 1400));
        assert_eq!(
            (data.increment, data.increment_f, data.angle_offset),
            (5, 5.0, 0.0)
        );
        assert_eq!(data.frame, MavFrame::MAV_FRAME_BODY_FRD);
        assert_eq!(data.time_usec, 3_000_000);
    }

    #[test]
    fn directions_that_look_less_far_promise_no_more_than_they_see() {
        let mut ring = ring(15.0);
        ring.range_max_m[7..10].fill(4.0);
        assert_eq!(sent(&ring).distances[6..11], [1401, 400, 400, 400, 1401]);
    }

    #[test]
    fn open_space_with_uneven_beams_holds_no_obstacle() {
        let mut ring = ring(12.0);
        for (sector, reach_m) in [
            (0, 11.99),
            (5, 4.2),
            (20, 7.0),
            (21, 11.0),
            (30, 5.0),
            (31, 6.0),
            (71, 4.0),
        ] {
            ring.range_max_m[sector] = reach_m;
        }
        let data = sent(&ring);
        assert_eq!(data.max_distance, 1100);
        assert_eq!(data.distances, [1101; SECTORS]);
    }

    #[test]
    fn a_gap_beside_an_obstacle_is_free_only_as_far_as_the_obstacle() {
        let mut ring = ring(12.0);
        ring.distance_m[10] = 6.0;
        ring.range_max_m[11] = 4.0;
        assert_eq!(sent(&ring).distances[9..13], [1101, 600, 600, 1101]);
    }

    #[test]
    fn the_reach_reported_stays_while_the_ring_wavers() {
        let reported = |reach_m| sent(&ring(reach_m)).max_distance;
        assert_eq!([11.95, 11.99, 12.0, 12.05].map(reported), [1100; 4]);
    }

    #[test]
    fn an_obstacle_nearer_than_the_sensor_sees_is_reported_as_near_as_can_be() {
        let mut ring = ring(15.0);
        ring.distance_m[0] = 0.05;
        ring.distance_m[1] = 0.0;
        assert_eq!(sent(&ring).distances[..2], [20, 20]);
        ring.range_min_m = 0.0;
        assert_eq!(sent(&ring).distances[..2], [5, 1]);
    }

    #[test]
    fn to_ardupilot_each_eighth_is_reported_in_one_piece() {
        let mut ring = ring(15.0);
        for sector in 0..SECTORS {
            ring.distance_m[sector] = 1.0 + sector as f32 * 0.1;
        }
        let data = sent_to(AutopilotType::ArduPilot, &ring);
        let eighth = |degrees: f32| ((degrees + 22.5).rem_euclid(360.0) / 45.0) as usize;
        let degrees = |element: usize| data.angle_offset + element as f32 * data.increment_f;
        for element in 0..SECTORS {
            assert_eq!(eighth(degrees(element)), element / 9, "{element}");
            let sector = (degrees(element) / 5.0).rem_euclid(SECTORS as f32).round() as usize % SECTORS;
            let expected_cm = 100.0 + sector as f32 * 10.0;
            assert!(
                (f32::from(data.distances[element]) - expected_cm).abs() <= 1.0,
                "{element}"
            );
        }
    }

    #[test]
    fn a_ring_that_knows_millimetres_knows_nothing() {
        let reported = sent(&ring(0.004));
        assert!(reported.distances.iter().all(|cm| *cm == UNKNOWN_CM));
        for reach_m in [0.0, 0.004, 0.02, 0.1, 0.3, 0.6] {
            let reported = sent(&ring(reach_m));
            assert!(
                0 < reported.min_distance && reported.min_distance < reported.max_distance,
                "{reach_m}"
            );
        }
    }

    #[test]
    fn a_stale_ring_is_sent_as_unknown() {
        for reading in [Reading::Stale { age_s: 0.4 }, Reading::Never] {
            let reported = message(Timestamp::from_seconds(3.1), reading, None);
            let MavMessage::OBSTACLE_DISTANCE(data) = reported else {
                panic!("another message");
            };
            assert_eq!(data.distances, [65535; SECTORS]);
        }
    }

    proptest! {
        #[test]
        fn no_sector_is_ever_reported_farther_than_it_or_both_beside_it_were_seen(
            distances in proptest::collection::vec(any::<f32>(), SECTORS),
            reaches in proptest::collection::vec(any::<f32>(), SECTORS),
        ) {
            let mut ring = ring(1.0);
            ring.distance_m.copy_from_slice(&distances);
            ring.range_max_m.copy_from_slice(&reaches);
            let data = sent(&ring);
            let least_m = f64::from(data.min_distance) / 100.0;
            let seen_m = |sector: usize| f64::from(distances[sector].min(reaches[sector]).max(0.0));
            for i in 0..SECTORS {
                let reported_m = f64::from(data.distances[i].min(data.max_distance)) / 100.0;
                if distances[i].is_nan() {
                    prop_assert_eq!(data.distances[i], 65535);
                } else if distances[i] < reaches[i] {
                    prop_assert!(reported_m <= f64::from(distances[i].max(0.0)).max(least_m) + 1e-3);
                    prop_assert!(reported_m >= least_m);
                } else {
                    let sides = [[1, 1], [2, 1], [1, 2]];
                    let beside = sides.map(|[left, right]| {
                        seen_m((i + SECTORS - left) % SECTORS).min(seen_m((i + right) % SECTORS))
                    });
                    let farthest_m = beside.into_iter().fold(f64::from(reaches[i].max(0.0)), f64::max);
                    prop_assert!(reported_m <= farthest_m + 1e-3);
                }
            }
        }
    }
}
