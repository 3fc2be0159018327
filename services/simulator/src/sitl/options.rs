//! What to start, and with what around it.

use super::build::{Interface, SitlBuild};
use jink_simulated_world::vehicle::wind::WindConfig;
use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;

/// A simulation to start.
#[derive(Clone, Debug)]
pub struct SitlOptions {
    /// Which autopilot.
    pub build: SitlBuild,
    /// How it is simulated; `None` = the best that the build offers.
    pub interface: Option<Interface>,
    /// Number of the autopilot's instance, 0 to 9: its ports count from it; `None` = the first whose ports are free.
    pub instance: Option<u8>,
    /// Working folder of the autopilot, made if it is not there.
    pub folder: PathBuf,
    /// What the autopilot prints; `None` = `sitl.log` in its working folder.
    pub log: Option<PathBuf>,
    /// Parameters that lie over the build's defaults from the start.
    pub parameters: Vec<(String, f64)>,
    /// Where the companion listens: jink's `udpin:`.
    pub companion: SocketAddr,
    /// Where a ground station listens.
    pub ground_station: Option<SocketAddr>,
    /// Wind.
    pub wind: WindConfig,
    /// Seed of instruments and gusts.
    pub seed: u64,
}

impl SitlOptions {
    /// `build` in `folder` for the companion at `companion`, without a ground station, in still air.
    pub fn new(build: SitlBuild, companion: SocketAddr, folder: PathBuf) -> Self {
        Self {
            build,
            interface: None,
            instance: None,
            folder,
            log: None,
            parameters: Vec::new(),
            companion,
            ground_station: None,
            wind: WindConfig::default(),
            seed: 1,
        }
    }

    /// The interface in force.
    ///
    /// # Errors
    /// One that the build does not offer, or that cannot do what is asked for.
    pub fn interface(&self) -> Result<Interface, Unsupported> {
        let offered = &self.build.interfaces;
        let interface = match self.interface {
            Some(asked) if !offered.contains(&asked) => {
                return Err(Unsupported::Interface {
                    asked,
                    offered: offered.clone(),
                });
            }
            Some(asked) => asked,
            None => *offered.first().ok_or(Unsupported::NoInterface)?,
        };
        let still = self.wind.mean_mps == [0.0; 3] && self.wind.gust_sigma_mps == 0.0;
        if !interface.has_our_vehicle() && !still {
            return Err(Unsupported::WindInSih);
        }
        Ok(interface)
    }
}

/// What cannot be simulated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unsupported {
    /// The build has no such interface.
    Interface {
        /// Asked for.
        asked: Interface,
        /// What there is.
        offered: Vec<Interface>,
    },
    /// The build has none at all.
    NoInterface,
    /// Wind with PX4's built-in vehicle.
    WindInSih,
}

impl fmt::Display for Unsupported {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Interface { asked, offered } => {
                let names: Vec<_> = offered.iter().map(|one| one.name()).collect();
                write!(
                    f,
                    "this build has no interface {}: it offers {}",
                    asked.name(),
                    names.join(", ")
                )
            }
            Self::NoInterface => f.write_str("this build offers no interface to a simulator"),
            Self::WindInSih => f.write_str(
                "wind needs a vehicle of this simulator (interface hil): PX4's built-in vehicle (sih) knows none",
            ),
        }
    }
}
impl std::error::Error for Unsupported {}
