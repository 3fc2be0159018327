//! A better direction nearby: PX4's choice, except for sectors without data.
//!
//! Every known sector within `CP_GUIDE_ANG` of the demanded one has a cost: the distances in it and on both sides of it
//! reduce it, the angle between them increases it. A sector without data is never chosen, and counts as an obstacle at
//! `CP_DIST` for its neighbours.

use super::config::PreventionConfig;
use super::sector_states::{SectorState, SectorStates};
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS};
use nalgebra::Vector2;

/// Weight of the angle: so many times CP_DIST (both m) for each sector aside.
const ASIDE: f64 = 0.5;
/// A sector of this cost (m) is never chosen.
const COST_MAX_M: f64 = 99.99;

/// The chosen direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuidedDirection {
    /// The demanded sector, counted as in PX4: it holds the angles from its centre up to the next one's.
    pub original: usize,
    /// The sector that is better, or the same.
    pub sector: usize,
    /// Unit vector, north and east: the centre of a sector that was chosen instead, otherwise the demanded direction to
    /// the bit.
    pub direction: Vector2<f64>,
}

/// The best direction for the demanded direction `wanted` (a unit vector).
pub fn guide(config: &PreventionConfig, sectors: &SectorStates, wanted: Vector2<f64>) -> GuidedDirection {
    let turns = (sectors.bearing_rad(&wanted) / SECTOR_WIDTH_RAD).rem_euclid(SECTORS as f64);
    let original = turns as usize % SECTORS;
    // Angles are configured in whole degrees: a rounding error must not take a sector away.
    let steps = (config.guide_rad / SECTOR_WIDTH_RAD + 1e-6) as usize;
    let steps = steps.min(SECTORS / 2 - 1);
    let mut best = (COST_MAX_M, original);
    for k in 0..=2 * steps {
        let sector = (original + SECTORS + k - steps) % SECTORS;
        let Some(reach_m) = sectors.states[sector].reach_m() else {
            continue;
        };
        let aside = k.abs_diff(steps) as f64;
        let mean_m = mean_m(config, sectors, sector);
        let cost_m = ASIDE * config.distance_m * aside - mean_m - reach_m;
        if cost_m < best.0 {
            best = (cost_m, sector);
        }
    }
    GuidedDirection {
        original,
        sector: best.1,
        direction: if best.1 == original {
            wanted
        } else {
            sectors.directions[best.1]
        },
    }
}

fn mean_m(config: &PreventionConfig, sectors: &SectorStates, sector: usize) -> f64 {
    let reach_m = |sector: usize| match sectors.states[sector % SECTORS] {
        SectorState::Unknown => config.distance_m,
        known => known.reach_m().unwrap_or(config.distance_m),
    };
    (reach_m(sector + SECTORS - 1) + reach_m(sector) + reach_m(sector + 1)) / 3.0
}
