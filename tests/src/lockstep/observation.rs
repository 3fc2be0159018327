//! What a test observes of a flight: the truth, the newest samples, how autopilot and ground station see it.

use super::{LockStep, PROPOSER, VEHICLE};
use crate::proposer::ProposerService;
use jink_emulated_autopilot::Autopilot;
use jink_emulated_ground_station::{GroundStation, Outcome};
use jink_shared_types::coded::Wire as _;
use jink_shared_types::events;
use jink_shared_types::health::Health;
use jink_shared_types::link::{AssistState, LinkStatus};
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{ApprovedTrajectory, MotionState, Route, TrajectoryMode};
use jink_shared_types::prevention::PreventedDemand;
use jink_shared_types::truth::SimTruth;
use jink_simulator::service::VehicleService;

impl LockStep {
    /// Where the vehicle should be now, and how fast; `None` while the autopilot's own setpoints are mirrored.
    pub fn reference(&self) -> Option<MotionState> {
        let trajectory = &self.approved().trajectory;
        let flown = trajectory.mode != TrajectoryMode::Mirror && trajectory.is_sound();
        flown.then(|| trajectory.at(self.now()))?
    }

    /// The truth after the last step.
    pub fn truth(&self) -> &SimTruth {
        &self.truth
    }

    /// The autopilot; before its process runs, one that has just booted.
    pub fn autopilot(&self) -> &dyn Autopilot {
        let vehicle = self.board.service::<VehicleService>(VEHICLE);
        vehicle.map_or(self.boots.as_ref(), VehicleService::autopilot)
    }

    /// What is approved now.
    pub fn approved(&self) -> &ApprovedTrajectory {
        let newest = self.spectator.approved.newest();
        newest.map_or(&*self.nothing.approved, |approved| approved.sample)
    }

    /// The planner's newest answer.
    pub fn route(&self) -> &Route {
        let newest = self.spectator.route.newest();
        newest.map_or(&*self.nothing.route, |route| route.sample)
    }

    /// The planner that a user brings, while it runs.
    pub fn proposer(&self) -> Option<&ProposerService> {
        self.board.service(PROPOSER)
    }

    /// What of the pilot's wish was allowed last.
    pub fn prevented(&self) -> &PreventedDemand {
        let newest = self.spectator.prevented.newest();
        newest.map_or(&self.nothing.prevented, |prevented| prevented.sample)
    }

    /// The newest map.
    pub fn map(&self) -> &LocalMap {
        let newest = self.spectator.map.newest();
        newest.map_or(&*self.nothing.map, |map| map.sample)
    }

    /// Whether a pilot is assisted, as the gateway said last.
    pub fn assist(&self) -> AssistState {
        let newest = self.spectator.link.newest();
        newest.map_or(AssistState::UNKNOWN, |link| link.assist.get())
    }

    /// The gateway's figures, as it said last.
    pub fn link_status(&self) -> LinkStatus {
        let newest = self.spectator.link.newest();
        newest.map_or_else(LinkStatus::default, |link| *link.sample)
    }

    /// Health of the whole, as the supervisor judges.
    pub fn health(&self) -> Health {
        self.board.health()
    }

    /// How the ground station sees the flight; the outcome is set when it is over.
    pub fn outcome(&self) -> Option<&Outcome> {
        self.station.progress().outcome.as_ref()
    }

    /// The ground station.
    pub fn station(&self) -> &GroundStation {
        &self.station
    }

    /// How often an event was raised.
    pub fn count(&self, event: &events::Event) -> usize {
        self.events
            .iter()
            .filter(|(_, sample)| sample.id == event.id)
            .count()
    }
}
