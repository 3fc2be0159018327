//! What obstacle messages say, in eight sectors of 45 degrees about the vehicle.
//!
//! * OBSTACLE_DISTANCE: always read about the vehicle's nose, **whatever its frame field says**. Shorter than `min_distance`,
//!   longer than `max_distance`, or 65535 means "nothing there"; an obstacle too near vanishes.
//! * OBSTACLE_DISTANCE_3D: with frame 12 (BODY_FRD) only. Other frames keep the sensor healthy and show no obstacle.
//! * Distances pass a low-pass (PRX_FILT, 0.25 Hz): they come late.
//! * Healthy while the last message is younger than half a second; a sector forgets after one more second.

use super::parameters::{Parameter as P, Parameters};
use mavlink::dialect::{MavFrame, OBSTACLE_DISTANCE_3D_DATA, OBSTACLE_DISTANCE_DATA};
use nalgebra::{Rotation2, Vector2};

/// Number of sectors.
pub const SECTORS: usize = 8;
/// A sensor that says nothing for longer is unhealthy (us).
const HEALTHY_US: u64 = 500_000;
/// A sector that was not renewed for longer is empty (us): the time of an unhealthy sensor and a second.
const FORGET_US: u64 = 1_500_000;
/// A filter that was not fed for longer starts anew (us).
const FILTER_RESTART_US: u64 = 500_000;
/// Width of a bin where the message gives none (deg).
const BIN_DEG: f64 = 5.0;
/// PRX1_TYPE of MAVLink.
const TYPE_MAVLINK: f64 = 2.0;

/// The nearest obstacle of a sector.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Face {
    /// From the nose to the right (rad).
    angle_rad: f64,
    /// As filtered (m).
    distance_m: f64,
    renewed_us: u64,
}

/// The sensor.
#[derive(Clone, Debug)]
pub struct Proximity {
    enabled: bool,
    received_us: Option<u64>,
    faces: [Option<Face>; SECTORS],
    /// Nearest of each sector in the group of OBSTACLE_DISTANCE_3D being received, and its time stamp.
    group: [Option<(f64, f64)>; SECTORS],
    group_boot_ms: u32,
    range_m: (f64, f64),
}

impl Proximity {
    /// As PRX1_TYPE says at the start.
    pub fn new(parameters: &Parameters) -> Self {
        Self {
            enabled: parameters.get(P::PRX1_TYPE) == TYPE_MAVLINK,
            received_us: None,
            faces: [None; SECTORS],
            group: [None; SECTORS],
            group_boot_ms: 0,
            range_m: (0.0, 0.0),
        }
    }

    /// Whether there is a sensor at all.
    pub fn is_enabled(&self) -> bool {
        self.enabled
    }

    /// Whether its data can be used.
    pub fn is_healthy(&self, now_us: u64) -> bool {
        self.enabled && self.received_us.is_some_and(|at_us| now_us - at_us < HEALTHY_US)
    }

    /// Takes a scan.
    pub fn receive(&mut self, now_us: u64, message: &OBSTACLE_DISTANCE_DATA, parameters: &Parameters) {
        if !self.enabled {
            return;
        }
        self.received_us = Some(now_us);
        let width_deg = if message.increment_f > 0.0 {
            f64::from(message.increment_f)
        } else if message.increment > 0 {
            f64::from(message.increment)
        } else {
            BIN_DEG
        };
        let offset_deg = f64::from(message.angle_offset);
        self.range_m = (
            f64::from(message.min_distance) * 0.01,
            f64::from(message.max_distance) * 0.01,
        );
        let mut nearest = [None; SECTORS];
        for (bin, distance) in message.distances.iter().enumerate() {
            let known = (message.min_distance..=message.max_distance).contains(distance);
            let angle_deg = offset_deg + bin as f64 * width_deg;
            if known && *distance != 0 && (bin as f64) * width_deg < 360.0 {
                note(&mut nearest, angle_deg.to_radians(), f64::from(*distance) * 0.01);
            }
        }
        self.renew(now_us, &nearest, parameters);
    }

    /// Takes one obstacle; those with the same time stamp belong together.
    pub fn receive_3d(&mut self, now_us: u64, message: &OBSTACLE_DISTANCE_3D_DATA, parameters: &Parameters) {
        if !self.enabled {
            return;
        }
        self.received_us = Some(now_us);
        if message.frame != MavFrame::MAV_FRAME_BODY_FRD {
            return;
        }
        if message.time_boot_ms != self.group_boot_ms {
            self.group_boot_ms = message.time_boot_ms;
            self.group = [None; SECTORS];
        }
        self.range_m = (f64::from(message.min_distance), f64::from(message.max_distance));
        let at = Vector2::new(f64::from(message.x), f64::from(message.y));
        let distance_m = at.norm();
        if distance_m >= self.range_m.0 && distance_m <= self.range_m.1 && distance_m > 0.0 {
            note(&mut self.group, at.y.atan2(at.x), distance_m);
        }
        let group = self.group;
        self.renew(now_us, &group, parameters);
    }

    fn renew(&mut self, now_us: u64, nearest: &[Option<(f64, f64)>; SECTORS], parameters: &Parameters) {
        let cutoff_hz = parameters.get(P::PRX_FILT);
        for (face, nearest) in self.faces.iter_mut().zip(nearest) {
            let Some((angle_rad, distance_m)) = *nearest else {
                *face = None;
                continue;
            };
            let before = face.filter(|face| now_us - face.renewed_us < FILTER_RESTART_US);
            let distance_m = match before {
                Some(before) if cutoff_hz > 0.0 => {
                    let dt_s = (now_us - before.renewed_us) as f64 * 1e-6;
                    let b = std::f64::consts::TAU * cutoff_hz * dt_s;
                    before.distance_m + (distance_m - before.distance_m) * (b / (1.0 + b))
                }
                _ => distance_m,
            };
            *face = Some(Face {
                angle_rad,
                distance_m,
                renewed_us: now_us,
            });
        }
    }

