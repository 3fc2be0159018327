//! Builds named in a file, so that nobody need type paths: `tests/real_autopilots/builds.toml`, which is not part of the project.
//!
//! ```toml
//! px4-2021 = "/home/me/PX4-2021"
//! px4 = "/home/me/PX4-Autopilot"
//! ardupilot = "/home/me/ardupilot"
//! ```

use crate::autopilot::Build;
use crate::setup::Autopilot;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where the file would be.
pub fn file() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("builds.toml")
}

/// The builds it names; none without the file.
///
/// # Errors
/// A key that is no autopilot, or a folder without a build.
pub fn configured() -> Result<BTreeMap<Autopilot, Build>, String> {
    let Ok(text) = std::fs::read_to_string(file()) else {
        return Ok(BTreeMap::new());
    };
    let named: BTreeMap<String, PathBuf> =
        toml::from_str(&text).map_err(|error| format!("{}: {error}", file().display()))?;
    let mut builds = BTreeMap::new();
    for (name, folder) in named {
        let autopilot = Autopilot::ALL
            .into_iter()
            .find(|autopilot| autopilot.option() == name);
        let autopilot = autopilot.ok_or_else(|| {
            format!(
                "{}: {name} is no autopilot: px4-2021, px4, ardupilot",
                file().display()
            )
        })?;
        builds.insert(autopilot, Build::find(autopilot, &folder)?);
    }
    Ok(builds)
}
