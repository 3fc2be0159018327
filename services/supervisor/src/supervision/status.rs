//! What others see of the system: its health, the status, and when either changes.

use super::{Action, Supervision};
use crate::health::judge;
use crate::process::{Process, RunState};
use crate::shadow::Shadow;
use jink_shared_types::Timestamp;
use jink_shared_types::coded::Coded;
use jink_shared_types::health::{Health, Heartbeat, ServiceState, SwapPhase, SystemStatus};

impl Supervision {
    /// Every essential process has reached its loop at least once: the system is started, healthy or not.
    pub fn is_up(&self) -> bool {
        self.up
    }

    /// Health of the whole.
    pub fn health(&self) -> Health {
        self.health
    }

    /// Name of a process, and how long it has been up at `now` (s).
    pub fn describe(&self, process: usize, now: Timestamp) -> Option<(&str, f64)> {
        let process = self.processes.get(process)?;
        Some((&process.rules.name, now.seconds_since(process.started)))
    }

    /// The last heartbeat of a process.
    pub fn heartbeat(&self, process: usize) -> Option<Heartbeat> {
        self.processes.get(process).map(Process::heartbeat)
    }

    /// Whether process `index` is down for good: stopped on request, or given up.
    pub fn is_down(&self, index: usize) -> bool {
        let process = self.processes.get(index);
        process.is_some_and(|process| matches!(process.run_state, RunState::Down | RunState::Failed))
    }

    /// Writes the whole status.
    pub fn write_status(&self, status: &mut SystemStatus) {
        status.started = self.started;
        status.health = Coded::new(self.health);
        status.len = self.processes.len() as u32;
        status.pid = self.pid;
        status.restarts = 0;
        let slots = status
            .processes
            .iter_mut()
            .zip(&self.processes)
            .zip(&self.second_instances);
        for ((slot, process), second) in slots {
            *slot = process.status(self.stopping.is_some());
            if let Some(shadow) = &second.shadow {
                slot.shadow_pid = shadow.pid;
                slot.swap = Coded::new(shadow.phase());
            }
            status.restarts += slot.restarts;
        }
    }

    pub(super) fn refresh(&mut self, now: Timestamp, actions: &mut Vec<Action>) -> bool {
        let stopping = self.stopping.is_some();
        let essential = || self.processes.iter().filter(|process| process.rules.essential);
        self.up |= essential().all(|process| process.was_up)
            && self
                .processes
                .iter()
                .all(|process| process.run_state != RunState::Waiting);
        let health = if stopping {
            Health::Stopping
        } else {
            judge(
                self.processes.iter().map(|process| process.view(false)),
                self.was_healthy,
            )
        };
        let culprit = essential()
            .map(|process| process.view(stopping))
            .find(|view| view.state != ServiceState::Active)
            .map_or("", |view| view.name);
        if let Some(event) = self.announcer.update(now, health, culprit) {
            actions.push(Action::PublishEvent(event));
        }
        let mut changed = health != self.health;
        self.health = health;
        self.was_healthy |= health == Health::Healthy;
        for (index, (process, second)) in self.processes.iter().zip(&self.second_instances).enumerate() {
            let shadow = second.shadow.as_ref();
            let shown = (
                process.state(stopping),
                process.pid,
                process.generation,
                shadow.map_or(0, |shadow| shadow.pid),
                shadow.map_or(SwapPhase::Idle, Shadow::phase),
            );
            match self.shown.get_mut(index) {
                Some(before) => {
                    changed |= *before != shown;
                    *before = shown;
                }
                None => self.shown.push(shown),
            }
        }
        changed
    }
}
