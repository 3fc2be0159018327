//! The logs of a run on a disk: each run has a folder of its own.
//!
//! | place | holds |
//! |---|---|
//! | `/dev/shm/jink_INSTANCE/log` | what the processes write, each file emptied when it has grown beyond its limit, and moved aside before |
//! | `LOG_DIR/INSTANCE/000001` | the logs of the first run; runs are counted, because a board without a clock of its own repeats its time |
//! | `/dev/shm/jink_INSTANCE/log_on_disk` | a link to that folder |

use super::append;
use crate::Instance;
use crate::logging::make_folder;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::os::unix::fs::{MetadataExt, symlink};
use std::path::{Path, PathBuf};

/// A log may have this part of what all may take: some twenty logs of a run, each with what was moved aside, leave room for the runs
/// before.
const FILES: u64 = 80;

/// The logs of a run.
#[derive(Debug)]
pub struct RunLogs {
    memory: PathBuf,
    /// The folder of all runs, and the link to that of this one.
    folder: PathBuf,
    link: PathBuf,
    max_bytes: u64,
    /// Where it is written down how much of each file has been carried.
    progress: PathBuf,
    /// How much (bytes).
    carried: BTreeMap<String, u64>,
}

impl RunLogs {
    /// Those of `instance`, to be carried to `log_dir`, where the logs of all its runs take no more than `max_mb` together.
    pub fn new(instance: &Instance, log_dir: &Path, max_mb: u32) -> Self {
        let progress = instance.spool().join("logs");
        let written = std::fs::read_to_string(&progress).unwrap_or_default();
        let carried = written.lines().filter_map(|line| {
            let (bytes, name) = line.split_once(' ')?;
            Some((name.to_owned(), bytes.parse().ok()?))
        });
        Self {
            memory: instance.log_folder(),
            folder: log_dir.join(instance.to_string()),
            link: instance.log_on_disk(),
            max_bytes: u64::from(max_mb) * 1_000_000,
            carried: carried.collect(),
            progress,
        }
    }

    /// Carries what has been written since the last time.
    ///
    /// # Errors
    /// What the system says, with the folder.
    pub fn carry(&mut self) -> io::Result<()> {
        self.carry_all()
            .map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", self.folder.display())))
    }

    fn carry_all(&mut self) -> io::Result<()> {
        if !self.link.is_dir() {
            let _was_removed = std::fs::remove_file(&self.link);
            symlink(begin(&self.folder, self.max_bytes)?, &self.link)?;
            self.carried.clear();
        }
        let before = self.carried.clone();
        let carried = self.carry_files();
        if before != self.carried {
            self.write_progress()?;
        }
        carried
    }

    fn carry_files(&mut self) -> io::Result<()> {
        for path in std::fs::read_dir(&self.memory)?
            .flatten()
            .map(|entry| entry.path())
        {
            let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
                continue;
            };
            let on_disk = self.link.join(name);
            match path.extension().and_then(|extension| extension.to_str()) {
                Some("log") => {
                    let position = self.carried.entry(name.to_owned()).or_default();
                    carry_log(&path, position, &on_disk, self.max_bytes / FILES)?;
                }
                Some("json") if modified(&path)? != modified(&on_disk).unwrap_or_default() => {
                    let new = on_disk.with_extension("new");
                    std::fs::copy(&path, &new)?;
                    File::options()
                        .write(true)
                        .open(&new)?
                        .set_modified(std::fs::metadata(&path)?.modified()?)?;
                    std::fs::rename(new, on_disk)?;
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn write_progress(&self) -> io::Result<()> {
        let mut text = String::new();
        for (name, bytes) in &self.carried {
            let _never_fails = writeln!(text, "{bytes} {name}");
        }
        if let Some(spool) = self.progress.parent() {
            std::fs::create_dir_all(spool)?;
        }
        let new = self.progress.with_extension("new");
        std::fs::write(&new, text)?;
        std::fs::rename(new, &self.progress)
    }
}

/// Seconds and nanoseconds of the last change.
fn modified(path: &Path) -> io::Result<(i64, i64)> {
    let metadata = std::fs::metadata(path)?;
    Ok((metadata.mtime(), metadata.mtime_nsec()))
}

/// A log on the disk that would grow beyond `max_bytes` is moved aside once.
fn carry_log(path: &Path, position: &mut u64, on_disk: &Path, max_bytes: u64) -> io::Result<()> {
    let file = File::open(path)?;
    let end = file.metadata()?.len();
    match std::fs::metadata(on_disk) {
        Ok(there) if there.len() > max_bytes => std::fs::rename(on_disk, on_disk.with_extension("log.1"))?,
        // Whoever has nothing to say has a log, too.
        Err(error) if error.kind() == ErrorKind::NotFound => drop(File::create(on_disk)?),
        _ => {}
    }
    if *position > end {
        // It was emptied; what it held then is beside it.
        if let Ok(aside) = File::open(path.with_extension("log.1")) {
            let end = aside.metadata()?.len();
            append(&aside, position, end, on_disk)?;
        }
        *position = 0;
    }
    append(&file, position, end, on_disk)
}

/// Makes the folder of a run that begins.
fn begin(folder: &Path, max_bytes: u64) -> io::Result<PathBuf> {
    if let Some(log_dir) = folder.parent() {
        make_folder(log_dir)?;
    }
    make_folder(folder)?;
    let mut runs = runs(folder)?;
    let mut number = runs.last().map_or(1, |(number, _)| number + 1);
    // Half of it is for the run that begins.
    remove_oldest(&mut runs, max_bytes / 2)?;
    loop {
        let run = std::path::absolute(folder.join(format!("{number:06}")))?;
        match std::fs::create_dir(&run) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
            made => return made.map(|()| run),
        }
    }
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
    use super::{RunLogs, begin, runs};
    use crate::Instance;
    use std::io::Write;
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
            std::fs::create_dir_all(&place.folder).unwrap();
            std::fs::create_dir_all(place.instance.log_folder()).unwrap();
            place
        }

        fn logs(&self, max_mb: u32) -> RunLogs {
            RunLogs::new(&self.instance, &self.folder.join("logs"), max_mb)
        }

        /// A run that writes so many bytes; the numbers of the runs that are left.
        fn run(&self, bytes: usize, max_bytes: u64) -> Vec<u64> {
            let folder = self.folder.join("runs");
            let run = begin(&folder, max_bytes).unwrap();
            std::fs::write(run.join("planner.log"), vec![b'x'; bytes]).unwrap();
            let runs = runs(&folder).unwrap();
            runs.into_iter().map(|(number, _)| number).collect()
        }
    }

