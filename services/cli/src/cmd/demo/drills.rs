//! Carries out the kills that were asked for and sees what becomes of them.

use jink_cli::drill::Kill;
use jink_cli::flight::KillRecord;
use jink_cli::report::round;
use jink_shared_types::health::{ProcessStatus, ServiceState, SystemStatus};
use jink_shared_types::truth::SimTruth;
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

/// Kills still to come, under way and done.
#[derive(Debug)]
pub struct Drills {
    planned: Vec<Kill>,
    /// With the restarts of the process before it was killed.
    open: Vec<(KillRecord, u32)>,
    done: Vec<KillRecord>,
}

impl Drills {
    /// In order of time.
    pub fn new(mut planned: Vec<Kill>) -> Self {
        planned.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        Self {
            planned,
            open: Vec::new(),
            done: Vec::new(),
        }
    }

    /// Kills what is due and notices who is back; answers what to tell of the kills.
    pub fn step(&mut self, mission_time_s: f64, truth: &SimTruth, status: &SystemStatus) -> Vec<String> {
        let mut news = Vec::new();
        while self
            .planned
            .first()
            .is_some_and(|kill| kill.at_s <= mission_time_s)
        {
            let kill = self.planned.remove(0);
            match find(status, &kill.process) {
                Some(process) if send_kill(process.pid) => {
                    news.push(format!(
                        "killed {} (process id {}) at {mission_time_s:.1} s",
                        kill.process, process.pid
                    ));
                    let record = KillRecord {
                        process: kill.process,
                        at_s: round(mission_time_s),
                        recovery_ms: None,
                        north_m: round(truth.position.x_m),
                        east_m: round(truth.position.y_m),
                    };
                    self.open.push((record, process.restarts));
                }
                _ => news.push(format!("{} does not run: not killed", kill.process)),
            }
        }
        let (back, open): (Vec<_>, Vec<_>) = std::mem::take(&mut self.open)
            .into_iter()
            .partition(|(record, before)| is_back(status, record, *before));
        self.open = open;
        for (mut record, _) in back {
            let recovery_us = find(status, &record.process).map_or(0, |process| process.recovery_us);
            record.recovery_ms = Some(f64::from(recovery_us) / 1e3);
            self.done.push(record);
        }
        news
    }

    /// Everything that was done.
    pub fn into_records(self) -> Vec<KillRecord> {
        let mut records = self.done;
        records.extend(self.open.into_iter().map(|(record, _)| record));
        records.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        records
    }
}

fn find<'a>(status: &'a SystemStatus, name: &str) -> Option<&'a ProcessStatus> {
    status
        .processes()
        .iter()
        .find(|process| process.heartbeat.name.as_str() == name)
}

fn is_back(status: &SystemStatus, record: &KillRecord, restarts_before: u32) -> bool {
    find(status, &record.process).is_some_and(|process| {
        let works = matches!(process.state.get(), ServiceState::Active | ServiceState::Standby);
        process.restarts > restarts_before && works && process.recovery_us > 0
    })
}

fn send_kill(pid: u32) -> bool {
    let handle = i32::try_from(pid)
        .ok()
        .and_then(Pid::from_raw)
        .and_then(|pid| pidfd_open(pid, PidfdFlags::empty()).ok());
    handle.is_some_and(|handle| pidfd_send_signal(&handle, Signal::KILL).is_ok())
}
