//! `jink.toml`: what this vehicle is, which sensors it has, where its autopilot is.
//!
//! Unknown keys and values out of range are refused with file, line and the nearest valid name; nothing is guessed.

mod foreign;
mod link;
mod mistakes;
mod nominal_view;
mod overlay;
mod parameters;
pub mod sensor_sets;
pub mod sensor_table;
mod viewer;

pub use foreign::{Foreign, Grants, USER_PROCESSES, is_foreign};
pub use link::{AUTOPILOT_LINK, AlsoLink, Link, LinkRow, Purpose, Signing};
pub use mistakes::{Examination, all_mistakes};
pub use overlay::{
    Examined, Layer, PROFILE_FOLDER, Resolved, SensorsExamined, sensor_place, sensors, sensors_of_ours,
};
pub use viewer::Viewer;

use jink_shared_types::params::{Param, ParamSet};
use jink_shared_types::ranges::{SENSORS, deadline_us};
use jink_shared_types::suggestion::{DidYouMean, nearest};
use jink_shared_types::view::FieldOfView;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use toml::Spanned;
use viewer::ViewerTable;

/// Name of the configuration file in its folder.
pub const CONFIG_FILE: &str = "jink.toml";

/// What the logs of the processes may take on a disk unless the configuration says more (MB): some dozens of flights.
const LOG_MAX_MB: u32 = 200;
/// And at least (MB): the logs of one run, each limited for itself.
const LOG_LEAST_MB: u32 = 20;

/// What recordings may take unless the configuration says otherwise (MB): an hour and a half of flights without clouds.
const RECORDINGS_MAX_MB: u32 = 2000;
/// The least that they may (MB): one file has a quarter of it.
const RECORDINGS_LEAST_MB: u32 = 40;
/// What may wait in memory for an event (s).
const BEFORE_EVENT_S: std::ops::RangeInclusive<f64> = 0.0..=600.0;
/// Name of the process table in the same folder.
pub const PROCESS_FILE: &str = "services.toml";

/// What is wrong with a configuration file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// The file.
    pub file: PathBuf,
    /// Line, counted from 1; 0 if the file as a whole is meant.
    pub line: usize,
    /// What is wrong, in one sentence.
    pub message: String,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line > 0 {
            write!(f, "{}:{}: {}", self.file.display(), self.line, self.message)
        } else {
            write!(f, "{}: {}", self.file.display(), self.message)
        }
    }
}
impl std::error::Error for ConfigError {}

/// The configuration in force.
#[derive(Clone, Debug, Default)]
pub struct Config {
    /// The parameters.
    pub params: ParamSet,
    /// Where changed parameters are kept; `None` = with the instance.
    pub param_store: Option<PathBuf>,
    /// Where the logs of the processes are kept; `None` = where the service manager keeps them, or with the instance.
    pub log_dir: Option<PathBuf>,
    /// What the logs of that folder may take (MB).
    pub log_max_mb: u32,
    /// The link to the autopilot, and the others.
    pub link: Link,
    /// What is recorded, and where.
    pub recorder: Recorder,
    /// Where the live page is served.
    pub viewer: Viewer,
    /// The virtual world, where there is one.
    pub simulation: Simulation,
    /// Names of the sensors that publish point clouds, and of those that publish scans.
    pub sensors: Vec<Sensor>,
}

/// What is recorded, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorder {
    /// Folder for recordings; `None` = nothing is recorded.
    pub folder: Option<PathBuf>,
    /// What the recordings of that folder may take (MB).
    pub max_mb: u32,
    /// The clouds of lidars and depth cameras are recorded, too.
    pub clouds: bool,
    /// Only so much before and after an event is recorded (s); `None` = everything.
    pub before_event_s: Option<f64>,
}

impl Default for Recorder {
    fn default() -> Self {
        Self {
            folder: None,
            max_mb: RECORDINGS_MAX_MB,
            clouds: false,
            before_event_s: None,
        }
    }
}

