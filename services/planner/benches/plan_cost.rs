//! What planning costs: `cargo bench -p jink-planner --bench plan_cost`.
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
use jink_shared_types::quantile::quantiles;
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::{DesiredPath, NavMode, VehicleState};
use jink_shared_types::{Coded, Flag, Reading, SampleHeader, Stamped, Timestamp};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;
use std::hint::black_box;
use std::time::Instant;

const FORESTS: u64 = 60;
const REPEATS: u64 = 5;

/// The forest of this seed.
fn forest(seed: u64) -> Box<LocalMap> {
    let mut random = SplitMix64::seed_from_u64(seed);
    let trees: Vec<(f64, f64)> = (0..27)
        .map(|_| {
            (
                random.random_range(-13.0..13.0_f64),
                random.random_range(-13.0..13.0_f64),
            )
        })
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

fn print(what: &str, times_ms: &[f64]) {
    let [p50, p99, max] = quantiles(times_ms, [0.5, 0.99, 1.0]).unwrap_or_default();
    println!("{what:<28} p50 {p50:6.2}  p99 {p99:6.2}  max {max:6.2} ms");
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
    let mut space = ConfigurationSpace::new(
        &speed_tiers(&params, &Tracking::PX4_TRAJECTORY),
        Clearance::from_params(&params),
    );
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
                moving: Reading::Never,
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
                is_guard_silent: false,
                proposal: Reading::Never,
            };
            let begin = Instant::now();
            planner.step(now, &inputs, &mut route);
            cycle.push(begin.elapsed().as_secs_f64() * 1e3);
            planned += u32::from(route.mode.get() == RouteMode::Plan);
        }
    }
    println!("{planned} of {} cycles found a plan", FORESTS * REPEATS);
    print("inflate for one tier", &inflate);
    print("whole cycle with new map", &cycle);
}