    impl Drop for Place {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.folder);
            let _ = std::fs::remove_dir_all(self.instance.folder());
        }
    }

    #[test]
    fn every_line_is_carried_once_whoever_carries_also_when_the_log_is_emptied() {
        let place = Place::new("once");
        let path = place.instance.log_folder().join("planner.log");
        let mut log = std::fs::File::options()
            .create(true)
            .append(true)
            .open(&path)
            .unwrap();
        let mut carrier = place.logs(200);
        let mut written = String::new();
        for line in 0..300 {
            let text = format!("line {line}\n");
            log.write_all(text.as_bytes()).unwrap();
            written += &text;
            if line % 7 == 0 {
                carrier.carry().unwrap();
            }
            if line % 40 == 0 {
                // The one before was killed.
                carrier = place.logs(200);
            }
            if line == 150 || line == 251 {
                std::fs::copy(&path, path.with_extension("log.1")).unwrap();
                log.set_len(0).unwrap();
            }
        }
        std::fs::write(place.instance.log_folder().join("planner.end.json"), "{}").unwrap();
        carrier.carry().unwrap();
        place.instance.wipe().unwrap();
        let run = place
            .folder
            .join("logs")
            .join(place.instance.to_string())
            .join("000001");
        assert_eq!(std::fs::read_to_string(run.join("planner.log")).unwrap(), written);
        assert_eq!(
            std::fs::read_to_string(run.join("planner.end.json")).unwrap(),
            "{}"
        );
        assert!(!place.instance.log_on_disk().exists());
    }

    #[test]
    fn a_log_on_the_disk_is_moved_aside_at_its_limit() {
        let place = Place::new("aside");
        let path = place.instance.log_folder().join("planner.log");
        let mut log = std::fs::File::options()
            .create(true)
            .append(true)
            .open(&path)
            .unwrap();
        // A megabyte together is 12,500 bytes for each.
        let mut carrier = place.logs(1);
        for _ in 0..30 {
            log.write_all(&[b'x'; 1000]).unwrap();
            carrier.carry().unwrap();
        }
        let size = |name: &str| {
            std::fs::metadata(place.instance.log_on_disk().join(name))
                .unwrap()
                .len()
        };
        assert_eq!((size("planner.log.1"), size("planner.log")), (13_000, 4_000));
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
    fn a_folder_that_is_misspelt_is_not_made_and_one_that_comes_back_is_used() {
        let place = Place::new("misspelt");
        std::fs::write(place.instance.log_folder().join("planner.log"), "one\n").unwrap();
        let disk = place.folder.join("lgo");
        let mut logs = RunLogs::new(&place.instance, &disk.join("jink"), 200);
        let why = logs.carry().unwrap_err().to_string();
        assert!(why.contains("is it misspelt?") && !disk.exists(), "{why}");
        std::fs::create_dir(&disk).unwrap();
        logs.carry().unwrap();
        let kept = || std::fs::read_to_string(place.instance.log_on_disk().join("planner.log")).unwrap();
        assert_eq!(kept(), "one\n");
        // Somebody removes all of it.
        std::fs::remove_dir_all(disk.join("jink")).unwrap();
        logs.carry().unwrap();
        assert_eq!(kept(), "one\n");
    }
}
