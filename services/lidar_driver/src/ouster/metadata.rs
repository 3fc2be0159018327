//! The metadata of an Ouster sensor: the geometry of its beams, and what its packets look like.
//!
//! Two layouts exist: that of firmware before 2.4 and of old tools (everything in one object), and the nested one that
//! the sensor's HTTP API answers with (`beam_intrinsics`, `lidar_intrinsics`, `lidar_data_format`, `config_params`,
//! `sensor_info`). What old files do not contain follows from the firmware manual: sixteen columns in a packet of
//! profile LEGACY, and the offsets of the model.

use super::profile::{Header, PROFILES, Profile};
use serde_json::{Map, Value};
use std::fmt;

/// Most rows of a sensor, and columns of its revolution.
const ROWS: usize = 256;
const COLUMNS: usize = 4_096;

/// Position of the lidar frame above the sensor frame (mm) where the metadata do not contain it (hardware user manual,
/// second generation).
const LIDAR_HEIGHT_MM: f64 = 36.18;

/// What is known of one sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Metadata {
    /// Its product line, e.g. OS-1-128; empty if not given.
    pub product: String,
    /// Its serial number; zero if not given.
    pub serial: u64,
    /// UDP port to which it sends lidar packets, if given.
    pub port: Option<u16>,
    /// Pixels of its packets.
    pub profile: Profile,
    /// Head of its packets.
    pub header: Header,
    /// Beams.
    pub rows: usize,
    /// Measurements in a revolution.
    pub columns: usize,
    /// Measurements in a packet.
    pub columns_per_packet: usize,
    /// First and last measurement id that it sends; the first may be greater than the last.
    pub window: [usize; 2],
    /// By how many columns a row must be shifted to see the same direction as its neighbours.
    pub pixel_shift: Vec<i32>,
    /// Of every beam, above the horizon (deg).
    pub altitude_deg: Vec<f64>,
    /// Of every beam, from the encoder's direction (deg).
    pub azimuth_deg: Vec<f64>,
    /// From the lidar's origin to where beams begin (mm): along the direction of the encoder, and up.
    pub beam_origin_mm: [f64; 2],
    /// Takes the lidar frame to the sensor frame, row by row; lengths in mm.
    pub sensor_t_lidar_mm: [f64; 16],
    /// Revolutions per second.
    pub rate_hz: f64,
}

/// Why metadata are of no use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MetadataError {
    /// The text is no JSON object.
    NotJson {
        /// The parser's error.
        cause: String,
    },
    /// A key is missing, and nothing can stand for it.
    Missing {
        /// The key.
        key: &'static str,
    },
    /// A value that the key cannot have.
    NotPossible {
        /// The key.
        key: &'static str,
        /// Its value.
        value: String,
        /// The possible values.
        possible: String,
    },
}

impl fmt::Display for MetadataError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotJson { cause } => write!(f, "no JSON object: {cause}"),
            Self::Missing { key } => write!(
                f,
                "`{key}` is missing: are these the metadata of an Ouster sensor?"
            ),
            Self::NotPossible { key, value, possible } => {
                write!(f, "{key} = {value} is not possible; possible: {possible}")
            }
        }
    }
}
impl std::error::Error for MetadataError {}

impl Metadata {
    /// Reads metadata of either layout.
    ///
    /// # Errors
    /// [`MetadataError`] naming the key.
    pub fn parse(text: &str) -> Result<Self, MetadataError> {
        // Editors and shells of Windows begin a file with a byte order mark.
        let text = text.trim_start_matches('\u{feff}');
        let value: Value = serde_json::from_str(text).map_err(|error| MetadataError::NotJson {
            cause: error.to_string(),
        })?;
        let Value::Object(root) = value else {
            return Err(MetadataError::NotJson {
                cause: "it is a value of another kind".to_owned(),
            });
        };
        Keys(&root).metadata()
    }

    /// Columns that it sends in a revolution.
    pub fn columns_sent(&self) -> usize {
        let [first, last] = self.window;
        1 + (last + self.columns - first) % self.columns
    }

    /// Whether it sends the column.
    pub fn sends(&self, column: usize) -> bool {
        let [first, last] = self.window;
        if first <= last {
            (first..=last).contains(&column)
        } else {
            column >= first || column <= last
        }
    }
}

/// Where the layouts keep their keys.
const SECTIONS: [&str; 6] = [
    "beam_intrinsics",
    "lidar_intrinsics",
    "lidar_data_format",
    "data_format",
    "config_params",
    "sensor_info",
];

struct Keys<'a>(&'a Map<String, Value>);

