//! Instances of flights: each has one of its own.

use jink_control::{Problem, running};
use jink_runtime::Instance;
use std::time::SystemTime;

/// What their names begin with.
const PREFIX: &str = "demo_";

/// An instance that no other flight has; `suffix` distinguishes those of one process.
///
/// # Errors
/// The name is too long.
pub fn own(suffix: &str) -> Result<Instance, Problem> {
    let name = format!("{PREFIX}{}{suffix}", std::process::id());
    name.parse().map_err(|error| Problem::Other(format!("{error}")))
}

/// Removes what ended flights have left, but for the newest `kept` of them.
pub fn remove_old(kept: usize) {
    let Ok(all) = Instance::all() else { return };
    let flights = all.into_iter().filter(|one| one.to_string().starts_with(PREFIX));
    let mut ended: Vec<(SystemTime, Instance)> = flights
        .filter(running::has_ended)
        .filter_map(|one| Some((std::fs::metadata(one.folder()).ok()?.modified().ok()?, one)))
        .collect();
    ended.sort_by_key(|(changed, _)| std::cmp::Reverse(*changed));
    for (_, instance) in ended.into_iter().skip(kept) {
        // Of another user, or just removed by another flight.
        let _stays = std::fs::remove_dir_all(instance.folder());
    }
}
