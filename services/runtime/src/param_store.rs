//! Changed parameters outlive the process that changed them: a small TOML file on top of `jink.toml`.
//!
//! | where | kept |
//! |---|---|
//! | `param_store = "/var/lib/jink/parameters.toml"` in `jink.toml` | over power cycles |
//! | not given: `parameters.toml` in the instance's folder, on tmpfs | while the instance is up |
//!
//! Rows that take effect after a restart are in force as they were when jink came up ([`ParamStore::begin_run`]): a service that is
//! started again, or another program in its place, works on with what the others have.
//!
//! The file holds only what differs from the configuration. It is written beside its place, synchronised and renamed, so
//! that a reader finds the old file or the new one and never half of one; and by a thread of its own, because a memory card
//! may take longer for that than a setpoint may wait. A file that cannot be read is moved aside and reported once: no
//! stored value is worth a vehicle that does not start.

use crate::config::Config;
use crate::instance::Instance;
use crate::realtime::{self, Scheduling};
use jink_shared_types::params::{Apply, Param, ParamError, ParamSet};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fmt::{self, Write as _};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};

/// Appended to the name of a file that cannot be understood.
const ASIDE: &str = "broken";
/// Appended, after the writer's process id, to the name of a file that is being written.
const UNFINISHED: &str = "new";
/// Texts that wait for the disk: the one being written, and newer ones. When full, the next change says everything again.
const WAITING: usize = 8;
/// Stack of the thread (bytes): where memory is locked, all of it is touched when the thread begins.
const STACK_BYTES: usize = 128 * 1024;

/// Why a store is not, or not wholly, in force.
#[derive(Debug)]
pub enum StoreError {
    /// It is no list of numbers; it was moved to where `aside` says.
    Broken {
        /// The file.
        file: PathBuf,
        /// Where it is now.
        aside: PathBuf,
        /// What is wrong with it.
        cause: String,
    },
    /// It is there and cannot be read.
    Unreadable {
        /// The file.
        file: PathBuf,
        /// Why not.
        cause: io::Error,
    },
    /// One value is not taken; the others are.
    Refused {
        /// The file.
        file: PathBuf,
        /// Which, and why.
        cause: ParamError,
    },
}

impl fmt::Display for StoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Broken { file, aside, cause } => write!(
                f,
                "{}: stored parameters are not understood and not used, see {}: {cause}",
                file.display(),
                aside.display()
            ),
            Self::Unreadable { file, cause } => {
                write!(f, "{}: stored parameters are not used: {cause}", file.display())
            }
            Self::Refused { file, cause } => {
                write!(f, "{}: a stored parameter is not used: {cause}", file.display())
            }
        }
    }
}
impl std::error::Error for StoreError {}

/// The file, and what it lies on top of.
#[derive(Clone, Debug)]
pub struct ParamStore {
    file: PathBuf,
    /// The same as it was when the instance came up.
    at_start: PathBuf,
    configured: ParamSet,
}

impl ParamStore {
    /// The store of `instance` over `config`, before anything of it has been applied.
    pub fn of(config: &Config, instance: &Instance) -> Self {
        Self {
            file: config
                .param_store
                .clone()
                .unwrap_or_else(|| instance.param_store()),
            at_start: instance.params_at_start(),
            configured: config.params.clone(),
        }
    }

