//! Everything on the link in a file that ground stations and `mavlogdump.py` read: for each frame eight bytes of time,
//! big-endian microseconds since 1970, and the frame as it was on the wire.
//!
//! It is written into memory and carried to a disk from there ([`jink_runtime::spool`]): the link never waits for a disk. What the disk
//! does not take is left out, and counted.

use jink_runtime::file_series::{file_bytes, unix_us};
use jink_runtime::spool::spooled_files::{begin, why_lost};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The longest frame: MAVLink 2 with a signature and a wide system id.
const FRAME_MAX: usize = 300;
/// How often it is asked whether the disk takes it (us).
const ASK_EVERY_US: u64 = 1_000_000;
/// Ends the names of the files.
const EXTENSION: &str = "tlog";

/// A log that is being written.
#[derive(Debug)]
pub struct Tlog {
    spool: PathBuf,
    generation: u32,
    /// A file that has so many bytes is followed by another (0: never).
    file_bytes: u64,
    file: File,
    path: PathBuf,
    bytes: u64,
    asked_us: u64,
    failure: Option<String>,
    left_out: u64,
}

impl Tlog {
    /// Begins a new file in `spool`. All files of the folder that they are carried to take no more than `max_bytes` (0: as much as there
    /// is).
    ///
    /// # Errors
    /// The system's about the folder or the file.
    pub fn begin(spool: &Path, generation: u32, max_bytes: u64) -> std::io::Result<Self> {
        let (file, path) = begin(spool, EXTENSION, generation)?;
        Ok(Self {
            spool: spool.to_owned(),
            generation,
            file_bytes: file_bytes(max_bytes),
            file,
            path,
            bytes: 0,
            asked_us: unix_us(),
            failure: None,
            left_out: 0,
        })
    }

    /// The file that is written to, in memory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a frame that was read or written now.
    pub fn add(&mut self, frame: &[u8]) {
        let now_us = unix_us();
        // A clock that was set asks once more.
        if now_us.abs_diff(self.asked_us) >= ASK_EVERY_US {
            self.asked_us = now_us;
            self.failure = self.failure.take().or_else(|| why_lost(&self.spool, EXTENSION));
        }
        let mut record = [0; 8 + FRAME_MAX];
        let len = 8 + frame.len();
        let Some(place) = record.get_mut(8..len).filter(|_| self.failure.is_none()) else {
            self.left_out += 1;
            return;
        };
        place.copy_from_slice(frame);
        record[..8].copy_from_slice(&now_us.to_be_bytes());
        // Whole records, so that what is carried ends with one.
        if let Err(error) = self.write(&record[..len]) {
            self.left_out += 1;
            self.failure = Some(error.to_string());
        }
    }

    fn write(&mut self, record: &[u8]) -> std::io::Result<()> {
        if self.file_bytes > 0 && self.bytes >= self.file_bytes {
            (self.file, self.path) = begin(&self.spool, EXTENSION, self.generation)?;
            self.bytes = 0;
        }
        self.bytes += record.len() as u64;
        self.file.write_all(record)
    }

    /// Why the log ends here: a disk that is full, or gone.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// Frames that are not in the file.
    pub fn left_out(&self) -> u64 {
        self.left_out
    }
}

impl Drop for Tlog {
    fn drop(&mut self) {
        if self.left_out > 0 {
            tracing::warn!("{} frames left out of the telemetry log", self.left_out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{FRAME_MAX, Tlog};

    #[test]
    fn frames_are_written_with_their_time_and_what_is_no_frame_is_left_out() {
        let folder = std::env::temp_dir().join(format!("jink_tlog_{}", std::process::id()));
        let mut log = Tlog::begin(&folder, 3, 0).unwrap();
        let path = log.path().to_owned();
        let frames: [&[u8]; 2] = [&[0xfd, 1, 2, 3], &[0xfe; FRAME_MAX]];
        log.add(frames[0]);
        log.add(&[0; FRAME_MAX + 1]);
        log.add(frames[1]);
        assert_eq!(log.left_out(), 1);
        drop(log);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        let (mut rest, mut before_us) = (&bytes[..], 0);
        for frame in frames {
            let (time, after) = rest.split_first_chunk::<8>().unwrap();
            let time_us = u64::from_be_bytes(*time);
            // 2020 or later: the unit is right.
            assert!(time_us >= before_us && time_us > 1_577_836_800_000_000);
            before_us = time_us;
            assert_eq!(&after[..frame.len()], frame);
            rest = &after[frame.len()..];
        }
        assert!(rest.is_empty());
        assert_eq!(path.file_name().unwrap(), "3-1.tlog");
    }
}
