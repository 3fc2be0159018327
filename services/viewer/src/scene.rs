//! What stands and moves in the picture, as JSON. Lengths in metres along north, east, down; ages in seconds.

use jink_shared_types::motion::{ApprovedTrajectory, Route, RouteMode, Trajectory, TrajectoryMode, Verdict};
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SectorRing};
use jink_shared_types::topics::{self, TopicRow};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Stamped, Timestamp};
use nalgebra::Vector3;
use serde_json::{Value, json};

/// Points that a trajectory is drawn with.
const LINE_POINTS: usize = 72;
/// Between two points of a stop it becomes slower by more than this (m/s).
const SLOWER_MPS: f64 = 0.0;

/// To millimetres, and milliseconds.
pub fn round(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

/// The newest of everything, however old.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// When it is shown.
    pub now: Timestamp,
    /// The vehicle.
    pub vehicle: Option<Stamped<'a, VehicleState>>,
    /// What is approved.
    pub approved: Option<Stamped<'a, ApprovedTrajectory>>,
    /// What is planned.
    pub route: Option<Stamped<'a, Route>>,
    /// The plan that is flown, or was made just now.
    pub plan: Option<&'a Route>,
    /// What the guard sees.
    pub ring: Option<Stamped<'a, SectorRing>>,
    /// What moves.
    pub moving: Option<Stamped<'a, MovingObstacles>>,
    /// Header of the map.
    pub map: Option<SampleHeader>,
    /// Header of the far map.
    pub far: Option<SampleHeader>,
    /// Header of the newest cloud.
    pub cloud: Option<SampleHeader>,
}

impl Scene<'_> {
    /// As JSON. What was never there is null; of all else its age is said, and whether it is stale.
    pub fn value(&self) -> Value {
        json!({
            "type": "scene",
            "now_s": round(self.now.seconds()),
            "vehicle": self.vehicle.map(|vehicle| self.aged(vehicle.header, &topics::VEHICLE_STATE.row, vehicle_value(&vehicle))),
            "approved": self.approved.map(|approved| {
                self.aged(approved.header, &topics::APPROVED.row, self.approved_value(&approved))
            }),
            "route": self.route.map(|route| self.aged(route.header, &topics::ROUTE.row, route_value(&route, self.plan))),
            "ring": self.ring.map(|ring| self.aged(ring.header, &topics::RING.row, self.ring_value(&ring))),
            "moving": self.moving.map(|moving| self.aged(moving.header, &topics::MOVING_OBSTACLES.row, moving_value(&moving))),
            "map": self.map.map(|header| self.aged(&header, &topics::LOCAL_MAP.row, json!({}))),
            "far": self.far.map(|header| self.aged(&header, &topics::FAR_MAP.row, json!({}))),
            "cloud": self.cloud.map(|header| self.aged(&header, &topics::RANGE_CLOUD.row, json!({}))),
        })
    }

    fn aged(&self, header: &SampleHeader, row: &TopicRow, mut value: Value) -> Value {
        value["age_s"] = json!(round(self.now.seconds_since(header.publish)));
        value["stale"] = json!(!header.is_fresh(self.now, row.deadline_ms));
        value
    }

    fn approved_value(&self, approved: &ApprovedTrajectory) -> Value {
        let trajectory = &approved.trajectory;
        let ends_in_s = trajectory.end().seconds_since(self.now);
        let flies = approved.verdict != Verdict::Hold
            && trajectory.mode != TrajectoryMode::Mirror
            && trajectory.is_sound();
        let (line, stop_from) = match flies && ends_in_s > 0.0 {
            true => line(trajectory, self.now),
            false => (Vec::new(), 0),
        };
        json!({
            "verdict": approved.verdict.get().to_string(),
            "reason": approved.reason.get().to_string(),
            "mode": trajectory.mode.get().to_string(),
            "limit_mps": round(trajectory.limits.speed_mps),
            "tube_m": round(trajectory.limits.tube_m),
            "free_way_m": finite(approved.free_way_m),
            "stopping_m": finite(approved.stopping_m),
            "ends_in_s": round(ends_in_s),
            "line": line,
            "stop_from": stop_from,
        })
    }

    fn ring_value(&self, ring: &SectorRing) -> Value {
        let sectors: Vec<Value> = ring
            .distance_m
            .iter()
            .zip(ring.range_max_m)
            .zip(ring.seen)
            .map(|((distance_m, range_m), seen)| match f64::from(*distance_m) {
                _ if !seen.is_set() => json!(null),
                distance_m if distance_m.is_nan() => json!(null),
                distance_m if distance_m.is_infinite() => json!([round(f64::from(range_m)), 0]),
                distance_m => json!([round(distance_m), 1]),
            })
            .collect();
        json!({
            "at": triple(ring.position.vector()),
            "yaw_rad": finite(ring.attitude.yaw_rad()),
            "width_rad": SECTOR_WIDTH_RAD,
            "band_m": round(f64::from(ring.band_half_m)),
            // Metres and whether something is there; null where nothing is known.
            "sectors": sectors,
        })
    }
}

