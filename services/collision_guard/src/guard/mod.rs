//! The guard: approves a new trajectory, keeps the one before, or brakes.
//!
//! | in | out |
//! |---|---|
//! | a new trajectory, if one has come | the approved trajectory, on every call |
//! | vehicle state, with its age | verdict, reason, free distance, stopping distance |
//! | the [`Ring`] | [`StepEvents`] for the pilot, once per change |
//!
//! # What is approved
//! A new trajectory passes if it is sound and within its own limits (`admission.rs`); departs from what is flown and
//! joins it without a jump; comes before its splice; ranges and vehicle state are fresh; its path is free for the distance
//! that the guard would need to stop (`lookahead.rs`); and it meets nothing that moves (`moving.rs`). Otherwise the one
//! before continues: it ends at rest, so refusing is always safe. A [`TrajectoryMode::Mirror`] always passes and ends what is flown. A stop (or brake) passes
//! without fresh data: it is what is needed then.
//!
//! # What is watched
//! The active trajectory is followed at every step. If a conflict is nearer than the stopping distance, it is replaced
//! by its own brake (`brake.rs`), unless it comes to rest within a shorter distance itself. The brake is flown until a
//! trajectory that departs from it passes. Unknown sectors are a conflict, except those of a sensor that no longer
//! answers: what was approved was certified then, and runs on to its own stop.
//!
//! # With collision prevention
//! What a pilot asks for is limited setpoint by setpoint, because the next setpoint is not known
//! ([`crate::prevention`]). A trajectory is known up to the place where it comes to rest, and so the same promise is
//! kept on the whole of it: never nearer to an obstacle than CP_DIST, and always slow enough to stop before. The
//! stricter one of the guard's own parameters and CP_DIST, CP_DELAY and MPC_ACC_HOR counts. A vehicle that is too near
//! already may leave, and comes no nearer.
//!
//! # After a restart
//! A guard that has just started does not know what is flown. It approves nothing until a trajectory comes, and takes
//! the first one that covers the present time, has not departed yet, is near the measured position and velocity, and
//! passes everything else. That is safe: up to its departure a trajectory repeats the approved one it was made from, so
//! the vehicle is on it already, and what it adds is checked like anything new. One that has departed is refused:
//! another trajectory is flown instead.

mod admission;
mod brake;
mod lookahead;
mod moving;

use crate::prevention::PreventionConfig;
use crate::ring::Ring;
use crate::step_events::StepEvents;
use admission::departure;
use brake::Braking;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::map::declared_as;
use jink_shared_types::motion::{
    ApprovedTrajectory, GuardReason, MotionState, Trajectory, TrajectoryMode, Verdict,
};
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::params::{self, ParamSet};
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Coded, Reading, Timestamp};
use lookahead::{Lookahead, LookaheadDemand, LookaheadResult};
use moving::MovingNow;

/// How far from the measured position a motion without a base may start (m): an estimator's jump, a gust.
const START_ERROR_M: f64 = 1.0;
/// Added per speed (s): the age of the measured position, and the lag of the vehicle.
const START_ERROR_S: f64 = 0.5;
/// How far from the measured velocity it may start (m/s): the change of speed by 3 m/s2 (PX4's MPC_ACC_HOR) in that
/// time. A trajectory that starts at rest is refused for a vehicle in motion.
const START_ERROR_MPS: f64 = 1.5;
/// A new trajectory must not need a brake for this long from now (s). Otherwise a start toward an obstacle would be
/// approved, because a vehicle at rest has no stopping distance, and braked half a second later, at speed.
const HORIZON_S: f64 = 1.0;
/// A brake is made only if it comes to rest within this share of the distance that the active trajectory takes.
const BRAKE_MAX_SHARE: f64 = 0.98;
/// Bit that marks trajectory ids made by the guard.
const GUARD_MADE: u64 = 1 << 63;

