//! What a recording holds, as people and scripts see it.

use crate::view::sample_json;
use jink_recorder::reading::{Ends, Message, Reading, RecordedSample};
use jink_shared_types::layout::{Layout, from_bytes, type_name};
use jink_shared_types::topics::{self, TABLE, Topic, Visitor};
use jink_shared_types::{SampleHeader, Timestamp};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Debug;

/// Longest list that becomes columns.
const LIST_MAX: usize = 16;

/// What there is of one topic.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OfTopic {
    /// Samples.
    pub samples: u64,
    /// Samples that are missing.
    pub lost: u64,
    /// What the samples took in memory (bytes), but for the unused ends of lists.
    pub bytes: u64,
    /// Publication of the first and the last.
    pub between: Option<(Timestamp, Timestamp)>,
}

impl OfTopic {
    fn take(&mut self, sample: &RecordedSample<'_>) {
        let time = sample.header.publish;
        let (first, last) = self.between.unwrap_or((time, time));
        self.between = Some((first.min(time), last.max(time)));
        self.samples += 1;
        self.bytes += (size_of::<SampleHeader>() + sample.payload.len()) as u64;
    }

    /// Mean rate (Hz); `None` with fewer than two samples.
    fn rate_hz(&self) -> Option<f64> {
        let (first, last) = self.between?;
        let span_s = last.seconds_since(first);
        (self.samples > 1 && span_s > 0.0).then(|| (self.samples - 1) as f64 / span_s)
    }
}

/// What there is of all topics.
#[derive(Clone, Debug, Default)]
pub struct Overview {
    /// By name.
    pub topics: BTreeMap<String, OfTopic>,
    /// Why it cannot be read to its end.
    pub damage: Option<String>,
    is_cut_off: bool,
    file_bytes: u64,
    about: BTreeMap<String, String>,
}

impl Overview {
    /// Of a recording.
    pub fn of(reading: &Reading) -> Self {
        let mut topics: BTreeMap<String, OfTopic> = BTreeMap::new();
        let ends = reading.each(|message| {
            match message {
                Message::Sample(sample) => topics.entry(sample.topic.to_owned()).or_default().take(sample),
                Message::Lost(topic, count) => topics.entry((*topic).to_owned()).or_default().lost += count,
            }
            true
        });
        Self {
            topics,
            is_cut_off: matches!(ends, Ok(Ends::CutOff)),
            damage: ends.err().map(|error| error.to_string()),
            file_bytes: reading.len_bytes(),
            about: reading.about.clone(),
        }
    }

    /// From the first sample to the last (s).
    pub fn duration_s(&self) -> f64 {
        let times = || self.topics.values().filter_map(|topic| topic.between);
        let first = times().map(|(first, _)| first).min();
        let last = times().map(|(_, last)| last).max();
        first
            .zip(last)
            .map_or(0.0, |(first, last)| last.seconds_since(first))
    }

    /// On one line.
    pub fn line(&self) -> String {
        let samples: u64 = self.topics.values().map(|topic| topic.samples).sum();
        let lost: u64 = self.topics.values().map(|topic| topic.lost).sum();
        let mut line = format!(
            "{:.1} s, {samples} samples of {} topics, {:.1} MB",
            self.duration_s(),
            self.topics.len(),
            self.file_bytes as f64 * 1e-6
        );
        if lost > 0 {
            line += &format!(", {lost} samples missing");
        }
        if self.is_cut_off {
            line += ", cut off";
        }
        if self.damage.is_some() {
            line += ", damaged";
        }
        line
    }

    /// A line for each topic.
    pub fn table(&self) -> String {
        let header = ["topic", "samples", "Hz", "missing", "kB"].map(str::to_owned);
        let rows: Vec<[String; 5]> = std::iter::once(header)
            .chain(self.topics.iter().map(|(name, topic)| {
                [
                    name.clone(),
                    topic.samples.to_string(),
                    topic.rate_hz().map_or("-".to_owned(), |hz| format!("{hz:.1}")),
                    topic.lost.to_string(),
                    format!("{:.0}", topic.bytes as f64 * 1e-3),
                ]
            }))
            .collect();
        let mut out = String::new();
        jink_control::status::write_table(&mut out, &rows);
        out
    }

