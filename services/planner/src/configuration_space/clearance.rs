//! The clearance that the vehicle needs: its footprint, and the standoff that collision prevention adds.

use crate::bit_layer::StructuringElement;
use jink_shared_types::params::{self, ParamSet};

/// Beyond this, CP_DIST is left to the guard (m): the map reaches 6 m at least.
const STANDOFF_MAX_M: f64 = 5.0;

/// The clearance that the vehicle needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Radius of the vehicle (m).
    pub vehicle_m: f64,
    /// Footprint: that radius and the error of the map (m).
    pub footprint_m: f64,
    /// Standoff: horizontal distance of its centre from obstacles at its height (m); zero and below: no more than the
    /// footprint.
    pub standoff_m: f64,
    /// Half height of the band that counts as the vehicle's height (m).
    pub band_half_m: f64,
}

impl Clearance {
    /// The clearance of the vehicle that `params` describe.
    pub fn from_params(params: &ParamSet) -> Self {
        Self {
            vehicle_m: params.get(&params::OA_VEH_RADIUS),
            footprint_m: params.get(&params::OA_VEH_RADIUS) + params.get(&params::OA_MAP_ERR),
            standoff_m: params.get(&params::CP_DIST).min(STANDOFF_MAX_M),
            band_half_m: params.get(&params::GD_BAND),
        }
    }

    /// What has to be free of obstacles around a reference that is followed within `tube_m`; `None` if the standoff is
    /// no more than the footprint.
    pub(super) fn standoff_element(&self, tube_m: f64) -> Option<StructuringElement> {
        (self.standoff_m > self.footprint_m).then(|| {
            StructuringElement::in_cylinder(
                self.footprint_m + tube_m,
                self.standoff_m + tube_m,
                self.band_half_m,
            )
        })
    }
}
