//! What was found: one line of what is, one of what to do.

use serde_json::{Value, json};

/// How a finding affects flights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// jink does not fly, or would not fly safely, before this is corrected.
    Blocker,
    /// It flies, worse than it could.
    Warning,
    /// As it should be.
    Good,
}

/// A finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// How it affects flights.
    pub grade: Severity,
    /// What it is about: a key, a message, a parameter.
    pub about: String,
    /// What is.
    pub is: String,
    /// What to do; empty where nothing is.
    pub remedy: String,
}

impl Finding {
    /// Nothing is to be done.
    pub fn good(about: impl Into<String>, is: impl Into<String>) -> Self {
        Self {
            grade: Severity::Good,
            about: about.into(),
            is: is.into(),
            remedy: String::new(),
        }
    }

    /// `remedy` makes it better.
    pub fn warning(about: impl Into<String>, is: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            grade: Severity::Warning,
            remedy: remedy.into(),
            ..Self::good(about, is)
        }
    }

    /// Nothing flies before `remedy` is done.
    pub fn blocker(about: impl Into<String>, is: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            grade: Severity::Blocker,
            ..Self::warning(about, is, remedy)
        }
    }

    /// As JSON.
    pub fn to_json(&self) -> Value {
        let grade = match self.grade {
            Severity::Blocker => "blocker",
            Severity::Warning => "warning",
            Severity::Good => "good",
        };
        json!({ "grade": grade, "about": self.about, "is": self.is, "remedy": self.remedy })
    }
}
