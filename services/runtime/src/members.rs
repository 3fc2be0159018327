//! Who the members of the families of topics are: sensors and processes.

use crate::Instance;
use crate::config::{Config, SensorOutput, process_names};
use jink_shared_types::topics::{CYCLES, HEALTH, RANGE_CLOUD, RANGE_SCAN, TopicRow};
use std::path::Path;

/// Who the members of the families are.
#[derive(Clone, Debug, Default)]
pub struct Members {
    /// Sensors that publish clouds.
    pub clouds: Vec<String>,
    /// Sensors that publish scans.
    pub scans: Vec<String>,
    /// Processes.
    pub processes: Vec<String>,
}

impl Members {
    /// Who they are in a running `instance`.
    pub fn of_instance(instance: &Instance) -> Self {
        Self::of_config(&instance.run_config())
    }

    /// Who they are with the configuration in `folder`.
    pub fn of_config(folder: &Path) -> Self {
        let mut processes = process_names(folder);
        processes.push("supervisor".to_owned());
        let sensors = Config::load(folder)
            .map(|config| config.sensors)
            .unwrap_or_default();
        let of = |output: SensorOutput| {
            let publishing = sensors.iter().filter(|sensor| sensor.output == output);
            publishing.map(|sensor| sensor.name.clone()).collect()
        };
        Self {
            clouds: of(SensorOutput::Cloud),
            scans: of(SensorOutput::Scan),
            processes,
        }
    }

    /// The names of all topics of a row.
    pub fn topics(&self, row: &TopicRow) -> Vec<String> {
        match row.is_family() {
            true => self.of(row).iter().map(|member| row.topic_name(member)).collect(),
            false => vec![row.name.to_owned()],
        }
    }

    /// Members of the family of a row.
    pub fn of(&self, row: &TopicRow) -> &[String] {
        match row.name {
            name if name == RANGE_CLOUD.row.name => &self.clouds,
            name if name == RANGE_SCAN.row.name => &self.scans,
            name if name == HEALTH.row.name || name == CYCLES.row.name => &self.processes,
            _ => &[],
        }
    }
}
