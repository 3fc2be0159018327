//! The guard's sector ring as OBSTACLE_DISTANCE, and for ArduPilot as OBSTACLE_DISTANCE_3D besides.
//!
//! | sector | distance on the wire (cm) |
//! |---|---|
//! | not known, or the ring is stale | 65535 |
//! | obstacle | rounded down, but not below `min_distance`: nearer ones count for nothing (PX4) or vanish (ArduPilot) |
//! | nothing seen as far as the farthest-seeing sector looks | `max_distance + 1` |
//! | nothing seen, but this sector looks less far | as far as it looks: what lies beyond is not known to be free |
//!
//! The message is sent in any case: to PX4 every bin that is told "unknown" blocks motion at once, while silence does so only
//! after half a second. (To ArduPilot "unknown" is free; it stops at neither.)
//!
//! OBSTACLE_DISTANCE_3D carries one obstacle per message: the nearest one of each eighth of the ring, as a point in BODY_FRD at the
//! vehicle's own height, all with the same stamp, by which ArduPilot knows that they belong together. ArduPilot reads
//! OBSTACLE_DISTANCE as fixed to the body whatever its `frame` says; so it is, here.

use jink_shared_types::ring::{SECTORS, SectorRing};
use jink_shared_types::{Reading, Timestamp};
use mavlink::dialects::ardupilotmega::{
    MavDistanceSensor, MavFrame, MavMessage, OBSTACLE_DISTANCE_3D_DATA, OBSTACLE_DISTANCE_DATA,
};

/// Distance of a sector that nothing is known about (cm).
const UNKNOWN_CM: u16 = u16::MAX;
/// Largest `max_distance` that leaves room for "max + 1" below "unknown" (cm).
const LONGEST_CM: u16 = u16::MAX - 2;

/// No obstacle is told nearer than this (m): ArduPilot takes zero for "nothing there".
const LEAST_M: f32 = 0.01;
/// `min_distance` and `max_distance` while nothing is known (cm): a range that no receiver takes for nonsense.
const SILENT_RANGE_CM: [u16; 2] = [20, 1200];

/// The message for `ring` at `now`.
pub fn message(now: Timestamp, ring: Reading<'_, SectorRing>) -> MavMessage {
    let mut data = OBSTACLE_DISTANCE_DATA {
        time_usec: now.ns / 1000,
        distances: [UNKNOWN_CM; SECTORS],
        min_distance: SILENT_RANGE_CM[0],
        max_distance: SILENT_RANGE_CM[1],
        sensor_type: MavDistanceSensor::MAV_DISTANCE_SENSOR_UNKNOWN,
        increment: 5,
        increment_f: 5.0,
        angle_offset: 0.0,
        frame: MavFrame::MAV_FRAME_BODY_FRD,
    };
    if let Some(ring) = ring.fresh() {
        data.time_usec = ring.header.capture.ns / 1000;
        fill(&mut data, &ring);
    }
    MavMessage::OBSTACLE_DISTANCE(data)
}

/// Eighths of the ring: ArduPilot keeps its boundary in as many.
pub const EIGHTHS: usize = 8;

/// The nearest obstacle of each eighth, for `ring` at `now`.
pub fn points(now: Timestamp, ring: Reading<'_, SectorRing>) -> [Option<MavMessage>; EIGHTHS] {
    const SECTORS_EACH: usize = SECTORS / EIGHTHS;
    let Some(ring) = ring.fresh() else {
        return [const { None }; EIGHTHS];
    };
    std::array::from_fn(|eighth| {
        // An eighth lies around its direction: half of it to the left.
        let sectors = (0..SECTORS_EACH)
            .map(|i| (eighth * SECTORS_EACH + SECTORS - SECTORS_EACH / 2 + i) % SECTORS)
            .filter(|sector| ring.distance_m[*sector] < ring.range_max_m[*sector]);
        let nearest = sectors.min_by(|a, b| ring.distance_m[*a].total_cmp(&ring.distance_m[*b]))?;
        let reach_m = ring.range_max_m[nearest];
        let least_m = ring.range_min_m.max(LEAST_M);
        let distance_m = ring.distance_m[nearest].max(least_m);
        let angle_rad = (nearest as f32 * (360.0 / SECTORS as f32)).to_radians();
        let numbers = [reach_m, least_m, distance_m];
        numbers.iter().all(|number| number.is_finite()).then(|| {
            MavMessage::OBSTACLE_DISTANCE_3D(OBSTACLE_DISTANCE_3D_DATA {
                time_boot_ms: (now.ns / 1_000_000) as u32,
                x: distance_m * angle_rad.cos(),
                y: distance_m * angle_rad.sin(),
                z: 0.0,
                min_distance: least_m,
                max_distance: reach_m,
                obstacle_id: u16::MAX,
                sensor_type: MavDistanceSensor::MAV_DISTANCE_SENSOR_UNKNOWN,
                frame: MavFrame::MAV_FRAME_BODY_FRD,
            })
        })
    })
}

