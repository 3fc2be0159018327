//! What the state machine is told, and what it asks for.

use super::Exit;
use crate::shadow::SwapNews;
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
        /// What it does.
        doing: Doing,
        /// CPU time it has used since its start (s).
        cpu_s: f64,
        /// The core it runs on, or ran on last, is known to run.
        core_runs: bool,
    },
    /// The second instance of a process has been started as the machine asked.
    ShadowSpawned {
        /// Which process.
        process: usize,
        /// Its process id.
        pid: u32,
    },
    /// The second instance of a process has ended and been reaped, or could not be started.
    ShadowDied {
        /// Which process.
        process: usize,
        /// How.
        exit: Exit,
    },
    /// Somebody wants another binary (or the same one) to take the place of a process.
    SwapRequested {
        /// Which process.
        process: usize,
        /// Cycles of the probation.
        cycles: u64,
        /// Nothing is to be changed.
        dry_run: bool,
    },
    /// Somebody wants a process ended and started again, or started if it is down.
    RestartRequested {
        /// Which process.
        process: usize,
    },
    /// Somebody wants one process to end for good.
    EndRequested {
        /// Which process.
        process: usize,
    },
    /// Somebody asked the system to stop.
    StopRequested,
}

/// What a process is doing, as the kernel says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doing {
    /// It runs, or would if it were given a CPU.
    Runnable,
    /// It waits for something: a lock, or a timer that a machine that stood still has not served yet.
    Sleeping,
    /// It was stopped, or is no more.
    Stopped,
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
    /// Start a second instance of a process: a shadow.
    SpawnShadow {
        /// Which process.
        process: usize,
        /// Which start of it this is.
        generation: u32,
        /// From the program of the swap, not from the process's own.
        candidate: bool,
    },
    /// End the second instance of a process (SIGKILL).
    KillShadow {
        /// Which process.
        process: usize,
    },
    /// First and second instance have exchanged their places.
    Promote {
        /// Which process.
        process: usize,
    },
    /// The program of the swap is the process's program from now on.
    Commit {
        /// Which process.
        process: usize,
    },
    /// Tell whoever asked how a swap goes.
    Tell {
        /// Which process.
        process: usize,
        /// What there is to tell.
        news: SwapNews,
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
