//! What the ring knows of the places along a path.

use super::Ring;
use super::sensor_view::SensorView;
use jink_shared_types::Timestamp;
use jink_shared_types::ring::{SECTORS, sector_of};

/// What is known of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// A sensor sees it free, or saw it free shortly before from where the vehicle was then.
    Free,
    /// It lies in the field of view of a sensor that no longer answers.
    Lost,
    /// No sensor has seen it.
    Unseen,
}

/// The ring at one time, for queries about places.
#[derive(Debug)]
pub struct RingQuery<'a> {
    ring: &'a Ring,
    now: Timestamp,
    /// Where the vehicle is (north, east) (m) and its heading (rad).
    place_m: [f64; 2],
    yaw_rad: f64,
    /// Body sectors that were covered by sensors that no longer answer, and are covered by no other.
    lost: [bool; SECTORS],
}

impl<'a> RingQuery<'a> {
    pub(super) fn new(ring: &'a Ring, now: Timestamp) -> Self {
        let pose = ring.poses.at(now).or_else(|| ring.poses.at(ring.poses.newest()));
        let mut covered = [false; SECTORS];
        let mut lost = [false; SECTORS];
        for layer in &ring.layers {
            if layer.is_live(now) {
                layer.mark_covered(&mut covered);
            } else if layer.is_lost(now) {
                layer.mark_covered(&mut lost);
            }
        }
        for (lost, covered) in lost.iter_mut().zip(covered) {
            *lost &= !covered;
        }
        Self {
            ring,
            now,
            place_m: pose.map_or([0.0; 2], |pose| [pose.position_m.x, pose.position_m.y]),
            yaw_rad: pose.map_or(0.0, |pose| pose.yaw_rad()),
            lost,
        }
    }

    fn views(&self) -> impl Iterator<Item = &'a SensorView> {
        let now = self.now;
        self.ring.layers.iter().flat_map(move |layer| layer.views(now))
    }

    /// The visible obstacle points: the nearest of every quarter of a sector of every live sensor, local NED (north,
    /// east) (m).
    pub fn obstacles(&self) -> impl Iterator<Item = [f64; 2]> {
        self.views()
            .flat_map(|view| view.places().map(|(place_m, _)| place_m))
    }

    /// What is known of the place (north, east) (m) at height `down_m`; if it is hidden now, it must have been seen
    /// with `clearance_m` around it. `no_overhang`: space above a free place counts as free.
    pub fn visibility(
        &self,
        place_m: [f64; 2],
        down_m: f64,
        clearance_m: f64,
        no_overhang: bool,
    ) -> Visibility {
        if self.views().any(|view| view.admits(place_m, no_overhang)) {
            return Visibility::Free;
        }
        let bearing_rad = (place_m[1] - self.place_m[1]).atan2(place_m[0] - self.place_m[0]) - self.yaw_rad;
        if self.lost[sector_of(bearing_rad)] {
            return Visibility::Lost;
        }
        let remembered = self.ring.memory.admits(
            self.now,
            place_m,
            down_m,
            clearance_m,
            self.ring.envelope.band_half_m,
            no_overhang,
        );
        if remembered {
            Visibility::Free
        } else {
            Visibility::Unseen
        }
    }

    /// Whether the place (north, east) (m) lies where the vehicle is now, within `radius_m`.
    pub fn is_here(&self, place_m: [f64; 2], radius_m: f64) -> bool {
        (place_m[0] - self.place_m[0]).hypot(place_m[1] - self.place_m[1]) <= radius_m
    }
}