    /// The stored values over the configured ones, and what could not be used. A file that is not there is an empty one.
    pub fn load(&self) -> (ParamSet, Vec<StoreError>) {
        let mut set = self.configured.clone();
        let mut refused = Vec::new();
        match std::fs::read_to_string(&self.file) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => {}
            // What is not even text is broken like what is no TOML.
            Err(cause) if cause.kind() == io::ErrorKind::InvalidData => {
                refused.extend(self.move_aside(cause.to_string()));
            }
            Err(cause) => refused.push(StoreError::Unreadable {
                file: self.file.clone(),
                cause,
            }),
            Ok(text) => match toml::from_str::<BTreeMap<String, f64>>(&text) {
                Err(cause) => refused.extend(self.move_aside(cause.message().replace('\n', " "))),
                Ok(stored) => {
                    for (name, value) in stored {
                        if let Err(cause) = set.set(&name, value) {
                            let file = self.file.clone();
                            refused.push(StoreError::Refused { file, cause });
                        }
                    }
                    // The configuration has changed below them: its own values fit together.
                    let reversed: Vec<ParamError> = set.reversed().collect();
                    for cause in reversed {
                        if let ParamError::Reversed { low, high } = &cause {
                            for name in [low.0, high.0] {
                                let configured = self.configured.named(name);
                                configured.map(|value| set.set(name, value)).transpose().ok();
                            }
                        }
                        let file = self.file.clone();
                        refused.push(StoreError::Refused { file, cause });
                    }
                }
            },
        }
        (set, refused)
    }

    /// The instance comes up: the values that are stored now are those that need a restart work with until it ends.
    ///
    /// # Errors
    /// The system's error about the file.
    pub fn begin_run(&self) -> io::Result<()> {
        write_atomically(&self.at_start, &self.text(&self.load().0))
    }

    /// The values that a process is to work with, and what of the store could not be used: those of rows that need a restart as they
    /// were when the instance came up, where it did.
    pub fn in_force(&self) -> (ParamSet, Vec<StoreError>) {
        let (mut set, refused) = self.load();
        let text = std::fs::read_to_string(&self.at_start).ok();
        let Some(stored) = text.and_then(|text| toml::from_str::<BTreeMap<String, f64>>(&text).ok()) else {
            return (set, refused);
        };
        let needs_restart = |row: &Param| row.apply == Apply::Restart;
        for (row, configured) in self.configured.rows().filter(|(row, _)| needs_restart(row)) {
            // Both were taken by this table before.
            let _taken = set.set(row.name, stored.get(row.name).copied().unwrap_or(configured));
        }
        (set, refused)
    }

    /// `None` if another process was faster: it has reported already.
    fn move_aside(&self, cause: String) -> Option<StoreError> {
        let aside = self.file.with_extension(ASIDE);
        std::fs::rename(&self.file, &aside).ok()?;
        Some(StoreError::Broken {
            file: self.file.clone(),
            aside,
            cause,
        })
    }

    /// What the file must say for `set` to be in force.
    fn text(&self, set: &ParamSet) -> String {
        let mut text =
            String::from("# Parameters changed while jink was running; they lie over those of jink.toml.\n");
        for (row, value) in set.rows() {
            if value != self.configured.get(row) {
                // Writing to a string does not fail. `{:?}` keeps the point that makes it a float.
                let _always = writeln!(text, "{} = {value:?}", row.name);
            }
        }
        text
    }

    /// Writes what differs from the configuration, by a thread of its own that is started at the first change.
    pub fn writer(self) -> StoreWriter {
        StoreWriter {
            store: self,
            thread: None,
        }
    }
}

/// Replaces `file` so that it is never seen half written, not even after a power failure.
fn write_atomically(file: &Path, text: &str) -> io::Result<()> {
    let folder = file.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    remove_unfinished(file, folder);
    let beside = file.with_extension(format!("{}.{UNFINISHED}", std::process::id()));
    let written = (|| {
        let mut new = std::fs::File::create(&beside)?;
        new.write_all(text.as_bytes())?;
        new.sync_all()?;
        std::fs::rename(&beside, file)
    })();
    if written.is_err() {
        // The first error is the one that counts.
        let _not_there = std::fs::remove_file(&beside);
        return written;
    }
    // Without this the new name may be lost with the power.
    std::fs::File::open(folder)?.sync_all()
}

/// Removes what writers that were killed have left beside `file`: their process ids are those of nobody.
fn remove_unfinished(file: &Path, folder: &Path) {
    let name = file.file_stem().unwrap_or_default();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let writer = path
            .file_stem()
            .map(Path::new)
            .filter(|stem| stem.file_stem() == Some(name));
        let pid = writer.and_then(Path::extension).and_then(OsStr::to_str);
        let pid = pid.and_then(|pid| pid.parse::<u32>().ok());
        let is_gone = pid.is_some_and(|pid| !Path::new(&format!("/proc/{pid}")).exists());
        if is_gone && path.extension() == Some(OsStr::new(UNFINISHED)) {
            // What cannot be removed is in nobody's way.
            let _stays = std::fs::remove_file(path);
        }
    }
}

/// Saves without making anybody wait.
#[derive(Debug)]
pub struct StoreWriter {
    store: ParamStore,
    thread: Option<(SyncSender<String>, Receiver<io::Result<()>>)>,
}

impl StoreWriter {
    /// Has `set` written. What could not be written is reported by [`Self::failure`].
    ///
    /// # Errors
    /// If the thread cannot be started, or the disk hangs behind as many changes as may wait.
    pub fn save(&mut self, set: &ParamSet) -> io::Result<()> {
        let text = self.store.text(set);
        if self.thread.is_none() {
            self.thread = Some(self.start()?);
        }
        let hangs = || io::Error::new(io::ErrorKind::WouldBlock, "the disk does not keep up");
        match &self.thread {
            Some((texts, _)) => texts.try_send(text).map_err(|_| hangs()),
            None => Err(hangs()),
        }
    }

    /// Why a change could not be written, once per failure.
    pub fn failure(&mut self) -> Option<io::Error> {
        let (_, answers) = self.thread.as_ref()?;
        loop {
            match answers.try_recv() {
                Ok(Ok(())) => {}
                Ok(Err(error)) => return Some(error),
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => return None,
            }
        }
    }

