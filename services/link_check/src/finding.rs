//! What was found: one line of what is, one of what to do.

use serde_json::{Value, json};

/// How a finding bears on flying.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// jink does not fly, or would not fly safely, before this is mended.
    Blocker,
    /// It flies, worse than it could.
    Warning,
    /// As it should be.
    Good,
}

/// One of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// How it bears on flying.
    pub grade: Grade,
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
            grade: Grade::Good,
            about: about.into(),
            is: is.into(),
            remedy: String::new(),
        }
    }

    /// `remedy` makes it better.
    pub fn warning(about: impl Into<String>, is: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            grade: Grade::Warning,
            remedy: remedy.into(),
            ..Self::good(about, is)
        }
    }

    /// Nothing flies before `remedy` is done.
    pub fn blocker(about: impl Into<String>, is: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            grade: Grade::Blocker,
            ..Self::warning(about, is, remedy)
        }
    }

    /// For whoever shows it.
    pub fn to_json(&self) -> Value {
        let grade = match self.grade {
            Grade::Blocker => "blocker",
            Grade::Warning => "warning",
            Grade::Good => "good",
        };
        json!({ "grade": grade, "about": self.about, "is": self.is, "remedy": self.remedy })
    }
}
