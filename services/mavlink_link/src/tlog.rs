//! Everything on the link in a file that ground stations and `mavlogdump.py` read: for each frame eight bytes of time,
//! big-endian microseconds since 1970, and the frame as it was on the wire.
//!
//! A thread writes; the link hands it copies and never waits. What the disk is too slow for is left out, and counted. The files of a
//! folder are limited together: one that has a quarter of that is followed by another, and the oldest ones are removed.

use jink_runtime::logging::make_folder;
use jink_runtime::realtime::{Scheduling, schedule};
use std::fs::File;
use std::io::{BufWriter, Error, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::{SystemTime, UNIX_EPOCH};

/// The longest frame: MAVLink 2 with a signature and a wide system id.
const FRAME_MAX: usize = 300;
/// Frames that may wait for the disk: some five seconds of a busy link.
const WAITING_MAX: usize = 2048;
/// Parts of its folder's limit that one file may have: so that what is removed at a time is no more.
const FILES: u64 = 4;

/// One frame with its time.
#[derive(Clone)]
struct TlogRecord {
    unix_us: u64,
    len: usize,
    bytes: [u8; FRAME_MAX],
}

/// A log that is being written.
#[derive(Debug)]
pub struct Tlog {
    path: PathBuf,
    /// `None` = is being closed.
    records: Option<SyncSender<TlogRecord>>,
    writer: Option<JoinHandle<()>>,
    /// Set by the writer when it cannot write any more.
    has_failed: Arc<AtomicBool>,
    left_out: u64,
}

impl Tlog {
    /// Begins a new file in `folder`, which is made if the one that it is in is there. Its name holds the time and the generation of
    /// the gateway, and a number if there is such a file already: a board without a clock of its own begins at the same time
    /// again and again. All files of the folder take no more than `max_bytes` (0: as much as there is).
    ///
    /// # Errors
    /// The system's error about the folder, the file or the thread.
    pub fn begin(folder: &Path, generation: u32, max_bytes: u64) -> std::io::Result<Self> {
        let of_folder = |error: Error| Error::new(error.kind(), format!("{}: {error}", folder.display()));
        make_folder(folder).map_err(of_folder)?;
        let files = Files {
            folder: folder.to_owned(),
            generation,
            max_bytes,
        };
        let (file, path) = files.next().map_err(of_folder)?;
        Self::writing(file, path, files)
    }

    /// Writes to `file`, which is called `path`, and then to further `files`.
    fn writing(file: File, path: PathBuf, files: Files) -> std::io::Result<Self> {
        let (records, incoming) = sync_channel(WAITING_MAX);
        let (name, has_failed) = (path.clone(), Arc::new(AtomicBool::new(false)));
        let failed = Arc::clone(&has_failed);
        let writer = std::thread::Builder::new()
            .name("tlog".to_owned())
            .spawn(move || {
                // Writing to a disk is not urgent, whatever priority the gateway itself has. On failure it keeps that
                // priority.
                let _ = schedule(0, Scheduling::Ordinary);
                if let Err(error) = write_all(file, &files, &incoming) {
                    tracing::error!("{}: the telemetry log ends here: {error}", name.display());
                    failed.store(true, Ordering::Relaxed);
                }
            })?;
        Ok(Self {
            path,
            records: Some(records),
            writer: Some(writer),
            has_failed,
            left_out: 0,
        })
    }

    /// The first file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a frame that was read or written now.
    pub fn add(&mut self, frame: &[u8]) {
        let mut record = TlogRecord {
            unix_us: unix_us(),
            len: frame.len(),
            bytes: [0; FRAME_MAX],
        };
        let fits = record
            .bytes
            .get_mut(..frame.len())
            .map(|bytes| bytes.copy_from_slice(frame));
        let sent = fits.is_some()
            && self
                .records
                .as_ref()
                .is_some_and(|records| records.try_send(record).is_ok());
        self.left_out += u64::from(!sent);
    }

    /// Whether the file ends here: a full disk, or one that is gone.
    pub fn has_failed(&self) -> bool {
        self.has_failed.load(Ordering::Relaxed)
    }

    /// Frames that are not in the file.
    pub fn left_out(&self) -> u64 {
        self.left_out
    }
}

impl Drop for Tlog {
    fn drop(&mut self) {
        self.records = None;
        if let Some(writer) = self.writer.take() {
            // The thread logs its own errors.
            let _ = writer.join();
        }
        if self.left_out > 0 {
            tracing::warn!("{}: {} frames left out", self.path.display(), self.left_out);
        }
    }
}

/// The files of a folder.
struct Files {
    folder: PathBuf,
    generation: u32,
    /// 0: not limited.
    max_bytes: u64,
}

impl Files {
    /// A new one, after the oldest ones have made room for it.
    fn next(&self) -> std::io::Result<(File, PathBuf)> {
        if self.max_bytes > 0 {
            remove_oldest(&self.folder, self.max_bytes - self.max_bytes / FILES)?;
        }
        new_file(&self.folder, unix_us() / 1_000_000, self.generation)
    }

    fn is_full(&self, bytes: u64) -> bool {
        self.max_bytes > 0 && bytes >= self.max_bytes / FILES
    }
}

/// Removes the telemetry logs that were written to longest ago, until the others take no more than `max_bytes`.
fn remove_oldest(folder: &Path, max_bytes: u64) -> std::io::Result<()> {
    let mut logs: Vec<_> = std::fs::read_dir(folder)?
        .flatten()
        .filter(|entry| {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            name.starts_with("jink-") && name.ends_with(".tlog")
        })
        .filter_map(|entry| {
            let metadata = entry.metadata().ok()?;
            Some((metadata.modified().ok()?, metadata.len(), entry.path()))
        })
        .collect();
    logs.sort();
    let mut bytes: u64 = logs.iter().map(|(_, len, _)| len).sum();
    for (_, len, path) in logs {
        if bytes <= max_bytes {
            break;
        }
        std::fs::remove_file(path)?;
        bytes -= len;
    }
    Ok(())
}

/// A file that was not there.
fn new_file(folder: &Path, unix_s: u64, generation: u32) -> std::io::Result<(File, PathBuf)> {
    let mut number = 1;
    loop {
        let suffix = if number == 1 {
            String::new()
        } else {
            format!("-{number}")
        };
        let path = folder.join(format!("jink-{unix_s}-{generation}{suffix}.tlog"));
        match File::create_new(&path) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
            made => return Ok((made?, path)),
        }
    }
}

