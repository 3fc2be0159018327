//! Shared memory: what the topics of a configuration take, what there is, and taking it before the flight.
//!
//! | | reckoned | taken |
//! |---|---|---|
//! | small samples, and what iceoryx2 keeps beside them | all that there may be | by each process when its service runs (`take_small`) |
//! | large samples | what the programs of the row may have queued and hold | by their publisher when it opens the topic |
//! | large samples that shadows and spectators hold besides | not | before one is filled for the first time; otherwise it is not sent |

use crate::config::{Config, Sensor, SensorOutput};
use crate::instance::Instance;
use crate::open_error::OpenError;
use jink_shared_types::topics::{self, TABLE, TopicRow};
use rustix::fs::{FallocateFlags, fallocate, statvfs};
use rustix::io::Errno;
use std::fs::File;
use std::os::unix::fs::MetadataExt;

/// Where shared memory lies.
pub const SHARED_MEMORY: &str = "/dev/shm";
/// What to do where it is too small.
pub const REMEDY: &str = "make /dev/shm larger (mount -o remount,size=256M /dev/shm; of a container --shm-size=256m) or configure fewer sensors";
/// What a program takes besides its samples when it joins (bytes): its node, a page for each of its connections, which are 40 at most.
pub(crate) const TO_JOIN_BYTES: u64 = 256 << 10;
/// What an instance takes besides the samples (bytes): nodes, topics, connections, configuration, record: 1.0 MiB of nine processes were
/// measured, and their logs begin.
const BESIDES_BYTES: usize = 2 << 20;
/// A file is taken up to here (bytes); what is larger are large samples.
const SMALL_BYTES: u64 = 1 << 20;
/// Unit of `st_blocks` (bytes), whatever the file system.
const BLOCK_BYTES: u64 = 512;

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
    /// Bytes of those that are taken at the start.
    pub reserved_bytes: usize,
}

/// What an instance takes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Need {
    /// Its topics, the largest first.
    pub topics: Vec<TopicNeed>,
}

impl Need {
    /// What the topics of `processes` processes and of the sensors of `config` take, and those that the configuration declares. A process
    /// that is swapped publishes twice for a moment, which takes its topics once more.
    pub fn of(processes: usize, config: &Config, declared: &[TopicRow]) -> Self {
        let sensors = &config.sensors;
        // Nobody publishes it otherwise.
        let is_there =
            |row: &&TopicRow| row.name != topics::CYCLES.row.name || config.recorder.folder.is_some();
        let mut topics: Vec<TopicNeed> = TABLE
            .iter()
            .filter(is_there)
            .chain(declared)
            .flat_map(|row| match row.name {
                name if name == topics::RANGE_CLOUD.row.name => of_sensors(row, sensors, SensorOutput::Cloud),
                name if name == topics::RANGE_SCAN.row.name => of_sensors(row, sensors, SensorOutput::Scan),
                name if row.producers.contains(&"*") => vec![need(row, name.to_owned(), processes)],
                name => vec![need(row, name.to_owned(), 1)],
            })
            .collect();
        topics.sort_by(|a, b| b.bytes.cmp(&a.bytes).then_with(|| a.topic.cmp(&b.topic)));
        Self { topics }
    }

    /// What is taken at the start (bytes).
    pub fn reserved_bytes(&self) -> usize {
        BESIDES_BYTES + self.topics.iter().map(|need| need.reserved_bytes).sum::<usize>()
    }

    /// What it may become while others look on (bytes).
    pub fn most_bytes(&self) -> usize {
        BESIDES_BYTES + self.topics.iter().map(|need| need.bytes).sum::<usize>()
    }

    /// # Errors
    /// [`OpenError::NoRoom`] if what is taken at the start is not there.
    pub fn has_room(&self) -> Result<(), OpenError> {
        has("this configuration", self.reserved_bytes() as u64)
    }
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
        reserved_bytes: publishers * row.reserved_bytes(),
    }
}

/// What there is (bytes).
///
/// # Errors
/// What the system says.
pub fn available_bytes() -> std::io::Result<u64> {
    let space = statvfs(SHARED_MEMORY)?;
    Ok(match space.f_blocks {
        // Mounted without a limit.
        0 => u64::MAX,
        _ => space.f_bavail.saturating_mul(space.f_frsize),
    })
}

/// What the instance's files in shared memory have taken (bytes); their sizes say what they may become.
pub fn used_bytes(instance: &Instance) -> u64 {
    let files = instance.memory_files();
    files
        .filter_map(|path| std::fs::symlink_metadata(path).ok())
        .map(|file| file.blocks() * BLOCK_BYTES)
        .sum()
}

