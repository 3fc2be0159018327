//! Which autopilot flies a simulated vehicle, an emulated one or somebody's build of a real one, as values laid over the configuration.
//!
//! | in | out |
//! |---|---|
//! | options of the user, what a build of an autopilot offers | `section.key=value`, or why it cannot be |

use crate::{Problem, places};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// What `jink-simulator sitl --json` says about a build.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq)]
pub struct Description {
    /// `px4` or `ardupilot`.
    pub autopilot: String,
    /// Version as the build names it; may be empty.
    pub version: String,
    /// The program.
    pub program: PathBuf,
    /// The profile that fits it best.
    pub profile: String,
    /// All that can fly it.
    pub profiles: Vec<String>,
    /// How it can be simulated, best first.
    pub interfaces: Vec<String>,
}

impl Description {
    /// For people.
    pub fn text(&self) -> String {
        let name = match self.autopilot.as_str() {
            "ardupilot" => "ArduCopter",
            _ => "PX4",
        };
        let version = match self.version.as_str() {
            "" => "of unknown version",
            version => version,
        };
        format!("{name} {version} ({})", self.program.display())
    }
}

/// Wind (m/s).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wind {
    north_mps: f64,
    east_mps: f64,
    gust_mps: f64,
}

/// More than a storm; a typing error (m/s).
const WIND_MAX_MPS: f64 = 30.0;

impl FromStr for Wind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|one| one.trim().parse()).collect();
        let wind = match numbers.as_deref() {
            Ok([north_mps, east_mps]) => Self {
                north_mps: *north_mps,
                east_mps: *east_mps,
                gust_mps: 0.0,
            },
            Ok([north_mps, east_mps, gust_mps]) => Self {
                north_mps: *north_mps,
                east_mps: *east_mps,
                gust_mps: *gust_mps,
            },
            _ => return Err("expected NORTH,EAST or NORTH,EAST,GUST in m/s".to_owned()),
        };
        let all = [wind.north_mps, wind.east_mps, wind.gust_mps];
        if all.iter().all(|one| one.abs() <= WIND_MAX_MPS) && wind.gust_mps >= 0.0 {
            return Ok(wind);
        }
        Err(format!("at most {WIND_MAX_MPS} m/s, gusts not below 0"))
    }
}

impl Wind {
    fn overrides(self) -> [String; 3] {
        // Numbers with a point: the keys take no whole ones.
        [
            format!("simulation.wind_north_mps={:?}", self.north_mps),
            format!("simulation.wind_east_mps={:?}", self.east_mps),
            format!("simulation.wind_gust_mps={:?}", self.gust_mps),
        ]
    }
}

/// The options of `jink up --world` and `jink demo`.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Autopilot of the simulated vehicle")]
pub struct Args {
    /// Whose autopilot: px4, px4_current (as emulated: PX4 without the trajectory interface), ardupilot
    #[arg(long, value_name = "NAME", value_parser = ["px4", "px4_current", "ardupilot"])]
    autopilot: Option<String>,
    /// A real one in simulation instead of an emulated one: source folder with a build for SITL, or the build folder
    #[arg(long, value_name = "DIR")]
    sitl: Option<PathBuf>,
    /// How it is simulated [default: the best the build offers]: hil, sih (PX4), json (ArduPilot)
    #[arg(long, value_name = "NAME", requires = "sitl", value_parser = ["hil", "sih", "json"])]
    sitl_interface: Option<String>,
    /// Its instance number, 0 to 9 [default: the first one whose ports are free]
    #[arg(long, value_name = "N", requires = "sitl", value_parser = clap::value_parser!(u8).range(0..=9))]
    sitl_instance: Option<u8>,
    /// Parameter it starts with, over its defaults and those jink's profile needs (repeatable)
    #[arg(long = "sitl-param", value_name = "NAME=NUMBER", requires = "sitl")]
    sitl_parameters: Vec<String>,
    /// Its working folder, kept afterwards with its logs [default: a temporary one]
    #[arg(long, value_name = "DIR", requires = "sitl")]
    sitl_folder: Option<PathBuf>,
    /// Wind in m/s, where the air moves to, and the standard deviation of its gusts
    #[arg(long, value_name = "NORTH,EAST[,GUST]", allow_hyphen_values = true)]
    wind: Option<Wind>,
}

/// The key that says how setpoints are sent.
const PROFILE_KEY: &str = "link.profile=";

