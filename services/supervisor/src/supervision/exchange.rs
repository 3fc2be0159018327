//! What the state machine is told, and what it asks for.

use super::Exit;
use jink_shared_types::Timestamp;
use jink_shared_types::events::EventSample;
use jink_shared_types::health::Heartbeat;

/// Something that happened. Processes are indices into the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Observation {
    /// A process sent a heartbeat.
    Heartbeat {
        /// Which process.
        process: usize,
        /// The heartbeat.
        heartbeat: Heartbeat,
        /// When it was published.
        time: Timestamp,
    },
    /// A process has been started as the machine asked.
    Spawned {
        /// Which process.
        process: usize,
        /// Its process id.
        pid: u32,
    },
    /// A process has ended and been reaped, or could not be started.
    Died {
        /// Which process.
        process: usize,
        /// How.
        exit: Exit,
    },
    /// What a silent process was found doing; the answer to [`Action::Examine`].
    Examined {
        /// Which process.
        process: usize,
        /// It runs, or would if it were given a CPU; not stopped, not waiting for anything else.
        runnable: bool,
        /// CPU time it has used since its start (s).
        cpu_s: f64,
    },
    /// Somebody asked the system to stop.
    StopRequested,
}

/// Something to do, in order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// Start a process.
    Spawn {
        /// Which process.
        process: usize,
        /// Which start of it this is.
        generation: u32,
    },
    /// Ask a process to end (SIGTERM).
    Terminate {
        /// Which process.
        process: usize,
    },
    /// See what a silent process is doing.
    Examine {
        /// Which process.
        process: usize,
    },
    /// End a process (SIGKILL).
    Kill {
        /// Which process.
        process: usize,
    },
    /// Remove what dead processes left in shared memory.
    CleanUp,
    /// Tell the pilot.
    Raise(EventSample),
    /// Everything has ended: leave.
    End(End),
}

/// How a system ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// On request.
    Stopped,
    /// This process could not start while the system came up.
    CannotStart {
        /// Which process.
        process: usize,
    },
    /// This process was given up and its row says that the system then stops.
    GaveUp {
        /// Which process.
        process: usize,
    },
}
