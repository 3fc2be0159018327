//! What the planner's tests have in common: a vehicle that hovers at the origin of a map, and where it is to fly.
#![allow(dead_code, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_shared_types::frames::Point;
use jink_shared_types::map::{LocalMap, center_of, set};
use jink_shared_types::vehicle::{DesiredPath, NavMode, VehicleState};
use jink_shared_types::{Coded, Flag, Timestamp};
use nalgebra::Vector3;

pub const NOW_S: f64 = 50.0;
pub const HEIGHT_M: f64 = 2.5;

pub fn now() -> Timestamp {
    Timestamp::from_seconds(NOW_S)
}

/// Around the vehicle at the origin, 2.5 m up: known free except the ground, what `occupied` says, and what lies beyond
/// `known_to_m` from the vehicle.
pub fn map(known_to_m: f64, occupied: impl Fn(Vector3<f64>) -> bool) -> Box<LocalMap> {
    let mut map = LocalMap::boxed();
    map.min_cell = [-64, -64, -44];
    for x in -64..64 {
        for y in -64..64 {
            for z in -44..20 {
                let p = center_of([x, y, z]).vector();
                if (p - Vector3::new(0.0, 0.0, -HEIGHT_M)).norm() < known_to_m {
                    set(&mut map.known, [x, y, z]);
                    if p.z > 0.0 || occupied(p) {
                        set(&mut map.occupied, [x, y, z]);
                    }
                }
            }
        }
    }
    map.ranges_fresh = Flag::YES;
    map
}

pub fn hovering() -> VehicleState {
    VehicleState {
        position: Point::new(0.0, 0.0, -HEIGHT_M),
        mode: Coded::new(NavMode::Mission),
        armed: Flag::YES,
        position_valid: Flag::YES,
        autopilot_alive: Flag::YES,
        home_down_m: 0.0,
        ..VehicleState::default()
    }
}

pub fn to(north_m: f64, east_m: f64) -> DesiredPath {
    let mut desired = DesiredPath {
        mode: Coded::new(NavMode::Mission),
        ..DesiredPath::default()
    };
    for point in &mut desired.points {
        point.position = Point::new(north_m, east_m, -HEIGHT_M);
        point.valid = Flag::YES;
    }
    desired
}