impl Keys<'_> {
    fn metadata(&self) -> Result<Metadata, MetadataError> {
        let product = self.text("prod_line").unwrap_or_default().to_owned();
        let altitude_deg = self.angles("beam_altitude_angles")?;
        let rows = altitude_deg.len();
        let azimuth_deg = self.angles("beam_azimuth_angles")?;
        if azimuth_deg.len() != rows {
            return Err(not_possible(
                "beam_azimuth_angles",
                format!("{} angles", azimuth_deg.len()),
                format!("{rows}, as many as beam_altitude_angles"),
            ));
        }
        if altitude_deg.iter().all(|angle| *angle == 0.0) && rows > 1 {
            return Err(not_possible(
                "beam_altitude_angles",
                "all zero".to_owned(),
                "one angle for each beam".to_owned(),
            ));
        }
        let (mode_columns, mode_hz) = self.mode()?;
        let columns = self.count("columns_per_frame", mode_columns, COLUMNS)?;
        let pixels = self.count("pixels_per_column", Some(rows), ROWS)?;
        if pixels != rows {
            return Err(not_possible(
                "pixels_per_column",
                pixels.to_string(),
                format!("{rows}, one for each angle"),
            ));
        }
        let columns_per_packet = self.count("columns_per_packet", Some(16), 256)?;
        let profile = self.profile()?;
        Ok(Metadata {
            serial: self
                .text("prod_sn")
                .and_then(|text| text.parse().ok())
                .unwrap_or(0),
            port: self
                .find("udp_port_lidar")
                .and_then(Value::as_u64)
                .and_then(|port| u16::try_from(port).ok())
                .filter(|port| *port > 0),
            header: self.header(profile)?,
            profile,
            rows,
            columns,
            columns_per_packet,
            window: self.window(columns)?,
            pixel_shift: self.pixel_shift(rows)?,
            beam_origin_mm: self.beam_origin_mm(&product)?,
            sensor_t_lidar_mm: self.sensor_t_lidar_mm()?,
            rate_hz: self
                .find("fps")
                .and_then(Value::as_f64)
                .filter(|rate_hz| *rate_hz > 0.0)
                .or(mode_hz)
                .unwrap_or(10.0),
            altitude_deg,
            azimuth_deg,
            product,
        })
    }

    /// The value of `key` in any of the places where a layout may have it.
    fn find(&self, key: &str) -> Option<&Value> {
        let in_section = |section: &&str| self.0.get(*section).and_then(|section| section.get(key));
        let found = self.0.get(key).or_else(|| SECTIONS.iter().find_map(in_section));
        found
            .or_else(|| {
                self.0
                    .get("sensor")
                    .and_then(|sensor| SECTIONS.iter().find_map(|section| sensor.get(*section)?.get(key)))
            })
            .filter(|value| !value.is_null())
    }

    fn text(&self, key: &str) -> Option<&str> {
        self.find(key).and_then(Value::as_str)
    }

    fn numbers(&self, key: &'static str, value: &Value) -> Result<Vec<f64>, MetadataError> {
        let list = value
            .as_array()
            .map(|list| list.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>());
        let list = list
            .flatten()
            .filter(|list| list.iter().all(|number| number.is_finite()));
        list.ok_or_else(|| not_possible(key, short(value), "a list of numbers".to_owned()))
    }

    fn angles(&self, key: &'static str) -> Result<Vec<f64>, MetadataError> {
        let value = self.find(key).ok_or(MetadataError::Missing { key })?;
        let angles = self.numbers(key, value)?;
        if (1..=ROWS).contains(&angles.len()) && angles.iter().all(|angle| angle.abs() <= 360.0) {
            return Ok(angles);
        }
        Err(not_possible(
            key,
            short(value),
            format!("1 to {ROWS} angles (deg)"),
        ))
    }

    fn count(&self, key: &'static str, default: Option<usize>, most: usize) -> Result<usize, MetadataError> {
        let Some(value) = self.find(key) else {
            return default.ok_or(MetadataError::Missing { key });
        };
        let count = value.as_u64().and_then(|count| usize::try_from(count).ok());
        count
            .filter(|count| (1..=most).contains(count))
            .ok_or_else(|| not_possible(key, short(value), format!("1 to {most}")))
    }

    /// Columns and revolutions per second of `lidar_mode`, e.g. 1024x10.
    fn mode(&self) -> Result<(Option<usize>, Option<f64>), MetadataError> {
        let Some(mode) = self.text("lidar_mode") else {
            return Ok((None, None));
        };
        let parsed = mode
            .split_once('x')
            .and_then(|(columns, rate)| Some((columns.parse().ok()?, rate.parse().ok()?)));
        parsed
            .map(|(columns, rate_hz)| (Some(columns), Some(rate_hz)))
            .ok_or_else(|| {
                not_possible(
                    "lidar_mode",
                    mode.to_owned(),
                    "COLUMNSxHZ, e.g. 1024x10".to_owned(),
                )
            })
    }

    fn profile(&self) -> Result<Profile, MetadataError> {
        let name = self.text("udp_profile_lidar").unwrap_or("LEGACY");
        let found = PROFILES.iter().find(|profile| profile.name == name);
        found.copied().ok_or_else(|| {
            let possible: Vec<&str> = PROFILES.iter().map(|profile| profile.name).collect();
            not_possible("udp_profile_lidar", name.to_owned(), possible.join(", "))
        })
    }

    fn header(&self, profile: Profile) -> Result<Header, MetadataError> {
        if profile.name == "LEGACY" {
            return Ok(Header::Legacy);
        }
        match self.text("header_type") {
            _ if profile.name.starts_with("FUSA_") => Ok(Header::Fusa),
            None | Some("STANDARD") => Ok(Header::Standard),
            Some("FUSA") => Ok(Header::Fusa),
            Some(other) => Err(not_possible(
                "header_type",
                other.to_owned(),
                "STANDARD, FUSA".to_owned(),
            )),
        }
    }

    fn window(&self, columns: usize) -> Result<[usize; 2], MetadataError> {
        let Some(value) = self.find("column_window") else {
            return Ok([0, columns - 1]);
        };
        let ends = self.numbers("column_window", value)?;
        match ends.as_slice() {
            [first, last]
                if [first, last]
                    .iter()
                    .all(|end| (0.0..columns as f64).contains(*end)) =>
            {
                Ok([*first as usize, *last as usize])
            }
            _ => Err(not_possible(
                "column_window",
                short(value),
                format!("two columns, 0 to {}", columns - 1),
            )),
        }
    }

    fn pixel_shift(&self, rows: usize) -> Result<Vec<i32>, MetadataError> {
        let Some(value) = self.find("pixel_shift_by_row") else {
            return Ok(vec![0; rows]);
        };
        let shifts = self.numbers("pixel_shift_by_row", value)?;
        if shifts.len() == rows {
            return Ok(shifts.into_iter().map(|shift| shift as i32).collect());
        }
        Err(not_possible(
            "pixel_shift_by_row",
            format!("{} shifts", shifts.len()),
            format!("{rows}, one for each beam"),
        ))
    }

    fn beam_origin_mm(&self, product: &str) -> Result<[f64; 2], MetadataError> {
        if let Some(value) = self.find("beam_to_lidar_transform") {
            let matrix = self.matrix("beam_to_lidar_transform", value)?;
            return Ok([matrix[3], matrix[11]]);
        }
        // Where old metadata have no value: the figures of the hardware manuals.
        let of_model = match product.get(..4) {
            Some("OS-0") => 27.67,
            Some("OS-1") => 15.806,
            Some("OS-2") => 13.762,
            _ => 12.163,
        };
        match self.find("lidar_origin_to_beam_origin_mm") {
            None => Ok([of_model, 0.0]),
            Some(value) => value
                .as_f64()
                .filter(|distance| distance.abs() <= 1_000.0)
                .map(|distance| [distance, 0.0])
                .ok_or_else(|| {
                    not_possible(
                        "lidar_origin_to_beam_origin_mm",
                        short(value),
                        "-1000 to 1000".to_owned(),
                    )
                }),
        }
    }

    fn sensor_t_lidar_mm(&self) -> Result<[f64; 16], MetadataError> {
        match self.find("lidar_to_sensor_transform") {
            Some(value) => self.matrix("lidar_to_sensor_transform", value),
            None => Ok([
                -1.0,
                0.0,
                0.0,
                0.0,
                0.0,
                -1.0,
                0.0,
                0.0,
                0.0,
                0.0,
                1.0,
                LIDAR_HEIGHT_MM,
                0.0,
                0.0,
                0.0,
                1.0,
            ]),
        }
    }

    fn matrix(&self, key: &'static str, value: &Value) -> Result<[f64; 16], MetadataError> {
        let numbers = self.numbers(key, value)?;
        <[f64; 16]>::try_from(numbers)
            .ok()
            .filter(|matrix| matrix.iter().all(|number| number.abs() <= 10_000.0))
            .ok_or_else(|| not_possible(key, short(value), "sixteen numbers, row by row".to_owned()))
    }
}

fn not_possible(key: &'static str, value: String, possible: String) -> MetadataError {
    MetadataError::NotPossible { key, value, possible }
}

/// A value in a few characters.
fn short(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(40) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}