fn fill(data: &mut OBSTACLE_DISTANCE_DATA, ring: &SectorRing) {
    let sectors = || ring.distance_m.iter().zip(&ring.range_max_m);
    let reach_cm = sectors()
        .filter(|(distance_m, _)| !distance_m.is_nan())
        .map(|(_, reach_m)| centimetres(*reach_m))
        .max();
    let Some(reach_cm) = reach_cm.filter(|reach_cm| *reach_cm > 1) else {
        return; // Every sector unknown, or known no farther than it can be told.
    };
    data.max_distance = reach_cm;
    data.min_distance = centimetres(ring.range_min_m.max(LEAST_M)).min(reach_cm - 1);
    for (slot, (distance_m, reach_m)) in data.distances.iter_mut().zip(sectors()) {
        let own_reach_cm = centimetres(*reach_m);
        *slot = if distance_m.is_nan() {
            UNKNOWN_CM
        } else if *distance_m < *reach_m {
            centimetres(*distance_m).max(data.min_distance)
        } else if own_reach_cm < reach_cm {
            own_reach_cm
        } else {
            reach_cm + 1
        };
    }
}

/// Rounded down, within what the message can say; NaN becomes 0.
fn centimetres(metres: f32) -> u16 {
    (metres * 100.0).clamp(0.0, f32::from(LONGEST_CM)) as u16
}

#[cfg(test)]
mod tests {
    use super::{UNKNOWN_CM, message, points};
    use jink_shared_types::ring::{SECTORS, SectorRing};
    use jink_shared_types::{Reading, SampleHeader, Stamped, Timestamp};
    use mavlink::dialects::ardupilotmega::{
        MavFrame, MavMessage, OBSTACLE_DISTANCE_3D_DATA, OBSTACLE_DISTANCE_DATA,
    };
    use proptest::prelude::*;

    fn sent(ring: &SectorRing) -> OBSTACLE_DISTANCE_DATA {
        let header = SampleHeader::at(Timestamp::from_seconds(3.0));
        let reading = Reading::Fresh(Stamped {
            sample: ring,
            header: &header,
        });
        match message(Timestamp::from_seconds(3.1), reading) {
            MavMessage::OBSTACLE_DISTANCE(data) => data,
            other => panic!("{other:?}"),
        }
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
        assert_eq!(data.distances[..3], [345, 65535, 1501]);
        assert_eq!((data.min_distance, data.max_distance), (20, 1500));
        assert_eq!(
            (data.increment, data.increment_f, data.angle_offset),
            (5, 5.0, 0.0)
        );
        assert_eq!(data.frame, MavFrame::MAV_FRAME_BODY_FRD);
        assert_eq!(data.time_usec, 3_000_000);
    }

    #[test]
    fn a_sector_that_looks_less_far_promises_no_more_than_it_sees() {
        let mut ring = ring(15.0);
        ring.range_max_m[7] = 4.0;
        assert_eq!(sent(&ring).distances[7], 400);
    }

