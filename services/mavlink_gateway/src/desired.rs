//! What PX4 wants to do: TRAJECTORY_REPRESENTATION_WAYPOINTS as a [`DesiredPath`].
//!
//! NaN keeps its meaning "not given". One quirk is put right: while landing PX4 fills points 1 and 2 with the home
//! altitude as if it were a down coordinate (some hundred metres below ground); that z is no goal and becomes NaN.
//!
//! A take-off and a landing are sent back as they are only where they are vertical; nobody looks for obstacles then. What lies
//! to the side is planned first ([`VerticalMotions`]):
//!
//! | asked for | the vehicle | becomes |
//! |---|---|---|
//! | landing | not yet at rest above the place | a target above the place, at the height at which the landing was asked for |
//! | landing | came to rest above the place | the landing, from then on |
//! | take-off to a place elsewhere | lower than its height | a take-off straight up, where it was begun |
//! | take-off to a place elsewhere | at its height | a target |

use crate::profile::curve::MAX_YAW_RAD;
use crate::vehicle::{MAX_COORDINATE_M, MAX_SPEED_MPS, Present};
use jink_mavlink_link::px4_mode;
use jink_shared_types::vehicle::{
    COMMAND_LAND, COMMAND_NONE, COMMAND_TAKEOFF, DesiredPath, DesiredPoint, NavMode,
};
use jink_shared_types::{Coded, Flag, Point, Reserved, Velocity};
#[allow(deprecated)] // The interface is gone from PX4 1.16 on; this profile is for the versions before.
use mavlink::dialect::TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA;

/// The path in `message`, asked for in the mode that follows from the last heartbeat's mode (and whether that has a
/// name) and the message's commands, see [`px4_mode::infer`].
#[allow(deprecated)]
pub fn read(
    message: &TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA,
    (heartbeat, named): (NavMode, bool),
) -> DesiredPath {
    let mut points: [DesiredPoint; 3] = std::array::from_fn(|i| DesiredPoint {
        position: Point::new(
            given(message.pos_x[i], MAX_COORDINATE_M),
            given(message.pos_y[i], MAX_COORDINATE_M),
            given(message.pos_z[i], MAX_COORDINATE_M),
        ),
        velocity: Velocity::new(
            given(message.vel_x[i], MAX_SPEED_MPS),
            given(message.vel_y[i], MAX_SPEED_MPS),
            given(message.vel_z[i], MAX_SPEED_MPS),
        ),
        yaw_rad: given_turn(message.pos_yaw[i]),
        yaw_rate_radps: given_turn(message.vel_yaw[i]),
        command: message.command[i],
        valid: Flag::from(i < usize::from(message.valid_points)),
        reserved: Reserved::ZERO,
    });
    let [current, waypoint, next] = &mut points;
    let descends = current.position.z_m.is_nan() && current.velocity.z_mps.is_finite();
    if descends || current.command == COMMAND_LAND {
        waypoint.position.z_m = f64::NAN;
        next.position.z_m = f64::NAN;
    }
    DesiredPath {
        points,
        autopilot_time_us: message.time_usec,
        mode: Coded::new(px4_mode::infer(heartbeat, named, &points)),
        ..DesiredPath::default()
    }
}

/// A landing begins where the vehicle is within this of its place, level (m): what PX4 was seen to be beside a place that it
/// holds, doubled.
const ABOVE_M: f64 = 0.4;
/// And this slow, level (m/s): the way to rest from it stays within the tube.
const RESTING_MPS: f64 = 0.4;
/// A place that has moved less than this is the same (m): PX4 projects it anew in every cycle.
const SAME_PLACE_M: f64 = 0.5;
/// A take-off this near is straight up (m): what GPS drifts between arming and take-off.
const STRAIGHT_UP_M: f64 = 1.0;
/// A take-off this near to its height has reached it (m): within PX4's NAV_MC_ALT_RAD of 0.8 m.
const AT_HEIGHT_M: f64 = 0.5;