impl Args {
    /// Whether anything was asked for.
    pub fn is_given(&self) -> bool {
        self.autopilot.is_some() || self.sitl.is_some() || self.wind.is_some()
    }

    /// Whether a real autopilot flies.
    pub fn is_sitl(&self) -> bool {
        self.sitl.is_some()
    }

    /// What a person wants to know about the build that was found; `None` for an emulated autopilot.
    pub fn describe(&self, programs: &Path) -> Result<Option<Description>, Problem> {
        let Some(folder) = &self.sitl else {
            return Ok(None);
        };
        let answer = places::program(programs, "jink-simulator")?
            .arg("sitl")
            .arg("--json")
            .arg(folder)
            .output()
            .map_err(Problem::io("jink-simulator"))?;
        if !answer.status.success() {
            let words = String::from_utf8_lossy(&answer.stderr);
            let words = words.trim().trim_start_matches("jink-simulator sitl: ");
            return Err(Problem::Other(words.to_owned()));
        }
        let description = serde_json::from_slice(&answer.stdout).map_err(|error| {
            Problem::Other(format!("the description of the build is not understood: {error}"))
        })?;
        Ok(Some(description))
    }

    /// What is laid over the configuration before the user's own `given`; `description` as [`Args::describe`] gave it.
    ///
    /// # Errors
    /// What does not fit together, in words.
    pub fn overrides(
        &self,
        description: Option<&Description>,
        profile_is_given: bool,
        given: &[String],
    ) -> Result<Vec<String>, Problem> {
        let profile = given
            .iter()
            .rev()
            .find_map(|text| text.strip_prefix(PROFILE_KEY))
            .map(str::trim);
        let mut overrides = match (&self.sitl, description) {
            (Some(folder), Some(description)) => {
                self.check(description, profile).map_err(Problem::Other)?;
                self.of_sitl(folder, description, profile_is_given || profile.is_some())?
            }
            _ => self.of_emulated(profile_is_given || profile.is_some()),
        };
        overrides.extend(self.wind.into_iter().flat_map(Wind::overrides));
        Ok(overrides)
    }

    fn check(&self, found: &Description, profile: Option<&str>) -> Result<(), String> {
        let asked_make = self.autopilot.as_deref().map(|name| match name {
            "ardupilot" => "ardupilot",
            _ => "px4",
        });
        if asked_make.is_some_and(|asked| asked != found.autopilot) {
            return Err(format!(
                "--autopilot {}, but {} is {}",
                self.autopilot.as_deref().unwrap_or_default(),
                found.program.display(),
                found.text()
            ));
        }
        if let Some(asked) = &self.sitl_interface
            && !found.interfaces.iter().any(|one| one == asked)
        {
            return Err(format!(
                "--sitl-interface {asked}: this build of {} offers {}",
                found.text(),
                found.interfaces.join(", ")
            ));
        }
        let interface = self.sitl_interface.as_ref().or(found.interfaces.first());
        if interface.is_some_and(|name| name == "sih")
            && self.wind.is_some_and(|wind| wind != Wind::default())
        {
            return Err(
                "--wind: PX4's built-in vehicle (sih) knows none; use --sitl-interface hil, if the build offers it"
                    .to_owned(),
            );
        }
        if let Some(profile) = profile
            && !found.profiles.iter().any(|one| one == profile)
        {
            return Err(format!(
                "link.profile {profile} does not fit {}: it is flown with {}",
                found.text(),
                found.profiles.join(" or ")
            ));
        }
        for parameter in &self.sitl_parameters {
            let number = parameter
                .split_once('=')
                .map(|(_, value)| value.trim().parse::<f64>());
            if !matches!(number, Some(Ok(_))) || parameter.contains(',') {
                return Err(format!("--sitl-param {parameter}: expected NAME=NUMBER"));
            }
        }
        Ok(())
    }

    fn of_sitl(&self, folder: &Path, found: &Description, has_profile: bool) -> Result<Vec<String>, Problem> {
        let mut overrides = vec![format!("simulation.sitl={}", quoted(folder)?)];
        if !has_profile {
            overrides.push(format!("{PROFILE_KEY}{}", found.profile));
        }
        if let Some(name) = &self.sitl_interface {
            overrides.push(format!("simulation.sitl_interface={name}"));
        }
        if let Some(number) = self.sitl_instance {
            overrides.push(format!("simulation.sitl_instance={number}"));
        }
        if let Some(folder) = &self.sitl_folder {
            overrides.push(format!("simulation.sitl_folder={}", quoted(folder)?));
        }
        if !self.sitl_parameters.is_empty() {
            overrides.push(format!(
                "simulation.sitl_parameters={:?}",
                self.sitl_parameters.join(",")
            ));
        }
        Ok(overrides)
    }

