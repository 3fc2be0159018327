//! The sector ring: what the guard sees around the vehicle, 72 sectors of 5 degrees in the body's horizontal plane.

use crate::clock::Timestamp;
use crate::frames::{Attitude, LocalNed, Point};

/// Number of sectors.
pub const SECTORS: usize = 72;

/// Width of a sector (rad): 5 degrees.
pub const SECTOR_WIDTH_RAD: f64 = std::f64::consts::TAU / SECTORS as f64;

crate::sample! {
    /// Nearest obstacle per sector. Sector `i` is centred on `i * 5` degrees, clockwise from forward.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct SectorRing: 1216 {
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
        }
    }
}

/// The sector that holds the body-frame bearing `bearing_rad` (clockwise from forward, any turn).
pub fn sector_of(bearing_rad: f64) -> usize {
    let turns = (bearing_rad / SECTOR_WIDTH_RAD).round();
    (turns.rem_euclid(SECTORS as f64) as usize) % SECTORS
}

/// The bearing of a sector's centre (rad), 0 to 2 pi.
pub fn sector_bearing_rad(sector: usize) -> f64 {
    sector as f64 * SECTOR_WIDTH_RAD
}

#[cfg(test)]
mod tests {
    use super::{SECTOR_WIDTH_RAD, SECTORS, sector_bearing_rad, sector_of};

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
