//! Cycle statistics: how long a service's cycles take against its budget, in fixed memory.

use jink_shared_types::Timestamp;
use jink_shared_types::coded::Coded;
use jink_shared_types::health::{Heartbeat, Histogram, Name, ServiceState};

/// Heartbeats per second. The supervisor calls two missed ones a hang, so this bounds detection to 100 ms.
pub const HEARTBEAT_PERIOD_S: f64 = 0.05;

/// Quantiles are taken over this many heartbeats (5 s), so that they follow a change of load.
const WINDOW_HEARTBEATS: u32 = 100;

/// Counts a service's cycles.
#[derive(Debug)]
pub struct CycleMeter {
    heartbeat: Heartbeat,
    budget_us: u32,
    window: Histogram,
    previous: Histogram,
    heartbeats: u32,
}

impl CycleMeter {
    /// A meter for process `name` with this process id, `generation`-th start, with a cycle budget in microseconds (0 = none).
    pub fn new(name: &str, pid: u32, generation: u32, budget_us: u32) -> Self {
        Self {
            heartbeat: Heartbeat {
                name: Name::new(name),
                pid,
                generation,
                state: Coded::new(ServiceState::Starting),
                ..Heartbeat::default()
            },
            budget_us,
            window: Histogram::default(),
            previous: Histogram::default(),
            heartbeats: 0,
        }
    }

    /// Counts a cycle that ran from `begin` to `end`.
    pub fn cycle(&mut self, begin: Timestamp, end: Timestamp) {
        let us = u32::try_from(end.ns_since(begin) / 1_000).unwrap_or(u32::MAX);
        self.window.record_us(us);
        self.heartbeat.cycles += 1;
        self.heartbeat.cycle_last_us = us;
        self.heartbeat.cycle_max_us = self.heartbeat.cycle_max_us.max(us);
        if self.budget_us > 0 && us > self.budget_us {
            self.heartbeat.budget_misses += 1;
        }
    }

    /// Counts an input that has just become late.
    pub fn deadline_missed(&mut self) {
        self.heartbeat.deadline_misses += 1;
    }

    /// The heartbeat to publish now, given the state of the service and of its inputs.
    pub fn beat(&mut self, state: ServiceState, inputs_fresh: u32, inputs_needed: u32) -> Heartbeat {
        let mut both = self.previous;
        both.merge(&self.window);
        self.heartbeat.cycle_p50_us = both.quantile_us(0.5) as u32;
        self.heartbeat.cycle_p99_us = both.quantile_us(0.99) as u32;
        self.heartbeat.inputs_fresh = inputs_fresh;
        self.heartbeat.inputs_needed = inputs_needed;
        self.heartbeat.cpu_ms = crate::realtime::cpu_time_ms();
        self.heartbeat.state = Coded::new(state);
        self.heartbeats += 1;
        if self.heartbeats.is_multiple_of(WINDOW_HEARTBEATS) {
            self.previous = self.window;
            self.window = Histogram::default();
        }
        self.heartbeat
    }
}

#[cfg(test)]
mod tests {
    use super::CycleMeter;
    use jink_shared_types::Timestamp;
    use jink_shared_types::health::ServiceState;

    #[test]
    fn cycles_over_budget_are_counted_and_quantiles_follow() {
        let mut meter = CycleMeter::new("planner", 1, 3, 1_000);
        for us in [500, 600, 700, 5_000] {
            meter.cycle(Timestamp::from_ns(1), Timestamp::from_ns(1 + us * 1_000));
        }
        let beat = meter.beat(ServiceState::Active, 0b1, 0b1);
        assert_eq!(
            (beat.cycles, beat.budget_misses, beat.cycle_max_us),
            (4, 1, 5_000)
        );
        assert!((600..=680).contains(&beat.cycle_p50_us), "{}", beat.cycle_p50_us);
        assert_eq!((beat.generation, beat.name.as_str()), (3, "planner"));
    }
}
