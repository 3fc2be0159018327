//! What every program needs that operates an instance of jink from outside: `jink`, and the programs of simulations beside it.
//!
//! | module | does |
//! |---|---|
//! | [`places`], [`beside`] | finds programs and configuration, becomes another program |
//! | [`supervisor`], [`running`] | starts an instance; whether one runs, and stopping it |
//! | [`request`] | asks its supervisor for a swap, a restart, a stop |
//! | [`watch`], [`meter`] | reads its topics |
//! | [`status`], [`parameters`] | its state and its parameters, for people and as JSON |
//! | [`narrate`], [`known_space`], [`speed_limit`], [`figures`] | says what it does in words and figures |
//! | [`findings`] | verdict and table of an examination, or JSON |
//! | [`worlds`], [`autopilot`], [`ports`] | virtual worlds and simulated autopilots, as values laid over the configuration |
//! | [`arguments`] | reads the command line |
//! | [`Problem`], [`Interrupt`] | why a command ends |

/// Like `print!`, but somebody who reads no further (`| head`) is no reason to end, least of all in the middle of a
/// flight.
#[macro_export]
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let mut out = std::io::stdout().lock();
        let _nobody_reads = write!(out, $($text)*).and_then(|()| out.flush());
    }};
}

/// The same with the end of a line.
#[macro_export]
macro_rules! sayln {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _nobody_reads = writeln!(std::io::stdout(), $($text)*);
    }};
}

pub mod arguments;
pub mod autopilot;
pub mod beside;
pub mod figures;
pub mod findings;
mod interrupt;
pub mod known_space;
pub mod meter;
pub mod narrate;
pub mod parameters;
pub mod places;
pub mod planned_speed;
pub mod ports;
mod problem;
pub mod provenance;
pub mod request;
pub mod running;
pub mod speed_limit;
pub mod status;
pub mod supervisor;
pub mod watch;
pub mod worlds;

pub use interrupt::Interrupt;
pub use problem::{EXIT_NOT_RUNNING, EXIT_PROBLEM, Problem};

/// The instance of whoever names none.
pub const DEFAULT_INSTANCE: &str = "default";
