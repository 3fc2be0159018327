//! The planner as a process: woken by maps, and 30 times a second at least.

use crate::{Planner, PlannerInputs};
use jink_runtime::{Checks, Cycle, Input, Output, Ports, Service, StartError, Wake};
use jink_shared_types::events::{EventSample, TRACKING_LEARNED};
use jink_shared_types::far_map::FarMap;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{ApprovedTrajectory, Route};
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::param_messages::{ParameterChange, table_of};
use jink_shared_types::params::{self, ParamSet};
use jink_shared_types::proposal::{Proposal, ProposalAnswer};
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{Reserved, SampleHeader, Stage, Timestamp, topics};
use std::fmt;

/// Routes are published at this rate even when nothing is new, so that a silent planner can be distinguished from one
/// that has nothing to change.
const RATE_HZ: u32 = 30;

/// The service: see [`crate`].
pub struct PlannerService {
    planner: Planner,
    route: Route,
    map: Input<LocalMap>,
    far: Input<FarMap>,
    moving: Input<MovingObstacles>,
    state: Input<VehicleState>,
    desired: Input<DesiredPath>,
    approved: Input<ApprovedTrajectory>,
    proposal: Input<Proposal>,
    answer: Output<ProposalAnswer>,
    output: Output<Route>,
    changes: Output<ParameterChange>,
    params: ParamSet,
}

impl fmt::Debug for PlannerService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("PlannerService")
    }
}

impl Service for PlannerService {
    const PROGRAM: &'static str = "planner";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let sensors = &ports.config().sensors;
        let planner =
            Planner::new(&ports.config().params, ports.setup().generation).with_sensors(sensors.len() as u16);
        Ok(Self {
            planner: sensors.iter().fold(planner, |planner, sensor| {
                planner.with_nominal_view(&sensor.nominal_view)
            }),
            route: Route::default(),
            map: ports.trigger(topics::LOCAL_MAP)?.needed(),
            far: ports.input(topics::FAR_MAP)?,
            moving: ports.input(topics::MOVING_OBSTACLES)?,
            state: ports.input(topics::VEHICLE_STATE)?.needed(),
            desired: ports.input(topics::DESIRED_PATH)?,
            approved: ports.input(topics::APPROVED)?,
            // A restarted program may count from the beginning, and implausible proposals are answered.
            proposal: ports
                .input(topics::PROPOSAL)?
                .of_all_producers()
                .with_checks(Checks::Stamps),
            answer: ports.output(topics::PROPOSAL_ANSWER)?,
            output: ports.output(topics::ROUTE)?,
            changes: ports.output(topics::PARAMETER_CHANGE)?,
            params: ports.config().params.clone(),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        // Fetched first: the approved trajectory counts however old it is, because it outlives its producer.
        let is_guard_silent = !self.approved.latest(now).is_fresh();
        let map = self.map.latest(now);
        // A route made without a map has the header of no measurement.
        let header = map.fresh().map_or_else(SampleHeader::default, |map| *map.header);
        let inputs = PlannerInputs {
            map,
            far: self.far.latest(now),
            moving: self.moving.latest(now),
            state: self.state.latest(now),
            desired: self.desired.latest(now),
            is_guard_silent,
            approved: self.approved.newest().map(|approved| approved.sample),
            proposal: self.proposal.latest(now),
        };
        self.planner.step(now, &inputs, &mut self.route);
        let route = &self.route;
        self.output
            .write(header.derived(Stage::Planner, now), |slot| slot.clone_from(route));
        if let Some(answer) = self.planner.proposal_answer() {
            self.answer.send(header.derived(Stage::Planner, now), answer);
        }
        for event in self.planner.events() {
            cycle.events.publish(now, event);
        }
        if let Some(learned) = self.planner.learned(now) {
            self.keep(now, &learned);
            let tracking = self
                .planner
                .tracking()
                .looser(learned.cut_s2, learned.overshoot_s2);
            tracing::info!(
                "follows less closely than was known: cuts corners {:.3} s2, overshoots {:.3} s2",
                tracking.cut_s2,
                tracking.overshoot_s2
            );
            let event = EventSample::new(
                &TRACKING_LEARNED,
                "",
                [100.0 * tracking.cut_s2, 100.0 * tracking.overshoot_s2],
            );
            cycle.events.publish(now, &event);
        }
        Wake::at(now.next_beat(RATE_HZ))
    }

    fn on_params_changed(&mut self, params: &ParamSet) {
        self.planner.on_params_changed(params);
    }
}

impl PlannerService {
    /// Asks the parameter server to keep the figures of `learned` that are not zero; they come back as a change of parameters.
    fn keep(&mut self, now: Timestamp, learned: &Tracking) {
        let values = [
            (&params::OA_TRK_CUT, learned.cut_s2),
            (&params::OA_TRK_OVER, learned.overshoot_s2),
        ];
        let kept = values.into_iter().filter(|(_, value)| *value > 0.0);
        for (id, (param, value)) in (now.ns..).zip(kept) {
            if let Some(row) = self.params.number_of(param.name) {
                let change = ParameterChange {
                    table: table_of(&self.params),
                    id: id.max(1),
                    value,
                    row: row as u32,
                    reserved: Reserved::ZERO,
                };
                self.changes.send(SampleHeader::at(now), &change);
            }
        }
    }
}
