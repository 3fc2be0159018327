//! What the processes are measured under.

use super::disturbance::{Disturbance, FLOODING_SENSOR};
use jink_control::Problem;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};

/// SCHED_FIFO priority of every process where real-time scheduling is measured.
const PRIORITY: u8 = 10;
/// Range of the measured lidar (m).
const RANGE_M: f64 = 20.0;

/// Name of the lidar with this number, from 0 on.
pub(crate) fn lidar_name(number: u32) -> String {
    match number {
        0 => "lidar".to_owned(),
        _ => format!("lidar_{}", number + 1),
    }
}

fn one() -> u32 {
    1
}

/// One load.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Load {
    /// Points of a frame.
    pub points: u32,
    /// Frames per second (Hz).
    pub rate_hz: f64,
    /// Sensors, each with so many points and frames.
    #[serde(default = "one")]
    pub sensors: u32,
    /// Additional readers of every large topic.
    #[serde(default)]
    pub readers: u32,
    /// What disturbs it.
    pub beside: Disturbance,
    /// Whether every process has SCHED_FIFO and keeps its memory.
    pub realtime: bool,
}

impl fmt::Display for Load {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} points, {} Hz{}{}{}{}{}",
            self.points,
            self.rate_hz,
            match self.sensors {
                1 => String::new(),
                sensors => format!(", {sensors} sensors"),
            },
            match self.readers {
                0 => String::new(),
                readers => format!(", {readers} readers"),
            },
            if self.beside == Disturbance::None {
                ""
            } else {
                ", "
            },
            self.beside.words(),
            if self.realtime { ", FIFO and mlock" } else { "" }
        )
    }
}

impl Load {
    /// Writes the set of sensors of this load into `folder`; its file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_sensors(&self, folder: &Path) -> Result<PathBuf, Problem> {
        let file = folder.join("sensors.toml");
        let lidar = |number| {
            format!(
                "[[sensor]]\nname = \"{}\"\nkind = \"lidar_3d\"\nrate_hz = {}\nrays = {}\nrange_max_m = {RANGE_M}\n\
             elevation_min_deg = -90\nelevation_max_deg = 90\n\n",
                lidar_name(number),
                self.rate_hz,
                self.points
            )
        };
        let mut text: String = (0..self.sensors).map(lidar).collect();
        if self.beside == Disturbance::Flood {
            text += &format!(
                "\n[[sensor]]\nname = \"{FLOODING_SENSOR}\"\nkind = \"user/flood\"\noutput = \"scan\"\n"
            );
        }
        std::fs::write(&file, text).map_err(Problem::io(file.display().to_string()))?;
        Ok(file)
    }

    /// Copies the configuration at `from` into `folder`, with what this load asks of the scheduler.
    ///
    /// # Errors
    /// A file cannot be read or written.
    pub fn write_config(&self, from: &Path, folder: &Path) -> Result<(), Problem> {
        let entries = std::fs::read_dir(from).map_err(Problem::io(from.display().to_string()))?;
        for entry in entries.filter_map(Result::ok) {
            let (path, to) = (entry.path(), folder.join(entry.file_name()));
            if path.is_file() {
                let text = std::fs::read(&path).map_err(Problem::io(path.display().to_string()))?;
                std::fs::write(&to, text).map_err(Problem::io(to.display().to_string()))?;
            }
        }
        if self.realtime {
            let file = folder.join("services.toml");
            let name = || file.display().to_string();
            let text = std::fs::read_to_string(&file).map_err(Problem::io(name()))?;
            let with =
                with_realtime(&text).map_err(|cause| Problem::Other(format!("{}: {cause}", name())))?;
            std::fs::write(&file, with).map_err(Problem::io(name()))?;
        }
        Ok(())
    }
}

/// The process table `text` with SCHED_FIFO and locked memory for every row that does not say otherwise. Comments are lost.
fn with_realtime(text: &str) -> Result<String, String> {
    let mut table: toml::Table = text.parse().map_err(|error: toml::de::Error| error.to_string())?;
    let defaults = table
        .entry("defaults")
        .or_insert_with(|| toml::Value::Table(toml::Table::new()));
    let defaults = defaults.as_table_mut().ok_or("\"defaults\" is no table")?;
    defaults.insert("priority".to_owned(), toml::Value::Integer(i64::from(PRIORITY)));
    defaults.insert("lock_memory".to_owned(), toml::Value::Boolean(true));
    toml::to_string(&table).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::with_realtime;

    #[test]
    fn realtime_joins_what_a_table_says_of_all_rows_already() {
        let rows = "[[process]]\nname = \"planner\"\n";
        for text in [
            rows.to_owned(),
            format!("[defaults]\npriority = 3\nlog = \"debug\"\n{rows}"),
        ] {
            let table: toml::Table = with_realtime(&text).unwrap().parse().unwrap();
            let defaults = table["defaults"].as_table().unwrap();
            assert_eq!(defaults["priority"].as_integer(), Some(10));
            assert_eq!(defaults["lock_memory"].as_bool(), Some(true));
            assert_eq!(defaults.contains_key("log"), text.contains("log"));
            assert_eq!(table["process"][0]["name"].as_str(), Some("planner"));
        }
        assert!(with_realtime("defaults = 1").is_err());
        assert!(with_realtime("[defaults").is_err());
    }
}