/// [`Recorder`] as jink.toml has it.
#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct RecorderTable {
    folder: String,
    max_mb: Option<Spanned<u32>>,
    clouds: bool,
    before_event_s: Option<Spanned<f64>>,
}

/// The virtual world.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Simulation {
    /// Which autopilot flies: px4, px4_current, ardupilot; auto = the one that `link.profile` is for.
    pub autopilot: String,
    /// Kind of world: forest, gap, corridor, utrap, building, empty, or FILE.toml.
    pub world: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Trees per square metre; unset = the world's own.
    pub density_per_m2: Option<f64>,
    /// UDP port on which the simulated autopilot talks to ground stations (it sends to it); 0 = none.
    pub ground_station_port: u16,
    /// UDP port the simulated autopilot binds for its companion; 0 = any free one.
    pub autopilot_port: u16,
    /// Mean wind to the north, where the air moves to (m/s).
    pub wind_north_mps: f64,
    /// Mean wind to the east (m/s).
    pub wind_east_mps: f64,
    /// Standard deviation of the gusts on each axis (m/s).
    pub wind_gust_mps: f64,
    /// Folder of a build of PX4 or ArduCopter (SITL) that flies instead of an emulated autopilot; empty = none.
    pub sitl: String,
    /// How it is simulated: auto, hil, sih, json.
    pub sitl_interface: String,
    /// Its instance number, from which its ports count; -1 = the first one whose ports are free.
    pub sitl_instance: i16,
    /// Parameters it starts with over its defaults and those that `link.profile` needs: NAME=NUMBER,NAME=NUMBER.
    pub sitl_parameters: String,
    /// Its working folder, kept; empty = a temporary one.
    pub sitl_folder: String,
}

impl Default for Simulation {
    fn default() -> Self {
        Self {
            autopilot: "auto".to_owned(),
            world: "forest".to_owned(),
            seed: 1,
            density_per_m2: None,
            ground_station_port: 14550,
            autopilot_port: 0,
            wind_north_mps: 0.0,
            wind_east_mps: 0.0,
            wind_gust_mps: 0.0,
            sitl: String::new(),
            sitl_interface: "auto".to_owned(),
            sitl_instance: -1,
            sitl_parameters: String::new(),
            sitl_folder: String::new(),
        }
    }
}

/// What a sensor publishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorOutput {
    /// `range/cloud/<name>`.
    Cloud,
    /// `range/scan/<name>`.
    Scan,
}

/// One sensor as every service needs to know it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Its name: the last part of its topic.
    pub name: String,
    /// What it publishes.
    pub output: SensorOutput,
    /// Its kind, as configured.
    pub kind: String,
    /// It is plugged in somewhere: the table has a `device`, which the driver of the kind opens.
    pub has_device: bool,
    /// Frames per second (Hz), where the table says so.
    pub rate_hz: Option<f64>,
    /// From the capture of a frame to its publication, at most (s).
    pub delay_s: f64,
    /// Declaration of the user: what a planar sensor says of its plane holds so far above and below it (m); zero for none.
    pub band_m: [f64; 2],
    /// Declaration of the user: a ray without an answer met nothing.
    pub no_return_is_clear: bool,
    /// The directions (body) at which its model looks, for one that does not say where it got no answer; else empty.
    pub nominal_view: FieldOfView,
}

impl Sensor {
    /// When a frame of it is stale; see [`deadline_us`]. `rate_hz` is what its driver knows of it, zero for nothing.
    pub fn deadline_us(&self, topic_deadline_ms: f64, rate_hz: f64) -> u32 {
        deadline_us(topic_deadline_ms, self.rate_hz.unwrap_or(rate_hz), self.delay_s)
    }
}

/// What a driver takes from capture to publication unless the sensor's table says more (s).
const DELAY_S: f64 = 0.05;

