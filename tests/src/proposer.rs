//! A planner that a user brings: it proposes ways to jink's planner, ten times a second.

use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, Wake};
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::proposal::{Proposal, ProposalAnswer, ProposalVerdict};
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{SampleHeader, topics};
use std::fmt;

/// Proposals a second.
const RATE_HZ: u32 = 10;
/// A goal that has moved less is the same (m).
const SAME_GOAL_M: f64 = 0.1;
/// A goal that is nearer is left to jink's planner (m).
const GOAL_NEAR_M: f64 = 10.0;
/// What lies nearer ahead is left out of a way (m).
const NEAR_M: f64 = 2.0;

/// How a way to the goal is found; nothing is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Plan {
    /// Nothing is proposed.
    Silent,
    /// Far to the side: east of everything by this coordinate (m), north along it, then to the goal. One way for one goal.
    Around {
        /// East coordinate (m).
        east_m: f64,
        /// Speed wished (m/s); 0 none.
        speed_mps: f64,
    },
    /// Straight to the goal, another way each time, through whatever stands there.
    Straight,
    /// To a place this far beside the vehicle's start (m), to stay there.
    Nowhere {
        /// East coordinate (m).
        east_m: f64,
    },
}

/// The service.
pub struct ProposerService {
    /// How it plans.
    pub plan: Plan,
    /// The answers so far.
    pub answers: Vec<ProposalAnswer>,
    proposal: Proposal,
    state: Input<VehicleState>,
    desired: Input<DesiredPath>,
    answer: Input<ProposalAnswer>,
    output: Output<Proposal>,
}

impl fmt::Debug for ProposerService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ProposerService({:?})", self.plan)
    }
}

impl Service for ProposerService {
    const PROGRAM: &'static str = "proposer";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            plan: Plan::Silent,
            answers: Vec::new(),
            proposal: Proposal::default(),
            state: ports.input(topics::VEHICLE_STATE)?.needed(),
            desired: ports.input(topics::DESIRED_PATH)?,
            answer: ports.input(topics::PROPOSAL_ANSWER)?,
            output: ports.output(topics::PROPOSAL)?,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        let known = self.answers.len();
        self.answer.each(|answer| self.answers.push(*answer.sample));
        let is_left = |answer: &ProposalAnswer| {
            answer.proposal_id == self.proposal.id && answer.verdict == ProposalVerdict::TooFar
        };
        if self.answers[known..].iter().any(is_left) {
            // The next one begins where the vehicle is.
            self.proposal.len = 0;
        }
        let (state, desired) = (self.state.latest(now).fresh(), self.desired.latest(now).fresh());
        if let (Some(state), Some(desired)) = (state, desired)
            && self.plan != Plan::Silent
            && desired.wants_planning()
        {
            let (from, goal) = (state.position, desired.points[1].position);
            let is_known = self.proposal.len > 0 && distance_m(self.proposal.goal, goal) < SAME_GOAL_M;
            if !is_known && distance_m(from, goal) < GOAL_NEAR_M {
                return Wake::at(now.next_beat(RATE_HZ));
            }
            if !is_known || self.plan == Plan::Straight {
                propose(self.plan, from, goal, &mut self.proposal);
            }
            self.output.send(SampleHeader::at(now), &self.proposal);
        }
        Wake::at(now.next_beat(RATE_HZ))
    }
}

fn distance_m(a: Point<LocalNed>, b: Point<LocalNed>) -> f64 {
    (a.vector() - b.vector()).norm()
}

/// Makes the proposal from `from` to `goal` in the place of the last one.
fn propose(plan: Plan, from: Point<LocalNed>, goal: Point<LocalNed>, proposal: &mut Proposal) {
    let at = |north_m: f64, east_m: f64| Point::new(north_m, east_m, goal.z_m);
    let mut waypoints = vec![from];
    let mut speed_wished_mps = 0.0;
    match plan {
        Plan::Silent => {}
        Plan::Straight => waypoints.push(goal),
        Plan::Nowhere { east_m } => waypoints.push(at(from.x_m, east_m)),
        Plan::Around { east_m, speed_mps } => {
            speed_wished_mps = speed_mps;
            let ahead = |point: &Point<LocalNed>| distance_m(*point, from) > NEAR_M;
            waypoints.extend(
                [at(from.x_m, east_m), at(goal.x_m, east_m)]
                    .into_iter()
                    .filter(ahead),
            );
            waypoints.push(goal);
        }
    }
    *proposal = Proposal {
        id: proposal.id + 1,
        goal,
        speed_mps: speed_wished_mps,
        len: waypoints.len() as u32,
        ..Proposal::default()
    };
    for (slot, waypoint) in proposal.waypoints.iter_mut().zip(waypoints) {
        *slot = waypoint;
    }
}
