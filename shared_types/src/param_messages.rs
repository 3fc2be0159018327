//! Parameters on their way between processes: the values in force, and what somebody wants changed.
//!
//! | sample | says |
//! |---|---|
//! | [`ParameterValues`] | every value, in the order of [`params::TABLE`] and of the rows that the configuration declares behind it |
//! | [`ParameterChange`] | one value that is asked for |
//!
//! Both name their rows by number, so both carry a number of the table ([`table_of`]): a build or a configuration with another
//! one is not understood rather than misunderstood.

use crate::hash;
use crate::params::{self, Apply, ParamSet, TABLE};
use crate::reserved::Reserved;

/// Values that a sample has room for: twice today's table, in a sample that is still below a KiB.
pub const PARAMETERS_MAX: usize = 64;

const _: () = assert!(TABLE.len() <= PARAMETERS_MAX);

/// A number that two builds have in common if their tables have the same rows in the same units and order. It travels
/// in the samples and not in their type names: builds whose tables differ still meet, and say that they do not
/// understand.
pub const TABLE_HASH: u64 = {
    let mut table = hash::START;
    let mut i = 0;
    while i < TABLE.len() {
        table = hash::text(hash::text(table, TABLE[i].name), TABLE[i].unit);
        i += 1;
    }
    table
};

/// The same of the rows of `set`: [`TABLE_HASH`] with those behind the table folded in.
pub fn table_of(set: &ParamSet) -> u64 {
    let fold = |table, row: &params::Param| hash::text(hash::text(table, row.name), row.unit);
    set.declared().iter().fold(TABLE_HASH, fold)
}

crate::sample! {
    /// The values in force. Those of rows that need a restart may be newer than what services work with.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct ParameterValues: 536 {
        /// [`table_of`] the set that it was filled from.
        pub table: u64,
        /// Identity of the last [`ParameterChange`] that was decided on; 0 = none yet.
        pub answered: u64,
        /// Values in use.
        pub len: u32,
        /// Changes since the producer's start.
        pub changes: u32,
        /// In the order of the table; the rest is zero.
        pub values: [f64; PARAMETERS_MAX],
    }
    plausible if Self::is_consistent
}

impl Default for ParameterValues {
    fn default() -> Self {
        Self {
            table: 0,
            answered: 0,
            len: 0,
            changes: 0,
            values: [0.0; PARAMETERS_MAX],
        }
    }
}

impl ParameterValues {
    /// The values of `set`.
    pub fn of(set: &ParamSet) -> Self {
        let mut sample = Self {
            table: table_of(set),
            len: set.len() as u32,
            ..Self::default()
        };
        for (slot, (_, value)) in sample.values.iter_mut().zip(set.rows()) {
            *slot = value;
        }
        sample
    }

    /// Whether it has room for the values that it counts, and all are numbers. Ranges are the table's business.
    pub fn is_consistent(&self) -> bool {
        let used = self.values.get(..self.len as usize);
        used.is_some_and(|values| values.iter().all(|value| value.is_finite()))
    }

    /// Row and value of each parameter; empty if it comes from a table with other rows than `known`.
    pub fn rows(&self, known: &ParamSet) -> impl Iterator<Item = (&'static params::Param, f64)> + use<'_> {
        let is_known = self.table == table_of(known) && self.len as usize == known.len();
        let rows = TABLE
            .iter()
            .chain(known.declared())
            .zip(self.values.iter().copied());
        rows.filter(move |_| is_known)
    }

    /// Takes the values of the rows that apply at once into `set`; what `set` would refuse stays as it was. Answers
    /// whether anything has changed.
    pub fn apply_live(&self, set: &mut ParamSet) -> bool {
        let mut changed = false;
        for (row, value) in self.rows(set).filter(|(row, _)| row.apply == Apply::Live) {
            changed |= set.get(row) != value && set.set(row.name, value).is_ok();
        }
        changed
    }
}

crate::sample! {
    /// A value that somebody on this board wants changed.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct ParameterChange: 32 {
        /// [`table_of`] the set of whoever asks.
        pub table: u64,
        /// Identity of the request, never 0.
        pub id: u64,
        /// The value.
        pub value: f64,
        /// Row of the table.
        pub row: u32,
        /// Explicit padding, zero.
        pub reserved: Reserved<4>,
    }
    plausible if Self::is_consistent
}

impl ParameterChange {
    /// Whether it can be answered, and asks for a number.
    pub fn is_consistent(&self) -> bool {
        self.id != 0 && self.value.is_finite()
    }

    /// The row that is meant; `None` if it comes from a table with other rows than `known`.
    pub fn row(&self, known: &ParamSet) -> Option<&'static params::Param> {
        let is_known = self.table == table_of(known);
        known.row(self.row as usize).filter(|_| is_known)
    }
}

#[cfg(test)]
mod tests {
    use super::ParameterValues;
    use crate::params::{Apply, OA_SPD_MAX, OA_VEH_RADIUS, Param, ParamSet, TABLE};
    use proptest::prelude::*;

    #[test]
    fn only_live_rows_take_effect_and_only_once() {
        let mut reported = ParamSet::default();
        reported.set("OA_SPD_MAX", 5.0).unwrap();
        reported.set("OA_VEH_RADIUS", 0.5).unwrap();
        let sample = ParameterValues::of(&reported);
        let mut set = ParamSet::default();
        assert!(sample.apply_live(&mut set));
        assert_eq!(
            (set.get(&OA_SPD_MAX), set.get(&OA_VEH_RADIUS)),
            (5.0, OA_VEH_RADIUS.default)
        );
        assert!(!sample.apply_live(&mut set), "nothing was new");
    }

    #[test]
    fn values_of_declared_rows_are_taken_by_those_who_declare_the_same() {
        static OWN: [Param; 1] = [Param {
            name: "USR_A",
            default: 1.0,
            ..OA_SPD_MAX
        }];
        let mut reported = ParamSet::declaring(&OWN);
        reported.set("USR_A", 2.0).unwrap();
        reported.set("OA_SPD_MAX", 5.0).unwrap();
        let sample = ParameterValues::of(&reported);
        let mut same = ParamSet::declaring(&OWN);
        assert!(sample.apply_live(&mut same));
        assert_eq!((same.named("USR_A"), same.get(&OA_SPD_MAX)), (Some(2.0), 5.0));
        assert!(
            !sample.apply_live(&mut ParamSet::default()),
            "it knows no such row"
        );
    }

    #[test]
    fn values_of_another_table_are_not_taken() {
        let mut sample = ParameterValues::of(&ParamSet::default());
        sample.values[2] = 7.0;
        sample.table ^= 1;
        assert!(!sample.apply_live(&mut ParamSet::default()));
    }

    proptest! {
        #[test]
        fn whatever_a_sample_says_no_value_leaves_its_range(values in proptest::collection::vec(any::<f64>(), 64)) {
            let mut sample = ParameterValues::of(&ParamSet::default());
            sample.values.copy_from_slice(&values);
            let mut set = ParamSet::default();
            sample.apply_live(&mut set);
            for row in TABLE {
                prop_assert!((row.min..=row.max).contains(&set.get(row)));
                prop_assert!(row.apply == Apply::Live || set.get(row) == row.default);
            }
        }
    }
}
