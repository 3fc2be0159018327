//! What is flown now: the approved trajectory, the autopilot's own target, or a point held.
//!
//! | mode | approved trajectory | desired path | flown |
//! |---|---|---|---|
//! | automatic | fresh and usable | any | the approved trajectory ([`Source::Planned`]); after its end its end |
//! | automatic | anything else | straight up or down, or no target | the autopilot's own target back ([`Source::Mirror`]) |
//! | automatic | anything else, one was flown before | for planning, or not known | that one, to its end at rest ([`Source::Coast`]) |
//! | automatic | none was flown | for planning, or not known | a held point ([`Source::Hold`]): never the raw waypoint |
//! | not listened to: flown by the pilot, or by the autopilot itself | any | any | the vehicle's place ([`Source::Shadow`]), so that no mode that listens begins with a jump |
//!
//! "Automatic" are the modes in which the autopilot flies what it is sent ([`super::Profile::listens`]). Where nothing smooths
//! a setpoint, a held point begins with a smooth stop, and a trajectory that lies far from the vehicle is not flown.
//!
//! A trajectory that was approved while the pilot flew, or that gave way to the autopilot's own target, belongs to a
//! flight that is over; it is never begun again. Points that are held stay where they are in the world when the estimator's coordinates jump.

use super::Situation;
use super::curve::{Curve, MAX_YAW_RAD};
use crate::vehicle::{MAX_COORDINATE_M, MAX_SPEED_MPS, Present};
use jink_shared_types::bezier::{self, QUINTIC};
use jink_shared_types::motion::{ApprovedTrajectory, Trajectory, TrajectoryMode, Verdict};
use jink_shared_types::vehicle::DesiredPath;
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
/// Peak deceleration of a stop of our own (m/s^2): PX4 and ArduCopter were measured to follow 2 to 4 with less than 0.7 m past
/// the end.
const STOP_MPS2: f64 = 2.5;
/// No stop is shorter than this (s).
const SHORTEST_STOP_S: f64 = 0.3;
/// A descent that stands still for so long (s) has met the ground: on its way down from a hover the vehicle moves after half of it.
const GROUND_AFTER_S: f64 = 2.0;
/// Slower than this share of the descent that is asked for is standing still.
const GROUND_SHARE: f64 = 0.3;
/// Then the curve lies so far below the vehicle (m): PX4 takes the way back to a curve from its own setpoint, which has gone on
/// into the ground, off the descent, and counts only nine tenths of a descent as one that ends on the ground.
const INTO_GROUND_M: f64 = 2.0;
/// What is flown until then (s) must have been sent: longer than four beats of the slowest stream.
const REPORTED_AHEAD_S: f64 = 0.4;
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

/// How what is sent lies to the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nearness {
    /// It belongs to a plan, and the vehicle is there.
    OnPlan,
    /// It does not.
    Apart,
    /// There is a plan, but it lies so far from the vehicle that it is not flown: it must be made anew.
    Astray,
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

/// A stop of our own.
#[derive(Clone, Copy, Debug)]
struct Stop {
    curve: Curve,
    shift: Vector3<f64>,
}

impl Stop {
    /// Its coordinates now, after all jumps of the estimator since it was begun.
    fn curve(&self, vehicle: &Present) -> Curve {
        self.curve.moved_by(vehicle.shift - self.shift)
    }
}

