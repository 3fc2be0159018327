//! Which point of the mission's track the flight task heads for.
//!
//! Normally that is the current waypoint. When the vehicle is further from the leg than the acceptance radius it is the
//! nearest point of the leg; when it has not yet reached the leg's start, the start; past the end, the end from here.

use super::setpoint::{CurrentPoint, PointKind, Triplet};
use jink_emulated_autopilot::mission::single;
use nalgebra::{Vector2, Vector3};

/// Waypoints that moved less than this are the same (m).
const UNCHANGED_M: f64 = 0.001;
/// Length below which a leg has no direction (single precision) (m).
const EPSILON_M: f64 = f32::EPSILON as f64;

/// Where the vehicle is relative to the leg.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Place {
    #[default]
    OnTrack,
    TargetBehind,
    PreviousInFront,
    OffTrack,
}

/// The leg being flown, and the points derived from it.
#[derive(Clone, Debug, Default)]
pub struct Track {
    leg: Option<Leg>,
    place: Place,
    locked_xy: Option<Vector2<f64>>,
    /// Where the flown part starts.
    pub from: Vector3<f64>,
    /// Where the flight task heads: the setpoint a companion is asked about.
    pub target: Vector3<f64>,
    /// What comes then.
    pub onward: Vector3<f64>,
    /// Acceptance radius of the target (m).
    pub acceptance_m: f64,
}

#[derive(Clone, Copy, Debug)]
struct Leg {
    previous: Vector3<f64>,
    current: Vector3<f64>,
    next: Vector3<f64>,
    previous_given: bool,
    next_given: bool,
}

impl Track {
    /// Without a current waypoint everything is where the vehicle is.
    pub fn stay(&mut self, position: &Vector3<f64>) {
        let here = single(*position);
        self.leg = None;
        self.locked_xy = None;
        self.place = Place::OnTrack;
        self.from = here;
        self.target = here;
        self.onward = here;
    }

    /// Follows the triplet. Returns whether the leg or the vehicle's place on it changed.
    pub fn update(&mut self, triplet: &Triplet, current: &CurrentPoint, position: &Vector3<f64>) -> bool {
        let target = self.resolve(current, position);
        let changed = self.leg.is_none_or(|leg| {
            (leg.current - target).amax() >= UNCHANGED_M
                || leg.previous_given != triplet.previous.is_some()
                || leg.next_given != triplet.next.is_some()
        });
        if changed {
            self.acceptance_m = current.acceptance_m;
            let next = match triplet.next {
                Some(next) if current.kind != PointKind::Loiter => next.position,
                _ => target,
            };
            self.leg = Some(Leg {
                previous: triplet.previous.unwrap_or(*position),
                current: target,
                next,
                previous_given: triplet.previous.is_some(),
                next_given: triplet.next.is_some(),
            });
        }
        let Some(leg) = self.leg else { return changed };
        let (place, closest) = self.locate(&leg, position);
        let moved = changed || place != self.place || place == Place::OffTrack;
        if moved {
            self.place = place;
            self.head_for(&leg, closest, position);
        }
        moved
    }

    /// The current waypoint itself.
    pub fn waypoint(&self) -> Vector3<f64> {
        self.leg.map_or(self.target, |leg| leg.current)
    }

    /// The waypoint after it.
    pub fn next_waypoint(&self) -> Vector3<f64> {
        self.leg.map_or(self.target, |leg| leg.next)
    }

    /// A target without horizontal place is where the vehicle was when it first received it.
    fn resolve(&mut self, current: &CurrentPoint, position: &Vector3<f64>) -> Vector3<f64> {
        let given = current.position;
        if given.x.is_finite() && given.y.is_finite() {
            self.locked_xy = None;
            return given;
        }
        let xy = *self.locked_xy.get_or_insert(single(*position).xy());
        Vector3::new(xy.x, xy.y, given.z)
    }

    fn locate(&self, leg: &Leg, position: &Vector3<f64>) -> (Place, Vector2<f64>) {
        let along = (leg.current - leg.previous)
            .xy()
            .try_normalize(EPSILON_M)
            .unwrap_or_default();
        let from_previous = (position - leg.previous).xy();
        let to_target = (leg.current - position).xy();
        let closest = leg.previous.xy() + along * from_previous.dot(&along);
        let place = if along.dot(&to_target) < 0.0 {
            Place::TargetBehind
        } else if along.dot(&from_previous) < 0.0 && from_previous.norm() > self.acceptance_m {
            Place::PreviousInFront
        } else if (position.xy() - closest).norm() > self.acceptance_m {
            Place::OffTrack
        } else {
            Place::OnTrack
        };
        (place, closest)
    }

    fn head_for(&mut self, leg: &Leg, closest: Vector2<f64>, position: &Vector3<f64>) {
        (self.from, self.target, self.onward) = match self.place {
            Place::OnTrack => (leg.previous, leg.current, leg.next),
            Place::TargetBehind => (*position, leg.current, leg.next),
            Place::PreviousInFront => (*position, leg.previous, leg.current),
            Place::OffTrack => {
                let nearest = Vector3::new(closest.x, closest.y, leg.current.z);
                (*position, single(nearest), leg.current)
            }
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triplet() -> Triplet {
        Triplet {
            previous: Some(Vector3::new(0.0, 0.0, -5.0)),
            current: Some(CurrentPoint {
                kind: PointKind::Position,
                position: Vector3::new(30.0, 0.0, -5.0),
                yaw_rad: f64::NAN,
                acceptance_m: 2.0,
                cruise_mps: f64::NAN,
            }),
            next: None,
        }
    }

    fn target_from(x: f64, y: f64) -> Vector3<f64> {
        let mut track = Track::default();
        let triplet = triplet();
        track.update(&triplet, &triplet.current.unwrap(), &Vector3::new(x, y, -5.0));
        track.target
    }

    #[test]
    fn the_target_is_the_waypoint_near_the_leg_and_the_leg_far_from_it() {
        assert_eq!(target_from(10.0, 1.9), Vector3::new(30.0, 0.0, -5.0));
        assert_eq!(target_from(10.0, 2.1), Vector3::new(10.0, 0.0, -5.0));
        assert_eq!(target_from(-4.0, 0.0), Vector3::new(0.0, 0.0, -5.0));
        assert_eq!(target_from(31.0, 5.0), Vector3::new(30.0, 0.0, -5.0));
    }

    #[test]
    fn a_target_without_a_place_is_locked_where_the_vehicle_was() {
        let mut track = Track::default();
        let mut triplet = triplet();
        triplet.previous = None;
        let mut current = triplet.current.unwrap();
        current.kind = PointKind::Land;
        current.position = Vector3::new(f64::NAN, f64::NAN, 488.0);
        track.update(&triplet, &current, &Vector3::new(3.0, 4.0, -5.0));
        track.update(&triplet, &current, &Vector3::new(5.0, 4.0, -4.0));
        assert_eq!(track.waypoint(), Vector3::new(3.0, 4.0, 488.0));
    }
}