/// Most frames per second that a sensor's table may say (Hz).
const RATE_MAX_HZ: f64 = 2_000.0;
/// Widest band that a planar sensor may stand for (m).
const BAND_MAX_M: f64 = 5.0;
/// Longest delay that it may say (ms): what is older is no basis for a motion.
const DELAY_MAX_MS: f64 = 1_000.0;

/// The kinds of sensors and what they publish. The driver that owns a kind knows its other keys.
pub const SENSOR_KINDS: &[(&str, SensorOutput)] = &[
    ("lidar_3d", SensorOutput::Cloud),
    ("depth_camera", SensorOutput::Cloud),
    ("lidar_2d", SensorOutput::Scan),
    ("rangefinder", SensorOutput::Scan),
    ("autopilot_rangefinder", SensorOutput::Scan),
    ("obstacle_row", SensorOutput::Scan),
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
#[derive(Default)]
struct File {
    param_store: String,
    log_dir: String,
    log_max_mb: Option<Spanned<u32>>,
    params: BTreeMap<Spanned<String>, Spanned<f64>>,
    link: Link,
    recorder: RecorderTable,
    viewer: ViewerTable,
    simulation: Simulation,
    sensor: Vec<Spanned<SensorTable>>,
    parameter: Vec<Spanned<parameters::Written>>,
}

/// Begins the kinds of sensors whose drivers are not ours. Their tables say themselves what they publish.
pub const USER_KINDS: &str = "user/";

/// Whether the driver of sensors of this kind is not ours.
pub fn is_user_kind(kind: &str) -> bool {
    kind.strip_prefix(USER_KINDS).is_some_and(is_plain)
}

/// Whether a name consists of lower-case letters, digits and underscores.
fn is_plain(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    !name.is_empty() && name.chars().all(plain)
}

#[derive(Deserialize)]
struct SensorTable {
    name: Spanned<String>,
    kind: Spanned<String>,
    rate_hz: Option<Spanned<f64>>,
    delay_ms: Option<Spanned<f64>>,
    band_up_m: Option<Spanned<f64>>,
    band_down_m: Option<Spanned<f64>>,
    no_return: Option<Spanned<String>>,
    output: Option<Spanned<String>>,
    #[serde(flatten)]
    of_the_driver: BTreeMap<String, toml::Value>,
}

impl Config {
    /// Reads `jink.toml` in `folder`.
    ///
    /// # Errors
    /// [`ConfigError`] naming file and line.
    pub fn load(folder: &Path) -> Result<Self, ConfigError> {
        let file = folder.join(CONFIG_FILE);
        let text = read(&file)?;
        Self::parse(&file, &text)
    }

    /// Reads the text of a configuration file; `file` only appears in errors.
    ///
    /// # Errors
    /// [`ConfigError`] naming file and line.
    pub fn parse(file: &Path, text: &str) -> Result<Self, ConfigError> {
        let config = Self::parse_over(file, text, &[])?;
        let layers = [Layer::of(file, text)];
        let reversed = config.params.reversed().next();
        let reversed = reversed.map(|error| overlay::reversed(&layers, &error));
        reversed
            .or_else(|| overlay::open_viewer(&layers, &config.viewer))
            .map_or(Ok(config), Err)
    }

    /// The same of a text that lies over another one, which declares these parameters; a list of its own replaces them.
    fn parse_over(file: &Path, text: &str, declared: &'static [Param]) -> Result<Self, ConfigError> {
        let parsed: File = parse_toml(file, text)?;
        let at = |offset: usize, message: String| ConfigError {
            file: file.to_owned(),
            line: line_of(text, offset),
            message,
        };
        parsed.link.check(&at)?;
        if let Some(least) = parsed
            .log_max_mb
            .as_ref()
            .filter(|mb| *mb.get_ref() < LOG_LEAST_MB)
        {
            let message = format!("log_max_mb is a number from {LOG_LEAST_MB}");
            return Err(at(least.span().start, message));
        }
        if let Some(least) = parsed
            .recorder
            .max_mb
            .as_ref()
            .filter(|mb| *mb.get_ref() < RECORDINGS_LEAST_MB)
        {
            let message = format!("max_mb of [recorder] is a number from {RECORDINGS_LEAST_MB}");
            return Err(at(least.span().start, message));
        }
        let before_event_s = parsed.recorder.before_event_s.as_ref();
        if let Some(wrong) = before_event_s.filter(|s| !BEFORE_EVENT_S.contains(s.get_ref())) {
            let message = format!(
                "before_event_s of [recorder] is a number from {} to {}",
                BEFORE_EVENT_S.start(),
                BEFORE_EVENT_S.end()
            );
            return Err(at(wrong.span().start, message));
        }
        let before_event_s = before_event_s.map_or(0.0, |s| *s.get_ref());
        let viewer = parsed
            .viewer
            .read()
            .map_err(|(place, message)| at(place, message))?;
        let mut config = Self {
            viewer,
            param_store: (!parsed.param_store.is_empty()).then(|| PathBuf::from(&parsed.param_store)),
            log_dir: (!parsed.log_dir.is_empty()).then(|| PathBuf::from(&parsed.log_dir)),
            log_max_mb: parsed.log_max_mb.map_or(LOG_MAX_MB, |mb| *mb.get_ref()),
            link: parsed.link,
            recorder: Recorder {
                folder: (!parsed.recorder.folder.is_empty()).then(|| PathBuf::from(&parsed.recorder.folder)),
                max_mb: parsed
                    .recorder
                    .max_mb
                    .map_or(RECORDINGS_MAX_MB, |mb| *mb.get_ref()),
                clouds: parsed.recorder.clouds,
                before_event_s: (before_event_s > 0.0).then_some(before_event_s),
            },
            simulation: parsed.simulation,
            params: ParamSet::declaring(match parsed.parameter.as_slice() {
                [] => declared,
                written => parameters::rows(written, &at)?,
            }),
            ..Self::default()
        };
        for (name, value) in &parsed.params {
            config
                .params
                .set(name.get_ref(), *value.get_ref())
                .map_err(|error| at(name.span().start, error.to_string()))?;
        }
        for table in &parsed.sensor {
            config.add_sensor(table.get_ref(), &at)?;
        }
        Ok(config)
    }

    fn add_sensor(
        &mut self,
        table: &SensorTable,
        at: &impl Fn(usize, String) -> ConfigError,
    ) -> Result<(), ConfigError> {
        let name = table.name.get_ref();
        if name.len() > 20 || !is_plain(name) {
            let message =
                format!("sensor name {name:?}: use 1 to 20 lower-case letters, digits and underscores");
            return Err(at(table.name.span().start, message));
        }
        if self.sensors.iter().any(|sensor| sensor.name == *name) {
            return Err(at(
                table.name.span().start,
                format!("two sensors are called {name:?}"),
            ));
        }
        if self.sensors.len() == SENSORS {
            let message = format!("sensor {name:?} is one too many: there is room for {SENSORS}");
            return Err(at(table.name.span().start, message));
        }
        let within = |key: &str, value: &Option<Spanned<f64>>, most: f64| match value {
            Some(value) if !(0.0..=most).contains(value.get_ref()) => Err(at(
                value.span().start,
                format!("sensor {name:?}: {key} is a number from 0 to {most}"),
            )),
            value => Ok(value.as_ref().map(|value| *value.get_ref())),
        };
        let rate_hz = within("rate_hz", &table.rate_hz, RATE_MAX_HZ)?;
        let delay_ms = within("delay_ms", &table.delay_ms, DELAY_MAX_MS)?;
        let output = table.output(at)?;
        let band_m = [
            within("band_up_m", &table.band_up_m, BAND_MAX_M)?.unwrap_or(0.0),
            within("band_down_m", &table.band_down_m, BAND_MAX_M)?.unwrap_or(0.0),
        ];
        if let (Some(band), SensorOutput::Cloud) =
            (table.band_up_m.as_ref().or(table.band_down_m.as_ref()), output)
        {
            let message =
                format!("sensor {name:?}: a band is for sensors that see one plane, not for clouds");
            return Err(at(band.span().start, message));
        }
        let no_return_is_clear = match table.no_return.as_ref() {
            None => false,
            Some(word) => match word.get_ref().as_str() {
                "clear" if table.says_where_nothing_answered() => true,
                "clear" => {
                    let message = format!(
                        "sensor {name:?} does not say where it got no answer, or gets none from blank walls: no_return = \"clear\" \
                         is not possible; declare what hangs nowhere (OA_DCL_HANG_LO, OA_DCL_HANG_HI) instead"
                    );
                    return Err(at(word.span().start, message));
                }
                "unknown" => false,
                other => {
                    let message =
                        format!("sensor {name:?}: no_return is \"unknown\" or \"clear\", not {other:?}");
                    return Err(at(word.span().start, message));
                }
            },
        };
        self.sensors.push(Sensor {
            name: name.clone(),
            output,
            band_m,
            no_return_is_clear,
            nominal_view: nominal_view::nominal_view(name, &table.of_the_driver),
            kind: table.kind.get_ref().clone(),
            has_device: table.of_the_driver.contains_key("device"),
            rate_hz: rate_hz.filter(|rate_hz| *rate_hz > 0.0),
            delay_s: delay_ms.map_or(DELAY_S, |ms| ms * 1e-3),
        });
        Ok(())
    }
}

impl SensorTable {
    /// Whether the direction of a ray without an answer is known, and whether that it has none is mostly due to the open air.
    fn says_where_nothing_answered(&self) -> bool {
        let model = self.of_the_driver.get("model").and_then(toml::Value::as_str);
        self.kind.get_ref() != "depth_camera" && !model.is_some_and(|model| model.starts_with("livox"))
    }

    /// What the sensor publishes: its kind says it, and of the kinds of others the table.
    fn output(&self, at: &impl Fn(usize, String) -> ConfigError) -> Result<SensorOutput, ConfigError> {
        let kind = self.kind.get_ref();
        let of_kind = SENSOR_KINDS.iter().find(|(known, _)| known == kind);
        match (of_kind, &self.output) {
            (Some((_, output)), None) => Ok(*output),
            (Some(_), Some(output)) => {
                let message =
                    format!("sensors of kind {kind:?} have no `output`: it is for kinds {USER_KINDS}...");
                Err(at(output.span().start, message))
            }
            (None, output) if is_user_kind(kind) => match output.as_ref().map(|word| word.get_ref().as_str())
            {
                Some("cloud") => Ok(SensorOutput::Cloud),
                Some("scan") => Ok(SensorOutput::Scan),
                _ => {
                    let place = output.as_ref().map_or(self.kind.span(), Spanned::span);
                    let message = format!("a sensor of kind {kind:?} needs output = \"cloud\" or \"scan\"");
                    Err(at(place.start, message))
                }
            },
            (None, _) => {
                let known = nearest(kind, SENSOR_KINDS.iter().map(|(known, _)| *known));
                let message = format!("unknown kind of sensor {kind:?}{}", DidYouMean(known));
                Err(at(self.kind.span().start, message))
            }
        }
    }
}

/// Reads a whole text file.
///
/// # Errors
/// [`ConfigError`] naming the file.
pub fn read(file: &Path) -> Result<String, ConfigError> {
    let text = std::fs::read_to_string(file).map_err(|error| ConfigError {
        file: file.to_owned(),
        line: 0,
        message: format!("cannot be read: {error}"),
    })?;
    // Editors of Windows begin a file with a byte order mark.
    Ok(text.trim_start_matches('\u{feff}').to_owned())
}

/// The names in the process table that lies beside `jink.toml`; empty if there is none. The table itself is the
/// supervisor's, which has checked it; others only need to know who there may be.
pub fn process_names(folder: &Path) -> Vec<String> {
    #[derive(Deserialize)]
    struct Table {
        #[serde(default)]
        process: Vec<Row>,
    }
    #[derive(Deserialize)]
    struct Row {
        name: String,
        per_sensor: Option<String>,
    }
    let text = std::fs::read_to_string(folder.join(PROCESS_FILE)).unwrap_or_default();
    let table = toml::from_str::<Table>(&text);
    table.map_or_else(
        |_| Vec::new(),
        |table| {
            let sensors = Config::load(folder).map_or_else(|_| Vec::new(), |config| config.sensors);
            let rows = table.process.into_iter();
            rows.flat_map(|row| match &row.per_sensor {
                Some(kind) => plugged_in(&sensors, kind)
                    .map(|sensor| of_sensor(&row.name, &sensor.name))
                    .collect(),
                None => vec![row.name],
            })
            .collect()
        },
    )
}

/// What stands for a sensor's name in a row of the process table that is there once per sensor.
const SENSOR_PLACE: &str = "{sensor}";

/// A text of such a row for the sensor called `sensor`.
pub fn of_sensor(text: &str, sensor: &str) -> String {
    text.replace(SENSOR_PLACE, sensor)
}

/// The sensors of `kind` that have a `device`: each of them has a driver of its own.
pub fn plugged_in<'a>(sensors: &'a [Sensor], kind: &str) -> impl Iterator<Item = &'a Sensor> {
    sensors
        .iter()
        .filter(move |sensor| sensor.has_device && sensor.kind == kind)
}

