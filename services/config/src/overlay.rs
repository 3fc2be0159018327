//! Overlays: the configuration file, then a profile, then the command line, each checked on its own so that an error
//! names the file and line (or the argument) it comes from.

use super::{
    CONFIG_FILE, Config, ConfigError, Viewer, all_mistakes, is_user_kind, line_of, parse_toml, read,
    sensor_sets, with_nearest,
};
use crate::sensor_table::Told;
use jink_shared_types::params::{Param, ParamError};
use jink_shared_types::suggestion::{DidYouMean, nearest};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::{Spanned, Table, Value};

/// Folder of the profiles inside a configuration folder.
pub const PROFILE_FOLDER: &str = "profiles";

/// Begins the line of a merged configuration that says which file its sensors come from.
const SENSORS_FROM: &str = "# Sensors from: ";

/// The `[[sensor]]` tables of a configuration.
#[derive(Deserialize)]
#[serde(bound = "T: DeserializeOwned")]
struct Sensors<T> {
    #[serde(default = "Vec::new")]
    sensor: Vec<T>,
}

/// The `[[sensor]]` tables of the configuration in `folder`, with the keys that only their drivers know.
///
/// # Errors
/// [`ConfigError`] naming file and line as the user wrote them, not those of the merged configuration.
pub fn sensors<T: DeserializeOwned>(folder: &Path) -> Result<Vec<T>, ConfigError> {
    let parse = |file: &Path, text: &str| parse_toml::<Sensors<T>>(file, text).map(|sensors| sensors.sensor);
    let merged = folder.join(CONFIG_FILE);
    let text = read(&merged)?;
    parse(&merged, &text).map_err(|error| {
        let origin = text.lines().find_map(|line| line.strip_prefix(SENSORS_FROM));
        let in_origin = origin.and_then(|file| {
            let file = Path::new(file);
            parse(file, &read(file).ok()?).err()
        });
        in_origin.unwrap_or(error)
    })
}

/// Those of [`sensors`] whose kind is none of others, for a driver that knows every kind of ours. Beside a sensor of others an
/// error names the line where the table begins.
///
/// # Errors
/// As [`sensors`].
pub fn sensors_of_ours<T: DeserializeOwned>(folder: &Path) -> Result<Vec<T>, ConfigError> {
    #[derive(Deserialize)]
    struct Kind {
        kind: String,
    }
    let kinds: Vec<Kind> = sensors(folder)?;
    if !kinds.iter().any(|table| is_user_kind(&table.kind)) {
        return sensors(folder);
    }
    #[derive(Deserialize)]
    struct Tables {
        sensor: Vec<Spanned<Table>>,
    }
    let file = folder.join(CONFIG_FILE);
    let text = read(&file)?;
    let tables: Tables = parse_toml(&file, &text)?;
    let tables = tables.sensor.into_iter().zip(kinds);
    let ours = tables.filter(|(_, table)| !is_user_kind(&table.kind));
    ours.map(|(table, _)| of_table(&file, &text, table)).collect()
}

/// File and line, as the user wrote them, of `key` in the table of the sensor called `sensor`; of the table's beginning, where it has
/// no such key. For the errors of drivers, which know what a value may be.
pub fn sensor_place(folder: &Path, sensor: &str, key: &str) -> Option<(PathBuf, usize)> {
    let merged = folder.join(CONFIG_FILE);
    let text = read(&merged).ok()?;
    let origin = text.lines().find_map(|line| line.strip_prefix(SENSORS_FROM));
    let file = origin.map_or(merged, PathBuf::from);
    let line = line_of_sensor(&read(&file).ok()?, sensor, Some(key))?;
    Some((file, line))
}

/// The line of `key` in the table of the sensor called `sensor`; of the table's beginning, where it has no such key.
fn line_of_sensor(text: &str, sensor: &str, key: Option<&str>) -> Option<usize> {
    let tables: Sensors<Spanned<BTreeMap<Spanned<String>, Value>>> = toml::from_str(text).ok()?;
    let is_meant = |table: &&Spanned<BTreeMap<Spanned<String>, Value>>| {
        let mut keys = table.get_ref().iter();
        keys.any(|(key, value)| key.get_ref() == "name" && value.as_str() == Some(sensor))
    };
    let table = tables.sensor.iter().find(is_meant)?;
    let mut keys = table.get_ref().keys();
    let written = keys.find(|written| Some(written.get_ref().as_str()) == key);
    let offset = written.map_or(table.span().start, |written| written.span().start);
    Some(line_of(text, offset))
}

