//! The smallest planner that gets there: straight to the goal, and where jink refuses that, past the place to blame, first on one
//! side, then on the other, each time farther. It looks at no map: jink says what stands in the way.

use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, Wake};
use jink_shared_types::map::LocalMap;
use jink_shared_types::proposal::{Proposal, ProposalAnswer};
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{Point, SampleHeader, topics};

struct Minimal {
    map: Input<LocalMap>,
    state: Input<VehicleState>,
    desired: Input<DesiredPath>,
    answer: Input<ProposalAnswer>,
    output: Output<Proposal>,
    proposal: Proposal,
    tries: i32,
}

impl Service for Minimal {
    const PROGRAM: &'static str = "minimal_planner";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            map: ports.trigger(topics::LOCAL_MAP)?.needed(),
            state: ports.input(topics::VEHICLE_STATE)?,
            desired: ports.input(topics::DESIRED_PATH)?,
            answer: ports.input(topics::PROPOSAL_ANSWER)?,
            output: ports.output(topics::PROPOSAL)?,
            proposal: Proposal::default(),
            tries: 0,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let Self {
            map,
            state,
            desired,
            answer,
            output,
            proposal,
            tries,
        } = self;
        let map = map.latest(cycle.now).fresh();
        let state = state.latest(cycle.now).fresh();
        let desired = desired
            .latest(cycle.now)
            .fresh()
            .filter(|desired| desired.wants_planning());
        let (Some(map), Some(state), Some(desired)) = (map, state, desired) else {
            return Wake::on_data();
        };
        let answer = answer.latest(cycle.now).fresh();
        let refused =
            answer.filter(|answer| answer.proposal_id == proposal.id && !answer.verdict.get().is_flown());
        let (here, goal) = (state.position, desired.points[1].position);
        if refused.is_some() || proposal.goal != goal {
            *tries = if proposal.goal == goal { *tries + 1 } else { 0 };
            // 0, -1, 1, -2, 2, ... times 0.8 m, four cells of the map, and anew after 4 m.
            let aside_m = 0.8 * f64::from((*tries % 11 + 1) / 2 * (1 - *tries % 11 % 2 * 2));
            let (north_m, east_m) = (goal.x_m - here.x_m, goal.y_m - here.y_m);
            let far_m = north_m.hypot(east_m).max(0.1);
            let blame = refused
                .map(|answer| answer.place)
                .filter(|place| place.is_finite());
            let place = blame
                .unwrap_or_else(|| Point::new(here.x_m + north_m / 2.0, here.y_m + east_m / 2.0, goal.z_m));
            let past = Point::new(
                place.x_m - east_m / far_m * aside_m,
                place.y_m + north_m / far_m * aside_m,
                goal.z_m,
            );
            *proposal = Proposal {
                id: cycle.now.ns,
                goal,
                len: 3,
                ..Proposal::default()
            };
            proposal.waypoints[..3].copy_from_slice(&[here, past, goal]);
        }
        output.send(
            SampleHeader {
                capture: map.header.capture,
                ..SampleHeader::default()
            },
            proposal,
        );
        Wake::on_data()
    }
}

fn main() -> std::process::ExitCode {
    jink_runtime::run::<Minimal>()
}
