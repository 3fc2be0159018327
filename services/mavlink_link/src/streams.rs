//! The messages that the gateway needs, requested when they do not come by themselves.
//!
//! Every two seconds the arrivals are compared with what is needed. A stream that brings less than half of it is asked
//! for by MAV_CMD_SET_MESSAGE_INTERVAL, a one-off message by MAV_CMD_REQUEST_MESSAGE; one request at a time, each
//! repeated after seconds, and after a refusal only after half a minute. The sticks are asked for before they are
//! needed, or the first seconds in Position mode would be flown without them; they may be missing then, because no
//! remote control is switched on.

use crate::profile_name::ProfileName;
use jink_shared_types::Timestamp;
use jink_shared_types::vehicle::NavMode;
use mavlink::MessageData;
#[allow(deprecated)] // Gone from PX4 1.16 on; this profile is for the versions before.
use mavlink::dialect::TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA;
use mavlink::dialect::{
    ALTITUDE_DATA, ATTITUDE_QUATERNION_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA, CURRENT_MODE_DATA,
    EXTENDED_SYS_STATE_DATA, GLOBAL_POSITION_INT_DATA, HOME_POSITION_DATA, LOCAL_POSITION_NED_DATA,
    MANUAL_CONTROL_DATA, MISSION_CURRENT_DATA, MavCmd, MavMessage, MavResult,
    POSITION_TARGET_GLOBAL_INT_DATA, POSITION_TARGET_LOCAL_NED_DATA,
};

/// How long arrivals are counted before they are judged (s).
const WINDOW_S: f64 = 2.0;
/// Pause between two requests of any kind (s).
const PAUSE_S: f64 = 0.5;
/// Pause before the same stream is asked for again (s): it may need a while to show.
const REPEAT_S: f64 = 4.0;
/// The same if no answer came (s): request or answer got lost. Longer than two ways of a link that is late.
const UNANSWERED_S: f64 = 1.0;
/// The same after a refusal (s): the autopilot may have been busy, but hardly changes its mind.
const REFUSED_S: f64 = 30.0;

/// When a stream is needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Need {
    Always,
    /// Sent by PX4 in automatic modes only.
    InAutomaticModes,
    /// Needed in this mode only; asked for before, so that it comes when the mode begins.
    In(NavMode),
    /// Some autopilots send it only while they have a mission.
    WithMission,
    /// One message is enough.
    Once,
}

#[derive(Clone, Copy, Debug)]
struct StreamState {
    message_id: u32,
    rate_hz: f64,
    /// What is asked for (Hz): more where a message comes at changes only, as soon after them as it is asked for often.
    asked_hz: f64,
    need: Need,
    arrived: u32,
    is_short: bool,
    not_before: Timestamp,
    /// What the last whole window brought; `None` before it has ended.
    came_hz: Option<f64>,
}

impl StreamState {
    /// Whether to ask for it: it is short, or will be needed and has not come.
    fn is_wanted(&self) -> bool {
        let comes_later = matches!(self.need, Need::In(_) | Need::WithMission);
        self.is_short || comes_later && self.came_hz == Some(0.0)
    }
}

/// How a stream comes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamRate {
    /// Message type.
    pub message_id: u32,
    /// What is needed (Hz).
    pub needed_hz: f64,
    /// What came in the last whole window (Hz).
    pub came_hz: f64,
    /// It has to come again and again; if not, it came once.
    pub is_steady: bool,
    /// It came less than half as often as it should, or never.
    pub is_short: bool,
}

const fn stream(message_id: u32, rate_hz: f64, need: Need) -> StreamState {
    StreamState {
        message_id,
        rate_hz,
        asked_hz: rate_hz,
        need,
        arrived: 0,
        is_short: false,
        not_before: Timestamp::NEVER,
        came_hz: None,
    }
}

/// A mode is reported within this time after it has changed, if it is requested this often (Hz). It comes twice a
/// second all the same.
const MODE_ASKED_HZ: f64 = 20.0;

