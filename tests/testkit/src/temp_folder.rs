//! A folder for one test.

use std::ops::Deref;
use std::path::{Path, PathBuf};

/// A folder of its own that is removed again.
#[derive(Debug)]
pub struct TempFolder(PathBuf);

impl TempFolder {
    /// For the test called `name`, which no other test of the program is.
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("jink_{name}_{}", std::process::id()));
        let _from_an_earlier_run = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// Writes a file in it, and returns its path.
    pub fn write(&self, name: &str, content: &str) -> PathBuf {
        let path = self.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, content).unwrap();
        path
    }
}

impl Deref for TempFolder {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl Drop for TempFolder {
    fn drop(&mut self) {
        let _gone_already = std::fs::remove_dir_all(&self.0);
    }
}