/// A configuration with every overlay applied.
#[derive(Clone, Debug, Default)]
pub struct Resolved {
    /// As a configuration file, to be given to the services.
    pub text: String,
    /// As values.
    pub config: Config,
}

/// One of the texts of which a configuration is made, without the mistakes that were found in it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Layer {
    /// Its file, or the argument.
    pub file: PathBuf,
    /// What stands there.
    pub text: String,
    /// It is an argument: there are no lines.
    is_argument: bool,
}

impl Layer {
    /// The text of `file`.
    pub fn of(file: &Path, text: &str) -> Self {
        Self {
            file: file.to_owned(),
            text: text.to_owned(),
            is_argument: false,
        }
    }

    /// The line of `section.key`; 0 in an argument, `None` where the key is not given.
    fn line(&self, section: &str, key: &str) -> Option<usize> {
        let tables: BTreeMap<String, Spanned<Value>> = toml::from_str(&self.text).ok()?;
        let table = tables.get(section)?;
        table.get_ref().get(key)?;
        let span = table.span();
        let from = line_of(&self.text, span.start);
        let mut lines = self.text.lines().enumerate().skip(from.saturating_sub(1));
        let is_it = |line: &str| line.split('=').next().is_some_and(|word| word.trim() == key);
        let line = lines
            .find(|(_, line)| is_it(line))
            .map_or(from, |(index, _)| index + 1);
        Some(if self.is_argument { 0 } else { line })
    }

    /// What `parse` finds wrong with the table of the sensor called `sensor`, of which it is given the table alone; nothing, where there
    /// is none that reads as `T`.
    pub fn mistakes_of_sensor<T: DeserializeOwned>(
        &self,
        sensor: &str,
        parse: impl Fn(&[T]) -> Result<(), Told>,
    ) -> Vec<ConfigError> {
        let examined = all_mistakes(&self.text, |text| {
            let tables: Sensors<Table> = parse_toml(&self.file, text)?;
            let is_meant = |table: &Table| table.get("name").and_then(Value::as_str) == Some(sensor);
            let table = tables.sensor.into_iter().find(is_meant);
            let table = table.and_then(|table| Value::Table(table).try_into().ok());
            let Some((table, begin)) = table.zip(line_of_sensor(text, sensor, None)) else {
                return Ok(());
            };
            parse(&[table]).map_err(|(key, message)| ConfigError {
                file: self.file.clone(),
                line: key
                    .and_then(|key| line_of_sensor(text, sensor, Some(&key)))
                    .unwrap_or(begin),
                message,
            })
        });
        examined.mistakes
    }

    /// What is wrong with the tables of sensors of ours, read as `T`.
    pub fn mistakes_of_sensors_as<T: DeserializeOwned>(&self) -> SensorsExamined {
        #[derive(Deserialize)]
        struct Kind {
            #[serde(default)]
            kind: String,
        }
        #[derive(Deserialize)]
        struct Tables {
            #[serde(default)]
            sensor: Vec<Spanned<Table>>,
        }
        let examined = all_mistakes(&self.text, |text| {
            let kinds: Sensors<Kind> = parse_toml(&self.file, text)?;
            if !kinds.sensor.iter().any(|table| is_user_kind(&table.kind)) {
                return parse_toml::<Sensors<T>>(&self.file, text).map(|_| ());
            }
            let tables: Tables = parse_toml(&self.file, text)?;
            let tables = tables.sensor.into_iter().zip(kinds.sensor);
            for (table, _) in tables.filter(|(_, table)| !is_user_kind(&table.kind)) {
                of_table::<T>(&self.file, text, table)?;
            }
            Ok(())
        });
        SensorsExamined {
            mistakes: examined.mistakes,
            layer: Self {
                text: examined.text,
                ..self.clone()
            },
        }
    }
}

/// Tables of sensors, and what is wrong with them.
#[derive(Clone, Debug)]
pub struct SensorsExamined {
    /// Everything that is wrong.
    pub mistakes: Vec<ConfigError>,
    /// What is right.
    pub layer: Layer,
}

/// One `[[sensor]]` table, with an error that names the line where the table begins.
fn of_table<T: DeserializeOwned>(file: &Path, text: &str, table: Spanned<Table>) -> Result<T, ConfigError> {
    let line = line_of(text, table.span().start);
    let sensor = Value::Table(table.into_inner()).try_into();
    sensor.map_err(|error: toml::de::Error| ConfigError {
        file: file.to_owned(),
        line,
        message: with_nearest(error.message()),
    })
}