/// Separates the vertical part of take-offs and landings, which is the autopilot's, from the level part, which is planned.
#[derive(Clone, Copy, Debug, Default)]
pub struct VerticalMotions {
    landing: Option<Landing>,
    takeoff: Option<Takeoff>,
}

#[derive(Clone, Copy, Debug)]
struct Landing {
    /// Level coordinates (m).
    place: [f64; 2],
    /// Down coordinate of the vehicle when it was asked for (m).
    down_m: f64,
    /// The vehicle has come to rest above the place.
    has_begun: bool,
}

#[derive(Clone, Copy, Debug)]
struct Takeoff {
    /// Level coordinates of where it leads to (m).
    place: [f64; 2],
    /// Level coordinates of where it was begun (m).
    from: [f64; 2],
    has_ended: bool,
}

impl VerticalMotions {
    /// `path` with what is planned of it as plain targets; the vehicle is there and moves like that.
    pub fn separate(&mut self, path: &mut DesiredPath, vehicle: Option<&Present>) {
        let asks_for = |command| path.points[..2].iter().any(|point| point.command == command);
        let (takes_off, lands) = (asks_for(COMMAND_TAKEOFF), asks_for(COMMAND_LAND));
        if !takes_off {
            self.takeoff = None;
        }
        if !lands {
            self.landing = None;
        }
        let Some(vehicle) = vehicle.filter(|_| takes_off || lands) else {
            return;
        };
        let waypoint = path.points[1].position;
        let place = [waypoint.x_m, waypoint.y_m];
        if !place.iter().all(|c| c.is_finite()) {
            return;
        }
        if lands {
            self.land(path, place, vehicle);
        } else {
            self.take_off(path, place, vehicle);
        }
    }

    fn land(&mut self, path: &mut DesiredPath, place: [f64; 2], vehicle: &Present) {
        let mut landing = self
            .landing
            .filter(|before| level_m(before.place, place) <= SAME_PLACE_M)
            .unwrap_or(Landing {
                place,
                down_m: vehicle.position.z,
                has_begun: false,
            });
        landing.has_begun |= level_m(place, [vehicle.position.x, vehicle.position.y]) <= ABOVE_M
            && vehicle.velocity.xy().norm() <= RESTING_MPS;
        self.landing = Some(landing);
        if !landing.has_begun {
            make_plain(path, Point::new(place[0], place[1], landing.down_m));
        }
    }

    fn take_off(&mut self, path: &mut DesiredPath, place: [f64; 2], vehicle: &Present) {
        let here = [vehicle.position.x, vehicle.position.y];
        let mut takeoff = self
            .takeoff
            .filter(|before| level_m(before.place, place) <= SAME_PLACE_M)
            .unwrap_or(Takeoff {
                place,
                from: here,
                has_ended: false,
            });
        let target = path.points[1].position;
        takeoff.has_ended |= vehicle.position.z <= target.z_m + AT_HEIGHT_M;
        self.takeoff = Some(takeoff);
        if level_m(takeoff.from, place) <= STRAIGHT_UP_M {
            return;
        }
        if takeoff.has_ended {
            make_plain(path, target);
            return;
        }
        for point in &mut path.points[..2] {
            (point.position.x_m, point.position.y_m) = (takeoff.from[0], takeoff.from[1]);
        }
    }
}

fn level_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Its present target becomes `target`, a plain one.
fn make_plain(path: &mut DesiredPath, target: Point<jink_shared_types::LocalNed>) {
    for point in &mut path.points[..2] {
        point.position = target;
        point.velocity = Velocity::UNSET;
        point.command = COMMAND_NONE;
    }
}

/// A field that is given and makes sense, else NaN.
fn given(value: f32, largest: f64) -> f64 {
    let value = f64::from(value);
    if value.abs() <= largest { value } else { f64::NAN }
}

/// The same for headings and their rates, to the bit: what is mirrored is what was asked for.
fn given_turn(value: f32) -> f32 {
    if f64::from(value).abs() <= MAX_YAW_RAD {
        value
    } else {
        f32::NAN
    }
}