    #[test]
    fn an_obstacle_nearer_than_the_sensor_sees_is_told_as_near_as_can_be() {
        let mut ring = ring(15.0);
        ring.distance_m[0] = 0.05;
        ring.distance_m[1] = 0.0;
        assert_eq!(sent(&ring).distances[..2], [20, 20]);
        ring.range_min_m = 0.0;
        assert_eq!(sent(&ring).distances[..2], [5, 1]);
    }

    fn told(ring: &SectorRing) -> Vec<OBSTACLE_DISTANCE_3D_DATA> {
        let header = SampleHeader::at(Timestamp::from_seconds(3.0));
        let reading = Reading::Fresh(Stamped {
            sample: ring,
            header: &header,
        });
        let messages = points(Timestamp::from_seconds(3.1), reading)
            .into_iter()
            .flatten();
        messages
            .map(|message| match message {
                MavMessage::OBSTACLE_DISTANCE_3D(data) => data,
                other => panic!("{other:?}"),
            })
            .collect()
    }

    #[test]
    fn the_nearest_obstacle_of_each_eighth_is_told_as_a_point_in_the_body_frame() {
        let mut ring = ring(15.0);
        assert!(told(&ring).is_empty());
        ring.distance_m[18] = 4.0; // Right: 90 degrees.
        ring.distance_m[20] = 6.0; // The same eighth, farther.
        ring.distance_m[70] = 2.0; // 10 degrees to the left: the eighth ahead.
        let points = told(&ring);
        assert_eq!(points.len(), 2);
        assert!(
            points
                .iter()
                .all(|p| p.frame == MavFrame::MAV_FRAME_BODY_FRD && p.time_boot_ms == 3100)
        );
        let [ahead, right] = [&points[0], &points[1]];
        assert!((ahead.x - 2.0 * 10f32.to_radians().cos()).abs() < 1e-4 && ahead.y < 0.0);
        assert!(right.x.abs() < 1e-4 && (right.y - 4.0).abs() < 1e-4);
    }

    #[test]
    fn a_ring_that_knows_millimetres_knows_nothing() {
        let told = sent(&ring(0.004));
        assert!(told.distances.iter().all(|cm| *cm == UNKNOWN_CM));
        for reach_m in [0.0, 0.004, 0.02, 0.1, 0.3] {
            let told = sent(&ring(reach_m));
            assert!(
                0 < told.min_distance && told.min_distance < told.max_distance,
                "{reach_m}"
            );
        }
    }

    #[test]
    fn a_stale_ring_is_sent_as_unknown() {
        for reading in [Reading::Stale { age_s: 0.4 }, Reading::Never] {
            let MavMessage::OBSTACLE_DISTANCE(data) = message(Timestamp::from_seconds(3.1), reading) else {
                panic!("another message");
            };
            assert_eq!(data.distances, [65535; SECTORS]);
        }
    }

    proptest! {
        #[test]
        fn no_sector_is_ever_told_farther_than_it_was_seen(
            distances in proptest::collection::vec(any::<f32>(), SECTORS),
            reaches in proptest::collection::vec(any::<f32>(), SECTORS),
        ) {
            let mut ring = ring(1.0);
            ring.distance_m.copy_from_slice(&distances);
            ring.range_max_m.copy_from_slice(&reaches);
            for point in told(&ring) {
                prop_assert!(point.x.is_finite() && point.y.is_finite() && point.x.hypot(point.y) >= 0.009);
            }
            let data = sent(&ring);
            for i in 0..SECTORS {
                let told_m = f64::from(data.distances[i]) / 100.0;
                if distances[i].is_nan() {
                    prop_assert_eq!(data.distances[i], 65535);
                } else if data.distances[i] != data.max_distance + 1 {
                    let least_m = f64::from(data.min_distance) / 100.0;
                    prop_assert!(told_m <= f64::from(distances[i].max(0.0)).max(least_m) + 1e-3);
                    prop_assert!(told_m >= least_m || distances[i] >= reaches[i]);
                } else {
                    prop_assert!(f64::from(data.max_distance) / 100.0 <= f64::from(reaches[i].max(0.0)) + 1e-3);
                    prop_assert!(distances[i] >= reaches[i]);
                }
            }
        }
    }
}