/// What is right and what is wrong with a configuration and all that lies over it.
#[derive(Clone, Debug, Default)]
pub struct Examined {
    /// The configuration without what is wrong.
    pub resolved: Resolved,
    /// Everything that is wrong, in the order of the sources.
    pub mistakes: Vec<ConfigError>,
    /// Where its sensors stand.
    pub sensors: Layer,
    /// The sources, the one below first.
    layers: Vec<Layer>,
}

impl Examined {
    /// File and line of `section.key` in the uppermost source that has it.
    pub fn place(&self, section: &str, key: &str) -> Option<(PathBuf, usize)> {
        let mut layers = self.layers.iter().rev();
        layers.find_map(|layer| Some((layer.file.clone(), layer.line(section, key)?)))
    }

    /// Lays a source over those below it.
    fn lay(&mut self, layer: Layer, merged: &mut Table, declared: &mut &'static [Param]) {
        let found = all_mistakes(&layer.text, |text| {
            Config::parse_over(&layer.file, text, declared)
        });
        self.mistakes
            .extend(found.mistakes.into_iter().map(|error| ConfigError {
                line: if layer.is_argument { 0 } else { error.line },
                ..error
            }));
        let Some(config) = found.value else { return };
        *declared = config.params.declared();
        let over: Table = found.text.parse().unwrap_or_default();
        let layer = Layer {
            text: found.text,
            ..layer
        };
        if over.contains_key("sensor") || self.layers.is_empty() {
            self.sensors.clone_from(&layer);
        }
        lay_over(merged, over);
        self.layers.push(layer);
    }
}

/// The error for the ends of a span that are the wrong way round, at the uppermost of `layers` that gives one of them.
pub(super) fn reversed(layers: &[Layer], error: &ParamError) -> ConfigError {
    let names = match error {
        ParamError::Reversed { low, high } => [low.0, high.0],
        _ => [""; 2],
    };
    let place = layers.iter().rev().find_map(|layer| {
        let line = names.iter().filter_map(|name| layer.line("params", name)).max()?;
        Some((layer.file.clone(), line))
    });
    let (file, line) = place.unwrap_or_default();
    ConfigError {
        file,
        line,
        message: error.to_string(),
    }
}

/// The error for a live page that everybody could read, at the uppermost of `layers` that says where it is served.
pub(super) fn open_viewer(layers: &[Layer], viewer: &Viewer) -> Option<ConfigError> {
    let message = viewer.refusal()?;
    let mut places = layers.iter().rev();
    let place = places.find_map(|layer| Some((layer.file.clone(), layer.line("viewer", "address")?)));
    let (file, line) = place.unwrap_or_default();
    Some(ConfigError { file, line, message })
}

impl Config {
    /// Reads `jink.toml` in `folder`, lays `profiles/<profile>.toml` over it, then the set of sensors ([`sensor_sets`]) that
    /// `sensors` names, then the `section.key=value` of `overrides` in their order. A list (the sensors) replaces the list below it,
    /// everything else key by key.
    ///
    /// # Errors
    /// [`ConfigError`] naming file and line, or the override.
    pub fn resolve(
        folder: &Path,
        profile: Option<&str>,
        sensors: Option<&str>,
        overrides: &[String],
    ) -> Result<Resolved, ConfigError> {
        let examined = Self::examine(folder, profile, sensors, overrides);
        match examined.mistakes.into_iter().next() {
            Some(first) => Err(first),
            None => Ok(examined.resolved),
        }
    }

