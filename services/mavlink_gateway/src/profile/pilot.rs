//! What is flown now: the approved trajectory, the autopilot's own target, or a point held.
//!
//! | mode | approved trajectory | desired path | flown |
//! |---|---|---|---|
//! | automatic | fresh and usable | any | the approved trajectory ([`Source::Planned`]); after its end its end |
//! | automatic | anything else | not for planning | the autopilot's own target back ([`Source::Mirror`]) |
//! | automatic | anything else, one was flown before | for planning, or not known | that one, to its end at rest ([`Source::Coast`]) |
//! | automatic | none was flown | for planning, or not known | a held point ([`Source::Hold`]): never the raw waypoint |
//! | flown by the pilot | any | any | the vehicle's place ([`Source::Shadow`]), ignored by PX4, so that no automatic mode begins with a jump |
//!
//! A trajectory that was approved while the pilot flew, or that gave way to the autopilot's own target, belongs to a
//! flight that is over; it is never begun again. Points that are held stay where they are in the world when the estimator's coordinates jump.

use super::Situation;
use super::curve::{Curve, MAX_YAW_RAD};
use crate::vehicle::{MAX_COORDINATE_M, MAX_SPEED_MPS, Present};
use jink_shared_types::bezier::{self, QUINTIC};
use jink_shared_types::motion::{ApprovedTrajectory, Trajectory, TrajectoryMode, Verdict};
use jink_shared_types::vehicle::{DesiredPath, NavMode};
use jink_shared_types::{SampleHeader, Timestamp};
use nalgebra::Vector3;

/// The last setpoint is only held on if the vehicle is this near to it (m); further away it was the target of a motion
/// that nobody has planned.
const HOLD_ON_M: f64 = 1.0;
/// While the pilot flies, the streamed point follows the vehicle when it is this far away (m).
const SHADOW_M: f64 = 0.5;
/// How long a new gateway listens for a trajectory before it holds a point (s): at 30 Hz one comes within 33 ms, and
/// a restarted gateway must not brake a flight that is going well. PX4 still flies the last curve for longer than that.
const LISTEN_S: f64 = 0.15;
/// A trajectory longer than this (s) is none.
const LONGEST_TRAJECTORY_S: f64 = 1e4;

/// Where a setpoint comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Cut from a freshly approved trajectory.
    Planned,
    /// Cut from the last one that was approved; the guard is silent or has nothing new.
    Coast,
    /// The autopilot's own target.
    Mirror,
    /// A held point.
    Hold,
    /// The vehicle's own place, while the pilot flies.
    Shadow,
}

/// A decision.
#[derive(Clone, Copy, Debug)]
pub struct Decision {
    /// What to fly.
    pub curve: Curve,
    /// Why.
    pub source: Source,
    /// Of the approved trajectory, if this is the first curve cut from it.
    pub first_of: Option<SampleHeader>,
}

/// A place to stay at.
#[derive(Clone, Copy, Debug)]
struct Held {
    position: Vector3<f64>,
    yaw_rad: f64,
    shift: Vector3<f64>,
}

impl Held {
    fn at(position: Vector3<f64>, yaw_rad: f64, vehicle: &Present) -> Self {
        Self {
            position,
            yaw_rad,
            shift: vehicle.shift,
        }
    }

    /// Its coordinates now, after all jumps of the estimator since it was taken.
    fn position(&self, vehicle: &Present) -> Vector3<f64> {
        self.position + (vehicle.shift - self.shift)
    }
}

/// Decides what is flown.
#[derive(Debug)]
pub struct Pilot {
    horizon_s: f64,
    shortest_s: f64,
    flown: Box<Trajectory>,
    has_flown: bool,
    news: Option<SampleHeader>,
    barred: Option<u64>,
    held: Option<Held>,
    mirrored: Option<Held>,
    shadow: Option<Held>,
    last: Option<Curve>,
    listening_since: Option<Timestamp>,
    has_spoken: bool,
}

