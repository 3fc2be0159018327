//! The rays of a cloud in the local frame, each from where the sensor was when it was measured: what OctoMap is given, and what both
//! maps are compared by.

use crate::clouds::{Series, Shot};
use jink_shared_types::params::{OA_CARVE_RNG, OA_VEH_RADIUS, ParamSet};
use jink_shared_types::ranges::RayKind;
use nalgebra::Vector3;

/// One ray, local NED (m).
pub struct LocalRay {
    /// Where the sensor was.
    pub origin_m: Vector3<f64>,
    /// Where the ray ended.
    pub end_m: Vector3<f64>,
    /// Whether it ended at an obstacle.
    pub is_hit: bool,
    /// Distance of both (m).
    pub range_m: f64,
}

/// How far rays of `shot` are looked along (m): the carve range, or the sensor's range if that is shorter.
pub fn reach_m(shot: &Shot, params: &ParamSet) -> f64 {
    params.get(&OA_CARVE_RNG).min(f64::from(shot.cloud.range_max_m))
}

/// Position of the vehicle when `shot` was complete (local NED, m).
pub fn vehicle_m(series: &Series, shot: &Shot) -> Vector3<f64> {
    let pose = series.track.at(shot.header.capture);
    pose.map_or_else(Vector3::zeros, |pose| pose.position.vector())
}

/// The one origin that OctoMap takes for a cloud: the sensor's place in the middle of its time (local NED, m).
pub fn middle_m(series: &Series, shot: &Shot) -> Vector3<f64> {
    let half_s = 0.5 * shot.header.capture.seconds_since(shot.cloud.first_point);
    let pose = series.track.at(shot.cloud.first_point.plus_seconds(half_s));
    pose.map_or_else(Vector3::zeros, |pose| pose.to_local(shot.cloud.origin).vector())
}

/// Every ray that says something, but those that end at the vehicle itself.
pub fn local_rays<'a>(
    series: &'a Series,
    shot: &'a Shot,
    params: &ParamSet,
) -> impl Iterator<Item = LocalRay> + 'a {
    let radius_m = params.get(&OA_VEH_RADIUS);
    let cursor = series.track.cursor();
    let points = shot.cloud.points().iter();
    points
        .scan(cursor, move |cursor, point| {
            let Some(cursor) = cursor else { return None };
            let body_m = Vector3::new(point.forward_m, point.right_m, point.down_m).cast::<f64>();
            let is_hit = point.kind.get() == RayKind::Hit;
            let says_something =
                point.kind.get() != RayKind::Unknown && !(is_hit && body_m.norm() < radius_m);
            let time = shot
                .cloud
                .first_point
                .plus_seconds(f64::from(point.offset_10us) * 1e-5);
            let ray = says_something.then(|| {
                let pose = cursor.at(time);
                LocalRay {
                    origin_m: pose.to_local(shot.cloud.origin).vector(),
                    end_m: pose.position.vector() + pose.attitude * body_m,
                    is_hit,
                    range_m: (body_m - shot.cloud.origin.vector()).norm(),
                }
            });
            Some(ray)
        })
        .flatten()
}
