//! What has happened on the wire: counters, the largest gap between setpoints, latencies.

use jink_mavlink_link::message::Receipt;
use jink_shared_types::link::LinkStatus;
use jink_shared_types::{SampleHeader, Stage, StageTime, Timestamp};

/// Counts what was really sent.
#[derive(Clone, Debug, Default)]
pub struct Wire {
    /// The counters; what is not about sending is filled in by the gateway.
    pub status: LinkStatus,
    last_setpoint: Timestamp,
    /// When the gateway was woken last.
    woken: Timestamp,
    /// The capture of the trajectory that was counted last.
    counted: Timestamp,
}

impl Wire {
    /// The gateway is woken at `now`.
    pub fn wake(&mut self, now: Timestamp) {
        self.woken = now;
    }

    /// The bytes of a message were handed to the kernel at `now`.
    pub fn sent(&mut self, now: Timestamp, receipt: Receipt) {
        self.status.sent += 1;
        match receipt {
            Receipt::Plain => {}
            Receipt::Obstacles => self.status.obstacle_distances += 1,
            Receipt::Setpoint { first_of } => {
                self.status.setpoints += 1;
                if self.last_setpoint.is_set() {
                    let gap_us = microseconds(now, self.last_setpoint);
                    self.status.setpoint_gap_max_us = self.status.setpoint_gap_max_us.max(gap_us);
                }
                self.last_setpoint = now;
                if let Some(header) = first_of {
                    self.known(now, &header);
                }
            }
        }
    }

    /// The autopilot knows at `now` what the trajectory with this header says: it was sent, or is flown already. One that was made of
    /// no measurement says nothing of how long measurements take, nor does another one of the same measurement: it was made
    /// later because something else had changed, the goal as a rule.
    pub fn known(&mut self, now: Timestamp, header: &SampleHeader) {
        if !header.capture.is_set() || header.capture == self.counted {
            return;
        }
        self.counted = header.capture;
        self.status
            .capture_to_wire
            .record_us(microseconds(now, header.capture));
        let mut before = header.capture;
        let LinkStatus { stages, hops, .. } = &mut self.status;
        let histograms = stages.iter_mut().zip(hops);
        for (index, (stage, (whole, hop))) in header.stages.iter().zip(histograms).enumerate() {
            let StageTime { begin, end } = match index == Stage::Gateway as usize {
                true => StageTime {
                    begin: self.woken,
                    end: now,
                },
                false => *stage,
            };
            if end.is_set() {
                whole.record_us(microseconds(end, before));
                hop.record_us(microseconds(begin, before));
                before = end;
            }
        }
    }

    /// Another gateway has sent up to here.
    pub fn resume_from(&mut self, last_setpoint: Timestamp) {
        self.last_setpoint = last_setpoint;
    }

    /// The stream was interrupted with good reason (the autopilot is gone or has started anew): the next gap does not count.
    pub fn interrupted(&mut self) {
        self.last_setpoint = Timestamp::NEVER;
    }
}

fn microseconds(now: Timestamp, then: Timestamp) -> u32 {
    u32::try_from(now.ns_since(then) / 1000).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::Wire;
    use jink_mavlink_link::message::Receipt;
    use jink_shared_types::{STAGES, SampleHeader, Stage, StageTime, Timestamp};

    fn at(ms: u64) -> Timestamp {
        Timestamp::from_ns(1_000_000_000 + ms * 1_000_000)
    }

    #[test]
    fn the_largest_gap_and_the_latencies_are_kept() {
        let mut wire = Wire::default();
        let plain = Receipt::Setpoint { first_of: None };
        let mut header = SampleHeader {
            capture: at(80),
            publish: at(97),
            ..SampleHeader::default()
        };
        for (stage, begin, end) in [(Stage::Sensor, 80, 85), (Stage::Guard, 96, 97)] {
            header.stages[stage as usize] = StageTime {
                begin: at(begin),
                end: at(end),
            };
        }
        let planned = Receipt::Setpoint {
            first_of: Some(header),
        };
        wire.wake(at(99));
        for (ms, receipt) in [
            (0, plain),
            (50, plain),
            (100, planned),
            (170, plain),
            (220, plain),
        ] {
            wire.sent(at(ms), receipt);
        }
        wire.sent(at(221), Receipt::Obstacles);
        let status = &wire.status;
        assert_eq!(
            (status.sent, status.setpoints, status.obstacle_distances),
            (6, 5, 1)
        );
        assert_eq!(status.setpoint_gap_max_us, 70_000);
        assert_eq!(
            (status.capture_to_wire.count, status.capture_to_wire.max_us),
            (1, 20_000)
        );
        let silent = (0, 0);
        for (histograms, expected) in [
            (
                &status.stages,
                [(1, 5_000), silent, silent, silent, (1, 12_000), (1, 3_000)],
            ),
            (
                &status.hops,
                [(1, 0), silent, silent, silent, (1, 11_000), (1, 2_000)],
            ),
        ] {
            let counted = histograms.map(|histogram| (histogram.count, histogram.max_us));
            assert_eq!(&counted[..STAGES], expected);
        }
    }

    #[test]
    fn of_trajectories_of_one_measurement_the_first_is_counted() {
        let mut wire = Wire::default();
        let of = |capture: Timestamp| SampleHeader {
            capture,
            ..SampleHeader::default()
        };
        for (capture, now) in [(at(0), at(10)), (at(0), at(90)), (at(100), at(107))] {
            wire.known(now, &of(capture));
        }
        wire.known(at(120), &of(Timestamp::NEVER));
        let counted = &wire.status.capture_to_wire;
        assert_eq!((counted.count, counted.max_us), (2, 10_000));
    }

    #[test]
    fn a_gap_with_a_good_reason_does_not_count() {
        let mut wire = Wire::default();
        wire.sent(at(0), Receipt::Setpoint { first_of: None });
        wire.interrupted();
        wire.sent(at(5000), Receipt::Setpoint { first_of: None });
        assert_eq!(wire.status.setpoint_gap_max_us, 0);
    }
}
