//! Names and folders of one jink: two instances on one host never meet.
//!
//! Shared memory gets a prefix of its own, iceoryx2's files a root of their own, both on tmpfs: service and node
//! creation costs some 17 `fsync`, which a disk makes ten times slower than memory.

use iceoryx2::prelude::{Config, FileName, Path, SemanticString};
use std::fmt;
use std::path::PathBuf;

/// Longest name of an instance. iceoryx2 wakes a process over a local socket called
/// `/dev/shm/jink_NAME/iox/jink_NAME-NUMBER.event`, and such a path has 107 bytes at most: with 22 twice in it, 32 digits are left
/// for the number, which has 30 to 31 in a process with a dozen ports.
const NAME_MAX: usize = 22;

/// One jink on this host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    name: String,
}

/// Why a name cannot be an instance's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadInstanceName {
    /// The refused name.
    pub name: String,
}

impl fmt::Display for BadInstanceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "instance name {:?}: use 1 to {NAME_MAX} lower-case letters, digits and underscores",
            self.name
        )
    }
}
impl std::error::Error for BadInstanceName {}

impl std::str::FromStr for Instance {
    type Err = BadInstanceName;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let fits = (1..=NAME_MAX).contains(&name.len());
        let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        if fits && name.chars().all(plain) {
            Ok(Self {
                name: name.to_owned(),
            })
        } else {
            Err(BadInstanceName {
                name: name.to_owned(),
            })
        }
    }
}

impl fmt::Display for Instance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

/// Where the folders of all instances are.
const ROOT: &str = "/dev/shm";
/// Begins the name of each.
const FOLDER_PREFIX: &str = "jink_";

impl Instance {
    /// The instance's own folder on tmpfs.
    pub fn folder(&self) -> PathBuf {
        PathBuf::from(format!("{ROOT}/{FOLDER_PREFIX}{}", self.name))
    }

