//! Missions as a ground station writes them: places in metres, items in MAVLink.

use jink_emulated_ground_station::Make;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::geo::{GlobalPoint, Projection};
use mavlink::dialect::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMissionType};
use nalgebra::Vector2;

/// North, east and up of the place where the vehicle stood at first (m), in the frame of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// North (m).
    pub north_m: f64,
    /// East (m).
    pub east_m: f64,
    /// Height above the ground (m).
    pub up_m: f64,
}

impl Place {
    /// A place.
    pub const fn new(north_m: f64, east_m: f64, up_m: f64) -> Self {
        Self {
            north_m,
            east_m,
            up_m,
        }
    }

    /// Level distance to a point (m).
    pub fn level_distance_m(&self, point: Point<LocalNed>) -> f64 {
        (point.x_m - self.north_m).hypot(point.y_m - self.east_m)
    }
}

/// One item.
#[derive(Clone, Copy, Debug)]
pub struct Item {
    /// What to do.
    pub command: MavCmd,
    /// Its first four parameters.
    pub params: [f32; 4],
    /// Where; `None` for an item without a place.
    pub place: Option<Place>,
}

impl Item {
    /// `command` at `place`.
    pub const fn at(command: MavCmd, place: Place) -> Self {
        Self {
            command,
            params: [0.0, 0.0, 0.0, f32::NAN],
            place: Some(place),
        }
    }

    /// A waypoint.
    pub const fn waypoint(north_m: f64, east_m: f64, up_m: f64) -> Self {
        Self::at(MavCmd::MAV_CMD_NAV_WAYPOINT, Place::new(north_m, east_m, up_m))
    }

    /// A take-off at `place`.
    pub const fn takeoff(place: Place) -> Self {
        Self::at(MavCmd::MAV_CMD_NAV_TAKEOFF, place)
    }

    /// A landing there.
    pub const fn land(north_m: f64, east_m: f64) -> Self {
        Self::at(MavCmd::MAV_CMD_NAV_LAND, Place::new(north_m, east_m, 0.0))
    }

    /// An item without a place.
    pub const fn bare(command: MavCmd, params: [f32; 4]) -> Self {
        Self {
            command,
            params,
            place: None,
        }
    }

    /// Whether it climbs from where the vehicle stands at first.
    pub fn is_takeoff_at_start(&self) -> bool {
        self.command == MavCmd::MAV_CMD_NAV_TAKEOFF
            && self
                .place
                .is_some_and(|place| place.north_m.hypot(place.east_m) < 0.1)
    }

    /// The same with other parameters.
    pub const fn with(self, params: [f32; 4]) -> Self {
        Self { params, ..self }
    }
}

/// How places become global: one point in both coordinate systems.
#[derive(Clone, Copy, Debug)]
pub struct Anchor {
    projection: Projection,
    local: Point<LocalNed>,
    /// Of the local frame's origin, above mean sea level (m).
    origin_amsl_m: f64,
}

impl Anchor {
    /// `global`, `amsl_m` above mean sea level, and `local` are the same place.
    pub fn new((global, amsl_m): (GlobalPoint, f64), local: Point<LocalNed>) -> Self {
        Self {
            projection: Projection::new(global),
            local,
            origin_amsl_m: amsl_m + local.z_m,
        }
    }

    /// Height above mean sea level (m).
    pub fn amsl_m(&self, place: Place) -> f64 {
        self.origin_amsl_m + place.up_m
    }

    /// Latitude and longitude in units of 1e-7 degrees.
    pub fn e7(&self, place: Place) -> (i32, i32) {
        let offset = Vector2::new(place.north_m - self.local.x_m, place.east_m - self.local.y_m);
        self.projection.to_global(offset).to_e7()
    }

    /// The items on the wire. ArduPilot's item 0 is home, which stands in front of `items` there.
    pub fn items(&self, make: Make, items: &[Item], target_system: u8) -> Vec<MISSION_ITEM_INT_DATA> {
        let home = Item::waypoint(0.0, 0.0, 0.0);
        let first = (make == Make::ArduCopter).then_some(home);
        let all = first.iter().chain(items);
        all.enumerate()
            .map(|(index, item)| {
                let (x, y) = item.place.map_or((0, 0), |place| self.e7(place));
                let frame = match item.place {
                    Some(_) => MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
                    None => MavFrame::MAV_FRAME_MISSION,
                };
                let [param1, param2, param3, param4] = item.params;
                // ArduPilot refuses a mission with a number that is none.
                let param4 = if make == Make::ArduCopter && param4.is_nan() {
                    0.0
                } else {
                    param4
                };
                MISSION_ITEM_INT_DATA {
                    target_system,
                    target_component: 1,
                    seq: index as u16,
                    frame,
                    command: item.command,
                    current: u8::from(index == 0),
                    autocontinue: 1,
                    param1,
                    param2,
                    param3,
                    param4,
                    x,
                    y,
                    z: item.place.map_or(0.0, |place| place.up_m as f32),
                    mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
                }
            })
            .collect()
    }
}
