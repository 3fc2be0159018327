//! Commands addressed to us: each gets exactly one COMMAND_ACK, and those that mean something here are obeyed.
//!
//! | command | answer |
//! |---|---|
//! | MAV_CMD_REQUEST_MESSAGE for something that the component says ([`MESSAGES`]) | ACCEPTED, the message |
//! | the same of ONBOARD_COMPUTER_STATUS, before the board has been read | TEMPORARILY_REJECTED |
//! | MAV_CMD_SET_MESSAGE_INTERVAL within the limits of a message that may be slower or faster | ACCEPTED |
//! | the same for anything else: heartbeats and setpoints are what safety rests on | DENIED |
//! | MAV_CMD_GET_MESSAGE_INTERVAL | ACCEPTED, MESSAGE_INTERVAL |
//! | MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, restart, disarmed | ACCEPTED, and the gateway is started anew |
//! | the same while armed, while that is not known, or while a restart is under way | TEMPORARILY_REJECTED |
//! | the same, shutdown | DENIED: what keeps a vehicle from hitting things is not switched off from afar |
//! | MAV_CMD_USER_1, 1: a pilot is to be assisted, 0: not any more ([`crate::assist`]) | ACCEPTED, or TEMPORARILY_REJECTED with a text that says why; other numbers DENIED |
//! | MAV_CMD_COMPONENT_ARM_DISARM | DENIED: we have no motors |
//! | everything else, known to the dialect or not | UNSUPPORTED |
//!
//! Commands to all components (target 0) are not ours to refuse: the autopilot answers them. All that is obeyed is done at once,
//! so nothing is ever IN_PROGRESS.

#![allow(deprecated)] // PROTOCOL_VERSION and GET_MESSAGE_INTERVAL are going, ground stations that ask for them are not.

use jink_mavlink_link::message::Content;
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{
    AUTOPILOT_VERSION_DATA, COMPONENT_METADATA_DATA, HEARTBEAT_DATA, MESSAGE_INTERVAL_DATA, MavCmd,
    MavMessage, MavResult, OBSTACLE_DISTANCE_DATA, ONBOARD_COMPUTER_STATUS_DATA, PROTOCOL_VERSION_DATA,
    TIMESYNC_DATA,
};

/// Which of our components a command names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// 196.
    Avoidance,
    /// 191.
    Computer,
}

/// A message that is said on request, or whose rhythm may be asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// HEARTBEAT.
    Heartbeat,
    /// TIMESYNC.
    Timesync,
    /// OBSTACLE_DISTANCE.
    Obstacles,
    /// ONBOARD_COMPUTER_STATUS.
    Computer,
    /// AUTOPILOT_VERSION.
    Version,
    /// PROTOCOL_VERSION.
    Protocol,
    /// COMPONENT_METADATA.
    Metadata,
}

/// What may be done with a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Freedom {
    /// It comes at its own rate.
    Fixed,
    /// Its period may be set within these limits (s); `stoppable`: it may be silenced.
    Settable {
        /// Shortest period.
        shortest_s: f64,
        /// Longest period.
        longest_s: f64,
        /// Nobody flies by it.
        stoppable: bool,
    },
    /// It comes only on request.
    OnRequest,
}

/// What is said by whom. An autopilot that prevents collisions by OBSTACLE_DISTANCE stops the vehicle when none has come for
/// 500 ms: two may be lost at 5 Hz, and more than 30 a second crowd a serial line.
pub const MESSAGES: &[(Role, u32, Topic, Freedom)] = &[
    (
        Role::Avoidance,
        HEARTBEAT_DATA::ID,
        Topic::Heartbeat,
        Freedom::Fixed,
    ),
    (
        Role::Avoidance,
        TIMESYNC_DATA::ID,
        Topic::Timesync,
        Freedom::Fixed,
    ),
    (
        Role::Avoidance,
        OBSTACLE_DISTANCE_DATA::ID,
        Topic::Obstacles,
        Freedom::Settable {
            shortest_s: 1.0 / 30.0,
            longest_s: 0.2,
            stoppable: false,
        },
    ),
    (
        Role::Avoidance,
        AUTOPILOT_VERSION_DATA::ID,
        Topic::Version,
        Freedom::OnRequest,
    ),
    (
        Role::Avoidance,
        PROTOCOL_VERSION_DATA::ID,
        Topic::Protocol,
        Freedom::OnRequest,
    ),
    (
        Role::Avoidance,
        COMPONENT_METADATA_DATA::ID,
        Topic::Metadata,
        Freedom::OnRequest,
    ),
    (
        Role::Computer,
        HEARTBEAT_DATA::ID,
        Topic::Heartbeat,
        Freedom::Fixed,
    ),
    (
        Role::Computer,
        ONBOARD_COMPUTER_STATUS_DATA::ID,
        Topic::Computer,
        Freedom::Settable {
            shortest_s: 1.0,
            longest_s: 60.0,
            stoppable: true,
        },
    ),
    (
        Role::Computer,
        AUTOPILOT_VERSION_DATA::ID,
        Topic::Version,
        Freedom::OnRequest,
    ),
    (
        Role::Computer,
        PROTOCOL_VERSION_DATA::ID,
        Topic::Protocol,
        Freedom::OnRequest,
    ),
];

