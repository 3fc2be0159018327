//! The place that the next plan departs from. It may be too narrow for a speed tier, or inside the standoff of an
//! obstacle.

use super::cells::{cell_holding, cells_within};
use super::{ConfigurationSpace, NarrowPlace};
use crate::bit_layer::StructuringElement;
use crate::speed_tiers::LAST_TIER;
use jink_shared_types::map::{CELL_M, Cell, center_of};
use nalgebra::Vector3;

/// An element as large as the clearance must not reach the cell that limits it, for rounding (m).
const ROUNDING_M: f64 = 1e-6;

impl ConfigurationSpace {
    /// Sets where the next plan departs from: whether there is clearance for `tier`, if the vehicle creeps or rests
    /// there (`is_creeping`), and whether it is inside the standoff. Nearer to something than its radius, only a
    /// vehicle that `has_plan` is moved away: one that takes off is near to the ground, and controlled by the
    /// autopilot.
    pub fn set_departure(&mut self, place: &Vector3<f64>, tier: usize, is_creeping: bool, has_plan: bool) {
        let cell = cell_holding(place);
        self.set_narrow(None);
        self.update_standoff_at(place);
        if !is_creeping || !self.contains(cell) {
            return;
        }
        self.prepare(tier);
        if !self.is_safe_at(tier, place) {
            let clearance_m = self.clearance_m(cell, self.radii_m[tier]);
            if clearance_m < self.clearance.vehicle_m && !has_plan {
                return;
            }
            self.set_narrow(Some(NarrowPlace {
                tier,
                element: StructuringElement::new(clearance_m.max(self.clearance.vehicle_m) - ROUNDING_M),
                from: cell,
            }));
            self.prepare(tier);
        }
    }

    /// Whether an occupied cell limits the clearance.
    pub fn is_narrowed_by_obstacle(&self) -> bool {
        self.narrow.as_ref().is_some_and(|narrow| {
            let radius_m = self.radii_m[narrow.tier];
            self.clearance_m(narrow.from, radius_m) < radius_m
        })
    }

    /// Whether `tier` has the clearance in `cell` that it needs.
    pub fn has_clearance(&self, tier: usize, cell: Cell) -> bool {
        let radius_m = self.radii_m[tier];
        self.is_safe(tier, cell) && cells_within(cell, radius_m).all(|(there, _)| !self.is_not_free(there))
    }

    /// Whether `cell` is occupied or unknown; outside the window all is unknown.
    fn is_not_free(&self, cell: Cell) -> bool {
        !self.contains(cell) || self.not_free.test(cell)
    }

    fn set_narrow(&mut self, narrow: Option<NarrowPlace>) {
        let speed_tiers = [self.narrow.as_ref(), narrow.as_ref()];
        for narrow in speed_tiers.into_iter().flatten() {
            self.ready[narrow.tier] = false;
        }
        self.narrow = narrow;
    }

    /// Distance from `cell` to the nearest occupied one, at most `max_m`, between their nearest points.
    fn clearance_m(&self, cell: Cell, max_m: f64) -> f64 {
        let occupied = cells_within(cell, max_m).filter(|(there, _)| self.is_occupied(*there));
        occupied.fold(max_m, |min_m, (_, away_m)| min_m.min(away_m))
    }

    /// Distance from `place` (local, m) to the nearest point of an occupied cell, at most what `tier` keeps away from one (m).
    pub fn hit_distance_m(&self, tier: usize, place: &Vector3<f64>) -> f64 {
        let most_m = self.hit_reach_m(tier);
        let occupied =
            cells_within(cell_holding(place), most_m).filter(|(there, _)| self.is_occupied(*there));
        let away_m = |there: Cell| {
            let apart = (place - center_of(there).vector())
                .abs()
                .add_scalar(-0.5 * CELL_M);
            apart.sup(&Vector3::zeros()).norm()
        };
        occupied.fold(most_m, |min_m, (there, _)| min_m.min(away_m(there)))
    }

    fn update_standoff_at(&mut self, place: &Vector3<f64>) {
        let slowest = LAST_TIER;
        if self.standoff_elements[slowest].is_none() {
            return;
        }
        self.set_inside_standoff(false);
        self.prepare(slowest);
        let is_too_near = self.is_hit_at(slowest, place);
        self.set_inside_standoff(is_too_near);
    }

    fn set_inside_standoff(&mut self, is_inside_standoff: bool) {
        if is_inside_standoff != self.is_inside_standoff {
            self.is_inside_standoff = is_inside_standoff;
            self.discard_tiers();
        }
    }
}
