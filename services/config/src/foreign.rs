//! What `services.toml` opens to programs of others: topics of their own, and what each of their processes may use.
//!
//! ```toml
//! [[topic]]
//! name = "user/wind"
//! payload = "Wind"
//! size_bytes = 24
//! rate_hz = 10
//!
//! [[process]]
//! name = "user_wind"
//! program = "/opt/wind/estimator"
//! reads = ["range/cloud/*"]
//! publishes = ["user/wind"]
//! ```
//!
//! | key of a `[[topic]]` | default | meaning |
//! |---|---|---|
//! | `name` | - | `user/` and lower-case letters, digits, underscores, slashes |
//! | `payload` | - | name of the sample's type, without the hash of its layout |
//! | `size_bytes` | - | its size |
//! | `rate_hz` | `0` | nominal rate; 0 = on change |
//! | `deadline_ms` | 2.5 periods, 5000 on change | age at which a sample counts as stale |
//! | `buffer` | `4` | samples a reader can fall behind |
//! | `wakes` | `false` | its samples start cycles of readers that ask for that |
//!
//! A process called `user_...` may use what the topic table opens to everybody, what its row grants, and nothing else,
//! whatever its program calls itself. The other rows of the process table need no grants and get none.

use super::{
    ConfigError, PROCESS_FILE, SENSOR_PLACE, Sensor, SensorOutput, line_of, of_sensor, parse_toml, read,
};
use jink_shared_types::suggestion::{DidYouMean, nearest};
use jink_shared_types::topics::{OPEN_TO_OTHERS, RANGE_CLOUD, RANGE_SCAN, TABLE, TopicRow, USER_TOPICS};
use serde::Deserialize;
use std::ops::RangeInclusive;
use std::path::Path;
use toml::Spanned;

/// Begins the names of processes whose programs are not ours.
pub const USER_PROCESSES: &str = "user_";

/// Longest name of a topic: names of services and files are made of it.
const TOPIC_NAME_MAX: usize = 48;
/// Longest name of a payload: with prefix and hash it must fit into a type name.
const PAYLOAD_NAME_MAX: usize = 40;
/// Largest payload (bytes). Every publisher has room for what all its readers may hold, so this bounds its memory.
const SIZE_MAX: i64 = 16 << 20;
const DEFAULT_BUFFER: i64 = 4;
/// Age at which a sample of a topic without a rate counts as stale (ms), as in the topic table.
const DEADLINE_ON_CHANGE_MS: f64 = 5000.0;
/// One sample may be lost or late: a deadline below this many periods would be missed all the time.
const DEADLINE_PERIODS_MIN: f64 = 2.0;
const DEADLINE_PERIODS: f64 = 2.5;

/// What one process may use besides what is open to everybody.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Grants {
    /// Topics, or families ending in `*`, that it may publish.
    pub publishes: Vec<String>,
    /// The same that it may read.
    pub reads: Vec<String>,
}

/// Everything that the file opens.
#[derive(Clone, Debug, Default)]
pub struct Foreign {
    /// Declared topics. Producers and consumers are the processes that the same file grants them to.
    pub topics: Vec<TopicRow>,
    /// Grants by the name of the process, `{sensor}` in it as written.
    grants: Vec<(String, Grants)>,
}

/// Whether a process of this name runs a program that is not ours.
pub fn is_foreign(process: &str) -> bool {
    process.starts_with(USER_PROCESSES)
}

#[derive(Deserialize)]
struct File {
    #[serde(default)]
    topic: Vec<Spanned<WrittenTopic>>,
    #[serde(default)]
    process: Vec<WrittenProcess>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenTopic {
    name: Option<Spanned<String>>,
    payload: Option<Spanned<String>>,
    size_bytes: Option<Spanned<i64>>,
    rate_hz: Option<Spanned<f64>>,
    deadline_ms: Option<Spanned<f64>>,
    buffer: Option<Spanned<i64>>,
    wakes: Option<bool>,
}

/// The rest of the row is the supervisor's.
#[derive(Deserialize)]
struct WrittenProcess {
    #[serde(default)]
    name: String,
    publishes: Option<Spanned<Vec<Spanned<String>>>>,
    reads: Option<Spanned<Vec<Spanned<String>>>>,
}

/// Makes an error of a place in the file and a sentence.
type At<'a> = dyn Fn(usize, String) -> ConfigError + 'a;

impl Foreign {
    /// Reads `services.toml` in `folder`.
    ///
    /// # Errors
    /// [`ConfigError`] naming file and line.
    pub fn load(folder: &Path) -> Result<Self, ConfigError> {
        let file = folder.join(PROCESS_FILE);
        Self::parse(&file, &read(&file)?)
    }

