//! Open space: cells that were free for a while, with nothing beside, above and below them. Noise of the sensor and of the
//! vehicle's pose moves hits by a cell, so a cell beside an obstacle is never open.
//!
//! A cell ceases to be open when it is not known any more, or when something has stayed in it: what has stopped is an
//! obstacle like any other, and what the drift of the estimate has shifted is soon one as well.

use crate::cells::{BitPlane, SIZE, bits, number, plane};
use crate::frame_bits::FrameBits;
use crate::window::{MapWindow, row};
use jink_shared_types::Timestamp;
use jink_shared_types::map::{SIZE_X, SIZE_Y, SIZE_Z};

/// Time between two looks for open cells (s): a cell is open if it was free at two of them.
const CHECK_S: f64 = 0.1;
/// Time between two looks for what has stayed (s).
const STAY_S: f64 = 1.0;
/// What was there in so many looks in a row has stayed.
const STAYED: usize = 3;

/// The open cells, by global index modulo the size.
pub(crate) struct OpenSpace {
    open: Box<BitPlane>,
    /// Free, and all neighbours as well, at the last look.
    was_free: Box<BitPlane>,
    /// Occupied at the last looks, the newest first.
    was_occupied: [Box<BitPlane>; STAYED - 1],
    scratch: [Box<BitPlane>; 3],
    checked: Timestamp,
    stayed: Timestamp,
}

impl OpenSpace {
    pub fn new() -> Self {
        Self {
            open: plane(),
            was_free: plane(),
            was_occupied: std::array::from_fn(|_| plane()),
            scratch: std::array::from_fn(|_| plane()),
            checked: Timestamp::NEVER,
            stayed: Timestamp::NEVER,
        }
    }

    /// Nothing is open.
    pub fn clear(&mut self) {
        self.open.fill(0);
        self.was_free.fill(0);
        self.was_occupied.iter_mut().for_each(|plane| plane.fill(0));
    }

    /// Looks at `window` as it is at `now`. What sensors that see `height` do not know above and below is not open;
    /// planar scans know but their own layer.
    pub fn update(&mut self, now: Timestamp, window: &MapWindow, height: bool) {
        // The window may have moved: what is a cell's number now was another cell's before.
        for ((open, free), known) in self.open.iter_mut().zip(&mut *self.was_free).zip(&*window.known) {
            *open &= known;
            *free &= known;
        }
        if is_due(&mut self.checked, now, CHECK_S) {
            self.free_with_neighbours(window, height);
            let [free, ..] = &self.scratch;
            for ((open, was_free), free) in self.open.iter_mut().zip(&mut *self.was_free).zip(&**free) {
                *open |= *was_free & free;
                *was_free = *free;
            }
        }
        if is_due(&mut self.stayed, now, STAY_S) {
            let [newer, older] = &mut self.was_occupied;
            for (word, open) in self.open.iter_mut().enumerate() {
                let occupied = window.occupied[word];
                *open &= !(occupied & newer[word] & older[word]);
                older[word] = newer[word];
                newer[word] = occupied;
            }
        }
    }

    /// Gives the offset from the window's smallest cell of each cell that `frame` hits and that is open (`true`), or at
    /// least was not occupied a second ago: there, what has come may continue.
    pub fn hits(&self, frame: &FrameBits, window: &MapWindow, mut found: impl FnMut([i32; 3], bool)) {
        let [.., settled] = &self.was_occupied;
        let [turn_x, first_y, first_z] = [0, 1, 2].map(|axis| window.min_cell[axis] & (SIZE[axis] - 1));
        for z in 0..SIZE[2] {
            for y in 0..SIZE[1] {
                let hit = row(&frame.hit, number([0, y, z]) >> 6);
                if hit == 0 {
                    continue;
                }
                let there = [0, (y + first_y) & (SIZE[1] - 1), (z + first_z) & (SIZE[2] - 1)];
                let open = row(&self.open, number(there) >> 6).rotate_right(turn_x as u32);
                let settled = row(settled, number(there) >> 6).rotate_right(turn_x as u32);
                for (cells, is_open) in [(hit & open, true), (hit & !open & !settled, false)] {
                    for (word, first) in [(cells as u64, 0), ((cells >> 64) as u64, 64)] {
                        bits(word).for_each(|bit| found([first + bit as i32, y, z], is_open));
                    }
                }
            }
        }
    }

    /// Writes the cells that are free by measurement, like those beside them in their layer, with nothing above and below
    /// them, into the first scratch plane. For sensors that see `height`, the layers above and below have to be known as
    /// well: before the ground is seen, the layer above it is, and then noise puts hits of the ground there. The window's
    /// opposite faces count as neighbours: what is free at a face is free at most to be lost again.
    fn free_with_neighbours(&mut self, window: &MapWindow, height: bool) {
        let [out, free, clear] = &mut self.scratch;
        let words = window.known.iter().zip(&*window.occupied).zip(&*window.declared);
        for ((free, clear), ((known, occupied), declared)) in free.iter_mut().zip(clear.iter_mut()).zip(words)
        {
            *free = known & !occupied & !declared;
            *clear = if height { *free } else { !occupied };
        }
        erode_in_layers(free, out);
        erode_in_layers(clear, out);
        out.copy_from_slice(&**free);
        erode_by_layers(clear, out);
    }
}

/// Unsets the cells of `out` that have an unset one of `clear` above or below them.
fn erode_by_layers(clear: &BitPlane, out: &mut BitPlane) {
    const SLICE: usize = SIZE_X / 64 * SIZE_Y;
    for (z, out) in out.chunks_exact_mut(SLICE).enumerate() {
        let [above, below] = [z + SIZE_Z - 1, z + 1].map(|beside| &clear[beside % SIZE_Z * SLICE..][..SLICE]);
        for (out, (above, below)) in out.iter_mut().zip(above.iter().zip(below)) {
            *out &= above & below;
        }
    }
}

/// Unsets the cells of `plane` that have an unset one beside them in their layer; `scratch` is overwritten.
fn erode_in_layers(plane: &mut BitPlane, scratch: &mut BitPlane) {
    const ROW: usize = SIZE_X / 64;
    const SLICE: usize = ROW * SIZE_Y;
    for pair in plane.chunks_exact_mut(ROW) {
        let row = u128::from(pair[0]) | u128::from(pair[1]) << 64;
        let row = row & row.rotate_left(1) & row.rotate_right(1);
        [pair[0], pair[1]] = [row as u64, (row >> 64) as u64];
    }
    for (slice, out) in plane.chunks_exact(SLICE).zip(scratch.chunks_exact_mut(SLICE)) {
        for (word, out) in out.iter_mut().enumerate() {
            let (before, after) = ((word + SLICE - ROW) % SLICE, (word + ROW) % SLICE);
            *out = slice[word] & slice[before] & slice[after];
        }
    }
    plane.copy_from_slice(scratch);
}

/// Whether `period_s` has passed since `last`, which then becomes `now`. A clock that went back begins anew.
fn is_due(last: &mut Timestamp, now: Timestamp, period_s: f64) -> bool {
    let is_due = !last.is_set() || !(0.0..period_s).contains(&now.seconds_since(*last));
    if is_due {
        *last = now;
    }
    is_due
}
