//! What every service's `main` uses: topics from the table, an event-driven loop, heartbeats, deadlines,
//! configuration, logging. A service implements [`Service`] and calls [`run::<S>()`](run).
//!
//! ```no_run
//! use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, Wake};
//! use jink_shared_types::motion::{ApprovedTrajectory, Route};
//! use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
//!
//! struct Echo {
//!     approved: Input<ApprovedTrajectory>,
//!     route: Output<Route>,
//! }
//!
//! impl Service for Echo {
//!     const PROGRAM: &'static str = "planner";
//!
//!     fn open(ports: &mut Ports) -> Result<Self, StartError> {
//!         Ok(Self {
//!             approved: ports.trigger(topics::APPROVED)?,
//!             route: ports.output(topics::ROUTE)?,
//!         })
//!     }
//!
//!     fn cycle(&mut self, cycle: &mut Cycle) -> Wake {
//!         if let Some(approved) = self.approved.latest(cycle.now).fresh() {
//!             let header = approved.header.derived(Stage::Planner, cycle.now);
//!             self.route.send(header, &Route::default());
//!         }
//!         Wake::at(cycle.now.next_beat(30))
//!     }
//! }
//!
//! fn main() -> std::process::ExitCode {
//!     jink_runtime::run::<Echo>()
//! }
//! ```
//!
//! | module | holds |
//! |---|---|
//! | [`config`] | `jink.toml`: read, checked, errors with file, line and nearest key |
//! | `instance` | names and folders that keep two jinks on one host apart |
//! | [`session`] | one program's connection to its topics; [`Input`] and [`Output`] |
//! | [`ports`] | the topics of a service with its configuration, clock and ownership |
//! | `setup` | what a service is started with |
//! | [`service`] | what a service is |
//! | `process_loop` | the loop of its process |
//! | [`lockstep`] | services in one process on a virtual clock, for campaigns and tests |
//! | `clock` | the board's clock, or a simulated one |
//! | `cycle_log` | what each cycle took of its inputs, for recordings and replays |
//! | [`heartbeat`] | cycle statistics |
//! | `param_store` | changed parameters that outlive the process that changed them |
//! | `ranges` | the range topics of all configured sensors |
//! | [`device`] | drivers: who reads a device, when the others run, what no driver does differently |
//! | [`members`] | who the members of the families of topics are |
//! | [`cleanup`] | what the dead left behind |
//! | [`room`] | what topics take of shared memory, what there is, and taking it before the flight |
//! | [`request`] | what can be asked of a running supervisor |
//! | [`procfs`] | what the kernel says of processes and of the board |
//! | [`programs`] | which file holds which of jink's programs |
//! | [`serial`] | serial ports, of devices and of links |
//! | [`realtime`] | memory locking, scheduling, clock |
//! | [`descriptors`] | room for open files, made before there are threads |
//! | [`logging`] | `tracing` for people and for journals |
//! | [`spool`] | what is written for a disk goes through memory, so that a disk that hangs hangs nobody |
//! | [`file_series`] | files of one kind in a folder, limited together |

pub mod cleanup;
mod clock;
mod cycle_log;
pub mod descriptors;
pub mod device;
mod events;
pub mod file_series;
pub mod heartbeat;
mod input;
mod instance;
pub mod lockstep;
pub mod logging;
pub mod members;
mod open_error;
mod output;
mod ownership;
mod param_store;
pub mod ports;
mod prefault;
mod process_loop;
pub mod procfs;
pub mod programs;
mod ranges;
pub mod realtime;
pub mod request;
pub mod room;
mod running;
pub mod serial;
pub mod service;
pub mod session;
mod setup;
pub mod spool;
mod transport;

pub use jink_config as config;

pub use clock::Clock;
pub use events::EventSender;
pub use input::{Checks, Input};
pub use instance::Instance;
pub use open_error::OpenError;
pub use output::Output;
pub use param_store::{ParamStore, StoreWriter};
pub use ports::{ExclusiveOwnership, Latency, Ports};
pub use process_loop::run;
pub use ranges::{RangeInputs, RangeSample};
pub use realtime::now;
pub use service::{Cycle, Service, Wake};
pub use session::Session;
pub use setup::{Setup, StartError};
