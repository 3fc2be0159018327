//! The guard as a process: woken by ranges and trajectories, and 30 times a second at least; it answers each
//! trajectory, and each demand of a pilot.

use crate::guard::{Guard, GuardConfig, GuardInputs};
use crate::prevention::expected::add_expected;
use crate::prevention::{PilotGuard, PreventionConfig};
use crate::ring::Ring;
use jink_runtime::{
    Checks, Cycle, Input, Output, Ports, RangeInputs, RangeSample, Service, StartError, Wake,
};
use jink_shared_types::motion::{ApprovedTrajectory, Trajectory};
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::params::ParamSet;
use jink_shared_types::prevention::{PilotDemand, PreventedDemand};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use std::fmt;

/// The active trajectory is checked, and published again, at this rate.
const RATE_HZ: u32 = 30;
/// The pilot's demand is answered at this rate.
const PILOT_RATE_HZ: u32 = 50;
/// The ring is published at this rate.
const RING_RATE_HZ: u32 = 15;

/// The service: see [`crate`].
pub struct GuardService {
    guard: Guard,
    pilot_guard: PilotGuard,
    ring: Ring,
    ranges: RangeInputs,
    state: Input<VehicleState>,
    moving: Input<MovingObstacles>,
    trajectory: Input<Trajectory>,
    demand: Input<PilotDemand>,
    approved: Output<ApprovedTrajectory>,
    prevented: Output<PreventedDemand>,
    sectors: Output<SectorRing>,
    answer: ApprovedTrajectory,
    ring_sample: SectorRing,
    answered: Timestamp,
    header: SampleHeader,
    due: Timestamp,
    ring_due: Timestamp,
    pilot_due: Timestamp,
}

impl fmt::Debug for GuardService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("GuardService")
    }
}

impl Service for GuardService {
    const PROGRAM: &'static str = "collision_guard";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let params = ports.config().params.clone();
        Ok(Self {
            guard: Guard::new(GuardConfig::from_params(&params), ports.setup().generation),
            pilot_guard: PilotGuard::new(PreventionConfig::from_params(&params)),
            ring: Ring::from_params(&params),
            ranges: RangeInputs::open(ports)?,
            state: ports.input(topics::VEHICLE_STATE)?.needed(),
            moving: ports.input(topics::MOVING_OBSTACLES)?,
            trajectory: ports.trigger(topics::TRAJECTORY)?,
            // Collision prevention answers a demand that is not a number, too: no motion, at once.
            demand: ports.input(topics::PILOT_DEMAND)?.with_checks(Checks::Stamps),
            approved: ports.output(topics::APPROVED)?,
            prevented: ports.output(topics::PREVENTED)?,
            sectors: ports.output(topics::RING)?,
            answer: ApprovedTrajectory::default(),
            ring_sample: SectorRing::default(),
            answered: Timestamp::NEVER,
            header: SampleHeader::default(),
            due: Timestamp::NEVER,
            ring_due: Timestamp::NEVER,
            pilot_due: Timestamp::NEVER,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        self.take_ranges();
        let newest = self.trajectory.latest(now).fresh();
        let new = newest.filter(|trajectory| trajectory.header.publish != self.answered);
        if new.is_some() || now >= self.due {
            if let Some(new) = &new {
                self.answered = new.header.publish;
                self.header = *new.header;
            }
            let inputs = GuardInputs {
                trajectory: new.map(|trajectory| trajectory.sample),
                state: self.state.latest(now),
                ring: &self.ring,
                moving: self.moving.latest(now),
            };
            let step_events = self.guard.step(now, &inputs, &mut self.answer);
            let answer = &self.answer;
            self.approved
                .write(self.header.derived(Stage::Guard, now), |slot| {
                    slot.clone_from(answer);
                });
            for event in step_events.events() {
                cycle.events.publish(now, event);
            }
            self.due = now.next_beat(RATE_HZ);
        }
        if now >= self.ring_due {
            self.ring_due = now.next_beat(RING_RATE_HZ);
            self.ring.ring(now, &mut self.ring_sample);
            self.sectors.send(SampleHeader::at(now), &self.ring_sample);
        }
        let is_steered = self.answer_pilot(cycle);
        let due = self.due.min(self.ring_due);
        Wake::at(if is_steered { due.min(self.pilot_due) } else { due })
    }

    /// The ring keeps what it has seen: its radius and its band need a restart.
    fn on_params_changed(&mut self, params: &ParamSet) {
        self.guard.configure(GuardConfig::from_params(params));
        self.pilot_guard.configure(PreventionConfig::from_params(params));
    }
}

impl GuardService {
    /// Answers the pilot's demand; whether there is one.
    fn answer_pilot(&mut self, cycle: &mut Cycle<'_>) -> bool {
        let now = cycle.now;
        let demand = self.demand.latest(now);
        if !demand.is_fresh() {
            return false;
        }
        if now < self.pilot_due {
            return true;
        }
        self.pilot_due = now.next_beat(PILOT_RATE_HZ);
        self.ring.ring(now, &mut self.ring_sample);
        let state = self.state.latest(now);
        if let Some(moving) = self.moving.latest(now).fresh() {
            let speed_mps = state
                .fresh()
                .map_or(0.0, |state| state.velocity.vector().xy().norm());
            let age_s = now.seconds_since(moving.header.capture).max(0.0);
            let config = self.pilot_guard.config();
            add_expected(
                &mut self.ring_sample,
                moving.obstacles(),
                age_s,
                speed_mps,
                config,
            );
        }
        if let Some((prevented, step_events)) = self.pilot_guard.step(now, demand, state, &self.ring_sample) {
            self.prevented.send(SampleHeader::at(now), &prevented);
            for event in step_events.events() {
                cycle.events.publish(now, event);
            }
        }
        true
    }

    fn take_ranges(&mut self) {
        let Self {
            ring, state, ranges, ..
        } = self;
        state.each(|state| {
            if let Err(refused) = ring.vehicle(state.sample, state.header) {
                tracing::debug!("{refused}");
            }
        });
        ranges.each(|number, sample| {
            let taken = match sample {
                RangeSample::Cloud(cloud) => ring.cloud(number, cloud.sample, cloud.header),
                RangeSample::Scan(scan) => ring.scan(number, scan.sample, scan.header),
            };
            if let Err(refused) = taken {
                tracing::debug!("{refused}");
            }
        });
    }
}
