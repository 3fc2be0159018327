//! Collision prevention: a setpoint is passed on only as far as it leads to no obstacle.
//!
//! | in | out |
//! |---|---|
//! | the sector ring | the setpoint as it may be flown ([`PreventionOutput::setpoint`]) |
//! | a horizontal setpoint, acceleration or velocity, local NED | what was done to it, and why ([`PreventionState`], [`PreventionCause`]) |
//! | the horizontal velocity | whether the vehicle is to hold |
//!
//! # An acceleration
//! 1. **Guidance** turns the setpoint toward a better direction nearby (`guidance.rs`), PX4's choice.
//! 2. **Split**: what leads toward the nearest obstacle and what leads along it are scaled, PX4's law (`split.rs`).
//! 3. **Compensation**: a vehicle that is too fast for the distance that is left is slowed, PX4's law for the sector
//!    that needs it most.
//! 4. **Limits**: the result is the acceleration nearest to that which, for *every* known sector `k`, keeps
//!
//!    ```text
//!    a . u_k <= P (v_max(d_k) - v . u_k) + max(S(d_k), 0) max(setpoint . u_k, 0)
//!    ```
//!
//!    where `u_k` is the sector's direction, `d_k` how far it is known, `v_max` the speed from which the vehicle still
//!    stops at CP_DIST (`laws.rs`), `P` MPC_XY_VEL_P_ACC, `S` the scale. For a single obstacle ahead 1 to 3 give the
//!    same result already; the limits are needed for a second one, and a third (`half_planes.rs`). The first summand
//!    makes "not faster than one can stop" a barrier (Ames et al.: Control barrier functions, 2019): the excess decays
//!    with the rate `P`.
//! 5. The result is not longer than MPC_ACC_HOR or the setpoint itself, whichever is longer.
//!
//! This is for an acceleration, the input of PX4's own collision prevention. Nothing in jink steers by accelerations,
//! so this part is not flown: it is compared with PX4's results (`the_reference_vectors_are_met`), and kept for that.
//! Guidance, the sectors, their times, and the speed from which the vehicle can stop are the same code for both inputs,
//! and only for accelerations there are results of PX4 to compare with.
//!
//! # A velocity
//! is what the pilot's sticks demand where he steers through jink. Step 1 applies to it, and then:
//!
//! 1. It is approached from the last result no faster than the vehicle is to accelerate (`rate_limiter.rs`).
//! 2. The first contact of a straight flight is computed (`outline.rs`). Along the normal there, the velocity must be
//!    one from which the vehicle stops at CP_DIST, with `1 / P` in addition to CP_DELAY; the result is the nearest
//!    velocity for which that holds, and 2 is repeated with it, until no contact is too fast. What is passed at CP_DIST
//!    or more does not count, so that the vehicle slides along walls with the part of the demand along them.
//! 3. What is small and isolated limits the speed as if it stood in the path, unless it is passed at three times
//!    CP_DIST: it may be a person who takes another step.
//! 4. With the stick pushed, the vehicle retreats from what has come nearer than CP_DIST.
//!
//! What moves, as far as obstacle fusion tracks it, stands in the ring where it is going to be as well (`expected.rs`): the
//! distances above are kept from there.
//!
//! The differences to PX4, and their reasons, are one table in docs/collision_prevention.md. Nothing here allocates,
//! and every result is a number: a setpoint that is NaN counts as a centred stick, and with a velocity that is NaN
//! nothing moves.

mod config;
mod data_loss;
pub(crate) mod expected;
mod guidance;
mod half_planes;
mod laws;
mod outline;
mod pilot_guard;
mod rate_limiter;
mod sector_states;
mod split;
#[cfg(test)]
mod tests;

pub use config::PreventionConfig;
pub use guidance::{GuidedDirection, guide};
pub use laws::{scale, speed_limit};
pub use pilot_guard::PilotGuard;
pub use sector_states::{SectorState, SectorStates};

