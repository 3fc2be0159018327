//! The sliding window: evidence per cell, and the planes that follow from it.
//!
//! | in | out |
//! |---|---|
//! | the vehicle's cell; the hit and free bits of one frame | the planes `occupied` and `known` |
//!
//! Evidence is a saturating log-odds number per cell (Moravec and Elfes, "High resolution maps from wide angle sonar",
//! 1985; in the additive, clamped form of Yguel, Aycard and Laugier, 2007), in units of one miss. It is applied once
//! per frame, whatever the number of rays through a cell, so that a dense sensor does not outweigh a sparse one. Cells
//! are addressed by their global index modulo the size; the window slides by clearing the cells that enter.

use crate::cells::{BitPlane, SIZE, bits, number, offset_in, plane};
use crate::frame_bits::FrameBits;
use jink_shared_types::map::{Cell, LocalMap, Plane, SIZE_X, SIZE_Y, SIZE_Z};

/// Cells per window.
const CELLS: usize = SIZE_X * SIZE_Y * SIZE_Z;

/// Evidence of a frame in which rays passed through the cell and none ended in it: the unit.
const MISS: i8 = 1;

/// Evidence of a frame in which a ray ended in the cell. With [`FREE_FLOOR`] it leaves 7: one hit makes even the best
/// known free cell occupied, and six frames in a row whose rays pass through it do not undo that. A wire that is hit in
/// one frame of seven therefore never disappears, and a false hit in open space is gone after 0.7 s at 10 Hz.
const HIT: i8 = 8;

/// Lower bound of the evidence: one miss, because a cell that was free for a minute is no safer from something moving
/// in than one that was free once. It also settles a cell with its first miss, so that most of a frame's free cells are
/// excluded by one mask.
const FREE_FLOOR: i8 = -MISS;

/// Upper bound of the evidence: a removed obstacle is cleared after this many frames whose rays pass through its place
/// (1.2 s at 10 Hz). A higher value would keep moved obstacles, a lower one lose wires in rain.
const OCCUPIED_CEILING: i8 = 12;

/// How far (cells) the middle of the window may be off its place before the window follows: a hovering vehicle moves nothing.
const HYSTERESIS: i32 = 4;

/// The window. See the module's text.
pub(crate) struct MapWindow {
    pub(crate) min_cell: Cell,
    pub(crate) evidence: Box<[i8; CELLS]>,
    pub(crate) occupied: Box<BitPlane>,
    pub(crate) known: Box<BitPlane>,
    /// Cells that are known by declarations of the user alone.
    pub(crate) declared: Box<BitPlane>,
    /// Cells at [`FREE_FLOOR`], which further misses do not change: most of a map after some frames.
    pub(crate) settled: Box<BitPlane>,
}

impl MapWindow {
    /// An all-unknown window around the local origin.
    pub fn new() -> Self {
        Self {
            min_cell: centred_on([0; 3]),
            evidence: zeroed_evidence(),
            occupied: plane(),
            known: plane(),
            declared: plane(),
            settled: plane(),
        }
    }

    /// Smallest global index inside, per axis.
    pub fn min_cell(&self) -> Cell {
        self.min_cell
    }

    /// Makes every cell unknown.
    pub fn clear(&mut self) {
        self.evidence.fill(0);
        self.occupied.fill(0);
        self.known.fill(0);
        self.declared.fill(0);
        self.settled.fill(0);
    }

    /// Whether `cell`, which lies inside, was seen occupied.
    pub fn is_occupied(&self, cell: Cell) -> bool {
        let modulo = [0, 1, 2].map(|axis| cell[axis] & (SIZE[axis] - 1));
        let number = number(modulo);
        offset_in(self.min_cell, cell).is_some() && (self.occupied[number >> 6] >> (number & 63)) & 1 == 1
    }

    /// Whether `cell` is known to be free by measurement; outside nothing is.
    pub fn is_free(&self, cell: Cell) -> bool {
        let number = number([0, 1, 2].map(|axis| cell[axis] & (SIZE[axis] - 1)));
        let (word, bit) = (number >> 6, number & 63);
        let measured = self.known[word] & !self.occupied[word] & !self.declared[word];
        offset_in(self.min_cell, cell).is_some() && (measured >> bit) & 1 == 1
    }

