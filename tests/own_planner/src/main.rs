//! A planner as somebody else would write it: it proposes a way around the trees to the planner of jink, which certifies it
//! before it is flown.
//!
//! Its way leads from the vehicle to the goal over two places, each of them beside the straight line as far as need be. It is
//! kept as long as nothing has come to stand on it.

mod slice;

use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, Wake};
use jink_shared_types::map::LocalMap;
use jink_shared_types::proposal::Proposal;
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{LocalNed, Point, SampleHeader, topics};
use slice::Slice;

/// The two places are so far ahead at most, the second twice as far (m): with a third of the way left each.
const AHEAD_M: f64 = 4.0;
/// How far beside the straight line they may lie: steps to either side, and their length (m).
const ASIDE: (i32, f64) = (8, 0.75);

struct OwnPlanner {
    map: Input<LocalMap>,
    state: Input<VehicleState>,
    desired: Input<DesiredPath>,
    output: Output<Proposal>,
    proposal: Proposal,
}

impl Service for OwnPlanner {
    const PROGRAM: &'static str = "own_planner";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            map: ports.trigger(topics::LOCAL_MAP)?.needed(),
            state: ports.input(topics::VEHICLE_STATE)?.needed(),
            desired: ports.input(topics::DESIRED_PATH)?,
            output: ports.output(topics::PROPOSAL)?,
            proposal: Proposal::default(),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        let (map, state) = (self.map.latest(now).fresh(), self.state.latest(now).fresh());
        let desired = self.desired.latest(now).fresh();
        let (Some(map), Some(state), Some(desired)) = (map, state, desired) else {
            return Wake::on_data();
        };
        if !desired.wants_planning() {
            return Wake::on_data();
        }
        let (here, goal) = (state.position, desired.points[1].position);
        let slice = Slice::of(&map, here.z_m);
        let is_kept = self.proposal.goal == goal && slice.is_clear(self.proposal.waypoints(), here, goal);
        if let Some(way) = way(&slice, here, goal).filter(|_| !is_kept) {
            self.proposal.id = now.ns;
            self.proposal.goal = goal;
            self.proposal.len = way.len() as u32;
            self.proposal.waypoints[..way.len()].copy_from_slice(&way);
        } else if !is_kept {
            // Nothing to propose: the planner of jink finds a way of its own.
            return Wake::on_data();
        }
        let header = SampleHeader {
            capture: map.header.capture,
            ..SampleHeader::default()
        };
        self.output.send(header, &self.proposal);
        Wake::on_data()
    }
}

/// The shortest way that is clear.
fn way(slice: &Slice, here: Point<LocalNed>, goal: Point<LocalNed>) -> Option<[Point<LocalNed>; 4]> {
    let (north_m, east_m) = (goal.x_m - here.x_m, goal.y_m - here.y_m);
    let far_m = north_m.hypot(east_m).max(0.1);
    let (north, east) = (north_m / far_m, east_m / far_m);
    let ahead_m = AHEAD_M.min(far_m / 3.0);
    let place = |ahead_m: f64, aside: i32| {
        let aside_m = f64::from(aside) * ASIDE.1;
        Point::new(
            here.x_m + north * ahead_m - east * aside_m,
            here.y_m + east * ahead_m + north * aside_m,
            goal.z_m,
        )
    };
    let all = (-ASIDE.0..=ASIDE.0).flat_map(|first| (-ASIDE.0..=ASIDE.0).map(move |second| (first, second)));
    let ways = all.map(|(first, second)| [here, place(ahead_m, first), place(2.0 * ahead_m, second), goal]);
    let clear = ways.filter(|way| slice.is_clear(way, here, goal));
    let length_m = |way: &[Point<LocalNed>; 4]| -> f64 {
        let legs = way.windows(2);
        legs.map(|leg| (leg[1].vector() - leg[0].vector()).norm()).sum()
    };
    clear.min_by(|one, other| length_m(one).total_cmp(&length_m(other)))
}

fn main() -> std::process::ExitCode {
    jink_runtime::run::<OwnPlanner>()
}
