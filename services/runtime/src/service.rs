//! What a service is: opened once, then run cycle by cycle.

use crate::events::EventSender;
use crate::ports::Ports;
use crate::setup::StartError;
use jink_shared_types::Timestamp;
use jink_shared_types::params::ParamSet;
use std::os::fd::BorrowedFd;

/// Descriptors a service may watch besides its topics: three for each of the gateway's links.
pub const WATCHED_FDS: usize = 3 * jink_shared_types::link::LINKS;
/// Exit code of a service that could not start: wrong configuration, missing device, refused topic. The supervisor does
/// not restart it at once: it would fail again.
pub const EXIT_CANNOT_START: u8 = 78;
/// Exit code of a service that wants to be started again ([`Wake::restart`], or a place was taken that somebody will leave): for the supervisor a death like any other, so
/// back-off and intensity hold for it, too.
pub const EXIT_RESTART: u8 = 75;

/// When a service wants to run again at the latest, data or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wake {
    pub(crate) at: Timestamp,
    pub(crate) restart: bool,
}

impl Wake {
    /// Only when data arrive.
    pub fn on_data() -> Self {
        Self::at(Timestamp::from_ns(u64::MAX))
    }

    /// At `time`. For what is put out at a fixed rate: [`Timestamp::next_beat`], so that a second instance of the service keeps
    /// the same time and its takeover is not noticed.
    pub fn at(time: Timestamp) -> Self {
        Self {
            at: time,
            restart: false,
        }
    }

    /// Never again: the process ends, and the supervisor starts it anew.
    pub fn restart() -> Self {
        Self {
            restart: true,
            ..Self::on_data()
        }
    }
}

/// One run of a service.
#[derive(Debug)]
pub struct Cycle<'a> {
    /// When it was woken.
    pub now: Timestamp,
    /// Events for the pilot.
    pub events: &'a mut EventSender,
}

/// A service: opened once, then run cycle by cycle.
pub trait Service: Sized {
    /// The program's name in the topic table. A program of others stands in no row: its process is called `user_...` and has what
    /// its row of the process table grants ([`crate::config::Foreign`]).
    const PROGRAM: &'static str;
    /// Whether what it puts out follows from the samples that it takes and the time of its cycles: where something is recorded, that is,
    /// too, and the service can be replayed. Not so if it reads devices, files or links.
    const REPLAYS: bool = true;

    /// Opens topics and devices.
    ///
    /// # Errors
    /// Whatever keeps the service from working at all; it is logged and the process ends.
    fn open(ports: &mut Ports) -> Result<Self, StartError>;

    /// Does what there is to do now and says when it must run again without data.
    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake;

    /// Takes new values of the parameters that apply at once. What is known and what is under way stays; the others are
    /// as they were at the start.
    fn on_params_changed(&mut self, _params: &ParamSet) {}

    /// Descriptors whose readability starts a cycle; they may change from cycle to cycle.
    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        [None; WATCHED_FDS]
    }
}
