//! Files of one kind in a folder, limited together: telemetry logs, recordings.
//!
//! One that has a quarter of the limit is followed by another, and those that were written to longest ago are removed to make room.

use crate::logging::make_folder;
use std::fs::File;
use std::io::{Error, ErrorKind, Result};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Parts of the limit that one file may have: so that what is removed at a time is no more.
const FILES: u64 = 4;
/// Begins the names of all: other files of the folder are somebody else's.
const PREFIX: &str = "jink-";

/// The files of a folder with one extension.
#[derive(Clone, Debug)]
pub struct FileSeries {
    folder: PathBuf,
    extension: &'static str,
    generation: u32,
    max_bytes: u64,
}

impl FileSeries {
    /// Those in `folder`. Their names hold the time, the `generation` of the process that writes, and a number if there is such a file
    /// already: a board without a clock of its own begins at the same time again and again. Together they take no more than
    /// `max_bytes` (0: as much as there is).
    pub fn new(folder: &Path, extension: &'static str, generation: u32, max_bytes: u64) -> Self {
        Self {
            folder: folder.to_owned(),
            extension,
            generation,
            max_bytes,
        }
    }

    /// A new file, after the oldest ones have made room for it. The folder is made if the one that it is in is there.
    ///
    /// # Errors
    /// The system's error about the folder.
    pub fn next(&self) -> Result<(File, PathBuf)> {
        make_folder(&self.folder)
            .and_then(|()| self.make_room())
            .and_then(|()| self.new_file(unix_us() / 1_000_000))
            .map_err(|error| Error::new(error.kind(), format!("{}: {error}", self.folder.display())))
    }

    /// Whether a file of so many bytes is to be followed by another.
    pub fn is_full(&self, bytes: u64) -> bool {
        self.max_bytes > 0 && bytes >= file_bytes(self.max_bytes)
    }

    /// Removes the files that were written to longest ago, until the others leave room for one more.
    fn make_room(&self) -> Result<()> {
        if self.max_bytes == 0 {
            return Ok(());
        }
        let mut files: Vec<_> = std::fs::read_dir(&self.folder)?
            .flatten()
            .filter(|entry| {
                let name = entry.file_name();
                let name = name.to_string_lossy();
                name.starts_with(PREFIX) && name.ends_with(&format!(".{}", self.extension))
            })
            .filter_map(|entry| {
                let metadata = entry.metadata().ok()?;
                Some((metadata.modified().ok()?, metadata.len(), entry.path()))
            })
            .collect();
        files.sort();
        let mut bytes: u64 = files.iter().map(|(_, len, _)| len).sum();
        for (_, len, path) in files {
            if bytes <= self.max_bytes - self.max_bytes / FILES {
                break;
            }
            std::fs::remove_file(path)?;
            bytes -= len;
        }
        Ok(())
    }

    /// A file that was not there.
    fn new_file(&self, unix_s: u64) -> Result<(File, PathBuf)> {
        let mut number = 1;
        loop {
            let suffix = match number {
                1 => String::new(),
                _ => format!("-{number}"),
            };
            let name = format!("{PREFIX}{unix_s}-{}{suffix}.{}", self.generation, self.extension);
            let path = self.folder.join(name);
            match File::create_new(&path) {
                Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
                made => return Ok((made?, path)),
            }
        }
    }
}

/// How much of the limit of all one file may have (bytes).
pub fn file_bytes(max_bytes: u64) -> u64 {
    max_bytes / FILES
}

/// Microseconds since 1970.
pub fn unix_us() -> u64 {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
    since_1970.map_or(0, |time| u64::try_from(time.as_micros()).unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::FileSeries;
    use std::io::Write;

    #[test]
    fn a_second_start_at_the_same_time_begins_a_file_of_its_own() {
        let folder = std::env::temp_dir().join(format!("jink_series_again_{}", std::process::id()));
        let series = FileSeries::new(&folder, "tlog", 1, 0);
        std::fs::create_dir(&folder).unwrap();
        let names = [(); 3].map(|()| {
            let (_file, path) = series.new_file(1_700_000_000).unwrap();
            path.file_name().unwrap().to_string_lossy().into_owned()
        });
        std::fs::remove_dir_all(&folder).unwrap();
        let begin = "jink-1700000000-1";
        assert_eq!(
            names,
            [
                format!("{begin}.tlog"),
                format!("{begin}-2.tlog"),
                format!("{begin}-3.tlog")
            ]
        );
    }

    #[test]
    fn the_files_of_a_folder_never_take_more_than_their_limit_and_the_oldest_go_first() {
        let folder = std::env::temp_dir().join(format!("jink_series_limit_{}", std::process::id()));
        let series = FileSeries::new(&folder, "tlog", 1, 10_000);
        std::fs::create_dir(&folder).unwrap();
        for (name, bytes) in [
            ("jink-1-1.tlog", 9000),
            ("jink-1-1.mcap", 20_000),
            ("notes.tlog", 20_000),
        ] {
            std::fs::write(folder.join(name), vec![0; bytes]).unwrap();
        }
        let (mut written, mut file) = (0, series.next().unwrap().0);
        for _ in 0..1000 {
            if series.is_full(written) {
                (written, file) = (0, series.next().unwrap().0);
            }
            file.write_all(&[0; 100]).unwrap();
            written += 100;
        }
        let names = |entry: std::fs::DirEntry| entry.file_name().into_string().unwrap();
        let ours = |entry: &std::fs::DirEntry| {
            let name = entry.file_name().into_string().unwrap();
            name.starts_with("jink-") && name.ends_with(".tlog")
        };
        let entries = || std::fs::read_dir(&folder).unwrap().flatten();
        let sizes: Vec<u64> = entries()
            .filter(ours)
            .map(|entry| entry.metadata().unwrap().len())
            .collect();
        let all: Vec<String> = entries().map(names).collect();
        std::fs::remove_dir_all(&folder).unwrap();
        assert!(
            sizes.iter().sum::<u64>() <= 10_000 && sizes.len() >= 3,
            "{sizes:?}"
        );
        let is_there = |name: &str| all.iter().any(|there| there == name);
        assert!(is_there("notes.tlog") && is_there("jink-1-1.mcap") && !is_there("jink-1-1.tlog"));
    }

    #[test]
    fn a_folder_that_is_misspelt_is_refused_and_not_made() {
        let place = std::env::temp_dir().join(format!("jink_sreies_{}", std::process::id()));
        let refused = FileSeries::new(&place.join("tlog"), "tlog", 1, 0)
            .next()
            .unwrap_err()
            .to_string();
        assert!(refused.starts_with(&place.display().to_string()), "{refused}");
        assert!(!place.exists());
    }
}
