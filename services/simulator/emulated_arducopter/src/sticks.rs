//! The pilot's sticks: a simulated receiver with the throttle down, and overrides from the ground station.

use mavlink::dialect::RC_CHANNELS_OVERRIDE_DATA;
use nalgebra::Vector2;

/// Channels that are simulated.
pub const CHANNELS: usize = 8;
/// Roll, pitch, throttle, yaw and four switches of the simulated receiver (us): the throttle is down.
const RECEIVER_US: [u16; CHANNELS] = [1_500, 1_500, 1_000, 1_500, 1_800, 1_000, 1_000, 1_800];
/// An override that is not repeated ends after this (us): RC_OVERRIDE_TIME.
const OVERRIDE_US: u64 = 3_000_000;
/// Values of an override that leave a channel to the receiver, and as it is.
const RELEASE: u16 = 0;
const IGNORE: u16 = u16::MAX;
/// Half of a channel's travel (us).
const TRAVEL_US: f64 = 500.0;
/// Deviation from the centre that counts as none, in shares of the travel.
const DEAD: f64 = 0.06;

/// The four sticks, and the switches.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sticks {
    overrides: [Option<u16>; CHANNELS],
    received_us: u64,
    now_us: u64,
}

impl Sticks {
    /// Takes overrides.
    pub fn receive(&mut self, now_us: u64, message: &RC_CHANNELS_OVERRIDE_DATA) {
        self.received_us = now_us;
        let channels = [
            message.chan1_raw,
            message.chan2_raw,
            message.chan3_raw,
            message.chan4_raw,
            message.chan5_raw,
            message.chan6_raw,
            message.chan7_raw,
            message.chan8_raw,
        ];
        for (slot, channel) in self.overrides.iter_mut().zip(channels) {
            match channel {
                RELEASE => *slot = None,
                IGNORE => {}
                value => *slot = Some(value),
            }
        }
    }

    /// A new step begins.
    pub fn begin(&mut self, now_us: u64) {
        self.now_us = now_us;
    }

    /// Channel `index` as it counts (us).
    pub fn raw_us(&self, index: usize) -> u16 {
        let fresh = self.now_us - self.received_us < OVERRIDE_US;
        let own = self.overrides[index].filter(|_| fresh);
        own.unwrap_or(RECEIVER_US[index])
    }

    /// -1 to 1, zero about the centre.
    fn deviation(&self, index: usize) -> f64 {
        let x = ((f64::from(self.raw_us(index)) - 1_500.0) / TRAVEL_US).clamp(-1.0, 1.0);
        if x.abs() < DEAD {
            return 0.0;
        }
        ((x.abs() - DEAD) / (1.0 - DEAD)).copysign(x)
    }

    /// Wish to move forward and to the right.
    pub fn lean(&self) -> Vector2<f64> {
        Vector2::new(-self.deviation(1), self.deviation(0))
    }

    /// Wish to climb.
    pub fn climb(&self) -> f64 {
        self.deviation(2)
    }

    /// Wish to turn right.
    pub fn turn(&self) -> f64 {
        self.deviation(3)
    }

    /// Throttle from 0 to 1.
    pub fn throttle(&self) -> f64 {
        ((f64::from(self.raw_us(2)) - 1_000.0) / (2.0 * TRAVEL_US)).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_an_override_the_throttle_is_down_and_an_override_ends_by_itself() {
        let mut sticks = Sticks::default();
        assert_eq!((sticks.climb(), sticks.throttle()), (-1.0, 0.0));
        sticks.receive(
            0,
            &RC_CHANNELS_OVERRIDE_DATA {
                chan1_raw: 1_500,
                chan2_raw: 1_000,
                chan3_raw: 1_500,
                chan4_raw: 1_500,
                ..RC_CHANNELS_OVERRIDE_DATA::default()
            },
        );
        sticks.begin(2_900_000);
        assert_eq!((sticks.climb(), sticks.lean()), (0.0, Vector2::new(1.0, 0.0)));
        sticks.begin(3_000_000);
        assert_eq!(sticks.climb(), -1.0);
    }
}
