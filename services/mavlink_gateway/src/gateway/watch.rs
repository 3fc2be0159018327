//! What is watched in flight besides flying: whether the autopilot follows what it is sent, and what becomes of an item that the
//! planner says is out of reach.
//!
//! | seen | said | done |
//! |---|---|---|
//! | ArduCopter follows no position in the air, while it is sent some, for [`super::echoes::EMPTY_S`] | once, and once more when it does again | nothing |
//! | the planner says that what is flown to is out of reach | as [`Blockage`](crate::blockage::Blockage) decides | waits, goes on to the next item, or stops |

use super::Gateway;
use super::mission::MissionFlight;
use crate::blockage::Remedy;
use crate::demand::Demand;
use crate::io::Outputs;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{EventSample, ITEM_BLOCKED};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{POSITION_TARGET_LOCAL_NED_DATA, PositionTargetTypemask};

/// A setpoint this long ago (s) may be refused now; an older one is not what the autopilot flies.
const SENT_S: f64 = 0.2;

/// The planner's distance to what is out of reach and ours may differ by so much (m): what the vehicle moves in between.
const SAME_AWAY_M: f64 = 1.0;

impl Gateway {
    /// What the autopilot says it follows. ArduCopter refuses a setpoint without a word: only here it shows, as a target without a
    /// position, while every setpoint of ours has one.
    pub(super) fn take_echo(
        &mut self,
        now: Timestamp,
        echo: &POSITION_TARGET_LOCAL_NED_DATA,
        outputs: &mut Outputs,
    ) {
        // An assisted vehicle follows velocities.
        let is_flown = self.vehicle.mode() == NavMode::Offboard
            && !self.assist.streams()
            && self.vehicle.is_armed()
            && self.vehicle.has_taken_off()
            && now.seconds_since(self.last_setpoint) <= SENT_S
            && self.last_setpoint.is_set();
        let copter = self.vehicle.make() == Some(AutopilotType::ArduPilot);
        let Some(flight) = self.mission.as_mut().filter(|_| copter) else {
            return;
        };
        let empty = echo
            .type_mask
            .contains(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_X_IGNORE);
        flight.take_echo(now, echo);
        if let Some(event) = flight.echoes.count(now, is_flown && empty) {
            outputs.report(EventSample::new(event, "", [0.0; 2]));
        }
    }

    /// Takes the planner's word that what is flown to is out of reach.
    pub(super) fn take_blocked_goal(&mut self, now: Timestamp, event: &EventSample, outputs: &mut Outputs) {
        let mode = self.vehicle.mode();
        let wish = match &self.mission {
            Some(flight) => flight.wish(),
            None => self.desired.filter(|path| path.mode == mode),
        };
        let wanted = wish.filter(|wish| self.was_alive && self.vehicle.is_armed() && wish.wants_planning());
        let Some((wish, present)) = wanted.zip(self.vehicle.present(now)) else {
            return;
        };
        let goal = wish.points[1].position;
        let away_m = (goal.vector() - present.position).norm();
        let is_reported_of = (away_m - event.numbers[0]).abs() <= SAME_AWAY_M;
        if !is_reported_of {
            return; // Something else is flown to by now.
        }
        let flies_item = self.mission.as_ref().is_some_and(MissionFlight::flies_an_item);
        let is_item = flies_item || mode == NavMode::Mission;
        match self.current_item.filter(|_| is_item) {
            Some((item, total)) => self.help_with_item(now, item, total, outputs),
            None if self.blockage.is_new(goal) => outputs.report(*event),
            None => {}
        }
    }

    fn help_with_item(&mut self, now: Timestamp, item: u16, total: Option<u16>, outputs: &mut Outputs) {
        let Some(remedy) = self.blockage.remedy(item) else {
            return;
        };
        let next = item.saturating_add(1);
        // ArduPilot's item 0 is home, and does not count.
        let home = u16::from(self.vehicle.make() == Some(AutopilotType::ArduPilot));
        // Behind the last item there is nothing to go on to.
        let remedy = match remedy {
            Remedy::Skip if total.is_some_and(|total| next >= total + home) => Remedy::Stop,
            remedy => remedy,
        };
        let event = EventSample::new(&ITEM_BLOCKED, remedy.word(), [f64::from(item), 0.0]);
        outputs.report(event);
        let flies_it = self.config.profile.flies_the_mission();
        match (remedy, self.mission.as_mut().filter(|_| flies_it)) {
            (Remedy::Wait, _) => {}
            (Remedy::Stop, _) => self.demand(now, Demand::Hold, outputs),
            (Remedy::Skip, Some(flight)) => flight.skip(),
            (Remedy::Skip, None) => self.demand(now, Demand::Current(next), outputs),
        }
    }
}