/// ArduCopter reports a target set by another sender until jink's next setpoint, 20 ms at most: requested this often
/// (Hz), which is half of its main loop's rate and 13 kB/s, 11 of 14 were seen in flight; with the 60 Hz that every
/// link carries, some four of seven.
const TARGET_ASKED_HZ: f64 = 200.0;

/// What every profile needs, most important first.
const ALWAYS: [StreamState; 4] = [
    stream(EXTENDED_SYS_STATE_DATA::ID, 5.0, Need::Always),
    stream(LOCAL_POSITION_NED_DATA::ID, 30.0, Need::Always),
    stream(ATTITUDE_QUATERNION_DATA::ID, 50.0, Need::Always),
    stream(HOME_POSITION_DATA::ID, 0.5, Need::Once),
];

/// Where the mission is flown by jink: where it lies, and how far it is.
const MISSION: [StreamState; 2] = [
    stream(GLOBAL_POSITION_INT_DATA::ID, 5.0, Need::Always),
    stream(MISSION_CURRENT_DATA::ID, 2.0, Need::WithMission),
];

/// What a profile needs besides. ArduCopter has no ALTITUDE; its heartbeat comes at once when the mode changes, while
/// PX4's comes once a second and CURRENT_MODE at every change, if it is asked for.
#[allow(deprecated)]
fn besides(profile: ProfileName) -> Vec<StreamState> {
    let altitude = stream(ALTITUDE_DATA::ID, 5.0, Need::Always);
    let path = TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::ID;
    match profile {
        ProfileName::Px4Trajectory => vec![
            stream(path, 5.0, Need::InAutomaticModes),
            stream(MISSION_CURRENT_DATA::ID, 1.0, Need::WithMission),
            altitude,
        ],
        ProfileName::Px4Offboard | ProfileName::Px4Deviation => {
            let mode = StreamState {
                asked_hz: MODE_ASKED_HZ,
                ..stream(CURRENT_MODE_DATA::ID, 2.0, Need::Always)
            };
            let sticks = stream(MANUAL_CONTROL_DATA::ID, 20.0, Need::In(NavMode::Position));
            let sticks = profile.steers().then_some(sticks);
            // A go-to in Hold is flown to by PX4 itself until it is seen here.
            let target = stream(POSITION_TARGET_GLOBAL_INT_DATA::ID, 10.0, Need::In(NavMode::Hold));
            MISSION
                .into_iter()
                .chain([mode, altitude, target])
                .chain(sticks)
                .collect()
        }
        ProfileName::ArdupilotGuided => {
            // Between two setpoints a target of another sender shows. More often than these come, and never in step
            // with them: at their own rate it would be reported just after each of them for a whole flight, or just
            // before.
            let target = stream(
                POSITION_TARGET_LOCAL_NED_DATA::ID,
                60.0,
                Need::In(NavMode::Offboard),
            );
            MISSION.into_iter().chain([target]).collect()
        }
    }
}

/// Watches the streams and asks for what is missing.
#[derive(Clone, Debug)]
pub struct Streams {
    streams: Vec<StreamState>,
    window_end: Timestamp,
    /// The mode in which the whole window was, if it was one.
    window_mode: Option<NavMode>,
    next_request: Timestamp,
    asked: Option<usize>,
}

impl Streams {
    /// For what `profile` needs.
    pub fn new(profile: ProfileName) -> Self {
        let mut streams = ALWAYS.to_vec();
        streams.extend(besides(profile));
        Self {
            streams,
            window_end: Timestamp::NEVER,
            window_mode: None,
            next_request: Timestamp::NEVER,
            asked: None,
        }
    }

    /// Over a link that carries it a target of another sender is requested as often as the autopilot can report it.
    pub fn look_often(&mut self) {
        for stream in &mut self.streams {
            if stream.message_id == POSITION_TARGET_LOCAL_NED_DATA::ID {
                stream.asked_hz = TARGET_ASKED_HZ;
            }
        }
    }

