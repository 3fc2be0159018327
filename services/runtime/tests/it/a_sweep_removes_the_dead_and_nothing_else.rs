//! What a sweep may remove: what belongs to a node of this instance, says nothing of being alive, and is too old to be a node that is
//! just being created.

use jink_runtime::cleanup::{self, BEING_CREATED};
use jink_runtime::{Instance, Session, now};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::{SampleHeader, topics};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// An instance of its own that leaves nothing behind.
struct Isolated(Instance);

impl Isolated {
    fn new(test: &str) -> Self {
        let instance: Instance = format!("rt_{test}_{}", std::process::id()).parse().unwrap();
        instance.make_folder().unwrap();
        Self(instance)
    }

    /// The files of a node without details that nobody knows: `age` old.
    fn remains(&self, id: u128, age: Duration) -> [PathBuf; 2] {
        let nodes = self.0.iceoryx_root().join("nodes");
        let folder = nodes.join(id.to_string());
        let monitor = nodes.join(format!("{}{id}.node_monitor", self.0.shm_prefix()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(&monitor, "").unwrap();
        for path in [&folder, &monitor] {
            made_older(path, age);
        }
        [folder, monitor]
    }
}

impl Drop for Isolated {
    fn drop(&mut self) {
        self.0.wipe().unwrap();
        std::fs::remove_dir_all(self.0.folder()).unwrap();
    }
}

fn made_older(path: &Path, age: Duration) {
    let file = File::open(path).unwrap();
    file.set_modified(SystemTime::now() - age).unwrap();
}

const OLD: Duration = BEING_CREATED.saturating_add(Duration::from_secs(60));

#[test]
fn what_nobody_knows_goes_when_it_is_old_and_stays_while_it_may_be_being_created() {
    let isolated = Isolated::new("sweep");
    let _session = Session::open(&isolated.0, "supervisor").unwrap();
    let own = cleanup::node_count(&isolated.0);
    let abandoned = isolated.remains(123_456_789, OLD);
    let young = isolated.remains(987_654_321, Duration::ZERO);
    // Half of it is young: somebody is at it.
    let [folder, monitor] = isolated.remains(555_555, OLD);
    made_older(&monitor, Duration::ZERO);
    assert_eq!(cleanup::node_count(&isolated.0), own + 3);
    let swept = cleanup::sweep(&isolated.0);
    assert_eq!((swept.zombies, swept.cleaned), (1, 0), "{swept:?}");
    assert!(abandoned.iter().all(|path| !path.exists()));
    assert!(young.iter().all(|path| path.exists()));
    assert!(folder.exists() && monitor.exists());
    assert_eq!(cleanup::node_count(&isolated.0), own + 2);
    // In time they go, too; and nothing is counted twice.
    for path in young.iter().chain([&folder, &monitor]) {
        made_older(path, OLD);
    }
    assert_eq!(cleanup::sweep(&isolated.0).zombies, 2);
    assert_eq!(cleanup::sweep(&isolated.0), cleanup::Swept::default());
}

#[test]
fn whoever_lives_is_left_alone_however_old_and_so_is_what_is_no_nodes() {
    let isolated = Isolated::new("sweep_live");
    let supervisor = Session::open(&isolated.0, "supervisor").unwrap();
    let gateway = Session::open(&isolated.0, "mavlink_gateway").unwrap();
    let mut output = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
    let mut input = supervisor.input(topics::LINK_STATUS, "").unwrap();
    let nodes = isolated.0.iceoryx_root().join("nodes");
    let notes = nodes.join("notes.txt");
    std::fs::write(&notes, "somebody's").unwrap();
    for entry in std::fs::read_dir(&nodes).unwrap() {
        made_older(&entry.unwrap().path(), OLD);
    }
    let living = cleanup::node_count(&isolated.0);
    assert_eq!(cleanup::sweep(&isolated.0), cleanup::Swept::default());
    assert_eq!(cleanup::node_count(&isolated.0), living);
    assert!(notes.exists());
    output.send(SampleHeader::at(now()), &LinkStatus::default());
    assert!(input.latest(now()).is_fresh());
}

#[test]
fn another_instance_is_none_of_its_business() {
    let (ours, theirs) = (Isolated::new("sweep_a"), Isolated::new("sweep_b"));
    let _session = Session::open(&ours.0, "supervisor").unwrap();
    let _their_folders = Session::open(&theirs.0, "supervisor").unwrap();
    let remains = theirs.remains(123_456_789, OLD);
    assert_eq!(cleanup::sweep(&ours.0), cleanup::Swept::default());
    assert!(remains.iter().all(|path| path.exists()));
}
