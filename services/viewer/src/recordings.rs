//! Recordings of the folder of `[recorder]`, to be listed and downloaded.

use serde::Serialize;
use std::fs::File;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::SystemTime;

/// Most recordings that are listed, the newest ones.
const LISTED_MAX: usize = 200;
/// How a recording's name ends.
const ENDING: &str = ".mcap";

/// A recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Listed {
    /// Name of its file.
    pub name: String,
    /// Its size (bytes).
    pub bytes: u64,
    /// Time since it was written last (s).
    pub age_s: f64,
}

/// The recordings in `folder`, the newest first.
pub fn list(folder: Option<&Path>) -> Vec<Listed> {
    let entries = folder.and_then(|folder| std::fs::read_dir(folder).ok());
    let now = SystemTime::now();
    let mut listed: Vec<Listed> = entries
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| {
            let name = entry
                .file_name()
                .into_string()
                .ok()
                .filter(|name| is_name(name))?;
            let found = entry.metadata().ok().filter(std::fs::Metadata::is_file)?;
            let written = found.modified().ok()?;
            Some(Listed {
                name,
                bytes: found.len(),
                age_s: now.duration_since(written).unwrap_or_default().as_secs_f64(),
            })
        })
        .collect();
    listed.sort_by(|one, other| one.age_s.total_cmp(&other.age_s));
    listed.truncate(LISTED_MAX);
    listed
}

/// The recording called `name` in `folder` and its size; `None` of anything else, wherever the name leads.
pub fn open(folder: &Path, name: &str) -> Option<(File, u64)> {
    if !is_name(name) {
        return None;
    }
    // A link may lead anywhere, and a pipe would never end.
    let flags = rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK;
    let file = File::options()
        .read(true)
        .custom_flags(flags.bits().cast_signed())
        .open(folder.join(name))
        .ok()?;
    let found = file.metadata().ok().filter(std::fs::Metadata::is_file)?;
    Some((file, found.len()))
}

/// Whether it can be the name of a recording: in the folder itself, and not hidden.
fn is_name(name: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    name.ends_with(ENDING) && !name.starts_with('.') && name.chars().all(is_plain)
}

#[cfg(test)]
mod tests {
    use super::{is_name, list, open};

    #[test]
    fn nothing_but_recordings_of_the_folder_is_given_away() {
        let folder = std::env::temp_dir().join(format!("jink_viewer_recordings_{}", std::process::id()));
        std::fs::create_dir_all(folder.join("folder.mcap")).unwrap();
        std::fs::write(folder.join("jink-1-1.mcap"), "flight").unwrap();
        std::fs::write(folder.join("secret.txt"), "secret").unwrap();
        std::os::unix::fs::symlink(folder.join("secret.txt"), folder.join("link.mcap")).unwrap();
        let names: Vec<String> = list(Some(&folder))
            .into_iter()
            .map(|listed| listed.name)
            .collect();
        assert_eq!(names, ["jink-1-1.mcap"]);
        assert_eq!(open(&folder, "jink-1-1.mcap").unwrap().1, 6);
        for name in [
            "secret.txt",
            "link.mcap",
            "folder.mcap",
            "../x.mcap",
            "..%2fx.mcap",
            "",
            ".mcap",
        ] {
            assert!(open(&folder, name).is_none(), "{name}");
        }
        assert!(!is_name("a/b.mcap") && !is_name("a\\b.mcap") && list(None).is_empty());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