/// The guard's parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuardConfig {
    /// Radius of the vehicle (m).
    pub vehicle_radius_m: f64,
    /// Distance kept in addition to the radius (m).
    pub margin_m: f64,
    /// Deceleration of the brake, and assumed for the stopping distance (m/s2), in any case, and the most: between them
    /// as hard as the autopilot follows.
    pub brake_mps2: (f64, f64),
    /// Overshoot of stops that was learned in flight (s2); 0: as is known of the profile.
    pub overshoot_s2: f64,
    /// Assumed reaction time (s).
    pub delay_s: f64,
    /// Standoff: distance between the vehicle's centre and any obstacle (m), where that is more than radius and margin.
    pub standoff_m: f64,
    /// The user declares that space above a free place is free. The declaration counts for trajectories that depend on it, so it ends
    /// when the map drops it.
    pub no_overhang: bool,
}

impl GuardConfig {
    /// The values in force. Where collision prevention is switched on, the stricter of its values and the guard's own.
    pub fn from_params(params: &ParamSet) -> Self {
        let own = Self {
            vehicle_radius_m: params.get(&params::OA_VEH_RADIUS),
            margin_m: params.get(&params::GD_MARGIN),
            brake_mps2: (params.get(&params::GD_ACC_BRAKE), f64::INFINITY),
            overshoot_s2: params.get(&params::OA_TRK_OVER),
            delay_s: params.get(&params::GD_DELAY),
            standoff_m: 0.0,
            no_overhang: params.get(&params::OA_DCL_HANG_HI) > params.get(&params::OA_DCL_HANG_LO),
        };
        let prevention = PreventionConfig::from_params(params);
        if !prevention.is_active() {
            return own;
        }
        let most_mps2 = prevention.acceleration_mps2;
        Self {
            brake_mps2: (own.brake_mps2.0.min(most_mps2), most_mps2),
            delay_s: own.delay_s.max(prevention.delay_s),
            standoff_m: prevention.distance_m,
            ..own
        }
    }
}

/// The inputs of one step.
#[derive(Clone, Copy, Debug)]
pub struct GuardInputs<'a> {
    /// A trajectory that has come since the last step.
    pub trajectory: Option<&'a Trajectory>,
    /// The vehicle's state.
    pub state: Reading<'a, VehicleState>,
    /// The obstacles around.
    pub ring: &'a Ring,
    /// What of them moves.
    pub moving: Reading<'a, MovingObstacles>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FlownMotion {
    /// Not known yet.
    Unknown,
    /// The autopilot's own setpoints.
    Mirror,
    /// The active trajectory.
    Active,
}

/// The guard.
#[derive(Clone, Debug)]
pub struct Guard {
    config: GuardConfig,
    generation: u32,
    brakes: u32,
    flown: FlownMotion,
    active: Trajectory,
    /// Memory for a brake before it replaces the active trajectory.
    draft: Trajectory,
    /// The active trajectory is the guard's own brake.
    is_braking: bool,
    verdict: Verdict,
    reason: GuardReason,
    /// Whether ranges were fresh at the last step; `None` as long as there have never been any.
    had_ranges: Option<bool>,
    /// How the autopilot follows, as the vehicle's state said it last.
    tracking: Option<Tracking>,
    lookahead: Lookahead,
}

impl Guard {
    /// A guard without state. `generation` distinguishes this start of the process from others.
    pub fn new(config: GuardConfig, generation: u32) -> Self {
        Self {
            config,
            generation,
            brakes: 0,
            flown: FlownMotion::Unknown,
            active: Trajectory::default(),
            draft: Trajectory::default(),
            is_braking: false,
            verdict: Verdict::Hold,
            reason: GuardReason::None,
            had_ranges: None,
            tracking: None,
            lookahead: Lookahead::new(),
        }
    }

    /// Uses new parameters from now on.
    pub fn configure(&mut self, config: GuardConfig) {
        self.config = config;
    }