/// Decides what is flown.
#[derive(Debug)]
pub struct Pilot {
    horizon_s: f64,
    shortest_s: f64,
    /// A trajectory that is farther from the vehicle (m) is not flown, and stops are made by us; `None`: the autopilot
    /// smooths what it is sent.
    astray_m: Option<f64>,
    is_astray: bool,
    stop: Option<Stop>,
    flown: Box<Trajectory>,
    has_flown: bool,
    update: Option<SampleHeader>,
    barred: Option<u64>,
    held: Option<Held>,
    mirrored: Option<Held>,
    /// Since when a descent that is mirrored stands still.
    grounded_since: Option<Timestamp>,
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
            astray_m: None,
            is_astray: false,
            stop: None,
            flown: Box::default(),
            has_flown: false,
            update: None,
            barred: None,
            held: None,
            mirrored: None,
            grounded_since: None,
            shadow: None,
            last: None,
            listening_since: None,
            has_spoken: false,
        }
    }

    /// For autopilots that fly a setpoint as it is: one that lies farther than `astray_m` from the vehicle is not sent, and a
    /// stop is smooth.
    pub fn near_the_vehicle(mut self, astray_m: f64) -> Self {
        self.astray_m = Some(astray_m);
        self
    }

    /// Whether what is approved is not flown because it lies too far from the vehicle.
    pub fn is_astray(&self) -> bool {
        self.is_astray
    }

    /// Forgets everything that is given in coordinates.
    pub fn reset(&mut self) {
        self.forget_flight();
        self.barred = Some(self.flown.id);
        self.shadow = None;
    }

    fn forget_flight(&mut self) {
        self.has_flown = false;
        self.update = None;
        self.held = None;
        self.mirrored = None;
        self.last = None;
        self.stop = None;
        self.is_astray = false;
    }

    /// Takes note of the approved trajectory; `true` if it is a new one to be flown.
    pub fn observe(&mut self, situation: &Situation<'_>) -> bool {
        self.listening_since.get_or_insert(situation.now);
        let fresh = situation.approved.fresh();
        if !situation.is_flown {
            self.forget_flight();
            self.barred = fresh.map(|approved| approved.trajectory.id).or(self.barred);
            return false;
        }
        let Some(approved) = fresh else {
            return false;
        };
        self.is_astray &= is_for_flying(&approved);
        if !self.is_new(&approved) || !is_usable(&approved) {
            return false;
        }
        // What only goes on from a reference that the vehicle has lost is as far away as that: it is planned anew first.
        if self.is_astray && self.is_far(&approved.trajectory, situation) {
            self.barred = Some(approved.trajectory.id);
            return false;
        }
        *self.flown = approved.trajectory;
        self.has_flown = true;
        self.barred = None;
        self.is_astray = false;
        self.update = Some(*approved.header);
        true
    }

    /// The new trajectory's header, if it says what was sent last: then nobody waits for it.
    pub fn reported(&mut self, now: Timestamp) -> Option<SampleHeader> {
        let sent = self.last?;
        let is_reported = sent.agrees_with(&self.flown, now, REPORTED_AHEAD_S);
        self.update.take_if(|_| is_reported)
    }

    fn is_new(&self, approved: &ApprovedTrajectory) -> bool {
        let new = &approved.trajectory;
        let same = self.has_flown && new.id == self.flown.id && new.start == self.flown.start;
        !same && self.barred != Some(new.id)
    }

    /// What to fly from `start` (shortly before now) on; `None` before the first position, and for a moment after the
    /// start while nothing was received from the guard.
    pub fn decide(&mut self, situation: &Situation<'_>, start: Timestamp) -> Option<Decision> {
        let decision = self.choose(situation, start);
        self.has_spoken |= decision.is_some();
        decision
    }

    fn choose(&mut self, situation: &Situation<'_>, start: Timestamp) -> Option<Decision> {
        let vehicle = situation.vehicle?;
        if !situation.is_flown {
            return Some(self.shadow(&vehicle, start));
        }
        self.shadow = None;
        self.notice_astray(&vehicle, situation.now);
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

    /// What lies too far from the vehicle is not flown any more: nobody has certified the way there.
    fn notice_astray(&mut self, vehicle: &Present, now: Timestamp) {
        if self.has_flown && self.lies_far(&self.flown, vehicle, now) {
            self.has_flown = false;
            self.update = None;
            self.last = None;
            self.barred = Some(self.flown.id);
            self.is_astray = true;
        }
    }

    fn is_far(&self, trajectory: &Trajectory, situation: &Situation<'_>) -> bool {
        let vehicle = situation.vehicle;
        vehicle.is_some_and(|vehicle| self.lies_far(trajectory, &vehicle, situation.now))
    }

    /// Whether a reference lies farther from the vehicle than what may be flown.
    fn lies_far(&self, trajectory: &Trajectory, vehicle: &Present, now: Timestamp) -> bool {
        let Some(limit_m) = self.astray_m else {
            return false;
        };
        let apart = trajectory
            .at(now)
            .map(|reference| (reference.position.vector() - vehicle.position).norm());
        apart.is_none_or(|apart_m| apart_m > limit_m)
    }

    fn follow(&mut self, source: Source, start: Timestamp) -> Option<Decision> {
        let curve = Curve::cut(&self.flown, start, self.horizon_s, self.shortest_s)?;
        self.held = None;
        self.stop = None;
        self.mirrored = None;
        self.grounded_since = None;
        self.last = Some(curve);
        Some(Decision {
            curve,
            source,
            first_of: self.update.take().filter(|_| source == Source::Planned),
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
        if self.is_on_ground(velocity.z, vehicle, now) {
            position.z += INTO_GROUND_M;
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

    /// Whether a descent with that speed has met the ground.
    fn is_on_ground(&mut self, descent_mps: f64, vehicle: &Present, now: Timestamp) -> bool {
        let stands = descent_mps > 0.0 && vehicle.velocity.z < GROUND_SHARE * descent_mps;
        if !stands {
            self.grounded_since = None;
            return false;
        }
        let since = *self.grounded_since.get_or_insert(now);
        now.seconds_since(since) > GROUND_AFTER_S
    }

    fn hold(&mut self, vehicle: &Present, now: Timestamp, start: Timestamp) -> Decision {
        self.mirrored = None;
        if self.astray_m.is_some() {
            return self.come_to_rest(vehicle, now);
        }
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

    /// Stops smoothly, from what was sent last if the vehicle is there, else from the vehicle's own motion.
    fn come_to_rest(&mut self, vehicle: &Present, now: Timestamp) -> Decision {
        let last = self
            .last
            .filter(|curve| (curve.position_at(now) - vehicle.position).norm() <= HOLD_ON_M);
        let stop = *self.stop.get_or_insert_with(|| {
            let (position, velocity, yaw_rad) = match last {
                Some(curve) => (curve.position_at(now), curve.velocity_at(now), curve.yaw_at(now)),
                None => (vehicle.position, vehicle.velocity, vehicle.yaw_rad),
            };
            let duration_s = (1.5 * velocity.norm() / STOP_MPS2).max(SHORTEST_STOP_S);
            Stop {
                curve: Curve::stop(now, duration_s, position, velocity, yaw_rad),
                shift: vehicle.shift,
            }
        });
        let curve = stop.curve(vehicle);
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

pub(crate) fn is_for_flying(approved: &ApprovedTrajectory) -> bool {
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
