//! Looks at every topic fifty times a second, and hands what it finds to the thread that writes.

use crate::layouts::Layout;
use crate::recording::{About, Channel, PARAMETERS_FILE};
use crate::schema::{self, Schema};
use crate::writer::{Batch, WriterThread};
use jink_runtime::config::{CONFIG_FILE, Foreign, PROCESS_FILE};
use jink_runtime::file_series::FileSeries;
use jink_runtime::members::Members;
use jink_runtime::session::{HeldTopic, RawInput};
use jink_runtime::{Cycle, OpenError, Ports, Session, StartError};
use jink_shared_types::Timestamp;
use jink_shared_types::events::{EventSample, HELD, RECORDING_AGAIN, RECORDING_STOPPED, Severity};
use jink_shared_types::layout::{Layout as SampleLayout, from_bytes};
use jink_shared_types::topics::{self, EVENT, FINGERPRINT, RANGE_CLOUD, TABLE, Topic, TopicRow, Visitor};
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::path::{Path, PathBuf};

/// How often topics are tried that nobody has opened yet (s).
const OPEN_PERIOD_S: f64 = 0.5;
/// How often it is looked whether a person asks for what came before (s).
const ASKED_PERIOD_S: f64 = 0.5;
/// How often samples that are not there are said (s).
const LOST_PERIOD_S: f64 = 1.0;
/// Bytes that are handed over at once: fewer are kept for the next look, so that the thread is not woken for each.
const HANDED_BYTES: usize = 256 << 10;
/// The longest that they are kept (s).
const HANDED_AFTER_S: f64 = 0.2;

/// What is recorded of the topics.
pub struct TopicRecorder {
    writer: WriterThread,
    session: Session,
    /// Topics that nobody has opened yet.
    unopened: Vec<(TopicRow, String)>,
    open_due: Timestamp,
    inputs: Vec<Recorded>,
    batch: Batch,
    handed: Timestamp,
    lost_due: Timestamp,
    /// The file by which a person asks that what came before is kept, and when it is looked for.
    asked: PathBuf,
    asked_due: Timestamp,
    has_failed: bool,
}

impl Debug for TopicRecorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "TopicRecorder({} topics)", self.inputs.len())
    }
}

/// A topic that is recorded.
struct Recorded {
    input: RawInput,
    layout: Layout,
    /// Every producer counts for itself.
    is_shared: bool,
    is_events: bool,
    /// Sequence number of the last sample of each epoch: of a topic that an instance and its shadow both publish they come in turn.
    last: BTreeMap<u32, u64>,
    /// Samples that were overwritten before they could be read, or for which the disk was too slow, and that have not been said.
    lost: u64,
}

impl Recorded {
    fn count(&mut self, sequence: u64) {
        if let Some(last) = self.last.insert((sequence >> 32) as u32, sequence)
            && !self.is_shared
        {
            self.lost += sequence.saturating_sub(last).saturating_sub(1);
        }
    }
}

impl TopicRecorder {
    /// Records into files in `folder` for `program`.
    ///
    /// # Errors
    /// A configuration that cannot be read, or no thread.
    pub fn begin(ports: &Ports, folder: &Path, program: &str) -> Result<Self, StartError> {
        let (setup, recorder) = (ports.setup(), &ports.config().recorder);
        let max_bytes = u64::from(recorder.max_mb) * 1_000_000;
        let series = FileSeries::new(folder, "mcap", setup.generation, max_bytes);
        let foreign = Foreign::load(&setup.config)?;
        let members = Members::of_config(&setup.config);
        // First what the supervisor says before anybody else has started: everybody takes it at his start.
        let of_supervisor = |row: &&TopicRow| row.producers == ["supervisor"];
        let (first, then): (Vec<&TopicRow>, Vec<&TopicRow>) = TABLE.iter().partition(of_supervisor);
        let unopened = first
            .into_iter()
            .chain(then)
            .filter(|row| row.logged)
            .flat_map(|row| members.topics(row).into_iter().map(|name| (*row, name)))
            .filter(|(row, _)| recorder.clouds || row.name != RANGE_CLOUD.row.name)
            .chain(foreign.topics.iter().map(|row| (*row, row.name.to_owned())))
            .collect();
        let session = Session::open(&setup.instance, program)?.with(&foreign);
        let started_with = [
            (CONFIG_FILE, setup.config.join(CONFIG_FILE)),
            (PROCESS_FILE, setup.config.join(PROCESS_FILE)),
            (PARAMETERS_FILE, setup.instance.params_at_start()),
        ];
        let about = About {
            facts: BTreeMap::from([
                ("instance".to_owned(), setup.instance.to_string()),
                ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
                ("topics".to_owned(), format!("{FINGERPRINT:016x}")),
            ]),
            files: started_with
                .into_iter()
                .filter_map(|(name, path)| Some((name.to_owned(), std::fs::read_to_string(path).ok()?)))
                .collect(),
        };
        let writer = WriterThread::begin(series, about, setup.instance.recording(), recorder.before_event_s)
            .map_err(|error| StartError::Needs {
                what: "a thread that writes".to_owned(),
                cause: error.to_string(),
            })?;
        Ok(Self {
            batch: writer.batch(),
            writer,
            session,
            unopened,
            open_due: Timestamp::NEVER,
            inputs: Vec::new(),
            handed: Timestamp::NEVER,
            lost_due: Timestamp::NEVER,
            asked: setup.instance.recording_asked(),
            asked_due: Timestamp::NEVER,
            has_failed: false,
        })
    }