    /// Reads the text of a process table; `file` only appears in errors.
    ///
    /// # Errors
    /// [`ConfigError`] naming file and line.
    pub fn parse(file: &Path, text: &str) -> Result<Self, ConfigError> {
        let parsed: File = parse_toml(file, text)?;
        let at = |offset: usize, message: String| ConfigError {
            file: file.to_owned(),
            line: line_of(text, offset),
            message,
        };
        let mut foreign = Self::default();
        for written in &parsed.topic {
            foreign.declare(written, &at)?;
        }
        for written in &parsed.process {
            foreign.grant(written, &at)?;
        }
        for topic in &mut foreign.topics {
            let granted = |lists: fn(&Grants) -> &Vec<String>| {
                let those = foreign.grants.iter();
                let those = those.filter(|(_, grants)| allows(lists(grants), topic.name));
                leaked_list(those.map(|(process, _)| process.as_str()))
            };
            topic.producers = granted(|grants| &grants.publishes);
            topic.consumers = granted(|grants| &grants.reads);
        }
        Ok(foreign)
    }

    /// What the process of this name may use.
    pub fn grants_of(&self, process: &str) -> Grants {
        let of_row = |(name, grants): &(String, Grants)| match name.split_once(SENSOR_PLACE) {
            Some((before, behind)) => {
                let sensor = process.strip_prefix(before)?.strip_suffix(behind)?;
                Some(grants.of_sensor(sensor))
            }
            None => (name == process).then(|| grants.clone()),
        };
        self.grants.iter().find_map(of_row).unwrap_or_default()
    }

    /// The grants of the row of this name, as written.
    pub fn grants_as_written(&self, name: &str) -> Grants {
        let row = self.grants.iter().find(|(row, _)| row == name);
        row.map_or_else(Grants::default, |(_, grants)| grants.clone())
    }

    /// `row` with the processes that are granted to read its topic called `name` among its consumers: whoever creates the topic
    /// makes room for them.
    pub fn with_readers(&self, row: TopicRow, name: &str) -> TopicRow {
        let granted = self.grants.iter().filter(|(_, grants)| grants.may_read(name));
        let granted: Vec<&str> = granted.map(|(process, _)| process.as_str()).collect();
        match granted.is_empty() || row.name.starts_with(USER_TOPICS) {
            true => row,
            false => TopicRow {
                consumers: leaked_list(row.consumers.iter().copied().chain(granted)),
                ..row
            },
        }
    }

    fn declare(&mut self, written: &Spanned<WrittenTopic>, at: &At<'_>) -> Result<(), ConfigError> {
        let start = written.span().start;
        let written = written.get_ref();
        let needs = |key: &str| at(start, format!("a topic needs `{key}`"));
        let name = written.name.as_ref().ok_or_else(|| needs("name"))?;
        let refuse = |message: String| at(name.span().start, message);
        if !is_topic_name(name.get_ref()) {
            return Err(refuse(format!(
                "topic name {:?}: use {USER_TOPICS} and lower-case letters, digits, underscores and slashes, \
                 {TOPIC_NAME_MAX} characters at most",
                name.get_ref()
            )));
        }
        if self.topics.iter().any(|topic| topic.name == name.get_ref()) {
            return Err(refuse(format!("two topics are called {:?}", name.get_ref())));
        }
        let payload = written.payload.as_ref().ok_or_else(|| needs("payload"))?;
        if !is_type_name(payload.get_ref()) {
            let message = format!(
                "payload {:?}: the name of a type, without the hash of its layout, {PAYLOAD_NAME_MAX} characters at most",
                payload.get_ref()
            );
            return Err(at(payload.span().start, message));
        }
        let size = written.size_bytes.as_ref().ok_or_else(|| needs("size_bytes"))?;
        let size_bytes = in_range("size_bytes", Some(size), 0, 1..=SIZE_MAX, at)?;
        let rate_hz = in_range("rate_hz", written.rate_hz.as_ref(), 0.0, 0.0..=1000.0, at)?;
        let (least_ms, default_ms) = match rate_hz {
            rate if rate > 0.0 => (DEADLINE_PERIODS_MIN * 1e3 / rate, DEADLINE_PERIODS * 1e3 / rate),
            _ => (1.0, DEADLINE_ON_CHANGE_MS),
        };
        let deadline = written.deadline_ms.as_ref();
        let deadline_ms = in_range("deadline_ms", deadline, default_ms, least_ms..=3_600_000.0, at)?;
        let buffer = in_range("buffer", written.buffer.as_ref(), DEFAULT_BUFFER, 1..=64, at)?;
        self.topics.push(TopicRow {
            name: leaked(name.get_ref()),
            payload: leaked(payload.get_ref()),
            producers: &[],
            consumers: &[],
            rate_hz,
            deadline_ms,
            buffer: usize::try_from(buffer).unwrap_or(1),
            logged: true,
            wakes: written.wakes.unwrap_or(false),
            payload_bytes: usize::try_from(size_bytes).unwrap_or(0),
        });
        Ok(())
    }

