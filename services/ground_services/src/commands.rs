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
//! | MAV_CMD_COMPONENT_ARM_DISARM | DENIED: we have no motors |
//! | everything else, known to the dialect or not | UNSUPPORTED |
//!
//! MAV_CMD_USER_1 to component 196 switches assisted flight, which is the gateway's: it answers that itself.
//! Commands to all components (target 0) are not ours to refuse: the autopilot answers them. All that is obeyed is done at once,
//! so nothing is ever IN_PROGRESS.

#![allow(deprecated)] // PROTOCOL_VERSION and GET_MESSAGE_INTERVAL are going, ground stations that ask for them are not.

use jink_mavlink_link::message::Command;
use mavlink::MessageData;
use mavlink::dialect::{
    AUTOPILOT_VERSION_DATA, COMPONENT_METADATA_DATA, HEARTBEAT_DATA, MESSAGE_INTERVAL_DATA, MavCmd,
    MavResult, OBSTACLE_DISTANCE_DATA, ONBOARD_COMPUTER_STATUS_DATA, PROTOCOL_VERSION_DATA, TIMESYNC_DATA,
};

/// Which of our components a command names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    /// 196.
    Avoidance,
    /// 191.
    Computer,
}

/// A message that is said on request, or whose interval may be asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answerable {
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
pub enum IntervalPolicy {
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
pub const MESSAGES: &[(Component, u32, Answerable, IntervalPolicy)] = &[
    (
        Component::Avoidance,
        HEARTBEAT_DATA::ID,
        Answerable::Heartbeat,
        IntervalPolicy::Fixed,
    ),
    (
        Component::Avoidance,
        TIMESYNC_DATA::ID,
        Answerable::Timesync,
        IntervalPolicy::Fixed,
    ),
    (
        Component::Avoidance,
        OBSTACLE_DISTANCE_DATA::ID,
        Answerable::Obstacles,
        IntervalPolicy::Settable {
            shortest_s: 1.0 / 30.0,
            longest_s: 0.2,
            stoppable: false,
        },
    ),
    (
        Component::Avoidance,
        AUTOPILOT_VERSION_DATA::ID,
        Answerable::Version,
        IntervalPolicy::OnRequest,
    ),
    (
        Component::Avoidance,
        PROTOCOL_VERSION_DATA::ID,
        Answerable::Protocol,
        IntervalPolicy::OnRequest,
    ),
    (
        Component::Avoidance,
        COMPONENT_METADATA_DATA::ID,
        Answerable::Metadata,
        IntervalPolicy::OnRequest,
    ),
    (
        Component::Computer,
        HEARTBEAT_DATA::ID,
        Answerable::Heartbeat,
        IntervalPolicy::Fixed,
    ),
    (
        Component::Computer,
        ONBOARD_COMPUTER_STATUS_DATA::ID,
        Answerable::Computer,
        IntervalPolicy::Settable {
            shortest_s: 1.0,
            longest_s: 60.0,
            stoppable: true,
        },
    ),
    (
        Component::Computer,
        AUTOPILOT_VERSION_DATA::ID,
        Answerable::Version,
        IntervalPolicy::OnRequest,
    ),
    (
        Component::Computer,
        PROTOCOL_VERSION_DATA::ID,
        Answerable::Protocol,
        IntervalPolicy::OnRequest,
    ),
];

/// An interval that was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MessageInterval {
    /// Our own.
    Usual,
    /// One message per so many seconds.
    Period(f64),
    /// None at all.
    Silent,
}

/// What is to be done besides the acknowledgement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CommandAction {
    /// Nothing.
    Nothing,
    /// It is said once.
    Say(Answerable),
    /// Its interval is changed.
    Set(Answerable, MessageInterval),
    /// Its interval is reported; `None`: it never comes by itself.
    ReportInterval(u32, Option<Answerable>),
    /// The gateway is started anew.
    Restart,
    /// Whoever asked is informed why there is no restart.
    ExplainRefusal,
}

/// What a command is judged by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandContext {
    /// The component it names.
    pub component: Component,
    /// Whether the vehicle is armed, if that is known.
    pub armed: Option<bool>,
    /// A restart is under way.
    pub restarting: bool,
}

/// The result of a command that is acknowledged, and what is to be done.
pub fn judge(command: &Command, context: &CommandContext) -> (MavResult, CommandAction) {
    let [first, second] = command.params;
    let is = |number: MavCmd| command.command == number as u16;
    if is(MavCmd::MAV_CMD_REQUEST_MESSAGE) {
        request(context.component, first, second)
    } else if is(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL) {
        set_interval(context.component, first, second)
    } else if is(MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL) {
        report_interval(context.component, first)
    } else if is(MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN) {
        reboot(context, first, second)
    } else if is(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM) {
        (MavResult::MAV_RESULT_DENIED, CommandAction::Nothing)
    } else {
        (MavResult::MAV_RESULT_UNSUPPORTED, CommandAction::Nothing)
    }
}

