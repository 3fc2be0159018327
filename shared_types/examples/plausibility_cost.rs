//! What it costs to judge samples that are full of good numbers: `cargo run --release -p jink-shared-types --example
//! plausibility_cost`.

use jink_shared_types::frames::Point;
use jink_shared_types::health::{Heartbeat, Name, PROCESSES, SystemStatus};
use jink_shared_types::layout::Layout;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{
    BezierPiece, CORRIDOR_POLYTOPES, HalfSpace, POLYTOPE_PLANES, Polytope, Route, RouteMode,
    TRAJECTORY_PIECES, Trajectory, TrajectoryMode,
};
use jink_shared_types::proposal::{PROPOSAL_WAYPOINTS, Proposal};
use jink_shared_types::quantile::quantiles;
use jink_shared_types::ranges::{CloudPoint, PointCloud, RangeScan, SCAN_BEAMS};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{Flag, Timestamp};
use std::hint::black_box;
use std::time::Instant;

const RUNS: usize = 10_000;

fn measure<T: Layout>(name: &str, sample: &T) {
    let us: Vec<f64> = (0..RUNS)
        .map(|_| {
            let begin = Instant::now();
            let plausible = black_box(sample).is_plausible();
            let took = begin.elapsed().as_nanos() as f64 * 1e-3;
            assert!(black_box(plausible), "{name} is not plausible");
            took
        })
        .collect();
    let [p50, p99, p999] = quantiles(&us, [0.5, 0.99, 0.999]).unwrap_or_default();
    println!(
        "{name:16} {:8} bytes   p50 {p50:7.3} us   p99 {p99:7.3} us   p99.9 {p999:7.3} us",
        size_of::<T>()
    );
}

fn route() -> Route {
    let mut route = Route {
        mode: RouteMode::Plan.into(),
        guide_len: CORRIDOR_POLYTOPES as u32 + 1,
        corridor_len: CORRIDOR_POLYTOPES as u32,
        ..Route::default()
    };
    let plane = HalfSpace {
        normal: [1.0, 0.0, 0.0],
        offset_m: 1.0,
    };
    route.corridor = [Polytope {
        len: POLYTOPE_PLANES as u32,
        planes: [plane; POLYTOPE_PLANES],
        ..Polytope::default()
    }; CORRIDOR_POLYTOPES];
    route
}

fn main() {
    let mut cloud = PointCloud::boxed();
    cloud.range_max_m = 40.0;
    while cloud.len < 20_000 && cloud.push(CloudPoint::default()) {}
    measure("PointCloud", &*cloud);
    measure("LocalMap", &*LocalMap::boxed());
    let scan = RangeScan {
        beams: SCAN_BEAMS as u32,
        range_max_m: 40.0,
        ..RangeScan::default()
    };
    measure("RangeScan", &scan);
    let state = VehicleState {
        position_valid: Flag::YES,
        ..VehicleState::default()
    };
    measure("VehicleState", &state);
    let ring = SectorRing {
        position: Point::ZERO,
        ..SectorRing::default()
    };
    measure("SectorRing", &ring);
    measure("DesiredPath", &DesiredPath::default());
    measure("Route", &route());
    let proposal = Proposal {
        len: PROPOSAL_WAYPOINTS as u32,
        ..Proposal::default()
    };
    measure("Proposal", &proposal);
    let piece = BezierPiece {
        duration_s: 1.0,
        ..BezierPiece::default()
    };
    let trajectory = Trajectory {
        mode: TrajectoryMode::Plan.into(),
        start: Timestamp::from_ns(1),
        len: TRAJECTORY_PIECES as u32,
        pieces: [piece; TRAJECTORY_PIECES],
        ..Trajectory::default()
    };
    measure("Trajectory", &trajectory);
    let mut status = SystemStatus {
        len: PROCESSES as u32,
        ..SystemStatus::default()
    };
    for process in &mut status.processes {
        process.heartbeat = Heartbeat {
            name: Name::new("obstacle_fusion"),
            ..Heartbeat::default()
        };
    }
    measure("SystemStatus", &status);
}
