//! The sector ring against PX4's map.
//!
//! The ring must agree with the messages, evaluated without it (`oracle.rs`). Where PX4 differs, there must be a
//! reason: one of a list, confirmed by the messages themselves.

use super::VectorReport;
use super::oracle::{ReceivedMessage, SectorReading, fused};
use super::replay::ReplayedStep;
use jink_shared_types::ring::SectorRing;
use jink_testkit::vectors::{BINS, unrolled};
use serde_json::Value;

/// What PX4 calls unknown (cm).
const UNKNOWN_CM: i64 = 65535;
/// Whole centimetres on one side, metres on the other (cm).
const SAME_CM: f64 = 1.01;

/// The reading of a sector of the ring.
pub fn said(ring: &SectorRing, sector: usize) -> SectorReading {
    let (distance_m, reach_m) = (ring.distance_m[sector], ring.range_max_m[sector]);
    if distance_m.is_nan() {
        SectorReading::Silent
    } else if distance_m.is_finite() {
        SectorReading::Hit(100.0 * f64::from(distance_m))
    } else {
        SectorReading::Clear(100.0 * f64::from(reach_m))
    }
}

fn is_same(a: SectorReading, b: SectorReading) -> bool {
    match (a, b) {
        (SectorReading::Silent, SectorReading::Silent) => true,
        // How far it is free is the sensor's affair: PX4 counts with the range, we with what of it is horizontal.
        (SectorReading::Clear(_), SectorReading::Clear(_)) => true,
        (SectorReading::Hit(a), SectorReading::Hit(b)) => (a - b).abs() <= SAME_CM,
        // An obstacle at the very end of the range.
        (SectorReading::Hit(a), SectorReading::Clear(b))
        | (SectorReading::Clear(a), SectorReading::Hit(b)) => (a - b).abs() <= SAME_CM,
        (SectorReading::Silent, _) | (_, SectorReading::Silent) => false,
    }
}

/// The ring of `replayed`, after all messages `received` so far.
pub struct MapComparison<'a> {
    pub replayed: &'a ReplayedStep,
    pub received: &'a [ReceivedMessage],
}

