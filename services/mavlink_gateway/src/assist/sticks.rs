//! The pilot's sticks, as the autopilot reports them: MANUAL_CONTROL (PX4) or RC_CHANNELS (ArduPilot).
//!
//! | stick | MANUAL_CONTROL | RC_CHANNELS, channel by RCMAP_* |
//! |---|---|---|
//! | forward | `x`, 1000 is full | pitch, from RCn_TRIM down to RCn_MIN |
//! | right | `y` | roll, from RCn_TRIM up to RCn_MAX |
//! | up | `z`, 500 is the centre | throttle, from the middle of its range: RC3_TRIM is the bottom of many remote controls |
//! | turn right | `r` | yaw, from RCn_TRIM up to RCn_MAX |

use jink_shared_types::Timestamp;
use mavlink::dialect::{MANUAL_CONTROL_DATA, RC_CHANNELS_DATA};
use nalgebra::{Rotation2, Vector2};

/// Sticks that were received longer ago than this (s) are lost: the autopilot's own limit for a lost remote control.
pub const STICKS_KEPT_S: f64 = 0.5;
/// A stick this near to its centre is there (share of its way): PX4's MAN_DEADZONE.
const DEAD_ZONE: f64 = 0.1;
/// The same of the throttle stick, which not every remote control centres by a spring: ArduCopter's THR_DZ.
const THROTTLE_DEAD_ZONE: f64 = 0.2;
/// Channels of RC_CHANNELS.
pub const CHANNELS: usize = 18;

/// The sticks.
#[derive(Clone, Copy, Debug)]
pub struct PilotSticks {
    /// Forward and right beyond the dead zone, in shares of their way; not longer than 1.
    level: Vector2<f64>,
    /// Up, -1 to 1.
    up: f64,
    /// Turn to the right, -1 to 1.
    turn: f64,
    received: Timestamp,
}

impl Default for PilotSticks {
    fn default() -> Self {
        Self {
            level: Vector2::zeros(),
            up: 0.0,
            turn: 0.0,
            received: Timestamp::NEVER,
        }
    }
}

impl PilotSticks {
    /// Takes the sticks as PX4 reports them; an axis that it does not know leaves everything as it was.
    pub fn take(&mut self, control: &MANUAL_CONTROL_DATA, received: Timestamp) {
        let share = |stick: i16| (stick != i16::MAX).then(|| f64::from(stick) / 1000.0);
        if let (Some(forward), Some(right)) = (share(control.x), share(control.y)) {
            let up = share(control.z).map_or(0.0, |z| 2.0 * z - 1.0);
            self.set([forward, right, up, share(control.r).unwrap_or(0.0)], received);
        }
    }

    /// Takes the channels as ArduPilot reports them; one that is not there leaves everything as it was.
    pub fn take_channels(
        &mut self,
        channels: &RC_CHANNELS_DATA,
        calibration: &RcCalibration,
        received: Timestamp,
    ) {
        let raw_us = channels_us(channels);
        let [roll, pitch, throttle, yaw] = &calibration.axes;
        if let (Some(right), Some(back), Some(up), Some(turn)) = (
            roll.share(&raw_us),
            pitch.share(&raw_us),
            throttle.share_about_middle(&raw_us),
            yaw.share(&raw_us),
        ) {
            self.set([-back, right, up, turn], received);
        }
    }

    fn set(&mut self, [forward, right, up, turn]: [f64; 4], received: Timestamp) {
        let beyond = |share| beyond(share, DEAD_ZONE);
        self.level = Vector2::new(beyond(forward), beyond(right)).cap_magnitude(1.0);
        self.up = self::beyond(up, THROTTLE_DEAD_ZONE);
        self.turn = beyond(turn);
        self.received = received;
    }

    /// Time since they were received (s); `None`: never.
    pub fn age_s(&self, now: Timestamp) -> Option<f64> {
        self.received.is_set().then(|| now.seconds_since(self.received))
    }

