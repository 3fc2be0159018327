//! What a step has to say to who reads the log afterwards. The step itself writes none: it says it beside its outputs.

use crate::demand::Demand;
use jink_shared_types::beams::BeamRefused;
use std::fmt;

/// A line of the log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Note {
    /// Ranges that came over MAVLink cannot be used. They may come a hundred times a second.
    RangesRefused {
        /// MAVLink component that sent them.
        component: u8,
        /// Why.
        cause: BeamRefused,
    },
    /// A command has gone to the autopilot.
    Asked(Demand),
    /// A mission is not read: it has more items than fit.
    MissionTooLong {
        /// Its items.
        items: u16,
        /// How many fit.
        most: usize,
    },
    /// The autopilot took the mission that was given back at another item; it is put right.
    TakenElsewhere {
        /// Where it took it.
        taken: u16,
        /// Where it was given back.
        given: u16,
    },
}

impl Note {
    /// Writes it into the log of the process, for who runs the step.
    pub fn log(&self) {
        match self {
            Self::RangesRefused { .. } => tracing::debug!("{self}"),
            Self::Asked(_) | Self::TakenElsewhere { .. } => tracing::info!("{self}"),
            Self::MissionTooLong { .. } => tracing::warn!("{self}"),
        }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::RangesRefused { component, cause } => write!(f, "ranges of component {component}: {cause}"),
            Self::Asked(demand) => write!(f, "asked of the autopilot: {demand:?}"),
            Self::MissionTooLong { items, most } => {
                write!(f, "a mission of {items} items is not read: {most} at most")
            }
            Self::TakenElsewhere { taken, given } => {
                write!(f, "the mission was taken at item {taken} instead of {given}")
            }
        }
    }
}