impl MapComparison<'_> {
    /// Compares the received messages with those that the step expects.
    pub fn judge(&self, expect: &Value, fragile_bins: &[usize], report: &mut VectorReport) {
        let distances_cm = unrolled(&expect["map_cm"]);
        let ranges_cm = unrolled(&expect["bin_max_range_cm"]);
        for bin in (0..BINS).filter(|bin| !fragile_bins.contains(bin)) {
            if let Some(what) = self.differs_from_messages(bin) {
                report.wrong(&format!("bin {bin}: {what}"));
                continue;
            }
            let px4 = if distances_cm[bin] == UNKNOWN_CM {
                SectorReading::Silent
            } else if distances_cm[bin] >= ranges_cm[bin] {
                SectorReading::Clear(distances_cm[bin] as f64)
            } else {
                SectorReading::Hit(distances_cm[bin] as f64)
            };
            let ours = said(&self.replayed.ring, bin);
            if is_same(ours, px4) {
                continue;
            } else if let Some(reason) = self.why(bin, ours, px4) {
                report.differs(reason);
            } else {
                report.wrong(&format!("bin {bin}: {ours:?}, PX4 {px4:?}, and no reason"));
            }
        }
    }

    fn live(&self) -> impl Iterator<Item = &ReceivedMessage> {
        self.received
            .iter()
            .filter(|received| received.is_live(self.replayed.now))
    }

    fn reported(&self, bin: usize) -> SectorReading {
        fused(self.received, self.replayed.now, bin, self.replayed.yaw_rad)
    }

    /// Whether the vehicle has turned since something was reported that still counts.
    pub fn has_turned(&self) -> bool {
        !self
            .live()
            .all(|received| received.is_unturned(self.replayed.yaw_rad))
    }

    /// How the ring differs from the messages, if it does. After a turn, places lie between bins: then a neighbour may
    /// have it.
    fn differs_from_messages(&self, bin: usize) -> Option<String> {
        let around = |bin: usize| [(bin + BINS - 1) % BINS, bin, (bin + 1) % BINS];
        let (ours, reported) = (said(&self.replayed.ring, bin), self.reported(bin));
        if !self.has_turned() {
            let same = match (ours, reported) {
                (SectorReading::Clear(a), SectorReading::Clear(b)) => (a - b).abs() <= SAME_CM,
                _ => is_same(ours, reported),
            };
            return (!same).then(|| format!("{ours:?}, and reported was {reported:?}"));
        }
        if let SectorReading::Hit(reported_cm) = reported {
            let is_there = around(bin)
                .into_iter()
                .any(|bin| matches!(said(&self.replayed.ring, bin), SectorReading::Hit(cm) if cm <= reported_cm + SAME_CM));
            if !is_there && !self.is_seen_again_beside(bin, reported) {
                return Some(format!("turned: {ours:?}, and reported was {reported:?}"));
            }
        }
        let is_known = ours != SectorReading::Silent;
        let was_reported = around(bin)
            .into_iter()
            .any(|bin| self.reported(bin) != SectorReading::Silent);
        (is_known && !was_reported).then(|| format!("turned: {ours:?}, and nothing was reported"))
    }

    /// Whether the source of `reported` has since reported a bin beside it. Of two messages of one time the one that
    /// came last is the newer, as for the ring.
    fn is_seen_again_beside(&self, bin: usize, reported: SectorReading) -> bool {
        let yaw_rad = self.replayed.yaw_rad;
        self.live()
            .enumerate()
            .filter(|(_, received)| received.reading_of(bin, yaw_rad) == reported)
            .all(|(came, by)| {
                self.live().enumerate().any(|(came_later, newer)| {
                    let beside = [(bin + BINS - 1) % BINS, (bin + 1) % BINS];
                    newer.layer == by.layer
                        && (newer.at, came_later) > (by.at, came)
                        && beside
                            .iter()
                            .any(|bin| newer.reading_of(*bin, yaw_rad) != SectorReading::Silent)
                })
            })
    }

    /// Why PX4 differs.
    fn why(&self, bin: usize, ours: SectorReading, px4: SectorReading) -> Option<&'static str> {
        let is_nearer = match (ours, px4) {
            (SectorReading::Hit(a), SectorReading::Hit(b) | SectorReading::Clear(b)) => a < b,
            (SectorReading::Hit(_), SectorReading::Silent) => true,
            _ => false,
        };
        if self.has_turned() {
            return Some("it is kept where it was seen while the vehicle turns");
        }
        if is_nearer {
            let is_too_near = self.live().any(|received| {
                received.readings[bin] != SectorReading::Silent && received.px4[bin] == SectorReading::Silent
            });
            return Some(if is_too_near {
                "a reading below the minimum, or at a true direction, is an obstacle"
            } else {
                "the nearest of all that is reported counts"
            });
        }
        if px4 == SectorReading::Silent {
            // The oracle has it from a living source.
            return Some("a living source covers it");
        }
        let sees_farther =
            matches!((ours, px4), (SectorReading::Hit(ours), SectorReading::Clear(px4)) if ours > px4);
        if sees_farther {
            return Some("where one sensor ends, another sees farther");
        }
        self.why_not_as_near(bin, px4)
    }

    /// Why PX4's word is not ours, although it is the more careful one: it must come from somewhere.
    fn why_not_as_near(&self, bin: usize, px4: SectorReading) -> Option<&'static str> {
        let says_so = |received: &&ReceivedMessage| is_same(received.px4[bin], px4);
        let newest = |layer: usize| {
            self.live()
                .filter(|received| received.layer == layer && received.readings[bin] != SectorReading::Silent)
                .max_by_key(|received| received.at)
        };
        let by = self.received.iter().rev().find(says_so);
        if let Some(by) = by {
            if !by.is_live(self.replayed.now) {
                return Some("older than half a second by its own time");
            }
            if by.readings[bin] == SectorReading::Silent {
                return Some("a reading that is no number, or a direction that is none");
            }
            let is_newest = newest(by.layer).is_some_and(|newest| std::ptr::eq(newest, by));
            return (!is_newest).then_some("a newer reading of the same source says otherwise");
        }
        // PX4 reads a direction that is none as one: which, depends on its arithmetic.
        if self
            .live()
            .any(|received| received.row.is_none() && received.is_refused())
        {
            return Some("a reading that is no number, or a direction that is none");
        }
        // Not reported of this bin by any message: PX4 has put an element of a row where it is not.
        let by = self
            .received
            .iter()
            .rev()
            .find(|received| received.has_element(px4))?;
        Some(if by.is_live(self.replayed.now) {
            "an element of a row is not where PX4 puts it"
        } else {
            "older than half a second by its own time"
        })
    }
}
