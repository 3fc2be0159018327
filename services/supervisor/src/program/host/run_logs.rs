//! Where the logs of a run are: with the instance, in memory, or on a disk, where each run has a folder of its own.
//!
//! | place | holds |
//! |---|---|
//! | `LOG_DIR/INSTANCE/000001` | the logs of the first run; runs are counted, because a board without a clock of its own repeats its time |
//! | `/dev/shm/jink_INSTANCE/log` | those of this run: a link to that folder, or, without one, the folder itself |

use jink_runtime::Instance;
use jink_runtime::config::Config;
use jink_runtime::logging::make_folder;
use std::io::{self, ErrorKind};
use std::os::unix::fs::{MetadataExt, symlink};
use std::path::{Path, PathBuf};

/// A log in memory that has grown beyond this is moved aside once (bytes).
const FILE_IN_MEMORY_BYTES: u64 = 1 << 20;
/// A log on a disk may have this part of what all may take: some twenty logs of a run, each with what was moved aside, leave room
/// for the runs before.
const FILES: u64 = 80;

/// The logs of the run that begins.
#[derive(Debug)]
pub struct RunLogs {
    /// Whose they are.
    pub instance: Instance,
    /// A log that has grown beyond this is moved aside once (bytes).
    pub file_max_bytes: u64,
    /// Why they are not where they should be.
    pub misplaced: Option<String>,
}

impl RunLogs {
    /// Makes the folder: that of the configuration, else that of the service manager, else in memory. One that cannot be made
    /// keeps nobody from flying: then they are in memory, too.
    pub fn begin(instance: &Instance, config: &Config) -> io::Result<Self> {
        let max_bytes = u64::from(config.log_max_mb) * 1_000_000;
        let mut logs = Self {
            instance: instance.clone(),
            file_max_bytes: FILE_IN_MEMORY_BYTES,
            misplaced: None,
        };
        if let Some(log_dir) = config.log_dir.clone().or_else(of_the_service_manager) {
            match make_folder(&log_dir)
                .and_then(|()| begin_on_disk(instance, &log_dir.join(instance.to_string()), max_bytes))
            {
                Ok(()) => {
                    logs.file_max_bytes = max_bytes / FILES;
                    return Ok(logs);
                }
                Err(error) => {
                    logs.misplaced = Some(format!("{}: {error}", log_dir.display()));
                }
            }
        }
        std::fs::create_dir_all(instance.log_folder())?;
        Ok(logs)
    }

    /// Those of a run that goes on under another supervisor.
    pub fn resume(instance: &Instance, config: &Config) -> io::Result<Self> {
        let is_on_disk = instance.log_folder().is_symlink();
        if !is_on_disk {
            std::fs::create_dir_all(instance.log_folder())?;
        }
        let on_disk = u64::from(config.log_max_mb) * 1_000_000 / FILES;
        Ok(Self {
            instance: instance.clone(),
            file_max_bytes: if is_on_disk { on_disk } else { FILE_IN_MEMORY_BYTES },
            misplaced: None,
        })
    }

    /// Whether they are where they should be, and there is room for them.
    pub fn are_kept(&self) -> bool {
        self.misplaced.is_none() && self.instance.logs_have_room()
    }
}

/// `LogsDirectory=` of the unit (systemd.exec(5)).
fn of_the_service_manager() -> Option<PathBuf> {
    let folders = std::env::var("LOGS_DIRECTORY").ok()?;
    let first = folders.split(':').next().filter(|folder| !folder.is_empty())?;
    Some(PathBuf::from(first))
}

fn begin_on_disk(instance: &Instance, folder: &Path, max_bytes: u64) -> io::Result<()> {
    make_folder(folder)?;
    let mut runs = runs(folder)?;
    let mut number = runs.last().map_or(1, |(number, _)| number + 1);
    // Half of it is for the run that begins.
    remove_oldest(&mut runs, max_bytes / 2)?;
    let run = loop {
        let run = std::path::absolute(folder.join(format!("{number:06}")))?;
        match std::fs::create_dir(&run) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
            made => break made.map(|()| run)?,
        }
    };
    // Whoever may make a folder there may not be able to write into it: the disk may be full.
    let probe = run.join("probe");
    std::fs::write(&probe, "room for logs\n").and_then(|()| std::fs::remove_file(probe))?;
    symlink(run, instance.log_folder())
}

/// The folders of all runs with their numbers, oldest first.
fn runs(folder: &Path) -> io::Result<Vec<(u64, PathBuf)>> {
    let mut runs: Vec<_> = std::fs::read_dir(folder)?
        .flatten()
        .filter_map(|entry| Some((entry.file_name().to_str()?.parse().ok()?, entry.path())))
        .collect();
    runs.sort();
    Ok(runs)
}