    /// Makes `cell` unknown, or free if it `was_free`; nothing outside the window.
    pub fn withdraw(&mut self, cell: Cell, was_free: bool) {
        if offset_in(self.min_cell, cell).is_some() {
            let number = number([0, 1, 2].map(|axis| cell[axis] & (SIZE[axis] - 1)));
            self.clear_cells(number, 1);
            if was_free {
                self.apply_word(number >> 6, 0, 1 << (number & 63));
            }
        }
    }

    /// Whether the window has to slide to have its middle at `middle`.
    pub fn must_follow(&self, middle: Cell) -> bool {
        let targets = centred_on(middle).into_iter().zip(self.min_cell);
        targets
            .into_iter()
            .any(|(target, min)| (target - min).abs() > HYSTERESIS)
    }

    /// Slides so that `middle` is in the middle of every axis on which it is off by more than [`HYSTERESIS`].
    pub fn follow(&mut self, middle: Cell) {
        for (axis, target) in centred_on(middle).into_iter().enumerate() {
            let shift = target - self.min_cell[axis];
            if shift.abs() > HYSTERESIS {
                self.slide(axis, shift);
            }
        }
    }

    fn slide(&mut self, axis: usize, shift: i32) {
        let old_min = self.min_cell[axis];
        self.min_cell[axis] += shift;
        let entering = shift.abs().min(SIZE[axis]);
        // Entering from above: the indices after the old end, which are the last ones of the new window.
        let first = if shift > 0 {
            old_min + shift + SIZE[axis] - entering
        } else {
            old_min + shift
        };
        for index in first..first + entering {
            self.clear_layer(axis, index);
        }
    }

    /// Makes the layer of cells with global index `index` on `axis` unknown.
    fn clear_layer(&mut self, axis: usize, index: i32) {
        let local = (index & (SIZE[axis] - 1)) as usize;
        match axis {
            0 => (0..SIZE_Y * SIZE_Z).for_each(|row| self.clear_cells(row * SIZE_X + local, 1)),
            1 => (0..SIZE_Z).for_each(|z| self.clear_cells((z * SIZE_Y + local) * SIZE_X, SIZE_X)),
            _ => self.clear_cells(local * SIZE_Y * SIZE_X, SIZE_Y * SIZE_X),
        }
    }

    /// Makes one cell, or `count` (a multiple of 64) cells from a word's start, unknown.
    fn clear_cells(&mut self, first: usize, count: usize) {
        self.evidence[first..first + count].fill(0);
        for bits in [
            &mut self.occupied,
            &mut self.known,
            &mut self.declared,
            &mut self.settled,
        ] {
            if count == 1 {
                bits[first >> 6] &= !(1 << (first & 63));
            } else {
                bits[first >> 6..(first + count) >> 6].fill(0);
            }
        }
    }

    /// Adds the evidence of one frame, made for this window's position: a hit cell is never counted free.
    pub fn apply(&mut self, frame: &FrameBits) {
        let [turn_x, first_y, first_z] = [0, 1, 2].map(|axis| self.min_cell[axis] & (SIZE[axis] - 1));
        for z in 0..SIZE[2] {
            for y in 0..SIZE[1] {
                let from = number([0, y, z]) >> 6;
                let hit = row(&frame.hit, from);
                let free = row(&frame.free, from) & !hit;
                let (band_hit, band_free) = (row(&frame.band_hit, from), row(&frame.band_free, from));
                if hit | free | band_hit | band_free == 0 {
                    continue;
                }
                let into = [0, (y + first_y) & (SIZE[1] - 1), (z + first_z) & (SIZE[2] - 1)];
                let [hit, free, band_hit, band_free] =
                    [hit, free, band_hit, band_free].map(|bits| bits.rotate_left(turn_x as u32));
                let word = number(into) >> 6;
                for (word, shift) in [(word, 0), (word + 1, 64)] {
                    let half = |bits: u128| (bits >> shift) as u64;
                    self.apply_measured(word, half(hit), half(free));
                    self.apply_declared(word, half(band_hit), half(band_free));
                }
            }
        }
    }

