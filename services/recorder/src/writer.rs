//! The thread that writes: what it cannot write in time is left out.

use crate::recording::{About, Channel, Kept, Recording};
use jink_runtime::file_series::{FileSeries, unix_us};
use jink_shared_types::{SampleHeader, Timestamp};
use mcap::{McapError, McapResult};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::os::unix::fs::symlink;
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
/// What may wait for an event (bytes, compressed): two minutes of everything but clouds.
const BLACK_BOX_MAX: usize = 64 << 20;

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
    /// Something has happened for which what came before is kept ([`WriterThread::begin`]).
    pub has_event: bool,
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
        self.has_event = false;
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
    /// Begins with a new file of `series`; `about` is said in each, and a link at `newest` leads to the last one. With `before_event_s`
    /// only that much before an event is written, and as much after it ([`Batch::has_event`]): until then samples wait in memory.
    ///
    /// # Errors
    /// The system's about the thread.
    pub fn begin(
        series: FileSeries,
        about: About,
        newest: PathBuf,
        before_event_s: Option<f64>,
    ) -> std::io::Result<Self> {
        let (batches, incoming) = channel();
        let (emptied, empty) = channel();
        let shared = Arc::new(Shared::default());
        let writer = Files {
            series,
            about,
            newest,
            black_box: before_event_s.map(BlackBox::new),
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

/// Samples of the last seconds, which are written if something happens.
#[derive(Debug)]
struct BlackBox {
    before_s: f64,
    /// Oldest first, their bytes compressed.
    waiting: VecDeque<Batch>,
    waiting_bytes: usize,
    /// Until then all is written.
    open_until: Timestamp,
}

impl BlackBox {
    fn new(before_s: f64) -> Self {
        Self {
            before_s,
            waiting: VecDeque::new(),
            waiting_bytes: 0,
            open_until: Timestamp::NEVER,
        }
    }

    /// Whether what comes at `now` is written.
    fn is_open(&self, now: Timestamp) -> bool {
        self.open_until.is_set() && now <= self.open_until
    }

    /// Takes a copy of a batch, or returns those that are to be written before it because something has happened in it.
    fn take(&mut self, batch: &Batch) -> Vec<Batch> {
        if batch.has_event {
            self.forget(batch.now);
            let waited = match self.is_open(batch.now) {
                true => Vec::new(),
                false => std::mem::take(&mut self.waiting)
                    .into_iter()
                    .filter_map(unpacked)
                    .collect(),
            };
            self.waiting_bytes = 0;
            self.open_until = batch.now.plus_seconds(self.before_s);
            return waited;
        }
        if !self.is_open(batch.now) {
            self.wait(batch);
        }
        Vec::new()
    }

    fn wait(&mut self, batch: &Batch) {
        let bytes = lz4::block::compress(&batch.bytes, None, true).unwrap_or_default();
        let packed = Batch {
            channels: Vec::new(),
            samples: batch.samples.clone(),
            lost: batch.lost.clone(),
            bytes,
            ..*batch
        };
        self.waiting_bytes += packed.len_bytes();
        self.waiting.push_back(packed);
        self.forget(batch.now);
    }

    /// Forgets what is too old, or too much.
    fn forget(&mut self, now: Timestamp) {
        let begin = now.plus_seconds(-self.before_s);
        let is_old = |oldest: &Batch| oldest.now < begin;
        while self.waiting_bytes > BLACK_BOX_MAX || self.waiting.front().is_some_and(is_old) {
            let Some(oldest) = self.waiting.pop_front() else {
                break;
            };
            self.waiting_bytes -= oldest.len_bytes();
        }
    }
}

/// A batch that has waited, as it was.
fn unpacked(mut batch: Batch) -> Option<Batch> {
    batch.bytes = lz4::block::decompress(&batch.bytes, None).ok()?;
    Some(batch)
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
    about: About,
    newest: PathBuf,
    /// `None`: everything is written.
    black_box: Option<BlackBox>,
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
    /// How many of all channels it has.
    channels: usize,
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
        self.close();
    }

    fn close(&mut self) {
        if let Some(open) = self.open.take()
            && let Err(error) = open.recording.finish()
        {
            tracing::error!("{}: has no index: {error}", open.path.display());
        }
    }

    fn take(&mut self, batch: &Batch) {
        self.channels.extend_from_slice(&batch.channels);
        self.missing.resize(self.channels.len(), 0);
        if let Some(mut black_box) = self.black_box.take() {
            let waited = black_box.take(batch);
            let is_open = black_box.is_open(batch.now);
            self.black_box = Some(black_box);
            if !is_open {
                self.close();
                return;
            }
            for before in waited {
                self.keep(&before);
            }
        }
        self.keep(batch);
    }

    /// Writes a batch, or counts what is lost with it.
    fn keep(&mut self, batch: &Batch) {
        let written = match self.retry_at {
            Some(at) if Instant::now() < at => false,
            _ => self
                .write(batch)
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

    fn write(&mut self, batch: &Batch) -> McapResult<()> {
        let is_full = |open: &Open| self.series.is_full(open.bytes.load(Ordering::Relaxed));
        if self.open.as_ref().is_some_and(is_full)
            && let Some(open) = self.open.take()
        {
            open.recording.finish()?;
        }
        let open = match &mut self.open {
            Some(open) => {
                for channel in &self.channels[open.channels..] {
                    open.recording.add(channel)?;
                    open.channels += 1;
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
        // Only for people who ask where it is.
        let _was_none = std::fs::remove_file(&self.newest);
        let _is_not_said = std::path::absolute(&path).and_then(|path| symlink(path, &self.newest));
        Ok(Open {
            recording,
            path,
            bytes,
            channels: self.channels.len(),
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
