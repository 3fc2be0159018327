//! Between the autopilot's companion port and jink: passes every datagram on, notes what passes, and can be cut.
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; one of the autopilots is older.

use crate::record::{ModeRequest, Shared};
use crate::wire::{Reader, Seen, Wire, frames, mode_of, note};
use jink_emulated_ground_station::Make;
use jink_mavlink_link::frame::Splitter;
use mavlink::MessageData;
use mavlink::dialect::{
    AUTOPILOT_VERSION_DATA, COMMAND_LONG_DATA, GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA,
    LOCAL_POSITION_NED_DATA, MISSION_CURRENT_DATA, MavCmd, MavMessage, SET_POSITION_TARGET_LOCAL_NED_DATA,
    STATUSTEXT_DATA, TRAJECTORY_REPRESENTATION_BEZIER_DATA, TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA,
};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Messages that jink steers the vehicle with.
const SETPOINTS: [u32; 3] = [
    SET_POSITION_TARGET_LOCAL_NED_DATA::ID,
    TRAJECTORY_REPRESENTATION_BEZIER_DATA::ID,
    TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::ID,
];

/// Messages whose content is looked at.
const WANTED: [u32; 7] = [
    HEARTBEAT_DATA::ID,
    STATUSTEXT_DATA::ID,
    LOCAL_POSITION_NED_DATA::ID,
    GLOBAL_POSITION_INT_DATA::ID,
    MISSION_CURRENT_DATA::ID,
    AUTOPILOT_VERSION_DATA::ID,
    COMMAND_LONG_DATA::ID,
];

/// The relay; it ends with this.
#[derive(Debug)]
pub struct Relay {
    cut: Arc<AtomicBool>,
    record: Shared,
    cut_since_s: Option<f64>,
    _readers: [Reader; 2],
}

impl Relay {
    /// The autopilot talks to `autopilot_port`, jink waits at `jink_port`.
    ///
    /// # Errors
    /// If a port is taken.
    pub fn start(autopilot_port: u16, jink_port: u16, make: Make, record: Shared) -> io::Result<Self> {
        let autopilot = Arc::new(Wire::listen(autopilot_port)?);
        let jink = Arc::new(Wire::towards(0, jink_port)?);
        let cut = Arc::new(AtomicBool::new(false));
        let inward = {
            let (jink, cut, record) = (Arc::clone(&jink), Arc::clone(&cut), record.clone());
            let mut splitter = Splitter::new();
            Reader::start(Arc::clone(&autopilot), move |datagram| {
                if !cut.load(Ordering::Relaxed) {
                    jink.send(datagram);
                }
                frames(
                    &mut splitter,
                    datagram,
                    |id| WANTED.contains(&id),
                    |seen| note(&mut record.lock(), make, &seen),
                );
            })
        };
        let outward = {
            let (autopilot, cut, record) = (Arc::clone(&autopilot), Arc::clone(&cut), record.clone());
            let mut splitter = Splitter::new();
            Reader::start(Arc::clone(&jink), move |datagram| {
                if !cut.load(Ordering::Relaxed) {
                    autopilot.send(datagram);
                    frames(
                        &mut splitter,
                        datagram,
                        |id| WANTED.contains(&id),
                        |seen| note_jinks(&record, make, &seen),
                    );
                }
            })
        };
        Ok(Self {
            cut,
            record,
            cut_since_s: None,
            _readers: [inward, outward],
        })
    }

    /// Cuts the line, or lets it pass again.
    pub fn set_cut(&mut self, cut: bool) {
        self.cut.store(cut, Ordering::Relaxed);
        let mut record = self.record.lock();
        let now_s = record.now_s();
        match (cut, self.cut_since_s.take()) {
            (true, since_s) => self.cut_since_s = since_s.or(Some(now_s)),
            (false, Some(since_s)) => record.silences_s.push((since_s, now_s)),
            (false, None) => {}
        }
    }
}

fn note_jinks(record: &Shared, make: Make, seen: &Seen) {
    let mut record = record.lock();
    if SETPOINTS.contains(&seen.id) {
        let now_s = record.now_s();
        record.setpoints_s.push(now_s);
    }
    if let Some(MavMessage::COMMAND_LONG(command)) = &seen.message
        && command.command == MavCmd::MAV_CMD_DO_SET_MODE
    {
        let custom = match make {
            Make::Px4 => (command.param2 as u32) << 16 | (command.param3 as u32) << 24,
            Make::ArduCopter => command.param2 as u32,
        };
        let at_s = record.now_s();
        record.requests.push(ModeRequest {
            at_s,
            is_jinks: true,
            mode: Some(mode_of(make, custom)),
        });
        return;
    }
    note(&mut record, make, seen);
}
