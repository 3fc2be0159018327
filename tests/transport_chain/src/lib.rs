//! A chain of processes that only hand samples on, for measuring what a transport costs: sensor, fusion, planner, generator, guard,
//! gateway, each a process, each waiting for the one before it.
//!
//! The first process fills a message at a fixed rate, with the time at which it began to fill it in every word. Each of the others
//! reads every word of what it gets and fills a message of its own size. The last one notes when it has read its message. The time
//! between the two is the latency of the chain.
//!
//! A program that measures a transport implements [`Incoming`] and [`Outgoing`] for it and calls [`program::run`] in its `main`.
//!
//! | module | holds |
//! |---|---|
//! | [`message`] | what is filled and read |
//! | [`stage`] | one process |
//! | `chain` | all of them, started, watched and ended; what was measured |
//! | [`program`] | the command line of a program that measures transports |

mod chain;
pub mod message;
pub mod program;
pub mod stage;

pub use chain::{Chain, Round};
pub use stage::{Account, Incoming, Outgoing, StageArgs};

/// Whatever keeps a transport from being measured; its text is for people.
pub type Fault = Box<dyn std::error::Error + Send + Sync>;

/// Names of the processes, in order.
pub const PLACES: [&str; 6] = ["sensor", "fusion", "planner", "generator", "guard", "gateway"];

/// CLOCK_MONOTONIC (ns).
pub fn now_ns() -> u64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    time.tv_sec.unsigned_abs() * 1_000_000_000 + time.tv_nsec.unsigned_abs()
}