    /// Whether they are received.
    pub fn is_fresh(&self, now: Timestamp) -> bool {
        self.age_s(now).is_some_and(|age_s| age_s <= STICKS_KEPT_S)
    }

    /// Where the pilot wants to go (north, east, m/s), with `full_mps` at full stick; nowhere if they are not received.
    pub fn velocity(&self, now: Timestamp, yaw_rad: f64, full_mps: f64) -> Vector2<f64> {
        if !self.is_fresh(now) {
            return Vector2::zeros();
        }
        Rotation2::new(yaw_rad) * self.level * full_mps
    }

    /// Share of the climb that is wanted, -1 to 1; 0 if they are not received.
    pub fn up(&self, now: Timestamp) -> f64 {
        if self.is_fresh(now) { self.up } else { 0.0 }
    }

    /// Share of the turn to the right that is wanted, -1 to 1; 0 if they are not received.
    pub fn turn(&self, now: Timestamp) -> f64 {
        if self.is_fresh(now) { self.turn } else { 0.0 }
    }
}

/// What is left of a deflection beyond the dead zone, -1 to 1.
fn beyond(share: f64, dead_zone: f64) -> f64 {
    let share = share.clamp(-1.0, 1.0);
    share.signum() * (share.abs() - dead_zone).max(0.0) / (1.0 - dead_zone)
}

/// Every channel's pulse width (us); `None` where there is no signal.
pub fn channels_us(channels: &RC_CHANNELS_DATA) -> [Option<u16>; CHANNELS] {
    let m = channels;
    [
        m.chan1_raw,
        m.chan2_raw,
        m.chan3_raw,
        m.chan4_raw,
        m.chan5_raw,
        m.chan6_raw,
        m.chan7_raw,
        m.chan8_raw,
        m.chan9_raw,
        m.chan10_raw,
        m.chan11_raw,
        m.chan12_raw,
        m.chan13_raw,
        m.chan14_raw,
        m.chan15_raw,
        m.chan16_raw,
        m.chan17_raw,
        m.chan18_raw,
    ]
    .map(|raw_us| (raw_us != 0 && raw_us != u16::MAX).then_some(raw_us))
}

/// How ArduPilot reads one stick: RCMAP_* and RCn_*.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RcAxis {
    /// Number of the channel, from 1.
    pub channel: usize,
    /// Lower end (us).
    pub min_us: f64,
    /// Centre (us).
    pub trim_us: f64,
    /// Upper end (us).
    pub max_us: f64,
    /// The stick counts the other way round.
    pub is_reversed: bool,
}

impl RcAxis {
    /// Deflection from the trim, -1 to 1; `None` without a signal.
    fn share(&self, raw_us: &[Option<u16>; CHANNELS]) -> Option<f64> {
        self.share_about(self.trim_us, raw_us)
    }

    /// The same from the middle of the range.
    fn share_about_middle(&self, raw_us: &[Option<u16>; CHANNELS]) -> Option<f64> {
        self.share_about(f64::midpoint(self.min_us, self.max_us), raw_us)
    }

    fn share_about(&self, centre_us: f64, raw_us: &[Option<u16>; CHANNELS]) -> Option<f64> {
        let raw_us = f64::from((*raw_us.get(self.channel.checked_sub(1)?)?)?);
        let way_us = if raw_us > centre_us {
            self.max_us - centre_us
        } else {
            centre_us - self.min_us
        };
        // A calibration that is none has no deflection.
        let share = if way_us >= 1.0 {
            (raw_us - centre_us) / way_us
        } else {
            0.0
        };
        let share = share.clamp(-1.0, 1.0);
        Some(if self.is_reversed { -share } else { share })
    }
}

/// How ArduPilot reads the sticks: roll, pitch, throttle, yaw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RcCalibration {
    /// Roll, pitch, throttle, yaw.
    pub axes: [RcAxis; 4],
}

#[cfg(test)]
mod tests {
    use super::{PilotSticks, RcAxis, RcCalibration};
    use jink_shared_types::Timestamp;
    use mavlink::dialect::{MANUAL_CONTROL_DATA, RC_CHANNELS_DATA};
    use nalgebra::Vector2;
    use proptest::prelude::*;

