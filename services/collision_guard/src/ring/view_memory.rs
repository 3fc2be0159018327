//! What was seen to be free a short while ago, from places the vehicle has passed.
//!
//! A vehicle that flies round a tree sees, at every moment, only what the trees in front of it do not hide. Nearly all
//! of its path has been seen, but not all of it at once. So views are stored every half metre for some seconds, and a
//! place counts as seen if one of them saw it free, with no hit of that view nearer than the required clearance.
//!
//! This is the guard's only assumption about time: what has been seen to be free stays free while it is hidden, for at
//! most [`VIEW_LIFETIME_S`]. Whatever moves in there meanwhile is an obstacle as soon as it is visible. Obstacles are
//! never remembered: the visible ones count, at once and without filter.

use super::sensor_view::SensorView;
use crate::ring::SENSORS;
use jink_shared_types::Timestamp;
use jink_shared_types::frames::wrap_pi;

/// Views stored over all sensors: at half a metre each, the last 32 m for two sensors.
const VIEWS: usize = 128;
/// How long a view counts (s): at 3 m/s the path past a few trees or round a building's corner. Longer would trust a
/// world that had time to change; shorter would stop the vehicle behind every second tree.
const VIEW_LIFETIME_S: f64 = 10.0;
/// A view is stored when the vehicle has moved this far since the sensor's last stored one (m) ...
const EVERY_M: f64 = 0.5;
/// ... or has turned this far (rad) (two sectors), for sensors that do not see all around ...
const EVERY_RAD: f64 = 0.17;
/// ... or this long ago (s), so that a hovering vehicle keeps what it sees.
const EVERY_S: f64 = 2.0;

/// What a sensor saw a while ago.
#[derive(Clone, Debug)]
pub struct StoredView {
    pub sensor: usize,
    pub view: SensorView,
    time: Timestamp,
}

/// The stored views.
#[derive(Clone, Debug)]
pub struct ViewMemory {
    kept: Vec<StoredView>,
    next: usize,
    /// Per sensor: its last stored view.
    last: [Option<usize>; SENSORS],
}

impl ViewMemory {
    /// Empty; allocates all its memory.
    pub fn new() -> Self {
        Self {
            kept: Vec::with_capacity(VIEWS),
            next: 0,
            last: [None; SENSORS],
        }
    }

    /// Clears everything.
    pub fn clear(&mut self) {
        self.kept.clear();
        self.next = 0;
        self.last = [None; SENSORS];
    }

    /// Stores the view that `sensor` had at `time`, if it differs enough from its last stored one.
    pub fn store_if_new(&mut self, sensor: usize, view: &SensorView, time: Timestamp) {
        let Some(last) = self.last.get_mut(sensor) else {
            return;
        };
        if let Some(kept) = last.and_then(|index| self.kept.get(index)) {
            let moved_m =
                (view.origin_m[0] - kept.view.origin_m[0]).hypot(view.origin_m[1] - kept.view.origin_m[1]);
            let risen_m = (view.down_m - kept.view.down_m).abs();
            let turned_rad = wrap_pi(view.heading_rad - kept.view.heading_rad).abs();
            let age_s = time.seconds_since(kept.time).abs();
            if moved_m.max(risen_m) < EVERY_M && turned_rad < EVERY_RAD && age_s < EVERY_S {
                return;
            }
        }
        let slot = self.next;
        self.next = (self.next + 1) % VIEWS;
        *last = Some(slot);
        for other in self
            .last
            .iter_mut()
            .enumerate()
            .filter(|(index, _)| *index != sensor)
        {
            if *other.1 == Some(slot) {
                *other.1 = None;
            }
        }
        let entry = StoredView {
            sensor,
            view: view.clone(),
            time,
        };
        match self.kept.get_mut(slot) {
            Some(old) => *old = entry,
            None => self.kept.push(entry),
        }
    }

    /// The views of the last [`VIEW_LIFETIME_S`] seconds, taken within `band_half_m` of the height `down_m`, the newest first.
    pub fn views(&self, now: Timestamp, down_m: f64, band_half_m: f64) -> impl Iterator<Item = &StoredView> {
        let count = self.kept.len();
        let newest_first = (1..=count).map(move |back| &self.kept[(self.next + count - back) % count]);
        newest_first.filter(move |kept| {
            now.seconds_since(kept.time).abs() <= VIEW_LIFETIME_S
                && (kept.view.down_m - down_m).abs() <= band_half_m
        })
    }

    /// Whether a view of the last [`VIEW_LIFETIME_S`] seconds, taken within `band_half_m` of the height `down_m`, saw
    /// the place (north, east) free with `clearance_m` around it; `no_overhang`: space above a free place counts as free.
    pub fn admits(
        &self,
        now: Timestamp,
        place_m: [f64; 2],
        down_m: f64,
        clearance_m: f64,
        band_half_m: f64,
        no_overhang: bool,
    ) -> bool {
        self.views(now, down_m, band_half_m)
            .any(|StoredView { view, .. }| {
                view.admits(place_m, no_overhang) && !view.has_hit_within(place_m, clearance_m as f32)
            })
    }
}
