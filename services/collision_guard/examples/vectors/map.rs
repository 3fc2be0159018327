//! The sector ring against PX4's map.
//!
//! The ring must say what the messages say, worked out without it (`oracle.rs`). Where PX4 says something else, there must be a reason:
//! one of a list, that the messages themselves bear out.

use super::oracle::{Heard, Word, fused};
use super::replay::{Answer, Message};
use super::report::Verdict;
use super::schema::{BINS, Fragile, Node, Unreadable};
use jink_shared_types::ring::SectorRing;

/// What PX4 calls unknown (cm).
const UNKNOWN_CM: i64 = 65535;
/// Whole centimetres on one side, metres on the other (cm).
const SAME_CM: f64 = 1.01;

/// Compares the ring of `answer` with the expectation of its step, after all that was `heard` so far.
pub fn judge(
    step: &Node<'_>,
    answer: &Answer,
    heard: &[Heard],
    fragile: &Fragile,
    verdict: &mut Verdict,
) -> Result<(), Unreadable> {
    let expect = step.get("expect")?;
    let distances_cm = expect.get("map_cm")?.bins()?;
    let ranges_cm = expect.get("bin_max_range_cm")?.bins()?;
    let scene = Scene { answer, heard };
    for bin in 0..BINS {
        if fragile.bins.contains(&bin) {
            verdict.fragile += 1;
            continue;
        }
        if let Some(what) = scene.is_unlike_what_was_told(bin) {
            verdict.wrong(format!("bin {bin}: {what}"));
            continue;
        }
        let px4 = if distances_cm[bin] == UNKNOWN_CM {
            Word::Silent
        } else if distances_cm[bin] >= ranges_cm[bin] {
            Word::Clear(distances_cm[bin] as f64)
        } else {
            Word::Hit(distances_cm[bin] as f64)
        };
        let ours = said(&answer.ring, bin);
        if is_same(ours, px4) {
            verdict.same();
        } else if let Some(reason) = scene.why(bin, ours, px4) {
            verdict.differs(reason);
        } else {
            verdict.wrong(format!("bin {bin}: {ours:?}, PX4 {px4:?}, and no reason"));
        }
    }
    Ok(())
}

/// What the ring says of a sector.
pub fn said(ring: &SectorRing, sector: usize) -> Word {
    let (distance_m, reach_m) = (ring.distance_m[sector], ring.range_max_m[sector]);
    if distance_m.is_nan() {
        Word::Silent
    } else if distance_m.is_finite() {
        Word::Hit(100.0 * f64::from(distance_m))
    } else {
        Word::Clear(100.0 * f64::from(reach_m))
    }
}

fn is_same(a: Word, b: Word) -> bool {
    match (a, b) {
        (Word::Silent, Word::Silent) => true,
        // How far it is free is the sensor's affair: PX4 counts with the range, we with what of it is horizontal.
        (Word::Clear(_), Word::Clear(_)) => true,
        (Word::Hit(a), Word::Hit(b)) => (a - b).abs() <= SAME_CM,
        // An obstacle at the very end of the range.
        (Word::Hit(a), Word::Clear(b)) | (Word::Clear(a), Word::Hit(b)) => (a - b).abs() <= SAME_CM,
        (Word::Silent, _) | (_, Word::Silent) => false,
    }
}

/// Whether the vehicle has turned since something was told that still counts.
pub fn has_turned(answer: &Answer, heard: &[Heard]) -> bool {
    Scene { answer, heard }.has_turned()
}

struct Scene<'a> {
    answer: &'a Answer,
    heard: &'a [Heard],
}

