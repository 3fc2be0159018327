//! Real autopilots in simulation (SITL): starts somebody's build of PX4 or ArduCopter and is its simulator.
//!
//! | in | out |
//! |---|---|
//! | [`SitlBuild`], [`SitlOptions`] | a running [`Sitl`]: [`SitlSample`]s of the truth, two MAVLink links |
//!
//! ```no_run
//! use jink_simulator::sitl::{Sitl, SitlBuild, SitlOptions};
//! use std::path::Path;
//!
//! let build = SitlBuild::find(Path::new("/home/me/PX4-Autopilot"))?;
//! let companion = "127.0.0.1:14540".parse()?;
//! let mut options = SitlOptions::new(build, companion, "/tmp/px4_of_mine".into());
//! options.parameters.push(("COM_OBS_AVOID".to_owned(), 1.0));
//! let mut sitl = Sitl::start(options)?;
//! while sitl.ended().is_none() {
//!     for sample in sitl.wait(std::time::Duration::from_millis(100)) {
//!         println!("{:.1} m up", -sample.truth.position.z_m);
//!     }
//! }
//! sitl.stop();
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Physics, instruments and packets are pure steps; sockets, processes and clocks are in `run`, `relay` and `process`. The
//! autopilot runs in lock-step with the physics, and both are paced to real time, as everything else of jink runs in it.

mod build;
mod error;
pub mod hil;
pub mod instruments;
pub mod json;
mod launch;
mod options;
mod ports;
mod process;
pub mod quadrotor;
mod relay;
mod run;
pub mod sih;
mod stage;
mod watch;

pub use build::{FindError, Interface, SitlBuild};
pub use error::StartError;
pub use options::{SitlOptions, Unsupported};
pub use ports::{PortError, SitlPorts};
pub use run::Sitl;
pub use stage::SitlSample;
pub use watch::AutopilotState;
