//! The stamps received from others, in a file that the next process begins with.
//!
//! A stamp is written when it is received, so that there is no moment after which a killed process leaves an older one. The file lies
//! on tmpfs, where a write costs about a microsecond: a disk would stop the link now and then. To a disk it is copied when the process ends.

use super::{STREAMS, SignedStream};
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Bytes of a sender: stamp, system, component, link, a mark that the place is in use, one to spare.
const ROW_BYTES: usize = 16;
/// The mark.
const USED: u8 = 1;

/// The file.
#[derive(Debug)]
pub(super) struct SenderFile {
    file: File,
    path: PathBuf,
    /// The copy, which outlives the instance's folder.
    copy: Option<PathBuf>,
    /// It holds the same senders in the same places as the memory of this process.
    is_ours: bool,
    has_failed: bool,
}

impl SenderFile {
    /// Opens the file and appends the senders in it and in its `copy` to `streams`, each with its newest stamp.
    pub(super) fn open(
        path: &Path,
        copy: Option<&Path>,
        streams: &mut Vec<SignedStream>,
    ) -> io::Result<Self> {
        let file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)?;
        let mut bytes = Vec::with_capacity(STREAMS * ROW_BYTES);
        io::Read::read_to_end(&mut &file, &mut bytes)?;
        let copied = copy.and_then(|copy| std::fs::read(copy).ok()).unwrap_or_default();
        let rows = bytes
            .chunks_exact(ROW_BYTES)
            .chain(copied.chunks_exact(ROW_BYTES));
        for row in rows.filter_map(of_bytes) {
            if let Some(known) = streams.iter_mut().find(|known| known.is_of_the_sender_of(&row)) {
                known.stamp = known.stamp.max(row.stamp);
            } else if streams.len() < STREAMS {
                streams.push(row);
            }
        }
        Ok(Self {
            file,
            path: path.to_owned(),
            copy: copy.map(Path::to_owned),
            is_ours: false,
            has_failed: false,
        })
    }

    /// Writes the stream number `last` of `streams`, or all, if another process has written since.
    pub(super) fn store(&mut self, streams: &[SignedStream], last: Option<usize>, is_owner: bool) {
        if !is_owner {
            self.is_ours = false;
            return;
        }
        let Some(stream) = last.and_then(|last| streams.get(last)) else {
            return;
        };
        let written = if self.is_ours {
            let at = last.unwrap_or(0) * ROW_BYTES;
            self.file.write_all_at(&to_bytes(stream), at as u64)
        } else {
            let mut all = [0; STREAMS * ROW_BYTES];
            for (row, stream) in all.chunks_exact_mut(ROW_BYTES).zip(streams) {
                row.copy_from_slice(&to_bytes(stream));
            }
            self.file.write_all_at(&all, 0)
        };
        self.is_ours = written.is_ok();
        if let Err(error) = written
            && !std::mem::replace(&mut self.has_failed, true)
        {
            tracing::warn!("the stamps of others are not kept for a restart: {error}");
        }
    }
}

impl Drop for SenderFile {
    fn drop(&mut self) {
        if self.is_ours
            && let Some(copy) = &self.copy
            && let Err(error) = std::fs::copy(&self.path, copy)
        {
            tracing::warn!("{}: the stamps of others are not kept: {error}", copy.display());
        }
    }
}

fn to_bytes(stream: &SignedStream) -> [u8; ROW_BYTES] {
    let mut row = [0; ROW_BYTES];
    row[..8].copy_from_slice(&stream.stamp.to_le_bytes());
    row[8..12].copy_from_slice(&stream.system_id.to_le_bytes());
    row[12..15].copy_from_slice(&[stream.component_id, stream.link_id, USED]);
    row
}

fn of_bytes(row: &[u8]) -> Option<SignedStream> {
    let row: &[u8; ROW_BYTES] = row.try_into().ok()?;
    let (stamp, rest) = row.split_first_chunk::<8>()?;
    let (system_id, rest) = rest.split_first_chunk::<4>()?;
    let &[component_id, link_id, USED, _] = rest else {
        return None;
    };
    Some(SignedStream {
        system_id: u32::from_le_bytes(*system_id),
        component_id,
        link_id,
        stamp: u64::from_le_bytes(*stamp),
    })
}