/// The mode of a route, its goal, and guide and corridor of the plan.
fn route_value(route: &Route, plan: Option<&Route>) -> Value {
    let guide: Vec<Value> = plan
        .map_or(&[][..], Route::guide)
        .iter()
        .map(|point| triple(point.vector()))
        .collect();
    let corridor: Vec<Vec<[f64; 4]>> = plan
        .map_or(&[][..], Route::corridor)
        .iter()
        .map(|piece| {
            let planes = piece.planes().iter();
            let four = |[north, east, down]: [f64; 3], offset_m| [north, east, down, offset_m].map(round);
            planes.map(|plane| four(plane.normal, plane.offset_m)).collect()
        })
        .collect();
    let has_goal =
        route.mode != RouteMode::Mirror && route.goal.is_finite() && route.goal.vector() != Vector3::zeros();
    json!({
        "plan": plan.map(|plan| plan.id.to_string()),
        "mode": route.mode.get().to_string(),
        "goal": has_goal.then(|| triple(route.goal.vector())),
        "guide": guide,
        "corridor": corridor,
    })
}

fn vehicle_value(vehicle: &VehicleState) -> Value {
    let (velocity, turn) = (vehicle.velocity.vector(), vehicle.attitude);
    let attitude = [turn.w, turn.x, turn.y, turn.z].map(finite);
    json!({
        "at": triple(vehicle.position.vector()),
        "velocity": triple(velocity),
        "speed_mps": finite(velocity.norm()),
        "attitude": attitude,
        "yaw_rad": finite(turn.yaw_rad()),
        "home_down_m": finite(vehicle.home_down_m),
        "mode": vehicle.mode.get().to_string(),
        "armed": vehicle.armed.is_set(),
        "landed": vehicle.landed.is_set(),
        "valid": vehicle.position_valid.is_set(),
    })
}

fn moving_value(moving: &MovingObstacles) -> Value {
    let obstacles: Vec<Value> = moving
        .obstacles()
        .iter()
        .map(|obstacle| {
            json!({
                "at": triple(obstacle.position.vector()),
                "velocity": triple(obstacle.velocity.vector()),
                "radius_m": round(obstacle.radius_m),
                "half_height_m": round(obstacle.half_height_m),
            })
        })
        .collect();
    json!({ "obstacles": obstacles })
}

/// What is left of a trajectory as points with their speeds, and from which of them on it only brakes: the stop with which each ends.
fn line(trajectory: &Trajectory, now: Timestamp) -> (Vec<[f64; 4]>, usize) {
    let from = now.max(trajectory.start);
    let left_s = trajectory.end().seconds_since(from).max(0.0);
    let points: Vec<[f64; 4]> = (0..LINE_POINTS)
        .filter_map(|number| {
            let time = from.plus_seconds(left_s * number as f64 / (LINE_POINTS - 1) as f64);
            let state = trajectory.at(time)?;
            let at = state.position.vector();
            Some([at.x, at.y, at.z, state.velocity.vector().norm()].map(round))
        })
        .collect();
    // Backwards from the rest as long as it was faster before: where it was not, it was flown steadily.
    let mut stop_from = points.len().saturating_sub(1);
    while stop_from > 0 && points[stop_from - 1][3] > points[stop_from][3] + SLOWER_MPS {
        stop_from -= 1;
    }
    (points, stop_from)
}

fn triple(vector: Vector3<f64>) -> Value {
    json!([finite(vector.x), finite(vector.y), finite(vector.z)])
}

/// Rounded; null of what is no number.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then(|| round(value))
}
