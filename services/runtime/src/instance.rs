//! Names and folders of one jink: two instances on one host never meet.
//!
//! Shared memory gets a prefix of its own, iceoryx2's files a root of their own, both on tmpfs: service and node
//! creation costs some 17 `fsync`, which a disk makes ten times slower than memory.

use crate::room::SHARED_MEMORY;
use iceoryx2::prelude::{Config, FileName, Path, SemanticString};
use std::fmt;
use std::io::{Error, ErrorKind};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
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

/// Less room than this (bytes) is none: a service that fails again and again writes that within a minute.
const LOG_ROOM_BYTES: u64 = 1 << 18;

/// Where the folders of all instances are.
const ROOT: &str = SHARED_MEMORY;
/// Rights of an instance's folder: its user's.
const PRIVATE_FOLDER: u32 = 0o700;
/// Rights of group and others, and among them those to write.
const OTHERS: u32 = 0o077;
const OTHERS_WRITE: u32 = 0o022;
/// Begins the name of each.
const FOLDER_PREFIX: &str = "jink_";

impl Instance {
    /// The instance's own folder on tmpfs.
    pub fn folder(&self) -> PathBuf {
        PathBuf::from(format!("{ROOT}/{FOLDER_PREFIX}{}", self.name))
    }

    /// Makes the instance's folder, into which no other user looks; one that is there already must be such.
    ///
    /// # Errors
    /// It is another user's, others may write to it, or it is no folder: who had made it could choose the programs that this user runs.
    pub fn make_folder(&self) -> std::io::Result<()> {
        let folder = self.folder();
        match std::fs::DirBuilder::new().mode(PRIVATE_FOLDER).create(&folder) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            other => return other,
        }
        let found = std::fs::symlink_metadata(&folder)?;
        let us = rustix::process::geteuid().as_raw();
        let why = if !found.is_dir() {
            "is no folder".to_owned()
        } else if found.uid() != us {
            format!("belongs to the user with id {}, and this is {us}", found.uid())
        } else if found.mode() & OTHERS_WRITE != 0 {
            "can be written by other users".to_owned()
        } else if found.mode() & OTHERS != 0 {
            return std::fs::set_permissions(folder, PermissionsExt::from_mode(PRIVATE_FOLDER));
        } else {
            return Ok(());
        };
        Err(Error::new(
            ErrorKind::PermissionDenied,
            format!("{} {why}; remove it, or use another --instance", folder.display()),
        ))
    }

    /// Takes from other users what iceoryx2 gives them: a file that it makes for all users, in which a few bytes keep every program from
    /// starting. Who has opened it before has a file that nobody uses any more.
    pub(crate) fn close_to_others(&self) -> std::io::Result<()> {
        for file in self.memory_files() {
            let is_open = file.extension().is_some_and(|end| end == "global_mgmt")
                && std::fs::symlink_metadata(&file).is_ok_and(|found| found.mode() & OTHERS != 0);
            if is_open {
                let copy = self.folder().join(format!("global_mgmt.{}", std::process::id()));
                let mut private = std::fs::File::options()
                    .create(true)
                    .truncate(true)
                    .write(true)
                    .mode(0o600)
                    .open(&copy)?;
                std::io::copy(&mut std::fs::File::open(&file)?, &mut private)?;
                std::fs::rename(&copy, &file)?;
            }
        }
        Ok(())
    }

    /// Files of shared memory that other users may open; empty as it should be.
    pub fn open_to_others(&self) -> Vec<PathBuf> {
        let is_open =
            |path: &PathBuf| std::fs::symlink_metadata(path).is_ok_and(|found| found.mode() & OTHERS != 0);
        self.memory_files()
            .chain([self.folder()])
            .filter(is_open)
            .collect()
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

    /// Which run has the shared memory now; its folder is made anew for each. `None` if there is none.
    pub fn run(&self) -> Option<u64> {
        Some(std::fs::metadata(self.iceoryx_root()).ok()?.ino())
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

    /// Where the gateway keeps the last stamp of each signed sender, for the next gateway: of the same run, or of a new start.
    pub fn signed_senders(&self) -> PathBuf {
        self.folder().join("mavlink_gateway.senders")
    }

    /// Where the parameters are kept as they were when the instance came up.
    pub fn params_at_start(&self) -> PathBuf {
        self.folder().join("parameters_at_start.toml")
    }

    /// Where the processes' logs are, in memory.
    pub fn log_folder(&self) -> PathBuf {
        self.folder().join("log")
    }

    /// A link to the folder on a disk to which they are carried, where there is one ([`crate::spool`]).
    pub fn log_on_disk(&self) -> PathBuf {
        self.folder().join("log_on_disk")
    }

    /// A link to the file that the recorder writes, or has written last.
    pub fn recording(&self) -> PathBuf {
        self.folder().join("recording")
    }

    /// The address of the live page, in a file.
    pub fn viewer_address(&self) -> PathBuf {
        self.folder().join("viewer.address")
    }

    /// The token of the live page, where the configuration names no file of its own.
    pub fn viewer_token(&self) -> PathBuf {
        self.folder().join("viewer.token")
    }

    /// A file that is made to ask the recorder to keep the last seconds.
    pub fn recording_asked(&self) -> PathBuf {
        self.folder().join("recording.asked")
    }

    /// Where people find the logs: on the disk, or else in memory.
    pub fn log_place(&self) -> PathBuf {
        self.log_on_disk()
            .canonicalize()
            .unwrap_or_else(|_| self.log_folder())
    }

    /// Where files wait that are wanted on a disk ([`crate::spool`]).
    pub fn spool(&self) -> PathBuf {
        self.folder().join("spool")
    }

    /// A file that is there while the recorder cannot carry the logs to their disk.
    pub fn logs_lost(&self) -> PathBuf {
        self.spool().join("logs.lost")
    }

    /// Whether there is room in memory for the logs.
    pub fn logs_have_room(&self) -> bool {
        let free = rustix::fs::statvfs(self.log_folder()).map(|system| system.f_bavail * system.f_frsize);
        free.is_ok_and(|bytes| bytes >= LOG_ROOM_BYTES)
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

    /// Every file of shared memory with this prefix.
    pub(crate) fn memory_files(&self) -> impl Iterator<Item = PathBuf> {
        let prefix = self.shm_prefix();
        let entries = std::fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
        entries
            .filter(move |entry| {
                let name = entry.file_name();
                name.to_str().is_some_and(|name| name.starts_with(&prefix))
            })
            .filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file()))
            .map(|entry| entry.path())
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

    /// Removes everything this instance left in memory, but the stamps of signatures: what they forbid to play back stays forbidden. Only
    /// for when nobody of it is alive.
    ///
    /// # Errors
    /// The first file that could not be removed.
    pub fn wipe(&self) -> std::io::Result<()> {
        for folder in [
            self.run_config(),
            self.iceoryx_root(),
            self.log_folder(),
            self.spool(),
        ] {
            // A command that looks at the instance may be making files in it: in a folder of another name it makes none.
            let aside = folder.with_extension("gone");
            unless_gone(&aside, std::fs::remove_dir_all(&aside))?;
            unless_gone(&folder, std::fs::rename(&folder, &aside))?;
            unless_gone(&aside, std::fs::remove_dir_all(&aside))?;
        }
        // The values of an earlier run would lie over those that this one was started with, and its autopilot was another.
        for file in [
            self.param_store(),
            self.params_at_start(),
            self.proven_profile(),
            self.flight_record(),
            self.log_on_disk(),
            self.viewer_address(),
            self.viewer_token(),
        ] {
            unless_gone(&file, std::fs::remove_file(&file))?;
        }
        for file in self.memory_files() {
            unless_gone(&file, std::fs::remove_file(&file))?;
        }
        Ok(())
    }
}

/// A file or folder that is not there counts as removed; of any other it is said whose it is.
fn unless_gone(path: &std::path::Path, done: std::io::Result<()>) -> std::io::Result<()> {
    let Err(error) = done else { return Ok(()) };
    if error.kind() == ErrorKind::NotFound {
        return Ok(());
    }
    let owner = std::fs::symlink_metadata(path).map(|found| found.uid());
    let whose = match owner {
        Ok(owner) if owner != rustix::process::geteuid().as_raw() => {
            format!("; it belongs to the user with id {owner}")
        }
        _ => String::new(),
    };
    let text = format!("{} cannot be removed: {error}{whose}", path.display());
    Err(Error::new(error.kind(), text))
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
    fn a_folder_is_made_for_its_user_alone_and_one_of_others_is_refused() {
        use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
        let instance: Instance = format!("private_{}", std::process::id()).parse().unwrap();
        let folder = instance.folder();
        let mode = || std::fs::symlink_metadata(&folder).unwrap().mode() & 0o777;
        instance.make_folder().unwrap();
        instance.make_folder().unwrap();
        assert_eq!(mode(), 0o700);
        let set = |mode| std::fs::set_permissions(&folder, PermissionsExt::from_mode(mode)).unwrap();
        // What others may only read is closed, in what they may write they may have written.
        set(0o755);
        instance.make_folder().unwrap();
        assert_eq!(mode(), 0o700);
        for written in [0o720, 0o702] {
            set(written);
            let refused = instance.make_folder().unwrap_err().to_string();
            assert!(refused.contains("can be written by other users"), "{refused}");
        }
        std::fs::remove_dir(&folder).unwrap();
        symlink("/tmp", &folder).unwrap();
        let refused = instance.make_folder().unwrap_err().to_string();
        assert!(refused.contains("is no folder"), "{refused}");
        std::fs::remove_file(&folder).unwrap();
        if !rustix::process::geteuid().is_root() {
            eprintln!("NOT TESTED: only root can make a folder of another user");
            return;
        }
        instance.make_folder().unwrap();
        std::os::unix::fs::chown(&folder, Some(65_534), None).unwrap();
        let refused = instance.make_folder().unwrap_err().to_string();
        assert!(refused.contains("belongs to the user with id 65534"), "{refused}");
        std::fs::remove_dir(&folder).unwrap();
    }

    #[test]
    fn what_signatures_forbid_outlives_a_new_start() {
        let instance: Instance = format!("stamps_{}", std::process::id()).parse().unwrap();
        instance.make_folder().unwrap();
        let (kept, wiped) = (instance.signed_senders(), instance.proven_profile());
        for file in [&kept, &wiped] {
            std::fs::write(file, "of the run before").unwrap();
        }
        instance.wipe().unwrap();
        assert!(kept.exists() && !wiped.exists());
        std::fs::remove_dir_all(instance.folder()).unwrap();
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
