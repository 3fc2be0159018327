//! Planes of one sensor laid on those of another.

use super::certainty::{self, Certainty, Pair};
use super::surfaces::{Surface, Surfaces};
use super::{CalibrateError, Correction, OVERLAP_MIN};
use nalgebra::{Isometry3, Matrix6, Point3, SymmetricEigen, Translation3, UnitQuaternion, Vector3, Vector6};

/// Mountings up to this far from the configured one are found (deg, about any axis).
pub const REACH_DEG: f64 = 20.0;
/// ... and no farther than this (m): nobody measures a mounting half a metre wrong.
pub const REACH_M: f64 = 0.5;
/// What registration makes of a mounting within [`REACH_DEG`] is right up to this far (deg); beyond it the scene repeats itself.
const BELIEVED_DEG: f64 = 25.0;
/// Starts are this far apart about each axis (deg): each finds what is half as far away, and some more.
const START_DEG: f64 = 13.0;
/// Planes that the starts are compared with, at most.
const COARSE_PLANES: usize = 500;
/// Planes that an estimate is made of, at most.
const FINE_PLANES: usize = 4_000;
/// Steps of a start and of the last pass: planes no farther than this (m) and with normals at most this cosine apart count as one,
/// for so many iterations.
const COARSE: [(f64, f64, usize); 3] = [(2.5, 0.7, 6), (1.2, 0.8, 6), (0.6, 0.9, 6)];
const FINE: [(f64, f64, usize); 2] = [(0.6, 0.9, 8), (0.4, 0.94, 14)];
/// Planes farther than this from the plane that they are laid on (m) are not the same surface.
const SAME_M: f64 = 0.1;
/// Directions with less information per plane than this are not moved along.
const STEP_MIN: f64 = 2e-3;
/// Two results this far apart are two (deg, m), and equally good if the one explains this share of the other.
const APART: (f64, f64) = (2.0, 0.15);
const EQUAL: f64 = 0.93;

/// The correction that lays `source`, of a sensor at `origin`, on `target`.
pub(super) fn register(
    target: &Surfaces,
    source: &Surfaces,
    origin: Point3<f64>,
) -> Result<Correction, CalibrateError> {
    let coarse = thinned(source, COARSE_PLANES);
    let fine = thinned(source, FINE_PLANES);
    let mut found: Vec<(f64, Isometry3<f64>)> = starts(&origin)
        .map(|start| {
            let pose = iterate(target, &coarse, start, &COARSE);
            (score(target, &coarse, &pose), pose)
        })
        .collect();
    let Some(configured) = found.first().copied() else {
        return Err(CalibrateError::NoOverlap { share: 0.0 });
    };
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    // Where others are hardly better, what comes of the configured mounting counts.
    let is_as_good = found.first().is_none_or(|best| configured.0 > EQUAL * best.0);
    let (_, start) = if is_as_good { configured } else { found[0] };
    let pose = iterate(target, &fine, start, &FINE);
    let best = score(target, &fine, &pose);
    let (deg, m) = (
        pose.rotation.angle().to_degrees(),
        (pose * origin - origin).norm(),
    );
    if deg > BELIEVED_DEG || m > REACH_M {
        return Err(CalibrateError::OutOfReach { deg, m });
    }
    let pairs = pairs(target, &fine, &pose, FINE[1].0, FINE[1].1);
    let pairs: Vec<Pair> = pairs
        .into_iter()
        .filter(|pair| pair.residual_m.abs() < SAME_M)
        .collect();
    let overlap = pairs.len() as f64 / fine.len() as f64;
    if overlap < OVERLAP_MIN || pairs.len() < super::PLANES_MIN {
        return Err(CalibrateError::NoOverlap { share: overlap });
    }
    let certainty = certainty::of(&pairs, pose * origin);
    rivals(target, &fine, &found, &pose, best, &certainty)?;
    let sum: f64 = pairs.iter().map(|pair| pair.residual_m * pair.residual_m).sum();
    Ok(Correction {
        body_t_configured: pose,
        certainty,
        residual_m: (sum / pairs.len() as f64).sqrt(),
        overlap,
    })
}

