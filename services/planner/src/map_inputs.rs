//! What the planner takes from the maps: known space, the field of view, detours, and how many sensors contribute.

use super::{Planner, PlannerInputs};
use crate::departure::Departure;
use crate::speed_tiers::{CRAWL_TIER, DEGRADED_TIER};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::far_map::{FAR_CELL_M, FarMap};
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::map::CELL_M;
use nalgebra::Vector3;

/// What is occupied so near beside a moving obstacle belongs to it (m): a cell, and what it has just left.
const MOVING_BESIDE_M: f64 = 0.2;
/// So far from the vehicle (m, to each side) the fine map shows what is too narrow: it reaches 64 cells from its middle, off which
/// the vehicle may be by four, and what is at its border has too little around it to be judged.
const NARROW_REACH_M: f64 = 55.0 * CELL_M;

impl Planner {
    /// Loads the map if it is new. Returns whether it is.
    pub(super) fn load_map(&mut self, inputs: &PlannerInputs<'_>) -> bool {
        let Some(map) = inputs.map.fresh() else {
            return false;
        };
        if map.header.publish == self.map_publish {
            return false;
        }
        self.map_publish = map.header.publish;
        self.planned_id = 0;
        self.space.load(map.sample);
        self.moving_hidden = false;
        self.view = map.view;
        true
    }

    /// Takes what moves out of the map, for those who predict it: a committed trajectory is blocked by what stands still,
    /// and who evades something must not be held by it.
    pub(super) fn hide_moving(&mut self) {
        self.space.unpaint();
        if !self.moving_hidden && !self.moving.is_empty() {
            self.moving_hidden = true;
            let now = self.moving.captured();
            self.space.remove_moving(self.moving.at(now), MOVING_BESIDE_M);
        }
    }

    /// The map as it is, for plans: a track may be wrong, and what it takes for moving stand still.
    pub(super) fn show_moving(&mut self, inputs: &PlannerInputs<'_>) {
        if let Some(map) = inputs.map.fresh().filter(|_| self.moving_hidden) {
            self.space.load(map.sample);
            self.moving_hidden = false;
        }
    }

    /// Updates the detours to `goal` from the far map, if there is one of the same epoch as the map: before a plan that
    /// cannot do without them, or in a cycle in which nothing else is to be done.
    pub(super) fn update_detours(
        &mut self,
        inputs: &PlannerInputs<'_>,
        departure: &Departure,
        goal: &Point<LocalNed>,
        is_due: bool,
    ) {
        let epoch = inputs.map.fresh().map(|map| map.sample.epoch);
        match inputs.far.fresh().filter(|far| Some(far.sample.epoch) == epoch) {
            Some(far) if !is_due && self.search.detours_mut().is_of(far.sample.epoch, goal) => {}
            Some(far) => {
                let here = &departure.state.position;
                if self.progress.is_stalled(departure.splice) {
                    self.learn_narrow(far.sample, here);
                }
                let sees_all_around = self.view.is_all_around();
                self.search.detours_mut().make(
                    far.sample,
                    far.header.publish.ns,
                    goal,
                    here,
                    sees_all_around,
                );
            }
            None => self.search.detours_mut().reset(),
        }
    }

    /// Remembers for the far map which of its cells around `here` the fine one has shown to be too narrow.
    fn learn_narrow(&mut self, far: &FarMap, here: &Point<LocalNed>) {
        self.space.prepare(CRAWL_TIER);
        let (space, down_m) = (&self.space, here.z_m);
        self.search
            .detours_mut()
            .too_narrow_mut()
            .learn(far, here, NARROW_REACH_M, |x_m, y_m| {
                let quarter_m = 0.25 * FAR_CELL_M;
                let is_hit = |off_m: [f64; 2]| {
                    let place = Vector3::new(x_m + off_m[0], y_m + off_m[1], down_m);
                    space.is_hit_at(CRAWL_TIER, &place)
                };
                [-quarter_m, quarter_m]
                    .into_iter()
                    .all(|x_m| is_hit([x_m, -quarter_m]) && is_hit([x_m, quarter_m]))
            });
    }

    /// What only one sensor has seen becomes old sooner where it does not look, so there is less time to stop.
    pub(super) fn update_top_tier(&mut self, live: u16) {
        let top_tier = if live < self.sensors { DEGRADED_TIER } else { 0 };
        if top_tier == self.top_tier {
            return;
        }
        self.top_tier = top_tier;
        let event = if top_tier > 0 {
            &events::SENSOR_LOST
        } else {
            &events::SENSOR_BACK
        };
        let numbers = [f64::from(live), f64::from(self.sensors)];
        self.events.push(EventSample::new(event, "planner", numbers));
    }
}
