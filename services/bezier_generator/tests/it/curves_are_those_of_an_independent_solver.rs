//! Our own method and Clarabel agree on random problems: which have a curve, and what it costs.

use crate::cases::{Case, KINDS, Kind, PIECES_MAX};
use crate::with_clarabel::{Answer, MARGIN, Tolerance, objective, solve};
use jink_bezier_generator::problem::{CurveSolver, PieceSpec};
use jink_shared_types::bezier::{QUINTIC, derivative};
use jink_shared_types::motion::MotionLimits;
use nalgebra::Vector3;
use proptest::prelude::*;

/// Verdicts may differ where this change of the margin changes Clarabel's.
const NEAR: f64 = 1e-5;
/// A bound may be missed by this share of the margin that is kept from it.
const MISSED: f64 = 0.02;
/// Costs may differ by this share.
const COST_SHARE: f64 = 1e-3;
/// Costs below this count as this: a curve along its guide costs nearly nothing.
const COST_MIN: f64 = 0.1;

fn clarabel(case: &Case, margin: f64) -> Answer {
    let tolerance = Tolerance(1e-9);
    solve(
        &case.start,
        &case.specs(),
        &case.target,
        &case.limits,
        margin,
        tolerance,
    )
}

/// The largest share of the margin by which a control point misses its bound, the start's own points left out.
fn missed(curves: &[[Vector3<f64>; QUINTIC]], pieces: &[PieceSpec<'_>], limits: &MotionLimits) -> f64 {
    let mut most: f64 = 0.0;
    let mut limit = |reached: f64, limit: f64| most = most.max((reached / limit - 1.0 + MARGIN) / MARGIN);
    for (index, (points, piece)) in curves.iter().zip(pieces).enumerate() {
        let of_start = |order: usize| if index == 0 { 3 - order } else { 0 };
        for point in points.iter().skip(of_start(0)) {
            // As a share of one metre.
            limit(1.0 - piece.polytope.depth_m(point), 1.0);
        }
        let velocity: [_; 5] = derivative(points, piece.duration_s);
        let acceleration: [_; 4] = derivative(&velocity, piece.duration_s);
        let jerk: [_; 3] = derivative(&acceleration, piece.duration_s);
        for v in velocity.iter().skip(of_start(1)) {
            limit(v.norm(), limits.speed_mps);
            limit(-v.z, limits.climb_mps);
            limit(v.z, limits.descent_mps);
        }
        for a in acceleration.iter().skip(of_start(2)) {
            limit(a.norm(), limits.acceleration_mps2);
        }
        for j in &jerk {
            limit(j.norm(), limits.jerk_mps3);
        }
    }
    most
}

/// The same verdict, the same cost, all bounds kept.
fn agree(case: &Case) -> Result<(), TestCaseError> {
    let specs = case.specs();
    let mut solver = CurveSolver::with_capacity(PIECES_MAX);
    let mut curves = Vec::new();
    let own = solver.solve(&case.start, &specs, &case.target, &case.limits, &mut curves);
    match (own, clarabel(case, MARGIN).curves) {
        (Ok(()), Ok(theirs)) => {
            let [own, theirs] = [&curves, &theirs].map(|curves| objective(curves, &specs, &case.target));
            let off = (own - theirs).abs() / theirs.max(COST_MIN);
            prop_assert!(off < COST_SHARE, "{own} and {theirs}");
        }
        (Ok(()), Err(_)) => prop_assert!(clarabel(case, MARGIN - NEAR).curves.is_ok()),
        (Err(_), Ok(_)) => prop_assert!(clarabel(case, MARGIN + NEAR).curves.is_err()),
        (Err(own), Err(theirs)) => prop_assert_eq!(own, theirs),
    }
    if own.is_ok() {
        let missed = missed(&curves, &specs, &case.limits);
        prop_assert!(missed < MISSED, "{missed}");
    }
    Ok(())
}

/// Corridors so narrow that rounding ends the progress before the gradient's residual is as small as wanted.
#[test]
fn where_rounding_ends_the_progress_the_curves_are_the_same() {
    for (kind, seed) in [
        (Kind::Narrow, 5_498_324_673_172_131_971),
        (Kind::Narrow, 764),
        (Kind::Narrow, 962),
        (Kind::Moving, 265),
    ] {
        agree(&Case::random(kind, seed)).unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]
    #[test]
    fn both_find_the_same_curves(kind in 0..KINDS.len(), seed in any::<u64>()) {
        agree(&Case::random(KINDS[kind], seed))?;
    }

    #[test]
    fn what_was_solved_before_does_not_matter(
        first in (0..KINDS.len(), any::<u64>()), second in (0..KINDS.len(), any::<u64>()),
    ) {
        let [first, second] = [first, second].map(|(kind, seed)| Case::random(KINDS[kind], seed));
        let run = |cases: &[&Case]| {
            let mut solver = CurveSolver::with_capacity(PIECES_MAX);
            let mut curves = Vec::new();
            let last = cases.iter().map(|case| {
                solver.solve(&case.start, &case.specs(), &case.target, &case.limits, &mut curves)
            });
            let last = last.last();
            (last, solver.iterations(), curves)
        };
        let (fresh, used) = (run(&[&second]), run(&[&first, &second]));
        prop_assert_eq!(fresh.0, used.0);
        if fresh.0 == Some(Ok(())) {
            prop_assert_eq!(fresh, used);
        }
    }
}

#[test]
fn with_what_is_no_number_there_is_no_curve() {
    let case = Case::random(KINDS[1], 2);
    let mut solver = CurveSolver::with_capacity(PIECES_MAX);
    let mut curves = Vec::new();
    let mut solve = |case: &Case, limits: &MotionLimits, target: &Vector3<f64>| {
        solver.solve(&case.start, &case.specs(), target, limits, &mut curves)
    };
    assert_eq!(solve(&case, &case.limits, &case.target), Ok(()));
    for number in [f64::NAN, f64::INFINITY] {
        assert!(solve(&case, &case.limits, &Vector3::repeat(number)).is_err());
        for spoil in [
            (|case, number| case.start.velocity.x_mps = number) as fn(&mut Case, f64),
            |case, number| case.start.acceleration.y_mps2 = number,
            |case, number| case.start.position.z_m = number,
            |case, number| case.corridor[0].planes[0].normal[1] = number,
        ] {
            let mut spoilt = case.clone();
            spoil(&mut spoilt, number);
            assert!(solve(&spoilt, &case.limits, &case.target).is_err());
        }
    }
    let mut spoilt = case.clone();
    spoilt.corridor[0].planes[0].offset_m = f64::NAN;
    assert!(solve(&spoilt, &case.limits, &case.target).is_err());
    for spoil in [
        (|limits| limits.speed_mps = f64::NAN) as fn(&mut MotionLimits),
        |limits| limits.climb_mps = f64::NAN,
        |limits| limits.acceleration_mps2 = f64::NAN,
        |limits| limits.jerk_mps3 = f64::NAN,
    ] {
        let mut limits = case.limits;
        spoil(&mut limits);
        assert!(solve(&case, &limits, &case.target).is_err());
    }
}
