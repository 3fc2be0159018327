//! What arrived from the companion, for the truth about a flight.

use crate::link::{COMPONENT_AVOIDANCE, Link, Packet};

/// Counters of received setpoints.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SetpointStatistics {
    /// Trajectories and setpoints received (WAYPOINTS, BEZIER, SET_POSITION_TARGET_LOCAL_NED).
    pub count: u64,
    /// When the last one came, boot time (s); 0 before the first.
    pub last_s: f64,
    /// Largest time without one while armed, in the air, and in a mode in which the companion leads (s).
    pub gap_max_s: f64,
    /// OBSTACLE_DISTANCE messages received.
    pub obstacle_distances: u64,
    /// Messages of the avoidance component whose sequence number did not follow that of the one before.
    pub sequence_breaks: u64,
    next_sequence: Option<u8>,
    waiting_since_us: Option<u64>,
    last_us: u64,
}

impl SetpointStatistics {
    /// A setpoint arrived.
    pub fn note(&mut self, now_us: u64) {
        self.count += 1;
        self.last_us = now_us;
        self.last_s = now_us as f64 * 1e-6;
    }

    /// A packet arrived; the sequence is that of the companion's avoidance component.
    pub fn note_packet(&mut self, packet: &Packet) {
        if packet.link == Link::Companion && packet.header.component_id == COMPONENT_AVOIDANCE {
            self.note_sequence(packet.header.sequence);
        }
    }

    /// A message of the avoidance component arrived.
    pub fn note_sequence(&mut self, sequence: u8) {
        let next = self.next_sequence.replace(sequence.wrapping_add(1));
        self.sequence_breaks += u64::from(next.is_some_and(|next| next != sequence));
    }

    /// `counts`: whether the companion is responsible now.
    pub fn step(&mut self, now_us: u64, counts: bool) {
        if !counts {
            self.waiting_since_us = None;
            return;
        }
        let since_us = *self.waiting_since_us.get_or_insert(now_us);
        let gap_us = now_us - since_us.max(self.last_us);
        self.gap_max_s = self.gap_max_s.max(gap_us as f64 * 1e-6);
    }
}

#[cfg(test)]
mod tests {
    use super::SetpointStatistics;

    #[test]
    fn a_lost_and_a_doubled_message_break_the_sequence() {
        let mut statistics = SetpointStatistics::default();
        (250..=255).chain(0..5).for_each(|n| statistics.note_sequence(n));
        assert_eq!(statistics.sequence_breaks, 0);
        statistics.note_sequence(6);
        statistics.note_sequence(6);
        assert_eq!(statistics.sequence_breaks, 2);
    }

    #[test]
    fn a_gap_counts_only_while_the_companion_is_responsible() {
        let mut statistics = SetpointStatistics::default();
        for ms in 0..1_000u64 {
            statistics.step(ms * 1_000, false);
        }
        assert_eq!(statistics.gap_max_s, 0.0);
        for ms in 1_000..3_000u64 {
            if ms % 50 == 0 && !(1_500..1_800).contains(&ms) {
                statistics.note(ms * 1_000);
            }
            statistics.step(ms * 1_000, true);
        }
        assert!(
            (statistics.gap_max_s - 0.349).abs() < 0.002,
            "{}",
            statistics.gap_max_s
        );
        assert_eq!(statistics.count, 34);
        assert!((statistics.last_s - 2.95).abs() < 1e-9);
    }
}
