//! Inflates the map for a speed tier: dilates its occupied and unknown cells by the clearance that the tier needs.

use super::ConfigurationSpace;
use super::cells::{cells_within, distance_squared_cells, per_cell};
use crate::bit_layer::StructuringElement;

impl ConfigurationSpace {
    /// Inflates the map for `tier`, once per map, and adds what moves. Before that nothing is safe in the tier and
    /// everything is a hit.
    pub fn prepare(&mut self, tier: usize) {
        if self.ready[tier] || !self.loaded {
            return;
        }
        self.ready[tier] = true;
        self.inflate(tier);
        self.paint_tier(tier);
    }

    fn inflate(&mut self, tier: usize) {
        if self.narrow_tier() == Some(tier) {
            self.prepare_narrow(tier);
            return;
        }
        if per_cell(tier) > 1 {
            self.prepare_halves(tier);
            return;
        }
        let element = &self.elements[tier];
        element.dilate(&self.not_free, &mut self.scratch, &mut self.blocked[tier]);
        let standoff_elements = self.standoff_elements[tier]
            .as_ref()
            .filter(|_| !self.is_inside_standoff);
        let body = standoff_elements.unwrap_or(element);
        body.dilate(&self.occupied, &mut self.scratch, &mut self.hit[tier]);
        if standoff_elements.is_some() {
            self.blocked[tier].add(&self.hit[tier]);
        }
        if tier == 0 {
            self.comfort
                .dilate(&self.hit[0], &mut self.scratch, &mut self.near);
            self.near_ready = true;
        }
    }

    /// Prepares the layers of half cells. The standoff is dilated on the map's cells: it is metres.
    fn prepare_halves(&mut self, tier: usize) {
        let min_half = self.min_half();
        let element = &self.elements[tier];
        self.halves.load_halves(&self.not_free, min_half);
        self.halves.close_shell(min_half);
        element.dilate(&self.halves, &mut self.scratch, &mut self.blocked[tier]);
        match self.standoff_elements[tier]
            .as_ref()
            .filter(|_| !self.is_inside_standoff)
        {
            Some(standoff_elements) => {
                standoff_elements.dilate(&self.occupied, &mut self.scratch, &mut self.halves);
                self.hit[tier].load_halves(&self.halves, min_half);
                self.blocked[tier].add(&self.hit[tier]);
            }
            None => {
                self.halves.load_halves(&self.occupied, min_half);
                element.dilate(&self.halves, &mut self.scratch, &mut self.hit[tier]);
            }
        }
    }

    /// Prepares a tier with the clearance that there is: unknown cells nearby, and occupied ones within the vehicle's
    /// radius, may stay as near as they are.
    fn prepare_narrow(&mut self, tier: usize) {
        let Some(narrow) = &self.narrow else {
            return;
        };
        let radius_m = self.radii_m[tier];
        let mut near = std::mem::take(&mut self.too_near);
        near.clear();
        self.unknown.copy(&self.not_free);
        self.unknown.remove(&self.occupied);
        self.other_occupied.copy(&self.occupied);
        for (cell, away_m) in cells_within(narrow.from, radius_m) {
            if self.contains(cell) && self.unknown.test(cell) {
                self.unknown.unset(cell);
                near.push((cell, radius_m));
            } else if self.is_occupied(cell) && away_m < self.clearance.vehicle_m {
                self.other_occupied.unset(cell);
                near.push((cell, self.clearance.vehicle_m));
            }
        }
        // Not the tier's own element, which may be one of half cells.
        StructuringElement::new(radius_m).dilate(&self.unknown, &mut self.scratch, &mut self.blocked[tier]);
        narrow
            .element
            .dilate(&self.other_occupied, &mut self.scratch, &mut self.hit[tier]);
        self.blocked[tier].add(&self.hit[tier]);
        for (cell, min_distance_m) in &near {
            let present_squared = distance_squared_cells(*cell, narrow.from);
            for (nearer, _) in cells_within(*cell, *min_distance_m) {
                if distance_squared_cells(*cell, nearer) < present_squared && self.contains(nearer) {
                    self.blocked[tier].set(nearer);
                }
            }
        }
        self.too_near = near;
    }
}
