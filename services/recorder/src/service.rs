//! The recorder as a process: looks at every topic fifty times a second.

use crate::layouts::Layout;
use crate::recording::Channel;
use crate::schema::{self, Schema};
use crate::writer::{Batch, WriterThread};
use jink_runtime::config::Foreign;
use jink_runtime::file_series::FileSeries;
use jink_runtime::members::Members;
use jink_runtime::session::RawInput;
use jink_runtime::{Cycle, Ports, Service, Session, StartError, Wake};
use jink_shared_types::Timestamp;
use jink_shared_types::events::{EventSample, RECORDING_AGAIN, RECORDING_STOPPED};
use jink_shared_types::topics::{FINGERPRINT, RANGE_CLOUD, TABLE, TopicRow};
use std::collections::BTreeMap;

/// How often topics are looked at (Hz): the fastest one, of 250 samples a second, holds eight.
const LOOK_HZ: u32 = 50;
/// How often topics are tried that nobody has opened yet (s).
const OPEN_PERIOD_S: f64 = 0.5;
/// How often samples that are not there are said (s).
const LOST_PERIOD_S: f64 = 1.0;
/// Bytes that are handed over at once: fewer are kept for the next look, so that the thread is not woken for each.
const HANDED_BYTES: usize = 256 << 10;
/// The longest that they are kept (s).
const HANDED_AFTER_S: f64 = 0.2;

/// The service: see [`crate`].
pub struct RecorderService {
    writer: WriterThread,
    session: Session,
    /// Topics that nobody has opened yet.
    unopened: Vec<(TopicRow, String)>,
    open_due: Timestamp,
    inputs: Vec<Recorded>,
    batch: Batch,
    handed: Timestamp,
    lost_due: Timestamp,
    has_failed: bool,
}

impl std::fmt::Debug for RecorderService {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "RecorderService({} topics)", self.inputs.len())
    }
}

/// A topic that is recorded.
struct Recorded {
    input: RawInput,
    layout: Layout,
    /// Every producer counts for itself.
    is_shared: bool,
    /// Sequence number of the last sample.
    last: Option<u64>,
    /// Samples that were overwritten before they could be read, or for which the disk was too slow, and that have not been said.
    lost: u64,
}

impl Recorded {
    fn count(&mut self, sequence: u64) {
        if let Some(last) = self.last.replace(sequence)
            && sequence >> 32 == last >> 32
            && !self.is_shared
        {
            self.lost += sequence.saturating_sub(last).saturating_sub(1);
        }
    }
}

impl Service for RecorderService {
    const PROGRAM: &'static str = "recorder";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let setup = ports.setup();
        let needs = |what: &str, cause: String| StartError::Needs {
            what: what.to_owned(),
            cause,
        };
        let recorder = &ports.config().recorder;
        let Some(folder) = &recorder.folder else {
            return Err(needs("a folder", "[recorder] of jink.toml names none".to_owned()));
        };
        let max_bytes = u64::from(recorder.max_mb) * 1_000_000;
        let series = FileSeries::new(folder, "mcap", setup.generation, max_bytes);
        let foreign = Foreign::load(&setup.config)?;
        let members = Members::of_config(&setup.config);
        let unopened = TABLE
            .iter()
            .filter(|row| row.logged)
            .flat_map(|row| members.topics(row).into_iter().map(|name| (*row, name)))
            .filter(|(row, _)| recorder.clouds || row.name != RANGE_CLOUD.row.name)
            .chain(foreign.topics.iter().map(|row| (*row, row.name.to_owned())))
            .collect();
        let session = Session::open(&setup.instance, Self::PROGRAM)?.with(&foreign);
        let about = BTreeMap::from([
            ("instance".to_owned(), setup.instance.to_string()),
            ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            ("topics".to_owned(), format!("{FINGERPRINT:016x}")),
        ]);
        let writer = WriterThread::begin(series, about)
            .map_err(|error| needs("a thread that writes", error.to_string()))?;
        Ok(Self {
            batch: writer.batch(),
            writer,
            session,
            unopened,
            open_due: Timestamp::NEVER,
            inputs: Vec::new(),
            handed: Timestamp::NEVER,
            lost_due: Timestamp::NEVER,
            has_failed: false,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        if now >= self.open_due && !self.unopened.is_empty() {
            self.open_due = now.plus_seconds(OPEN_PERIOD_S);
            self.open_topics();
        }
        for (channel, recorded) in self.inputs.iter_mut().enumerate() {
            let mut sequences = [0u64; 64];
            let mut count = 0;
            let (layout, batch) = (recorded.layout, &mut self.batch);
            recorded.input.each(|header, payload| {
                batch.push(channel, header, &payload[..layout.used_bytes(payload)]);
                if let Some(place) = sequences.get_mut(count) {
                    *place = header.sequence;
                    count += 1;
                }
            });
            for sequence in &sequences[..count] {
                recorded.count(*sequence);
            }
        }
        if now >= self.lost_due {
            self.lost_due = now.plus_seconds(LOST_PERIOD_S);
            for (channel, recorded) in self.inputs.iter_mut().enumerate() {
                let lost = std::mem::take(&mut recorded.lost);
                if lost > 0 {
                    self.batch.push_lost(channel, lost);
                }
            }
        }
        let is_due =
            self.batch.len_bytes() >= HANDED_BYTES || now >= self.handed.plus_seconds(HANDED_AFTER_S);
        if is_due && !self.batch.is_empty() {
            self.hand_over(now);
        }
        if self.writer.has_failed() != self.has_failed {
            self.has_failed = !self.has_failed;
            let event = match self.has_failed {
                true => &RECORDING_STOPPED,
                false => &RECORDING_AGAIN,
            };
            cycle.events.publish(now, &EventSample::new(event, "", [0.0; 2]));
        }
        Wake::at(now.next_beat(LOOK_HZ))
    }
}

impl RecorderService {
    fn open_topics(&mut self) {
        let (session, inputs, batch) = (&self.session, &mut self.inputs, &mut self.batch);
        self.unopened
            .retain(|(row, name)| match session.raw_input(row, name) {
                Ok(None) => true,
                Ok(Some(input)) => {
                    batch.channels.push(channel(row, name, &input));
                    inputs.push(Recorded {
                        layout: Layout::of(row),
                        is_shared: row.is_shared(),
                        last: None,
                        lost: 0,
                        input,
                    });
                    false
                }
                Err(error) => {
                    tracing::warn!("{name} is not recorded: {error}");
                    false
                }
            });
    }

    fn hand_over(&mut self, now: Timestamp) {
        self.handed = now;
        let mut batch = std::mem::replace(&mut self.batch, self.writer.batch());
        batch.sort(now);
        if let Err(refused) = self.writer.send(batch) {
            for channel in refused.counts() {
                self.inputs[channel].lost += 1;
            }
        }
    }
}

fn channel(row: &TopicRow, name: &str, input: &RawInput) -> Channel {
    let is_ours = TABLE.iter().any(|known| known.name == row.name);
    let schema = match is_ours {
        true => {
            Schema::of(&[row.payload.to_owned()]).map_or_else(|_| String::new(), |known| schema::json(&known))
        }
        false => String::new(),
    };
    Channel {
        topic: name.to_owned(),
        type_name: input.type_name().to_owned(),
        payload_bytes: input.size(),
        schema,
    }
}
