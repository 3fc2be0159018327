//! Cells as numbers: the bit of a cell in a flat plane.
//!
//! A flat plane has one bit per cell, x fastest, then y, then z, either by the global index modulo the size (as in
//! `shared_types::map`, for everything that outlives a frame) or by the offset from the window's smallest cell (within
//! one frame, where a step to a neighbour is then one addition).

use jink_shared_types::map::{Cell, SIZE_X, SIZE_Y, SIZE_Z};

/// Cells per axis.
pub(crate) const SIZE: [i32; 3] = [SIZE_X as i32, SIZE_Y as i32, SIZE_Z as i32];

/// Words of 64 cells in a plane.
pub(crate) const WORDS: usize = SIZE_X * SIZE_Y * SIZE_Z / 64;

/// One bit per cell of the window, x fastest.
pub(crate) type BitPlane = [u64; WORDS];

/// Distance in a plane between neighbours along each axis.
pub(crate) const STRIDE: [i64; 3] = [1, SIZE_X as i64, (SIZE_X * SIZE_Y) as i64];

/// An all-zero plane on the heap.
pub(crate) fn plane() -> Box<BitPlane> {
    jink_shared_types::sample::zeroed_box()
}

/// The offset of `cell` from `min_cell` per axis, if that is inside the window.
pub(crate) fn offset_in(min_cell: Cell, cell: Cell) -> Option<[i32; 3]> {
    // A window's corner is a plausible position: the difference wraps only for cells far away.
    let offset = [0, 1, 2].map(|axis| cell[axis].wrapping_sub(min_cell[axis]));
    let inside = (0..3).all(|axis| (offset[axis] as u32) < SIZE[axis] as u32);
    inside.then_some(offset)
}

/// The number in a flat plane of the cell at `offset`, which is inside.
#[inline]
pub(crate) fn number(offset: [i32; 3]) -> usize {
    (offset[0] + (offset[1] + offset[2] * SIZE[1]) * SIZE[0]) as usize
}

/// The positions of the set bits of `word`, lowest first.
pub(crate) fn bits(mut word: u64) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        let bit = word.trailing_zeros();
        // For the empty word this changes nothing and the position is 64.
        word &= word.wrapping_sub(1);
        (bit < 64).then_some(bit)
    })
}

#[cfg(test)]
mod tests {
    use super::{SIZE, bits, number, offset_in};
    use jink_shared_types::map::{LocalMap, SIZE_X, bit_of, row_of};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_layout_is_that_of_the_shared_map(cell in prop::array::uniform3(-100_000..100_000i32)) {
            let modulo = [0, 1, 2].map(|axis| cell[axis] & (SIZE[axis] - 1));
            prop_assert_eq!(number(modulo), row_of(cell) * SIZE_X + bit_of(cell) as usize);
        }

        #[test]
        fn inside_means_the_same_as_for_the_shared_map(
            min_cell in prop::array::uniform3(-300..300i32),
            cell in prop::array::uniform3(-300..300i32),
        ) {
            let mut map = LocalMap::boxed();
            map.min_cell = min_cell;
            prop_assert_eq!(offset_in(min_cell, cell).is_some(), map.contains(cell));
        }

        #[test]
        fn every_set_bit_is_named_once(word in any::<u64>()) {
            prop_assert_eq!(bits(word).fold(0, |sum, bit| sum | 1u64 << bit), word);
            prop_assert_eq!(bits(word).count(), word.count_ones() as usize);
        }
    }

    #[test]
    fn sizes_are_powers_of_two() {
        assert!(SIZE.iter().all(|size| size.count_ones() == 1));
    }
}