/// The row of a message.
fn find(component: Component, id: u32) -> Option<(Answerable, IntervalPolicy)> {
    let row = MESSAGES.iter().find(|row| row.0 == component && row.1 == id)?;
    Some((row.2, row.3))
}

/// A parameter that numbers something.
fn whole(param: f32) -> Option<u32> {
    // Beyond, floats leave numbers out.
    const EXACT: f32 = 16_777_216.0;
    ((0.0..=EXACT).contains(&param) && param.fract() == 0.0).then_some(param as u32)
}

fn request(component: Component, id: f32, of: f32) -> (MavResult, CommandAction) {
    match whole(id) {
        Some(id) if id == MESSAGE_INTERVAL_DATA::ID => report_interval(component, of),
        id => match id.and_then(|id| find(component, id)) {
            // Ours is a question or an answer to one, nothing to be said by itself.
            None | Some((Answerable::Timesync, _)) => {
                (MavResult::MAV_RESULT_UNSUPPORTED, CommandAction::Nothing)
            }
            Some((message, _)) => (MavResult::MAV_RESULT_ACCEPTED, CommandAction::Say(message)),
        },
    }
}

/// `interval_us`: 0 = the usual one, -1 = silence.
fn set_interval(component: Component, id: f32, interval_us: f32) -> (MavResult, CommandAction) {
    let denied = (MavResult::MAV_RESULT_DENIED, CommandAction::Nothing);
    let Some((
        message,
        IntervalPolicy::Settable {
            shortest_s,
            longest_s,
            stoppable,
        },
    )) = whole(id).and_then(|id| find(component, id))
    else {
        return denied;
    };
    let period_s = f64::from(interval_us) / 1e6;
    // A period that was meant to be the limit may have been rounded to whole microseconds.
    let in_range = (shortest_s - 1e-6..=longest_s + 1e-6).contains(&period_s);
    let interval = match interval_us {
        0.0 => MessageInterval::Usual,
        -1.0 if stoppable => MessageInterval::Silent,
        _ if in_range => MessageInterval::Period(period_s),
        _ => return denied,
    };
    (
        MavResult::MAV_RESULT_ACCEPTED,
        CommandAction::Set(message, interval),
    )
}

fn report_interval(component: Component, id: f32) -> (MavResult, CommandAction) {
    // The answer has two bytes for it.
    match whole(id).filter(|id| *id <= u32::from(u16::MAX)) {
        None => (MavResult::MAV_RESULT_DENIED, CommandAction::Nothing),
        Some(id) => {
            let by_itself = find(component, id).filter(|(_, policy)| *policy != IntervalPolicy::OnRequest);
            let message = by_itself.map(|(message, _)| message);
            (
                MavResult::MAV_RESULT_ACCEPTED,
                CommandAction::ReportInterval(id, message),
            )
        }
    }
}

/// `autopilot` and `computer`: what is to become of the component addressed, and of the board it runs on: 0 = nothing, 1 = a
/// restart, 2 = the end, 3 = a restart into a boot loader, which we have none of.
fn reboot(context: &CommandContext, autopilot: f32, computer: f32) -> (MavResult, CommandAction) {
    let wants = |what: f32| autopilot == what || computer == what;
    if autopilot == 0.0 && computer == 0.0 {
        (MavResult::MAV_RESULT_ACCEPTED, CommandAction::Nothing)
    } else if !wants(1.0) || !(0.0..=1.0).contains(&autopilot) || !(0.0..=1.0).contains(&computer) {
        (MavResult::MAV_RESULT_DENIED, CommandAction::Nothing)
    } else if context.restarting {
        (MavResult::MAV_RESULT_TEMPORARILY_REJECTED, CommandAction::Nothing)
    } else if context.armed != Some(false) {
        (
            MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            CommandAction::ExplainRefusal,
        )
    } else {
        (MavResult::MAV_RESULT_ACCEPTED, CommandAction::Restart)
    }
}

#[cfg(test)]
mod tests {
    use super::{
        Answerable, Command, CommandAction, CommandContext, Component, IntervalPolicy, MESSAGES,
        MessageInterval,
    };
    use mavlink::dialect::{MavCmd, MavResult};
    use proptest::prelude::*;

    const DISARMED: CommandContext = CommandContext {
        component: Component::Avoidance,
        armed: Some(false),
        restarting: false,
    };