    /// Where obstacles are, from the vehicle in local north and east (m), one per sector.
    pub fn obstacles(&self, now_us: u64, yaw_rad: f64) -> impl Iterator<Item = Vector2<f64>> {
        self.faces.iter().flatten().filter_map(move |face| {
            let fresh = now_us - face.renewed_us < FORGET_US;
            let at = Rotation2::new(yaw_rad + face.angle_rad) * Vector2::new(face.distance_m, 0.0);
            fresh.then_some(at)
        })
    }

    /// Distance in sector `sector` (m), and the sensor's range (m).
    pub fn sector(&self, now_us: u64, sector: usize) -> Option<(f64, (f64, f64))> {
        let face = self.faces.get(sector).copied().flatten()?;
        let fresh = self.is_healthy(now_us) && now_us - face.renewed_us < FORGET_US;
        fresh.then_some((face.distance_m, self.range_m))
    }
}

/// Keeps the nearest distance of the sector that `angle_rad` lies in.
fn note(nearest: &mut [Option<(f64, f64)>; SECTORS], angle_rad: f64, distance_m: f64) {
    let width_rad = std::f64::consts::TAU / SECTORS as f64;
    let turns = (angle_rad / width_rad).round().rem_euclid(SECTORS as f64);
    let sector = turns as usize % SECTORS;
    if nearest[sector].is_none_or(|(_, known_m)| distance_m < known_m) {
        nearest[sector] = Some((angle_rad, distance_m));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(filter_hz: f64) -> (Proximity, Parameters) {
        let mut parameters = Parameters::default();
        parameters.set(P::PRX1_TYPE, 2.0);
        parameters.set(P::PRX_FILT, filter_hz);
        (Proximity::new(&parameters), parameters)
    }

    fn scan(distance_cm: u16, bins: std::ops::Range<usize>) -> OBSTACLE_DISTANCE_DATA {
        let mut message = OBSTACLE_DISTANCE_DATA {
            increment: 5,
            min_distance: 20,
            max_distance: 2_000,
            distances: [u16::MAX; 72],
            ..OBSTACLE_DISTANCE_DATA::default()
        };
        message.distances[bins].fill(distance_cm);
        message
    }

    #[test]
    fn a_scan_is_about_the_nose_and_what_is_out_of_range_is_not_there() {
        let (mut proximity, parameters) = sensor(0.0);
        let mut message = scan(500, 17..20);
        message.frame = MavFrame::MAV_FRAME_GLOBAL;
        proximity.receive(0, &message, &parameters);
        let at: Vec<_> = proximity.obstacles(0, 0.0).collect();
        assert_eq!(at.len(), 1);
        assert!((at[0].norm() - 5.0).abs() < 1e-9 && at[0].y > 4.9);
        for distance_cm in [0, 19, 2_001, u16::MAX] {
            proximity.receive(0, &scan(distance_cm, 0..72), &parameters);
            assert_eq!(proximity.obstacles(0, 0.0).count(), 0, "{distance_cm}");
            assert!(proximity.is_healthy(0));
        }
        let mut shifted = scan(500, 0..1);
        shifted.angle_offset = 90.0;
        proximity.receive(0, &shifted, &parameters);
        assert!(proximity.obstacles(0, 0.0).next().unwrap().y > 4.9);
    }

    #[test]
    fn a_sensor_is_healthy_for_half_a_second_and_forgotten_a_second_later() {
        let (mut proximity, parameters) = sensor(0.0);
        proximity.receive(1_000_000, &scan(500, 0..72), &parameters);
        assert!(proximity.is_healthy(1_496_000) && !proximity.is_healthy(1_504_000));
        assert_eq!(proximity.obstacles(2_496_000, 0.0).count(), SECTORS);
        assert_eq!(proximity.obstacles(2_504_000, 0.0).count(), 0);
    }

    #[test]
    fn the_filter_lags_and_zero_switches_it_off() {
        for (filter_hz, lags) in [(0.25, true), (0.0, false)] {
            let (mut proximity, parameters) = sensor(filter_hz);
            proximity.receive(0, &scan(1_000, 0..1), &parameters);
            proximity.receive(100_000, &scan(500, 0..1), &parameters);
            let (distance_m, _) = proximity.sector(100_000, 0).unwrap();
            assert_eq!(distance_m > 9.0, lags, "{distance_m}");
        }
    }

    #[test]
    fn a_point_counts_in_the_bodys_frame_only() {
        let (mut proximity, parameters) = sensor(0.0);
        let mut message = OBSTACLE_DISTANCE_3D_DATA {
            time_boot_ms: 1,
            x: 4.0,
            min_distance: 0.2,
            max_distance: 20.0,
            frame: MavFrame::MAV_FRAME_LOCAL_NED,
            ..OBSTACLE_DISTANCE_3D_DATA::default()
        };
        proximity.receive_3d(0, &message, &parameters);
        assert!(proximity.is_healthy(0));
        assert_eq!(proximity.obstacles(0, 0.0).count(), 0);
        message.frame = MavFrame::MAV_FRAME_BODY_FRD;
        proximity.receive_3d(0, &message, &parameters);
        message.x = -3.0;
        proximity.receive_3d(0, &message, &parameters);
        assert_eq!(proximity.obstacles(0, 0.0).count(), 2);
    }
}