impl Pilot {
    /// Curves last `horizon_s`, or down to `shortest_s`.
    pub fn new(horizon_s: f64, shortest_s: f64) -> Self {
        Self {
            horizon_s,
            shortest_s,
            flown: Box::default(),
            has_flown: false,
            news: None,
            barred: None,
            held: None,
            mirrored: None,
            shadow: None,
            last: None,
            listening_since: None,
            has_spoken: false,
        }
    }

    /// Forgets everything that is told in coordinates.
    pub fn reset(&mut self) {
        self.forget_flight();
        self.barred = Some(self.flown.id);
        self.shadow = None;
    }

    fn forget_flight(&mut self) {
        self.has_flown = false;
        self.news = None;
        self.held = None;
        self.mirrored = None;
        self.last = None;
    }

    /// Takes note of the approved trajectory; `true` if it is a new one to be flown.
    pub fn observe(&mut self, situation: &Situation<'_>) -> bool {
        self.listening_since.get_or_insert(situation.now);
        let fresh = situation.approved.fresh();
        if !is_automatic(situation.mode) {
            self.forget_flight();
            self.barred = fresh.map(|approved| approved.trajectory.id).or(self.barred);
            return false;
        }
        let Some(approved) = fresh else {
            return false;
        };
        if !self.is_news(&approved) || !is_usable(&approved) {
            return false;
        }
        *self.flown = approved.trajectory;
        self.has_flown = true;
        self.barred = None;
        self.news = Some(*approved.header);
        true
    }

    fn is_news(&self, approved: &ApprovedTrajectory) -> bool {
        let new = &approved.trajectory;
        let same = self.has_flown && new.id == self.flown.id && new.start == self.flown.start;
        !same && self.barred != Some(new.id)
    }

    /// What to fly from `start` (shortly before now) on; `None` before the first position, and for a moment after the
    /// start while nothing was heard of the guard.
    pub fn decide(&mut self, situation: &Situation<'_>, start: Timestamp) -> Option<Decision> {
        let decision = self.choose(situation, start);
        self.has_spoken |= decision.is_some();
        decision
    }

    fn choose(&mut self, situation: &Situation<'_>, start: Timestamp) -> Option<Decision> {
        let vehicle = situation.vehicle?;
        if !is_automatic(situation.mode) {
            return Some(self.shadow(&vehicle, start));
        }
        self.shadow = None;
        let fresh = situation.approved.fresh();
        let follows = self.has_flown
            && fresh
                .is_some_and(|approved| approved.trajectory.id == self.flown.id && is_for_flying(&approved));
        if follows && let Some(decision) = self.follow(Source::Planned, start) {
            return Some(decision);
        }
        if let Some(path) = situation.desired.filter(|path| !path.wants_planning()) {
            return Some(self.mirror(path, &vehicle, situation.now, start));
        }
        if self.has_flown
            && let Some(decision) = self.follow(Source::Coast, start)
        {
            return Some(decision);
        }
        let since = self.listening_since.unwrap_or(situation.now);
        let listens = !self.has_spoken && situation.now.seconds_since(since) < LISTEN_S;
        if listens && fresh.is_none() {
            return None;
        }
        Some(self.hold(&vehicle, situation.now, start))
    }

    fn follow(&mut self, source: Source, start: Timestamp) -> Option<Decision> {
        let curve = Curve::cut(&self.flown, start, self.horizon_s, self.shortest_s)?;
        self.held = None;
        self.mirrored = None;
        self.last = Some(curve);
        Some(Decision {
            curve,
            source,
            first_of: self.news.take().filter(|_| source == Source::Planned),
        })
    }

