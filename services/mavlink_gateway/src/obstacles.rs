//! The guard's sector ring as OBSTACLE_DISTANCE.
//!
//! | sector | distance on the wire (cm) |
//! |---|---|
//! | not known, or the ring is stale | 65535 |
//! | obstacle | rounded down, at least 0 |
//! | nothing seen as far as the farthest-seeing sector looks | `max_distance + 1` |
//! | nothing seen, but this sector looks less far | as far as it looks: what lies beyond is not known to be free |
//!
//! The message is sent in any case: to an autopilot that is told "unknown" every bin blocks motion at once, while
//! silence does so only after half a second.

use jink_shared_types::ring::{SECTORS, SectorRing};
use jink_shared_types::{Reading, Timestamp};
use mavlink::dialects::ardupilotmega::{MavDistanceSensor, MavFrame, MavMessage, OBSTACLE_DISTANCE_DATA};

/// Distance of a sector that nothing is known about (cm).
const UNKNOWN_CM: u16 = u16::MAX;
/// Largest `max_distance` that leaves room for "max + 1" below "unknown" (cm).
const LONGEST_CM: u16 = u16::MAX - 2;

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

fn fill(data: &mut OBSTACLE_DISTANCE_DATA, ring: &SectorRing) {
    let sectors = || ring.distance_m.iter().zip(&ring.range_max_m);
    let reach_cm = sectors()
        .filter(|(distance_m, _)| !distance_m.is_nan())
        .map(|(_, reach_m)| centimetres(*reach_m))
        .max();
    let Some(reach_cm) = reach_cm else {
        return; // Every sector unknown.
    };
    data.max_distance = reach_cm;
    data.min_distance = centimetres(ring.range_min_m).min(reach_cm);
    for (slot, (distance_m, reach_m)) in data.distances.iter_mut().zip(sectors()) {
        let own_reach_cm = centimetres(*reach_m);
        *slot = if distance_m.is_nan() {
            UNKNOWN_CM
        } else if *distance_m < *reach_m {
            centimetres(*distance_m)
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
    use super::message;
    use jink_shared_types::ring::{SECTORS, SectorRing};
    use jink_shared_types::{Reading, SampleHeader, Stamped, Timestamp};
    use mavlink::dialects::ardupilotmega::{MavFrame, MavMessage, OBSTACLE_DISTANCE_DATA};
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
            let data = sent(&ring);
            for i in 0..SECTORS {
                let told_m = f64::from(data.distances[i]) / 100.0;
                if distances[i].is_nan() {
                    prop_assert_eq!(data.distances[i], 65535);
                } else if data.distances[i] != data.max_distance + 1 {
                    prop_assert!(told_m <= f64::from(distances[i].max(0.0)) + 1e-3);
                } else {
                    prop_assert!(f64::from(data.max_distance) / 100.0 <= f64::from(reaches[i].max(0.0)) + 1e-3);
                    prop_assert!(distances[i] >= reaches[i]);
                }
            }
        }
    }
}