/// Until the link is closed; whenever nothing waits, all is handed to the system.
fn write_all(file: File, files: &Files, incoming: &Receiver<TlogRecord>) -> std::io::Result<()> {
    let mut file = BufWriter::new(file);
    let mut bytes = 0;
    loop {
        let record = match incoming.try_recv() {
            Ok(record) => record,
            Err(TryRecvError::Disconnected) => return file.flush(),
            Err(TryRecvError::Empty) => {
                file.flush()?;
                match incoming.recv() {
                    Ok(record) => record,
                    Err(_) => return Ok(()),
                }
            }
        };
        if files.is_full(bytes) {
            file.flush()?;
            file = BufWriter::new(files.next()?.0);
            bytes = 0;
        }
        file.write_all(&record.unix_us.to_be_bytes())?;
        file.write_all(&record.bytes[..record.len])?;
        bytes += 8 + record.len as u64;
    }
}

fn unix_us() -> u64 {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
    since_1970.map_or(0, |time| u64::try_from(time.as_micros()).unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::{FRAME_MAX, Files, Tlog, new_file};
    use std::fs::File;

    #[test]
    fn a_second_start_at_the_same_time_begins_a_file_of_its_own() {
        let folder = std::env::temp_dir().join(format!("jink_tlog_again_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let names = [(); 3].map(|()| {
            let (_file, path) = new_file(&folder, 1_700_000_000, 1).unwrap();
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
        let folder = std::env::temp_dir().join(format!("jink_tlog_limit_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("jink-1-1.tlog"), [0; 9000]).unwrap();
        std::fs::write(folder.join("notes.tlog"), "somebody else's").unwrap();
        let files = Files {
            folder: folder.clone(),
            generation: 1,
            max_bytes: 10_000,
        };
        let sizes = || -> Vec<u64> {
            let entries = std::fs::read_dir(&folder).unwrap().flatten();
            let ours = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with("jink-"));
            ours.map(|entry| entry.metadata().unwrap().len()).collect()
        };
        let (send, incoming) = super::sync_channel(1000);
        for second in 0..1000 {
            send.send(super::TlogRecord {
                unix_us: second,
                len: 92,
                bytes: [0xfd; FRAME_MAX],
            })
            .unwrap();
        }
        drop(send);
        super::write_all(files.next().unwrap().0, &files, &incoming).unwrap();
        let left = sizes();
        assert!(left.iter().sum::<u64>() <= 10_000 && left.len() >= 3, "{left:?}");
        assert!(!folder.join("jink-1-1.tlog").exists() && folder.join("notes.tlog").exists());
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_folder_that_is_misspelt_is_refused_and_not_made() {
        let place = std::env::temp_dir().join(format!("jink_tlgo_{}", std::process::id()));
        let refused = Tlog::begin(&place.join("tlog"), 1, 0).unwrap_err().to_string();
        assert!(refused.starts_with(&place.display().to_string()), "{refused}");
        assert!(!place.exists());
    }

    #[test]
    fn a_full_disk_ends_it_and_nothing_else() {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let files = Files {
            folder: "/dev".into(),
            generation: 1,
            max_bytes: 0,
        };
        let mut log = Tlog::writing(full, "/dev/full".into(), files).unwrap();
        let begin = std::time::Instant::now();
        while !log.has_failed() && begin.elapsed().as_secs() < 60 {
            log.add(&[0xfd, 1, 2, 3]);
            std::thread::yield_now();
        }
        assert!(log.has_failed());
    }

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
        assert!(path.file_name().unwrap().to_string_lossy().ends_with("-3.tlog"));
    }
}
