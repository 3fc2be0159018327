//! The thread that writes: what it cannot write in time is left out.

use crate::recording::{Channel, Kept, Recording};
use jink_runtime::file_series::{FileSeries, unix_us};
use jink_shared_types::{SampleHeader, Timestamp};
use mcap::{McapError, McapResult};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often all that is there is handed to the system: what a reader of a file that is cut off misses at most.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);
/// After a file that could not be written another one is tried so much later.
const RETRY_AFTER: Duration = Duration::from_secs(10);
/// Bytes that may wait for a slow disk: two seconds of a lidar, its map and everything else.
const WAITING_MAX: usize = 48 << 20;

/// Samples on their way to the file.
#[derive(Debug, Default)]
pub struct Batch {
    /// Channels that are new.
    pub channels: Vec<Channel>,
    /// Channel, header, and where the payload is in `bytes`.
    samples: Vec<(usize, SampleHeader, std::ops::Range<usize>)>,
    /// Channel and how many of its samples are not there.
    lost: Vec<(usize, u64)>,
    bytes: Vec<u8>,
    now: Timestamp,
}

impl Batch {
    /// Adds a copy of a sample.
    pub fn push(&mut self, channel: usize, header: &SampleHeader, payload: &[u8]) {
        let begin = self.bytes.len();
        self.bytes.extend_from_slice(payload);
        self.samples.push((channel, *header, begin..self.bytes.len()));
    }

    /// Notes that samples of a channel are not there.
    pub fn push_lost(&mut self, channel: usize, count: u64) {
        self.lost.push((channel, count));
    }

    /// Whether there is nothing in it.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty() && self.lost.is_empty() && self.channels.is_empty()
    }

    /// How many samples of each channel are in it.
    pub fn counts(&self) -> impl Iterator<Item = usize> {
        self.samples.iter().map(|(channel, ..)| *channel)
    }

    /// Bytes of its samples.
    pub fn len_bytes(&self) -> usize {
        self.bytes.len() + self.samples.len() * size_of::<SampleHeader>()
    }

    /// Puts its samples in the order in which they were published.
    pub fn sort(&mut self, now: Timestamp) {
        self.now = now;
        self.samples.sort_by_key(|(_, header, _)| header.publish);
    }

    fn clear(&mut self) {
        self.channels.clear();
        self.samples.clear();
        self.lost.clear();
        self.bytes.clear();
    }
}

/// What both sides look at.
#[derive(Debug, Default)]
struct Shared {
    waiting_bytes: AtomicUsize,
    has_failed: AtomicBool,
}