    /// The same with all that is wrong instead of the first mistake.
    pub fn examine(
        folder: &Path,
        profile: Option<&str>,
        sensors: Option<&str>,
        overrides: &[String],
    ) -> Examined {
        let mut examined = Examined::default();
        let base = folder.join(CONFIG_FILE);
        let set = sensors.map(sensor_sets::named);
        let set = set.map(|set| set.map(|set| Layer::of(&set.file, &set.text)));
        let layer_of = |file: PathBuf| read(&file).map(|text| Layer::of(&file, &text));
        let profile = profile.map(|name| profile_file(folder, name).and_then(layer_of));
        let (mut merged, mut declared): (Table, &'static [Param]) = (Table::new(), &[]);
        match layer_of(base) {
            Ok(layer) => examined.lay(layer, &mut merged, &mut declared),
            // What lies over it would be misjudged.
            Err(error) => {
                examined.mistakes.push(error);
                return examined;
            }
        }
        match profile {
            Some(Ok(layer)) => examined.lay(layer, &mut merged, &mut declared),
            Some(Err(error)) => examined.mistakes.push(error),
            None => {}
        }
        match set {
            Some(Ok(layer)) => examined.lay(layer, &mut merged, &mut declared),
            Some(Err(error)) => {
                examined.mistakes.push(error);
                // Those below are not the ones that are meant.
                merged.remove("sensor");
            }
            None => {}
        }
        if sensors.is_some()
            && let Some(set) = examined.layers.last()
            && set.file != examined.sensors.file
            && examined.mistakes.is_empty()
        {
            let error = problem(&set.file, "there is no [[sensor]] in it".to_owned());
            examined.mistakes.push(error);
        }
        for text in overrides {
            match override_layer(text) {
                Ok(layer) => examined.lay(layer, &mut merged, &mut declared),
                Err(error) => examined.mistakes.push(error),
            }
        }
        let whole = PathBuf::from("merged configuration");
        let body = toml::to_string(&merged).unwrap_or_default();
        let sources: Vec<String> = examined
            .layers
            .iter()
            .map(|layer| layer.file.display().to_string())
            .collect();
        let sensors_from = &examined.sensors.file;
        let text = format!(
            "# Merged while starting, from: {}\n{SENSORS_FROM}{}\n{body}",
            sources.join(", ").replace('\n', " "),
            std::path::absolute(sensors_from)
                .unwrap_or_else(|_| sensors_from.clone())
                .display()
        );
        match Self::parse_over(&whole, &text, &[]) {
            Ok(config) => {
                let reversed = config
                    .params
                    .reversed()
                    .map(|error| reversed(&examined.layers, &error));
                examined.mistakes.extend(reversed);
                examined
                    .mistakes
                    .extend(open_viewer(&examined.layers, &config.viewer));
                examined.resolved = Resolved { text, config };
            }
            Err(error) => examined.mistakes.push(error),
        }
        examined
    }
}

fn problem(file: &Path, message: String) -> ConfigError {
    ConfigError {
        file: file.to_owned(),
        line: 0,
        message,
    }
}

fn profile_file(folder: &Path, profile: &str) -> Result<PathBuf, ConfigError> {
    let profiles = folder.join(PROFILE_FOLDER);
    let file = profiles.join(format!("{profile}.toml"));
    if file.is_file() {
        return Ok(file);
    }
    let mut known: Vec<String> = std::fs::read_dir(&profiles)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| {
            entry
                .file_name()
                .to_str()?
                .strip_suffix(".toml")
                .map(str::to_owned)
        })
        .collect();
    known.sort();
    let hint = match (
        nearest(profile, known.iter().map(String::as_str)),
        known.is_empty(),
    ) {
        (_, true) => format!("; {} holds none", profiles.display()),
        (None, false) => format!("; there are {}", known.join(", ")),
        (near, false) => DidYouMean(near).to_string(),
    };
    Err(problem(&file, format!("there is no profile {profile:?}{hint}")))
}

/// Keys above all sections.
const TOP_KEYS: [&str; 3] = ["param_store", "log_dir", "log_max_mb"];

/// One `section.key=value` as a text of its own. A value that is no TOML is taken as text, so that an address needs no quotes.
fn override_layer(text: &str) -> Result<Layer, ConfigError> {
    let label = PathBuf::from(format!("--set {text}"));
    let refused = |message: &str| problem(&label, message.to_owned());
    // Few keys stand in no section.
    let is_whole = |path: &str| path.contains('.') || TOP_KEYS.contains(&path);
    let Some((path, value)) = text
        .split_once('=')
        .map(|(path, value)| (path.trim(), value.trim()))
        .filter(|(path, _)| is_whole(path))
    else {
        return Err(refused(
            "write section.key=value, e.g. link.address=udpin:0.0.0.0:14540",
        ));
    };
    let (section, key) = path.split_once('.').unwrap_or((path, ""));
    if matches!(section, "sensor" | "parameter") {
        return Err(refused(&format!(
            "{section}s are a list: change them in jink.toml or in a profile"
        )));
    }
    let value = value
        .parse::<Value>()
        .unwrap_or_else(|_| Value::String(value.to_owned()));
    let value = match key {
        "" => value,
        key => Value::Table(Table::from_iter([(key.to_owned(), value)])),
    };
    let table = Table::from_iter([(section.to_owned(), value)]);
    Ok(Layer {
        text: toml::to_string(&table).map_err(|error| refused(&error.to_string()))?,
        file: label,
        is_argument: true,
    })
}

