//! The clock of a service: the board's, or that of a simulation which sets it.

use crate::realtime;
use crate::transport::local::LocalBus;
use jink_shared_types::Timestamp;

/// What stamps samples and says when it is time. Every part of a service reads the same one.
#[derive(Clone, Debug)]
pub struct Clock(Option<LocalBus>);

impl Clock {
    /// CLOCK_MONOTONIC.
    pub fn monotonic() -> Self {
        Self(None)
    }

    /// The clock of `bus`: it stands until it is set.
    pub fn of(bus: &LocalBus) -> Self {
        Self(Some(bus.clone()))
    }

    /// The time now.
    pub fn now(&self) -> Timestamp {
        self.0.as_ref().map_or_else(realtime::now, LocalBus::now)
    }

    /// Whether time is simulated: what the board does besides is then no part of what happens.
    pub fn is_virtual(&self) -> bool {
        self.0.is_some()
    }
}