/// Parses TOML into `T`; an unknown key is answered with the nearest one that exists.
///
/// # Errors
/// [`ConfigError`] naming file and line.
pub fn parse_toml<T: DeserializeOwned>(file: &Path, text: &str) -> Result<T, ConfigError> {
    toml::from_str(text).map_err(|error| ConfigError {
        file: file.to_owned(),
        line: error.span().map_or(0, |span| line_of(text, span.start)),
        message: with_nearest(error.message()),
    })
}

/// Line (from 1) of byte `offset` in `text`.
pub fn line_of(text: &str, offset: usize) -> usize {
    1 + text.bytes().take(offset).filter(|byte| *byte == b'\n').count()
}

/// Shortens serde's "unknown field `x`, expected one of `a`, `b`" to what a person needs: the nearest name.
fn with_nearest(message: &str) -> String {
    let kinds = [("unknown field", "key"), ("unknown variant", "value")];
    let Some((_, kind)) = kinds.iter().find(|(start, _)| message.starts_with(start)) else {
        return message.trim().replace('\n', " ");
    };
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    let Some((unknown, known)) = quoted.split_first() else {
        return message.to_owned();
    };
    let near = nearest(unknown, known.iter().copied());
    format!("unknown {kind} `{unknown}`{}", DidYouMean(near))
}

