//! Which messages leave on which link, and how often.
//!
//! Rates are those measured on PX4's links. A stream without anything to say (the trajectory outside automatic modes)
//! waits, and sends [`WAKE_US`] after it has something again.

use super::firmware::Firmware;
use jink_emulated_autopilot::link::Link;

/// From the first content to the first message of a stream that had none: the link's own cycle (us).
const WAKE_US: u64 = 20_000;

/// A message that is sent regularly; the number is its MAVLink id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Stream {
    /// HEARTBEAT.
    Heartbeat = 0,
    /// SYS_STATUS.
    SysStatus = 1,
    /// SYSTEM_TIME.
    SystemTime = 2,
    /// ATTITUDE.
    Attitude = 30,
    /// ATTITUDE_QUATERNION.
    AttitudeQuaternion = 31,
    /// LOCAL_POSITION_NED.
    LocalPosition = 32,
    /// GLOBAL_POSITION_INT.
    GlobalPosition = 33,
    /// MISSION_CURRENT.
    MissionCurrent = 42,
    /// MANUAL_CONTROL: the sticks, to whoever asks for them.
    ManualControl = 69,
    /// POSITION_TARGET_LOCAL_NED.
    PositionTarget = 85,
    /// POSITION_TARGET_GLOBAL_INT: the waypoint being flown.
    PositionTargetGlobal = 87,
    /// TIMESYNC requests.
    Timesync = 111,
    /// ALTITUDE.
    Altitude = 141,
    /// HOME_POSITION.
    HomePosition = 242,
    /// EXTENDED_SYS_STATE.
    ExtendedSysState = 245,
    /// OBSTACLE_DISTANCE: the fused map of collision prevention.
    ObstacleDistance = 330,
    /// ODOMETRY.
    Odometry = 331,
    /// TRAJECTORY_REPRESENTATION_WAYPOINTS.
    Trajectory = 332,
    /// ORBIT_EXECUTION_STATUS: the circle, while it is flown.
    OrbitStatus = 360,
    /// CURRENT_MODE.
    CurrentMode = 436,
}

use Stream as S;

impl Stream {
    /// Whether `firmware` sends it.
    fn exists_in(self, firmware: Firmware) -> bool {
        match self {
            S::Trajectory => firmware.has_trajectory_interface(),
            S::ObstacleDistance | S::Odometry | S::CurrentMode => firmware == Firmware::Current,
            _ => true,
        }
    }
}

/// Stream, rate to the companion, rate to the ground station (Hz); 0 = off.
const RATES_HZ: [(Stream, f64, f64); 20] = [
    (S::Heartbeat, 1.0, 1.0),
    (S::SysStatus, 5.0, 1.0),
    (S::SystemTime, 1.0, 1.0),
    (S::Attitude, 100.0, 20.0),
    (S::AttitudeQuaternion, 50.0, 0.0),
    (S::LocalPosition, 30.0, 1.0),
    (S::GlobalPosition, 50.0, 5.0),
    (S::MissionCurrent, 1.0, 1.0),
    (S::ManualControl, 0.0, 0.0),
    (S::PositionTarget, 10.0, 1.5),
    (S::PositionTargetGlobal, 10.0, 1.5),
    (S::Timesync, 10.0, 0.0),
    (S::Altitude, 10.0, 1.0),
    (S::HomePosition, 0.5, 0.5),
    (S::ExtendedSysState, 5.0, 1.0),
    (S::ObstacleDistance, 10.0, 1.0),
    (S::Odometry, 30.0, 0.0),
    (S::Trajectory, 5.0, 0.0),
    (S::OrbitStatus, 5.0, 2.0),
    (S::CurrentMode, 0.5, 0.5),
];

#[derive(Clone, Copy, Debug)]
struct Schedule {
    stream: Stream,
    /// The firmware has such a stream.
    exists: bool,
    default_us: u64,
    /// 0 = off.
    interval_us: u64,
    due_us: u64,
}

impl Schedule {
    fn new(firmware: Firmware, stream: Stream, rate_hz: f64) -> Self {
        let exists = stream.exists_in(firmware);
        let on = exists && rate_hz > 0.0;
        let interval_us = if on { (1e6 / rate_hz) as u64 } else { 0 };
        Self {
            stream,
            exists,
            default_us: interval_us,
            interval_us,
            due_us: interval_us,
        }
    }
}

/// The schedules of both links.
#[derive(Clone, Debug)]
pub struct Streams {
    links: [[Schedule; RATES_HZ.len()]; 2],
}

impl Streams {
    /// The schedules of `firmware` at boot.
    pub fn new(firmware: Firmware) -> Self {
        let companion = RATES_HZ.map(|(stream, rate_hz, _)| Schedule::new(firmware, stream, rate_hz));
        let ground_station = RATES_HZ.map(|(stream, _, rate_hz)| Schedule::new(firmware, stream, rate_hz));
        Self {
            links: [companion, ground_station],
        }
    }

