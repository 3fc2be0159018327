//! One file of a recording.

use jink_shared_types::layout::bytes_of;
use jink_shared_types::{SampleHeader, Timestamp};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, McapResult, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::io::{Seek, Write};

/// The channel that says what is not there: JSON with the topic and how many of its samples.
pub const LOST: &str = "recorder/lost";
/// The attachment that holds the parameters as they were when the instance came up.
pub const PARAMETERS_FILE: &str = "parameters_at_start.toml";
/// Bytes of a chunk before it is compressed: what is lost at most when the board loses its power, and what a reader has to look at for
/// one message.
const CHUNK_BYTES: u64 = 1 << 20;
/// Profile of the file, name of its metadata record, and encoding of schemas and messages: samples as they are in memory.
pub(crate) const ENCODING: &str = "jink";

/// A topic that is recorded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Channel {
    /// Its name.
    pub topic: String,
    /// Its payload with the hash of the layout, as iceoryx2 knows it.
    pub type_name: String,
    /// Size of its payload in memory (bytes).
    pub payload_bytes: usize,
    /// Its layout as JSON; empty where only its producer knows it.
    pub schema: String,
}

/// What is said in each file besides its samples.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct About {
    /// The metadata record `jink`.
    pub facts: BTreeMap<String, String>,
    /// Attachments: texts with their names.
    pub files: BTreeMap<String, String>,
}

/// One sample.
#[derive(Clone, Copy, Debug)]
pub struct Kept<'a> {
    /// Which channel it is of, counted from 0 in the order in which they were added.
    pub channel: usize,
    /// Its header.
    pub header: &'a SampleHeader,
    /// What is in use of its payload.
    pub payload: &'a [u8],
}

/// A file that is being written.
pub struct Recording<W: Write + Seek> {
    writer: Writer<W>,
    channels: Vec<u16>,
    lost: u16,
    lost_messages: u32,
    /// Time of the day minus the board's clock (ns).
    ahead_ns: i128,
    message: Vec<u8>,
}

impl<W: Write + Seek> std::fmt::Debug for Recording<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Recording({} channels)", self.channels.len())
    }
}

impl<W: Write + Seek> Recording<W> {
    /// Begins a file: at `now` of the board's clock it is `unix_ns` of the day.
    ///
    /// # Errors
    /// What the system says of the file.
    pub fn begin(file: W, now: Timestamp, unix_ns: u64, about: &About) -> McapResult<Self> {
        let mut writer = WriteOptions::new()
            .profile(ENCODING)
            .library(concat!("jink ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(CHUNK_BYTES))
            // It would be that of the whole file, which may have any length.
            .calculate_data_section_crc(false)
            .create(file)?;
        let mut metadata = about.facts.clone();
        metadata.insert("monotonic_ns".to_owned(), now.ns.to_string());
        metadata.insert("unix_ns".to_owned(), unix_ns.to_string());
        writer.write_metadata(&Metadata {
            name: ENCODING.to_owned(),
            metadata,
        })?;
        for (name, text) in &about.files {
            writer.attach(&Attachment {
                log_time: unix_ns,
                create_time: unix_ns,
                name: name.clone(),
                media_type: "text/plain".to_owned(),
                data: text.as_bytes().into(),
            })?;
        }
        let schema = writer.add_schema(LOST, "jsonschema", LOST_SCHEMA.as_bytes())?;
        let lost = writer.add_channel(schema, LOST, "json", &BTreeMap::new())?;
        Ok(Self {
            writer,
            channels: Vec::new(),
            lost,
            lost_messages: 0,
            ahead_ns: i128::from(unix_ns) - i128::from(now.ns),
            message: Vec::new(),
        })
    }

    /// Adds the next channel.
    ///
    /// # Errors
    /// What the system says of the file.
    pub fn add(&mut self, channel: &Channel) -> McapResult<()> {
        let schema = &channel.schema;
        let schema = self
            .writer
            .add_schema(&channel.type_name, ENCODING, schema.as_bytes())?;
        let metadata = BTreeMap::from([("payload_bytes".to_owned(), channel.payload_bytes.to_string())]);
        let id = self
            .writer
            .add_channel(schema, &channel.topic, ENCODING, &metadata)?;
        self.channels.push(id);
        Ok(())
    }

    /// Writes a sample.
    ///
    /// # Errors
    /// What the system says of the file, or that the channel has not been added.
    pub fn write(&mut self, kept: &Kept<'_>) -> McapResult<()> {
        self.message.clear();
        self.message.extend_from_slice(bytes_of(kept.header));
        self.message.extend_from_slice(kept.payload);
        let header = MessageHeader {
            channel_id: self.channels.get(kept.channel).copied().unwrap_or(u16::MAX),
            // Its low half counts the samples of one start of a producer.
            sequence: kept.header.sequence as u32,
            log_time: self.unix_ns(kept.header.publish),
            publish_time: self.unix_ns(kept.header.capture),
        };
        self.writer.write_to_known_channel(&header, &self.message)
    }

    /// Says that `count` samples of `topic` are not in it, at `now`.
    ///
    /// # Errors
    /// What the system says of the file.
    pub fn write_lost(&mut self, now: Timestamp, topic: &str, count: u64) -> McapResult<()> {
        let time = self.unix_ns(now);
        let header = MessageHeader {
            channel_id: self.lost,
            sequence: self.lost_messages,
            log_time: time,
            publish_time: time,
        };
        self.lost_messages = self.lost_messages.wrapping_add(1);
        let text = serde_json::json!({ "topic": topic, "samples": count }).to_string();
        self.writer.write_to_known_channel(&header, text.as_bytes())
    }

    /// Hands everything so far to the system: a reader opens the file up to here, whatever comes.
    ///
    /// # Errors
    /// What the system says of the file.
    pub fn flush(&mut self) -> McapResult<()> {
        self.writer.flush()
    }

    /// Ends the file with its index.
    ///
    /// # Errors
    /// What the system says of the file.
    pub fn finish(mut self) -> McapResult<()> {
        self.writer.finish().map(|_summary| ())
    }

    fn unix_ns(&self, time: Timestamp) -> u64 {
        let ns = if time.is_set() {
            i128::from(time.ns) + self.ahead_ns
        } else {
            0
        };
        u64::try_from(ns).unwrap_or(0)
    }
}

const LOST_SCHEMA: &str = r#"{
  "type": "object",
  "title": "recorder/lost",
  "description": "Samples that the recorder could not keep",
  "properties": {
    "topic": { "type": "string" },
    "samples": { "type": "integer", "description": "how many, since the last message about this topic" }
  }
}"#;