    /// Applies measurements: cells known by declarations alone start again with them.
    fn apply_measured(&mut self, word: usize, hit: u64, free: u64) {
        let renewed = self.declared[word] & (hit | free);
        if renewed != 0 {
            for bit in bits(renewed) {
                self.evidence[word << 6 | bit as usize] = 0;
            }
            self.declared[word] &= !renewed;
            self.occupied[word] &= !renewed;
            self.settled[word] &= !renewed;
        }
        self.apply_word(word, hit, free);
    }

    /// Applies declarations, where nothing was measured.
    fn apply_declared(&mut self, word: usize, hit: u64, free: u64) {
        let open = !self.known[word] | self.declared[word];
        let (hit, free) = (hit & open, free & open);
        self.declared[word] |= hit | free;
        self.apply_word(word, hit, free);
    }

    /// Declares `cell` free if it is unknown; nothing outside the window.
    pub fn declare_free(&mut self, cell: Cell) {
        if offset_in(self.min_cell, cell).is_none() {
            return;
        }
        let number = number([0, 1, 2].map(|axis| cell[axis] & (SIZE[axis] - 1)));
        let (word, bit) = (number >> 6, 1 << (number & 63));
        if self.known[word] & bit == 0 {
            self.apply_declared(word, 0, bit);
        }
    }

    fn apply_word(&mut self, word: usize, hit: u64, free: u64) {
        self.known[word] |= hit | free;
        for bit in bits(free & !self.settled[word]) {
            self.miss(word, bit);
        }
        for bit in bits(hit) {
            let evidence = &mut self.evidence[word << 6 | bit as usize];
            *evidence = (*evidence + HIT).min(OCCUPIED_CEILING);
        }
        // One hit outweighs the lowest possible evidence (see FREE_FLOOR).
        self.occupied[word] |= hit;
        self.settled[word] &= !hit;
    }

    fn miss(&mut self, word: usize, bit: u32) {
        let evidence = &mut self.evidence[word << 6 | bit as usize];
        *evidence = (*evidence - MISS).max(FREE_FLOOR);
        if *evidence <= 0 {
            self.occupied[word] &= !(1 << bit);
        }
        if *evidence == FREE_FLOOR {
            self.settled[word] |= 1 << bit;
        }
    }

    /// Cell number `into` now covers a part of its own and a part of cell number `from`, or of one outside: it is
    /// occupied if either is, with the stronger evidence, and known only if both are.
    pub(crate) fn merge_cell(&mut self, into: usize, from: Option<usize>) {
        let is_set = |bits: &BitPlane, cell: usize| (bits[cell >> 6] >> (cell & 63)) & 1 == 1;
        let of = |cell: usize| {
            (
                is_set(&self.known, cell),
                is_set(&self.declared, cell),
                self.evidence[cell],
            )
        };
        let (known, declared, evidence) = of(into);
        let (from_known, from_declared, from_evidence) = from.map_or((false, false, 0), of);
        if !known && !from_known {
            return;
        }
        let strongest = evidence.max(from_evidence);
        let is_known = strongest > 0 || (known && from_known);
        let evidence = if is_known { strongest } else { 0 };
        let mut put = |bits: fn(&mut Self) -> &mut BitPlane, value: bool| {
            let word = &mut bits(self)[into >> 6];
            *word = (*word & !(1 << (into & 63))) | (u64::from(value) << (into & 63));
        };
        put(|window| &mut *window.known, is_known);
        put(|window| &mut *window.occupied, evidence > 0);
        put(
            |window| &mut *window.declared,
            is_known && (declared || from_declared),
        );
        put(|window| &mut *window.settled, is_known && evidence == FREE_FLOOR);
        self.evidence[into] = evidence;
    }