use data_loss::{DataLoss, DataLossAction};
use half_planes::HalfPlanes;
use jink_shared_types::Timestamp;
use jink_shared_types::prevention::{PreventionCause, PreventionState};
use jink_shared_types::ring::{SECTORS, SectorRing};
use nalgebra::Vector2;
use outline::Outline;
use rate_limiter::{RateLimitStep, RateLimiter};
use split::Split;

/// A setpoint shorter than this is a centred stick (m/s2 or m/s): PX4's own limit.
const CENTRED: f64 = 1e-3;
/// The vehicle stands if it is slower (m/s): less than an estimator's noise.
const STANDS_MPS: f64 = 0.05;
/// Fastest retreat from an obstacle that has come too near (m/s): a person walks with 1.4.
const RETREAT_MPS: f64 = 2.0;
/// Most contacts that one result is corrected for: two walls are enough for a corner, the rest is for irregular
/// obstacles.
const CONTACTS: usize = 8;
/// Largest plausible demand (m/s2, m/s): beyond, data are damaged.
const PLAUSIBLE_MAX: f64 = 1e3;

/// A horizontal demand, local NED (north, east).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HorizontalSetpoint {
    /// An acceleration (m/s2).
    Acceleration(Vector2<f64>),
    /// A velocity (m/s).
    Velocity(Vector2<f64>),
}

/// The result of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreventionOutput {
    /// What may be flown, of the kind of the demand. Always finite, except when switched off: then it is the demand.
    pub setpoint: Vector2<f64>,
    /// What was done.
    pub state: PreventionState,
    /// Why.
    pub cause: PreventionCause,
    /// The nearest obstacle, or the nearest end of what is known: its sector and distance (m).
    pub nearest: Option<(usize, f64)>,
    /// The sector that guidance chose.
    pub guided: Option<usize>,
    /// No sensor has data, and the pilot has to be notified.
    pub must_warn: bool,
}

/// Collision prevention.
#[derive(Clone, Debug)]
pub struct Prevention {
    config: PreventionConfig,
    data_loss: DataLoss,
    rate_limiter: RateLimiter,
    /// Sectors, from the nose, of which something was known since construction.
    ever_seen: [bool; SECTORS],
}

impl Prevention {
    /// Without any data yet.
    pub fn new(config: PreventionConfig) -> Self {
        Self {
            config,
            data_loss: DataLoss::default(),
            rate_limiter: RateLimiter::default(),
            ever_seen: [false; SECTORS],
        }
    }

    /// The parameters in force.
    pub fn config(&self) -> &PreventionConfig {
        &self.config
    }

    /// Uses new parameters from now on.
    pub fn configure(&mut self, config: PreventionConfig) {
        self.config = config;
    }

