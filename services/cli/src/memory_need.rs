//! How much shared memory the topics of a configuration take: computed from the topic table, before anything is started.

use jink_runtime::config::{Sensor, SensorOutput};
use jink_shared_types::topics::{self, TABLE, TopicRow};

/// One topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicNeed {
    /// Its name; of a topic on which every process publishes, or has its own, the row's.
    pub topic: String,
    /// Processes that publish it at once.
    pub publishers: usize,
    /// Samples that each of them has room for.
    pub slots: usize,
    /// Bytes of all of them.
    pub bytes: usize,
}

/// What the topics of `processes` processes and of `sensors` take, the largest first. A process that is swapped publishes twice for a
/// moment, which takes its topics once more.
pub fn of_topics(processes: usize, sensors: &[Sensor]) -> Vec<TopicNeed> {
    let mut needs: Vec<TopicNeed> = TABLE
        .iter()
        .flat_map(|row| match row.name {
            name if name == topics::RANGE_CLOUD.row.name => of_sensors(row, sensors, SensorOutput::Cloud),
            name if name == topics::RANGE_SCAN.row.name => of_sensors(row, sensors, SensorOutput::Scan),
            name if row.producers.contains(&"*") => vec![need(row, name.to_owned(), processes)],
            name => vec![need(row, name.to_owned(), 1)],
        })
        .collect();
    needs.sort_by(|a, b| b.bytes.cmp(&a.bytes).then_with(|| a.topic.cmp(&b.topic)));
    needs
}

fn of_sensors(row: &TopicRow, sensors: &[Sensor], output: SensorOutput) -> Vec<TopicNeed> {
    let of_the_kind = sensors.iter().filter(|sensor| sensor.output == output);
    of_the_kind
        .map(|sensor| need(row, row.topic_name(&sensor.name), 1))
        .collect()
}

fn need(row: &TopicRow, topic: String, publishers: usize) -> TopicNeed {
    TopicNeed {
        topic,
        publishers,
        slots: row.slots(),
        bytes: publishers * row.memory_bytes(),
    }
}

#[cfg(test)]
mod tests {
    use super::of_topics;
    use jink_runtime::config::{Config, PROCESS_FILE, process_names};
    use std::path::Path;

    /// A fifth of what a board with 1 GB lends to shared memory, which is half of it (bytes).
    const MOST_BYTES: usize = 100_000_000;

    #[test]
    fn the_shipped_configuration_fits_a_small_board() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        assert!(folder.join(PROCESS_FILE).is_file());
        let config = Config::load(&folder).unwrap();
        let needs = of_topics(process_names(&folder).len() + 1, &config.sensors);
        let bytes: usize = needs.iter().map(|need| need.bytes).sum();
        assert!(bytes < MOST_BYTES, "{bytes} {needs:?}");
        assert_eq!(needs[0].topic, "range/cloud/lidar", "{needs:?}");
    }

    #[test]
    fn every_sensor_and_every_process_counts() {
        let config = Config::parse(
            Path::new("jink.toml"),
            "[[sensor]]\nname = \"a\"\nkind = \"lidar_3d\"\n[[sensor]]\nname = \"b\"\nkind = \"rangefinder\"\n",
        )
        .unwrap();
        let of = |topic: &str, processes: usize, sensors: usize| {
            let needs = of_topics(processes, &config.sensors[..sensors]);
            needs.into_iter().find(|need| need.topic == topic)
        };
        assert!(of("range/cloud/a", 1, 2).is_some() && of("range/scan/b", 1, 2).is_some());
        assert!(of("range/scan/b", 1, 1).is_none() && of("range/cloud/b", 1, 2).is_none());
        let bytes = |processes| of("health/*", processes, 0).unwrap().bytes;
        assert_eq!(bytes(8), 8 * bytes(1));
    }
}
