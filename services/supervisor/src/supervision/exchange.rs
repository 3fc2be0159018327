//! Inputs and outputs of the state machine.

use super::Exit;
use crate::shadow::SwapProgress;
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
    /// A process has been started as the machine requested.
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
    /// What a silent process was found doing; the answer to [`Action::Inspect`].
    Inspected {
        /// Which process.
        process: usize,
        /// What it does.
        activity: ProcessActivity,
        /// CPU time it has used since its start (s).
        cpu_s: f64,
        /// The core it runs on, or ran on last, is known to run.
        core_runs: bool,
    },
    /// The second instance of a process has been started as the machine requested.
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
    /// A request to replace a process by another binary (or the same one).
    SwapRequested {
        /// Which process.
        process: usize,
        /// Cycles of the probation.
        cycles: u64,
        /// Nothing is to be changed.
        dry_run: bool,
    },
    /// A request to end a process and start it again, or to start it if it is down.
    RestartRequested {
        /// Which process.
        process: usize,
    },
    /// A request to end a process for good.
    EndRequested {
        /// Which process.
        process: usize,
    },
    /// A request to stop the system.
    StopRequested,
}

/// What a process is doing, as the kernel reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessActivity {
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
    Inspect {
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
    /// The program before the last [`Self::Commit`] is the process's program again.
    TakeBack {
        /// Which process.
        process: usize,
    },
    /// Report to the client that requested a swap how it goes.
    ReportSwap {
        /// Which process.
        process: usize,
        /// The step it has reached.
        progress: SwapProgress,
    },
    /// Remove what dead processes left in shared memory.
    CleanUp,
    /// Publish an event, for the pilot among others.
    PublishEvent(EventSample),
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