/// Whether `needed_bytes` are there.
pub(crate) fn has(what: &str, needed_bytes: u64) -> Result<(), OpenError> {
    // What cannot be asked is tried.
    let available_bytes = available_bytes().unwrap_or(u64::MAX);
    match available_bytes < needed_bytes {
        true => Err(OpenError::NoRoom {
            what: what.to_owned(),
            needed_bytes,
            available_bytes,
        }),
        false => Ok(()),
    }
}

/// Takes the first `bytes` of `file`, if they are not there yet.
pub(crate) fn take(file: &File, bytes: u64, what: &str) -> Result<(), OpenError> {
    match fallocate(file, FallocateFlags::KEEP_SIZE, 0, bytes) {
        Err(Errno::NOSPC | Errno::NOMEM) => Err(OpenError::NoRoom {
            what: what.to_owned(),
            needed_bytes: bytes,
            available_bytes: available_bytes().unwrap_or(0),
        }),
        // A file system that cannot do it gives memory when it is written.
        _ => Ok(()),
    }
}

/// Takes what the instance's small files lack.
pub(crate) fn take_small(instance: &Instance) -> Result<(), OpenError> {
    for path in instance.memory_files() {
        let Ok(file) = File::options().write(true).open(&path) else {
            // Removed meanwhile, or being made.
            continue;
        };
        let Ok(metadata) = file.metadata() else { continue };
        let bytes = metadata.len().min(SMALL_BYTES);
        if bytes > 0 && metadata.blocks() * BLOCK_BYTES < bytes {
            take(&file, bytes, &format!("instance {instance}"))?;
        }
    }
    Ok(())
}

/// With one digit, in millions of bytes.
pub fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}

#[cfg(test)]
mod tests {
    use super::{Need, SHARED_MEMORY, TopicNeed, used_bytes};
    use crate::config::{Config, PROCESS_FILE, process_names};
    use crate::instance::Instance;
    use std::os::unix::fs::FileExt;
    use std::path::Path;

    /// A quarter of what a board with 1 GB lends to shared memory, which is half of it (bytes): while as many look on as may.
    const MOST_BYTES: usize = 125_000_000;
    /// A tenth of it.
    const RESERVED_BYTES: usize = 50_000_000;

    #[test]
    fn the_shipped_configuration_fits_a_small_board() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        assert!(folder.join(PROCESS_FILE).is_file());
        let config = Config::load(&folder).unwrap();
        let need = Need::of(process_names(&folder).len() + 1, &config, &[]);
        assert!(need.most_bytes() < MOST_BYTES, "{need:?}");
        assert!(need.reserved_bytes() < RESERVED_BYTES, "{need:?}");
        assert_eq!(need.topics[0].topic, "range/cloud/lidar", "{need:?}");
    }

    #[test]
    fn what_a_file_may_become_is_not_used() {
        const FILE_BYTES: u64 = 64 << 20;
        let instance: Instance = format!("sparse_{}", std::process::id()).parse().unwrap();
        assert_eq!(used_bytes(&instance), 0);
        let path = Path::new(SHARED_MEMORY).join(instance.shm_prefix() + "topic");
        let file = std::fs::File::create_new(&path).unwrap();
        file.set_len(FILE_BYTES).unwrap();
        let empty = used_bytes(&instance);
        file.write_all_at(&[1; 4096], FILE_BYTES / 2).unwrap();
        let written = used_bytes(&instance);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(empty, 0);
        assert!((4096..FILE_BYTES / 2).contains(&written), "{written}");
    }

    #[test]
    fn every_sensor_and_every_process_counts() {
        let config = Config::parse(
            Path::new("jink.toml"),
            "[[sensor]]\nname = \"a\"\nkind = \"lidar_3d\"\n[[sensor]]\nname = \"b\"\nkind = \"rangefinder\"\n",
        )
        .unwrap();
        let of = |topic: &str, processes: usize, sensors: usize| -> Option<TopicNeed> {
            let sensors = config.sensors[..sensors].to_vec();
            let config = Config {
                sensors,
                ..config.clone()
            };
            let need = Need::of(processes, &config, &[]);
            need.topics.into_iter().find(|need| need.topic == topic)
        };
        assert!(of("range/cloud/a", 1, 2).is_some() && of("range/scan/b", 1, 2).is_some());
        assert!(of("range/scan/b", 1, 1).is_none() && of("range/cloud/b", 1, 2).is_none());
        let bytes = |processes| of("health/*", processes, 0).unwrap().bytes;
        assert_eq!(bytes(8), 8 * bytes(1));
    }
}
