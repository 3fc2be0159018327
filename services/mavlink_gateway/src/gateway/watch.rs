//! What is watched in flight besides flying: whether the autopilot follows what it is sent, and whether the vehicle stands before
//! an item that it cannot reach.
//!
//! | seen | said | done |
//! |---|---|---|
//! | ArduCopter follows no position, [`ECHOES_TO_TELL`] times in a row | once, and once more when it does again | nothing |
//! | a way is wanted, and the vehicle stands | as [`Blockage`](crate::blockage::Blockage) decides | waits, goes on to the next item, or stops |

use super::Gateway;
use crate::blockage::{Remedy, View};
use crate::executive::Demand;
use crate::io::Outputs;
use crate::make::Make;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{Event, EventSample, ITEM_BLOCKED, SETPOINTS_FOLLOWED, SETPOINTS_IGNORED};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialects::ardupilotmega::{POSITION_TARGET_LOCAL_NED_DATA, PositionTargetTypemask};

/// So many echoes in a row that show no position count as a refusal: at 5 Hz 0.6 s, in which a mode has been entered.
const ECHOES_TO_TELL: u32 = 3;

/// Counts the echoes in a row in which the autopilot followed no position.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Echoes {
    empty: u32,
}

impl Echoes {
    /// One more; what there is to tell, if that has changed.
    fn count(&mut self, is_empty: bool) -> Option<&'static Event> {
        let before = self.empty;
        self.empty = if is_empty { before.saturating_add(1) } else { 0 };
        if self.empty == ECHOES_TO_TELL {
            Some(&SETPOINTS_IGNORED)
        } else {
            (before >= ECHOES_TO_TELL && self.empty == 0).then_some(&SETPOINTS_FOLLOWED)
        }
    }
}

impl Gateway {
    /// What the autopilot says it follows. ArduCopter refuses a setpoint without a word: only here it shows, as a target without a
    /// position, while every setpoint of ours has one.
    pub(super) fn take_echo(
        &mut self,
        now: Timestamp,
        echo: &POSITION_TARGET_LOCAL_NED_DATA,
        outputs: &mut Outputs,
    ) {
        let follows = self.vehicle.mode() == NavMode::Offboard;
        let copter = self.vehicle.make() == Some(Make::ArduPilot);
        let Some(flight) = self.mission.as_mut().filter(|_| copter) else {
            return;
        };
        let empty = echo
            .type_mask
            .contains(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_X_IGNORE);
        if let Some(news) = flight.echoes.count(follows && empty) {
            self.tell(now, news, 0.0, outputs);
        }
    }

    /// Helps a vehicle that stands before an item it cannot reach.
    pub(super) fn watch_blockage(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let mode = self.vehicle.mode();
        let wish = match &self.mission {
            Some(flight) => flight.wish().filter(|_| mode == NavMode::Offboard),
            None => self
                .desired
                .filter(|path| path.mode == mode && mode == NavMode::Mission),
        };
        let wanted = wish.filter(|wish| self.was_alive && self.vehicle.is_armed() && wish.wants_planning());
        let present = self.vehicle.present(now);
        let Some((item, total)) = self.current_item else {
            return;
        };
        let view = View {
            now,
            item,
            speed_mps: present.map_or(f64::INFINITY, |present| present.velocity.norm()),
            away_m: wanted
                .zip(present)
                .map(|(wish, present)| (wish.points[1].position.vector() - present.position).norm()),
        };
        let Some(remedy) = self.blockage.step(&view) else {
            return;
        };
        let next = item.saturating_add(1);
        // ArduPilot's item 0 is home, and does not count.
        let home = u16::from(self.vehicle.make() == Some(Make::ArduPilot));
        // Behind the last item there is nothing to go on to.
        let remedy = match remedy {
            Remedy::Skip if total.is_some_and(|total| next >= total + home) => Remedy::Stop,
            remedy => remedy,
        };
        let event = EventSample::new(&ITEM_BLOCKED, remedy.word(), [f64::from(item), 0.0]);
        self.texts.push(now, &event);
        outputs.tell(event);
        match (remedy, &mut self.mission) {
            (Remedy::Wait, _) => {}
            (Remedy::Stop, _) => self.demand(now, Demand::Hold, outputs),
            (Remedy::Skip, Some(flight)) => flight.skip(),
            (Remedy::Skip, None) => self.demand(now, Demand::Current(next), outputs),
        }
    }
}