    /// A message that has to come besides, this often (Hz).
    pub fn need(&mut self, message_id: u32, rate_hz: f64) {
        self.streams.push(stream(message_id, rate_hz, Need::Always));
    }

    /// Sticks that have to come this often (Hz) while a pilot flies; what is needed already stays as it is.
    pub fn need_sticks(&mut self, message_id: u32, rate_hz: f64) {
        if self.streams.iter().all(|stream| stream.message_id != message_id) {
            self.streams
                .push(stream(message_id, rate_hz, Need::In(NavMode::Position)));
        }
    }

    /// Counts an arrival.
    pub fn arrived(&mut self, message_id: u32) {
        if let Some(stream) = self.streams.iter_mut().find(|s| s.message_id == message_id) {
            stream.arrived = stream.arrived.saturating_add(1);
        }
    }

    /// Takes the answer to the last request.
    pub fn answered(&mut self, now: Timestamp, ack: &COMMAND_ACK_DATA) {
        let ours = matches!(
            ack.command,
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL | MavCmd::MAV_CMD_REQUEST_MESSAGE
        );
        let refused = matches!(
            ack.result,
            MavResult::MAV_RESULT_DENIED | MavResult::MAV_RESULT_UNSUPPORTED | MavResult::MAV_RESULT_FAILED
        );
        if ours && let Some(stream) = self.asked.take().map(|asked| &mut self.streams[asked]) {
            let waits = refused || stream.need == Need::WithMission;
            let pause_s = if waits { REFUSED_S } else { REPEAT_S };
            stream.not_before = stream.not_before.max(now.plus_seconds(pause_s));
        }
    }

    /// The next request to the autopilot of `system_id`, which is in `mode`, if one is due.
    pub fn request(&mut self, now: Timestamp, mode: NavMode, target: (u8, u8)) -> Option<MavMessage> {
        if !self.window_end.is_set() {
            self.begin_window(now, mode);
        }
        let is_alike = |before: &NavMode| *before == mode || before.is_automatic() && mode.is_automatic();
        self.window_mode = self.window_mode.filter(is_alike);
        if now >= self.window_end {
            self.judge();
            self.begin_window(now, mode);
        }
        if now < self.next_request {
            return None;
        }
        // The most important first, and then the one that waits longest.
        let waiting = self.streams.iter().enumerate();
        let (due, _) = waiting
            .filter(|(_, s)| s.is_wanted() && now >= s.not_before)
            .min_by_key(|(_, s)| s.not_before)?;
        let stream = &mut self.streams[due];
        let is_urgent = stream.is_short || stream.need == Need::WithMission;
        stream.not_before = now.plus_seconds(if is_urgent { UNANSWERED_S } else { REFUSED_S });
        self.next_request = now.plus_seconds(PAUSE_S);
        self.asked = Some(due);
        Some(ask(stream, target))
    }

    /// When [`Self::request`] has something to do next.
    pub fn next_wake(&self) -> Timestamp {
        self.streams
            .iter()
            .filter(|s| s.is_wanted())
            .map(|s| s.not_before.max(self.next_request))
            .fold(self.window_end, Timestamp::min)
    }

    /// Every stream as the last whole window has shown it; nothing before the first has ended.
    pub fn rates(&self) -> impl Iterator<Item = StreamRate> {
        self.streams.iter().filter_map(|stream| {
            stream.came_hz.map(|came_hz| StreamRate {
                message_id: stream.message_id,
                needed_hz: stream.rate_hz,
                came_hz,
                is_steady: stream.need != Need::Once,
                is_short: stream.is_short,
            })
        })
    }

    fn begin_window(&mut self, now: Timestamp, mode: NavMode) {
        self.window_end = now.plus_seconds(WINDOW_S);
        self.window_mode = Some(mode);
    }

