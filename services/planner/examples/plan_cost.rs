//! What planning costs: `cargo run --release -p jink-planner --example plan_cost`.
//!
//! Synthetic forests (1 tree per 25 m2), everything within 10 m known. Prints the time to inflate a map for the highest
//! speed tier and the time of a whole cycle with a new map: p50, p99 and maximum over all forests.

use jink_planner::configuration_space::{Clearance, ConfigurationSpace};
use jink_planner::speed_tiers::speed_tiers;
use jink_planner::{Planner, PlannerInputs};
use jink_shared_types::frames::Point;
use jink_shared_types::map::{LocalMap, center_of, set};
use jink_shared_types::motion::{Route, RouteMode};
use jink_shared_types::params::ParamSet;
use jink_shared_types::vehicle::{DesiredPath, NavMode, VehicleState};
use jink_shared_types::{Coded, Flag, Reading, SampleHeader, Stamped, Timestamp};
use std::hint::black_box;
use std::time::Instant;

const FORESTS: u64 = 60;
const REPEATS: u64 = 5;

/// A forest from a hash of its seed: positions only need to be scattered, not random.
fn forest(seed: u64) -> Box<LocalMap> {
    let scatter = |i: u64, k: u64| {
        let mut z = (seed * 1000 + i * 10 + k).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((z ^ (z >> 27)) >> 11) as f64 / (1u64 << 53) as f64 * 26.0 - 13.0
    };
    let trees: Vec<(f64, f64)> = (0..27)
        .map(|i| (scatter(i, 0), scatter(i, 1)))
        .filter(|(x, y)| x.hypot(*y) > 2.0)
        .collect();
    let mut map = LocalMap::boxed();
    map.min_cell = [-64, -64, -44];
    map.ranges_fresh = Flag::YES;
    for x in -64..64 {
        for y in -64..64 {
            for z in -44..20 {
                let p = center_of([x, y, z]).vector();
                if p.xy().norm() < 10.0 {
                    set(&mut map.known, [x, y, z]);
                    if p.z > 0.0 || trees.iter().any(|(a, b)| (p.x - a).hypot(p.y - b) < 0.3) {
                        set(&mut map.occupied, [x, y, z]);
                    }
                }
            }
        }
    }
    map
}

fn print(what: &str, mut times_ms: Vec<f64>) {
    times_ms.sort_by(f64::total_cmp);
    let at = |q: f64| times_ms[((times_ms.len() - 1) as f64 * q) as usize];
    println!(
        "{what:<28} p50 {:6.2}  p99 {:6.2}  max {:6.2} ms",
        at(0.5),
        at(0.99),
        at(1.0)
    );
}

fn main() {
    let params = ParamSet::default();
    let state = VehicleState {
        position: Point::new(0.0, 0.0, -2.5),
        mode: Coded::new(NavMode::Mission),
        armed: Flag::YES,
        position_valid: Flag::YES,
        ..VehicleState::default()
    };
    let mut desired = DesiredPath {
        mode: Coded::new(NavMode::Mission),
        ..DesiredPath::default()
    };
    for point in &mut desired.points {
        point.position = Point::new(60.0, 0.0, -2.5);
    }
    let mut space = ConfigurationSpace::new(&speed_tiers(&params), Clearance::from_params(&params));
    let mut planner = Planner::new(&params, 1);
    let (mut inflate, mut cycle, mut planned) = (Vec::new(), Vec::new(), 0);
    for seed in 0..FORESTS {
        let map = forest(seed);
        for repeat in 0..REPEATS {
            let begin = Instant::now();
            space.load(black_box(&map));
            space.prepare(0);
            inflate.push(begin.elapsed().as_secs_f64() * 1e3);
            let now = Timestamp::from_seconds(10.0 + (seed * REPEATS + repeat) as f64);
            let header = SampleHeader::at(now);
            let mut route = Route::default();
            let inputs = PlannerInputs {
                far: Reading::Never,
                map: Reading::Fresh(Stamped {
                    sample: &map,
                    header: &header,
                }),
                state: Reading::Fresh(Stamped {
                    sample: &state,
                    header: &header,
                }),
                desired: Reading::Fresh(Stamped {
                    sample: &desired,
                    header: &header,
                }),
                approved: None,
                proposal: Reading::Never,
            };
            let begin = Instant::now();
            planner.step(now, &inputs, &mut route);
            cycle.push(begin.elapsed().as_secs_f64() * 1e3);
            planned += u32::from(route.mode.get() == RouteMode::Plan);
        }
    }
    println!("{planned} of {} cycles found a plan", FORESTS * REPEATS);
    print("inflate for one tier", inflate);
    print("whole cycle with new map", cycle);
}
