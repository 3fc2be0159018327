//! How much memory the processes take, and how much more as the flight goes on: after its start a service needs no more.

use crate::drill::SUPERVISOR;
use crate::flight_log::MemoryUse;
use jink_runtime::procfs::resident_kib;
use jink_shared_types::health::SystemStatus;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Between two looks.
const PERIOD: Duration = Duration::from_secs(1);
/// What a process takes so long after it was seen first is what it needs: until then pages are touched for the first time.
const WARM_UP: Duration = Duration::from_secs(30);

/// One start of a process.
#[derive(Debug)]
struct Process {
    name: String,
    since: Instant,
    warm_kib: Option<u64>,
    now_kib: u64,
}

/// Looks at the memory of all processes once a second.
#[derive(Debug, Default)]
pub struct Memory {
    processes: BTreeMap<u32, Process>,
    looked: Option<Instant>,
}

impl Memory {
    /// Looks, if it is time.
    pub fn look(&mut self, status: &SystemStatus) {
        if self.looked.is_some_and(|looked| looked.elapsed() < PERIOD) {
            return;
        }
        self.looked = Some(Instant::now());
        let services = status.processes().iter();
        let all = services
            .map(|process| (process.pid, process.heartbeat.name.as_str()))
            .chain([(status.pid, SUPERVISOR)]);
        for (pid, name) in all {
            if let Some(kib) = resident_kib(pid) {
                self.take(pid, name, kib);
            }
        }
    }

    fn take(&mut self, pid: u32, name: &str, kib: u64) {
        let process = self.processes.entry(pid).or_insert_with(|| Process {
            name: name.to_owned(),
            since: Instant::now(),
            warm_kib: None,
            now_kib: kib,
        });
        process.now_kib = kib;
        if process.since.elapsed() >= WARM_UP {
            process.warm_kib.get_or_insert(kib);
        }
    }

    /// What was seen of those that lived long enough.
    pub fn uses(self) -> Vec<MemoryUse> {
        let warm = |process: Process| {
            let warm_kib = process.warm_kib?;
            Some(MemoryUse {
                process: process.name,
                resident_kib: process.now_kib,
                growth_kib: process.now_kib as i64 - warm_kib as i64,
            })
        };
        self.processes.into_values().filter_map(warm).collect()
    }
}