/// The side of the service.
#[derive(Debug)]
pub struct WriterThread {
    batches: Option<Sender<Batch>>,
    /// Batches that have been written, to be filled again.
    empty: Receiver<Batch>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl WriterThread {
    /// Begins with a new file of `series`; `about` is said in each.
    ///
    /// # Errors
    /// The system's about the thread.
    pub fn begin(series: FileSeries, about: BTreeMap<String, String>) -> std::io::Result<Self> {
        let (batches, incoming) = channel();
        let (emptied, empty) = channel();
        let shared = Arc::new(Shared::default());
        let writer = Files {
            series,
            about,
            channels: Vec::new(),
            open: None,
            retry_at: None,
            missing: Vec::new(),
            shared: Arc::clone(&shared),
        };
        let thread = std::thread::Builder::new()
            .name("recording".to_owned())
            .spawn(move || writer.run(&incoming, &emptied))?;
        Ok(Self {
            batches: Some(batches),
            empty,
            shared,
            thread: Some(thread),
        })
    }

    /// An empty batch.
    pub fn batch(&self) -> Batch {
        self.empty.try_recv().unwrap_or_default()
    }

    /// Hands a batch over, or back if the disk is too slow for it. New channels always find a place.
    pub fn send(&self, batch: Batch) -> Result<(), Batch> {
        let waiting = self.shared.waiting_bytes.load(Ordering::Relaxed);
        if waiting + batch.len_bytes() > WAITING_MAX && batch.channels.is_empty() {
            return Err(batch);
        }
        self.shared
            .waiting_bytes
            .fetch_add(batch.len_bytes(), Ordering::Relaxed);
        match &self.batches {
            Some(batches) => batches.send(batch).map_err(|refused| refused.0),
            None => Err(batch),
        }
    }

    /// Whether nothing is written at present.
    pub fn has_failed(&self) -> bool {
        self.shared.has_failed.load(Ordering::Relaxed)
    }
}

impl Drop for WriterThread {
    fn drop(&mut self) {
        self.batches = None;
        if let Some(thread) = self.thread.take() {
            // It logs its own errors.
            let _joined = thread.join();
        }
    }
}

/// A file that counts what is written.
struct Counted {
    file: BufWriter<File>,
    bytes: Arc<AtomicU64>,
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.bytes.fetch_add(written as u64, Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Counted {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}

/// The side of the thread.
struct Files {
    series: FileSeries,
    about: BTreeMap<String, String>,
    /// All channels so far: each file has them.
    channels: Vec<Channel>,
    open: Option<Open>,
    /// When another file is tried.
    retry_at: Option<Instant>,
    /// Samples of each channel that no file has.
    missing: Vec<u64>,
    shared: Arc<Shared>,
}

struct Open {
    recording: Recording<Counted>,
    path: PathBuf,
    bytes: Arc<AtomicU64>,
    flushed: Instant,
}

impl Files {
    fn run(mut self, incoming: &Receiver<Batch>, emptied: &Sender<Batch>) {
        // Of this thread alone. Whoever may not be polite writes all the same.
        let _refused = rustix::process::setpriority_process(None, 19);
        loop {
            match incoming.recv_timeout(FLUSH_PERIOD) {
                Ok(mut batch) => {
                    let bytes = batch.len_bytes();
                    self.take(&batch);
                    batch.clear();
                    self.shared.waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
                    // The service may be ending.
                    let _nobody_fills_it = emptied.send(batch);
                }
                Err(RecvTimeoutError::Timeout) => self.flush(),
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        if let Some(open) = self.open.take()
            && let Err(error) = open.recording.finish()
        {
            tracing::error!("{}: has no index: {error}", open.path.display());
        }
    }

    fn take(&mut self, batch: &Batch) {
        let known = self.channels.len();
        self.channels.extend_from_slice(&batch.channels);
        self.missing.resize(self.channels.len(), 0);
        let written = match self.retry_at {
            Some(at) if Instant::now() < at => false,
            _ => self
                .write(batch, known)
                .map_or_else(|error| self.fail(&error), |()| true),
        };
        if !written {
            let lost = batch.lost.iter().copied();
            for (channel, count) in batch.counts().map(|channel| (channel, 1)).chain(lost) {
                if let Some(missing) = self.missing.get_mut(channel) {
                    *missing += count;
                }
            }
        }
    }

    fn write(&mut self, batch: &Batch, known: usize) -> McapResult<()> {
        let is_full = |open: &Open| self.series.is_full(open.bytes.load(Ordering::Relaxed));
        if self.open.as_ref().is_some_and(is_full)
            && let Some(open) = self.open.take()
        {
            open.recording.finish()?;
        }
        let open = match &mut self.open {
            Some(open) => {
                for channel in &self.channels[known..] {
                    open.recording.add(channel)?;
                }
                open
            }
            None => {
                let open = self.begin(batch.now)?;
                self.retry_at = None;
                self.shared.has_failed.store(false, Ordering::Relaxed);
                self.open.insert(open)
            }
        };
        let missing = self.missing.iter_mut().map(std::mem::take).enumerate();
        for (channel, count) in missing.chain(batch.lost.iter().copied()) {
            if let Some(channel) = self.channels.get(channel).filter(|_| count > 0) {
                open.recording.write_lost(batch.now, &channel.topic, count)?;
            }
        }
        for (channel, header, range) in &batch.samples {
            open.recording.write(&Kept {
                channel: *channel,
                header,
                payload: batch.bytes.get(range.clone()).unwrap_or_default(),
            })?;
        }
        if open.flushed.elapsed() >= FLUSH_PERIOD {
            open.recording.flush()?;
            open.flushed = Instant::now();
        }
        Ok(())
    }

    fn begin(&self, now: Timestamp) -> McapResult<Open> {
        let (file, path) = self.series.next()?;
        let bytes = Arc::new(AtomicU64::new(0));
        let file = Counted {
            file: BufWriter::new(file),
            bytes: Arc::clone(&bytes),
        };
        let mut recording = Recording::begin(file, now, unix_us() * 1000, &self.about)?;
        for channel in &self.channels {
            recording.add(channel)?;
        }
        tracing::info!("records into {}", path.display());
        Ok(Open {
            recording,
            path,
            bytes,
            flushed: Instant::now(),
        })
    }

    fn flush(&mut self) {
        if let Some(open) = &mut self.open
            && let Err(error) = open.recording.flush()
        {
            self.fail(&error);
        }
    }

    /// A file that cannot be written ends, and another one is tried later. Returns that nothing was written.
    fn fail(&mut self, error: &McapError) -> bool {
        let path = self.open.take().map(|open| format!("{}: ", open.path.display()));
        tracing::error!("{}nothing is recorded: {error}", path.unwrap_or_default());
        self.retry_at = Some(Instant::now() + RETRY_AFTER);
        self.shared.has_failed.store(true, Ordering::Relaxed);
        false
    }
}
