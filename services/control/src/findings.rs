//! What an examination has found, as people and scripts read it: the verdict first, then the one thing to mend first, then
//! everything.

use jink_shared_types::events::{EventSample, find};
use serde::{Deserialize, Serialize};

/// How a finding bears on flying.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// Nothing flies before this is mended.
    Blocker,
    /// It flies, worse than it could.
    Warning,
    /// As it should be.
    Good,
}

/// One line of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// How it bears on flying.
    pub grade: Grade,
    /// What it is about.
    pub about: String,
    /// What is.
    pub is: String,
    /// What to do; empty where nothing is.
    pub remedy: String,
}

/// All that was found, in the order of causes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// In the order of causes: the first blocker is the one to mend first.
    pub findings: Vec<Finding>,
    /// Whom it is about.
    pub subject: String,
    /// How long it took (s).
    pub seconds: f64,
}

/// Those of `events` that are about one of `about` (their ids), as findings with what to do.
pub fn of_events<'a>(events: &'a [EventSample], about: &'a [u16]) -> impl Iterator<Item = Finding> + 'a {
    events
        .iter()
        .filter(|event| about.contains(&event.id))
        .map(|event| Finding {
            grade: Grade::Warning,
            about: "event".to_owned(),
            is: event.text(),
            remedy: find(event.id).map_or("", |row| row.action).to_owned(),
        })
}

/// Columns of the grade and of what a finding is about.
const COLUMNS: usize = 8;

impl Findings {
    /// Whether nothing keeps jink from flying.
    pub fn is_ready(&self) -> bool {
        self.count(Grade::Blocker) == 0
    }

    fn count(&self, grade: Grade) -> usize {
        self.findings
            .iter()
            .filter(|finding| finding.grade == grade)
            .count()
    }

    fn first(&self) -> Option<&Finding> {
        self.findings
            .iter()
            .find(|finding| finding.grade == Grade::Blocker)
    }

    /// One sentence.
    pub fn verdict(&self) -> String {
        let count = |grade, one: &str| match self.count(grade) {
            1 => format!("1 {one}"),
            many => format!("{many} {one}s"),
        };
        let warnings = count(Grade::Warning, "warning");
        let whom = &self.subject;
        match self.is_ready() {
            true => format!("READY: {whom}; {warnings}"),
            false => format!(
                "NOT READY: {whom}; {}, {warnings}",
                count(Grade::Blocker, "blocker")
            ),
        }
    }

    /// For a person.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n", self.verdict());
        if let Some(first) = self.first() {
            text += &format!("First: {}\n", first.is);
            if !first.remedy.is_empty() {
                text += &format!("  -> {}\n", first.remedy);
            }
        }
        text.push('\n');
        let mut rows: Vec<_> = self.findings.iter().collect();
        rows.sort_by_key(|finding| finding.grade);
        let about = rows
            .iter()
            .map(|row| row.about.chars().count())
            .max()
            .unwrap_or(0);
        for row in rows {
            let grade = match row.grade {
                Grade::Blocker => "BLOCKER",
                Grade::Warning => "warning",
                Grade::Good => "good",
            };
            text += &format!("{grade:COLUMNS$} {:about$}  {}\n", row.about, row.is);
            if !row.remedy.is_empty() {
                text += &format!("{:COLUMNS$} {:about$}  -> {}\n", "", "", row.remedy);
            }
        }
        text
    }

    /// For a script: the verdict, what to mend first, and everything.
    pub fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "ready": self.is_ready(),
            "subject": self.subject,
            "seconds": self.seconds,
            "mend_first": self.first(),
            "findings": self.findings,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{Finding, Findings, Grade};

    fn finding(grade: Grade, about: &str) -> Finding {
        Finding {
            grade,
            about: about.to_owned(),
            is: format!("{about} is so"),
            remedy: match grade {
                Grade::Good => String::new(),
                _ => format!("mend {about}"),
            },
        }
    }

    fn findings(rows: &[(Grade, &str)]) -> Findings {
        Findings {
            findings: rows.iter().map(|(grade, about)| finding(*grade, about)).collect(),
            subject: "PX4 1.15.2, quadrotor, system 1".to_owned(),
            seconds: 5.0,
        }
    }

    #[test]
    fn the_verdict_stands_first_and_then_the_first_blocker_in_the_order_of_causes() {
        let found = findings(&[
            (Grade::Good, "link"),
            (Grade::Warning, "TIMESYNC"),
            (Grade::Blocker, "version"),
            (Grade::Blocker, "COM_OBS_AVOID"),
        ]);
        let text = found.text();
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(
            lines[..4],
            [
                "NOT READY: PX4 1.15.2, quadrotor, system 1; 2 blockers, 1 warning",
                "First: version is so",
                "  -> mend version",
                "",
            ]
        );
        assert!(
            lines[4].starts_with("BLOCKER  version        version is so"),
            "{}",
            lines[4]
        );
        assert!(lines.last().unwrap().starts_with("good     link"));
        assert!(!found.is_ready());
        assert_eq!(found.json()["mend_first"]["about"], "version");
    }

    #[test]
    fn without_a_blocker_it_is_ready_and_nothing_is_to_be_mended_first() {
        let found = findings(&[(Grade::Good, "link"), (Grade::Warning, "CP_DIST")]);
        let text = found.text();
        assert!(
            text.starts_with("READY: PX4 1.15.2, quadrotor, system 1; 1 warning\n\nwarning"),
            "{text}"
        );
        assert_eq!(found.json()["mend_first"], serde_json::Value::Null);
        assert_eq!(found.json()["ready"], true);
    }

    #[test]
    fn it_survives_the_way_from_the_program_that_examines() {
        let found = findings(&[(Grade::Blocker, "link")]);
        let text = serde_json::to_string(&found).unwrap();
        assert!(text.contains("\"grade\":\"blocker\""), "{text}");
        assert_eq!(serde_json::from_str::<Findings>(&text).unwrap(), found);
    }
}