    /// Every instance that has a folder, running or ended, in alphabetical order.
    ///
    /// # Errors
    /// What the system says about the folder of folders.
    pub fn all() -> std::io::Result<Vec<Self>> {
        let mut all: Vec<Self> = std::fs::read_dir(ROOT)?
            .flatten()
            .filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()))
            .filter_map(|entry| {
                entry
                    .file_name()
                    .to_str()?
                    .strip_prefix(FOLDER_PREFIX)?
                    .parse()
                    .ok()
            })
            .collect();
        all.sort_by(|one: &Self, other| one.name.cmp(&other.name));
        Ok(all)
    }

    /// Where iceoryx2 keeps its files.
    pub fn iceoryx_root(&self) -> PathBuf {
        self.folder().join("iox")
    }

    /// Where the configuration in force is kept while the instance is up.
    pub fn run_config(&self) -> PathBuf {
        self.folder().join("config")
    }

    /// Where changed parameters are kept while the instance is up, unless the configuration names another place.
    pub fn param_store(&self) -> PathBuf {
        self.folder().join("parameters.toml")
    }

    /// Where the gateway keeps which profile it has found to fit, for the next gateway of the same run.
    pub fn proven_profile(&self) -> PathBuf {
        self.folder().join("profile")
    }

    /// Where the gateway keeps what is flown, for a gateway that is started again in flight.
    pub fn flight_record(&self) -> PathBuf {
        self.folder().join("mavlink_gateway.flight")
    }

    /// Where the gateway keeps the last stamp of each signed sender, for the next gateway of the same run.
    pub fn signed_senders(&self) -> PathBuf {
        self.folder().join("mavlink_gateway.senders")
    }

    /// Where the parameters are kept as they were when the instance came up.
    pub fn params_at_start(&self) -> PathBuf {
        self.folder().join("parameters_at_start.toml")
    }

    /// Where the processes' logs are kept while the instance is up.
    pub fn log_folder(&self) -> PathBuf {
        self.folder().join("log")
    }

    /// The lock that says "up": held by the supervisor, its process id inside.
    pub fn lock_file(&self) -> PathBuf {
        self.folder().join("supervisor.pid")
    }

    /// Where the supervisor takes requests ([`crate::request`]).
    pub fn request_socket(&self) -> PathBuf {
        self.folder().join("request.sock")
    }

    /// Where process `name` passes what only one instance of it can have to the next one.
    pub fn handover_socket(&self, name: &str) -> PathBuf {
        self.folder().join(format!("{name}.handover"))
    }

    /// Where it is written down how process `name` ended last.
    pub fn post_mortem(&self, name: &str) -> PathBuf {
        self.log_folder().join(format!("{name}.end.json"))
    }

    /// Prefix of the names of shared memory objects. It ends in a character that no instance name has, so that no prefix
    /// begins another one.
    pub fn shm_prefix(&self) -> String {
        format!("jink_{}-", self.name)
    }

    /// iceoryx2's configuration for this instance. Workers never clean up after others: that belongs to the
    /// supervisor, after control has moved.
    pub(crate) fn iceoryx_config(&self) -> Option<Config> {
        let mut config = Config::default();
        let root = self.iceoryx_root();
        config
            .global
            .set_root_path(&Path::new(root.to_str()?.as_bytes()).ok()?);
        config.global.prefix = FileName::new(self.shm_prefix().as_bytes()).ok()?;
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        Some(config)
    }

    /// Removes everything this instance left in memory. Only for when nobody of it is alive.
    ///
    /// # Errors
    /// The first file that could not be removed.
    pub fn wipe(&self) -> std::io::Result<()> {
        for folder in [self.run_config(), self.iceoryx_root(), self.log_folder()] {
            // A command that looks at the instance may be making files in it: in a folder of another name it makes none.
            let aside = folder.with_extension("gone");
            unless_gone(std::fs::remove_dir_all(&aside))?;
            unless_gone(std::fs::rename(&folder, &aside))?;
            unless_gone(std::fs::remove_dir_all(&aside))?;
        }
        // The values of an earlier run would lie over those that this one was started with, and its autopilot was another.
        for file in [
            self.param_store(),
            self.params_at_start(),
            self.proven_profile(),
            self.flight_record(),
            self.signed_senders(),
        ] {
            unless_gone(std::fs::remove_file(file))?;
        }
        let prefix = self.shm_prefix();
        for entry in std::fs::read_dir("/dev/shm")?.flatten() {
            let ours = entry
                .file_name()
                .to_str()
                .is_some_and(|name| name.starts_with(&prefix));
            if ours && entry.file_type().is_ok_and(|kind| kind.is_file()) {
                unless_gone(std::fs::remove_file(entry.path()))?;
            }
        }
        Ok(())
    }
}

/// A file or folder that is not there counts as removed.
fn unless_gone(done: std::io::Result<()>) -> std::io::Result<()> {
    match done {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::{Instance, NAME_MAX};

    /// Bytes of a path in `sockaddr_un`, without the zero at its end.
    const SOCKET_PATH_MAX: usize = 107;

    #[test]
    fn a_name_that_would_leave_its_folder_is_refused() {
        for bad in [
            "",
            "..",
            "a/b",
            "A",
            "with space",
            "x".repeat(NAME_MAX + 1).as_str(),
        ] {
            assert!(bad.parse::<Instance>().is_err(), "{bad:?}");
        }
        assert!("default".parse::<Instance>().is_ok());
    }

    #[test]
    fn the_longest_name_leaves_room_for_the_sockets_of_its_processes() {
        let longest: Instance = "x".repeat(NAME_MAX).parse().unwrap();
        let socket = format!("{}9{:031}.event", longest.shm_prefix(), 0);
        let path = longest.iceoryx_root().join(socket);
        assert!(path.as_os_str().len() <= SOCKET_PATH_MAX, "{}", path.display());
    }

    #[test]
    fn two_instances_share_nothing() {
        let one: Instance = "one_2".parse().unwrap();
        let other: Instance = "one".parse().unwrap();
        assert_ne!(one.folder(), other.folder());
        assert_ne!(one.shm_prefix(), other.shm_prefix());
        assert!(!one.shm_prefix().starts_with(&other.shm_prefix()));
    }
}