    /// One step: checks a new trajectory, watches the active one, and writes the approved one into `out`.
    ///
    /// Verdict and reason are those of the last decision, and stay until the next one: a refusal is reported until
    /// something passes or a brake is made. The mode says whether the approved trajectory is a brake. Without fresh
    /// ranges the free distance is infinite: nothing is known that ends it.
    pub fn step(
        &mut self,
        now: Timestamp,
        inputs: &GuardInputs<'_>,
        out: &mut ApprovedTrajectory,
    ) -> StepEvents {
        let mut step_events = StepEvents::default();
        let has_ranges = inputs.ring.is_fresh(now);
        self.report_ranges(has_ranges, &mut step_events);
        let known = inputs.state.fresh().and_then(|state| state.tracking.known());
        self.tracking = known.or(self.tracking);

        let mut lookahead = None;
        if let Some(candidate) = inputs.trajectory.filter(|candidate| self.is_new(candidate)) {
            match self.judge(now, candidate, inputs, has_ranges) {
                Ok(seen) => {
                    self.take(candidate, &mut step_events);
                    lookahead = seen;
                }
                Err(reason) => self.refuse(reason),
            }
        }
        if self.flown == FlownMotion::Active && has_ranges && lookahead.is_none() {
            let seen = self.look(now, None, inputs);
            if seen.is_blocked() {
                self.brake(now, &seen, &mut step_events);
            }
            lookahead = Some(seen);
        }

        out.trajectory = self.active;
        out.free_way_m = lookahead.map_or(f64::INFINITY, |seen| seen.free_distance_m);
        out.stopping_m = lookahead.map_or(0.0, |seen| seen.stopping_m);
        out.verdict = Coded::new(self.verdict);
        out.reason = Coded::new(self.reason);
        step_events
    }

    fn is_new(&self, candidate: &Trajectory) -> bool {
        self.flown != FlownMotion::Active || candidate.id != self.active.id
    }

    /// Whether `candidate` may be flown, and the result of the lookahead, if there was one.
    fn judge(
        &mut self,
        now: Timestamp,
        candidate: &Trajectory,
        inputs: &GuardInputs<'_>,
        has_ranges: bool,
    ) -> Result<Option<LookaheadResult>, GuardReason> {
        let mode = candidate.mode.get();
        if mode == TrajectoryMode::Mirror {
            // A mirror carries no pieces; with pieces it is a damaged trajectory whose mode byte has become unreadable.
            return if candidate.len == 0 {
                Ok(None)
            } else {
                Err(GuardReason::Unsound)
            };
        }
        admission::examine(candidate)?;
        let state = inputs.state.fresh().filter(|state| is_usable(state.sample));
        self.connects(now, candidate, state.map(|state| state.sample))?;
        let is_stop = matches!(mode, TrajectoryMode::Stop | TrajectoryMode::Brake);
        if !is_stop && !has_ranges {
            return Err(GuardReason::RangesStale);
        }
        if !is_stop && state.is_none() {
            return Err(GuardReason::StateStale);
        }
        if !has_ranges {
            return Ok(None);
        }
        let seen = self.look(now, Some(candidate), inputs);
        if seen.is_blocked() {
            Err(seen.conflict)
        } else {
            Ok(Some(seen))
        }
    }

    /// Whether `candidate` departs, in time and without a jump, from what is flown.
    fn connects(
        &self,
        now: Timestamp,
        candidate: &Trajectory,
        state: Option<&VehicleState>,
    ) -> Result<(), GuardReason> {
        let departs = departure(candidate);
        let is_on_time = if now <= departs {
            Ok(())
        } else {
            Err(GuardReason::Late)
        };
        if self.flown == FlownMotion::Active && candidate.base_id == self.active.id {
            is_on_time?;
            return admission::joins(candidate, &self.active, now);
        }
        let from_rest = candidate.base_id == 0;
        let may_start = match self.flown {
            FlownMotion::Active => from_rest && self.active.end() <= departs,
            FlownMotion::Mirror => from_rest,
            FlownMotion::Unknown => from_rest || candidate.start <= now,
        };
        if !may_start {
            return Err(GuardReason::WrongBase);
        }
        is_on_time?;
        let state = state.ok_or(GuardReason::StateStale)?;
        let reference = candidate.at(now).ok_or(GuardReason::Unsound)?;
        if is_near(&reference, state) {
            Ok(())
        } else {
            Err(GuardReason::Discontinuous)
        }
    }

