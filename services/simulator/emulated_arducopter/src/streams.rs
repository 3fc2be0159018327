//! Which messages leave on which link, and how often: nothing but HEARTBEAT and TIMESYNC until somebody asks.

use jink_emulated_autopilot::link::Link;

/// Interval of HEARTBEAT (us).
const HEARTBEAT_US: u64 = 1_000_000;
/// Interval of TIMESYNC requests (us).
const TIMESYNC_US: u64 = 10_000_000;

macro_rules! streams {
    ($( $(#[$meta:meta])* $name:ident = $id:literal; )*) => {
        /// A message that can be asked for; the number is its MAVLink id.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u32)]
        pub enum Stream { $( $(#[$meta])* $name = $id, )* }

        impl Stream {
            /// All of them.
            pub const ALL: &'static [Stream] = &[$( Stream::$name ),*];
        }
    };
}

streams! {
    /// HEARTBEAT.
    Heartbeat = 0;
    /// SYS_STATUS.
    SysStatus = 1;
    /// SYSTEM_TIME.
    SystemTime = 2;
    /// GPS_RAW_INT.
    GpsRaw = 24;
    /// ATTITUDE.
    Attitude = 30;
    /// ATTITUDE_QUATERNION.
    AttitudeQuaternion = 31;
    /// LOCAL_POSITION_NED.
    LocalPosition = 32;
    /// GLOBAL_POSITION_INT.
    GlobalPosition = 33;
    /// SERVO_OUTPUT_RAW.
    ServoOutput = 36;
    /// MISSION_CURRENT.
    MissionCurrent = 42;
    /// MISSION_ITEM_REACHED.
    MissionItemReached = 46;
    /// NAV_CONTROLLER_OUTPUT.
    NavController = 62;
    /// RC_CHANNELS.
    RcChannels = 65;
    /// VFR_HUD.
    VfrHud = 74;
    /// ATTITUDE_TARGET.
    AttitudeTarget = 83;
    /// POSITION_TARGET_LOCAL_NED.
    PositionTarget = 85;
    /// POSITION_TARGET_GLOBAL_INT.
    PositionTargetGlobal = 87;
    /// HIGHRES_IMU.
    HighresImu = 105;
    /// SCALED_IMU2.
    ScaledImu2 = 116;
    /// DISTANCE_SENSOR, one message per sector.
    DistanceSensor = 132;
    /// BATTERY_STATUS.
    BatteryStatus = 147;
    /// AUTOPILOT_VERSION.
    AutopilotVersion = 148;
    /// HOME_POSITION.
    HomePosition = 242;
    /// EXTENDED_SYS_STATE.
    ExtendedSysState = 245;
}

impl Stream {
    /// The stream of message `id`.
    pub fn of_id(id: u32) -> Option<Self> {
        Self::ALL.iter().copied().find(|stream| *stream as u32 == id)
    }

    fn default_us(self) -> u64 {
        if self == Stream::Heartbeat {
            HEARTBEAT_US
        } else {
            0
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Schedule {
    /// 0 = off.
    interval_us: u64,
    due_us: u64,
}

impl Schedule {
    fn every(interval_us: u64, now_us: u64) -> Self {
        Self {
            interval_us,
            due_us: now_us + interval_us,
        }
    }

    fn is_due(&self, now_us: u64) -> bool {
        self.interval_us != 0 && now_us >= self.due_us
    }

    fn serve(&mut self, now_us: u64) {
        self.due_us += self.interval_us;
        if self.due_us <= now_us {
            self.due_us = now_us + self.interval_us;
        }
    }
}

/// The schedules of both links.
#[derive(Clone, Debug)]
pub struct Streams {
    links: [[Schedule; Stream::ALL.len()]; 2],
    timesync: Schedule,
}

impl Default for Streams {
    fn default() -> Self {
        let link = std::array::from_fn(|i| Schedule::every(Stream::ALL[i].default_us(), 0));
        Self {
            links: [link, link],
            timesync: Schedule::every(TIMESYNC_US, 0),
        }
    }
}

impl Streams {
    /// Number of schedules on both links, the range of the index of [`Streams::take`].
    pub const COUNT: usize = 2 * Stream::ALL.len();

    /// What schedule `index` has to send now; it counts as sent.
    pub fn take(&mut self, index: usize, now_us: u64) -> Option<(Link, Stream)> {
        let (link, stream) = (index / Stream::ALL.len(), index % Stream::ALL.len());
        let schedule = &mut self.links[link][stream];
        if !schedule.is_due(now_us) {
            return None;
        }
        schedule.serve(now_us);
        Some((Link::ALL[link], Stream::ALL[stream]))
    }

    /// Whether a TIMESYNC request goes out now, on both links.
    pub fn take_timesync(&mut self, now_us: u64) -> bool {
        let due = self.timesync.is_due(now_us);
        if due {
            self.timesync.serve(now_us);
        }
        due
    }

    /// SET_MESSAGE_INTERVAL on one link: positive = interval, 0 = default, negative = off. `false` for a message there is none
    /// of.
    pub fn set_interval(&mut self, now_us: u64, link: Link, id: u32, interval_us: f64) -> bool {
        let Some(stream) = Stream::ALL.iter().position(|stream| *stream as u32 == id) else {
            return false;
        };
        let interval_us = if interval_us > 0.0 {
            interval_us as u64
        } else if interval_us < 0.0 {
            0
        } else {
            Stream::ALL[stream].default_us()
        };
        self.links[link as usize][stream] = Schedule::every(interval_us, now_us);
        true
    }

    /// REQUEST_DATA_STREAM: everything at `rate_hz`, HEARTBEAT as it is.
    pub fn set_all(&mut self, now_us: u64, link: Link, rate_hz: f64) {
        let interval_us = if rate_hz > 0.0 { (1e6 / rate_hz) as u64 } else { 0 };
        for (stream, schedule) in Stream::ALL.iter().zip(&mut self.links[link as usize]) {
            if *stream != Stream::Heartbeat {
                *schedule = Schedule::every(interval_us, now_us);
            }
        }
    }

    /// The interval of a message on `link` (us); 0 = off, `None` = no such message.
    pub fn interval_us(&self, link: Link, id: u32) -> Option<u64> {
        let stream = Stream::ALL.iter().position(|stream| *stream as u32 == id)?;
        Some(self.links[link as usize][stream].interval_us)
    }
}