    fn start(&self) -> io::Result<(SyncSender<String>, Receiver<io::Result<()>>)> {
        let (texts, to_write) = sync_channel::<String>(WAITING);
        let (answer, answers) = sync_channel(WAITING);
        let file = self.store.file.clone();
        std::thread::Builder::new()
            .name("param_store".to_owned())
            .stack_size(STACK_BYTES)
            .spawn(move || {
                // It has inherited the priority of whoever flies.
                let _at_its_own = realtime::schedule(0, Scheduling::Ordinary);
                while let Ok(mut text) = to_write.recv() {
                    while let Ok(newer) = to_write.try_recv() {
                        text = newer;
                    }
                    // Nobody asks any more: the answers that count are the first ones.
                    let _unread = answer.try_send(write_atomically(&file, &text));
                }
            })?;
        Ok((texts, answers))
    }
}

#[cfg(test)]
mod tests {
    use super::{ParamStore, StoreError, write_atomically};
    use crate::config::Config;
    use jink_shared_types::params::{OA_ALT_MAX, OA_GOAL_RAD, OA_SPD_MAX, OA_VEH_RADIUS, ParamSet, TABLE};
    use proptest::prelude::*;
    use std::path::PathBuf;

    /// A folder of its own that is removed again.
    struct Folder(PathBuf);

    impl Folder {
        fn new(test: &str) -> Self {
            Self(std::env::temp_dir().join(format!("jink_store_{test}_{}", std::process::id())))
        }

        fn store(&self) -> ParamStore {
            let config = Config {
                param_store: Some(self.0.join("deep/parameters.toml")),
                ..Config::default()
            };
            ParamStore::of(&config, &"any".parse().unwrap())
        }

