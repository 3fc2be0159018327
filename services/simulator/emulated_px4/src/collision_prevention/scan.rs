//! A message with distances all around into the bins that its elements touch.
//!
//! An element reaches half an increment to either side of its direction. One that straddles the zero is compared as an
//! arc that begins below zero, and with nothing else: it never reaches the bins to the left of the zero. Of several
//! elements that touch a bin the last one wins, not the nearest. Both are PX4's ways.

use super::angle::{degrees, wrap_deg};
use super::map::{BIN_DEG, BINS, Map, TIMEOUT_US, UNKNOWN_CM};
use super::message::{ObstacleDistance, frame};

/// A range of angles (deg); it may begin below zero.
#[derive(Clone, Copy, Debug, Default)]
struct Arc {
    lower_deg: f32,
    upper_deg: f32,
}

impl Arc {
    /// Element `index` of a circle of elements of this width, `count` of which fit.
    fn of(index: i32, width_deg: f32, offset_deg: f32, count: i32) -> Self {
        let lower_edge_deg = |index: i32| {
            let centre_deg = (index % count) as f32 * width_deg + offset_deg;
            wrap_deg(centre_deg - width_deg / 2.0)
        };
        let (mut lower_deg, upper_deg) = (lower_edge_deg(index), lower_edge_deg(index + 1));
        if lower_deg > upper_deg {
            lower_deg -= 360.0;
        }
        Self { lower_deg, upper_deg }
    }

    /// Edges that just meet do not touch.
    fn touches(&self, other: &Self) -> bool {
        let inside = |deg: f32| other.lower_deg < deg && deg < other.upper_deg;
        let contains = |a: &Self, b: &Self| a.lower_deg <= b.lower_deg && b.upper_deg <= a.upper_deg;
        inside(self.lower_deg) || inside(self.upper_deg) || contains(self, other) || contains(other, self)
    }
}

/// Takes a message of a vehicle that heads `yaw_rad`. Returns its frame if that is not understood.
pub(super) fn ingest(map: &mut Map, now_us: u64, message: &ObstacleDistance, yaw_rad: f32) -> Option<u8> {
    let usable = message.increment_deg > 0.0;
    if now_us.wrapping_sub(message.time_us) >= TIMEOUT_US || !usable {
        return None;
    }
    map.receive(message.time_us, message.min_cm, message.max_cm);
    let offset_deg = match message.frame {
        frame::BODY_FRD => message.offset_deg,
        frame::GLOBAL | frame::LOCAL_NED => message.offset_deg - degrees(yaw_rad),
        other => return Some(other),
    };
    paint(map, message, offset_deg);
    None
}

fn paint(map: &mut Map, message: &ObstacleDistance, offset_deg: f32) {
    let fitting = 360.0 / message.increment_deg;
    let count = fitting as i32;
    if count == 0 {
        // PX4 divides by it.
        return;
    }
    // One more than fits whole if the increment does not divide the circle.
    let elements = (fitting.ceil() as usize).min(BINS);
    let mut arcs = [Arc::default(); BINS];
    for (index, arc) in arcs.iter_mut().enumerate().take(elements) {
        *arc = Arc::of(index as i32, message.increment_deg, offset_deg, count);
    }
    let range_m = f32::from(message.max_cm) * 0.01;
    for bin in 0..BINS {
        let bin_arc = Arc::of(bin as i32, BIN_DEG, 0.0, BINS as i32);
        for (arc, distance_cm) in arcs.iter().zip(message.distances_cm).take(elements) {
            if distance_cm != UNKNOWN_CM && arc.touches(&bin_arc) {
                map.offer(
                    bin,
                    range_m,
                    f32::from(distance_cm) * 0.01,
                    distance_cm,
                    message.max_cm,
                );
            }
        }
    }
}
