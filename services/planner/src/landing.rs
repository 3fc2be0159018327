//! Whether the place under a vehicle that lands is free, as far as the map knows: reported once per landing. The autopilot lands; the
//! planner looks for no other place.
//!
//! A place to land is level: the highest and the lowest of what is seen below the vehicle, column by column, are next to each other. A
//! post, a bush, the edge of a box or a roof, and a steep slope are not. What is not seen says nothing.

use super::Planner;
use jink_shared_types::events;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::map::{CELL_M, LocalMap, SIZE_Z, cell_of};
use jink_shared_types::params;
use jink_shared_types::vehicle::{NavMode, VehicleState};

/// So far beside the vehicle the place counts, too (m): a landing drifts by some decimetres.
const BESIDE_M: f64 = 0.8;
/// More than this from the lowest to the highest is not level (m): noise makes two cells of flat ground, a slope of ten degrees two more.
const LEVEL_M: f64 = 0.7;

impl Planner {
    /// Looks below a vehicle that the autopilot lands, once per map.
    pub(super) fn watch_landing(&mut self, state: &VehicleState, map: Option<&LocalMap>) {
        if state.mode != NavMode::Land || state.landed.is_set() || !state.armed.is_set() {
            self.landing_reported = false;
            return;
        }
        let radius_m = self.params.get(&params::OA_VEH_RADIUS) + BESIDE_M;
        let is_uneven = map.is_some_and(|map| unevenness_m(map, &state.position, radius_m) > LEVEL_M);
        if state.position_valid.is_set() && is_uneven && !self.landing_reported {
            self.landing_reported = true;
            self.report_event(&events::PLACE_NOT_FREE);
        }
    }
}

/// From the lowest to the highest of what is first seen below `place`, `radius_m` to each side (m); 0 if nothing is.
fn unevenness_m(map: &LocalMap, place: &Point<LocalNed>, radius_m: f64) -> f64 {
    let middle = cell_of(*place);
    let reach = (radius_m / CELL_M).round() as i32;
    let window_end = map.min_cell[2] + SIZE_Z as i32;
    let mut below = None;
    for north in -reach..=reach {
        for east in -reach..=reach {
            if north * north + east * east > reach * reach {
                continue;
            }
            let column = |down| [middle[0] + north, middle[1] + east, down];
            let first = (middle[2] + 1..window_end).find(|down| map.is_occupied(column(*down)));
            if let Some(down) = first {
                let (highest, lowest) = below.unwrap_or((down, down));
                below = Some((down.min(highest), down.max(lowest)));
            }
        }
    }
    below.map_or(0.0, |(highest, lowest)| f64::from(lowest - highest) * CELL_M)
}