    fn grant(&mut self, written: &WrittenProcess, at: &At<'_>) -> Result<(), ConfigError> {
        let lists = [("publishes", &written.publishes), ("reads", &written.reads)];
        for (key, list) in lists {
            let Some(list) = list else { continue };
            if !is_foreign(&written.name) {
                let message = format!(
                    "{:?} has `{key}`: only processes called {USER_PROCESSES}... are granted topics, the others stand in the \
                     topic table",
                    written.name
                );
                return Err(at(list.span().start, message));
            }
            for topic in list.get_ref() {
                let checked = match key {
                    "publishes" => self.check_publishes(topic.get_ref()),
                    _ => self.check_exists(topic.get_ref()),
                };
                checked
                    .map_err(|message| at(topic.span().start, format!("{:?}: {message}", written.name)))?;
            }
        }
        let texts = |list: &Option<Spanned<Vec<Spanned<String>>>>| {
            let list = list.as_ref().map_or(&[][..], |list| list.get_ref().as_slice());
            list.iter().map(|topic| topic.get_ref().clone()).collect()
        };
        let grants = Grants {
            publishes: texts(&written.publishes),
            reads: texts(&written.reads),
        };
        if grants != Grants::default() {
            self.grants.push((written.name.clone(), grants));
        }
        Ok(())
    }

    /// There is such a topic, or such a family.
    fn check_exists(&self, topic: &str) -> Result<(), String> {
        let declared = self.topics.iter().map(|topic| topic.name);
        let in_table = TABLE.iter().any(|row| row.member_of(topic).is_some());
        if in_table || declared.clone().any(|name| name == topic) {
            return Ok(());
        }
        let near = nearest(topic, TABLE.iter().map(|row| row.name).chain(declared));
        Err(format!("there is no topic {topic:?}{}", DidYouMean(near)))
    }

    fn check_publishes(&self, topic: &str) -> Result<(), String> {
        self.check_exists(topic)?;
        let row = TABLE.iter().find(|row| row.member_of(topic).is_some());
        if row.is_none_or(|row| OPEN_TO_OTHERS.contains(&row.name)) {
            return Ok(());
        }
        Err(format!(
            "{topic} may not be published by others; open are {} and {USER_TOPICS}...",
            OPEN_TO_OTHERS.join(", ")
        ))
    }
}

impl Grants {
    /// Whether the topic of this name may be published.
    pub fn may_publish(&self, topic: &str) -> bool {
        allows(&self.publishes, topic)
    }

    /// Whether the topic of this name may be read.
    pub fn may_read(&self, topic: &str) -> bool {
        allows(&self.reads, topic)
    }

    /// Those of a row that is there once per sensor, for the sensor called `sensor`.
    pub fn of_sensor(&self, sensor: &str) -> Self {
        let of = |list: &[String]| list.iter().map(|topic| of_sensor(topic, sensor)).collect();
        Self {
            publishes: of(&self.publishes),
            reads: of(&self.reads),
        }
    }