    /// Copies the planes out; returns how many cells are occupied and how many known.
    ///
    /// Nothing hangs from above in the layers of cells `no_overhang` (smallest and largest global index, z counts
    /// downwards): where a cell is free there, those above it up to the last layer are declared free, unless something
    /// was seen there.
    pub fn write(&self, out: &mut LocalMap, no_overhang: Option<[i32; 2]>) -> (u32, u32) {
        let occupied = copy_plane(&self.occupied, &mut out.occupied);
        let known = copy_plane(&self.known, &mut out.known);
        copy_plane(&self.declared, &mut out.declared);
        let declared = no_overhang.map_or(0, |layers| self.declare_no_overhang(out, layers));
        (occupied, known + declared)
    }
}

const _: () = assert!(FREE_FLOOR + HIT > 6 * MISS, "a hit cell must survive six misses");

/// The row of 128 cells that starts at `word`.
pub(crate) fn row(bits: &BitPlane, word: usize) -> u128 {
    u128::from(bits[word]) | u128::from(bits[word + 1]) << 64
}

fn copy_plane(from: &BitPlane, to: &mut Plane) -> u32 {
    let mut cells = 0;
    for (words, row) in from.chunks_exact(2).zip(to.iter_mut()) {
        *row = [words[0], words[1]];
        cells += words[0].count_ones() + words[1].count_ones();
    }
    cells
}

fn centred_on(middle: Cell) -> Cell {
    [0, 1, 2].map(|axis| middle[axis] - SIZE[axis] / 2)
}

fn zeroed_evidence() -> Box<[i8; CELLS]> {
    jink_shared_types::sample::zeroed_box()
}

#[cfg(test)]
mod tests {
    use super::{FREE_FLOOR, HIT, HYSTERESIS, MISS, MapWindow, OCCUPIED_CEILING};
    use crate::cells::{SIZE, number, offset_in};
    use crate::frame_bits::FrameBits;
    use jink_shared_types::map::{Cell, LocalMap};
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    /// The same map in a slow implementation: a sorted list of known cells, everything else is unknown.
    struct Naive {
        min_cell: Cell,
        evidence: BTreeMap<Cell, i8>,
    }

    impl Naive {
        fn follow(&mut self, vehicle: Cell) {
            for axis in 0..3 {
                let centred = vehicle[axis] - SIZE[axis] / 2;
                if (centred - self.min_cell[axis]).abs() > HYSTERESIS {
                    self.min_cell[axis] = centred;
                }
            }
            let min_cell = self.min_cell;
            self.evidence
                .retain(|cell, _| offset_in(min_cell, *cell).is_some());
        }

        fn apply(&mut self, hits: &[Cell], frees: &[Cell]) {
            for cell in frees.iter().filter(|cell| !hits.contains(cell)) {
                let evidence = self.evidence.entry(*cell).or_default();
                *evidence = (*evidence - MISS).max(FREE_FLOOR);
            }
            for cell in hits {
                let evidence = self.evidence.entry(*cell).or_default();
                *evidence = (*evidence + HIT).min(OCCUPIED_CEILING);
            }
        }
    }

    fn set_all(frame: &mut FrameBits, min_cell: Cell, hits: &[Cell], frees: &[Cell]) {
        frame.begin(min_cell);
        for cell in hits {
            let number = number(offset_in(min_cell, *cell).unwrap());
            frame.hit[number >> 6] |= 1 << (number & 63);
        }
        for cell in frees {
            frame.mark_free(*cell);
        }
    }

    fn assert_same(window: &MapWindow, naive: &Naive, map: &mut LocalMap) {
        map.min_cell = window.min_cell();
        let (occupied, known) = window.write(map, None);
        assert_eq!(map.min_cell, naive.min_cell);
        assert_eq!(known as usize, naive.evidence.len());
        let occupied_naive = naive.evidence.values().filter(|evidence| **evidence > 0).count();
        assert_eq!(occupied as usize, occupied_naive);
        for (cell, evidence) in &naive.evidence {
            assert_eq!(map.is_occupied(*cell), *evidence > 0, "{cell:?}");
            assert_eq!(map.is_free(*cell), *evidence <= 0, "{cell:?}");
            assert_eq!(window.is_occupied(*cell), *evidence > 0, "{cell:?}");
        }
    }

