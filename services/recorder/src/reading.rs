//! Recordings as they are read again.

use crate::recording::{Channel, ENCODING, LOST};
use jink_shared_types::layout::from_bytes;
use jink_shared_types::{SampleHeader, Timestamp};
use mcap::McapError;
use mcap::io::MessageReader;
use mcap::read::{LinearReader, Options};
use mcap::records::Record;
use mcap::sans_io::LinearReaderOptions;
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// The largest record that a recorder makes, and a chunk before it was compressed: what fits into one, and the largest sample of all on
/// top. What a damaged file says of its sizes is taken from memory before it is looked at.
const RECORD_MAX_BYTES: usize = 64 << 20;
/// Where a file says what it is: header and metadata.
const BEGIN_BYTES: u64 = 1 << 20;

/// Why a recording cannot be read.
#[derive(Debug)]
pub enum ReadError {
    /// The system's about the file.
    File(PathBuf, std::io::Error),
    /// There is nothing in it.
    Empty(PathBuf),
    /// It is no MCAP file.
    Foreign(PathBuf),
    /// It is an MCAP file of another program.
    NotOurs(PathBuf, String),
    /// It is damaged: after so many samples.
    Damaged(PathBuf, u64, McapError),
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path, error) => write!(f, "{}: {error}", path.display()),
            Self::Empty(path) => write!(f, "{}: the file is empty", path.display()),
            Self::Foreign(path) => write!(f, "{}: not an MCAP file", path.display()),
            Self::NotOurs(path, profile) => write!(
                f,
                "{}: an MCAP file, but no recording of jink (its profile is {profile:?})",
                path.display()
            ),
            Self::Damaged(path, samples, error) => {
                write!(f, "{}: damaged after {samples} samples: {error}", path.display())
            }
        }
    }
}
impl std::error::Error for ReadError {}

/// A recording.
#[derive(Debug)]
pub struct Reading {
    path: PathBuf,
    len_bytes: u64,
    is_whole: bool,
    /// The metadata record `jink`; empty if the file was cut off before it.
    pub about: BTreeMap<String, String>,
    /// The attachments: what the instance was started with, as texts.
    pub files: BTreeMap<String, String>,
}

/// One sample of a recording.
#[derive(Clone, Copy, Debug)]
pub struct RecordedSample<'a> {
    /// The topic.
    pub topic: &'a str,
    /// The payload's type with the hash of its layout.
    pub type_name: &'a str,
    /// The layout as JSON; empty where only its producer knows it.
    pub schema: &'a str,
    /// Size of the payload in memory (bytes).
    pub payload_bytes: usize,
    /// Its header.
    pub header: &'a SampleHeader,
    /// Its payload: the unused end of a list is left out.
    pub payload: &'a [u8],
}

impl From<&RecordedSample<'_>> for Channel {
    fn from(sample: &RecordedSample<'_>) -> Self {
        Self {
            topic: sample.topic.to_owned(),
            type_name: sample.type_name.to_owned(),
            payload_bytes: sample.payload_bytes,
            schema: sample.schema.to_owned(),
        }
    }
}

/// One message of a recording.
#[derive(Clone, Copy, Debug)]
pub enum Message<'a> {
    /// A sample.
    Sample(RecordedSample<'a>),
    /// Of this topic so many samples are not in it.
    Lost(&'a str, u64),
}

/// How a recording ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// With its index.
    Whole,
    /// It was cut off: the recorder or the board was.
    CutOff,
}

