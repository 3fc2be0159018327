//! A ground station without a person: it sends what it is commanded to send, and says whether it worked.
#![allow(deprecated)] // MISSION_SET_CURRENT is superseded, PX4 of 2021 knows nothing else.

use crate::mission::{Anchor, Item, Place};
use crate::record::{ModeRequest, Share, Shared};
use crate::wire::{Reader, Wire, frames, note};
use jink_emulated_ground_station::{Make, heartbeat};
use jink_mavlink_link::frame::Splitter;
use jink_mavlink_link::message::COMPONENT_AVOIDANCE;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{
    COMMAND_INT_DATA, COMMAND_LONG_DATA, MANUAL_CONTROL_DATA, MISSION_CLEAR_ALL_DATA, MISSION_COUNT_DATA,
    MISSION_ITEM_INT_DATA, MISSION_SET_CURRENT_DATA, MavCmd, MavFrame, MavMessage, MavMissionType,
    MavParamType, MavResult, PARAM_SET_DATA, PositionTargetTypemask, RC_CHANNELS_OVERRIDE_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// System id of ground stations.
pub const STATION: u8 = 255;
/// Their component.
const COMPONENT: u8 = 190;
/// A question is repeated after this.
const REPEAT: Duration = Duration::from_millis(1200);
/// The sticks are sent this often.
const STICKS_PERIOD: Duration = Duration::from_millis(50);
/// So often at most.
const ATTEMPTS: u32 = 4;
/// How often somebody who waits looks.
const LOOK: Duration = Duration::from_millis(10);

/// What the autopilot fetches from us, and how it took it.
#[derive(Debug, Default)]
struct Upload {
    items: Vec<MISSION_ITEM_INT_DATA>,
    result: Option<u32>,
}

/// Sticks: forward, right, up, turn right, -1 to 1 each.
pub type Sticks = [f64; 4];

/// The pilot's remote control.
#[derive(Clone, Copy, Debug, Default)]
struct Remote {
    sticks: Option<Sticks>,
    /// The switch on channel 6.
    is_switched_on: bool,
}

impl Remote {
    /// What it sends to the autopilot of this make with the system id `target`.
    fn message(&self, make: Make, target: u8) -> Option<MavMessage> {
        let [forward, right, up, turn] = self.sticks?;
        let thousandths = |share: f64| (1000.0 * share) as i16;
        let pulse_us = |share: f64| (1500.0 + 500.0 * share) as u16;
        Some(match make {
            Make::Px4 => MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
                x: thousandths(forward),
                y: thousandths(right),
                z: thousandths(0.5 + 0.5 * up),
                r: thousandths(turn),
                target,
                ..MANUAL_CONTROL_DATA::default()
            }),
            Make::ArduCopter => MavMessage::RC_CHANNELS_OVERRIDE(RC_CHANNELS_OVERRIDE_DATA {
                chan1_raw: pulse_us(right),
                chan2_raw: pulse_us(-forward),
                chan3_raw: pulse_us(up),
                chan4_raw: pulse_us(turn),
                chan5_raw: u16::MAX,
                chan6_raw: if self.is_switched_on { 2000 } else { 1000 },
                chan7_raw: u16::MAX,
                chan8_raw: u16::MAX,
                target_system: target,
                target_component: 1,
                ..RC_CHANNELS_OVERRIDE_DATA::default()
            }),
        })
    }
}

/// The station; it falls silent with this.
#[derive(Debug)]
pub struct Station {
    wire: Arc<Wire>,
    make: Make,
    target: u8,
    record: Shared,
    upload: Arc<Mutex<Upload>>,
    remote: Arc<Mutex<Remote>>,
    _reader: Reader,
}