    /// What may be flown of `demand` by a vehicle that moves with `velocity` (north, east, m/s), with `ring` around it.
    pub fn step(
        &mut self,
        now: Timestamp,
        ring: &SectorRing,
        demand: HorizontalSetpoint,
        velocity: Vector2<f64>,
    ) -> PreventionOutput {
        let sectors = SectorStates::of(ring, now);
        let newest = ring.seen.iter().max().copied().filter(|_| sectors.has_data());
        let missing = self.data_loss.note(now, &self.config, newest);
        let asked = match demand {
            HorizontalSetpoint::Acceleration(wanted) | HorizontalSetpoint::Velocity(wanted) => wanted,
        };
        let mut outcome = PreventionOutput {
            setpoint: asked,
            state: PreventionState::Off,
            cause: PreventionCause::None,
            nearest: sectors.nearest(),
            guided: None,
            must_warn: false,
        };
        if !self.config.is_active() {
            return outcome;
        }
        for (seen, state) in self.ever_seen.iter_mut().zip(&sectors.states) {
            *seen |= *state != SectorState::Unknown;
        }
        outcome.state = PreventionState::Free;
        if !is_plausible(&velocity) {
            outcome.setpoint = Vector2::zeros();
            outcome.state = PreventionState::Acting;
            outcome.cause = PreventionCause::BadInput;
            return outcome;
        }
        if missing != DataLossAction::Nothing {
            outcome.setpoint = match demand {
                HorizontalSetpoint::Acceleration(_) => {
                    let stopping = velocity * -self.config.velocity_gain_per_s;
                    stopping.cap_magnitude(self.config.acceleration_mps2)
                }
                HorizontalSetpoint::Velocity(_) => Vector2::zeros(),
            };
            outcome.cause = PreventionCause::NoData;
            outcome.must_warn = missing != DataLossAction::Quiet;
            outcome.state = if missing == DataLossAction::Hold {
                PreventionState::Hold
            } else {
                PreventionState::Blind
            };
            return outcome;
        }
        let wanted = if is_plausible(&asked) {
            asked
        } else {
            Vector2::zeros()
        };
        let keep_m = self.config.distance_m.max(sectors.range_min_m);
        let scene = PreventionStep {
            config: &self.config,
            sectors: &sectors,
            keep_m,
            allowed_unseen: std::array::from_fn(|sector| self.config.goes_unseen && !self.ever_seen[sector]),
        };
        let rate_limiter = self.rate_limiter.at(now, &velocity);
        let (setpoint, asked_now, cause, guided) = match demand {
            HorizontalSetpoint::Acceleration(_) => {
                let (setpoint, cause, guided) = scene.acceleration(wanted, velocity);
                (setpoint, asked, cause, guided)
            }
            HorizontalSetpoint::Velocity(_) => {
                let asked_now = rate_limiter.toward(&wanted, self.config.acceleration_mps2);
                let (setpoint, cause, guided) = scene.velocity(wanted, &rate_limiter);
                self.rate_limiter = RateLimiter::new(now, setpoint);
                (setpoint, asked_now, cause, guided)
            }
        };
        outcome.setpoint = setpoint;
        outcome.guided = guided;
        if (setpoint - asked_now).norm() > CENTRED || !is_plausible(&asked) {
            outcome.state = PreventionState::Acting;
            outcome.cause = if is_plausible(&asked) {
                cause
            } else {
                PreventionCause::BadInput
            };
        }
        outcome
    }
}

fn is_plausible(vector: &Vector2<f64>) -> bool {
    // False for NaN.
    vector.norm() < PLAUSIBLE_MAX
}

/// The inputs of one step.
struct PreventionStep<'a> {
    config: &'a PreventionConfig,
    sectors: &'a SectorStates,
    keep_m: f64,
    allowed_unseen: [bool; SECTORS],
}