#[cfg(test)]
mod tests {
    use super::{CONFIG_FILE, Config, PROCESS_FILE, SensorOutput, of_sensor, plugged_in, process_names};
    use jink_shared_types::params;
    use std::path::Path;

    fn error_of(text: &str) -> String {
        Config::parse(Path::new("jink.toml"), text)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn a_good_file_is_read_whole() {
        let text = "param_store = \"/var/lib/jink/p.toml\"\n[params]\nOA_SPD_MAX = 4\n[link]\naddress = \"udpin:127.0.0.1:14541\"\n\
                    [[sensor]]\nname = \"lidar\"\nkind = \"lidar_3d\"\nrate_hz = 10\n";
        let config = Config::parse(Path::new("jink.toml"), text).unwrap();
        assert_eq!(config.params.get(&params::OA_SPD_MAX), 4.0);
        assert_eq!(config.link.address, "udpin:127.0.0.1:14541");
        assert_eq!(config.param_store, Some("/var/lib/jink/p.toml".into()));
        assert_eq!(config.sensors[0].output, SensorOutput::Cloud);
        // Two and a half periods of 10 Hz and what a driver takes unless its table says more.
        assert_eq!(config.sensors[0].deadline_us(250.0, 0.0), 300_000);
    }

    #[test]
    fn a_slow_sensor_says_so_in_its_table() {
        let text = "[[sensor]]\nname = \"sonar\"\nkind = \"rangefinder\"\nrate_hz = 2\ndelay_ms = 200\n";
        let config = Config::parse(Path::new("jink.toml"), text).unwrap();
        assert_eq!(config.sensors[0].deadline_us(250.0, 20.0), 1_450_000);
        let sensor = |key: &str| {
            error_of(&format!(
                "[[sensor]]\nname = \"a\"\nkind = \"rangefinder\"\n{key}\n"
            ))
        };
        assert_eq!(
            sensor("rate_hz = -1"),
            "jink.toml:4: sensor \"a\": rate_hz is a number from 0 to 2000"
        );
        assert_eq!(
            sensor("delay_ms = 5000"),
            "jink.toml:4: sensor \"a\": delay_ms is a number from 0 to 1000"
        );
    }

    #[test]
    fn declarations_of_a_sensor_are_for_those_that_can_make_them() {
        let parse = |table: &str| {
            let text = format!("[[sensor]]\nname = \"top\"\n{table}\n");
            Config::parse(Path::new("jink.toml"), &text).map_err(|error| error.to_string())
        };
        let ouster = parse("kind = \"lidar_3d\"\nmodel = \"ouster_os1\"\nno_return = \"clear\"").unwrap();
        assert!(ouster.sensors[0].no_return_is_clear);
        let plane = parse("kind = \"lidar_2d\"\nband_up_m = 1.2\nno_return = \"unknown\"").unwrap();
        assert_eq!(
            (plane.sensors[0].band_m, plane.sensors[0].no_return_is_clear),
            ([1.2, 0.0], false)
        );
        for (table, words) in [
            (
                "kind = \"lidar_3d\"\nmodel = \"livox_mid360\"\nno_return = \"clear\"",
                "jink.toml:5: sensor \"top\" does not say where it got no answer",
            ),
            ("kind = \"depth_camera\"\nno_return = \"clear\"", "OA_DCL_HANG_LO"),
            (
                "kind = \"lidar_3d\"\nno_return = \"free\"",
                "\"unknown\" or \"clear\", not \"free\"",
            ),
            (
                "kind = \"lidar_3d\"\nband_up_m = 1.0",
                "a band is for sensors that see one plane",
            ),
            (
                "kind = \"lidar_2d\"\nband_down_m = 9.0",
                "band_down_m is a number from 0 to",
            ),
        ] {
            let error = parse(table).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn a_sensor_that_nobody_would_look_at_is_refused() {
        let table = |number: usize| format!("[[sensor]]\nname = \"s{number}\"\nkind = \"rangefinder\"\n");
        let sixteen: String = (0..16).map(table).collect();
        assert_eq!(
            Config::parse(Path::new("jink.toml"), &sixteen)
                .unwrap()
                .sensors
                .len(),
            16
        );
        assert_eq!(
            error_of(&format!("{sixteen}{}", table(16))),
            "jink.toml:50: sensor \"s16\" is one too many: there is room for 16"
        );
    }

    #[test]
    fn an_unknown_key_is_refused_with_line_and_nearest() {
        assert_eq!(
            error_of("[link]\nadress = \"x\"\n"),
            "jink.toml:2: unknown key `adress`; did you mean `address`?"
        );
        assert_eq!(
            error_of("\n[lnk]\n"),
            "jink.toml:2: unknown key `lnk`; did you mean `link`?"
        );
        assert_eq!(
            error_of("[params]\n\nOA_SPEED_MAX = 3.0\n"),
            "jink.toml:3: unknown parameter OA_SPEED_MAX; did you mean `OA_SPD_MAX`?"
        );
    }

    #[test]
    fn a_value_out_of_range_or_of_the_wrong_type_is_refused_with_its_line() {
        assert_eq!(
            error_of("[params]\nOA_SPD_MAX = 99\n"),
            "jink.toml:2: OA_SPD_MAX = 99 is outside 0.3 to 20"
        );
        assert!(error_of("[link]\nsystem_id = \"one\"\n").starts_with("jink.toml:2: "));
        assert!(error_of("[link\n").starts_with("jink.toml:1: "));
    }

    #[test]
    fn a_sensor_that_is_plugged_in_is_distinguished_from_one_that_is_not() {
        let text = "[[sensor]]\nname = \"a\"\nkind = \"rangefinder\"\ndevice = \"/dev/ttyS4\"\n\
                    [[sensor]]\nname = \"b\"\nkind = \"rangefinder\"\n\
                    [[sensor]]\nname = \"c\"\nkind = \"lidar_2d\"\ndevice = \"/dev/ttyS5\"\n";
        let config = Config::parse(Path::new("jink.toml"), text).unwrap();
        let names: Vec<&str> = plugged_in(&config.sensors, "rangefinder")
            .map(|sensor| sensor.name.as_str())
            .collect();
        assert_eq!(names, ["a"]);
        assert_eq!(of_sensor("{sensor}_driver", "a"), "a_driver");
    }

    #[test]
    fn a_sensor_of_another_kind_says_what_it_publishes() {
        let table = |keys: &str| format!("[[sensor]]\nname = \"tof\"\n{keys}\n");
        let text = table("kind = \"user/tof\"\noutput = \"scan\"\nrate = 7");
        let config = Config::parse(Path::new("jink.toml"), &text).unwrap();
        assert_eq!(config.sensors[0].output, SensorOutput::Scan);
        assert_eq!(
            error_of(&table("kind = \"user/tof\"")),
            "jink.toml:3: a sensor of kind \"user/tof\" needs output = \"cloud\" or \"scan\""
        );
        assert_eq!(
            error_of(&table("kind = \"lidar_3d\"\noutput = \"cloud\"")),
            "jink.toml:4: sensors of kind \"lidar_3d\" have no `output`: it is for kinds user/..."
        );
        assert_eq!(
            error_of(&table("kind = \"lidar_3\"")),
            "jink.toml:3: unknown kind of sensor \"lidar_3\"; did you mean `lidar_3d`?"
        );
    }

    #[test]
    fn a_process_per_sensor_is_known_by_the_names_of_those_that_are_plugged_in() {
        let folder = std::env::temp_dir().join(format!("jink_names_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let sensors = "[[sensor]]\nname = \"front\"\nkind = \"rangefinder\"\ndevice = \"/dev/ttyS4\"\n\
                       [[sensor]]\nname = \"ground\"\nkind = \"rangefinder\"\n";
        std::fs::write(folder.join(CONFIG_FILE), sensors).unwrap();
        let rows = "[[process]]\nname = \"planner\"\nprogram = \"p\"\n\
                    [[process]]\nname = \"{sensor}\"\nprogram = \"r\"\nper_sensor = \"rangefinder\"\n";
        std::fs::write(folder.join(PROCESS_FILE), rows).unwrap();
        let names = process_names(&folder);
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(names, ["planner", "front"]);
    }

    #[test]
    fn sensors_have_names_of_their_own_and_known_kinds() {
        let twice =
            "[[sensor]]\nname = \"a\"\nkind = \"lidar_3d\"\n[[sensor]]\nname = \"a\"\nkind = \"lidar_2d\"\n";
        assert_eq!(error_of(twice), "jink.toml:5: two sensors are called \"a\"");
        let odd = "[[sensor]]\nname = \"a\"\nkind = \"lidar3d\"\n";
        assert_eq!(
            error_of(odd),
            "jink.toml:3: unknown kind of sensor \"lidar3d\"; did you mean `lidar_3d`?"
        );
    }
}
