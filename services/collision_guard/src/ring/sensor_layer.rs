//! One sensor's part of the ring: its newest views, several if it does not see all at once, and how long they count.

use super::bearing::sector_toward;
use super::sensor_view::{SensorView, SlotHit, ViewSector};
use jink_shared_types::Timestamp;
use jink_shared_types::pose_history::Pose;
use jink_shared_types::ring::{SECTORS, sector_bearing_rad};

/// A sample stamped this far in the future (s) is broken, not fresh: clocks of one board agree to less.
const FUTURE_S: f64 = 0.1;
/// Views kept of a sensor that turns: half a second of views of 20 ms.
const PARTS: usize = 25;

/// A view and its time.
#[derive(Clone, Debug)]
struct TimedView {
    view: SensorView,
    /// When that was captured; never if there is none.
    captured: Timestamp,
    /// Whether the view is still fixed in local NED.
    is_placed: bool,
}

/// How long samples count.
#[derive(Clone, Copy, Debug)]
pub struct Lifetimes {
    /// Age at which the sensor's samples count as stale (s).
    pub deadline_s: f64,
    /// Age up to which its views count (s).
    pub kept_s: f64,
    /// Each sample shows all that the sensor sees: what it saw free before counts while its samples come.
    pub is_remembered: bool,
}

/// The views of one sensor.
#[derive(Clone, Debug)]
pub struct SensorLayer {
    parts: Vec<TimedView>,
    /// When its newest sample was captured, with a pose or without.
    arrived: Timestamp,
    lifetimes: Lifetimes,
    /// Shortest range it measures (m).
    pub range_min_m: f32,
}

impl SensorLayer {
    /// A sensor without samples.
    pub fn new() -> Self {
        let part = TimedView {
            view: SensorView::unknown(),
            captured: Timestamp::NEVER,
            is_placed: false,
        };
        Self {
            parts: vec![part; PARTS],
            arrived: Timestamp::NEVER,
            lifetimes: Lifetimes {
                deadline_s: 0.0,
                kept_s: 0.0,
                is_remembered: false,
            },
            range_min_m: 0.0,
        }
    }

    /// Records that a sample has come, whether it is used or not.
    pub fn record_arrival(&mut self, captured: Timestamp, lifetimes: Lifetimes) {
        self.arrived = captured;
        self.lifetimes = lifetimes;
    }

    /// Replaces all views by one from `pose`: `fill` writes it into an empty view.
    pub fn replace(
        &mut self,
        pose: &Pose,
        captured: Timestamp,
        fill: impl FnOnce(&mut SensorView),
    ) -> &SensorView {
        for part in &mut self.parts {
            part.captured = Timestamp::NEVER;
        }
        self.fill(0, pose, captured, fill)
    }

    /// Adds a view from `pose` to those in other directions.
    pub fn add(
        &mut self,
        pose: &Pose,
        captured: Timestamp,
        fill: impl FnOnce(&mut SensorView),
    ) -> &SensorView {
        let oldest = (0..self.parts.len()).min_by_key(|index| self.parts[*index].captured.ns);
        let index = oldest.unwrap_or(0);
        self.fill(index, pose, captured, fill);
        let (before, rest) = self.parts.split_at_mut(index);
        if let Some((new, after)) = rest.split_first_mut() {
            let others = before.iter_mut().chain(after);
            for other in others.filter(|part| part.captured.is_set()) {
                // A late view does not replace a newer one.
                if other.captured <= new.captured {
                    remove_what_is_seen_again(&mut other.view, &new.view);
                } else {
                    remove_what_is_seen_again(&mut new.view, &other.view);
                }
            }
        }
        &self.parts[index].view
    }

    fn fill(
        &mut self,
        index: usize,
        pose: &Pose,
        captured: Timestamp,
        fill: impl FnOnce(&mut SensorView),
    ) -> &SensorView {
        let part = &mut self.parts[index];
        part.view.reset(pose);
        fill(&mut part.view);
        part.captured = captured;
        part.is_placed = true;
        &part.view
    }

    /// Local NED has moved: no view is fixed in it any more.
    pub fn invalidate_places(&mut self) {
        for part in &mut self.parts {
            part.is_placed = false;
        }
    }

    /// The views that still count.
    pub fn views(&self, now: Timestamp) -> impl Iterator<Item = &SensorView> {
        self.parts
            .iter()
            .filter(move |part| part.is_placed && is_young(now, part.captured, self.lifetimes.kept_s))
            .map(|part| &part.view)
    }

    /// Whether any view still counts.
    pub fn is_live(&self, now: Timestamp) -> bool {
        self.views(now).next().is_some()
    }

    /// Whether samples still come from this sensor, with a pose or without.
    pub fn is_arriving(&self, now: Timestamp) -> bool {
        is_young(now, self.arrived, self.lifetimes.deadline_s)
    }

    /// Whether what it saw free before still counts.
    pub fn remembers(&self, now: Timestamp) -> bool {
        self.lifetimes.is_remembered && self.is_live(now)
    }

    /// Whether it has seen something, and its views no longer count.
    pub fn is_lost(&self, now: Timestamp) -> bool {
        self.parts.iter().any(|part| part.captured.is_set()) && !self.is_live(now)
    }

    /// Marks in `mask` the sectors that this layer knows, or knew, numbered from the heading of the view.
    pub fn mark_covered(&self, mask: &mut [bool; SECTORS]) {
        for part in self.parts.iter().filter(|part| part.captured.is_set()) {
            for (covered, sector) in mask.iter_mut().zip(&part.view.sectors) {
                *covered |= sector.is_known();
            }
        }
    }
}

fn is_young(now: Timestamp, time: Timestamp, limit_s: f64) -> bool {
    time.is_set() && (-FUTURE_S..=limit_s).contains(&now.seconds_since(time))
}

/// Removes from `old` what lies in sectors that `new` knows.
fn remove_what_is_seen_again(old: &mut SensorView, new: &SensorView) {
    let turn_rad = old.heading_rad - new.heading_rad;
    for (sector, slot) in old.sectors.iter_mut().enumerate() {
        let (right, forward) = (sector_bearing_rad(sector) + turn_rad).sin_cos();
        if new.sectors[sector_toward(forward as f32, right as f32)].is_known() {
            *slot = ViewSector::UNKNOWN;
        }
    }
    for index in 0..old.hits.len() {
        let [forward, right] = new.level(old.local(old.hits[index].level_m));
        if new.sectors[sector_toward(forward, right)].is_known() {
            old.hits[index] = SlotHit::NONE;
        }
    }
}