    /// As one JSON object.
    pub fn json(&self) -> Value {
        let topics: serde_json::Map<String, Value> = self
            .topics
            .iter()
            .map(|(name, topic)| {
                let of_topic = json!({
                    "samples": topic.samples,
                    "missing": topic.lost,
                    "rate_hz": topic.rate_hz(),
                    "bytes": topic.bytes,
                });
                (name.clone(), of_topic)
            })
            .collect();
        json!({
            "about": self.about,
            "duration_s": self.duration_s(),
            "file_bytes": self.file_bytes,
            "cut_off": self.is_cut_off,
            "damage": self.damage,
            "topics": topics,
        })
    }
}

/// Samples of one topic as lines of a table.
#[derive(Debug)]
pub struct CsvTable {
    topic: String,
    columns: Vec<String>,
}

/// A sample as JSON, if this build knows its layout.
struct AsJson<'a>(&'a RecordedSample<'a>);
impl Visitor for AsJson<'_> {
    type Output = Result<Value, String>;
    fn visit<T: Layout + Debug + 'static>(self, _: Topic<T>) -> Result<Value, String> {
        let (recorded, ours) = (self.0.type_name, type_name::<T>());
        match recorded == ours {
            true => Ok(sample_json::of::<T>(&from_bytes(self.0.payload))),
            false => Err(format!(
                "{} was recorded with another layout: {recorded}, this build has {ours}",
                self.0.topic
            )),
        }
    }
}

impl CsvTable {
    /// Of `topic`.
    pub fn new(topic: &str) -> Self {
        Self {
            topic: topic.to_owned(),
            columns: Vec::new(),
        }
    }

    /// The names of the columns.
    pub fn header(&self) -> String {
        self.columns.join(",")
    }

    /// The line of a sample; the first one decides about the columns.
    ///
    /// # Errors
    /// That this build has another layout of it, or none.
    pub fn line(&mut self, sample: &RecordedSample<'_>) -> Result<String, String> {
        let row = TABLE.iter().find(|row| row.member_of(&self.topic).is_some());
        let json = row.and_then(|row| topics::visit(row, AsJson(sample)));
        let json =
            json.ok_or_else(|| format!("only its own programs know the layout of {}", self.topic))??;
        let header = sample.header;
        let mut cells = vec![
            ("publish_s".to_owned(), seconds(header.publish)),
            ("capture_s".to_owned(), seconds(header.capture)),
            ("sequence".to_owned(), (header.sequence as u32).to_string()),
        ];
        flatten("", &json, &mut cells);
        if self.columns.is_empty() {
            self.columns = cells.iter().map(|(name, _)| name.clone()).collect();
        }
        let cells: BTreeMap<String, String> = cells.into_iter().collect();
        let cell = |name: &String| cells.get(name).map_or("", String::as_str);
        Ok(self.columns.iter().map(cell).collect::<Vec<_>>().join(","))
    }
}

fn seconds(time: Timestamp) -> String {
    match time.is_set() {
        true => format!("{:.6}", time.ns as f64 * 1e-9),
        false => String::new(),
    }
}

fn flatten(name: &str, value: &Value, cells: &mut Vec<(String, String)>) {
    let within = |key: &str| match name {
        "" => key.to_owned(),
        name => format!("{name}.{key}"),
    };
    match value {
        Value::Object(fields) => {
            for (key, value) in fields {
                flatten(&within(key), value, cells);
            }
        }
        Value::Array(elements) if elements.len() > LIST_MAX => {}
        Value::Array(elements) => {
            for (index, value) in elements.iter().enumerate() {
                flatten(&within(&index.to_string()), value, cells);
            }
        }
        Value::Null => cells.push((name.to_owned(), String::new())),
        Value::String(text) => cells.push((name.to_owned(), text.replace([',', '\n', '"'], " "))),
        value => cells.push((name.to_owned(), value.to_string())),
    }
}
