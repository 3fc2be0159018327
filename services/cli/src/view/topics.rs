//! The topic table as people see it.

use jink_runtime::members::Members;
use jink_shared_types::topics::TopicRow;
use serde::Serialize;

/// One topic.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Listed {
    /// Its name; ends in `*` for a family whose members are not known.
    pub name: String,
    /// Payload type.
    pub payload: &'static str,
    /// Rate that is kept at least (Hz); 0 = on change.
    pub rate_hz: f64,
    /// Age at which a sample counts as stale (ms).
    pub stale_after_ms: f64,
    /// Programs that may publish it.
    pub producers: &'static [&'static str],
    /// Programs that may read it; `*` = every one.
    pub consumers: &'static [&'static str],
}

impl Listed {
    /// The topics of one row; without `members` a family is one line.
    pub fn of(row: &TopicRow, members: Option<&Members>) -> Vec<Self> {
        let one = |name: String| Self {
            name,
            payload: row.payload,
            rate_hz: row.rate_hz,
            stale_after_ms: row.deadline_ms,
            producers: row.producers,
            consumers: row.consumers,
        };
        match members {
            Some(members) if row.is_family() => members
                .of(row)
                .iter()
                .map(|member| one(row.topic_name(member)))
                .collect(),
            _ => vec![one(row.name.to_owned())],
        }
    }
}

/// As a table.
pub fn table(topics: &[Listed]) -> String {
    let names = |names: &[&str]| match names {
        [] => "-".to_owned(),
        ["*"] => "every service".to_owned(),
        names => names.join(" "),
    };
    let header = ["topic", "payload", "least Hz", "stale ms", "from", "to"].map(str::to_owned);
    let rows: Vec<[String; 6]> = std::iter::once(header)
        .chain(topics.iter().map(|topic| {
            let rate = match topic.rate_hz {
                rate if rate > 0.0 => format!("{rate}"),
                _ => "-".to_owned(),
            };
            [
                topic.name.clone(),
                topic.payload.to_owned(),
                rate,
                format!("{}", topic.stale_after_ms),
                names(topic.producers),
                names(topic.consumers),
            ]
        }))
        .collect();
    let mut out = String::new();
    jink_control::status::write_table(&mut out, &rows);
    out
}

#[cfg(test)]
mod tests {
    use super::{Listed, Members, table};
    use jink_shared_types::topics::TABLE;

    #[test]
    fn families_are_one_line_or_one_per_member() {
        let members = Members {
            clouds: vec!["front".to_owned(), "rear".to_owned()],
            processes: vec!["planner".to_owned()],
            ..Members::default()
        };
        let all: Vec<Listed> = TABLE
            .iter()
            .flat_map(|row| Listed::of(row, Some(&members)))
            .collect();
        let names: Vec<&str> = all.iter().map(|one| one.name.as_str()).collect();
        assert!(names.contains(&"range/cloud/rear") && names.contains(&"health/planner"));
        assert!(
            !names
                .iter()
                .any(|name| name.contains('*') || name.starts_with("range/scan"))
        );
        let unknown: Vec<Listed> = TABLE.iter().flat_map(|row| Listed::of(row, None)).collect();
        assert_eq!(unknown.len(), TABLE.len());
        let text = table(&unknown);
        assert!(
            text.contains("range/cloud/*") && text.contains("every service"),
            "{text}"
        );
    }
}
