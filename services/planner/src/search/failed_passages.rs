//! Passages that turned out too narrow when the vehicle was near: trying one again costs more every time.
//!
//! Between two passages that both look wide enough from afar, and from nearby are not, the vehicle would go to and fro
//! for good: whichever it is away from is the cheaper one. What fails while the vehicle makes progress does not count
//! ([`crate::progress`]), nor does a first failure. From the second on the passage costs as much as a detour that becomes
//! twice as long each time, until a path round both is cheaper.

use jink_shared_types::Timestamp;
use jink_shared_types::map::{CELL_M, Cell, SIZE_Y, bit_of};

/// Where a passage counts as the same, and what around its place costs more (m, horizontally; at any height): about half a
/// passage that is too narrow for the slowest tier of whole cells.
const RADIUS_M: f64 = 0.8;
/// What a path through a passage that has failed twice costs more (m); each further time twice as much. About the way round
/// a tree or two, so that the next passage is tried before a long detour.
const COST_M: f32 = 15.0;
/// A passage has failed again only if the last failure that counted was so long ago (s): a flickering cell is not another
/// approach at once, but a passage that flickers for long is too narrow.
const AGAIN_AFTER_S: f64 = 1.5;
/// Failures are forgotten after this time (s): longer than any stay before a passage, and what stood there may have moved.
const FORGET_AFTER_S: f64 = 120.0;
/// Passages that are remembered; another one replaces the oldest.
const PASSAGES: usize = 16;
/// More failures cost no more: 240 m is longer than any detour that was flown.
const FAILURES_MAX: u32 = 6;

/// A passage that failed.
#[derive(Clone, Copy, Debug)]
struct Passage {
    /// A cell of the map in it.
    cell: Cell,
    /// The lowest speed tier in which it failed; those below it need less clearance.
    tier: usize,
    failures: u32,
    /// The last failure that counted.
    last: Timestamp,
}

/// The passages that failed on the way to a goal.
#[derive(Debug)]
pub(super) struct FailedPassages {
    passages: Vec<Passage>,
    /// The columns of cells that cost more: one bit along x for each y, modular like the map.
    columns: [u128; SIZE_Y],
}

impl Default for FailedPassages {
    fn default() -> Self {
        Self {
            passages: Vec::with_capacity(PASSAGES),
            columns: [0; SIZE_Y],
        }
    }
}

impl FailedPassages {
    /// Forgets them: there is another goal.
    pub(super) fn clear(&mut self) {
        self.passages.clear();
        self.columns.fill(0);
    }

    /// At `now` a path of `tier` that the vehicle was near to could not be continued through `cell` of the map.
    pub(super) fn record(&mut self, tier: usize, cell: Cell, now: Timestamp) {
        self.passages
            .retain(|passage| now.seconds_since(passage.last) < FORGET_AFTER_S);
        match self.passages.iter_mut().find(|passage| is_in(passage.cell, cell)) {
            Some(passage) => {
                passage.tier = passage.tier.max(tier);
                if now.seconds_since(passage.last) > AGAIN_AFTER_S {
                    passage.failures = (passage.failures + 1).min(FAILURES_MAX);
                    passage.last = now;
                }
            }
            None => {
                if self.passages.len() == PASSAGES {
                    self.passages.remove(0);
                }
                self.passages.push(Passage {
                    cell,
                    tier,
                    failures: 1,
                    last: now,
                });
            }
        }
        self.mark_columns();
    }

    fn mark_columns(&mut self) {
        self.columns.fill(0);
        let reach = (RADIUS_M / CELL_M).ceil() as i32;
        for passage in self.passages.iter().filter(|passage| passage.failures > 1) {
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let cell = [passage.cell[0] + dx, passage.cell[1] + dy, passage.cell[2]];
                    if is_in(passage.cell, cell) {
                        self.columns[column_of(cell)] |= 1 << bit_of(cell);
                    }
                }
            }
        }
    }

    /// What a metre of path in `cell` of the map costs more in `tier`.
    #[inline]
    pub(super) fn cost_per_metre(&self, tier: usize, cell: Cell) -> f32 {
        if self.columns[column_of(cell)] >> bit_of(cell) & 1 == 0 {
            return 0.0;
        }
        let here = self
            .passages
            .iter()
            .filter(|passage| passage.failures > 1 && tier <= passage.tier && is_in(passage.cell, cell));
        let failures = here.map(|passage| passage.failures).max().unwrap_or(1);
        if failures < 2 {
            return 0.0;
        }
        COST_M * (1 << (failures - 2)) as f32 / (2.0 * RADIUS_M) as f32
    }
}

fn column_of(cell: Cell) -> usize {
    cell[1] as usize & (SIZE_Y - 1)
}

/// Whether `cell` is in the passage around `place`.
fn is_in(place: Cell, cell: Cell) -> bool {
    let [x, y] = [0, 1].map(|axis| f64::from(place[axis] - cell[axis]) * CELL_M);
    x.hypot(y) <= RADIUS_M
}

#[cfg(test)]
mod tests {
    use super::{COST_M, FAILURES_MAX, FORGET_AFTER_S, FailedPassages, RADIUS_M};
    use jink_shared_types::Timestamp;

    fn at(s: f64) -> Timestamp {
        Timestamp::from_seconds(1_000.0 + s)
    }

    #[test]
    fn a_passage_costs_from_the_second_failure_on_twice_as_much_each_time() {
        let mut failed = FailedPassages::default();
        let through_m = 2.0 * RADIUS_M as f32;
        let mut expected_m = 0.0;
        for n in 0..10 {
            // A second report at once is the same failure.
            failed.record(2, [20, -3, 5], at(5.0 * f64::from(n)));
            failed.record(2, [21, -3, 5], at(5.0 * f64::from(n) + 0.1));
            let cost_m = failed.cost_per_metre(2, [20, -1, 9]) * through_m;
            assert!((cost_m - expected_m).abs() < 1e-3, "{n} {cost_m} {expected_m}");
            if n + 2 <= FAILURES_MAX as i32 {
                expected_m = if n == 0 { COST_M } else { 2.0 * expected_m };
            }
        }
        // Beside it, in a tier that needs less clearance, and at the same place of the next window: nothing.
        assert_eq!(failed.cost_per_metre(2, [20, 2, 5]), 0.0);
        assert_eq!(failed.cost_per_metre(3, [20, -3, 5]), 0.0);
        assert_eq!(failed.cost_per_metre(2, [148, -3, 5]), 0.0);
        assert!(failed.cost_per_metre(0, [20, -3, 5]) > 0.0);
    }

    #[test]
    fn failures_are_forgotten_and_there_is_room_for_the_latest() {
        let mut failed = FailedPassages::default();
        for s in [0.0, 5.0] {
            failed.record(2, [0, 0, 0], at(s));
        }
        assert!(failed.cost_per_metre(2, [0, 0, 0]) > 0.0);
        failed.record(2, [40, 0, 0], at(6.0 + FORGET_AFTER_S));
        assert_eq!(failed.cost_per_metre(2, [0, 0, 0]), 0.0);
        for n in 0..100 {
            for s in [0.0, 2.0] {
                failed.record(2, [10 * n, 0, 0], at(200.0 + 4.0 * f64::from(n) + s));
            }
        }
        assert!(failed.cost_per_metre(2, [990, 0, 0]) > 0.0);
        failed.clear();
        assert_eq!(failed.cost_per_metre(2, [990, 0, 0]), 0.0);
    }
}