    fn judge(context: CommandContext, command: MavCmd, params: [f32; 2]) -> (MavResult, CommandAction) {
        let command = Command {
            command: command as u16,
            params,
            target_system: 1,
            target_component: 196,
        };
        super::judge(&command, &context)
    }

    #[test]
    fn what_safety_rests_on_keeps_its_rhythm() {
        let set = |component, id: f32, interval_us: f32| {
            let context = CommandContext {
                component,
                ..DISARMED
            };
            judge(context, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [id, interval_us])
        };
        let denied = (MavResult::MAV_RESULT_DENIED, CommandAction::Nothing);
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
                assert_eq!(set(Component::Avoidance, id, interval_us), denied, "{id}");
            }
        }
        for interval_us in [-1.0, 1.0, 500_000.0, f32::NAN, f32::INFINITY] {
            assert_eq!(
                set(Component::Avoidance, 330.0, interval_us),
                denied,
                "{interval_us}"
            );
        }
        let accepted = |message, interval| {
            (
                MavResult::MAV_RESULT_ACCEPTED,
                CommandAction::Set(message, interval),
            )
        };
        assert_eq!(
            set(Component::Avoidance, 330.0, 0.0),
            accepted(Answerable::Obstacles, MessageInterval::Usual)
        );
        assert_eq!(
            set(Component::Avoidance, 330.0, 100_000.0),
            accepted(Answerable::Obstacles, MessageInterval::Period(0.1))
        );
        assert_eq!(
            set(Component::Computer, 390.0, -1.0),
            accepted(Answerable::Computer, MessageInterval::Silent)
        );
        assert_eq!(
            set(Component::Avoidance, 390.0, -1.0),
            denied,
            "the other component says it"
        );
    }

    #[test]
    fn a_restart_needs_a_vehicle_that_is_known_to_be_disarmed() {
        let reboot = |context, params| judge(context, MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, params);
        let not_now = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        let accepted = MavResult::MAV_RESULT_ACCEPTED;
        assert_eq!(reboot(DISARMED, [1.0, 0.0]), (accepted, CommandAction::Restart));
        assert_eq!(reboot(DISARMED, [0.0, 1.0]), (accepted, CommandAction::Restart));
        assert_eq!(reboot(DISARMED, [0.0, 0.0]), (accepted, CommandAction::Nothing));
        for armed in [Some(true), None] {
            let context = CommandContext { armed, ..DISARMED };
            assert_eq!(
                reboot(context, [1.0, 0.0]),
                (not_now, CommandAction::ExplainRefusal)
            );
        }
        let restarting = CommandContext {
            restarting: true,
            ..DISARMED
        };
        assert_eq!(reboot(restarting, [1.0, 0.0]), (not_now, CommandAction::Nothing));
        for params in [
            [2.0, 0.0],
            [0.0, 2.0],
            [1.0, 2.0],
            [3.0, 0.0],
            [f32::NAN, 0.0],
            [1.0, f32::NAN],
        ] {
            let (result, action) = reboot(DISARMED, params);
            assert_eq!(
                (result, action),
                (MavResult::MAV_RESULT_DENIED, CommandAction::Nothing),
                "{params:?}"
            );
        }
    }

    #[test]
    fn everything_that_is_reported_can_be_asked_for_and_its_rhythm_reported() {
        for (component, id, message, policy) in MESSAGES {
            let context = CommandContext {
                component: *component,
                ..DISARMED
            };
            let id = *id as f32;
            let (_, action) = judge(context, MavCmd::MAV_CMD_REQUEST_MESSAGE, [id, f32::NAN]);
            assert!(action == CommandAction::Say(*message) || *message == Answerable::Timesync);
            let reported = (*policy != IntervalPolicy::OnRequest).then_some(*message);
            for (command, params) in [
                (MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL, [id, 0.0]),
                (MavCmd::MAV_CMD_REQUEST_MESSAGE, [244.0, id]),
            ] {
                let (result, action) = judge(context, command, params);
                assert_eq!(result, MavResult::MAV_RESULT_ACCEPTED);
                assert_eq!(action, CommandAction::ReportInterval(id as u32, reported));
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
            let component = if computer { Component::Computer } else { Component::Avoidance };
            let (result, action) = super::judge(&command, &CommandContext { component, armed, restarting });
            prop_assert!(result != MavResult::MAV_RESULT_IN_PROGRESS);
            if result != MavResult::MAV_RESULT_ACCEPTED {
                prop_assert!(matches!(action, CommandAction::Nothing | CommandAction::ExplainRefusal));
            }
            if action == CommandAction::Restart {
                prop_assert!(armed == Some(false) && !restarting);
            }
            if let CommandAction::Set(_, MessageInterval::Period(period_s)) = action {
                prop_assert!((0.03..=61.0).contains(&period_s));
            }
        }
    }
}
