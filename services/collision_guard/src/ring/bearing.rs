//! Which sector a horizontal direction belongs to, in a few multiplications and without a branch, so that the compiler
//! can process four points at a time.
//!
//! Sectors are divided into four slots. Nearest hits are kept per slot: at the stopping distance a sector is so wide
//! that its nearest hit says little of where the obstacle ends sideways.

use jink_shared_types::ring::SECTORS;
use std::f32::consts::{FRAC_PI_2, PI};

/// Slots per sector. A slot of 1.25 degrees is 9 cm wide at 4 m, about the guard's margin; twice as many would be finer
/// than the rays of many lidars are apart.
pub const SLOTS_PER_SECTOR: usize = 4;
/// Slots all around.
pub const SLOTS: usize = SECTORS * SLOTS_PER_SECTOR;
/// Bins of an accumulator: slots counted from straight ahead, to the left in two's complement, so a power of two. The
/// slots of the sector straight behind have two bins each.
pub const BINS: usize = 512;
/// Bins of an accumulator with one bin per sector.
pub const SECTOR_BINS: usize = BINS / SLOTS_PER_SECTOR;

/// Adding it to a small number moves the number, rounded, into the low bits of the sum: 1.5 * 2^23.
const ROUNDING: f32 = 12_582_912.0;

/// Bearing of `(forward, right)`, clockwise from forward, in units of sectors (5 degrees), -36 to 36. A zero vector
/// points forward. The arc tangent is the polynomial of Abramowitz and Stegun 4.4.47: its error of at most 1e-5 rad is
/// a 9000th of a sector.
#[inline(always)]
pub fn bearing_sectors(forward: f32, right: f32) -> f32 {
    let (ahead, aside) = (forward.abs(), right.abs());
    let steep = ahead < aside;
    let (small, large) = if steep { (ahead, aside) } else { (aside, ahead) };
    let slope = small / (large + f32::MIN_POSITIVE);
    let s = slope * slope;
    let series = ((0.020_835_1 * s - 0.085_133_0) * s + 0.180_141) * s - 0.330_299_5;
    let octant = (series * s + 0.999_866) * slope;
    let quadrant = if steep { FRAC_PI_2 - octant } else { octant };
    let half_turn = if forward < 0.0 { PI - quadrant } else { quadrant };
    let angle = if right < 0.0 { -half_turn } else { half_turn };
    angle * (SECTORS as f32 / (2.0 * PI))
}

/// The accumulator bin of a bearing in units of sectors; anything for NaN, but always below [`BINS`].
#[inline(always)]
pub fn bin_of(bearing_sectors: f32) -> u32 {
    // A sector reaches half a sector to either side of its bearing: its four slots are centred -3/8, -1/8, 1/8, 3/8
    // off.
    let slot = SLOTS_PER_SECTOR as f32 * bearing_sectors + 1.5;
    (slot + ROUNDING).to_bits() & (BINS as u32 - 1)
}

/// The bin of the sector that holds `bin`.
#[inline(always)]
pub fn sector_bin(bin: usize) -> usize {
    bin / SLOTS_PER_SECTOR % SECTOR_BINS
}

/// The sector of a sector's bin.
#[inline(always)]
pub fn sector_of_bin(sector_bin: usize) -> usize {
    // Bins 37..=91 belong to no direction; they only come from NaN, whose values are never used.
    let sector = if sector_bin >= SECTOR_BINS / 2 {
        sector_bin.saturating_sub(SECTOR_BINS - SECTORS)
    } else {
        sector_bin
    };
    sector.min(SECTORS - 1)
}

/// The slot of a bin.
pub fn slot_of_bin(bin: usize) -> usize {
    sector_of_bin(sector_bin(bin)) * SLOTS_PER_SECTOR + bin % SLOTS_PER_SECTOR
}

/// The sector of a horizontal direction given as forward and right components of the frame that the sectors turn with.
#[inline(always)]
pub fn sector_toward(forward: f32, right: f32) -> usize {
    sector_of_bin(sector_bin(bin_of(bearing_sectors(forward, right)) as usize))
}

#[cfg(test)]
mod tests {
    use super::{SLOTS, bearing_sectors, bin_of, sector_bin, sector_of_bin, sector_toward, slot_of_bin};
    use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS, sector_bearing_rad, sector_of};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_fast_sector_is_the_contract_s_sector(bearing in -7.0..7.0f64, range in 1e-3..1e4f64) {
            let to_border = ((bearing / SECTOR_WIDTH_RAD).rem_euclid(1.0) - 0.5).abs();
            prop_assume!(to_border > 5e-4);
            let (right, forward) = bearing.sin_cos();
            prop_assert_eq!(sector_toward((forward * range) as f32, (right * range) as f32), sector_of(bearing));
        }

        #[test]
        fn no_number_leads_outside_the_ring(forward in any::<f32>(), right in any::<f32>()) {
            prop_assert!(sector_toward(forward, right) < SECTORS);
        }
    }

    #[test]
    fn slots_are_counted_clockwise_and_each_lies_in_its_sector() {
        for slot in 0..SLOTS {
            let bearing = (slot as f32 - 1.5) / 4.0 * SECTOR_WIDTH_RAD as f32;
            let bin = bin_of(bearing_sectors(bearing.cos(), bearing.sin())) as usize;
            assert_eq!(slot_of_bin(bin), slot);
            assert_eq!(sector_of_bin(sector_bin(bin)), slot / 4);
        }
    }

    #[test]
    fn both_sides_of_straight_back_are_one_sector() {
        assert_eq!(sector_toward(-5.0, 0.01), SECTORS / 2);
        assert_eq!(sector_toward(-5.0, -0.01), SECTORS / 2);
        for sector in 0..SECTORS {
            let (right, forward) = sector_bearing_rad(sector).sin_cos();
            assert_eq!(sector_toward(forward as f32, right as f32), sector);
        }
    }
}