    /// Takes what has been published since the last time.
    pub fn look(&mut self, cycle: &mut Cycle<'_>) {
        let now = cycle.now;
        if now >= self.open_due && !self.unopened.is_empty() {
            self.open_due = now.plus_seconds(OPEN_PERIOD_S);
            self.open_topics();
        }
        for (channel, recorded) in self.inputs.iter_mut().enumerate() {
            let mut sequences = [0u64; 64];
            let mut count = 0;
            let (layout, batch, is_events) = (recorded.layout, &mut self.batch, recorded.is_events);
            recorded.input.each(|header, payload| {
                batch.has_event |= is_events && is_grave(payload);
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
        if now >= self.asked_due {
            self.asked_due = now.plus_seconds(ASKED_PERIOD_S);
            self.batch.has_event |= std::fs::remove_file(&self.asked).is_ok();
        }
        if now >= self.lost_due {
            self.lost_due = now.plus_seconds(LOST_PERIOD_S);
            self.say_lost();
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
    }

    /// Says what is missing since the last time.
    fn say_lost(&mut self) {
        for (channel, recorded) in self.inputs.iter_mut().enumerate() {
            let lost = std::mem::take(&mut recorded.lost);
            if lost > 0 {
                self.batch.push_lost(channel, lost);
            }
        }
    }

    fn open_topics(&mut self) {
        let (session, inputs, batch) = (&self.session, &mut self.inputs, &mut self.batch);
        self.unopened
            .retain(|(row, name)| match open(session, row, name) {
                Ok(None) => true,
                Ok(Some(input)) => {
                    batch.channels.push(channel(row, name, &input));
                    inputs.push(Recorded {
                        layout: Layout::of(row),
                        is_shared: row.is_shared(),
                        is_events: row.name == EVENT.row.name,
                        last: BTreeMap::new(),
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

/// Opens a topic, and makes it if it is one of the table: the first sample on it is recorded, too.
fn open(session: &Session, row: &TopicRow, name: &str) -> Result<Option<RawInput>, OpenError> {
    let _made = topics::visit(row, Make { session, name }).transpose()?;
    session.raw_input(row, name)
}

struct Make<'a> {
    session: &'a Session,
    name: &'a str,
}

impl Visitor for Make<'_> {
    type Output = Result<HeldTopic, OpenError>;
    fn visit<T: SampleLayout + Debug + 'static>(self, topic: Topic<T>) -> Self::Output {
        let member = topic.row.member_of(self.name).unwrap_or_default();
        self.session.hold(topic, member)
    }
}

impl Drop for TopicRecorder {
    /// What was taken last, and what is missing of it, is in the file, too.
    fn drop(&mut self) {
        self.say_lost();
        if !self.batch.is_empty() {
            self.hand_over(jink_runtime::now());
        }
    }
}

/// Whether an event is one for which what came before it is kept: something is wrong, or the vehicle was made to hold.
fn is_grave(event: &[u8]) -> bool {
    let event = from_bytes::<EventSample>(event);
    event.severity.get() as u8 <= Severity::Warning as u8 || event.id == HELD.id
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
