//! Curves against PX4's evaluation of the ones it was sent.

use super::VectorReport;
use jink_shared_types::bezier::{derivative, derivative_scalar, evaluate, evaluate_scalar};
use jink_shared_types::frames::wrap_pi;
use jink_testkit::vectors::{flag, list, number, numbers, whole};
use nalgebra::Vector3;
use serde_json::Value;

/// The tolerance: relative, and absolute for small numbers.
const SAME: f64 = 1e-4;

/// A point of a curve, by its parameter from 0 to 1.
struct Sample {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
    yaw_rad: f64,
    yaw_rate: f64,
}

/// Compares one.
pub fn judge(scenario: &Value, report: &mut VectorReport) {
    let points = list(&scenario["control_points"]).iter();
    let points: Vec<_> = points.map(|point| Vector3::from(numbers::<3>(point))).collect();
    let yaws_rad: Vec<f64> = list(&scenario["yaws_rad"]).iter().map(number).collect();
    let expect = &scenario["expect"];
    let is_valid = flag(&expect["valid"]);
    let t = match scenario.get("t") {
        Some(t) => Some(number(t)),
        None => normalised(scenario),
    };
    if t.is_some_and(f64::is_nan) && is_valid {
        report.differs("no number is no time of a curve");
        return;
    }
    match (t.and_then(|t| sample(&points, &yaws_rad, t)), is_valid) {
        (None, false) => {}
        (None, true) => report.wrong("PX4 evaluates it"),
        (Some(_), false) => report.wrong("PX4 does not evaluate it"),
        (Some(sample), true) => compare(expect, &sample, report),
    }
}

/// The parameter from the times, if now lies between them.
fn normalised(scenario: &Value) -> Option<f64> {
    let [start, end, now] = ["start_us", "end_us", "now_us"].map(|name| whole(&scenario[name]));
    let is_inside = (start..=end).contains(&now);
    is_inside.then(|| (now - start) as f64 / (end - start) as f64)
}

fn sample(points: &[Vector3<f64>], yaws_rad: &[f64], t: f64) -> Option<Sample> {
    if !(0.0..=1.0).contains(&t) || yaws_rad.len() != points.len() {
        return None;
    }
    // Headings turn by less than half a circle from the first one.
    let turns: Vec<f64> = yaws_rad.iter().map(|yaw| wrap_pi(yaw - yaws_rad[0])).collect();
    match points.len() {
        1 => Some(Sample {
            position: points[0],
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            yaw_rad: wrap_pi(yaws_rad[0]),
            yaw_rate: 0.0,
        }),
        2 => sample_of::<2, 1, 0>(points, &turns, yaws_rad[0], t),
        3 => sample_of::<3, 2, 1>(points, &turns, yaws_rad[0], t),
        4 => sample_of::<4, 3, 2>(points, &turns, yaws_rad[0], t),
        5 => sample_of::<5, 4, 3>(points, &turns, yaws_rad[0], t),
        6 => sample_of::<6, 5, 4>(points, &turns, yaws_rad[0], t),
        _ => None,
    }
}

fn sample_of<const N: usize, const M: usize, const L: usize>(
    points: &[Vector3<f64>],
    turns: &[f64],
    first_rad: f64,
    t: f64,
) -> Option<Sample> {
    let points: [Vector3<f64>; N] = points.try_into().ok()?;
    let turns: [f64; N] = turns.try_into().ok()?;
    let velocities: [Vector3<f64>; M] = derivative(&points, 1.0);
    let rates: [f64; M] = derivative_scalar(&turns, 1.0);
    let acceleration = if L == 0 {
        Vector3::zeros()
    } else {
        let accelerations: [Vector3<f64>; L] = derivative(&velocities, 1.0);
        evaluate(&accelerations, t)
    };
    Some(Sample {
        position: evaluate(&points, t),
        velocity: evaluate(&velocities, t),
        acceleration,
        yaw_rad: wrap_pi(first_rad + evaluate_scalar(&turns, t)),
        yaw_rate: evaluate_scalar(&rates, t),
    })
}

fn compare(expect: &Value, sample: &Sample, report: &mut VectorReport) {
    for (name, ours) in [
        ("position", &sample.position),
        ("velocity_dT", &sample.velocity),
        ("acceleration_dT2", &sample.acceleration),
    ] {
        let px4 = Vector3::from(numbers::<3>(&expect[name]));
        let size = px4
            .iter()
            .filter(|x| x.is_finite())
            .fold(0.0, |a: f64, x| a.max(x.abs()));
        let is_same = ours.iter().zip(px4.iter()).all(|(ours, px4)| {
            !px4.is_finite() && !ours.is_finite() || (ours - px4).abs() <= SAME * (1.0 + size)
        });
        let is_no_number = |v: &Vector3<f64>| v.iter().any(|x| !x.is_finite());
        if is_same {
            continue;
        } else if is_no_number(&px4) && !is_no_number(ours) {
            report.differs("PX4's answer is no number");
        } else {
            report.wrong(&format!("{name} {ours:?}, PX4 {px4:?}"));
        }
    }
    let [yaw, rate] = ["yaw", "yaw_rate_dT"].map(|name| number(&expect[name]));
    let is_yaw = wrap_pi(sample.yaw_rad - yaw).abs() <= SAME * 10.0;
    let is_rate = (sample.yaw_rate - rate).abs() <= SAME * (1.0 + rate.abs());
    let is_same = is_yaw && is_rate || yaw.is_nan() && sample.yaw_rad.is_nan();
    if !is_same {
        let Sample {
            yaw_rad, yaw_rate, ..
        } = sample;
        report.wrong(&format!("heading {yaw_rad} at {yaw_rate}, PX4 {yaw} at {rate}"));
    }
}
