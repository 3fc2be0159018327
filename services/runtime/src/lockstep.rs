//! Services in lock-step: all in one process, on a clock that a scheduler sets. Each is opened and run as in a process of its
//! own ([`crate::run`]); only who calls it, and what time it is, differs.
//!
//! ```
//! # use jink_runtime::lockstep::{LocalBus, Member};
//! # use jink_runtime::{Cycle, Ports, Service, Setup, StartError, Wake};
//! # use jink_runtime::config::Config;
//! # use jink_shared_types::Timestamp;
//! # use clap::Parser;
//! struct Ticker(u32);
//! impl Service for Ticker {
//!     const PROGRAM: &'static str = "planner";
//!     fn open(_: &mut Ports) -> Result<Self, StartError> { Ok(Self(0)) }
//!     fn cycle(&mut self, cycle: &mut Cycle) -> Wake {
//!         self.0 += 1;
//!         Wake::at(cycle.now.plus_seconds(0.1))
//!     }
//! }
//!
//! let bus = LocalBus::new(Timestamp::from_seconds(1000.0));
//! let setup = Setup::parse_from(["planner", "--process", "planner", "--instance", "doc"]);
//! let mut ticker = Member::<Ticker>::start(&bus, setup, Config::default()).unwrap();
//! for step in 0..100 {
//!     bus.set_clock(Timestamp::from_seconds(1000.0 + 0.01 * f64::from(step)));
//!     ticker.run_if_due();
//! }
//! assert_eq!(ticker.service().0, 10);
//! ```

pub mod program;
pub mod relay;
pub(crate) mod remote;
pub mod replay;

pub use crate::transport::local::LocalBus;

use crate::config::{Config, Foreign, is_foreign};
use crate::running::Running;
use crate::service::Service;
use crate::session::Session;
use crate::setup::{Setup, StartError};
use crate::transport::Wakeup;
use jink_shared_types::Timestamp;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::fmt;

/// What a member did when it was looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Looked {
    /// Nothing was due.
    Slept,
    /// It ran a cycle.
    Ran,
    /// It ran a cycle and wants to be started again.
    WantsRestart,
    /// It has ended by itself.
    Ended(std::process::ExitStatus),
}

/// A service in lock-step. Dropping it is what SIGKILL is to a process.
pub struct Member<S> {
    running: Running<S>,
    bus: LocalBus,
    wake: Timestamp,
    is_settled: bool,
}

impl<S> fmt::Debug for Member<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Member({})", std::any::type_name::<S>())
    }
}

impl<S: Service> Member<S> {
    /// Opens the service on `bus`, as a process started with `setup` and `config` would. Its first cycle is due at once.
    ///
    /// A process of somebody else's uses what the table in its configuration folder grants it.
    ///
    /// # Errors
    /// Whatever keeps the service from working.
    pub fn start(bus: &LocalBus, setup: Setup, config: Config) -> Result<Self, StartError> {
        let session = match is_foreign(&setup.process) {
            true => Session::local(bus, &setup.process).with(&Foreign::load(&setup.config)?),
            false => Session::local(bus, S::PROGRAM),
        };
        let is_replay = session.cycle_log.is_some();
        let mut member = Self {
            running: Running::start(session, setup, config)?,
            bus: bus.clone(),
            wake: Timestamp::NEVER,
            is_settled: false,
        };
        if is_replay {
            // What it takes does not depend on when it can: and nothing that it says waits.
            member.is_settled = member.running.settle().is_ok();
        }
        Ok(member)
    }

    /// Runs a cycle if data have come, a descriptor is readable, or it is time; sends the heartbeat if it is due.
    pub fn run_if_due(&mut self) -> Looked {
        let has_data = self.running.ports.wakeups.iter().any(Wakeup::is_set);
        let is_new_owner = self.running.attend();
        if !(has_data || is_new_owner || self.bus.now() >= self.wake || self.is_readable()) {
            return Looked::Slept;
        }
        self.run()
    }

    /// Runs a cycle.
    fn run(&mut self) -> Looked {
        for wakeup in &self.running.ports.wakeups {
            wakeup.clear();
        }
        let wake = self.running.turn();
        self.wake = wake.at;
        if !self.is_settled {
            self.is_settled = self.running.settle().is_ok();
        }
        match wake.restart {
            true => Looked::WantsRestart,
            false => Looked::Ran,
        }
    }

    /// When it is due even if nothing comes: for a cycle or for its heartbeat.
    fn due(&self) -> Timestamp {
        self.wake.min(self.running.beat_due())
    }

    /// Ends it as SIGTERM ends a process: it says so.
    pub fn terminate(mut self) {
        self.running.end();
    }

    /// The service.
    pub fn service(&self) -> &S {
        &self.running.service
    }

    /// The service.
    pub fn service_mut(&mut self) -> &mut S {
        &mut self.running.service
    }

    fn is_readable(&self) -> bool {
        let watched = self.running.service.watched();
        let mut fds: Vec<PollFd<'_>> = watched
            .into_iter()
            .flatten()
            .map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN))
            .collect();
        let at_once = Timespec {
            tv_sec: 0,
            tv_nsec: 0,
        };
        !fds.is_empty() && poll(&mut fds, Some(&at_once)).is_ok_and(|ready| ready > 0)
    }
}