fn lay_over(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => lay_over(below, above),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{CONFIG_FILE, Config, PROFILE_FOLDER};
    use jink_shared_types::params;
    use std::path::PathBuf;

    /// A configuration folder of its own that is removed again.
    struct Folder(PathBuf);

    impl Folder {
        fn new(test: &str, base: &str, profile: &str) -> Self {
            let path = std::env::temp_dir().join(format!("jink_overlay_{test}_{}", std::process::id()));
            std::fs::create_dir_all(path.join(PROFILE_FOLDER)).unwrap();
            std::fs::write(path.join(CONFIG_FILE), base).unwrap();
            std::fs::write(path.join(PROFILE_FOLDER).join("fast.toml"), profile).unwrap();
            Self(path)
        }

        fn error(&self, profile: Option<&str>, overrides: &[&str]) -> String {
            let overrides: Vec<String> = overrides.iter().map(|&text| text.to_owned()).collect();
            let error = Config::resolve(&self.0, profile, None, &overrides)
                .unwrap_err()
                .to_string();
            error.replace(&format!("{}/", self.0.display()), "")
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            std::fs::remove_dir_all(&self.0).unwrap();
        }
    }

    const BASE: &str = "[params]\nOA_SPD_MAX = 2\nOA_ALT_MAX = 50\n[link]\naddress = \"udpin:127.0.0.1:1\"\n\
                        [[sensor]]\nname = \"lidar\"\nkind = \"lidar_3d\"\nrate_hz = 10\n";

    #[test]
    fn the_later_source_wins_key_by_key() {
        let folder = Folder::new("wins", BASE, "[params]\nOA_SPD_MAX = 6\nOA_GOAL_RAD = 1\n");
        let overrides = [
            "params.OA_SPD_MAX=4.5",
            "link.address=serial:/dev/ttyTHS1:921600",
            "log_dir=/var/log/jink",
            "log_max_mb=30",
        ]
        .map(str::to_owned);
        let resolved = Config::resolve(&folder.0, Some("fast"), None, &overrides).unwrap();
        let again = Config::parse(&folder.0, &resolved.text).unwrap();
        for config in [&resolved.config, &again] {
            assert_eq!(config.log_dir, Some("/var/log/jink".into()));
            assert_eq!(config.log_max_mb, 30);
            assert_eq!(
                config.params.get(&params::OA_SPD_MAX),
                4.5,
                "command line over profile"
            );
            assert_eq!(config.params.get(&params::OA_GOAL_RAD), 1.0, "profile over file");
            assert_eq!(
                config.params.get(&params::OA_ALT_MAX),
                50.0,
                "what nobody overrides stays"
            );
            assert_eq!(config.link.address, "serial:/dev/ttyTHS1:921600");
        }
        assert!(
            resolved.text.contains("rate_hz = 10"),
            "keys of the drivers are kept"
        );
    }

    #[test]
    fn parameters_that_the_file_declares_are_set_by_what_lies_over_it() {
        let row = "[[parameter]]\nname = \"USR_A\"\ndefault = 1\nmin = 0\nmax = 5\ntext = \"a\"\n";
        let folder = Folder::new("declared", &format!("{BASE}{row}"), "[params]\nUSR_A = 2\n");
        let value = |profile: Option<&str>, overrides: &[&str]| {
            let overrides: Vec<String> = overrides.iter().map(|&text| text.to_owned()).collect();
            let resolved = Config::resolve(&folder.0, profile, None, &overrides).unwrap();
            resolved.config.params.named("USR_A").unwrap()
        };
        assert_eq!((value(None, &[]), value(Some("fast"), &[])), (1.0, 2.0));
        assert_eq!(value(Some("fast"), &["params.USR_A=3.5"]), 3.5);
        assert_eq!(
            folder.error(None, &["params.USR_A=6"]),
            "--set params.USR_A=6: USR_A = 6 is outside 0 to 5"
        );
    }

    #[test]
    fn a_set_of_sensors_lies_over_the_profile_and_below_the_command_line() {
        let folder = Folder::new("sets", BASE, "[params]\nOA_DCL_START = 0.7\n");
        let overrides = ["params.OA_DCL_HANG_HI=4".to_owned()];
        let resolved = Config::resolve(&folder.0, Some("fast"), Some("mid360"), &overrides).unwrap();
        let names: Vec<&str> = resolved
            .config
            .sensors
            .iter()
            .map(|sensor| sensor.name.as_str())
            .collect();
        assert_eq!(names, ["mid360"], "instead of those of the file");
        assert_eq!(resolved.config.params.get(&params::OA_DCL_START), 0.9);
        assert_eq!(resolved.config.params.get(&params::OA_DCL_HANG_HI), 4.0);
        assert_eq!(resolved.config.params.get(&params::OA_SPD_MAX), 2.0);
        assert!(resolved.text.contains("sensors/mid360.toml"), "{}", resolved.text);
        let error = |name: &str| {
            let resolved = Config::resolve(&folder.0, None, Some(name), &[]);
            resolved.unwrap_err().to_string()
        };
        assert!(
            error("mid70").contains("known are sphere, mid360"),
            "{}",
            error("mid70")
        );
        let own = folder.0.join("own.toml");
        let own = own.to_str().unwrap();
        std::fs::write(own, "[params]\nOA_SPD_MAX = 60\n").unwrap();
        assert!(
            error(own).contains("own.toml:2: OA_SPD_MAX = 60"),
            "{}",
            error(own)
        );
        std::fs::write(own, "[params]\nOA_SPD_MAX = 6\n").unwrap();
        assert!(
            error(own).contains("own.toml: there is no [[sensor]] in it"),
            "{}",
            error(own)
        );
    }

    #[test]
    fn the_sensors_of_an_overlay_replace_the_list() {
        let folder = Folder::new(
            "list",
            BASE,
            "[[sensor]]\nname = \"front\"\nkind = \"depth_camera\"\n",
        );
        let resolved = Config::resolve(&folder.0, Some("fast"), None, &[]).unwrap();
        let names: Vec<&str> = resolved.config.sensors.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names, ["front"]);
    }

    #[test]
    fn sensors_of_others_are_none_of_our_drivers_business() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Strict {
            name: String,
            #[serde(rename = "kind")]
            _kind: String,
            #[serde(rename = "rate_hz")]
            _rate_hz: Option<f64>,
        }
        let other = "[[sensor]]\nname = \"tof\"\nkind = \"user/tof\"\noutput = \"scan\"\nbus = 3\n";
        let folder = Folder::new("others", &format!("{other}{BASE}"), "");
        let ours: Vec<Strict> = super::sensors_of_ours(&folder.0).unwrap();
        assert_eq!(
            ours.iter().map(|sensor| sensor.name.as_str()).collect::<Vec<_>>(),
            ["lidar"]
        );
        let wrong = BASE.replace("rate_hz", "rate_h");
        std::fs::write(folder.0.join(CONFIG_FILE), format!("{other}{wrong}")).unwrap();
        let error = super::sensors_of_ours::<Strict>(&folder.0).unwrap_err();
        assert_eq!(
            (error.line, error.message.as_str()),
            (11, "unknown key `rate_h`; did you mean `rate_hz`?")
        );
    }

    #[test]
    fn every_source_is_named_in_its_own_errors() {
        let folder = Folder::new("errors", BASE, "[params]\n\nOA_SPD_MAX = 60\n");
        assert_eq!(
            folder.error(Some("fast"), &[]),
            "profiles/fast.toml:3: OA_SPD_MAX = 60 is outside 0.3 to 20"
        );
        assert_eq!(
            folder.error(Some("fats"), &[]),
            "profiles/fats.toml: there is no profile \"fats\"; did you mean `fast`?"
        );
        assert_eq!(
            folder.error(None, &["link.adress=x"]),
            "--set link.adress=x: unknown key `adress`; did you mean `address`?"
        );
        assert_eq!(
            folder.error(None, &["params.OA_SPD_MAX=99"]),
            "--set params.OA_SPD_MAX=99: OA_SPD_MAX = 99 is outside 0.3 to 20"
        );
        assert!(
            folder
                .error(None, &["OA_SPD_MAX"])
                .contains("write section.key=value")
        );
        assert!(
            folder
                .error(None, &["sensor.name=x"])
                .contains("sensors are a list")
        );
        assert!(
            folder
                .error(None, &["params.OA_SPD_MAX=fast"])
                .starts_with("--set params.OA_SPD_MAX=fast: ")
        );
    }
}