    /// Number of schedules on both links, the range of the index of [`Streams::due`].
    pub const COUNT: usize = 2 * RATES_HZ.len();

    /// The stream of message `message_id`.
    pub fn find(&self, message_id: u32) -> Option<Stream> {
        let companion = self.links[Link::Companion as usize].iter();
        companion
            .filter(|s| s.exists)
            .map(|s| s.stream)
            .find(|stream| *stream as u32 == message_id)
    }

    /// What schedule `index` has to send now.
    pub fn due(&self, index: usize, now_us: u64) -> Option<(Link, Stream)> {
        let link = Link::ALL[index / RATES_HZ.len()];
        let schedule = &self.links[link as usize][index % RATES_HZ.len()];
        let due = schedule.interval_us != 0 && now_us >= schedule.due_us;
        due.then_some((link, schedule.stream))
    }

    /// Schedule `index` was served; `sent`: there was something to say.
    pub fn served(&mut self, index: usize, now_us: u64, sent: bool) {
        let schedule = &mut self.links[index / RATES_HZ.len()][index % RATES_HZ.len()];
        if !sent {
            schedule.due_us = now_us + WAKE_US;
            return;
        }
        schedule.due_us += schedule.interval_us;
        if schedule.due_us <= now_us {
            schedule.due_us = now_us + schedule.interval_us;
        }
    }

    /// SET_MESSAGE_INTERVAL: positive = interval, 0 = default, negative = off. Returns whether that can be done: not for a
    /// message without a stream, and not for HEARTBEAT.
    pub fn set_interval(&mut self, now_us: u64, link: Link, message_id: u32, interval_us: f64) -> bool {
        let found = self.links[link as usize]
            .iter_mut()
            .find(|s| s.exists && s.stream as u32 == message_id);
        let Some(schedule) = found else { return false };
        if schedule.stream == Stream::Heartbeat {
            return false;
        }
        schedule.interval_us = if interval_us > 0.0 {
            interval_us as u64
        } else if interval_us < 0.0 {
            0
        } else {
            schedule.default_us
        };
        schedule.due_us = schedule.due_us.min(now_us + schedule.interval_us);
        true
    }

    /// The interval of a message on `link` (us); 0 = off, `None` = no such stream.
    pub fn interval_us(&self, link: Link, message_id: u32) -> Option<u64> {
        self.links[link as usize]
            .iter()
            .find(|s| s.exists && s.stream as u32 == message_id)
            .map(|s| s.interval_us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(streams: &mut Streams, stream: Stream, link: Link, seconds: u64) -> usize {
        let mut sent = 0;
        for now_us in (0..seconds * 1_000_000).step_by(4_000) {
            for index in 0..Streams::COUNT {
                if let Some(due) = streams.due(index, now_us) {
                    sent += usize::from(due == (link, stream));
                    streams.served(index, now_us, true);
                }
            }
        }
        sent
    }

    #[test]
    fn rates_are_kept_on_average_although_steps_are_coarse() {
        for firmware in [Firmware::default(), Firmware::Current] {
            for (stream, companion_hz, ground_hz) in RATES_HZ {
                for (link, hz) in [(Link::Companion, companion_hz), (Link::GroundStation, ground_hz)] {
                    let hz = if stream.exists_in(firmware) { hz } else { 0.0 };
                    let sent = count(&mut Streams::new(firmware), stream, link, 20) as f64;
                    assert!((sent - 20.0 * hz).abs() <= 1.0, "{stream:?} {link:?} {sent}");
                }
            }
        }
    }

    #[test]
    fn an_interval_can_be_changed_but_not_that_of_the_heartbeat() {
        let mut streams = Streams::new(Firmware::default());
        assert!(!streams.set_interval(0, Link::Companion, 0, 20_000.0));
        assert!(!streams.set_interval(0, Link::Companion, 9_999, 20_000.0));
        assert!(streams.set_interval(0, Link::Companion, 332, 20_000.0));
        assert_eq!(count(&mut streams, Stream::Trajectory, Link::Companion, 2), 99);
        assert!(streams.set_interval(0, Link::Companion, 332, -1.0));
        assert_eq!(streams.interval_us(Link::Companion, 332), Some(0));
        assert!(streams.set_interval(0, Link::Companion, 332, 0.0));
        assert_eq!(streams.interval_us(Link::Companion, 332), Some(200_000));
        let mut current = Streams::new(Firmware::Current);
        assert!(!current.set_interval(0, Link::Companion, 332, 20_000.0));
        assert_eq!(current.interval_us(Link::Companion, 332), None);
    }
}