    /// The autopilot's target as a curve, axis by axis: a position stays, a velocity without a position moves on from
    /// where the vehicle is, and what is not given stays where the mirroring began.
    fn mirror(
        &mut self,
        path: &DesiredPath,
        vehicle: &Present,
        now: Timestamp,
        start: Timestamp,
    ) -> Decision {
        if std::mem::take(&mut self.has_flown) {
            self.barred = Some(self.flown.id);
        }
        self.held = None;
        let [target, waypoint, _] = &path.points;
        let begun = *self
            .mirrored
            .get_or_insert(Held::at(vehicle.position, vehicle.yaw_rad, vehicle));
        let stay = begun.position(vehicle);
        let wanted = target.position.vector();
        let wanted_velocity = target.velocity.vector();
        let mut position = stay;
        let mut velocity = Vector3::zeros();
        for axis in 0..3 {
            if wanted[axis].is_finite() {
                position[axis] = wanted[axis];
            } else if wanted_velocity[axis].is_finite() {
                position[axis] = vehicle.position[axis];
                velocity[axis] = wanted_velocity[axis];
            }
        }
        let yaw_rad = [target.yaw_rad, waypoint.yaw_rad]
            .into_iter()
            .map(f64::from)
            .find(|yaw| yaw.abs() <= MAX_YAW_RAD)
            .unwrap_or(begun.yaw_rad);
        let curve = Curve::line(start, self.horizon_s, position, now, velocity, yaw_rad);
        self.last = Some(curve);
        Decision {
            curve,
            source: Source::Mirror,
            first_of: None,
        }
    }

    fn hold(&mut self, vehicle: &Present, now: Timestamp, start: Timestamp) -> Decision {
        self.mirrored = None;
        let here = Held::at(vehicle.position, vehicle.yaw_rad, vehicle);
        let last = self.last;
        let held = *self.held.get_or_insert_with(|| match last {
            Some(curve) if (curve.position_at(now) - vehicle.position).norm() <= HOLD_ON_M => {
                Held::at(curve.position_at(now), curve.yaw_at(now), vehicle)
            }
            _ => here,
        });
        let curve = Curve::constant(start, self.horizon_s, held.position(vehicle), held.yaw_rad);
        self.last = Some(curve);
        Decision {
            curve,
            source: Source::Hold,
            first_of: None,
        }
    }

    fn shadow(&mut self, vehicle: &Present, start: Timestamp) -> Decision {
        let near = self
            .shadow
            .filter(|shadow| (shadow.position(vehicle) - vehicle.position).norm() <= SHADOW_M);
        let shadow = near.unwrap_or(Held::at(vehicle.position, vehicle.yaw_rad, vehicle));
        self.shadow = Some(shadow);
        Decision {
            curve: Curve::constant(start, self.horizon_s, shadow.position(vehicle), vehicle.yaw_rad),
            source: Source::Shadow,
            first_of: None,
        }
    }
}

/// Whether PX4 listens in this mode. It may be listening in a mode that is not known yet, or has no name here.
fn is_automatic(mode: NavMode) -> bool {
    mode.is_automatic() || mode == NavMode::Unknown
}

fn is_for_flying(approved: &ApprovedTrajectory) -> bool {
    approved.verdict != Verdict::Hold && approved.trajectory.mode != TrajectoryMode::Mirror
}

/// Whether it can be flown at all: something to fly, no number that could not be sent, and no leap.
fn is_usable(approved: &ApprovedTrajectory) -> bool {
    let trajectory = &approved.trajectory;
    is_for_flying(approved)
        && trajectory.is_sound()
        && trajectory.duration_s() <= LONGEST_TRAJECTORY_S
        && trajectory.pieces().iter().all(|piece| {
            let points = piece.points();
            let velocity: [_; QUINTIC - 1] = bezier::derivative(&points, piece.duration_s);
            points.iter().all(|p| p.amax() <= MAX_COORDINATE_M)
                && velocity.iter().all(|v| v.norm() <= MAX_SPEED_MPS)
                && piece.yaw_rad.iter().all(|yaw| yaw.abs() <= MAX_YAW_RAD)
        })
}