    fn of_emulated(&self, has_profile: bool) -> Vec<String> {
        let Some(name) = self.autopilot.as_deref() else {
            return Vec::new();
        };
        let mut overrides = vec![format!("simulation.autopilot={name}")];
        let profile = match name {
            "ardupilot" => "ardupilot_guided",
            "px4_current" => "px4_offboard",
            _ => "px4_trajectory",
        };
        if !has_profile {
            overrides.push(format!("{PROFILE_KEY}{profile}"));
        }
        overrides
    }
}

/// A path as a TOML string, absolute: who reads it has another working folder.
fn quoted(path: &Path) -> Result<String, Problem> {
    let path = std::path::absolute(path).map_err(Problem::io(path.display().to_string()))?;
    Ok(format!("{:?}", path.display().to_string()))
}

#[cfg(test)]
mod tests {
    use super::{Args, Description, Wind};
    use std::path::PathBuf;

    fn current() -> Description {
        Description {
            autopilot: "px4".to_owned(),
            version: "v1.16.0".to_owned(),
            program: "/x/bin/px4".into(),
            profile: "px4_offboard".to_owned(),
            profiles: vec!["px4_offboard".to_owned()],
            interfaces: vec!["hil".to_owned(), "sih".to_owned()],
        }
    }

    fn choice() -> Args {
        Args {
            sitl: Some(PathBuf::from("/my builds/px4")),
            ..Args::default()
        }
    }

    #[test]
    fn the_profile_is_the_one_that_fits_unless_the_user_names_one() {
        let overrides = choice().overrides(Some(&current()), false, &[]).unwrap();
        assert_eq!(
            overrides,
            ["simulation.sitl=\"/my builds/px4\"", "link.profile=px4_offboard"]
        );
        let named = ["link.profile=px4_offboard".to_owned()];
        let overrides = choice().overrides(Some(&current()), false, &named).unwrap();
        assert_eq!(overrides.len(), 1);
        assert_eq!(choice().overrides(Some(&current()), true, &[]).unwrap().len(), 1);
    }

    #[test]
    fn what_does_not_fit_is_refused_in_words() {
        let refusal = |choice: Args, given: &[String]| {
            let refused = choice.overrides(Some(&current()), false, given);
            refused.unwrap_err().to_string()
        };
        let other = Args {
            autopilot: Some("ardupilot".to_owned()),
            ..choice()
        };
        assert!(refusal(other, &[]).contains("is PX4 v1.16.0"));
        let interface = Args {
            sitl_interface: Some("json".to_owned()),
            ..choice()
        };
        assert!(refusal(interface, &[]).contains("offers hil, sih"));
        let wind = Args {
            sitl_interface: Some("sih".to_owned()),
            wind: Some("3,0".parse().unwrap()),
            ..choice()
        };
        assert!(refusal(wind, &[]).contains("--sitl-interface hil"));
        let profile = ["link.profile=px4_trajectory".to_owned()];
        assert!(refusal(choice(), &profile).contains("flown with px4_offboard"));
        let parameter = Args {
            sitl_parameters: vec!["A=b".to_owned()],
            ..choice()
        };
        assert!(refusal(parameter, &[]).contains("NAME=NUMBER"));
    }

    #[test]
    fn an_emulated_autopilot_comes_with_its_profile() {
        let choice = Args {
            autopilot: Some("ardupilot".to_owned()),
            wind: Some("-2,1.5,0.5".parse().unwrap()),
            ..Args::default()
        };
        assert_eq!(
            choice.overrides(None, false, &[]).unwrap(),
            [
                "simulation.autopilot=ardupilot",
                "link.profile=ardupilot_guided",
                "simulation.wind_north_mps=-2.0",
                "simulation.wind_east_mps=1.5",
                "simulation.wind_gust_mps=0.5",
            ]
        );
    }

    #[test]
    fn wind_is_two_or_three_numbers() {
        for wrong in ["", "1", "1,2,3,4", "a,b", "1,2,-1", "99,0", "nan,0"] {
            assert!(wrong.parse::<Wind>().is_err(), "{wrong}");
        }
    }
}