impl Scene<'_> {
    fn live(&self) -> impl Iterator<Item = &Heard> {
        self.heard.iter().filter(|heard| heard.is_live(self.answer.now))
    }

    fn told(&self, bin: usize) -> Word {
        fused(self.heard, self.answer.now, bin, self.answer.yaw_rad)
    }

    /// Whether the vehicle has turned since something was told that still counts.
    fn has_turned(&self) -> bool {
        !self.live().all(|heard| heard.is_unturned(self.answer.yaw_rad))
    }

    /// What is wrong with what the ring says, if it is not what was told. After a turn, places lie between bins: then a neighbour may
    /// have it.
    fn is_unlike_what_was_told(&self, bin: usize) -> Option<String> {
        let around = |bin: usize| [(bin + BINS - 1) % BINS, bin, (bin + 1) % BINS];
        let (ours, told) = (said(&self.answer.ring, bin), self.told(bin));
        if !self.has_turned() {
            let same = match (ours, told) {
                (Word::Clear(a), Word::Clear(b)) => (a - b).abs() <= SAME_CM,
                _ => is_same(ours, told),
            };
            return (!same).then(|| format!("{ours:?}, and told was {told:?}"));
        }
        if let Word::Hit(told_cm) = told {
            let is_there = around(bin)
                .into_iter()
                .any(|bin| matches!(said(&self.answer.ring, bin), Word::Hit(cm) if cm <= told_cm + SAME_CM));
            if !is_there && !self.is_seen_again_beside(bin, told) {
                return Some(format!("turned: {ours:?}, and told was {told:?}"));
            }
        }
        let is_known = ours != Word::Silent;
        let was_told = around(bin).into_iter().any(|bin| self.told(bin) != Word::Silent);
        (is_known && !was_told).then(|| format!("turned: {ours:?}, and nothing was told"))
    }

    /// Whether the source of `told` has since said something of a bin beside it. Of two messages of one time the one that came last is
    /// the newer, as for the ring.
    fn is_seen_again_beside(&self, bin: usize, told: Word) -> bool {
        let yaw_rad = self.answer.yaw_rad;
        self.live()
            .enumerate()
            .filter(|(_, heard)| heard.word(bin, yaw_rad) == told)
            .all(|(came, by)| {
                self.live().enumerate().any(|(came_later, newer)| {
                    let beside = [(bin + BINS - 1) % BINS, (bin + 1) % BINS];
                    newer.layer == by.layer
                        && (newer.at, came_later) > (by.at, came)
                        && beside.iter().any(|bin| newer.word(*bin, yaw_rad) != Word::Silent)
                })
            })
    }

    /// Why PX4 says something else.
    fn why(&self, bin: usize, ours: Word, px4: Word) -> Option<&'static str> {
        let is_nearer = match (ours, px4) {
            (Word::Hit(a), Word::Hit(b) | Word::Clear(b)) => a < b,
            (Word::Hit(_), Word::Silent) => true,
            _ => false,
        };
        if self.has_turned() {
            return Some("it is kept where it was seen while the vehicle turns");
        }
        if is_nearer {
            let is_too_near = self
                .live()
                .any(|heard| heard.words[bin] != Word::Silent && heard.px4[bin] == Word::Silent);
            return Some(if is_too_near {
                "a reading below the minimum, or at a true direction, is an obstacle"
            } else {
                "the nearest of all that is told counts"
            });
        }
        if px4 == Word::Silent {
            // The oracle has it from a living source.
            return Some("a living source covers it");
        }
        let sees_farther = matches!((ours, px4), (Word::Hit(ours), Word::Clear(px4)) if ours > px4);
        if sees_farther {
            return Some("where one sensor ends, another sees farther");
        }
        self.why_not_as_near(bin, px4)
    }

    /// Why PX4's word is not ours, although it is the more careful one: it must come from somewhere.
    fn why_not_as_near(&self, bin: usize, px4: Word) -> Option<&'static str> {
        let says_so = |heard: &&Heard| is_same(heard.px4[bin], px4);
        let newest = |layer: usize| {
            self.live()
                .filter(|heard| heard.layer == layer && heard.words[bin] != Word::Silent)
                .max_by_key(|heard| heard.at)
        };
        let by = self.heard.iter().rev().find(says_so);
        if let Some(by) = by {
            if !by.is_live(self.answer.now) {
                return Some("older than half a second by its own time");
            }
            if by.words[bin] == Word::Silent {
                return Some("a reading that is no number, or a direction that is none");
            }
            let is_newest = newest(by.layer).is_some_and(|newest| std::ptr::eq(newest, by));
            return (!is_newest).then_some("a newer reading of the same source says otherwise");
        }
        // PX4 reads a direction that is none as one: which, depends on its arithmetic.
        if self.live().any(|heard| heard.row.is_none() && heard.is_refused()) {
            return Some("a reading that is no number, or a direction that is none");
        }
        // Not told of this bin by any message: PX4 has put an element of a row where it is not.
        let by = self
            .heard
            .iter()
            .rev()
            .find(|heard| heard.row.is_some_and(|row| row.holds(px4)))?;
        Some(if by.is_live(self.answer.now) {
            "an element of a row is not where PX4 puts it"
        } else {
            "older than half a second by its own time"
        })
    }
}

/// The distances of a row.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    distances_cm: [u16; BINS],
    max_cm: u16,
}

impl Row {
    /// Of a message, if it is one.
    pub fn of(message: &Message) -> Option<Self> {
        match message {
            Message::Row { row, .. } => Some(Self {
                distances_cm: row.distances_cm,
                max_cm: row.max_cm,
            }),
            Message::Beam { .. } => None,
        }
    }

    fn holds(&self, word: Word) -> bool {
        self.distances_cm.iter().any(|cm| {
            let cm = f64::from(*cm);
            match word {
                Word::Silent => false,
                Word::Hit(px4) => (cm - px4).abs() < 0.5,
                Word::Clear(px4) => (cm - px4).abs() < 0.5 || cm > f64::from(self.max_cm),
            }
        })
    }
}
