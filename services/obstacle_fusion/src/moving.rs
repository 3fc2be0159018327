//! Obstacles that move: hits in space that was open, grouped and tracked.
//!
//! | in | out |
//! |---|---|
//! | every frame of hits, before it counts as evidence; the window | [`MovingObstacles`]: position, velocity, size, uncertainty |
//!
//! What is hit where nothing was, with nothing beside it either, has come there (`open_space`; L. Schmid et al.,
//! "Dynablox: Real-time Detection of Diverse Dynamic Objects in Complex Environments", RA-L 2023, section IV, on this
//! map's bit planes). Such hits are grouped by columns (`clusters`), and the groups tracked from frame to frame with a
//! constant velocity (`tracks`). A track is reported once it has moved for a while, as far as its uncertainty allows to
//! say so: what only flickers, and what the map's own errors shift, is not; nor is what moves as the estimated position slips
//! (`slip`), nor what a late attitude displaces while the vehicle turns.
//!
//! What moves is in the map as well, like everything that is hit; a track says where it is going to be.

mod clusters;
mod open_space;
mod slip;
mod tracks;

use crate::frame_bits::FrameBits;
use crate::window::MapWindow;
use clusters::Clusters;
use jink_shared_types::Timestamp;
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::pose_history::Estimate;
use nalgebra::Vector3;
use open_space::OpenSpace;
use slip::Slip;
use tracks::{Tracks, Viewpoint};

/// The vehicle counts as turning as it did for about this long (s): a sweep takes so long, and its poses may be late.
const TURNED_S: f64 = 0.1;

/// What moves around the vehicle.
pub(crate) struct Moving {
    open: OpenSpace,
    clusters: Clusters,
    tracks: Tracks,
    slip: Slip,
    viewpoint: Viewpoint,
    /// When that was taken.
    viewed: Timestamp,
    /// A sensor that sees height contributes: not only planar scans.
    sees_height: bool,
}

impl Moving {
    pub fn new() -> Self {
        Self {
            open: OpenSpace::new(),
            clusters: Clusters::new(),
            tracks: Tracks::new(),
            slip: Slip::default(),
            viewpoint: Viewpoint::default(),
            viewed: Timestamp::NEVER,
            sees_height: false,
        }
    }

    /// The map was cleared or moved: cells have other numbers now.
    pub fn clear(&mut self) {
        self.open.clear();
        self.tracks.clear();
        self.slip.on_reset();
    }

    /// Takes an estimate of the vehicle's position and velocity.
    pub fn vehicle(&mut self, at: Timestamp, estimate: &Estimate) {
        self.slip.update(at, estimate);
        let passed_s = at.seconds_since(self.viewed).max(0.0);
        let turned_radps = self.viewpoint.turning_radps * (-passed_s / TURNED_S).exp();
        self.viewpoint = Viewpoint {
            place_m: estimate.position_m,
            turning_radps: estimate.rates_radps.norm().max(turned_radps),
        };
        self.viewed = at;
    }

    /// Whether the estimated position moves otherwise than the estimated velocity says.
    pub fn is_slipping(&self) -> bool {
        self.slip.is_wrong()
    }

    /// A sensor that sees height contributes.
    pub fn sees_height(&mut self) {
        self.sees_height = true;
    }

    /// Takes a frame captured at `capture` that is not applied to `window` yet.
    pub fn look(&mut self, capture: Timestamp, frame: &FrameBits, window: &MapWindow) {
        self.open.update(capture, window, self.sees_height);
        self.clusters.clear();
        self.open
            .hits(frame, window, |cell, is_open| self.clusters.add(cell, is_open));
        let slipped_m = self.slip.slipped_m();
        let groups = self.clusters.groups(window.min_cell());
        self.tracks.update(capture, groups, &slipped_m, &self.viewpoint);
    }

    /// Writes what moves, the nearest to `vehicle_m` (local) first.
    pub fn write(&mut self, vehicle_m: &Vector3<f64>, epoch: u32, out: &mut MovingObstacles) {
        self.tracks.write(vehicle_m, out);
        out.epoch = epoch;
    }
}