impl Station {
    /// At `wire`, for the autopilot with system id `target`. `is_radio`: what comes in is what a telemetry radio would carry.
    pub fn start(wire: Wire, make: Make, target: u8, record: Shared, is_radio: bool) -> Self {
        let wire = Arc::new(wire);
        let upload = Arc::new(Mutex::new(Upload::default()));
        let remote = Arc::new(Mutex::new(Remote::default()));
        let reader = {
            let (ours, record, upload) = (Arc::clone(&wire), record.clone(), Arc::clone(&upload));
            let (remote, mut steered) = (Arc::clone(&remote), Instant::now());
            let mut splitter = Splitter::new();
            let mut beat = Instant::now() - REPEAT;
            let mut last_s = 0.0;
            Reader::start(Arc::clone(&wire), move |datagram| {
                if beat.elapsed() >= Duration::from_secs(1) {
                    beat = Instant::now();
                    ours.say(STATION, COMPONENT, heartbeat());
                }
                if steered.elapsed() >= STICKS_PERIOD {
                    steered = Instant::now();
                    let remote = *remote.lock().unwrap_or_else(PoisonError::into_inner);
                    if let Some(sticks) = remote.message(make, target) {
                        ours.say(STATION, COMPONENT, sticks);
                    }
                }
                if is_radio {
                    let mut record = record.lock();
                    let now_s = record.now_s();
                    if record.mode().is_armed {
                        record.radio_time_s += now_s - last_s;
                    }
                    last_s = now_s;
                }
                frames(
                    &mut splitter,
                    datagram,
                    |_| true,
                    |seen| {
                        if let Some(message) = &seen.message
                            && let Some(answer) = answer(&upload, message)
                        {
                            ours.say(STATION, COMPONENT, answer);
                        }
                        let mut record = record.lock();
                        if is_radio && record.mode().is_armed {
                            let share: &mut Share =
                                record.radio.entry((seen.is_autopilots(), seen.id)).or_default();
                            share.frames += 1;
                            share.bytes += seen.bytes as u64;
                        }
                        if let Some(MavMessage::COMMAND_ACK(ack)) = &seen.message {
                            let now_s = record.now_s();
                            record.acks.push((now_s, ack.command, ack.result));
                        }
                        note(&mut record, make, &seen);
                    },
                );
            })
        };
        Self {
            wire,
            make,
            target,
            record,
            upload,
            remote,
            _reader: reader,
        }
    }

    /// Sends anything.
    pub fn say(&self, message: MavMessage) {
        self.wire.say(STATION, COMPONENT, message);
    }

    /// Sends anything as another station on the same line.
    pub fn say_as(&self, system: u8, message: MavMessage) {
        self.wire.say(system, COMPONENT, message);
    }