    fn judge(&mut self) {
        for stream in &mut self.streams {
            let enough = (0.5 * WINDOW_S * stream.rate_hz).max(1.0);
            let came = f64::from(stream.arrived) >= enough;
            stream.is_short = !came
                && match stream.need {
                    Need::Always | Need::Once => true,
                    Need::InAutomaticModes => self.window_mode.is_some_and(NavMode::is_automatic),
                    Need::In(mode) => self.window_mode == Some(mode),
                    Need::WithMission => false,
                };
            stream.came_hz = Some(f64::from(stream.arrived) / WINDOW_S);
            if stream.need != Need::Once {
                stream.arrived = 0;
            }
        }
    }
}

fn ask(stream: &StreamState, (target_system, target_component): (u8, u8)) -> MavMessage {
    let once = stream.need == Need::Once;
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1: stream.message_id as f32,
        param2: if once { 0.0 } else { (1e6 / stream.asked_hz) as f32 },
        command: if once {
            MavCmd::MAV_CMD_REQUEST_MESSAGE
        } else {
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL
        },
        target_system,
        target_component,
        ..COMMAND_LONG_DATA::default()
    })
}

#[cfg(test)]
mod tests {
    use super::{Need, Streams};
    use crate::profile_name::ProfileName;
    use jink_shared_types::Timestamp;
    use jink_shared_types::vehicle::NavMode;
    use mavlink::MessageData;
    use mavlink::dialect::{COMMAND_ACK_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult};

    fn all() -> Streams {
        Streams::new(ProfileName::Px4Trajectory)
    }

    /// Runs 20 s at 100 Hz; `arrives` selects the messages that come at 100 Hz. Returns the requests with their times.
    fn run(
        streams: &mut Streams,
        mode: NavMode,
        arrives: impl Fn(u32) -> bool,
        answer: Option<MavResult>,
    ) -> Vec<(f64, COMMAND_LONG_DATA)> {
        let mut requests = Vec::new();
        for i in 0..2000 {
            let now = Timestamp::from_seconds(10.0 + f64::from(i) * 0.01);
            let arriving: Vec<_> = streams
                .streams
                .iter()
                .map(|s| s.message_id)
                .filter(|id| arrives(*id))
                .collect();
            for message_id in arriving {
                streams.arrived(message_id);
            }
            if let Some(MavMessage::COMMAND_LONG(request)) = streams.request(now, mode, (1, 1)) {
                if let Some(result) = answer {
                    let ack = COMMAND_ACK_DATA {
                        command: request.command,
                        result,
                        ..COMMAND_ACK_DATA::default()
                    };
                    streams.answered(now, &ack);
                }
                requests.push((f64::from(i) * 0.01, request));
            }
        }
        requests
    }

    #[test]
    fn nothing_is_asked_for_that_comes_by_itself() {
        assert!(run(&mut all(), NavMode::Mission, |_| true, None).is_empty());
    }

    #[test]
    fn the_sticks_are_asked_for_before_they_are_needed_and_may_be_missing_until_then() {
        let sticks = mavlink::dialect::MANUAL_CONTROL_DATA::ID;
        let asked_in = |mode| {
            let mut streams = Streams::new(ProfileName::Px4Deviation);
            let requests = run(&mut streams, mode, |id| id != sticks, None);
            let is_short = streams
                .rates()
                .any(|rate| rate.message_id == sticks && rate.is_short);
            (requests.len(), is_short)
        };
        assert_eq!(asked_in(NavMode::Mission), (1, false));
        let (times, is_short) = asked_in(NavMode::Position);
        assert!(times >= 3 && is_short);
    }

