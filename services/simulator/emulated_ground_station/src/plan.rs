//! What to fly, and how it looks as mission items.

use super::in_flight::InFlight;
use super::item::PlanItem;
use super::make::Make;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::geo::{GlobalPoint, Projection};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMissionType};
use nalgebra::Vector2;

/// What to do after the last waypoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Land where it is.
    Land,
    /// Return to the start and land there.
    Return,
    /// Stay there.
    Hold,
    /// The mission itself ends on the ground: its last items do.
    Mission,
}

impl Ending {
    /// The mode that does it; `None` if nothing needs to be done.
    pub(super) fn mode(self) -> Option<NavMode> {
        match self {
            Self::Land => Some(NavMode::Land),
            Self::Return => Some(NavMode::Return),
            Self::Hold | Self::Mission => None,
        }
    }
}

/// A flight.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightPlan {
    /// Height above the start at which the mission begins (m).
    pub takeoff_height_m: f64,
    /// Waypoints, in the frame of the autopilot's local position.
    pub waypoints: Vec<Point<LocalNed>>,
    /// Items that come behind them.
    pub tail: Vec<PlanItem>,
    /// What is done in flight, one after the other.
    pub in_flight: Vec<InFlight>,
    /// Speed asked for (m/s); `None` leaves it to the autopilot.
    pub cruise_speed_mps: Option<f64>,
    /// What to do after the last one.
    pub ending: Ending,
    /// Set the mission again when the autopilot leaves it unasked, or a pilot takes it.
    pub resume: bool,
    /// Longest time the mission may take (s).
    pub mission_limit_s: f64,
}

impl FlightPlan {
    /// Items that are no waypoints.
    pub(super) fn items_before_waypoints(&self, make: Make) -> usize {
        let home_and_takeoff = if make.takes_off_with_the_mission() { 2 } else { 0 };
        home_and_takeoff + usize::from(self.cruise_speed_mps.is_some())
    }

    /// The mission items, given one place in both coordinate systems and the down coordinate of the ground.
    pub(super) fn items(
        &self,
        make: Make,
        global: GlobalPoint,
        local: Point<LocalNed>,
        ground_down_m: f64,
        target_system: u8,
    ) -> Vec<MISSION_ITEM_INT_DATA> {
        let here = Projection::new(global);
        let blank = MISSION_ITEM_INT_DATA {
            target_system,
            target_component: 1,
            frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
            autocontinue: 1,
            mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
            ..MISSION_ITEM_INT_DATA::default()
        };
        let mut items = Vec::with_capacity(self.waypoints.len() + 3);
        if make.takes_off_with_the_mission() {
            let (x, y) = global.to_e7();
            let home = MISSION_ITEM_INT_DATA {
                command: MavCmd::MAV_CMD_NAV_WAYPOINT,
                x,
                y,
                ..blank.clone()
            };
            let takeoff = MISSION_ITEM_INT_DATA {
                command: MavCmd::MAV_CMD_NAV_TAKEOFF,
                z: self.takeoff_height_m as f32,
                ..blank.clone()
            };
            items.extend([home, takeoff]);
        }
        if let Some(speed_mps) = self.cruise_speed_mps {
            items.push(MISSION_ITEM_INT_DATA {
                command: MavCmd::MAV_CMD_DO_CHANGE_SPEED,
                frame: MavFrame::MAV_FRAME_MISSION,
                param1: 1.0,
                param2: speed_mps as f32,
                param3: -1.0,
                ..blank.clone()
            });
        }
        let waypoints = self.waypoints.iter().map(|place| PlanItem {
            command: MavCmd::MAV_CMD_NAV_WAYPOINT,
            place: *place,
            param1: 0.0,
        });
        for item in waypoints.chain(self.tail.iter().cloned()) {
            let PlanItem {
                command,
                place,
                param1,
            } = item;
            let offset = Vector2::new(place.x_m - local.x_m, place.y_m - local.y_m);
            let (x, y) = here.to_global(offset).to_e7();
            items.push(MISSION_ITEM_INT_DATA {
                command,
                param1,
                x,
                y,
                z: (ground_down_m - place.z_m) as f32,
                // No heading asked for; ArduCopter does not look at it.
                param4: f32::NAN,
                ..blank.clone()
            });
        }
        for (index, item) in items.iter_mut().enumerate() {
            item.seq = index as u16;
            item.current = u8::from(index == 0);
        }
        items
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waypoints_become_items_at_the_right_place() {
        let plan = FlightPlan {
            takeoff_height_m: 2.5,
            waypoints: vec![Point::new(30.0, -4.0, -2.5), Point::new(60.0, 0.0, -5.0)],
            tail: vec![PlanItem::landing(Point::new(60.0, 9.0, 0.1))],
            in_flight: Vec::new(),
            cruise_speed_mps: Some(3.0),
            ending: Ending::Land,
            resume: true,
            mission_limit_s: 100.0,
        };
        let global = GlobalPoint {
            latitude_deg: 47.4,
            longitude_deg: 8.5,
        };
        let local = Point::new(1.0, 2.0, 0.1);
        let items = plan.items(Make::Px4, global, local, 0.1, 1);
        assert_eq!(items.len(), 4);
        assert_eq!((items[3].command, items[3].z), (MavCmd::MAV_CMD_NAV_LAND, 0.0));
        assert_eq!((items[0].seq, items[0].current, items[2].seq), (0, 1, 2));
        let place = Projection::new(global).to_local(GlobalPoint::from_e7(items[1].x, items[1].y));
        assert!(
            (place.x - 29.0).abs() < 0.02 && (place.y + 6.0).abs() < 0.02,
            "{place}"
        );
        assert!((items[2].z - 5.1).abs() < 1e-5);
        let copters = plan.items(Make::ArduCopter, global, local, 0.1, 1);
        assert_eq!(copters.len(), 6);
        assert_eq!(copters[1].command, MavCmd::MAV_CMD_NAV_TAKEOFF);
        let before = plan.items_before_waypoints(Make::ArduCopter);
        assert_eq!((copters[before].seq, copters[before].x), (3, items[1].x));
    }
}