/// A rhythm that was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rhythm {
    /// Our own.
    Usual,
    /// One message per so many seconds.
    Period(f64),
    /// None at all.
    Silent,
}

/// What is to be done besides the acknowledgement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Deed {
    /// Nothing.
    Nothing,
    /// It is said once.
    Say(Topic),
    /// Its rhythm is changed.
    Set(Topic, Rhythm),
    /// Its rhythm is told; `None`: it never comes by itself.
    TellInterval(u32, Option<Topic>),
    /// The gateway is started anew.
    Restart,
    /// Whoever asked is told why there is no restart.
    ExplainRefusal,
    /// A pilot is assisted (`true`), or not any more.
    Assist(bool),
}

/// What a command is judged by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Circumstances {
    /// The component it names.
    pub role: Role,
    /// Whether the vehicle is armed, if that is known.
    pub armed: Option<bool>,
    /// A restart is under way.
    pub restarting: bool,
}

/// A command, in whichever message it came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Number.
    pub command: u16,
    /// First and second parameter; NaN if they could not be read.
    pub params: [f32; 2],
    /// Addressed system, 0 = all.
    pub target_system: u8,
    /// Addressed component, 0 = all.
    pub target_component: u8,
}

impl Command {
    /// The command in `content`, if it is one.
    pub fn of(content: &Content) -> Option<Self> {
        match content {
            Content::Message(MavMessage::COMMAND_LONG(data)) => Some(Self {
                command: data.command as u16,
                params: [data.param1, data.param2],
                target_system: data.target_system,
                target_component: data.target_component,
            }),
            Content::Message(MavMessage::COMMAND_INT(data)) => Some(Self {
                command: data.command as u16,
                params: [data.param1, data.param2],
                target_system: data.target_system,
                target_component: data.target_component,
            }),
            Content::Message(_) => None,
            Content::UnknownCommand {
                command,
                target_system,
                target_component,
            } => Some(Self {
                command: *command,
                params: [f32::NAN; 2],
                target_system: *target_system,
                target_component: *target_component,
            }),
        }
    }

    /// The result that is acknowledged, and what is to be done.
    pub fn judge(&self, circumstances: &Circumstances) -> (MavResult, Deed) {
        let [first, second] = self.params;
        let is = |command: MavCmd| self.command == command as u16;
        if is(MavCmd::MAV_CMD_REQUEST_MESSAGE) {
            request(circumstances.role, first, second)
        } else if is(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL) {
            set_interval(circumstances.role, first, second)
        } else if is(MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL) {
            tell_interval(circumstances.role, first)
        } else if is(MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN) {
            reboot(circumstances, first, second)
        } else if is(MavCmd::MAV_CMD_USER_1) && circumstances.role == Role::Avoidance {
            match first {
                1.0 => (MavResult::MAV_RESULT_ACCEPTED, Deed::Assist(true)),
                0.0 => (MavResult::MAV_RESULT_ACCEPTED, Deed::Assist(false)),
                _ => (MavResult::MAV_RESULT_DENIED, Deed::Nothing),
            }
        } else if is(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM) {
            (MavResult::MAV_RESULT_DENIED, Deed::Nothing)
        } else {
            (MavResult::MAV_RESULT_UNSUPPORTED, Deed::Nothing)
        }
    }
}

/// The row of a message.
fn find(role: Role, id: u32) -> Option<(Topic, Freedom)> {
    let row = MESSAGES.iter().find(|row| row.0 == role && row.1 == id)?;
    Some((row.2, row.3))
}

/// A parameter that numbers something.
fn whole(param: f32) -> Option<u32> {
    // Beyond, floats leave numbers out.
    const EXACT: f32 = 16_777_216.0;
    ((0.0..=EXACT).contains(&param) && param.fract() == 0.0).then_some(param as u32)
}