    /// A topic that both may publish. Readers take the newer of two producers for the successor of the other: two that go on at
    /// once silence each other.
    pub fn published_by_both<'a>(&'a self, other: &Self) -> Option<&'a str> {
        let meets = |one: &str, other: &str| match (one.strip_suffix('*'), other.strip_suffix('*')) {
            (Some(one), Some(other)) => one.starts_with(other) || other.starts_with(one),
            (Some(family), None) => other.starts_with(family),
            (None, Some(family)) => one.starts_with(family),
            (None, None) => one == other,
        };
        let mine = self.publishes.iter().map(String::as_str);
        let mut mine = mine.filter(|one| other.publishes.iter().any(|other| meets(one, other)));
        mine.next()
    }

    /// A range topic among those to be published that belongs to no sensor, so that nobody would read it; with the nearest
    /// one that does.
    pub fn without_sensor(&self, sensors: &[Sensor]) -> Option<(&str, Option<String>)> {
        let topic_of = |sensor: &Sensor| match sensor.output {
            SensorOutput::Cloud => RANGE_CLOUD.row.topic_name(&sensor.name),
            SensorOutput::Scan => RANGE_SCAN.row.topic_name(&sensor.name),
        };
        let known: Vec<String> = sensors.iter().map(topic_of).collect();
        let is_range = |topic: &&String| {
            let one = [RANGE_CLOUD.row, RANGE_SCAN.row];
            !topic.ends_with('*') && one.iter().any(|row| row.member_of(topic).is_some())
        };
        let mut missing = self.publishes.iter().filter(is_range);
        let missing = missing.find(|topic| !known.contains(topic))?;
        let near = nearest(missing, known.iter().map(String::as_str));
        Some((missing, near.map(str::to_owned)))
    }
}

fn allows(list: &[String], topic: &str) -> bool {
    list.iter().any(|granted| match granted.strip_suffix('*') {
        Some(family) => topic.starts_with(family),
        None => granted == topic,
    })
}

fn is_topic_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let part = |part: &str| !part.is_empty() && part.chars().all(plain);
    let own = text.strip_prefix(USER_TOPICS);
    text.len() <= TOPIC_NAME_MAX && own.is_some_and(|own| own.split('/').all(part))
}

fn is_type_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
    (1..=PAYLOAD_NAME_MAX).contains(&text.len()) && text.chars().all(plain)
}

fn in_range<T: PartialOrd + Copy + std::fmt::Display>(
    key: &str,
    written: Option<&Spanned<T>>,
    default: T,
    range: RangeInclusive<T>,
    at: &At<'_>,
) -> Result<T, ConfigError> {
    match written {
        None => Ok(default),
        Some(value) if range.contains(value.get_ref()) => Ok(*value.get_ref()),
        Some(value) => {
            let (value, place) = (value.get_ref(), value.span().start);
            let message = format!("{key} = {value} is outside {} to {}", range.start(), range.end());
            Err(at(place, message))
        }
    }
}

/// A text like those of the tables in the program. The configuration is read a few times in the life of a process.
pub(super) fn leaked(text: &str) -> &'static str {
    Box::leak(text.to_owned().into_boxed_str())
}

fn leaked_list<'a>(texts: impl Iterator<Item = &'a str>) -> &'static [&'static str] {
    Box::leak(texts.map(leaked).collect::<Vec<_>>().into_boxed_slice())
}

#[cfg(test)]
mod tests {
    use super::{Foreign, Grants};
    use crate::{Sensor, SensorOutput};
    use jink_shared_types::view::FieldOfView;
    use std::path::Path;

    const TOPIC: &str = "[[topic]]\nname = \"user/wind\"\npayload = \"Wind\"\nsize_bytes = 24\n";

    fn parse(text: &str) -> Foreign {
        Foreign::parse(Path::new("services.toml"), text).unwrap()
    }

    fn error_of(text: &str) -> String {
        let error = Foreign::parse(Path::new("services.toml"), text);
        error.unwrap_err().to_string()
    }

    #[test]
    fn a_process_has_what_its_row_grants_and_a_topic_names_its_users() {
        let foreign = parse(&format!(
            "{TOPIC}[[process]]\nname = \"user_wind\"\nprogram = \"w\"\nreads = [\"range/cloud/*\", \"map/local\"]\n\
             publishes = [\"user/wind\"]\n[[process]]\nname = \"planner\"\n"
        ));
        let grants = foreign.grants_of("user_wind");
        assert!(grants.may_publish("user/wind") && !grants.may_publish("plan/route"));
        assert!(grants.may_read("range/cloud/front") && !grants.may_read("range/scan/front"));
        assert_eq!(foreign.grants_of("planner"), Grants::default());
        let map = jink_shared_types::topics::LOCAL_MAP.row;
        let more = foreign.with_readers(map, map.name).max_subscribers();
        assert_eq!(more, map.max_subscribers() + 2, "room for it and its shadow");
        let topic = foreign.topics[0];
        assert_eq!(
            (topic.name, topic.payload, topic.payload_bytes),
            ("user/wind", "Wind", 24)
        );
        assert_eq!((topic.rate_hz, topic.deadline_ms, topic.buffer), (0.0, 5000.0, 4));
        assert_eq!((topic.producers, topic.consumers), (&["user_wind"][..], &[][..]));
    }

