//! Which instance of a process owns which inputs: written by the supervisor only, read by every service.
//!
//! An instance owns an input if it publishes what comes of it. Ownership changes at a moment on the common clock: inputs
//! published before [`ControlEntry::from`] belong to the active instance, later ones to the next. Every input carries the
//! time of its publication, both instances see the same one, so each input has exactly one owner: nothing is
//! answered twice, nothing is left out, and no order has to be guessed. (A sequence number would say the same for one
//! input; a time says it for all inputs of a service and for its timers.)

use crate::clock::Timestamp;
use crate::health::{Name, PROCESSES};
use crate::reserved::Reserved;

crate::sample! {
    /// Who owns the inputs of one process.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct ControlEntry: 48 {
        /// The process.
        pub name: Name,
        /// Generation that owns now; 0 = none.
        pub active: u32,
        /// Generation that owns inputs published at `from` and later; 0 = no change is planned.
        pub next: u32,
        /// When ownership changes.
        pub from: Timestamp,
        /// Counts changes of ownership: the high half of the sequence numbers that the active instance publishes. It only
        /// grows, also when an older generation takes back what a newer one has failed at, so that readers never take
        /// the returned one's samples for leftovers.
        pub epoch: u32,
        /// The same of the next instance.
        pub next_epoch: u32,
    }
}

impl ControlEntry {
    /// Whether `generation` owns an input published at `time`.
    pub fn owns(&self, generation: u32, time: Timestamp) -> bool {
        let owner = if self.next != 0 && time >= self.from {
            self.next
        } else {
            self.active
        };
        owner == generation
    }

    /// The epoch in which `generation` publishes, if the record says so.
    pub fn epoch_of(&self, generation: u32) -> Option<u32> {
        match generation {
            0 => None,
            _ if generation == self.next => Some(self.next_epoch),
            _ if generation == self.active => Some(self.epoch),
            _ => None,
        }
    }
}

crate::sample! {
    /// The whole record.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Control: 1160 {
        /// Entries in use.
        pub len: u32,
        /// Explicit padding, zero.
        pub reserved: Reserved<4>,
        /// One per process.
        pub entries: [ControlEntry; PROCESSES],
    }
    plausible if Self::is_consistent
}

impl Default for Control {
    fn default() -> Self {
        Self {
            len: 0,
            reserved: Reserved::ZERO,
            entries: [ControlEntry::default(); PROCESSES],
        }
    }
}

impl Control {
    /// Whether it has room for the entries that it counts, and each says in words whose it is.
    pub fn is_consistent(&self) -> bool {
        self.len as usize <= PROCESSES && self.entries().iter().all(|entry| entry.name.is_text())
    }

    /// The entries in use.
    pub fn entries(&self) -> &[ControlEntry] {
        &self.entries[..(self.len as usize).min(PROCESSES)]
    }

    /// The entry of a process.
    pub fn entry(&self, name: &Name) -> Option<&ControlEntry> {
        self.entries().iter().find(|entry| entry.name == *name)
    }
}

#[cfg(test)]
mod tests {
    use super::ControlEntry;
    use crate::clock::Timestamp;
    use crate::health::Name;
    use proptest::prelude::*;

    proptest! {
        /// Whatever the record says, no input has two owners, and a planned change leaves none without.
        #[test]
        fn every_input_has_exactly_one_owner(active in 1..5u32, next in 0..5u32, from in 0..100u64, time in 0..100u64) {
            let entry = ControlEntry {
                name: Name::new("planner"),
                active,
                next,
                from: Timestamp::from_ns(from),
                epoch: active,
                next_epoch: next,
            };
            let owners = (1..5u32).filter(|g| entry.owns(*g, Timestamp::from_ns(time))).count();
            prop_assert_eq!(owners, 1);
        }
    }
}