fn request(role: Role, id: f32, of: f32) -> (MavResult, Deed) {
    match whole(id) {
        Some(id) if id == MESSAGE_INTERVAL_DATA::ID => tell_interval(role, of),
        id => match id.and_then(|id| find(role, id)) {
            // Ours is a question or an answer to one, nothing to be said by itself.
            None | Some((Topic::Timesync, _)) => (MavResult::MAV_RESULT_UNSUPPORTED, Deed::Nothing),
            Some((topic, _)) => (MavResult::MAV_RESULT_ACCEPTED, Deed::Say(topic)),
        },
    }
}

/// `interval_us`: 0 = the usual one, -1 = silence.
fn set_interval(role: Role, id: f32, interval_us: f32) -> (MavResult, Deed) {
    let denied = (MavResult::MAV_RESULT_DENIED, Deed::Nothing);
    let Some((
        topic,
        Freedom::Settable {
            shortest_s,
            longest_s,
            stoppable,
        },
    )) = whole(id).and_then(|id| find(role, id))
    else {
        return denied;
    };
    let period_s = f64::from(interval_us) / 1e6;
    // A period that was meant to be the limit may have been rounded to whole microseconds.
    let in_range = (shortest_s - 1e-6..=longest_s + 1e-6).contains(&period_s);
    let rhythm = match interval_us {
        0.0 => Rhythm::Usual,
        -1.0 if stoppable => Rhythm::Silent,
        _ if in_range => Rhythm::Period(period_s),
        _ => return denied,
    };
    (MavResult::MAV_RESULT_ACCEPTED, Deed::Set(topic, rhythm))
}

fn tell_interval(role: Role, id: f32) -> (MavResult, Deed) {
    // The answer has two bytes for it.
    match whole(id).filter(|id| *id <= u32::from(u16::MAX)) {
        None => (MavResult::MAV_RESULT_DENIED, Deed::Nothing),
        Some(id) => {
            let by_itself = find(role, id).filter(|(_, freedom)| *freedom != Freedom::OnRequest);
            let topic = by_itself.map(|(topic, _)| topic);
            (MavResult::MAV_RESULT_ACCEPTED, Deed::TellInterval(id, topic))
        }
    }
}

/// `autopilot` and `computer`: what is to become of the component addressed, and of the board it runs on: 0 = nothing, 1 = a
/// restart, 2 = the end, 3 = a restart into a boot loader, which we have none of.
fn reboot(circumstances: &Circumstances, autopilot: f32, computer: f32) -> (MavResult, Deed) {
    let wants = |what: f32| autopilot == what || computer == what;
    if autopilot == 0.0 && computer == 0.0 {
        (MavResult::MAV_RESULT_ACCEPTED, Deed::Nothing)
    } else if !wants(1.0) || !(0.0..=1.0).contains(&autopilot) || !(0.0..=1.0).contains(&computer) {
        (MavResult::MAV_RESULT_DENIED, Deed::Nothing)
    } else if circumstances.restarting {
        (MavResult::MAV_RESULT_TEMPORARILY_REJECTED, Deed::Nothing)
    } else if circumstances.armed != Some(false) {
        (MavResult::MAV_RESULT_TEMPORARILY_REJECTED, Deed::ExplainRefusal)
    } else {
        (MavResult::MAV_RESULT_ACCEPTED, Deed::Restart)
    }
}

#[cfg(test)]
mod tests {
    use super::{Circumstances, Command, Deed, Freedom, MESSAGES, Rhythm, Role, Topic};
    use mavlink::dialects::ardupilotmega::{MavCmd, MavResult};
    use proptest::prelude::*;

    const DISARMED: Circumstances = Circumstances {
        role: Role::Avoidance,
        armed: Some(false),
        restarting: false,
    };

    fn judge(circumstances: Circumstances, command: MavCmd, params: [f32; 2]) -> (MavResult, Deed) {
        let command = Command {
            command: command as u16,
            params,
            target_system: 1,
            target_component: 196,
        };
        command.judge(&circumstances)
    }

