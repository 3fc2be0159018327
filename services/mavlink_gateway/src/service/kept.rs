//! What the next gateway of the same run is to know, in files of the instance.

use crate::ProfileChoice;
use crate::ProfileName;
use crate::executive::record::Record;
use jink_shared_types::Timestamp;
use std::path::PathBuf;

/// How often what is flown is written down although it has not changed (s): it is read if it is not much older.
const WRITTEN_EVERY_S: f64 = 1.0;

/// What is flown, in a file on tmpfs that is read by the next gateway.
pub(super) struct FlightFile {
    path: PathBuf,
    written: Option<Record>,
}

impl FlightFile {
    pub(super) fn of(path: PathBuf) -> Self {
        Self { path, written: None }
    }

    pub(super) fn read(&self) -> Option<Record> {
        std::fs::read(&self.path)
            .ok()
            .and_then(|bytes| Record::of_bytes(&bytes))
    }

    /// Writes a new file beside the old one and puts it in its place: whoever reads meanwhile has one of the two whole.
    pub(super) fn keep(&mut self, now: Timestamp, record: Option<Record>) {
        let Some(record) = record else { return };
        let is_kept = self.written.is_some_and(|written| {
            let is_recent = !record.armed || now.seconds_since(written.written) < WRITTEN_EVERY_S;
            written.says_the_same(&record) && is_recent
        });
        if is_kept {
            return;
        }
        self.written = Some(record);
        let beside = self.path.with_extension("new");
        let done =
            std::fs::write(&beside, record.to_bytes()).and_then(|()| std::fs::rename(&beside, &self.path));
        if let Err(cause) = done {
            tracing::warn!(
                "what is flown is not kept for a restart, {}: {cause}",
                self.path.display()
            );
        }
    }
}

/// Which profile a gateway of this run has found to fit the autopilot, in a file of the instance: a gateway that is started again
/// in flight goes on at once with what was chosen.
pub(super) struct ProvenProfile {
    file: PathBuf,
    kept: Option<ProfileName>,
}

impl ProvenProfile {
    /// What is kept in `file`; nothing, if it cannot be read.
    pub(super) fn of(file: PathBuf) -> Self {
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        Self {
            kept: text.trim().parse().ok(),
            file,
        }
    }

    /// The profile to begin with, and whether it is proven.
    pub(super) fn for_choice(&self, choice: ProfileChoice) -> (ProfileName, bool) {
        match (choice, self.kept) {
            (ProfileChoice::Fixed(profile), kept) => (profile, kept == Some(profile)),
            (ProfileChoice::Auto, Some(kept)) => (kept, true),
            (ProfileChoice::Auto, None) => (ProfileName::Px4Trajectory, false),
        }
    }

    /// Keeps it if it is another than before. What was proven once stays: a run has one profile.
    pub(super) fn keep(&mut self, proven: Option<ProfileName>) {
        if proven.is_none() || proven == self.kept {
            return;
        }
        self.kept = proven;
        let written = std::fs::write(&self.file, proven.map_or("", ProfileName::name));
        if let Err(cause) = written {
            tracing::warn!(
                "{}: {cause}; a restarted gateway will ask the autopilot again",
                self.file.display()
            );
        }
    }
}
