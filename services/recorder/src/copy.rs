//! The recording of a replay: everything as it was, but for what the replayed services have published.

use crate::ReplayError;
use jink_recorder::reading::Reading;
use jink_recorder::{About, Channel, Kept, Recording};
use jink_shared_types::{SampleHeader, Timestamp};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// A recording that is written beside its place, and takes it when it is complete.
pub(crate) struct Output {
    path: PathBuf,
    unfinished: PathBuf,
    recording: Option<Recording<BufWriter<File>>>,
    channels: BTreeMap<String, usize>,
}

impl Output {
    /// At `path`, with what `source` says of itself.
    pub(crate) fn begin(path: &Path, source: &Reading) -> Result<Self, ReplayError> {
        let unfinished = path.with_extension("mcap.new");
        let number = |key: &str| source.about.get(key)?.parse::<u64>().ok();
        let about = About {
            facts: source.about.clone(),
            files: source.files.clone(),
        };
        let file =
            File::create(&unfinished).map_err(|error| ReplayError::Folder(unfinished.clone(), error))?;
        let begin = Timestamp::from_ns(number("monotonic_ns").unwrap_or(0));
        let recording = Recording::begin(
            BufWriter::new(file),
            begin,
            number("unix_ns").unwrap_or(begin.ns),
            &about,
        );
        Ok(Self {
            path: path.to_owned(),
            recording: Some(recording.map_err(|error| ReplayError::Out(path.to_owned(), error.to_string()))?),
            unfinished,
            channels: BTreeMap::new(),
        })
    }

    /// Writes a sample.
    pub(crate) fn write(
        &mut self,
        channel: &Channel,
        header: &SampleHeader,
        payload: &[u8],
    ) -> Result<(), ReplayError> {
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
            .map_err(|error| ReplayError::Out(self.path.clone(), error.to_string()))
    }

    /// Says that samples are missing, which were missing before.
    pub(crate) fn write_lost(&mut self, now: Timestamp, topic: &str, count: u64) -> Result<(), ReplayError> {
        let written = self.recording.as_mut().map(|it| it.write_lost(now, topic, count));
        written
            .transpose()
            .map(drop)
            .map_err(|error| ReplayError::Out(self.path.clone(), error.to_string()))
    }

    /// Completes it.
    pub(crate) fn finish(mut self) -> Result<(), ReplayError> {
        let finished = self.recording.take().map_or(Ok(()), Recording::finish);
        finished.map_err(|error| ReplayError::Out(self.path.clone(), error.to_string()))?;
        std::fs::rename(&self.unfinished, &self.path)
            .map_err(|error| ReplayError::Folder(self.path.clone(), error))
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        // Nothing half written is left; after `finish` there is none.
        let _none = std::fs::remove_file(&self.unfinished);
    }
}
