//! Lines of logs in plain words: when, how severe, of whom, what.

use serde_json::{Map, Value};
use std::fmt;
use tracing::Level;

/// Longest name of a service, for the columns.
const SERVICE_WIDTH: usize = 18;
/// What a record holds besides the numbers and names of its message.
const OWN_KEYS: [&str; 6] = ["timestamp", "level", "message", "target", "span", "spans"];

/// One line of a service's log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogLine {
    /// RFC 3339 in UTC; of what is no record (a panic) that of the record before it. Compares as time does.
    pub time: String,
    /// `None`: it is no record.
    pub level: Option<Level>,
    /// Who has written it.
    pub service: String,
    /// What.
    pub text: String,
}

impl LogLine {
    /// The lines of `text`, which `service` has written.
    pub fn all(service: &str, text: &str) -> Vec<Self> {
        let mut time = String::new();
        let mut lines = Vec::new();
        for line in text.lines().filter(|line| !line.trim().is_empty()) {
            let record: Option<Map<String, Value>> = serde_json::from_str(line).ok();
            let read = record
                .as_ref()
                .and_then(|record| Self::of_record(service, record));
            let line = read.unwrap_or_else(|| Self {
                time: time.clone(),
                level: None,
                service: service.to_owned(),
                text: line.to_owned(),
            });
            time.clone_from(&line.time);
            lines.push(line);
        }
        lines
    }

    fn of_record(service: &str, record: &Map<String, Value>) -> Option<Self> {
        let word = |key: &str| record.get(key)?.as_str();
        let mut text = word("message").unwrap_or_default().to_owned();
        for (key, value) in record.iter().filter(|(key, _)| !OWN_KEYS.contains(&key.as_str())) {
            let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            text += &format!("  {key}={value}");
        }
        Some(Self {
            time: word("timestamp")?.to_owned(),
            level: Some(word("level")?.parse().ok()?),
            service: service.to_owned(),
            text: text.trim_start().to_owned(),
        })
    }

    /// Whether it is as severe as `level`, or more. What is no record is severe: services write nothing else of their own will.
    pub fn is_at_least(&self, level: Level) -> bool {
        self.level.is_none_or(|own| own <= level)
    }
}

impl fmt::Display for LogLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // To the millisecond: 2026-11-28T14:03:12.345678Z.
        let time = self.time.get(..23).unwrap_or(&self.time).replace('T', " ");
        let level = self
            .level
            .map_or(String::new(), |level| level.as_str().to_lowercase());
        let service = &self.service;
        let text = self.text.replace('\n', "\n      | ");
        write!(f, "{time:<23}  {level:<5}  {service:<SERVICE_WIDTH$}  {text}")
    }
}

/// In the order of their times, lines of the same service in their own order.
pub fn merge(lines: &mut [LogLine]) {
    lines.sort_by(|one, other| one.time.cmp(&other.time));
}

#[cfg(test)]
mod tests {
    use super::{LogLine, merge};
    use tracing::Level;

    const PLANNER: &str = concat!(
        r#"{"timestamp":"2026-11-28T14:03:12.345678Z","level":"WARN","message":"jink: path blocked, evading","event":10,"target":"x"}"#,
        "\nthread 'main' panicked\n\n",
        r#"{"timestamp":"2026-11-28T14:03:14.000001Z","level":"INFO","message":"started","target":"x"}"#,
    );
    const GUARD: &str =
        r#"{"timestamp":"2026-11-28T14:03:13.000000Z","level":"INFO","message":"released","target":"x"}"#;

    #[test]
    fn a_record_becomes_a_line_in_plain_words() {
        let lines = LogLine::all("planner", PLANNER);
        assert_eq!(
            lines[0].to_string(),
            "2026-11-28 14:03:12.345  warn   planner             jink: path blocked, evading  event=10"
        );
        assert_eq!(
            (lines[1].text.as_str(), lines[1].level),
            ("thread 'main' panicked", None)
        );
        assert!(lines[0].is_at_least(Level::WARN) && !lines[2].is_at_least(Level::WARN));
        assert!(lines[1].is_at_least(Level::ERROR));
    }

    #[test]
    fn what_several_services_have_written_stands_in_the_order_of_time() {
        let mut lines = LogLine::all("planner", PLANNER);
        lines.extend(LogLine::all("collision_guard", GUARD));
        merge(&mut lines);
        let texts: Vec<_> = lines
            .iter()
            .map(|line| line.text.split("  ").next().unwrap())
            .collect();
        assert_eq!(
            texts,
            [
                "jink: path blocked, evading",
                "thread 'main' panicked",
                "released",
                "started"
            ]
        );
    }
}