    #[test]
    fn what_safety_rests_on_keeps_its_rhythm() {
        let set = |role, id: f32, interval_us: f32| {
            let circumstances = Circumstances { role, ..DISARMED };
            judge(
                circumstances,
                MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                [id, interval_us],
            )
        };
        let denied = (MavResult::MAV_RESULT_DENIED, Deed::Nothing);
        // Heartbeat, time, both trajectories and the set point, strangers.
        for id in [
            0.0,
            111.0,
            332.0,
            333.0,
            84.0,
            148.0,
            30.0,
            f32::NAN,
            -1.0,
            0.5,
            1e9,
        ] {
            for interval_us in [-1.0, 0.0, 100_000.0] {
                assert_eq!(set(Role::Avoidance, id, interval_us), denied, "{id}");
            }
        }
        for interval_us in [-1.0, 1.0, 500_000.0, f32::NAN, f32::INFINITY] {
            assert_eq!(set(Role::Avoidance, 330.0, interval_us), denied, "{interval_us}");
        }
        let accepted = |topic, rhythm| (MavResult::MAV_RESULT_ACCEPTED, Deed::Set(topic, rhythm));
        assert_eq!(
            set(Role::Avoidance, 330.0, 0.0),
            accepted(Topic::Obstacles, Rhythm::Usual)
        );
        assert_eq!(
            set(Role::Avoidance, 330.0, 100_000.0),
            accepted(Topic::Obstacles, Rhythm::Period(0.1))
        );
        assert_eq!(
            set(Role::Computer, 390.0, -1.0),
            accepted(Topic::Computer, Rhythm::Silent)
        );
        assert_eq!(
            set(Role::Avoidance, 390.0, -1.0),
            denied,
            "the other component says it"
        );
    }

    #[test]
    fn a_restart_needs_a_vehicle_that_is_known_to_be_disarmed() {
        let reboot =
            |circumstances, params| judge(circumstances, MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, params);
        let not_now = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        let accepted = MavResult::MAV_RESULT_ACCEPTED;
        assert_eq!(reboot(DISARMED, [1.0, 0.0]), (accepted, Deed::Restart));
        assert_eq!(reboot(DISARMED, [0.0, 1.0]), (accepted, Deed::Restart));
        assert_eq!(reboot(DISARMED, [0.0, 0.0]), (accepted, Deed::Nothing));
        for armed in [Some(true), None] {
            let circumstances = Circumstances { armed, ..DISARMED };
            assert_eq!(reboot(circumstances, [1.0, 0.0]), (not_now, Deed::ExplainRefusal));
        }
        let restarting = Circumstances {
            restarting: true,
            ..DISARMED
        };
        assert_eq!(reboot(restarting, [1.0, 0.0]), (not_now, Deed::Nothing));
        for params in [
            [2.0, 0.0],
            [0.0, 2.0],
            [1.0, 2.0],
            [3.0, 0.0],
            [f32::NAN, 0.0],
            [1.0, f32::NAN],
        ] {
            let (result, deed) = reboot(DISARMED, params);
            assert_eq!(
                (result, deed),
                (MavResult::MAV_RESULT_DENIED, Deed::Nothing),
                "{params:?}"
            );
        }
    }

    #[test]
    fn everything_that_is_said_can_be_asked_for_and_its_rhythm_told() {
        for (role, id, topic, freedom) in MESSAGES {
            let circumstances = Circumstances {
                role: *role,
                ..DISARMED
            };
            let id = *id as f32;
            let (_, deed) = judge(circumstances, MavCmd::MAV_CMD_REQUEST_MESSAGE, [id, f32::NAN]);
            assert!(deed == Deed::Say(*topic) || *topic == Topic::Timesync);
            let told = (*freedom != Freedom::OnRequest).then_some(*topic);
            for (command, params) in [
                (MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL, [id, 0.0]),
                (MavCmd::MAV_CMD_REQUEST_MESSAGE, [244.0, id]),
            ] {
                let (result, deed) = judge(circumstances, command, params);
                assert_eq!(result, MavResult::MAV_RESULT_ACCEPTED);
                assert_eq!(deed, Deed::TellInterval(id as u32, told));
            }
        }
    }

    proptest! {
        #[test]
        fn whatever_is_commanded_it_is_judged_and_only_what_is_accepted_is_done(
            command in any::<u16>(), known in 0..6usize, bits in any::<[u32; 2]>(), small in any::<[i16; 2]>(), is_small in any::<bool>(),
            armed in any::<Option<bool>>(), restarting in any::<bool>(), computer in any::<bool>(),
        ) {
            let numbers = [command, 512, 511, 510, 246, 400];
            let params = if is_small { small.map(f32::from) } else { bits.map(f32::from_bits) };
            let command = Command { command: numbers[known], params, target_system: 1, target_component: 196 };
            let role = if computer { Role::Computer } else { Role::Avoidance };
            let (result, deed) = command.judge(&Circumstances { role, armed, restarting });
            prop_assert!(result != MavResult::MAV_RESULT_IN_PROGRESS);
            if result != MavResult::MAV_RESULT_ACCEPTED {
                prop_assert!(matches!(deed, Deed::Nothing | Deed::ExplainRefusal));
            }
            if deed == Deed::Restart {
                prop_assert!(armed == Some(false) && !restarting);
            }
            if let Deed::Set(_, Rhythm::Period(period_s)) = deed {
                prop_assert!((0.03..=61.0).contains(&period_s));
            }
        }
    }
}