#[cfg(test)]
mod tests {
    use super::VerticalMotions;
    use crate::vehicle::Present;
    use jink_shared_types::vehicle::{COMMAND_LAND, COMMAND_TAKEOFF, DesiredPath, DesiredPoint, NavMode};
    use jink_shared_types::{Coded, Flag, Point, Velocity};
    use nalgebra::Vector3;

    fn at(x: f64, z: f64, speed_mps: f64) -> Present {
        Present {
            position: Vector3::new(x, 0.0, z),
            velocity: Vector3::new(speed_mps, 0.0, 0.0),
            yaw_rad: 0.0,
            shift: Vector3::zeros(),
        }
    }

    fn landing(x: f64) -> DesiredPath {
        let point = DesiredPoint {
            position: Point::new(x, 0.0, f64::NAN),
            velocity: Velocity::new(f64::NAN, f64::NAN, 0.7),
            command: COMMAND_LAND,
            valid: Flag::YES,
            ..DesiredPoint::default()
        };
        DesiredPath {
            points: [point; 3],
            mode: Coded::new(NavMode::Land),
            ..DesiredPath::default()
        }
    }

    fn takeoff(x: f64) -> DesiredPath {
        let mut path = landing(x);
        path.mode = Coded::new(NavMode::Takeoff);
        for point in &mut path.points {
            point.position.z_m = -5.0;
            point.velocity = Velocity::UNSET;
            point.command = COMMAND_TAKEOFF;
        }
        path
    }

    /// What becomes of `path` for a vehicle that is there, one after the other.
    fn separated(path: DesiredPath, vehicle: &[Present]) -> Vec<DesiredPath> {
        let mut motions = VerticalMotions::default();
        vehicle
            .iter()
            .map(|vehicle| {
                let mut path = path;
                motions.separate(&mut path, Some(vehicle));
                path
            })
            .collect()
    }

    #[test]
    fn a_landing_elsewhere_is_planned_to_above_its_place_and_begins_at_rest_there() {
        let way = [at(0.0, -4.0, 0.0), at(19.0, -4.5, 2.0), at(20.1, -4.0, 2.0)];
        for planned in separated(landing(20.0), &way) {
            assert!(planned.wants_planning());
            assert_eq!(planned.points[1].position, Point::new(20.0, 0.0, -4.0));
        }
        // Once begun it goes on, also where a gust has moved the vehicle.
        let mut all = way.to_vec();
        all.extend([at(20.1, -4.0, 0.1), at(20.9, -2.0, 0.8)]);
        for mirrored in &separated(landing(20.0), &all)[3..] {
            assert!(!mirrored.wants_planning());
            assert_eq!(mirrored.points[0].command, COMMAND_LAND);
            assert_eq!(mirrored.points[0].position.x_m, 20.0);
        }
    }

    #[test]
    fn a_landing_here_is_the_autopilots_as_soon_as_the_vehicle_rests() {
        assert!(!separated(landing(0.1), &[at(0.0, -4.0, 0.1)])[0].wants_planning());
        assert!(separated(landing(0.1), &[at(0.0, -4.0, 3.0)])[0].wants_planning());
    }

    #[test]
    fn a_takeoff_elsewhere_goes_straight_up_and_then_is_planned() {
        let all = separated(
            takeoff(30.0),
            &[at(1.0, 0.0, 0.0), at(1.2, -3.0, 0.0), at(1.1, -4.8, 0.0)],
        );
        for up in &all[..2] {
            assert!(!up.wants_planning());
            assert_eq!(up.points[0].position, Point::new(1.0, 0.0, -5.0));
        }
        assert!(all[2].wants_planning());
        assert_eq!(all[2].points[1].position, Point::new(30.0, 0.0, -5.0));
    }

    #[test]
    fn a_takeoff_here_stays_as_it_is() {
        let asked = takeoff(0.3);
        for path in separated(asked, &[at(0.0, 0.0, 0.0), at(0.0, -4.9, 0.0)]) {
            assert_eq!(path.points[0].position, asked.points[0].position);
            assert!(!path.wants_planning());
        }
    }
}