        fn write(&self, bytes: &[u8]) -> ParamStore {
            let store = self.store();
            std::fs::create_dir_all(store.file.parent().unwrap()).unwrap();
            std::fs::write(&store.file, bytes).unwrap();
            store
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _never_made = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn only_what_differs_from_the_configuration_is_kept() {
        let folder = Folder::new("differs");
        let mut store = folder.store();
        assert!(store.configured.set("OA_ALT_MAX", 50.0).is_ok());
        let mut set = store.configured.clone();
        assert!(set.set("OA_SPD_MAX", 4.0).is_ok());
        write_atomically(&store.file, &store.text(&set)).unwrap();
        // Meanwhile somebody has changed the configuration.
        assert!(store.configured.set("OA_ALT_MAX", 60.0).is_ok());
        assert!(store.configured.set("OA_SPD_MAX", 2.0).is_ok());
        let (loaded, refused) = store.load();
        assert_eq!((loaded.get(&OA_SPD_MAX), loaded.get(&OA_ALT_MAX)), (4.0, 60.0));
        assert!(refused.is_empty(), "{refused:?}");
        let left: Vec<_> = std::fs::read_dir(store.file.parent().unwrap()).unwrap().collect();
        assert_eq!(left.len(), 1, "{left:?}");
    }

    #[test]
    fn a_row_that_needs_a_restart_keeps_its_value_until_jink_comes_up_again() {
        let folder = Folder::new("at_start");
        let mut store = folder.store();
        store.at_start = folder.0.join("at_start.toml");
        let change = |store: &ParamStore, radius_m: f64, speed_mps: f64| {
            let mut set = store.configured.clone();
            set.set("OA_VEH_RADIUS", radius_m).unwrap();
            set.set("OA_SPD_MAX", speed_mps).unwrap();
            write_atomically(&store.file, &store.text(&set)).unwrap();
        };
        let in_force = |store: &ParamStore| {
            let (set, refused) = store.in_force();
            assert!(refused.is_empty(), "{refused:?}");
            (set.get(&OA_VEH_RADIUS), set.get(&OA_SPD_MAX))
        };
        change(&store, 0.5, 2.0);
        assert_eq!(in_force(&store), (0.5, 2.0), "nobody has begun a run");
        store.begin_run().unwrap();
        change(&store, 0.1, 4.0);
        assert_eq!(in_force(&store), (0.5, 4.0), "one service is started again");
        change(&store, OA_VEH_RADIUS.default, 4.0);
        assert_eq!(
            in_force(&store),
            (0.5, 4.0),
            "back to what is configured, for later"
        );
        change(&store, 0.1, 4.0);
        store.begin_run().unwrap();
        assert_eq!(in_force(&store), (0.1, 4.0), "jink has come up again");
    }

    #[test]
    fn a_broken_file_is_reported_once_moved_aside_and_never_fatal() {
        let folder = Folder::new("broken");
        for bytes in [&b"OA_SPD_MAX = "[..], &b"\xff\xfe\x00"[..], &b"[a]\nb = 1"[..]] {
            let store = folder.write(bytes);
            let (set, refused) = store.load();
            assert_eq!(set, store.configured);
            let [StoreError::Broken { aside, .. }] = &refused[..] else {
                panic!("{refused:?}");
            };
            assert_eq!(std::fs::read(aside).unwrap(), bytes);
            let (_, again) = store.load();
            assert!(again.is_empty(), "{again:?}");
        }
    }

    #[test]
    fn stored_values_that_contradict_a_new_configuration_give_way_to_it() {
        let folder = Folder::new("reversed");
        let mut store = folder.write(b"OA_ALT_MIN = 40.0\nOA_GOAL_RAD = 0.5\n");
        store.configured.set("OA_ALT_MAX", 30.0).unwrap();
        let (set, refused) = store.load();
        assert_eq!((set.get(&OA_ALT_MAX), set.get(&OA_GOAL_RAD)), (30.0, 0.5));
        assert_eq!(set.reversed().count(), 0);
        assert!(
            refused[0]
                .to_string()
                .ends_with("OA_ALT_MIN = 40 is above OA_ALT_MAX = 30"),
            "{refused:?}"
        );
    }

    #[test]
    fn a_value_that_is_no_longer_allowed_does_not_spoil_the_others() {
        let folder = Folder::new("refused");
        let store = folder.write(b"GONE = 1.0\nOA_SPD_MAX = 99.0\nOA_GOAL_RAD = 0.5\n");
        let (set, refused) = store.load();
        assert_eq!(set.get(&OA_GOAL_RAD), 0.5);
        assert_eq!(set.get(&OA_SPD_MAX), OA_SPD_MAX.default);
        assert_eq!(refused.len(), 2);
    }

    #[test]
    fn the_writer_ends_with_the_newest_values_on_disk() {
        let folder = Folder::new("writer");
        let store = folder.store();
        let mut writer = store.clone().writer();
        let mut set = ParamSet::default();
        for i in 0..200 {
            set.set("OA_SPD_MAX", 1.0 + f64::from(i) / 100.0).unwrap();
            // A disk that does not keep up is tried again.
            while writer.save(&set).is_err() {
                std::thread::yield_now();
            }
        }
        while store.load().0 != set {
            std::thread::yield_now();
        }
        assert!(writer.failure().is_none());
    }

    #[test]
    fn what_killed_writers_have_left_goes_with_the_next_change() {
        let folder = Folder::new("unfinished");
        let store = folder.store();
        let beside = |name: &str| store.file.with_file_name(name);
        std::fs::create_dir_all(store.file.parent().unwrap()).unwrap();
        let mut child = std::process::Command::new("true").spawn().unwrap();
        child.wait().unwrap();
        let left = beside(&format!("parameters.{}.new", child.id()));
        let others = [
            beside(&format!("parameters.{}.new", 1)),
            beside(&format!("other.{}.new", child.id())),
            beside("parameters.new"),
            beside(&format!("parameters.{}.toml", child.id())),
        ];
        for file in others.iter().chain([&left]) {
            std::fs::write(file, "half").unwrap();
        }
        write_atomically(&store.file, "").unwrap();
        assert!(!left.exists());
        assert!(others.iter().all(|file| file.exists()), "they are somebody's");
    }

    #[test]
    fn what_cannot_be_written_is_reported() {
        let folder = Folder::new("failure");
        let store = folder.write(b"");
        let in_the_way = ParamStore {
            file: store.file.join("parameters.toml"),
            ..store
        };
        let mut writer = in_the_way.writer();
        writer.save(&ParamSet::default()).unwrap();
        while writer.failure().is_none() {
            std::thread::yield_now();
        }
    }

    proptest! {
        #[test]
        fn every_value_survives_the_file(shares in proptest::collection::vec(0.0..=1.0f64, TABLE.len())) {
            let folder = Folder::new("survives");
            let store = folder.store();
            let mut set = ParamSet::default();
            for (row, share) in TABLE.iter().zip(shares) {
                let value = row.min + share * (row.max - row.min);
                // Rows of whole numbers refuse most of them, and ends of spans what is beyond the other end: they keep their default.
                let _refused = set.change(row.name, value);
            }
            write_atomically(&store.file, &store.text(&set)).unwrap();
            prop_assert_eq!(store.load().0, set);
        }

        #[test]
        fn no_file_at_all_makes_a_start_fail(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let folder = Folder::new("garbage");
            let (set, _) = folder.write(&bytes).load();
            for (row, value) in set.rows() {
                prop_assert!((row.min..=row.max).contains(&value));
            }
        }
    }
}