    /// A command, repeated until it is answered.
    pub fn command(&self, command: MavCmd, params: [f32; 7]) -> Option<MavResult> {
        let [param1, param2, param3, param4, param5, param6, param7] = params;
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            target_system: self.target,
            target_component: 1,
            command,
            param1,
            param2,
            param3,
            param4,
            param5,
            param6,
            param7,
            ..COMMAND_LONG_DATA::default()
        });
        self.ask(command, &message)
    }

    /// A command with a place, repeated until it is answered.
    pub fn command_at(
        &self,
        anchor: &Anchor,
        command: MavCmd,
        params: [f32; 4],
        place: Place,
    ) -> Option<MavResult> {
        let (x, y) = anchor.e7(place);
        let [param1, param2, param3, param4] = params;
        // PX4 takes the height of these commands as one above the sea, whatever the frame says.
        let (frame, up_m) = match self.make {
            Make::Px4 => (MavFrame::MAV_FRAME_GLOBAL, anchor.amsl_m(place)),
            Make::ArduCopter => (MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT, place.up_m),
        };
        let message = MavMessage::COMMAND_INT(COMMAND_INT_DATA {
            target_system: self.target,
            target_component: 1,
            frame,
            command,
            param1,
            param2,
            param3,
            param4,
            x,
            y,
            z: up_m as f32,
            ..COMMAND_INT_DATA::default()
        });
        self.ask(command, &message)
    }

    fn ask(&self, command: MavCmd, message: &MavMessage) -> Option<MavResult> {
        let first = self.record.lock().acks.len();
        for _ in 0..ATTEMPTS {
            self.say(message.clone());
            let begin = Instant::now();
            while begin.elapsed() < REPEAT {
                std::thread::sleep(LOOK);
                let record = self.record.lock();
                let mut update = record.acks.iter().skip(first);
                if let Some((_, _, result)) = update.find(|(_, answered, result)| {
                    *answered == command && *result != MavResult::MAV_RESULT_IN_PROGRESS
                }) {
                    return Some(*result);
                }
            }
        }
        None
    }

    /// Notes that somebody wants another mode now.
    fn wish(&self, mode: Option<NavMode>) {
        let mut record = self.record.lock();
        let at_s = record.now_s();
        record.requests.push(ModeRequest {
            at_s,
            is_jinks: false,
            mode,
        });
    }

    /// Notes that the next command leads to another mode.
    pub fn expect_mode_change(&self) {
        self.wish(None);
    }

    /// Asks for a mode.
    pub fn set_mode(&self, mode: NavMode) -> Option<MavResult> {
        let Some(MavMessage::COMMAND_LONG(command)) = self.make.mode_command(mode, self.target) else {
            return None;
        };
        self.wish(Some(mode));
        self.ask(MavCmd::MAV_CMD_DO_SET_MODE, &MavMessage::COMMAND_LONG(command))
    }

    /// Arms.
    pub fn arm(&self) -> Option<MavResult> {
        self.command(
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        )
    }

    /// Sets a parameter of the autopilot; whether it says so afterwards.
    pub fn set_parameter(&self, name: &str, value: f64) -> bool {
        // PX4 keeps whole numbers as such and takes their bits; ArduPilot casts.
        let is_whole = self.make == Make::Px4 && value.fract() == 0.0 && is_integer(name);
        let (param_value, param_type) = if is_whole {
            (
                f32::from_bits((value as i32) as u32),
                MavParamType::MAV_PARAM_TYPE_INT32,
            )
        } else {
            (value as f32, MavParamType::MAV_PARAM_TYPE_REAL32)
        };
        self.record.lock().parameters.remove(name);
        for _ in 0..ATTEMPTS {
            self.say(MavMessage::PARAM_SET(PARAM_SET_DATA {
                param_value,
                target_system: self.target,
                target_component: 1,
                param_id: name.into(),
                param_type,
            }));
            let begin = Instant::now();
            while begin.elapsed() < REPEAT {
                std::thread::sleep(LOOK);
                if let Some(reported) = self.record.lock().parameters.get(name) {
                    return reported.to_bits() == param_value.to_bits();
                }
            }
        }
        false
    }

    /// Uploads a mission; MAV_MISSION_RESULT, 0 = accepted.
    pub fn upload(&self, anchor: &Anchor, items: &[Item]) -> Option<u32> {
        let items = anchor.items(self.make, items, self.target);
        self.upload_list(items, MavMissionType::MAV_MISSION_TYPE_MISSION)
    }

    /// Uploads rally points.
    pub fn upload_rally(&self, anchor: &Anchor, places: &[Place]) -> Option<u32> {
        let items: Vec<Item> = places
            .iter()
            .map(|place| Item::at(MavCmd::MAV_CMD_NAV_RALLY_POINT, *place))
            .collect();
        let items = anchor.items(Make::Px4, &items, self.target).into_iter();
        let items = items
            .map(|item| MISSION_ITEM_INT_DATA {
                mission_type: MavMissionType::MAV_MISSION_TYPE_RALLY,
                param4: 0.0,
                current: 0,
                ..item
            })
            .collect();
        self.upload_list(items, MavMissionType::MAV_MISSION_TYPE_RALLY)
    }

    fn upload_list(&self, items: Vec<MISSION_ITEM_INT_DATA>, mission_type: MavMissionType) -> Option<u32> {
        let count = items.len() as u16;
        *self.uploading() = Upload { items, result: None };
        for _ in 0..ATTEMPTS {
            self.say(MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
                count,
                target_system: self.target,
                target_component: 1,
                mission_type,
                ..MISSION_COUNT_DATA::default()
            }));
            let begin = Instant::now();
            while begin.elapsed() < Duration::from_secs(3) {
                std::thread::sleep(LOOK);
                if let Some(result) = self.uploading().result {
                    return Some(result);
                }
            }
        }
        None
    }

    fn uploading(&self) -> std::sync::MutexGuard<'_, Upload> {
        self.upload.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Removes the mission.
    pub fn clear_mission(&self) -> Option<u32> {
        self.uploading().result = None;
        self.say(MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
            target_system: self.target,
            target_component: 1,
            mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
        }));
        let begin = Instant::now();
        while begin.elapsed() < REPEAT {
            std::thread::sleep(LOOK);
            if let Some(result) = self.uploading().result {
                return Some(result);
            }
        }
        None
    }

    /// Makes an item current, in both words that stations have for it.
    pub fn set_current(&self, item: u16) {
        match self.make {
            Make::ArduCopter => {
                self.command(
                    MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT,
                    [f32::from(item), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                );
            }
            Make::Px4 => self.say(MavMessage::MISSION_SET_CURRENT(MISSION_SET_CURRENT_DATA {
                seq: item,
                target_system: self.target,
                target_component: 1,
            })),
        }
    }

    /// A go-to: the click on the map.
    pub fn go_to(&self, anchor: &Anchor, place: Place) -> Option<MavResult> {
        self.expect_mode_change();
        // Bit 0 of the second parameter: change to the mode that flies there.
        self.command_at(
            anchor,
            MavCmd::MAV_CMD_DO_REPOSITION,
            [-1.0, 1.0, 0.0, f32::NAN],
            place,
        )
    }

    /// A position as a setpoint of its own, as a program beside jink would send it (as system `system`).
    pub fn set_position_target(&self, system: u8, place: Place) {
        use PositionTargetTypemask as Mask;
        let ignored = Mask::from_bits_truncate(0b1101_1111_1000);
        self.say_as(
            system,
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
                target_system: self.target,
                target_component: 1,
                coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
                type_mask: ignored,
                x: place.north_m as f32,
                y: place.east_m as f32,
                z: -place.up_m as f32,
                ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
            }),
        );
    }

    /// The remote control: from now on the sticks are sent twenty times a second; `None`: it falls silent.
    pub fn steer(&self, sticks: Option<Sticks>) {
        self.remote().sticks = sticks;
    }

    fn remote(&self) -> std::sync::MutexGuard<'_, Remote> {
        self.remote.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Chooses assisted flight, or switches it off: with ArduCopter by the switch on channel 6, with PX4 by command.
    pub fn choose_assist(&self, on: bool) {
        self.remote().is_switched_on = on;
        self.expect_mode_change();
        if self.make == Make::Px4 {
            self.say(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                command: MavCmd::MAV_CMD_USER_1,
                param1: f32::from(u8::from(on)),
                target_system: self.target,
                target_component: COMPONENT_AVOIDANCE,
                ..COMMAND_LONG_DATA::default()
            }));
        }
    }
}

/// Parameters of PX4 that scripts set and that are whole numbers.
fn is_integer(name: &str) -> bool {
    [
        "COM_OBS_AVOID",
        "COM_OBL_RC_ACT",
        "COM_OBL_ACT",
        "EAV_EN",
        "RTL_TYPE",
        "MIS_MNT_YAW_CTL",
    ]
    .contains(&name)
}

/// What to answer the autopilot that fetches a mission. PX4 still asks for the first item with the deprecated request.
#[allow(deprecated)]
fn answer(upload: &Mutex<Upload>, message: &MavMessage) -> Option<MavMessage> {
    let mut upload = upload.lock().unwrap_or_else(PoisonError::into_inner);
    let wanted = match message {
        MavMessage::MISSION_REQUEST_INT(request) if request.target_system == STATION => request.seq,
        MavMessage::MISSION_REQUEST(request) if request.target_system == STATION => request.seq,
        MavMessage::MISSION_ACK(ack) if ack.target_system == STATION => {
            upload.result = Some(ack.mavtype as u32);
            return None;
        }
        _ => return None,
    };
    let item = upload.items.get(usize::from(wanted))?;
    Some(MavMessage::MISSION_ITEM_INT(item.clone()))
}
