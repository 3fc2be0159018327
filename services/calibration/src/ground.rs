//! A sensor against gravity: the ground under a vehicle that stands.

use super::points::Points;
use super::surfaces::{Surface, Surfaces, ordered};
use super::{CalibrateError, PLANES_MIN, SURE_DEG, SURE_M};
use nalgebra::{Matrix3, Point3, Unit, UnitQuaternion, Vector3};

/// The ground as the sensor has it is inclined by no more than this (deg): its mounting may be so wrong.
const INCLINED_DEG: f64 = 35.0;
/// Planes this near to a common one (m), and inclined by no more than this against it (cosine), belong to it.
const SAME_M: f64 = 0.08;
const SAME_COSINE: f64 = 0.9;
/// Planes of which a ground is proposed, at most.
const PROPOSED: usize = 300;
/// Extent of the ground in view in its narrower direction (m, one standard deviation) for an inclination.
const EXTENT_MIN_M: f64 = 0.4;
/// Planes err together within so much (m).
const TOGETHER_M: f64 = 1.0;

/// What the ground says of a sensor's mounting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Turns the sensor, about its own place, so that the ground is level (body).
    pub turn: UnitQuaternion<f64>,
    /// One standard deviation of the inclination about its worse axis (rad). What the ground is inclined itself, and the error of the
    /// autopilot's attitude, come on top.
    pub sigma_rad: f64,
    /// Height of the sensor above the ground (m).
    pub height_m: f64,
    /// One standard deviation of it (m).
    pub height_sigma_m: f64,
    /// Root mean square of the distances from the plane (m).
    pub residual_m: f64,
}

impl Ground {
    /// Whether roll, pitch and height are known to within what is promised.
    pub fn is_sure(&self) -> bool {
        self.sigma_rad <= SURE_DEG.to_radians() && self.height_sigma_m <= SURE_M
    }
}

/// Correction of a sensor that has measured `points`, with gravity along `down` (body, any length): roll, pitch and height. Its turn
/// about gravity and its place along the ground do not follow from the ground.
///
/// # Errors
/// [`CalibrateError`] where there is no ground in view, or too little of it.
pub fn against_gravity(points: &Points, down: &Vector3<f64>) -> Result<Ground, CalibrateError> {
    let surfaces = Surfaces::of(points);
    let (origin, up) = (points.origin(), -Unit::new_normalize(*down));
    if !up.iter().all(|part| part.is_finite()) {
        return Err(CalibrateError::NoGround);
    }
    let least = INCLINED_DEG.to_radians().cos();
    let is_ground =
        |surface: &&Surface| surface.normal.dot(&up) > least && up.dot(&(origin - surface.center)) > 0.0;
    let candidates: Vec<Surface> = surfaces.all.iter().filter(is_ground).copied().collect();
    let step = candidates.len().div_ceil(PROPOSED).max(1);
    let proposed = candidates.iter().step_by(step).map(|surface| {
        let plane = (surface.center, surface.normal);
        let weight: f64 = on_plane(&candidates, plane).map(|one| one.weight).sum();
        (weight, plane)
    });
    let best = proposed.max_by(|a, b| a.0.total_cmp(&b.0));
    let mut plane = best.ok_or(CalibrateError::NoGround)?.1;
    for _ in 0..3 {
        plane = fitted(on_plane(&candidates, plane), plane.1).0;
    }
    let ground: Vec<&Surface> = on_plane(&candidates, plane).collect();
    if ground.len() < PLANES_MIN {
        return Err(CalibrateError::NoGround);
    }
    let ((center, normal), [across_m2, narrow_m2]) = fitted(ground.iter().copied(), plane.1);
    if narrow_m2.sqrt() < EXTENT_MIN_M {
        return Err(CalibrateError::NarrowGround {
            extent_m: narrow_m2.sqrt(),
        });
    }
    let mut together: Vec<[i32; 3]> = ground
        .iter()
        .map(|one| super::points::cube_of(&one.center, TOGETHER_M))
        .collect();
    together.sort_unstable();
    together.dedup();
    let height_sigma_m = (across_m2 / together.len() as f64).sqrt();
    let turn = UnitQuaternion::rotation_between(&normal, &up).unwrap_or_default();
    // The mean of the ground is not under the sensor: what its inclination is uncertain by counts at that distance.
    let aside_m = (center - origin - normal * normal.dot(&(center - origin))).norm();
    let sigma_rad = height_sigma_m / narrow_m2.sqrt();
    Ok(Ground {
        turn,
        sigma_rad,
        height_m: normal.dot(&(origin - center)),
        height_sigma_m: height_sigma_m.hypot(aside_m * sigma_rad),
        residual_m: across_m2.sqrt(),
    })
}

fn on_plane(
    surfaces: &[Surface],
    (center, normal): (Point3<f64>, Vector3<f64>),
) -> impl Iterator<Item = &Surface> + Clone {
    surfaces.iter().filter(move |surface| {
        normal.dot(&(surface.center - center)).abs() < SAME_M && surface.normal.dot(&normal) > SAME_COSINE
    })
}

/// The plane through `surfaces` (normal to the side of `toward`), its variance across, and that along its narrower direction (m^2).
fn fitted<'a>(
    surfaces: impl Iterator<Item = &'a Surface> + Clone,
    toward: Vector3<f64>,
) -> ((Point3<f64>, Vector3<f64>), [f64; 2]) {
    let weights: f64 = surfaces.clone().map(|one| one.weight).sum();
    let weights = weights.max(f64::MIN_POSITIVE);
    let sum: Vector3<f64> = surfaces.clone().map(|one| one.center.coords * one.weight).sum();
    let center = Point3::from(sum / weights);
    let covariance: Matrix3<f64> = surfaces
        .map(|one| {
            let off = one.center - center;
            off * off.transpose() * one.weight
        })
        .sum::<Matrix3<f64>>()
        / weights;
    let ([across, narrow, _], [normal, ..]) = ordered(covariance);
    let normal = if normal.dot(&toward) < 0.0 {
        -normal
    } else {
        normal
    };
    ((center, normal), [across.max(0.0), narrow])
}
