//! Parts of the horizon: sets of the ring's sectors, and how they are described to people.

use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS};
use serde::Serialize;

/// The quarters of the horizon, clockwise, each around its middle.
const QUARTERS: [(&str, f64); 4] = [
    ("forward", 0.0),
    ("right", 90.0),
    ("behind", 180.0),
    ("left", 270.0),
];

/// A part of the horizon without a gap, clockwise from the nose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// Where it begins (deg), 0 to 360.
    pub from_deg: f64,
    /// Where it ends, clockwise (deg), 0 to 360: less than the beginning if the nose lies in it.
    pub to_deg: f64,
}

/// A set of sectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sectors(pub [bool; SECTORS]);

impl Sectors {
    /// None of them.
    pub const NONE: Self = Self([false; SECTORS]);

    /// Those that `holds` says.
    pub fn of(holds: impl Fn(usize) -> bool) -> Self {
        Self(std::array::from_fn(holds))
    }

    /// Their numbers.
    pub fn each(&self) -> impl Iterator<Item = usize> + '_ {
        (0..SECTORS).filter(|sector| self.0[*sector])
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.each().next().is_none()
    }

    /// How much of the horizon they are (deg).
    pub fn width_deg(&self) -> f64 {
        self.each().count() as f64 * width_deg()
    }

    /// Whether all that lies within `half_deg` of straight ahead is in it.
    pub fn holds_ahead(&self, half_deg: f64) -> bool {
        let each_side = (half_deg / width_deg()).round() as usize;
        (0..=each_side).all(|step| self.0[step % SECTORS] && self.0[(SECTORS - step % SECTORS) % SECTORS])
    }

    /// As few intervals as there can be, in clockwise order.
    pub fn intervals(&self) -> Vec<Interval> {
        let begins = |sector: &usize| self.0[*sector] && !self.0[(sector + SECTORS - 1) % SECTORS];
        let from_begin = |begin: usize| {
            let sectors = (1..=SECTORS).take_while(|step| self.0[(begin + step) % SECTORS]);
            let end = begin + sectors.count();
            Interval {
                from_deg: turn_deg(begin as f64 - 0.5),
                to_deg: turn_deg(end as f64 + 0.5),
            }
        };
        if self.0.iter().all(|holds| *holds) {
            return vec![Interval {
                from_deg: 0.0,
                to_deg: 360.0,
            }];
        }
        (0..SECTORS).filter(begins).map(from_begin).collect()
    }

    /// For people: each interval with the sides of the vehicle that it lies on.
    pub fn text(&self) -> String {
        let intervals = self.intervals();
        match intervals.as_slice() {
            [] => "nothing".to_owned(),
            _ if self.0.iter().all(|holds| *holds) => "all around".to_owned(),
            _ => intervals
                .iter()
                .map(Interval::text)
                .collect::<Vec<_>>()
                .join(", "),
        }
    }
}

impl Interval {
    /// How wide it is (deg).
    pub fn width_deg(&self) -> f64 {
        match (self.to_deg - self.from_deg).rem_euclid(360.0) {
            0.0 => 360.0,
            width_deg => width_deg,
        }
    }

    fn text(&self) -> String {
        format!(
            "{} to {} deg ({})",
            self.from_deg,
            self.to_deg,
            self.sides().join(", ")
        )
    }

    /// The quarters that it reaches into.
    fn sides(&self) -> Vec<&'static str> {
        let reaches = |middle_deg: f64| {
            let past_deg = (middle_deg - 45.0 - self.from_deg).rem_euclid(360.0);
            past_deg < self.width_deg() || past_deg > 360.0 - 90.0
        };
        QUARTERS
            .iter()
            .filter(|(_, middle_deg)| reaches(*middle_deg))
            .map(|(name, _)| *name)
            .collect()
    }
}

fn width_deg() -> f64 {
    SECTOR_WIDTH_RAD.to_degrees()
}

/// A place counted in sectors, in degrees from 0 to 360; sectors are five degrees wide, so that halves are exact.
fn turn_deg(sectors: f64) -> f64 {
    (sectors * 360.0 / SECTORS as f64).rem_euclid(360.0)
}

#[cfg(test)]
mod tests {
    use super::{Interval, Sectors};
    use jink_shared_types::ring::SECTORS;
    use proptest::prelude::*;

    fn sectors(numbers: impl IntoIterator<Item = usize>) -> Sectors {
        let mut sectors = Sectors::NONE;
        numbers.into_iter().for_each(|number| sectors.0[number] = true);
        sectors
    }

    #[test]
    fn an_interval_is_classified_by_its_ends_and_sides() {
        assert_eq!(Sectors::NONE.text(), "nothing");
        assert_eq!(sectors(0..SECTORS).text(), "all around");
        assert_eq!(sectors(20..30).text(), "97.5 to 147.5 deg (right, behind)");
        assert_eq!(sectors([70, 71, 0, 1]).text(), "347.5 to 7.5 deg (forward)");
        assert_eq!(sectors([0]).text(), "357.5 to 2.5 deg (forward)");
        let most = sectors((0..SECTORS).filter(|number| *number != 36));
        assert_eq!(most.text(), "182.5 to 177.5 deg (forward, right, behind, left)");
        assert_eq!(
            sectors([18, 54]).text(),
            "87.5 to 92.5 deg (right), 267.5 to 272.5 deg (left)"
        );
    }

    #[test]
    fn ahead_is_held_on_both_sides_of_the_nose() {
        assert!(sectors([70, 71, 0, 1, 2]).holds_ahead(10.0));
        assert!(!sectors([71, 0, 1, 2]).holds_ahead(10.0));
        assert!(!sectors([70, 71, 1, 2]).holds_ahead(10.0));
    }

    proptest! {
        #[test]
        fn intervals_are_the_set_again(bits in proptest::array::uniform32(any::<bool>()), invert: bool) {
            let set = Sectors::of(|sector| bits[sector % 32] != (invert && sector > 40));
            let intervals = set.intervals();
            let width_deg: f64 = intervals.iter().map(Interval::width_deg).sum();
            prop_assert!((width_deg - set.width_deg()).abs() < 1e-9);
            for sector in 0..SECTORS {
                let holds = |interval: &&Interval| {
                    let past_deg = (sector as f64 * 5.0 - interval.from_deg).rem_euclid(360.0);
                    past_deg < interval.width_deg()
                };
                prop_assert_eq!(intervals.iter().filter(holds).count(), usize::from(set.0[sector]));
            }
        }
    }
}