/// Removes the oldest runs until the others take no more than `max_bytes` on the disk.
fn remove_oldest(runs: &mut Vec<(u64, PathBuf)>, max_bytes: u64) -> io::Result<()> {
    let sizes: Vec<u64> = runs.iter().map(|(_, run)| size_bytes(run)).collect();
    let mut bytes: u64 = sizes.iter().sum();
    let mut removed = 0;
    for (size, (_, run)) in sizes.iter().zip(runs.iter()) {
        if bytes <= max_bytes {
            break;
        }
        std::fs::remove_dir_all(run)?;
        bytes -= size;
        removed += 1;
    }
    runs.drain(..removed);
    Ok(())
}

/// What a run takes, its folder included (bytes).
fn size_bytes(run: &Path) -> u64 {
    const BLOCK_BYTES: u64 = 512;
    let files = std::fs::read_dir(run).into_iter().flatten().flatten();
    let all = std::iter::once(run.to_owned()).chain(files.map(|entry| entry.path()));
    all.filter_map(|path| std::fs::symlink_metadata(path).ok())
        .map(|metadata| metadata.blocks() * BLOCK_BYTES)
        .sum()
}

#[cfg(test)]
mod tests {
    use super::{RunLogs, begin_on_disk, runs};
    use jink_runtime::Instance;
    use jink_runtime::config::Config;
    use std::path::PathBuf;

    struct Place {
        instance: Instance,
        folder: PathBuf,
    }

    impl Place {
        fn new(test: &str) -> Self {
            let name = format!("logs_{test}_{}", std::process::id());
            let place = Self {
                folder: std::env::temp_dir().join(&name),
                instance: name.parse().unwrap(),
            };
            std::fs::create_dir_all(place.instance.folder()).unwrap();
            place
        }

        /// A run that writes so many bytes; the numbers of the runs that are left.
        fn run(&self, bytes: usize, max_bytes: u64) -> Vec<u64> {
            begin_on_disk(&self.instance, &self.folder, max_bytes).unwrap();
            std::fs::write(self.instance.log_folder().join("planner.log"), vec![b'x'; bytes]).unwrap();
            self.instance.wipe().unwrap();
            runs(&self.folder)
                .unwrap()
                .into_iter()
                .map(|(number, _)| number)
                .collect()
        }
    }

    impl Drop for Place {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.folder);
            let _ = std::fs::remove_dir_all(self.instance.folder());
        }
    }

    #[test]
    fn what_is_on_the_disk_outlives_the_instances_memory_run_by_run() {
        let place = Place::new("outlive");
        assert_eq!(place.run(10, 1 << 30), [1]);
        assert_eq!(place.run(20, 1 << 30), [1, 2]);
        let first = place.folder.join("000001/planner.log");
        assert_eq!(std::fs::read(first).unwrap(), vec![b'x'; 10]);
        assert!(!place.instance.log_folder().exists());
    }

    #[test]
    fn the_oldest_runs_make_room_for_the_next_one() {
        let place = Place::new("limit");
        for _ in 0..10 {
            let left = place.run(100_000, 1_000_000);
            assert!(left.len() <= 6, "{left:?}");
        }
        assert_eq!(place.run(1, 1_000_000).last(), Some(&11));
        assert_eq!(place.run(1, 0), [12], "not even with no room at all");
    }

    #[test]
    fn a_folder_that_is_misspelt_is_not_made_and_the_logs_are_in_memory() {
        let place = Place::new("misspelt");
        let config = Config {
            log_dir: Some(place.folder.join("lgo")),
            ..Config::default()
        };
        let logs = RunLogs::begin(&place.instance, &config).unwrap();
        assert!(logs.misplaced.is_some_and(|why| why.contains("is it misspelt?")));
        assert!(!place.folder.exists() && place.instance.log_folder().is_dir());
        std::fs::create_dir(&place.folder).unwrap();
        place.instance.wipe().unwrap();
        let logs = RunLogs::begin(&place.instance, &config).unwrap();
        assert_eq!(logs.misplaced, None);
        assert!(place.folder.join("lgo").is_dir() && place.instance.log_folder().is_symlink());
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_an_error_and_makes_no_link() {
        let place = Place::new("refused");
        let file = place.folder.join("a_file");
        std::fs::create_dir_all(&place.folder).unwrap();
        std::fs::write(&file, "").unwrap();
        assert!(begin_on_disk(&place.instance, &file.join("jink"), 1 << 30).is_err());
        assert!(!place.instance.log_folder().is_symlink());
    }
}
