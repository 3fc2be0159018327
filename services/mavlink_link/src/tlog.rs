//! Everything on the link in a file that ground stations and `mavlogdump.py` read: for each frame eight bytes of time,
//! big-endian microseconds since 1970, and the frame as it was on the wire.
//!
//! A thread writes; the link hands it copies and never waits. What the disk is too slow for is left out, and counted.

use jink_runtime::file_series::{FileSeries, unix_us};
use jink_runtime::realtime::{Scheduling, schedule};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;

/// The longest frame: MAVLink 2 with a signature and a wide system id.
const FRAME_MAX: usize = 300;
/// Frames that may wait for the disk: some five seconds of a busy link.
const WAITING_MAX: usize = 2048;

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
    /// Begins a new file in `folder`; see [`FileSeries`].
    ///
    /// # Errors
    /// The system's error about the folder, the file or the thread.
    pub fn begin(folder: &Path, generation: u32, max_bytes: u64) -> std::io::Result<Self> {
        let files = FileSeries::new(folder, "tlog", generation, max_bytes);
        let (file, path) = files.next()?;
        Self::writing(file, path, files)
    }

    /// Writes to `file`, which is called `path`, and then to further `files`.
    fn writing(file: File, path: PathBuf, files: FileSeries) -> std::io::Result<Self> {
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

/// Until the link is closed; whenever nothing waits, all is handed to the system.
fn write_all(file: File, files: &FileSeries, incoming: &Receiver<TlogRecord>) -> std::io::Result<()> {
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

#[cfg(test)]
mod tests {
    use super::{FRAME_MAX, FileSeries, Tlog};
    use std::fs::File;

    #[test]
    fn a_full_disk_ends_it_and_nothing_else() {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let files = FileSeries::new("/dev".as_ref(), "tlog", 1, 0);
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