/// Refuses a result beside which another one, far from it, is as good. Where a direction is not observable, every place along it is
/// as good as any: that is said otherwise.
fn rivals(
    target: &Surfaces,
    fine: &[Surface],
    found: &[(f64, Isometry3<f64>)],
    pose: &Isometry3<f64>,
    best: f64,
    certainty: &Certainty,
) -> Result<(), CalibrateError> {
    if !certainty.unobservable.is_empty() {
        return Ok(());
    }
    let apart = |other: &Isometry3<f64>| {
        let between = pose.inverse() * other;
        (
            between.rotation.angle().to_degrees(),
            between.translation.vector.norm(),
        )
    };
    let is_other = |other: &Isometry3<f64>| {
        let (deg, m) = apart(other);
        deg > APART.0 || m > APART.1
    };
    for (_, start) in found.iter().filter(|(_, pose)| is_other(pose)).take(3) {
        let other = iterate(target, fine, *start, &FINE);
        if is_other(&other) && score(target, fine, &other) > EQUAL * best {
            let (apart_deg, apart_m) = apart(&other);
            return Err(CalibrateError::Ambiguous { apart_deg, apart_m });
        }
    }
    Ok(())
}

/// The configured mounting, and turns about each axis of the sensor.
fn starts(origin: &Point3<f64>) -> impl Iterator<Item = Isometry3<f64>> {
    const TURNS: [f64; 3] = [0.0, -START_DEG, START_DEG];
    let there = Translation3::from(origin.coords);
    (0..27).map(move |number| {
        let [roll, pitch, yaw] =
            [number % 3, number / 3 % 3, number / 9].map(|turn: usize| TURNS[turn].to_radians());
        let turn = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        there * turn * there.inverse()
    })
}

/// About `most` of the planes, evenly.
fn thinned(surfaces: &Surfaces, most: usize) -> Vec<Surface> {
    let step = surfaces.len().div_ceil(most).max(1);
    surfaces.all.iter().step_by(step).copied().collect()
}

/// What lies on what.
fn pairs(
    target: &Surfaces,
    source: &[Surface],
    pose: &Isometry3<f64>,
    gate_m: f64,
    cosine: f64,
) -> Vec<Pair> {
    let pair = |surface: &Surface| {
        let place = pose * surface.center;
        let normal = pose.rotation * surface.normal;
        let fits = |other: &Surface| other.normal.dot(&normal) > cosine;
        let other = target.nearest(&place, gate_m, fits)?;
        // The mean of both normals makes the residual the same from either side (Rusinkiewicz, "A symmetric objective function for ICP", 2019).
        let sum = other.normal + normal;
        let normal = sum / sum.norm().max(f64::MIN_POSITIVE);
        Some(Pair {
            place,
            normal,
            residual_m: normal.dot(&(place - other.center)),
            normal_variance: 0.25 * (surface.normal_variance + other.normal_variance),
            weight: surface.weight.sqrt(),
            target: other.center,
        })
    };
    source.iter().filter_map(pair).collect()
}

/// Share of the planes that lie on another one.
fn score(target: &Surfaces, source: &[Surface], pose: &Isometry3<f64>) -> f64 {
    let (gate_m, cosine, _) = FINE[0];
    let pairs = pairs(target, source, pose, gate_m, cosine);
    let fits = |pair: &Pair| (1.0 - (pair.residual_m / SAME_M).powi(2)).max(0.0);
    pairs.iter().map(fits).sum::<f64>() / source.len().max(1) as f64
}

/// Steps of Gauss and Newton through `passes`, with weights after Cauchy that leave out what does not belong together.
fn iterate(
    target: &Surfaces,
    source: &[Surface],
    start: Isometry3<f64>,
    passes: &[(f64, f64, usize)],
) -> Isometry3<f64> {
    let mut pose = start;
    for (gate_m, cosine, iterations) in passes.iter().copied() {
        for _ in 0..iterations {
            let pairs = pairs(target, source, &pose, gate_m, cosine);
            let step = step(&pairs, 0.15 * gate_m);
            let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
            let shift: Vector3<f64> = step.fixed_rows::<3>(3).into_owned();
            pose = Isometry3::from_parts(Translation3::from(shift), turn) * pose;
            if step.norm() < 1e-6 {
                break;
            }
        }
    }
    pose
}

/// The turn (rad, about the body's origin) and shift (m) that takes away most of the residuals, as far as they are observable.
fn step(pairs: &[Pair], scale_m: f64) -> Vector6<f64> {
    if pairs.len() < 6 {
        return Vector6::zeros();
    }
    let lever_m = certainty::lever_m(pairs, &Point3::origin());
    let (mut information, mut gradient, mut sum) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
    for pair in pairs {
        let weight = pair.weight / (1.0 + (pair.residual_m / scale_m).powi(2));
        let row = pair.row(&Point3::origin(), lever_m);
        information += row * row.transpose() * weight;
        gradient += row * (weight * pair.residual_m);
        sum += weight;
    }
    let eigen = SymmetricEigen::new(information);
    let mut step = Vector6::zeros();
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > STEP_MIN * sum {
            step -= vector * (vector.dot(&gradient) / value);
        }
    }
    for part in step.fixed_rows_mut::<3>(0).iter_mut() {
        *part /= lever_m;
    }
    step
}
