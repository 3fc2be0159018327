//! What watching the sensors for faults costs: `cargo run --release -p jink-obstacle-fusion --example health_cost`.
//!
//! Flies each set of sensors through a rendered forest and prints percentiles of the time that the map takes for a
//! frame; and the same of a mirrored sensor, with which a cause is searched most of the time.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../tests/it/flights/mod.rs"]
mod flights;

use flights::{FlightPath, SensorSample, fly, set};
use jink_shared_types::quantile::quantiles;
use jink_simulated_world::world::{World, WorldKind};

fn main() {
    let world = World::generate("forest".parse::<WorldKind>().unwrap(), 1).unwrap();
    let path = FlightPath::through(&world);
    println!("set        fault   p50 ms   p90 ms   p99 ms   max ms");
    for name in ["mid360", "os0", "os1", "vlp16", "d435", "sf45", "rplidar"] {
        for is_faulty in [false, true] {
            let flown = fly(&world, &set(name), &path, 16.0, |_, sample, _| {
                if is_faulty {
                    match sample {
                        SensorSample::Cloud(cloud) => {
                            let origin = cloud.origin;
                            let count = cloud.len as usize;
                            for point in &mut cloud.points[..count] {
                                point.right_m = 2.0 * origin.y_m as f32 - point.right_m;
                            }
                        }
                        SensorSample::Scan(scan) => {
                            scan.angle_first_rad = -scan.angle_first_rad;
                            scan.angle_step_rad = -scan.angle_step_rad;
                        }
                    }
                }
                1
            });
            let [p50, p90, p99, max] = quantiles(&flown.frame_ms, [0.5, 0.9, 0.99, 1.0]).unwrap_or_default();
            let fault = if is_faulty { "mirror" } else { "none" };
            println!("{name:10} {fault:6} {p50:8.2} {p90:8.2} {p99:8.2} {max:8.2}");
        }
    }
}