    /// Follows `candidate`, or the active trajectory, through the ring.
    fn look(
        &mut self,
        now: Timestamp,
        candidate: Option<&Trajectory>,
        inputs: &GuardInputs<'_>,
    ) -> LookaheadResult {
        let clearance_m = self.config.vehicle_radius_m + self.config.margin_m;
        let trajectory = candidate.unwrap_or(&self.active);
        let demand = LookaheadDemand {
            clearance_m,
            standoff_m: clearance_m.max(self.config.standoff_m),
            delay_s: self.config.delay_s,
            braking: self.braking(),
            horizon_s: if candidate.is_some() { HORIZON_S } else { 0.0 },
            loss_counts: candidate.is_some(),
            no_overhang: self.config.no_overhang && trajectory.declarations & declared_as::NO_OVERHANG != 0,
        };
        let moving = inputs
            .moving
            .fresh()
            .map_or_else(MovingNow::default, |moving| MovingNow {
                obstacles: moving.sample.obstacles(),
                age_s: now.seconds_since(moving.header.capture).max(0.0),
            });
        self.lookahead
            .follow(now, trajectory, &inputs.ring.query(now), &moving, &demand)
    }

    fn take(&mut self, candidate: &Trajectory, step_events: &mut StepEvents) {
        if self.is_braking {
            step_events.add(EventSample::new(&events::GUARD_RELEASED, "", [0.0; 2]));
        }
        self.is_braking = false;
        self.active = *candidate;
        self.flown = if candidate.mode == TrajectoryMode::Mirror {
            FlownMotion::Mirror
        } else {
            FlownMotion::Active
        };
        self.verdict = Verdict::Passed;
        self.reason = GuardReason::None;
    }

    fn refuse(&mut self, reason: GuardReason) {
        self.verdict = if self.flown == FlownMotion::Unknown {
            Verdict::Hold
        } else {
            Verdict::Kept
        };
        self.reason = reason;
    }

    fn braking(&self) -> Braking {
        Braking {
            range_mps2: self.config.brake_mps2,
            tracking: self
                .tracking
                .map(|tracking| tracking.looser(0.0, self.config.overshoot_s2)),
        }
    }

    /// Replaces the active trajectory by its brake, if that is shorter.
    fn brake(&mut self, now: Timestamp, seen: &LookaheadResult, step_events: &mut StepEvents) {
        if self.is_braking {
            return;
        }
        let id = GUARD_MADE | (u64::from(self.generation) << 32) | u64::from(self.brakes);
        brake::brake(&self.active, now, &self.braking(), id, &mut self.draft);
        if self.draft.way_left_m(now) > BRAKE_MAX_SHARE * self.active.way_left_m(now) {
            return;
        }
        self.brakes = self.brakes.wrapping_add(1);
        std::mem::swap(&mut self.active, &mut self.draft);
        self.is_braking = true;
        self.verdict = Verdict::Braked;
        self.reason = seen.conflict;
        let what = match seen.conflict {
            GuardReason::Obstacle if seen.is_moving => "something moving",
            GuardReason::Obstacle => "obstacle",
            _ => "unseen",
        };
        step_events.add(EventSample::new(
            &events::GUARD_BRAKED,
            what,
            [seen.free_distance_m, 0.0],
        ));
    }

    fn report_ranges(&mut self, has_ranges: bool, step_events: &mut StepEvents) {
        match (self.had_ranges, has_ranges) {
            (None, false) => return,
            (Some(true), false) => step_events.add(EventSample::new(&events::RANGES_LOST, "", [0.0; 2])),
            (Some(false), true) => step_events.add(EventSample::new(&events::RANGES_BACK, "", [0.0; 2])),
            (None | Some(true), true) | (Some(false), false) => {}
        }
        self.had_ranges = Some(has_ranges);
    }
}

fn is_usable(state: &VehicleState) -> bool {
    /// No multicopter is faster: such a speed is damaged data, and must not excuse a start far away.
    const FASTEST_MPS: f64 = 60.0;
    state.position_valid.is_set()
        && state.position.is_finite()
        && state.velocity.vector().norm() <= FASTEST_MPS
}

fn is_near(reference: &MotionState, state: &VehicleState) -> bool {
    let speed_mps = state.velocity.vector().norm();
    let error_m = (reference.position.vector() - state.position.vector()).norm();
    let error_mps = (reference.velocity.vector() - state.velocity.vector()).norm();
    error_m <= START_ERROR_M + START_ERROR_S * speed_mps && error_mps <= START_ERROR_MPS
}