    /// A step of the vehicle, mostly small; offsets (modulo the window) of hit and of free cells. Few different cells,
    /// so that evidence piles up.
    fn scene() -> impl Strategy<Value = (Cell, Vec<Cell>, Vec<Cell>)> {
        let step = prop_oneof![4 => -9..9i32, 1 => -200..200i32];
        let offset = (0..6i32, 0..6i32, 0..6i32).prop_map(|(x, y, z)| [x * 25, y * 25, z * 12]);
        let cells = prop::collection::vec(offset, 0..60);
        (prop::array::uniform3(step), cells.clone(), cells)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn sliding_keeps_what_stays_and_forgets_what_enters(scenes in prop::collection::vec(scene(), 1..25)) {
            let mut window = MapWindow::new();
            let mut frame = FrameBits::new();
            let mut naive = Naive { min_cell: window.min_cell(), evidence: BTreeMap::new() };
            let mut map = LocalMap::boxed();
            let mut vehicle = [0, 0, 0];
            for (step, hits, frees) in scenes {
                vehicle = [0, 1, 2].map(|axis| vehicle[axis] + step[axis]);
                window.follow(vehicle);
                naive.follow(vehicle);
                assert_same(&window, &naive, &mut map);
                // The last cell of each axis belongs to the window, too.
                let place = |offsets: Vec<Cell>| {
                    let mut cells: Vec<Cell> = offsets
                        .into_iter()
                        .map(|o| [0, 1, 2].map(|axis| naive.min_cell[axis] + o[axis].min(SIZE[axis] - 1)))
                        .collect();
                    cells.sort_unstable();
                    cells.dedup();
                    cells
                };
                let (hits, frees) = (place(hits), place(frees));
                set_all(&mut frame, window.min_cell(), &hits, &frees);
                window.apply(&frame);
                naive.apply(&hits, &frees);
                assert_same(&window, &naive, &mut map);
            }
        }
    }

    #[test]
    fn one_hit_outlives_six_misses_whatever_was_before() {
        let cell = [3, 4, 5];
        for (free_frames_before, outlived) in [(0, 7), (1, 6), (50, 6)] {
            let mut window = MapWindow::new();
            let mut frame = FrameBits::new();
            let mut apply = |hits: &[Cell], frees: &[Cell]| {
                set_all(&mut frame, window.min_cell(), hits, frees);
                window.apply(&frame);
                window.is_occupied(cell)
            };
            for _ in 0..free_frames_before {
                assert!(!apply(&[], &[cell]));
            }
            // Rays that pass through the cell in the same frame do not count.
            assert!(apply(&[cell], &[cell]));
            for _ in 0..outlived {
                assert!(apply(&[], &[cell]));
            }
            assert!(!apply(&[], &[cell]));
        }
    }

    #[test]
    fn what_is_gone_is_forgotten_after_as_many_frames_as_the_ceiling_says() {
        let cell = [3, 4, 5];
        let mut window = MapWindow::new();
        let mut frame = FrameBits::new();
        set_all(&mut frame, window.min_cell(), &[cell], &[]);
        (0..100).for_each(|_| window.apply(&frame));
        set_all(&mut frame, window.min_cell(), &[], &[cell]);
        let frames = (1..100).find(|_| {
            window.apply(&frame);
            !window.is_occupied(cell)
        });
        assert_eq!(frames, Some(i32::from(OCCUPIED_CEILING)));
    }

    #[test]
    fn a_hovering_vehicle_does_not_move_the_window() {
        let mut window = MapWindow::new();
        let before = window.min_cell();
        for step in -HYSTERESIS..=HYSTERESIS {
            window.follow([step, -step, step]);
        }
        assert_eq!(window.min_cell(), before);
        window.follow([HYSTERESIS + 1, 0, 0]);
        assert_eq!(
            window.min_cell(),
            [before[0] + HYSTERESIS + 1, before[1], before[2]]
        );
    }
}
