//! Removes what dead processes left in an instance's memory, also what iceoryx2 by itself does not.
//!
//! A process killed within its first milliseconds leaves a node that is dead and has no details yet: its clean-up
//! reports for ever that somebody else has done it (iceoryx2 0.10, issues 1252, 1702, 1967), its files stay, and every
//! later start looks at them. Such nodes, and folders of nodes without anything that would show whether they live, are
//! removed here by their files' names.

use crate::instance::Instance;
use iceoryx2::node::{NodeCleanupFailure, NodeState, NodeView};
use iceoryx2::prelude::{CallbackProgression, Node, ipc};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

/// A node without signs of life or death is being created, or its creator was killed at it: creation takes a
/// millisecond, on a disk a tenth of a second.
pub const BEING_CREATED: Duration = Duration::from_secs(10);

/// What was removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Swept {
    /// Dead nodes that iceoryx2 has cleaned up after.
    pub cleaned: u32,
    /// Dead nodes that it never would have.
    pub zombies: u32,
    /// What is still there: dead, and not to be removed now.
    pub left: u32,
}

/// Removes all that is dead in `instance`. Takes milliseconds, on a busy machine seconds: iceoryx2 lists all shared memory of the host
/// for each port of a dead node.
pub fn sweep(instance: &Instance) -> Swept {
    let mut swept = Swept::default();
    let Some(config) = instance.iceoryx_config() else {
        return swept;
    };
    let mut known = BTreeSet::new();
    let mut zombies = Vec::new();
    // A list that cannot be read is read at the next sweep.
    let _next_time = Node::<ipc::Service>::list(&config, |node| {
        let id = node.node_id().value();
        known.insert(id);
        if let NodeState::Dead(dead) = node {
            let is_bare = dead.details().is_none();
            match dead.try_remove_stale_resources() {
                Ok(()) => swept.cleaned += 1,
                Err(NodeCleanupFailure::ResourcesAlreadyCleanedUp) if is_bare => zombies.push(id),
                Err(_) => swept.left += 1,
            }
        }
        CallbackProgression::Continue
    });
    let files = files_by_node(instance);
    for (id, paths) in &files {
        let abandoned = !known.contains(id) && paths.iter().all(is_old);
        if zombies.contains(id) || abandoned {
            swept.zombies += 1;
            for path in paths {
                // What is gone already needs no removing.
                let _gone = match path.is_dir() {
                    true => std::fs::remove_dir_all(path),
                    false => std::fs::remove_file(path),
                };
            }
        }
    }
    swept
}

/// Every file and folder that belongs to a node: `<id>/` with its details and `<prefix><id>.node_monitor*`.
fn files_by_node(instance: &Instance) -> BTreeMap<u128, Vec<PathBuf>> {
    let mut files: BTreeMap<u128, Vec<PathBuf>> = BTreeMap::new();
    let prefix = instance.shm_prefix();
    let Ok(entries) = std::fs::read_dir(instance.iceoryx_root().join("nodes")) else {
        return files;
    };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let id = name.to_str().and_then(|name| {
            let digits = name.strip_prefix(&prefix).unwrap_or(name);
            digits.split('.').next()?.parse().ok()
        });
        if let Some(id) = id {
            files.entry(id).or_default().push(entry.path());
        }
    }
    files
}

fn is_old(path: &PathBuf) -> bool {
    let modified = std::fs::metadata(path).and_then(|data| data.modified());
    modified.is_ok_and(|time| {
        SystemTime::now()
            .duration_since(time)
            .is_ok_and(|age| age > BEING_CREATED)
    })
}

/// Nodes of `instance` that have left traces, alive or dead: for tests and figures.
pub fn node_count(instance: &Instance) -> usize {
    files_by_node(instance).len()
}