impl Reading {
    /// Opens `path`.
    ///
    /// # Errors
    /// [`ReadError`] if it is no recording of jink.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let unreadable = |error| ReadError::File(path.to_owned(), error);
        let (begin, end, len_bytes) = ends_of(path).map_err(unreadable)?;
        if len_bytes == 0 {
            return Err(ReadError::Empty(path.to_owned()));
        }
        let (mut about, mut files) = (BTreeMap::new(), BTreeMap::new());
        let records = LinearReader::new_with_options(&begin, Options::IgnoreEndMagic.into());
        let records = records.map_err(|_| ReadError::Foreign(path.to_owned()))?;
        let mut is_mcap = begin.starts_with(mcap::MAGIC);
        for record in records {
            match record {
                Ok(Record::Header(header)) if header.profile == ENCODING => is_mcap = true,
                Ok(Record::Header(header)) => {
                    return Err(ReadError::NotOurs(path.to_owned(), header.profile));
                }
                Ok(Record::Metadata(metadata)) if metadata.name == ENCODING => {
                    about = metadata.metadata;
                }
                Ok(Record::Attachment { header, data, .. }) => {
                    files.insert(header.name, String::from_utf8_lossy(&data).into_owned());
                }
                // Behind those come samples.
                Ok(Record::Schema { .. } | Record::Channel(_) | Record::Chunk { .. }) => break,
                Ok(_) => {}
                Err(_) if !is_mcap => return Err(ReadError::Foreign(path.to_owned())),
                // What follows is read when it is asked for.
                Err(_) => break,
            }
        }
        Ok(Self {
            path: path.to_owned(),
            len_bytes,
            is_whole: end == mcap::MAGIC && len_bytes > 2 * mcap::MAGIC.len() as u64,
            about,
            files,
        })
    }

    /// Its size (bytes).
    pub fn len_bytes(&self) -> u64 {
        self.len_bytes
    }

    /// The moment that a file calls `unix_ns`, on the board's clock of then.
    pub fn on_boards_clock(&self, unix_ns: u64) -> Option<Timestamp> {
        let number = |key: &str| self.about.get(key)?.parse::<u64>().ok();
        let ahead_ns = number("unix_ns")?.checked_sub(number("monotonic_ns")?)?;
        Some(Timestamp::from_ns(unix_ns.checked_sub(ahead_ns)?))
    }

    /// Hands every message to `visit`, in the order of the file, until it says `false`.
    ///
    /// # Errors
    /// [`ReadError::Damaged`]; what came before has been visited.
    pub fn each(&self, mut visit: impl FnMut(&Message<'_>) -> bool) -> Result<Ends, ReadError> {
        let damaged = |seen: usize, error| ReadError::Damaged(self.path.clone(), seen as u64, error);
        let file = File::open(&self.path).map_err(|error| ReadError::File(self.path.clone(), error))?;
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(RECORD_MAX_BYTES);
        let messages = MessageReader::new_with_options(BufReader::new(file), options);
        for (seen, message) in messages.enumerate() {
            let message = match message {
                Ok(message) => message,
                Err(McapError::UnexpectedEof | McapError::UnexpectedEoc) => return Ok(Ends::CutOff),
                Err(error) => return Err(damaged(seen, error)),
            };
            let goes_on = if message.channel.topic == LOST {
                let lost: serde_json::Value = serde_json::from_slice(&message.data).unwrap_or_default();
                let count = lost["samples"].as_u64().unwrap_or(0);
                visit(&Message::Lost(lost["topic"].as_str().unwrap_or_default(), count))
            } else {
                let (header, payload) = message
                    .data
                    .split_at(message.data.len().min(size_of::<SampleHeader>()));
                let schema = message.channel.schema.as_ref();
                let payload_bytes = message.channel.metadata.get("payload_bytes");
                visit(&Message::Sample(RecordedSample {
                    topic: &message.channel.topic,
                    type_name: schema.map_or("", |schema| &schema.name),
                    schema: schema.map_or("", |schema| std::str::from_utf8(&schema.data).unwrap_or_default()),
                    payload_bytes: payload_bytes.and_then(|bytes| bytes.parse().ok()).unwrap_or(0),
                    header: &from_bytes(header),
                    payload,
                }))
            };
            if !goes_on {
                break;
            }
        }
        Ok(if self.is_whole { Ends::Whole } else { Ends::CutOff })
    }
}

/// How a file begins and ends, and how long it is (bytes).
fn ends_of(path: &Path) -> std::io::Result<(Vec<u8>, Vec<u8>, u64)> {
    let mut file = File::open(path)?;
    let len = file.metadata()?.len();
    let (mut begin, mut end) = (Vec::new(), Vec::new());
    file.by_ref().take(BEGIN_BYTES).read_to_end(&mut begin)?;
    file.seek(SeekFrom::Start(len.saturating_sub(mcap::MAGIC.len() as u64)))?;
    file.read_to_end(&mut end)?;
    Ok((begin, end, len))
}
