//! The folder of a flight's instance, with its configuration file and its sockets.

use jink_runtime::Instance;
use jink_runtime::config::{CONFIG_FILE, PROCESS_FILE};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// The folder of an instance that is removed at the end.
pub(super) struct Folder(pub(super) Instance);

impl Folder {
    /// A new one with its configuration and its process table.
    pub(super) fn new(config: &str, table: &str) -> Result<Self, String> {
        static FLIGHTS: AtomicU32 = AtomicU32::new(0);
        let number = FLIGHTS.fetch_add(1, Ordering::Relaxed);
        let name = format!("ls{}_{number}", std::process::id());
        let folder = Self(name.parse().map_err(|error| format!("{error}"))?);
        let run_config = folder.0.run_config();
        std::fs::create_dir_all(&run_config)
            .and_then(|()| std::fs::write(run_config.join(CONFIG_FILE), config))
            .and_then(|()| std::fs::write(run_config.join(PROCESS_FILE), table))
            .map_err(|error| format!("{}: {error}", run_config.display()))?;
        Ok(folder)
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.0.folder().join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What is left is reported by whoever looks for left-overs.
        let _left = std::fs::remove_dir_all(self.0.folder());
    }
}

/// The address of a socket in the instance's folder.
pub(super) fn address(path: &Path) -> String {
    format!("unix:{}", path.display())
}