    #[test]
    fn what_comes_in_guided_only_or_with_a_mission_only_is_no_fault_elsewhere() {
        use mavlink::dialect::{MISSION_CURRENT_DATA, POSITION_TARGET_LOCAL_NED_DATA};
        let seen_in = |mode, answer| {
            let mut streams = Streams::new(ProfileName::ArdupilotGuided);
            let silent = [MISSION_CURRENT_DATA::ID, POSITION_TARGET_LOCAL_NED_DATA::ID];
            let requests = run(&mut streams, mode, |id| !silent.contains(&id), answer);
            let short: Vec<_> = streams.rates().filter(|rate| rate.is_short).collect();
            (
                requests.len(),
                short.iter().map(|rate| rate.message_id).collect::<Vec<_>>(),
            )
        };
        let granted = Some(MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(seen_in(NavMode::Manual, granted), (2, vec![]));
        assert_eq!(
            seen_in(NavMode::Offboard, granted).1,
            [POSITION_TARGET_LOCAL_NED_DATA::ID]
        );
    }

    #[test]
    fn a_place_asked_for_is_looked_for_more_often_over_a_fast_link() {
        use mavlink::dialect::POSITION_TARGET_LOCAL_NED_DATA as Target;
        let asked_us = |fast: bool| {
            let mut streams = Streams::new(ProfileName::ArdupilotGuided);
            if fast {
                streams.look_often();
            }
            let requests = run(&mut streams, NavMode::Offboard, |id| id != Target::ID, None);
            let asked = requests
                .iter()
                .find(|(_, request)| request.param1 == Target::ID as f32);
            let needed_hz = streams.rates().find(|rate| rate.message_id == Target::ID);
            (asked.unwrap().1.param2, needed_hz.unwrap().needed_hz)
        };
        assert_eq!(asked_us(true), (5_000.0, 60.0));
        assert!((asked_us(false).0 - 16_666.7).abs() < 1.0);
    }

    #[test]
    fn what_is_missing_after_two_seconds_is_asked_for_and_never_flooded() {
        let requests = run(&mut all(), NavMode::Mission, |_| false, None);
        assert!(requests[0].0 >= 2.0);
        for pair in requests.windows(2) {
            assert!(pair[1].0 - pair[0].0 >= 0.499);
        }
        for stream in all().streams {
            let times: Vec<_> = requests
                .iter()
                .filter(|(_, request)| request.param1 == stream.message_id as f32)
                .map(|(time, _)| *time)
                .collect();
            assert!(
                times.len() >= 3,
                "{} was asked for {} times",
                stream.message_id,
                times.len()
            );
            // Nobody answers: the request may have got lost.
            assert!(times.windows(2).all(|pair| pair[1] - pair[0] >= 0.99));
        }
        assert_eq!(
            requests[0].1.param1, 245.0,
            "whether it stands on the ground comes first"
        );
        let position = &requests
            .iter()
            .find(|(_, request)| request.param1 == 32.0)
            .unwrap()
            .1;
        assert_eq!(position.command, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL);
        assert_eq!((position.param1, position.param2.round()), (32.0, 33333.0));
        assert!(requests.iter().any(|(_, request)| {
            request.command == MavCmd::MAV_CMD_REQUEST_MESSAGE && request.param1 == 242.0
        }));
    }

    #[test]
    fn what_was_promised_is_given_time_to_show() {
        let granted = Some(MavResult::MAV_RESULT_ACCEPTED);
        let requests = run(&mut all(), NavMode::Mission, |_| false, granted);
        for stream in all().streams {
            if stream.need == Need::WithMission {
                continue; // There may be no mission.
            }
            let id = stream.message_id as f32;
            let mut times = requests
                .iter()
                .filter(|(_, r)| r.param1 == id)
                .map(|(time, _)| *time);
            let (first, second) = (times.next().unwrap(), times.next().unwrap());
            assert!(second - first >= 3.99, "{id}: {first} s, {second} s");
        }
    }

    #[test]
    fn a_refusal_is_respected_for_half_a_minute() {
        let requests = run(
            &mut all(),
            NavMode::Mission,
            |_| false,
            Some(MavResult::MAV_RESULT_UNSUPPORTED),
        );
        assert_eq!(requests.len(), all().streams.len());
    }

    #[test]
    fn the_desired_path_is_missed_in_automatic_modes_only() {
        let requests = run(&mut all(), NavMode::Manual, |id| id != 332, None);
        assert!(requests.is_empty());
        let requests = run(&mut all(), NavMode::Mission, |id| id != 332, None);
        assert!(!requests.is_empty() && requests.iter().all(|(_, request)| request.param1 == 332.0));
    }
}
