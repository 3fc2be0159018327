//! Which autopilot flies the simulated vehicle, as values laid over the configuration.
//!
//! | in | out |
//! |---|---|
//! | options, what a build of an autopilot offers | `section.key=value`, or why it cannot be |

use serde::Deserialize;
use std::path::PathBuf;
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

/// What was asked for.
#[derive(Clone, Debug, Default)]
pub struct Choice<'a> {
    /// `px4`, `px4_current` or `ardupilot`.
    pub autopilot: Option<&'a str>,
    /// Folder of a build, absolute.
    pub sitl: Option<PathBuf>,
    /// `hil`, `sih` or `json`.
    pub interface: Option<&'a str>,
    /// Instance number.
    pub instance: Option<u8>,
    /// NAME=NUMBER each.
    pub parameters: &'a [String],
    /// Working folder, absolute.
    pub folder: Option<PathBuf>,
    /// Wind.
    pub wind: Option<Wind>,
}

/// The key that says how setpoints are spoken.
const PROFILE_KEY: &str = "link.profile=";

impl Choice<'_> {
    /// What is laid over the configuration before the user's own `given`; `description` is that of the build in `sitl`.
    ///
    /// # Errors
    /// What does not fit together, in words.
    pub fn overrides(
        &self,
        description: Option<&Description>,
        profile_is_given: bool,
        given: &[String],
    ) -> Result<Vec<String>, String> {
        let profile = given
            .iter()
            .rev()
            .find_map(|text| text.strip_prefix(PROFILE_KEY))
            .map(str::trim);
        let mut overrides = match (&self.sitl, description) {
            (Some(folder), Some(description)) => {
                self.check(description, profile)?;
                self.of_sitl(folder, description, profile_is_given || profile.is_some())
            }
            _ => self.of_emulated(profile_is_given || profile.is_some()),
        };
        overrides.extend(self.wind.into_iter().flat_map(Wind::overrides));
        Ok(overrides)
    }

    fn check(&self, found: &Description, profile: Option<&str>) -> Result<(), String> {
        let asked_make = self.autopilot.map(|name| match name {
            "ardupilot" => "ardupilot",
            _ => "px4",
        });
        if asked_make.is_some_and(|asked| asked != found.autopilot) {
            return Err(format!(
                "--autopilot {}, but {} is {}",
                self.autopilot.unwrap_or_default(),
                found.program.display(),
                found.text()
            ));
        }
        if let Some(asked) = self.interface
            && !found.interfaces.iter().any(|one| one == asked)
        {
            return Err(format!(
                "--sitl-interface {asked}: this build of {} offers {}",
                found.text(),
                found.interfaces.join(", ")
            ));
        }
        let interface = self.interface.or(found.interfaces.first().map(String::as_str));
        if interface == Some("sih") && self.wind.is_some_and(|wind| wind != Wind::default()) {
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
        for parameter in self.parameters {
            let number = parameter
                .split_once('=')
                .map(|(_, value)| value.trim().parse::<f64>());
            if !matches!(number, Some(Ok(_))) || parameter.contains(',') {
                return Err(format!("--sitl-param {parameter}: expected NAME=NUMBER"));
            }
        }
        Ok(())
    }

    fn of_sitl(&self, folder: &std::path::Path, found: &Description, has_profile: bool) -> Vec<String> {
        let mut overrides = vec![format!("simulation.sitl={}", quoted(folder))];
        if !has_profile {
            overrides.push(format!("{PROFILE_KEY}{}", found.profile));
        }
        overrides.extend(
            self.interface
                .map(|name| format!("simulation.sitl_interface={name}")),
        );
        overrides.extend(
            self.instance
                .map(|number| format!("simulation.sitl_instance={number}")),
        );
        overrides.extend(
            self.folder
                .as_ref()
                .map(|folder| format!("simulation.sitl_folder={}", quoted(folder))),
        );
        if !self.parameters.is_empty() {
            overrides.push(format!(
                "simulation.sitl_parameters={:?}",
                self.parameters.join(",")
            ));
        }
        overrides
    }

    fn of_emulated(&self, has_profile: bool) -> Vec<String> {
        let Some(name) = self.autopilot else {
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

/// A path as a TOML string.
fn quoted(path: &std::path::Path) -> String {
    format!("{:?}", path.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::{Choice, Description, Wind};
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

    fn choice() -> Choice<'static> {
        Choice {
            sitl: Some(PathBuf::from("/my builds/px4")),
            ..Choice::default()
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
        let refusal = |choice: Choice<'_>, given: &[String]| {
            choice.overrides(Some(&current()), false, given).unwrap_err()
        };
        let other = Choice {
            autopilot: Some("ardupilot"),
            ..choice()
        };
        assert!(refusal(other, &[]).contains("is PX4 v1.16.0"));
        let interface = Choice {
            interface: Some("json"),
            ..choice()
        };
        assert!(refusal(interface, &[]).contains("offers hil, sih"));
        let wind = Choice {
            interface: Some("sih"),
            wind: Some("3,0".parse().unwrap()),
            ..choice()
        };
        assert!(refusal(wind, &[]).contains("--sitl-interface hil"));
        let profile = ["link.profile=px4_trajectory".to_owned()];
        assert!(refusal(choice(), &profile).contains("flown with px4_offboard"));
        let parameters = ["A=b".to_owned()];
        let parameter = Choice {
            parameters: &parameters,
            ..choice()
        };
        assert!(refusal(parameter, &[]).contains("NAME=NUMBER"));
    }

    #[test]
    fn an_emulated_autopilot_comes_with_its_profile() {
        let choice = Choice {
            autopilot: Some("ardupilot"),
            wind: Some("-2,1.5,0.5".parse().unwrap()),
            ..Choice::default()
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
