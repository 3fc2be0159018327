//! What comes of a replay.

use crate::difference::FieldDifference;
use crate::instance::InstanceName;
use std::fmt;

/// A difference between a recorded flight and its replay.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The topic.
    pub topic: String,
    /// The number of the cycle.
    pub cycle: u32,
    /// When the cycle began: after the begin of the recording (ns).
    pub at_ns: u64,
    /// What differs; `None`: a sample is there only once.
    pub field: Option<FieldDifference>,
    /// The sample was published in the flight.
    pub is_recorded: bool,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let at_s = self.at_ns as f64 * 1e-9;
        write!(f, "{} at {at_s:.3} s (cycle {}): ", self.topic, self.cycle)?;
        match (&self.field, self.is_recorded) {
            (Some(field), _) => write!(f, "{field}"),
            (None, true) => f.write_str("a recorded sample is not published any more"),
            (None, false) => f.write_str("a sample is published that was not recorded"),
        }
    }
}

/// What has come of one start of a process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Compared {
    /// Which.
    pub instance: InstanceName,
    /// Cycles that were replayed.
    pub cycles: u64,
    /// Samples that were compared.
    pub samples: u64,
    /// Those that differ.
    pub differing: u64,
    /// The first difference.
    pub first: Option<Difference>,
    /// Why it was not replayed to its end.
    pub ends: Option<String>,
}

/// What has come of a replay.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// In the order of their names.
    pub instances: Vec<Compared>,
    /// How long the flight was (s).
    pub flight_s: f64,
}

impl Report {
    /// Whether every start of each process was replayed to its end.
    pub fn is_whole(&self) -> bool {
        !self.instances.is_empty() && self.instances.iter().all(|compared| compared.ends.is_none())
    }

    /// The first difference of all.
    pub fn first(&self) -> Option<&Difference> {
        let all = self
            .instances
            .iter()
            .filter_map(|compared| compared.first.as_ref());
        all.min_by_key(|difference| difference.at_ns)
    }
}
