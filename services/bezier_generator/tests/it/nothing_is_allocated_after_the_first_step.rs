//! The generator allocates nothing once it is made, whether a curve exists or not.

use crate::cases::{Case, KINDS, PIECES_MAX};
use allocation_counter::measure;
use jink_bezier_generator::problem::CurveSolver;
use jink_bezier_generator::{Generator, NoTrajectory};
use jink_shared_types::Timestamp;
use jink_shared_types::motion::{Route, Trajectory};

fn now() -> Timestamp {
    Timestamp::from_seconds(100.0)
}

#[test]
fn solved_and_unsolvable_problems_allocate_nothing() {
    let cases: Vec<_> = (0..60)
        .map(|seed| Case::random(KINDS[seed % KINDS.len()], seed as u64))
        .collect();
    let mut curves = Vec::with_capacity(PIECES_MAX);
    let mut solver = None;
    let in_new = measure(|| solver = Some(CurveSolver::with_capacity(PIECES_MAX)));
    assert!(in_new.count_total > 0, "the counter counts");
    let mut solver = solver.unwrap();
    let (mut solved, mut unsolvable) = (0, 0);
    for case in &cases {
        let specs = case.specs();
        let in_solve =
            measure(
                || match solver.solve(&case.start, &specs, &case.target, &case.limits, &mut curves) {
                    Ok(()) => solved += 1,
                    Err(_) => unsolvable += 1,
                },
            );
        assert_eq!(in_solve.count_total, 0);
    }
    assert!(solved > 10 && unsolvable > 5, "{solved} solved, {unsolvable} not");
}

#[test]
fn steps_of_the_generator_allocate_nothing() {
    let routes: Vec<_> = (0..60)
        .map(|seed| Case::random(KINDS[seed % KINDS.len()], seed as u64))
        .map(|case| case.route(now().plus_seconds(0.1)))
        .collect();
    let mut generator = Generator::new(1);
    let mut base = Trajectory::default();
    let mut out = Trajectory::default();
    let mut outcomes = [0; 2];
    let in_flight = measure(|| {
        for route in &routes {
            let made = generator.step(now(), route, None, &mut out);
            outcomes[usize::from(made.is_err())] += 1;
            if made.is_ok() {
                base.clone_from(&out);
            }
        }
        let foreign = Route {
            base_id: 99,
            ..routes[0]
        };
        let refused = generator.step(now(), &foreign, Some(&base), &mut out);
        assert!(matches!(refused, Err(NoTrajectory::WrongBase { .. })));
    });
    assert_eq!(in_flight.count_total, 0);
    let [made, failed] = outcomes;
    assert!(made > 10 && failed > 0, "{made} made, {failed} not");
}
