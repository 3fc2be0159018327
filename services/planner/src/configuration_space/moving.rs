//! What moves, painted into the layers for one plan: the places where the vehicle could meet it.

use super::ConfigurationSpace;
use super::cells::{cell_holding, is_within};
use crate::moving::PredictedCylinder;
use crate::speed_tiers::TIERS;
use jink_shared_types::map::{SIZE_X, SIZE_Z, bit_of, center_of};
use jink_shared_types::moving::MOVING_OBSTACLES;
use nalgebra::Vector3;

/// Room for so many moments of each obstacle: three seconds in quarters.
const MEETINGS_EACH: usize = 16;

/// A cylinder as of a moment, and where the vehicle can be then: between two distances from where it departs (m).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Meeting {
    pub cylinder: PredictedCylinder,
    pub between_m: [f64; 2],
}

/// The meetings of a plan that departs from one place.
#[derive(Debug, Default)]
pub(super) struct Meetings {
    from_m: Vector3<f64>,
    all: Vec<Meeting>,
}

impl Meetings {
    /// None yet, with room for every obstacle at every moment that a plan looks at.
    pub fn new() -> Self {
        Self {
            from_m: Vector3::zeros(),
            all: Vec::with_capacity(MOVING_OBSTACLES * MEETINGS_EACH),
        }
    }
}

impl ConfigurationSpace {
    /// From now on every tier holds the places of `meetings` as well, for a vehicle that departs from `from` (local,
    /// m), until [`Self::unpaint`] or the next map.
    pub(crate) fn paint(&mut self, from: &Vector3<f64>, meetings: impl Iterator<Item = Meeting>) {
        self.unpaint();
        self.meetings.from_m = *from;
        self.meetings.all.extend(meetings);
        for tier in 0..TIERS {
            if self.ready[tier] {
                self.paint_tier(tier);
            }
        }
    }

    /// Takes what moves out of the map, until it is loaded again: what is occupied within `beside_m` of these cylinders.
    pub(crate) fn remove_moving(
        &mut self,
        cylinders: impl Iterator<Item = PredictedCylinder>,
        beside_m: f64,
    ) {
        self.discard_tiers();
        for cylinder in cylinders {
            let reach_m = cylinder.radius_m + beside_m;
            let reach = Vector3::new(reach_m, reach_m, cylinder.half_height_m + beside_m);
            let [low, high] = [-1.0, 1.0].map(|side| cell_holding(&(cylinder.centre_m + reach * side)));
            for z in low[2]..=high[2] {
                for y in low[1]..=high[1] {
                    for x in low[0]..=high[0] {
                        let away = center_of([x, y, z]).vector() - cylinder.centre_m;
                        if away.xy().norm() < reach_m && self.is_occupied([x, y, z]) {
                            self.occupied.unset([x, y, z]);
                            self.not_free.unset([x, y, z]);
                        }
                    }
                }
            }
        }
    }

    /// Every tier holds only what the map does.
    pub(crate) fn unpaint(&mut self) {
        self.meetings.all.clear();
        for tier in 0..TIERS {
            if std::mem::take(&mut self.painted[tier]) {
                self.hit[tier].copy(&self.unpainted_hit[tier]);
                self.blocked[tier].copy(&self.unpainted_blocked[tier]);
            }
        }
    }

    /// Paints one tier, which has just been inflated or unpainted.
    pub(super) fn paint_tier(&mut self, tier: usize) {
        self.painted[tier] = !self.meetings.all.is_empty();
        if !self.painted[tier] {
            return;
        }
        self.unpainted_hit[tier].copy(&self.hit[tier]);
        self.unpainted_blocked[tier].copy(&self.blocked[tier]);
        let meetings = std::mem::take(&mut self.meetings);
        for meeting in &meetings.all {
            self.paint_meeting(tier, &meetings.from_m, meeting);
        }
        self.meetings = meetings;
    }

    fn paint_meeting(&mut self, tier: usize, from_m: &Vector3<f64>, meeting: &Meeting) {
        let PredictedCylinder {
            centre_m,
            radius_m,
            half_height_m,
        } = meeting.cylinder;
        let (reach_m, up_m) = (radius_m + self.radii_m[tier], half_height_m + self.radii_m[tier]);
        let corner = |side: f64| {
            let place = centre_m + Vector3::new(reach_m, reach_m, up_m) * side;
            self.cell_of(tier, &place)
        };
        let (low, high) = (corner(-1.0), corner(1.0));
        let min_cell = self.min_cell(tier);
        let [first_z, last_z] = [
            low[2].max(min_cell[2]),
            high[2].min(min_cell[2] + SIZE_Z as i32 - 1),
        ];
        let [first_x, last_x] = [
            low[0].max(min_cell[0]),
            high[0].min(min_cell[0] + SIZE_X as i32 - 1),
        ];
        let [nearest_m, farthest_m] = meeting.between_m;
        for y in low[1]..=high[1] {
            if !is_within(min_cell, [min_cell[0], y, min_cell[2]]) {
                continue;
            }
            let mut row = 0u128;
            for x in first_x..=last_x {
                let place = self.center_of(tier, [x, y, 0]);
                let away_m = (place - from_m).xy().norm();
                if (place - centre_m).xy().norm() < reach_m && (nearest_m..=farthest_m).contains(&away_m) {
                    row |= 1 << bit_of([x, y, 0]);
                }
            }
            for z in (first_z..=last_z).filter(|_| row != 0) {
                self.hit[tier].add_row([0, y, z], row);
                self.blocked[tier].add_row([0, y, z], row);
            }
        }
    }
}
