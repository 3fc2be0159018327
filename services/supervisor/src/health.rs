//! Health of the whole, made of the states of its processes, and when a change is reported to the pilot.
//!
//! Only essential processes count. In this order:
//!
//! | health | when |
//! |---|---|
//! | stopping | a stop was requested |
//! | failed | an essential process has been given up (and its row does not say that this may be ignored) |
//! | healthy | every essential process is active |
//! | degraded | one is dead, stopped on request, starting again, or reports that it is degraded; or any lack after the system was healthy once |
//! | starting | otherwise: processes are being started, or stand by for inputs that have never come |
//!
//! A process that stands by works, but the chain does not: before the first flight that is a system still starting
//! (the autopilot may not be switched on yet), afterwards it is a lack.

use jink_shared_types::Timestamp;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::health::{Health, ServiceState};

/// How long the system must be degraded before it is reported to the pilot (s). A restart takes some 60 ms and has its
/// own event; half a second is how long PX4 tolerates silence of its companion before it reacts itself.
const REPORT_AFTER_S: f64 = 0.5;

/// One process as far as the health of the whole depends on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its state as the supervisor judges it.
    pub state: ServiceState,
    /// The system cannot fly without it.
    pub essential: bool,
    /// Its being given up is ignored.
    pub failure_ignored: bool,
    /// It has been restarted.
    pub restarted: bool,
}

/// The health of a system of `processes` that has, or has not, been healthy before.
pub fn judge<'a>(processes: impl Iterator<Item = View<'a>> + Clone, was_healthy: bool) -> Health {
    let essential = || processes.clone().filter(|process| process.essential);
    let given_up = |process: &View<'_>| process.state == ServiceState::Failed && !process.failure_ignored;
    let lacking = |process: &View<'_>| match process.state {
        ServiceState::Dead | ServiceState::Failed | ServiceState::Stopped | ServiceState::Degraded => true,
        ServiceState::Starting => process.restarted,
        _ => false,
    };
    if essential().any(|process| given_up(&process)) {
        Health::Failed
    } else if essential().all(|process| process.state == ServiceState::Active) {
        Health::Healthy
    } else if was_healthy || essential().any(|process| lacking(&process)) {
        Health::Degraded
    } else {
        Health::Starting
    }
}

/// Reports each change between ready and not ready once to the pilot.
#[derive(Clone, Debug)]
pub struct Announcer {
    ready_reported: bool,
    lacking_since: Option<Timestamp>,
}

impl Default for Announcer {
    /// Nothing reported yet.
    fn default() -> Self {
        Self {
            ready_reported: false,
            lacking_since: None,
        }
    }
}

impl Announcer {
    /// What to report at `now`; `culprit` is the first process that is not as it should be.
    pub fn update(&mut self, now: Timestamp, health: Health, culprit: &str) -> Option<EventSample> {
        match health {
            Health::Healthy => {
                self.lacking_since = None;
                let is_due = !self.ready_reported;
                self.ready_reported = true;
                is_due.then(|| EventSample::new(&events::AVOIDANCE_READY, "", [0.0; 2]))
            }
            Health::Starting | Health::Degraded => {
                let since = *self.lacking_since.get_or_insert(now);
                let is_due = self.ready_reported && now.seconds_since(since) >= REPORT_AFTER_S;
                if is_due {
                    self.ready_reported = false;
                }
                is_due.then(|| EventSample::new(&events::AVOIDANCE_DEGRADED, culprit, [0.0; 2]))
            }
            // Both are reported otherwise: by the event of the process given up, by the request to stop.
            Health::Failed | Health::Stopping => {
                self.ready_reported = false;
                None
            }
        }
    }

    /// When there may be something to report without anything else happening.
    pub fn due(&self) -> Option<Timestamp> {
        let since = self.lacking_since.filter(|_| self.ready_reported)?;
        Some(since.plus_seconds(REPORT_AFTER_S))
    }
}

#[cfg(test)]
mod tests {
    use super::{Announcer, View, judge};
    use jink_shared_types::Timestamp;
    use jink_shared_types::events;
    use jink_shared_types::health::{Health, ServiceState};

    fn view(state: ServiceState) -> View<'static> {
        View {
            name: "planner",
            state,
            essential: true,
            failure_ignored: false,
            restarted: false,
        }
    }

    fn health_with(one: View<'static>, was_healthy: bool) -> Health {
        judge([view(ServiceState::Active), one].into_iter(), was_healthy)
    }

    #[test]
    fn standing_by_is_starting_before_the_system_was_healthy_and_a_lack_afterwards() {
        let standby = view(ServiceState::Standby);
        assert_eq!(health_with(standby, false), Health::Starting);
        assert_eq!(health_with(standby, true), Health::Degraded);
        assert_eq!(health_with(view(ServiceState::Active), false), Health::Healthy);
    }

    #[test]
    fn a_dead_restarting_or_blind_essential_process_degrades() {
        for state in [ServiceState::Dead, ServiceState::Stopped, ServiceState::Degraded] {
            assert_eq!(health_with(view(state), false), Health::Degraded);
        }
        let starting = view(ServiceState::Starting);
        assert_eq!(health_with(starting, false), Health::Starting);
        let again = View {
            restarted: true,
            ..starting
        };
        assert_eq!(health_with(again, false), Health::Degraded);
    }

    #[test]
    fn only_what_is_essential_and_not_ignored_fails_the_system() {
        let failed = view(ServiceState::Failed);
        assert_eq!(health_with(failed, true), Health::Failed);
        let ignored = View {
            failure_ignored: true,
            ..failed
        };
        assert_eq!(health_with(ignored, true), Health::Degraded);
        let extra = View {
            essential: false,
            ..failed
        };
        assert_eq!(health_with(extra, true), Health::Healthy);
    }

    #[test]
    fn a_change_is_reported_once_to_the_pilot_and_a_short_lack_is_not() {
        let mut announcer = Announcer::default();
        let at = |s: f64| Timestamp::from_seconds(10.0 + s);
        let mut report =
            |s: f64, health: Health| announcer.update(at(s), health, "planner").map(|event| event.id);
        assert_eq!(report(0.0, Health::Starting), None);
        assert_eq!(report(5.0, Health::Healthy), Some(events::AVOIDANCE_READY.id));
        assert_eq!(report(6.0, Health::Degraded), None, "a restart");
        assert_eq!(report(6.1, Health::Healthy), None);
        assert_eq!(report(7.0, Health::Degraded), None);
        assert_eq!(report(7.6, Health::Degraded), Some(events::AVOIDANCE_DEGRADED.id));
        assert_eq!(report(9.0, Health::Degraded), None, "reported already");
        assert_eq!(report(9.5, Health::Healthy), Some(events::AVOIDANCE_READY.id));
    }
}
