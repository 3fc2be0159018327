//! Recordings that are made of others: a part of one, or one with other samples in it.

use crate::reading::Reading;
use crate::{About, Channel, Kept, Recording};
use jink_shared_types::{SampleHeader, Timestamp};
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// Why there is no copy: the file, and what is wrong with it.
#[derive(Debug)]
pub struct CopyError(PathBuf, String);

impl fmt::Display for CopyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.0.display(), self.1)
    }
}
impl std::error::Error for CopyError {}

/// A recording that is written beside its place, and takes it when it is complete.
#[derive(Debug)]
pub struct RecordingCopy {
    path: PathBuf,
    unfinished: PathBuf,
    recording: Option<Recording<BufWriter<File>>>,
    channels: BTreeMap<String, usize>,
}

impl RecordingCopy {
    /// At `path`, with what `source` says of itself; `read` are the files that its samples are from.
    ///
    /// # Errors
    /// What the system says of the file, or that it is one of those.
    pub fn begin(path: &Path, source: &Reading, read: &[PathBuf]) -> Result<Self, CopyError> {
        let is_same = |other: &PathBuf| {
            path.canonicalize()
                .is_ok_and(|path| other.canonicalize().is_ok_and(|other| other == path))
        };
        if read.iter().any(is_same) {
            return Err(CopyError(
                path.to_owned(),
                "is read, and would be written over".to_owned(),
            ));
        }
        let unfinished = path.with_extension("mcap.new");
        let number = |key: &str| source.about.get(key)?.parse::<u64>().ok();
        let about = About {
            facts: source.about.clone(),
            files: source.files.clone(),
        };
        let file =
            File::create(&unfinished).map_err(|error| CopyError(unfinished.clone(), error.to_string()))?;
        let begin = Timestamp::from_ns(number("monotonic_ns").unwrap_or(0));
        let recording = Recording::begin(
            BufWriter::new(file),
            begin,
            number("unix_ns").unwrap_or(begin.ns),
            &about,
        );
        Ok(Self {
            path: path.to_owned(),
            recording: Some(recording.map_err(|error| CopyError(path.to_owned(), error.to_string()))?),
            unfinished,
            channels: BTreeMap::new(),
        })
    }

    /// Writes a sample.
    ///
    /// # Errors
    /// What the system says of the file.
    pub fn write(
        &mut self,
        channel: &Channel,
        header: &SampleHeader,
        payload: &[u8],
    ) -> Result<(), CopyError> {
        let Some(recording) = &mut self.recording else {
            return Ok(());
        };
        let next = self.channels.len();
        let written = match self.channels.get(&channel.topic) {
            Some(_) => Ok(()),
            None => {
                self.channels.insert(channel.topic.clone(), next);
                recording.add(channel)
            }
        };
        let kept = Kept {
            channel: self.channels[&channel.topic],
            header,
            payload,
        };
        written
            .and_then(|()| recording.write(&kept))
            .map_err(|error| CopyError(self.path.clone(), error.to_string()))
    }

    /// Says that samples are missing, which were missing before.
    ///
    /// # Errors
    /// What the system says of the file.
    pub fn write_lost(&mut self, now: Timestamp, topic: &str, count: u64) -> Result<(), CopyError> {
        let written = self.recording.as_mut().map(|it| it.write_lost(now, topic, count));
        written
            .transpose()
            .map(drop)
            .map_err(|error| CopyError(self.path.clone(), error.to_string()))
    }

    /// Completes it.
    ///
    /// # Errors
    /// What the system says of the file.
    pub fn finish(mut self) -> Result<(), CopyError> {
        let finished = self.recording.take().map_or(Ok(()), Recording::finish);
        finished.map_err(|error| CopyError(self.path.clone(), error.to_string()))?;
        std::fs::rename(&self.unfinished, &self.path)
            .map_err(|error| CopyError(self.path.clone(), error.to_string()))
    }
}

impl Drop for RecordingCopy {
    fn drop(&mut self) {
        // Nothing half written is left; after `finish` there is none.
        let _none = std::fs::remove_file(&self.unfinished);
    }
}
