//! What happens in a running system, one line per event, for whoever watches it.

use crate::figures::exit_text;
use jink_shared_types::health::{
    EXIT_NOT_SPAWNED, Health, ProcessStatus, ReplaceReason, ServiceState, SystemStatus,
};
use jink_shared_types::link::{LINKS, LinkStatus};

/// Remembers what has been reported.
#[derive(Clone, Debug, Default)]
pub struct Narrator {
    reported: Vec<Reported>,
    /// With whether the system stands by.
    health: Option<(Health, bool)>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Reported {
    started: bool,
    restarts: u32,
    recovery_us: u32,
    failed: bool,
}

impl Narrator {
    /// What is new in `status` since the last call.
    pub fn update(&mut self, status: &SystemStatus) -> Vec<String> {
        let processes = status.processes();
        self.reported.resize(processes.len(), Reported::default());
        let mut lines = Vec::new();
        for (reported, process) in self.reported.iter_mut().zip(processes) {
            report_process(reported, process, &mut lines);
        }
        // Who is to blame may change many times a second; only a change of the health is reported.
        let health = (status.health.get(), is_standing_by(status));
        if self.health != Some(health) {
            self.health = Some(health);
            // Each process that starts has a line of its own.
            if health != (Health::Starting, false) {
                lines.push(health_line(status));
            }
        }
        lines
    }
}

/// Remembers which links are waited for.
#[derive(Clone, Debug, Default)]
pub struct Waits([bool; LINKS]);

impl Waits {
    /// What is new in `status` since the last call; the links lead to `addresses`, in the same order.
    pub fn update(&mut self, status: &LinkStatus, addresses: &[String]) -> Vec<String> {
        let links = status.links.iter().zip(addresses);
        let mut lines = Vec::new();
        for (before, (link, address)) in self.0.iter_mut().zip(links) {
            let waits = link.is_waited_for.is_set();
            match (std::mem::replace(before, waits), waits) {
                (false, true) => lines.push(format!("waiting for {address}")),
                (true, false) => lines.push(format!("{address} is there")),
                _ => {}
            }
        }
        lines
    }
}

fn report_process(reported: &mut Reported, process: &ProcessStatus, lines: &mut Vec<String>) {
    let name = process.heartbeat.name.as_str();
    let ended = match process.last_exit {
        EXIT_NOT_SPAWNED => "could not be started".to_owned(),
        exit => format!("ended with {}", exit_text(exit)),
    };
    if process.restarts > reported.restarts {
        reported.restarts = process.restarts;
        let what_then = if process.reason == ReplaceReason::TakenOver {
            "its second instance took over"
        } else {
            "started again"
        };
        lines.push(format!(
            "{name} {ended}, {what_then} (restart {})",
            process.restarts
        ));
    } else if process.pid != 0 && !reported.started {
        lines.push(format!("{name} started, process id {}", process.pid));
    }
    reported.started |= process.pid != 0;
    if process.recovery_us != reported.recovery_us {
        reported.recovery_us = process.recovery_us;
        lines.push(format!(
            "{name} works again after {:.0} ms",
            f64::from(process.recovery_us) * 1e-3
        ));
    }
    if process.state == ServiceState::Failed && !reported.failed {
        reported.failed = true;
        lines.push(format!("{name} {ended} and was given up"));
    }
}

/// Every essential process has reached its loop, and some wait for inputs that have never come.
pub fn is_standing_by(status: &SystemStatus) -> bool {
    let essential = || {
        status
            .processes()
            .iter()
            .filter(|process| process.essential.is_set())
    };
    let in_loop = |state: ServiceState| {
        matches!(
            state,
            ServiceState::Standby | ServiceState::Active | ServiceState::Degraded
        )
    };
    status.health == Health::Starting
        && essential().all(|process| in_loop(process.state.get()))
        && essential().any(|process| process.state == ServiceState::Standby)
}

/// The health of the whole in words, with who is to blame for it.
pub fn health_line(status: &SystemStatus) -> String {
    let named = |wanted: &dyn Fn(ServiceState) -> bool| {
        let names: Vec<&str> = status
            .processes()
            .iter()
            .filter(|process| process.essential.is_set() && wanted(process.state.get()))
            .map(|process| process.heartbeat.name.as_str())
            .collect();
        names.join(", ")
    };
    match status.health.get() {
        Health::Healthy => "ready".to_owned(),
        Health::Starting if is_standing_by(status) => format!(
            "waiting for first inputs: {}",
            named(&|state| state == ServiceState::Standby)
        ),
        Health::Starting => "starting".to_owned(),
        Health::Degraded => format!("degraded: {}", named(&|state| state != ServiceState::Active)),
        Health::Failed => format!("failed: {}", named(&|state| state == ServiceState::Failed)),
        Health::Stopping => "stopping".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::{Narrator, Waits, is_standing_by};
    use jink_shared_types::coded::{Coded, Flag};
    use jink_shared_types::health::{EXIT_NOT_SPAWNED, Health, Name, ServiceState, SystemStatus};
    use jink_shared_types::link::LinkStatus;

    fn status(health: Health, states: &[(&str, ServiceState)]) -> SystemStatus {
        let mut status = SystemStatus {
            health: Coded::new(health),
            len: states.len() as u32,
            ..SystemStatus::default()
        };
        for (slot, (name, state)) in status.processes.iter_mut().zip(states) {
            slot.heartbeat.name = Name::new(name);
            slot.state = Coded::new(*state);
            slot.essential = Flag::YES;
            slot.pid = 7;
        }
        status
    }

    #[test]
    fn every_piece_of_news_is_reported_once() {
        let mut narrator = Narrator::default();
        let mut now = status(Health::Starting, &[("planner", ServiceState::Starting)]);
        assert_eq!(narrator.update(&now), ["planner started, process id 7"]);
        assert!(narrator.update(&now).is_empty());
        now = status(Health::Healthy, &[("planner", ServiceState::Active)]);
        assert_eq!(narrator.update(&now), ["ready"]);
        now = status(Health::Degraded, &[("planner", ServiceState::Dead)]);
        now.processes[0].pid = 0;
        assert_eq!(narrator.update(&now), ["degraded: planner"]);
        now = status(Health::Healthy, &[("planner", ServiceState::Active)]);
        now.processes[0].restarts = 1;
        now.processes[0].last_exit = 256 + 9;
        now.processes[0].recovery_us = 57_800;
        let expected = [
            "planner ended with signal 9, started again (restart 1)",
            "planner works again after 58 ms",
            "ready",
        ];
        assert_eq!(narrator.update(&now), expected);
        assert!(narrator.update(&now).is_empty());
        now.processes[0].restarts = 2;
        now.processes[0].last_exit = EXIT_NOT_SPAWNED;
        let refused = "planner could not be started, started again (restart 2)";
        assert_eq!(narrator.update(&now), [refused]);
    }

    #[test]
    fn a_device_that_is_waited_for_is_named_once_and_so_is_its_coming() {
        let addresses = ["serial:/dev/ttyACM0:921600", "udpin:14550"].map(str::to_owned);
        let (mut waits, mut status) = (Waits::default(), LinkStatus::default());
        assert!(waits.update(&status, &addresses).is_empty());
        status.links[0].is_waited_for = Flag::YES;
        assert_eq!(
            waits.update(&status, &addresses),
            ["waiting for serial:/dev/ttyACM0:921600"]
        );
        assert!(waits.update(&status, &addresses).is_empty());
        status.links[0].is_waited_for = Flag::default();
        assert_eq!(
            waits.update(&status, &addresses),
            ["serial:/dev/ttyACM0:921600 is there"]
        );
    }

    #[test]
    fn a_process_that_was_given_up_is_named() {
        let mut narrator = Narrator::default();
        let mut now = status(Health::Failed, &[("planner", ServiceState::Failed)]);
        now.processes[0].pid = 0;
        now.processes[0].last_exit = 1;
        assert_eq!(
            narrator.update(&now),
            ["planner ended with code 1 and was given up", "failed: planner"]
        );
    }

    #[test]
    fn standing_by_names_who_waits() {
        let states = [
            ("gateway", ServiceState::Active),
            ("planner", ServiceState::Standby),
        ];
        let waiting = status(Health::Starting, &states);
        assert!(is_standing_by(&waiting));
        let update = Narrator::default().update(&waiting);
        assert_eq!(update.last().unwrap(), "waiting for first inputs: planner");
        let starting = status(Health::Starting, &[("gateway", ServiceState::Starting)]);
        assert!(!is_standing_by(&starting));
    }
}
