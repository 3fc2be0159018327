//! Obstacles on the wire: what PX4 makes of OBSTACLE_DISTANCE and DISTANCE_SENSOR, and what it sends itself.
//!
//! Both are stamped with the time of arrival. A link has one rangefinder, whatever `id` its messages carry: of several
//! that arrive within a cycle the last one is seen.

use super::collision_prevention::{CollisionPrevention, DistanceSensor, ObstacleDistance};
use mavlink::dialect::{DISTANCE_SENSOR_DATA, MavFrame, OBSTACLE_DISTANCE_DATA};

/// `increment_f` if it is positive, `increment` otherwise.
pub fn scan(now_us: u64, message: &OBSTACLE_DISTANCE_DATA) -> ObstacleDistance {
    ObstacleDistance {
        time_us: now_us,
        frame: message.frame as u8,
        increment_deg: if message.increment_f > 0.0 {
            message.increment_f
        } else {
            f32::from(message.increment)
        },
        offset_deg: message.angle_offset,
        min_cm: message.min_distance,
        max_cm: message.max_distance,
        distances_cm: message.distances,
    }
}

/// MAVLink's quality 0 is "unknown", 1 to 100 are 0 to 100 here.
pub fn reading(now_us: u64, message: &DISTANCE_SENSOR_DATA) -> DistanceSensor {
    let metres = |cm: u16| f32::from(cm) * 1e-2;
    DistanceSensor {
        time_us: now_us,
        min_m: metres(message.min_distance),
        max_m: metres(message.max_distance),
        distance_m: metres(message.current_distance),
        quality: match message.signal_quality.min(100) {
            0 => -1,
            quality => (100 * (i16::from(quality) - 1) / 99) as i8,
        },
        orientation: message.orientation as u8,
        field_of_view_rad: message.horizontal_fov,
        body_q_sensor: message.quaternion,
    }
}

/// The fused map as it was published last.
pub fn fused(prevention: &CollisionPrevention) -> OBSTACLE_DISTANCE_DATA {
    let map = prevention.map();
    OBSTACLE_DISTANCE_DATA {
        time_usec: map.time_us,
        distances: *prevention.published_cm(),
        min_distance: map.min_cm,
        max_distance: map.max_cm,
        increment: 0,
        increment_f: 5.0,
        angle_offset: 0.0,
        frame: MavFrame::MAV_FRAME_BODY_FRD,
        ..OBSTACLE_DISTANCE_DATA::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quality_of_one_is_invalid_and_none_is_unknown() {
        let quality = |signal_quality| {
            reading(
                0,
                &DISTANCE_SENSOR_DATA {
                    signal_quality,
                    ..DISTANCE_SENSOR_DATA::default()
                },
            )
            .quality
        };
        assert_eq!([0, 1, 50, 100].map(quality), [-1, 0, 49, 100]);
    }

    #[test]
    fn the_fractional_increment_counts_before_the_whole_one() {
        let increment = |increment_f| {
            scan(
                0,
                &OBSTACLE_DISTANCE_DATA {
                    increment: 5,
                    increment_f,
                    ..OBSTACLE_DISTANCE_DATA::default()
                },
            )
            .increment_deg
        };
        assert_eq!([2.5, 0.0, -1.0].map(increment), [2.5, 5.0, 5.0]);
    }
}