    const NOW: Timestamp = Timestamp::from_ns(5_000_000_000);

    fn calibration() -> RcCalibration {
        let axis = |channel, is_reversed| RcAxis {
            channel,
            min_us: 1100.0,
            trim_us: 1520.0,
            max_us: 1900.0,
            is_reversed,
        };
        RcCalibration {
            axes: [axis(1, false), axis(2, false), axis(3, false), axis(6, true)],
        }
    }

    #[test]
    fn full_sticks_are_full_wishes_and_lost_ones_are_none() {
        let mut sticks = PilotSticks::default();
        assert_eq!(sticks.velocity(NOW, 0.0, 5.0), Vector2::zeros());
        let full = MANUAL_CONTROL_DATA {
            x: 1000,
            z: 1000,
            r: -1000,
            ..MANUAL_CONTROL_DATA::default()
        };
        sticks.take(&full, NOW);
        // The nose to the east.
        let wish = sticks.velocity(NOW, std::f64::consts::FRAC_PI_2, 5.0);
        assert!((wish - Vector2::new(0.0, 5.0)).norm() < 1e-9);
        assert_eq!((sticks.up(NOW), sticks.turn(NOW)), (1.0, -1.0));
        let later = NOW.plus_seconds(0.6);
        assert_eq!(sticks.velocity(later, 0.0, 5.0), Vector2::zeros());
        assert_eq!((sticks.up(later), sticks.turn(later)), (0.0, 0.0));
    }

    #[test]
    fn channels_are_read_as_ardupilot_reads_them() {
        let mut sticks = PilotSticks::default();
        let mut channels = RC_CHANNELS_DATA {
            chan1_raw: 1520,
            chan2_raw: 1100,
            chan3_raw: 1500,
            chan6_raw: 1900,
            ..RC_CHANNELS_DATA::default()
        };
        sticks.take_channels(&channels, &calibration(), NOW);
        assert!((sticks.velocity(NOW, 0.0, 3.0) - Vector2::new(3.0, 0.0)).norm() < 1e-9);
        assert_eq!(
            sticks.up(NOW),
            0.0,
            "the throttle rests in the middle of its range"
        );
        assert_eq!(sticks.turn(NOW), -1.0, "the channel is reversed");
        // No signal on one of them: nothing was received.
        channels.chan2_raw = 0;
        let later = NOW.plus_seconds(1.0);
        sticks.take_channels(&channels, &calibration(), later);
        assert!(!sticks.is_fresh(later));
    }

    proptest! {
        #[test]
        fn no_wish_is_longer_than_a_full_stick(
            x: i16, y: i16, z: i16, r: i16, yaw_rad in -9.0..9.0f64, raw in proptest::array::uniform4(any::<u16>()),
            ends in proptest::array::uniform3(0.0..3000.0f64),
        ) {
            let mut sticks = PilotSticks::default();
            let control = MANUAL_CONTROL_DATA { x, y, z, r, ..MANUAL_CONTROL_DATA::default() };
            sticks.take(&control, NOW);
            let within = |sticks: &PilotSticks| {
                let wish = sticks.velocity(NOW, yaw_rad, 5.0);
                wish.norm() <= 5.0 + 1e-9 && sticks.up(NOW).abs() <= 1.0 && sticks.turn(NOW).abs() <= 1.0
            };
            prop_assert!(within(&sticks));
            let [min_us, trim_us, max_us] = ends;
            let mut odd = calibration();
            for axis in &mut odd.axes {
                *axis = RcAxis { min_us, trim_us, max_us, ..*axis };
            }
            let channels = RC_CHANNELS_DATA {
                chan1_raw: raw[0], chan2_raw: raw[1], chan3_raw: raw[2], chan6_raw: raw[3],
                ..RC_CHANNELS_DATA::default()
            };
            sticks.take_channels(&channels, &odd, NOW);
            prop_assert!(within(&sticks));
        }
    }
}
