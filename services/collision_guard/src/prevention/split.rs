//! PX4's response to the nearest obstacle: the parts along it and toward it are each scaled by the distance that is
//! left.
//!
//! Where PX4's response jumps, this one does not:
//!
//! | direction of the demand | PX4 | here |
//! |---|---|---|
//! | toward the nearest obstacle, at any angle below 90 degrees | part toward it by its distance, part along it by the obstacles there | same |
//! | 90 degrees and beyond | unscaled, whatever is there | by the obstacles there; unscaled where there are none; a transition of 15 degrees |
//! | the last half sector before one without data | unscaled | falls to zero at the border |
//! | the result leads where no data are | given | falls to zero at the border |

use super::config::PreventionConfig;
use super::laws::scale;
use super::sector_states::{SectorState, SectorStates};
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS, sector_bearing_rad};
use nalgebra::Vector2;

/// Sine of the angle over which the rule for "along" becomes the rule for "away": 15 degrees, three sectors.
const TRANSITION: f64 = 0.258_819;
/// A part of a unit vector shorter than this has no direction.
const NONE: f64 = 1e-7;

/// The inputs of splitting.
#[derive(Clone, Copy, Debug)]
pub struct Split<'a> {
    /// Parameters.
    pub config: &'a PreventionConfig,
    /// The sectors.
    pub sectors: &'a SectorStates,
    /// Distance to keep (m).
    pub keep_m: f64,
    /// Sectors into which motion is allowed although nothing is known of them.
    pub allowed_unseen: &'a [bool; SECTORS],
}

impl Split<'_> {
    /// The share of a demand for the unit vector `wanted` that may be given, as a vector not longer than two.
    pub fn share(&self, wanted: Vector2<f64>) -> Vector2<f64> {
        let covered = self.coverage(&wanted);
        let Some((nearest, reach_m)) = self.sectors.nearest() else {
            return wanted * covered;
        };
        if covered == 0.0 {
            return Vector2::zeros();
        }
        let toward = self.sectors.directions[nearest];
        let cosine = wanted.dot(&toward);
        let shared = if cosine > 0.0 {
            let normal = toward * cosine;
            let along = wanted - normal;
            along * self.along(&along) + normal * self.authority(reach_m)
        } else {
            let at_right_angles = self.along(&(wanted - toward * cosine));
            let away = self.straight(&wanted);
            let share = (-cosine / TRANSITION).min(1.0);
            wanted * (at_right_angles + share * (away - at_right_angles))
        };
        // The rest may point elsewhere after a part was removed.
        let covered = covered.min(self.coverage(&shared));
        shared * covered
    }

    /// Share of what leads along the nearest obstacle.
    fn along(&self, along: &Vector2<f64>) -> f64 {
        if along.norm() < NONE {
            return 0.0;
        }
        let sector = self.sectors.sector_toward(along);
        match self.sectors.states[sector].reach_m() {
            Some(reach_m) => self.authority(reach_m),
            None => 1.0,
        }
    }

    /// Share of a demand away from the nearest obstacle: between two sectors' centres, interpolated.
    fn straight(&self, wanted: &Vector2<f64>) -> f64 {
        let share = |sector: usize| match self.sectors.states[sector] {
            SectorState::Hit { distance_m, .. } => self.authority(distance_m),
            SectorState::Clear { .. } => 1.0,
            SectorState::Unknown => f64::from(u8::from(self.allowed_unseen[sector])),
        };
        let (before, after, part) = self.sectors.between(wanted);
        share(before) + part * (share(after) - share(before))
    }

    /// 1 inside what may be entered, falling to 0 over the last half sector before what may not, and 0 in there.
    pub fn coverage(&self, wanted: &Vector2<f64>) -> f64 {
        let may_enter = |sector: usize| {
            self.sectors.states[sector] != SectorState::Unknown || self.allowed_unseen[sector]
        };
        let sector = self.sectors.sector_toward(wanted);
        if !may_enter(sector) {
            return 0.0;
        }
        let aside_rad =
            jink_shared_types::frames::wrap_pi(self.sectors.bearing_rad(wanted) - sector_bearing_rad(sector));
        let next = if aside_rad < 0.0 { SECTORS - 1 } else { 1 };
        if may_enter((sector + next) % SECTORS) {
            return 1.0;
        }
        let half = 0.5 * SECTOR_WIDTH_RAD;
        ((half - aside_rad.abs()) / half).clamp(0.0, 1.0)
    }

    /// PX4's scale, but not below minus one.
    fn authority(&self, distance_m: f64) -> f64 {
        scale(self.config, self.keep_m, distance_m).max(-1.0)
    }
}
