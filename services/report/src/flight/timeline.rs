//! What happened when: modes, health, what became of each process, events.

use jink_shared_types::Timestamp;
use jink_shared_types::events::{EventSample, find};
use jink_shared_types::health::{ProcessStatus, ReplaceReason, SystemStatus};
use jink_shared_types::vehicle::VehicleState;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A state, and since when.
type Change = (Timestamp, String);

/// What became of a process.
#[derive(Debug, Default)]
struct OfProcess {
    states: Vec<Change>,
    marks: Vec<Change>,
    restarts: u32,
    pid: u32,
    budget_us: u32,
    medians_us: Vec<u32>,
    p99_us: u32,
    max_us: u32,
    budget_misses: BTreeMap<u32, u64>,
    cpu_ms: BTreeMap<u32, u32>,
    recovery_us: u32,
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Timeline {
    was_armed: bool,
    modes: Vec<Change>,
    health: Vec<Change>,
    processes: BTreeMap<String, OfProcess>,
    order: Vec<String>,
    events: Vec<(Timestamp, EventSample)>,
}

fn note(changes: &mut Vec<Change>, time: Timestamp, state: String) {
    if changes.last().is_none_or(|(_, last)| *last != state) {
        changes.push((time, state));
    }
}

impl Timeline {
    /// Whether the motors have run.
    pub(super) fn was_armed(&self) -> bool {
        self.was_armed
    }

    pub(super) fn take_vehicle(&mut self, time: Timestamp, vehicle: &VehicleState) {
        self.was_armed |= vehicle.armed.is_set();
        if !vehicle.mode_pending.is_set() {
            let mode = vehicle.mode.get().to_string();
            let armed = if vehicle.armed.is_set() { "" } else { ", disarmed" };
            note(&mut self.modes, time, format!("{mode}{armed}"));
        }
    }

    pub(super) fn take_event(&mut self, time: Timestamp, event: &EventSample) {
        self.events.push((time, *event));
    }

    pub(super) fn take_status(&mut self, time: Timestamp, status: &SystemStatus) {
        note(&mut self.health, time, status.health.get().to_string());
        for process in status.processes() {
            let name = process.heartbeat.name.as_str();
            if name.is_empty() {
                continue;
            }
            if !self.processes.contains_key(name) {
                self.order.push(name.to_owned());
            }
            self.processes
                .entry(name.to_owned())
                .or_default()
                .take(time, process);
        }
    }

    pub(super) fn json(&self, begin: Timestamp) -> Value {
        let t = |time: &Timestamp| super::round(time.seconds_since(begin));
        let changes = |changes: &[Change]| -> Vec<Value> {
            changes
                .iter()
                .map(|(time, state)| json!([t(time), state]))
                .collect()
        };
        let process = |name: &String| {
            let of = &self.processes[name];
            let mut medians = of.medians_us.clone();
            medians.sort_unstable();
            json!({
                "name": name,
                "states": changes(&of.states),
                "marks": changes(&of.marks),
                "restarts": of.restarts,
                "recovery_ms": super::round(f64::from(of.recovery_us) / 1e3),
                "budget_us": of.budget_us,
                "p50_us": medians.get(medians.len() / 2),
                "p99_us": of.p99_us,
                "max_us": of.max_us,
                "budget_misses": of.budget_misses.values().sum::<u64>(),
                "cpu_s": super::round(f64::from(of.cpu_ms.values().sum::<u32>()) / 1e3),
            })
        };
        let event = |(time, event): &(Timestamp, EventSample)| {
            json!({
                "t": t(time),
                "severity": event.severity.get().to_string(),
                "process": event.process.as_str(),
                "text": event.text(),
                "action": find(event.id).map_or("", |row| row.action),
            })
        };
        json!({
            "modes": changes(&self.modes),
            "health": changes(&self.health),
            "processes": self.order.iter().map(process).collect::<Vec<_>>(),
            "events": self.events.iter().map(event).collect::<Vec<_>>(),
        })
    }
}

impl OfProcess {
    fn take(&mut self, time: Timestamp, process: &ProcessStatus) {
        let beat = &process.heartbeat;
        note(&mut self.states, time, process.state.get().to_string());
        let is_other = self.pid != 0 && process.pid != 0 && process.pid != self.pid;
        if is_other && process.reason != ReplaceReason::Never {
            self.marks.push((time, process.reason.get().to_string()));
        }
        if process.pid != 0 {
            self.pid = process.pid;
        }
        self.restarts = self.restarts.max(process.restarts);
        self.recovery_us = self.recovery_us.max(process.recovery_us);
        self.budget_us = process.cycle_budget_us;
        if beat.cycle_p50_us > 0 {
            self.medians_us.push(beat.cycle_p50_us);
        }
        self.p99_us = self.p99_us.max(beat.cycle_p99_us);
        self.max_us = self.max_us.max(beat.cycle_max_us);
        self.budget_misses.insert(beat.pid, beat.budget_misses);
        self.cpu_ms.insert(beat.pid, beat.cpu_ms);
    }
}
