//! What the service manager is notified, if there is one (`sd_notify(3)`): ready, alive, how it goes, stopping.

use crate::supervision::Supervision;
use jink_shared_types::Timestamp;
use jink_shared_types::health::Health;
use sd_notify::NotifyState;

/// The service manager's notification socket.
#[derive(Debug)]
pub struct Notifier {
    listening: bool,
    /// Half the time after which the service manager calls the supervisor hung.
    period_s: Option<f64>,
    due: Timestamp,
    ready: bool,
    notified: Option<Health>,
}

impl Notifier {
    /// Looks into the environment for a service manager.
    pub fn new() -> Self {
        Self {
            listening: std::env::var_os("NOTIFY_SOCKET").is_some(),
            period_s: sd_notify::watchdog_enabled().map(|limit| limit.as_secs_f64() / 2.0),
            due: Timestamp::NEVER,
            ready: false,
            notified: None,
        }
    }

    /// Sends what is due about `supervision` at `now`.
    pub fn update(&mut self, now: Timestamp, supervision: &Supervision) {
        if !self.listening {
            return;
        }
        if supervision.is_up() && !self.ready {
            self.ready = true;
            send(&[NotifyState::Ready]);
        }
        let health = supervision.health();
        if self.notified != Some(health) {
            self.notified = Some(health);
            send(&[NotifyState::Status(&health.to_string())]);
            if health == Health::Stopping {
                send(&[NotifyState::Stopping]);
            }
        }
        if let Some(period_s) = self.period_s
            && now >= self.due
        {
            self.due = now.plus_seconds(period_s);
            send(&[NotifyState::Watchdog]);
        }
    }

    /// When something is due at the latest.
    pub fn due(&self) -> Option<Timestamp> {
        self.period_s.filter(|_| self.listening).map(|_| self.due)
    }
}

fn send(state: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(state) {
        tracing::warn!("the service manager does not listen: {error}");
    }
}
