//! The sector ring: what the guard sees around the vehicle, 72 sectors of 5 degrees in the body's horizontal plane.

use crate::clock::Timestamp;
use crate::frames::{Attitude, LocalNed, Point};
use crate::reserved::Reserved;

/// Number of sectors.
pub const SECTORS: usize = 72;

/// Width of a sector (rad): 5 degrees.
pub const SECTOR_WIDTH_RAD: f64 = std::f64::consts::TAU / SECTORS as f64;

/// Bearing of the centre of sector 0 (rad), clockwise from forward.
pub const SECTOR_0_RAD: f64 = 0.0;

crate::sample! {
    /// Nearest obstacle per sector. Sector `i` is centred on `i * 5` degrees, clockwise from forward.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct SectorRing: 1248 {
        /// Where the vehicle was.
        pub position: Point<LocalNed>,
        /// Its attitude; sectors turn with its heading and stay level.
        pub attitude: Attitude,
        /// Horizontal distance to the nearest obstacle (m); infinity = nothing up to `range_max_m`; NaN = unknown.
        pub distance_m: [f32; SECTORS],
        /// How far the sensor of this sector sees (m); 0 while unknown.
        pub range_max_m: [f32; SECTORS],
        /// When the sector was last measured.
        pub seen: [Timestamp; SECTORS],
        /// Shortest range that any contributing sensor measures (m).
        pub range_min_m: f32,
        /// Half height of the band around the vehicle that counts (m).
        pub band_half_m: f32,
        /// Room for later fields, zero.
        pub reserved: Reserved<32>,
    }
    means { SECTOR_WIDTH_RAD: f64, SECTOR_0_RAD: f64 }
    plausible if Self::is_consistent
}

impl SectorRing {
    /// Whether it says from where and in which directions it was seen, and its distances are some; a NaN distance is
    /// unknown.
    pub fn is_consistent(&self) -> bool {
        let is_length = |m: &f32| m.is_finite() && *m >= 0.0;
        self.position.is_finite()
            && self.attitude.is_rotation()
            && is_length(&self.range_min_m)
            && is_length(&self.band_half_m)
            && self.distance_m.iter().all(|m| m.is_nan() || *m >= 0.0)
            && self.range_max_m.iter().all(is_length)
    }
}

impl Default for SectorRing {
    fn default() -> Self {
        Self {
            position: Point::ZERO,
            attitude: Attitude::default(),
            distance_m: [f32::NAN; SECTORS],
            range_max_m: [0.0; SECTORS],
            seen: [Timestamp::NEVER; SECTORS],
            range_min_m: 0.0,
            band_half_m: 0.0,
            reserved: Reserved::ZERO,
        }
    }
}

/// The sector that holds the body-frame bearing `bearing_rad` (clockwise from forward, any turn).
pub fn sector_of(bearing_rad: f64) -> usize {
    let turns = ((bearing_rad - SECTOR_0_RAD) / SECTOR_WIDTH_RAD).round();
    (turns.rem_euclid(SECTORS as f64) as usize) % SECTORS
}

/// The bearing of a sector's centre (rad), 0 to 2 pi.
pub fn sector_bearing_rad(sector: usize) -> f64 {
    SECTOR_0_RAD + sector as f64 * SECTOR_WIDTH_RAD
}

/// The sectors that an arc touches, clockwise, each once: from `from_rad` on, `width_rad` wide (a whole turn at most; no width is one
/// direction). None if either is no finite number.
pub fn sectors_of_arc(from_rad: f64, width_rad: f64) -> impl Iterator<Item = usize> {
    let width_rad = width_rad.clamp(0.0, std::f64::consts::TAU);
    let first = ((from_rad - SECTOR_0_RAD) / SECTOR_WIDTH_RAD).round();
    let last = ((from_rad - SECTOR_0_RAD + width_rad) / SECTOR_WIDTH_RAD).round();
    let count = if (last - first).is_finite() {
        (last - first) as usize + 1
    } else {
        0
    };
    let first = first.rem_euclid(SECTORS as f64) as usize;
    (0..count.min(SECTORS)).map(move |step| (first + step) % SECTORS)
}

#[cfg(test)]
mod tests {
    use super::{SECTOR_WIDTH_RAD, SECTORS, sector_bearing_rad, sector_of, sectors_of_arc};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn an_arc_touches_the_sectors_of_all_its_directions_and_no_other(
            from_rad in -20.0..20.0f64, width_rad in 0.0..7.0f64,
        ) {
            let touched: Vec<usize> = sectors_of_arc(from_rad, width_rad).collect();
            let width_rad = width_rad.min(std::f64::consts::TAU);
            let mut expected = [false; SECTORS];
            for step in 0..=10_000 {
                expected[sector_of(from_rad + width_rad * f64::from(step) / 10_000.0)] = true;
            }
            for (sector, is_expected) in expected.into_iter().enumerate() {
                let count = touched.iter().filter(|touched| **touched == sector).count();
                prop_assert!(count <= 1, "sector {sector} comes {count} times");
                // An arc that reaches less than a step into a sector is missed by the steps.
                prop_assert!(count == 1 || !is_expected, "sector {sector} is missing");
                let middle_rad = sector_bearing_rad(sector);
                let past_rad = (middle_rad - from_rad).rem_euclid(std::f64::consts::TAU);
                let half_rad = 0.5 * SECTOR_WIDTH_RAD;
                let is_far = past_rad > width_rad + half_rad + 1e-9
                    && past_rad < std::f64::consts::TAU - half_rad - 1e-9;
                prop_assert!(count == 0 || !is_far, "sector {sector} is not in it");
            }
        }
    }

    #[test]
    fn an_arc_that_is_no_number_touches_nothing() {
        assert_eq!(sectors_of_arc(f64::NAN, 1.0).count(), 0);
        assert_eq!(sectors_of_arc(f64::INFINITY, 1.0).count(), 0);
        assert_eq!(sectors_of_arc(0.0, f64::NAN).count(), 0);
        assert_eq!(sectors_of_arc(3.0, f64::INFINITY).count(), SECTORS);
    }

    #[test]
    fn a_sector_holds_its_own_centre_and_the_seam_is_round() {
        for sector in 0..SECTORS {
            assert_eq!(sector_of(sector_bearing_rad(sector)), sector);
            assert_eq!(
                sector_of(sector_bearing_rad(sector) - std::f64::consts::TAU),
                sector
            );
        }
        assert_eq!(sector_of(-0.4 * SECTOR_WIDTH_RAD), 0);
        assert_eq!(sector_of(-0.6 * SECTOR_WIDTH_RAD), SECTORS - 1);
    }
}