impl PreventionStep<'_> {
    fn acceleration(
        &self,
        wanted: Vector2<f64>,
        velocity: Vector2<f64>,
    ) -> (Vector2<f64>, PreventionCause, Option<usize>) {
        let size = wanted.norm();
        let (guided, demand) = self.guided(wanted, size);
        let mut answer = Vector2::zeros();
        let mut cause = PreventionCause::None;
        if size > CENTRED {
            answer = self.split().share(demand / size) * size;
            cause = self.why(&demand, guided.map(|guided| guided.1));
        }
        let compensation = self.compensation(&velocity);
        let mut limits = HalfPlanes::default();
        for (sector, toward, reach_m) in self.sectors.known() {
            let closing_mps = velocity.dot(&toward);
            let room = self.config.velocity_gain_per_s
                * (self.limit_mps(sector, reach_m, closing_mps) - closing_mps);
            let granted = scale(self.config, self.keep_m, reach_m).max(0.0) * demand.dot(&toward).max(0.0);
            limits.push(toward, (room + granted).max(-self.config.acceleration_mps2));
        }
        let before = answer;
        answer = limits.nearest(answer + compensation);
        if cause == PreventionCause::None && (answer - before).norm() > CENTRED {
            cause = PreventionCause::Obstacle;
        }
        let longest = self.config.acceleration_mps2.max(size);
        (
            answer.cap_magnitude(longest),
            cause,
            guided.map(|guided| guided.0),
        )
    }

    fn velocity(
        &self,
        wanted: Vector2<f64>,
        rate_limiter: &RateLimitStep,
    ) -> (Vector2<f64>, PreventionCause, Option<usize>) {
        let size = wanted.norm();
        let (guided, demand) = self.guided(wanted, size);
        let cause = self.why(&demand, guided.map(|guided| guided.1));
        let target = demand * self.coverage(&demand);
        let next = rate_limiter.toward(&target, self.config.acceleration_mps2);
        let answer = self.moderated(next * self.coverage(&next), size > CENTRED);
        let answer = answer * self.coverage(&answer);
        (answer, cause, guided.map(|guided| guided.0))
    }

    /// The velocity nearest to `wanted` from which the vehicle can stop before everything it leads to.
    fn moderated(&self, wanted: Vector2<f64>, is_pushed: bool) -> Vector2<f64> {
        let outline = Outline::of(self.sectors, self.keep_m);
        let mut limits = HalfPlanes::default();
        if let Some(near) = outline.too_near().filter(|_| is_pushed) {
            limits.push(near.normal, self.closing_mps(near.room_m));
        }
        for place in outline.isolated() {
            self.limit_for_isolated(place, &wanted, &mut limits);
        }
        // Between two obstacles the nearest velocity within both limits may be arbitrarily large sideways.
        let longest_mps = wanted.norm().max(if is_pushed { RETREAT_MPS } else { 0.0 });
        let mut answer = limits.nearest(wanted).cap_magnitude(longest_mps);
        for _ in 0..CONTACTS {
            let Some(direction) = answer.try_normalize(CENTRED) else {
                return Vector2::zeros();
            };
            let Some(contact) = outline.first_contact(&direction) else {
                return answer;
            };
            let limit_mps = self.closing_mps(contact.room_m).max(0.0);
            let closing_mps = answer.dot(&contact.normal);
            if closing_mps <= limit_mps + CENTRED {
                return answer;
            }
            limits.push(contact.normal, limit_mps);
            answer = limits.nearest(wanted).cap_magnitude(longest_mps);
        }
        // There is a contact in every direction that was tried: slower in the last of them.
        let direction = answer.try_normalize(CENTRED).unwrap_or_default();
        match outline.first_contact(&direction) {
            Some(contact) => {
                let limit_mps = self.closing_mps(contact.room_m).max(0.0) / contact.normal.dot(&direction);
                answer.cap_magnitude(limit_mps)
            }
            None => answer,
        }
    }

    /// Something isolated may step into the path: the speed toward it is limited as if it stood there, the less so the
    /// farther aside it is passed. From twice CP_DIST aside the limit is relaxed, and at three times there is none.
    fn limit_for_isolated(&self, place: &Vector2<f64>, wanted: &Vector2<f64>, limits: &mut HalfPlanes) {
        let distance_m = place.norm();
        let speed_mps = wanted.norm();
        if distance_m <= CENTRED || speed_mps <= CENTRED || wanted.dot(place) <= 0.0 {
            return;
        }
        let aside_m = wanted.perp(place).abs() / speed_mps;
        let care = (3.0 - aside_m / self.keep_m).min(1.0);
        if care > 0.0 {
            let limit_mps = self.closing_mps((distance_m - self.keep_m).max(0.0)) / care;
            limits.push(place / distance_m, limit_mps);
        }
    }

    /// Greatest speed toward something that may be approached by another `room_m` (m/s). From an obstacle that is too
    /// near the vehicle retreats with the gain of the velocity controller: with a lower one it did not retreat from a
    /// person who walked up.
    fn closing_mps(&self, room_m: f64) -> f64 {
        if room_m < 0.0 {
            return (self.config.velocity_gain_per_s * room_m).max(-RETREAT_MPS);
        }
        // A velocity is reached with the time constant of the velocity controller.
        let delay_s = self.config.delay_s + 1.0 / self.config.velocity_gain_per_s;
        speed_limit(
            room_m,
            self.config.acceleration_mps2,
            self.config.jerk_mps3,
            delay_s,
        )
    }

    /// Share of a velocity that leads into known sectors; 1 for zero velocity.
    fn coverage(&self, velocity: &Vector2<f64>) -> f64 {
        let speed_mps = velocity.norm();
        if speed_mps > CENTRED {
            self.split().coverage(&(velocity / speed_mps))
        } else {
            1.0
        }
    }

    fn split(&self) -> Split<'_> {
        Split {
            config: self.config,
            sectors: self.sectors,
            keep_m: self.keep_m,
            allowed_unseen: &self.allowed_unseen,
        }
    }

    /// The sector that guidance chose and whether it is another one; the demand turned there.
    fn guided(&self, wanted: Vector2<f64>, size: f64) -> (Option<(usize, bool)>, Vector2<f64>) {
        if size <= CENTRED {
            return (None, Vector2::zeros());
        }
        let guided = guide(self.config, self.sectors, wanted / size);
        (
            Some((guided.sector, guided.sector != guided.original)),
            guided.direction * size,
        )
    }

    /// The cause of a change to a demand, if there is one.
    fn why(&self, demand: &Vector2<f64>, was_turned: Option<bool>) -> PreventionCause {
        match self.sectors.states[self.sectors.sector_toward(demand)] {
            SectorState::Unknown => PreventionCause::Unseen,
            _ if was_turned == Some(true) => PreventionCause::Guided,
            SectorState::Clear { .. }
                if self
                    .sectors
                    .nearest()
                    .is_none_or(|(sector, _)| self.is_clear(sector)) =>
            {
                PreventionCause::Reach
            }
            SectorState::Clear { .. } | SectorState::Hit { .. } => PreventionCause::Obstacle,
        }
    }

    fn is_clear(&self, sector: usize) -> bool {
        matches!(self.sectors.states[sector], SectorState::Clear { .. })
    }

    /// Greatest speed toward a sector (m/s) of a vehicle that closes on it with `closing_mps`.
    fn limit_mps(&self, sector: usize, reach_m: f64, closing_mps: f64) -> f64 {
        let age_s = match self.sectors.states[sector] {
            SectorState::Hit { age_s, .. } => age_s,
            SectorState::Clear { .. } | SectorState::Unknown => 0.0,
        };
        let flown_m = closing_mps.max(0.0) * (self.config.delay_s + age_s);
        let way_m = reach_m - self.keep_m - flown_m;
        speed_limit(way_m, self.config.acceleration_mps2, self.config.jerk_mps3, 0.0)
    }

    /// The deceleration for the sector that the vehicle approaches most above its speed limit.
    fn compensation(&self, velocity: &Vector2<f64>) -> Vector2<f64> {
        let gain = self.config.velocity_gain_per_s;
        let mut worst = (0.0, Vector2::zeros());
        for (sector, toward, reach_m) in self.sectors.known() {
            let closing_mps = velocity.dot(&toward).max(0.0);
            let needed = gain * (self.limit_mps(sector, reach_m, closing_mps) - closing_mps);
            if needed < worst.0 {
                worst = (needed, toward);
            }
        }
        let speed_mps = velocity.norm();
        if speed_mps > STANDS_MPS {
            let sector = self.sectors.sector_toward(velocity);
            let is_unseen =
                self.sectors.states[sector] == SectorState::Unknown && !self.allowed_unseen[sector];
            if is_unseen && -gain * speed_mps < worst.0 {
                worst = (-gain * speed_mps, velocity / speed_mps);
            }
        }
        worst.1 * worst.0
    }
}
