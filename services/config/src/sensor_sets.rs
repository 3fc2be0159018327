//! Sets of sensors that vehicles are equipped with, by name: `[[sensor]]` tables and the declarations that belong to them, as files
//! under `config/sensors`. A set of the user's own is a file like these.

use super::{ConfigError, read};
use jink_shared_types::suggestion::{DidYouMean, nearest};
use std::path::PathBuf;

macro_rules! sets {
    ($( $name:literal ),* $(,)?) => {
        /// Names and texts.
        const SETS: &[(&str, &str)] = &[$(
            ($name, include_str!(concat!("../../../config/sensors/", $name, ".toml"))),
        )*];
    };
}

sets!(
    "sphere", "mid360", "os0", "os1", "vlp16", "d435", "d435x3", "sf45", "rplidar"
);

/// A set of sensors: the text of its file, and what it is called in errors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SensorSet {
    /// Its name, or that of its file without folder and extension.
    pub name: String,
    /// Its file.
    pub file: PathBuf,
    /// What stands in it.
    pub text: String,
}

/// The names of the sets that come with jink.
pub fn names() -> impl Iterator<Item = &'static str> {
    SETS.iter().map(|(name, _)| *name)
}

/// The set called `name`; of several with a plus between them the sensors of all (`mid360+d435`), with the declarations of the
/// first that makes one; a file, if it ends in `.toml`.
///
/// # Errors
/// [`ConfigError`] naming what there is no set of, or the file that cannot be read.
pub fn named(name: &str) -> Result<SensorSet, ConfigError> {
    if name.ends_with(".toml") {
        let file = PathBuf::from(name);
        let stem = file
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        let text = read(&file)?;
        return Ok(SensorSet {
            name: stem,
            file,
            text,
        });
    }
    let mut texts = Vec::new();
    for part in name.split('+') {
        let text = SETS
            .iter()
            .find(|(known, _)| *known == part)
            .map(|(_, text)| *text);
        texts.push(text.ok_or_else(|| ConfigError {
            file: PathBuf::from(format!("--sensor {name}")),
            line: 0,
            message: format!(
                "there is no set of sensors {part:?}; known are {}, and files that end in .toml{}",
                names().collect::<Vec<_>>().join(", "),
                DidYouMean(nearest(part, names()))
            ),
        })?);
    }
    Ok(SensorSet {
        name: name.to_owned(),
        file: PathBuf::from(format!("sensors/{name}.toml")),
        text: joined(&texts),
    })
}

/// The tables of all texts in one: `[params]` of all of them first, then every `[[sensor]]` whose name is new.
fn joined(texts: &[&str]) -> String {
    if let [only] = texts {
        return (*only).to_owned();
    }
    let mut params = toml::Table::new();
    let mut sensors: Vec<toml::Value> = Vec::new();
    for table in texts.iter().filter_map(|text| text.parse::<toml::Table>().ok()) {
        for (key, value) in table
            .get("params")
            .and_then(toml::Value::as_table)
            .into_iter()
            .flatten()
        {
            params.entry(key.clone()).or_insert_with(|| value.clone());
        }
        for sensor in table
            .get("sensor")
            .and_then(toml::Value::as_array)
            .into_iter()
            .flatten()
        {
            if sensors
                .iter()
                .all(|known| known.get("name") != sensor.get("name"))
            {
                sensors.push(sensor.clone());
            }
        }
    }
    let mut whole = toml::Table::new();
    whole.insert("params".to_owned(), params.into());
    whole.insert("sensor".to_owned(), sensors.into());
    // Tables that were read can be written.
    toml::to_string(&whole).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::{named, names};
    use crate::Config;
    use jink_shared_types::params;

    #[test]
    fn every_set_is_a_configuration_with_sensors() {
        for name in names() {
            let set = named(name).unwrap();
            let config = Config::parse(&set.file, &set.text).unwrap();
            assert!(!config.sensors.is_empty(), "{name}");
        }
    }

    #[test]
    fn a_pair_has_the_sensors_of_both_and_what_either_declares() {
        let set = named("os1+d435").unwrap();
        let config = Config::parse(&set.file, &set.text).unwrap();
        let sensors: Vec<&str> = config.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
        assert_eq!(sensors, ["os1", "front"]);
        assert_eq!(config.params.get(&params::OA_DCL_START), 0.9);
        let twice = named("sf45+rplidar").unwrap();
        let config = Config::parse(&twice.file, &twice.text).unwrap();
        assert_eq!(config.sensors.len(), 3, "one rangefinder is enough");
    }

    #[test]
    fn a_set_that_does_not_exist_is_answered_with_those_that_do() {
        let error = named("mid70").unwrap_err().to_string();
        assert!(error.contains("mid360, os0, os1"), "{error}");
        assert!(
            named("/nonexistent/own.toml")
                .unwrap_err()
                .to_string()
                .contains("own.toml")
        );
    }
}
