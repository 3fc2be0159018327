//! The owner of the parameters: one value of each for everybody, changed on request, kept across restarts.
//!
//! | in | out |
//! |---|---|
//! | `parameters/change`: from `jink param set`, from ground stations through the gateway | `parameters`: after each change, and once a second |
//! | | the parameter store (`ParamStore` of the runtime) |
//!
//! No flight hangs on it: every service goes on with the values that it has. So neither a link that is down nor a gateway that is
//! being restarted keeps anybody from reading and tuning parameters, and whoever asks over MAVLink cannot take it along.

mod service;

pub use service::ParameterService;

use jink_shared_types::Timestamp;
use jink_shared_types::param_messages::{ParameterChange, ParameterValues};
use jink_shared_types::params::ParamSet;

/// How often all values are published although nothing has changed (Hz), as the topic table says.
const PUBLISH_RATE_HZ: u32 = 1;

/// The parameters, and what has to be said about them.
#[derive(Clone, Debug)]
pub struct ParameterServer {
    set: ParamSet,
    /// Changes since the start.
    changes: u32,
    /// Identity of the last request that was decided on.
    answered: u64,
    publish_due: Timestamp,
}

impl ParameterServer {
    /// With these values in force.
    pub fn new(set: &ParamSet) -> Self {
        Self {
            set: set.clone(),
            changes: 0,
            answered: 0,
            publish_due: Timestamp::NEVER,
        }
    }

    /// The values in force.
    pub fn set(&self) -> &ParamSet {
        &self.set
    }

    /// Decides on a change: whether a value is another one now. What is refused is answered with the value that stays.
    pub fn take(&mut self, change: &ParameterChange) -> bool {
        self.answered = change.id;
        let Some(row) = change.row(&self.set) else {
            return false;
        };
        let before = self.set.get(row);
        let is_new = self.set.change(row.name, change.value).is_ok() && self.set.get(row) != before;
        self.changes = self.changes.wrapping_add(u32::from(is_new));
        is_new
    }

    /// All values; the next ones are due in a second.
    pub fn publish(&mut self, now: Timestamp) -> ParameterValues {
        self.publish_due = now.next_beat(PUBLISH_RATE_HZ);
        ParameterValues {
            changes: self.changes,
            answered: self.answered,
            ..ParameterValues::of(&self.set)
        }
    }

    /// When they are due to be published again. May lie in the past: then at once.
    pub fn due(&self) -> Timestamp {
        self.publish_due
    }
}

#[cfg(test)]
mod tests {
    use super::ParameterServer;
    use jink_shared_types::param_messages::{ParameterChange, TABLE_HASH};
    use jink_shared_types::params::{ParamSet, TABLE};
    use jink_shared_types::{Reserved, Timestamp};
    use proptest::prelude::*;

    fn at(s: f64) -> Timestamp {
        Timestamp::from_seconds(100.0 + s)
    }

    fn server() -> ParameterServer {
        ParameterServer::new(&ParamSet::default())
    }

    fn change(id: u64, row: usize, value: f64) -> ParameterChange {
        ParameterChange {
            table: TABLE_HASH,
            id,
            value,
            row: row as u32,
            reserved: Reserved::ZERO,
        }
    }

    fn speed() -> usize {
        TABLE.iter().position(|row| row.name == "OA_SPD_MAX").unwrap()
    }

    #[test]
    fn a_change_is_answered_counted_and_published_and_a_repetition_is_no_change() {
        let mut server = server();
        assert!(server.take(&change(7, speed(), 4.5)));
        let values = server.publish(at(0.1));
        assert_eq!((values.answered, values.changes), (7, 1));
        let reported = values
            .rows(server.set())
            .find(|(row, _)| row.name == "OA_SPD_MAX");
        assert_eq!(reported.unwrap().1, 4.5);
        assert!(!server.take(&change(8, speed(), 4.5)));
        assert_eq!(server.publish(at(0.2)).answered, 8);
        assert!(server.due() > at(0.2));
    }

    #[test]
    fn what_is_refused_is_answered_with_the_value_that_stays() {
        let mut server = server();
        for (id, row, value) in [
            (8, speed(), 99.0),
            (9, speed(), f64::NAN),
            (10, 99, 1.0),
            (11, usize::MAX, 1.0),
        ] {
            assert!(!server.take(&change(id, row, value)));
            assert_eq!(server.publish(at(0.0)).answered, id);
        }
        // A table with other rows is not understood, rather than misunderstood.
        assert!(!server.take(&ParameterChange {
            table: 1,
            ..change(12, speed(), 2.0)
        }));
        assert_eq!(server.set(), &ParamSet::default());
    }

    proptest! {
        #[test]
        fn whatever_is_asked_for_every_value_stays_in_its_range_and_below_the_other_end_of_its_span(
            asked in proptest::collection::vec((0..2 * TABLE.len(), prop_oneof![any::<f64>(), 0.0..200.0]), 1..60),
        ) {
            let mut server = server();
            for (id, (row, value)) in asked.into_iter().enumerate() {
                server.take(&change(1 + id as u64, row, value));
                let values = server.publish(at(id as f64));
                prop_assert!(values.is_consistent());
                prop_assert_eq!(values.answered, 1 + id as u64);
            }
            for (row, value) in server.set().rows() {
                prop_assert!((row.min..=row.max).contains(&value), "{} = {}", row.name, value);
            }
            prop_assert_eq!(server.set().reversed().count(), 0);
        }
    }
}
