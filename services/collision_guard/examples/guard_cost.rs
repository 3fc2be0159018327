//! What one step of the guard costs: a flight at 3 m/s along a line of cylinders, with a new trajectory in every step
//! and without.
//!
//! `cargo run --release -p jink-collision-guard --example guard_cost`

#[path = "../tests/it/common/mod.rs"]
mod common;

use common::{Lidar, World, fly, guard, on, random, ring, step, straight, time};
use jink_shared_types::motion::Verdict;
use jink_shared_types::quantile::quantiles;
use std::time::Instant;

fn main() {
    let world = World(
        (0..40)
            .map(|i| [1.0 + f64::from(i), if i % 2 == 0 { 2.0 } else { -2.0 }, 0.3])
            .collect(),
    );
    println!(
        "{:<44} {:>9} {:>9} {:>9} {:>9}",
        "what", "min us", "p50 us", "p99 us", "max us"
    );
    for sensors in [1, 4] {
        for (replan, name) in [(false, "watching"), (true, "judging a new trajectory")] {
            let us = costs(&world, sensors, replan);
            let [min, p50, p99, max] = quantiles(&us, [0.0, 0.5, 0.99, 1.0]).unwrap_or_default();
            println!(
                "{:<44} {min:>9.1} {p50:>9.1} {p99:>9.1} {max:>9.1}",
                format!("{name}, {sensors} sensors")
            );
        }
    }
}

fn costs(world: &World, sensors: usize, replan: bool) -> Vec<f64> {
    let lidar = Lidar {
        sigma_m: 0.03,
        ..Lidar::default()
    };
    let mut way = straight(7, 10.0, 3.0, 2.0, 40.0);
    let (mut guard, mut ring) = (guard(), ring());
    let mut us = Vec::new();
    for i in 0..300_u32 {
        let t = 10.0 + 0.05 * f64::from(i);
        let place = |t: f64| on(&way, t);
        fly(&mut ring, &place, t - 0.2, t);
        for sensor in 0..sensors {
            let seed = u64::from(i) * 8 + sensor as u64;
            let (cloud, header) = lidar.sweep(world, &place, t, &mut random(seed));
            let taken = ring.cloud(sensor, &cloud, &header);
            assert!(taken.is_ok(), "{taken:?}");
        }
        let mut next = way;
        if i > 0 {
            (next.id, next.base_id, next.splice) = (way.id + 1, way.id, time(t + 0.1));
        }
        let candidate = (i == 0 || replan).then_some(&next);
        let here = place(t);
        let begin = Instant::now();
        let (out, _) = step(&mut guard, t, candidate, &ring, here);
        us.push(begin.elapsed().as_secs_f64() * 1e6);
        assert_eq!(out.verdict.get(), Verdict::Passed, "{:?} at {t}", out.reason);
        way = out.trajectory;
    }
    us
}
