//! Curves against PX4's evaluation of the ones it was sent.

use super::report::ScenarioResult;
use super::schema::{Node, Unreadable};
use jink_shared_types::bezier::{derivative, derivative_scalar, evaluate, evaluate_scalar};
use jink_shared_types::frames::wrap_pi;
use nalgebra::Vector3;

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
pub fn judge(scenario: &Node<'_>, result: &mut ScenarioResult) -> Result<(), Unreadable> {
    let mut points = Vec::new();
    for point in scenario.get("control_points")?.list()? {
        points.push(Vector3::from(point.numbers::<3>()?));
    }
    let mut yaws_rad = Vec::new();
    for yaw in scenario.get("yaws_rad")?.list()? {
        yaws_rad.push(yaw.number()?);
    }
    let expect = scenario.get("expect")?;
    let is_valid = expect.get("valid")?.flag()?;
    let t = match scenario.find("t") {
        Some(t) => t.number()?,
        None => match normalised(scenario)? {
            Some(t) => t,
            None if is_valid => {
                result.wrong("PX4 evaluates it".to_owned());
                return Ok(());
            }
            None => {
                result.same();
                return Ok(());
            }
        },
    };
    if t.is_nan() && is_valid {
        result.differs("no number is no time of a curve");
        return Ok(());
    }
    let sample = sample(&points, &yaws_rad, t);
    match (sample, is_valid) {
        (None, false) => result.same(),
        (None, true) => result.wrong("PX4 evaluates it".to_owned()),
        (Some(_), false) => result.wrong("PX4 does not evaluate it".to_owned()),
        (Some(sample), true) => compare(scenario, &expect, &sample, result)?,
    }
    Ok(())
}

/// The parameter from the times, if now lies between them.
fn normalised(scenario: &Node<'_>) -> Result<Option<f64>, Unreadable> {
    let time = |name| scenario.get(name)?.integer();
    let (start, end, now) = (time("start_us")?, time("end_us")?, time("now_us")?);
    let is_inside = (start..=end).contains(&now);
    Ok(is_inside.then(|| (now - start) as f64 / (end - start) as f64))
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

fn compare(
    scenario: &Node<'_>,
    expect: &Node<'_>,
    sample: &Sample,
    result: &mut ScenarioResult,
) -> Result<(), Unreadable> {
    for (name, ours) in [
        ("position", &sample.position),
        ("velocity_dT", &sample.velocity),
        ("acceleration_dT2", &sample.acceleration),
    ] {
        let px4 = Vector3::from(expect.get(name)?.numbers::<3>()?);
        let size = px4
            .iter()
            .filter(|x| x.is_finite())
            .fold(0.0, |a: f64, x| a.max(x.abs()));
        let is_same = ours.iter().zip(px4.iter()).all(|(ours, px4)| {
            !px4.is_finite() && !ours.is_finite() || (ours - px4).abs() <= SAME * (1.0 + size)
        });
        let is_no_number = |v: &Vector3<f64>| v.iter().any(|x| !x.is_finite());
        if is_same {
            result.same();
        } else if is_no_number(&px4) && !is_no_number(ours) {
            result.differs("PX4's answer is no number");
        } else {
            result.wrong(format!("{name} {ours:?}, PX4 {px4:?}"));
        }
    }
    let is_seam = match scenario.find("fragile") {
        Some(fragile) => fragile.find("yaw").is_some(),
        None => false,
    };
    if is_seam {
        result.fragile += 1;
        return Ok(());
    }
    let (yaw, rate) = (expect.get("yaw")?.number()?, expect.get("yaw_rate_dT")?.number()?);
    let is_yaw = wrap_pi(sample.yaw_rad - yaw).abs() <= SAME * 10.0;
    let is_rate = (sample.yaw_rate - rate).abs() <= SAME * (1.0 + rate.abs());
    if is_yaw && is_rate || yaw.is_nan() && sample.yaw_rad.is_nan() {
        result.same();
    } else {
        result.wrong(format!(
            "heading {} at {}, PX4 {yaw} at {rate}",
            sample.yaw_rad, sample.yaw_rate
        ));
    }
    Ok(())
}
