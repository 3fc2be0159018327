//! What each cycle of a service took of its inputs, so that a recorded flight can be replayed.
//!
//! A service that reads no clock but that of its cycle, and nothing but topics, puts out the same again if each cycle begins at the same
//! time and takes the same samples. Both are in [`CycleEntries`], in the order in which they happened.

use crate::clock::Timestamp;
use crate::coded::Flag;
use crate::hash;
use crate::reserved::Reserved;

/// Entries of one sample: what a service does between two heartbeats, several times over.
pub const CYCLE_ENTRIES: usize = 64;

crate::sample! {
    /// The begin of a cycle, or a sample that it took.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct CycleEntry: 16 {
        /// When the cycle began; of a sample, when that was published.
        pub time: Timestamp,
        /// [`topic_id`] of the sample's topic; 0: a cycle begins.
        pub topic: u32,
        /// Of a sample: how often the cycle had looked at the topic before. Of a cycle: its number, from 1.
        pub number: u32,
    }
}

crate::sample! {
    /// What a service has done since the last sample of this topic.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct CycleEntries: 1032 {
        /// Entries in use.
        pub len: u32,
        /// The instance was started as a shadow.
        pub shadow: Flag,
        /// Zero.
        pub reserved: Reserved<3>,
        /// A cycle, what it took, the next cycle.
        pub entries: [CycleEntry; CYCLE_ENTRIES],
    }
    plausible if Self::is_consistent
}

impl Default for CycleEntries {
    fn default() -> Self {
        Self {
            len: 0,
            shadow: Flag::NO,
            reserved: Reserved::ZERO,
            entries: [CycleEntry::default(); CYCLE_ENTRIES],
        }
    }
}

impl CycleEntries {
    /// Whether it has room for the entries that it counts.
    pub fn is_consistent(&self) -> bool {
        self.len as usize <= CYCLE_ENTRIES
    }

    /// The entries in use.
    pub fn entries(&self) -> &[CycleEntry] {
        &self.entries[..(self.len as usize).min(CYCLE_ENTRIES)]
    }

    /// Adds an entry. Returns whether there was room.
    pub fn push(&mut self, entry: CycleEntry) -> bool {
        let place = self.entries.get_mut(self.len as usize);
        place.is_some_and(|place| {
            *place = entry;
            self.len += 1;
            true
        })
    }
}

/// A number for the topic of this name, never 0.
pub fn topic_id(name: &str) -> u32 {
    let hash = hash::text(hash::START, name);
    ((hash >> 32) as u32 ^ hash as u32).max(1)
}

#[cfg(test)]
mod tests {
    use super::{CYCLE_ENTRIES, CycleEntries, CycleEntry, topic_id};
    use crate::topics::TABLE;
    use std::collections::BTreeSet;

    #[test]
    fn no_two_topics_have_one_number() {
        let members = ["", "front", "planner", "mavlink_gateway"];
        let names: BTreeSet<String> = TABLE
            .iter()
            .flat_map(|row| members.map(|member| row.topic_name(member)))
            .collect();
        let ids: BTreeSet<u32> = names.iter().map(|name| topic_id(name)).collect();
        assert_eq!(ids.len(), names.len());
        assert!(!ids.contains(&0));
    }

    #[test]
    fn what_is_full_takes_no_more() {
        let mut sample = CycleEntries::default();
        let pushed = (0..CYCLE_ENTRIES + 1).filter(|_| sample.push(CycleEntry::default()));
        assert_eq!(pushed.count(), CYCLE_ENTRIES);
        assert_eq!(sample.entries().len(), CYCLE_ENTRIES);
        sample.len = u32::MAX;
        assert_eq!(sample.entries().len(), CYCLE_ENTRIES);
    }
}