    #[test]
    fn a_row_per_sensor_is_granted_its_own_sensor() {
        let foreign = parse("[[process]]\nname = \"user_{sensor}\"\npublishes = [\"range/scan/{sensor}\"]\n");
        let grants = foreign.grants_of("user_tof");
        assert!(grants.may_publish("range/scan/tof") && !grants.may_publish("range/scan/front"));
    }

    #[test]
    fn what_cannot_be_granted_is_refused_with_its_line() {
        let row = |keys: &str| error_of(&format!("[[process]]\nname = \"user_a\"\n{keys}\n"));
        assert_eq!(
            error_of("[[process]]\nname = \"planner\"\nreads = [\"map/local\"]\n"),
            "services.toml:3: \"planner\" has `reads`: only processes called user_... are granted topics, the others stand in \
             the topic table"
        );
        assert_eq!(
            row("publishes = [\"plan/route\"]"),
            format!(
                "services.toml:3: \"user_a\": plan/route may not be published by others; open are {} and user/...",
                super::OPEN_TO_OTHERS.join(", ")
            )
        );
        assert_eq!(
            row("reads = [\n\"map/local\",\n\"map/locl\"]"),
            "services.toml:5: \"user_a\": there is no topic \"map/locl\"; did you mean `map/local`?"
        );
        let other_name = format!("{TOPIC}[[process]]\nname = \"user_a\"\npublishes = [\"user/wnd\"]\n");
        assert_eq!(
            error_of(&other_name),
            "services.toml:7: \"user_a\": there is no topic \"user/wnd\"; did you mean `user/wind`?"
        );
    }

    #[test]
    fn a_topic_that_makes_no_sense_is_refused_with_its_line() {
        assert!(
            error_of("\n[[topic]]\nname = \"user/a\"\n")
                .starts_with("services.toml:2: a topic needs `payload`")
        );
        assert!(
            error_of("[[topic]]\nname = \"wind\"\n")
                .starts_with("services.toml:2: topic name \"wind\": use user/")
        );
        assert!(error_of("[[topic]]\nname = \"user//a\"\n").starts_with("services.toml:2: topic name"));
        assert_eq!(
            error_of(&format!("{TOPIC}{TOPIC}")),
            "services.toml:6: two topics are called \"user/wind\""
        );
        assert_eq!(
            error_of(&format!("{TOPIC}rate_hz = 10\ndeadline_ms = 150\n")),
            "services.toml:6: deadline_ms = 150 is outside 200 to 3600000"
        );
        assert_eq!(
            error_of(&format!("{TOPIC}rate_h = 10\n")),
            "services.toml:5: unknown key `rate_h`; did you mean `rate_hz`?"
        );
    }

    #[test]
    fn two_producers_of_one_topic_are_seen() {
        let publishing = |topics: &[&str]| Grants {
            publishes: topics.iter().map(|&topic| topic.to_owned()).collect(),
            ..Grants::default()
        };
        let one = publishing(&["user/a", "range/cloud/front"]);
        assert_eq!(one.published_by_both(&publishing(&["user/b"])), None);
        assert_eq!(
            one.published_by_both(&publishing(&["range/cloud/*"])),
            Some("range/cloud/front")
        );
        assert_eq!(one.published_by_both(&one), Some("user/a"));
    }

    #[test]
    fn a_range_topic_without_a_sensor_is_reported_with_the_nearest() {
        let grants = Grants {
            publishes: vec!["range/cloud/frnt".to_owned()],
            ..Grants::default()
        };
        let sensor = Sensor {
            name: "front".to_owned(),
            output: SensorOutput::Cloud,
            kind: "user/tof".to_owned(),
            has_device: false,
            rate_hz: None,
            delay_s: 0.0,
            band_m: [0.0; 2],
            no_return_is_clear: false,
            nominal_view: FieldOfView::default(),
        };
        let (missing, near) = grants.without_sensor(&[sensor]).unwrap();
        assert_eq!(
            (missing, near.as_deref()),
            ("range/cloud/frnt", Some("range/cloud/front"))
        );
    }
}
