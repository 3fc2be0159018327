//! What a curve costs: `cargo bench -p jink-bezier-generator --bench solver_cost`.
//!
//! The same random problems (straight, zigzag, narrow, moving starts, hopeless ones; 3 to 11 pieces) are posed and solved
//! with Clarabel, to a gap of 1e-5, and with our own method, one after the other. Prints for feasible and infeasible ones
//! the time and the iterations: median, p99 and maximum. Of three runs of a problem the shortest counts, so that what
//! else runs on the machine does not. Problems whose start is refused before anything is solved are not counted.

use jink_bezier_generator::problem::{CurveSolver, Infeasible};
use jink_shared_types::quantile::quantiles;
use std::hint::black_box;
use std::time::Instant;

mod cases;
mod with_clarabel;

use cases::{Case, KINDS, Kind, PIECES_MAX};
use with_clarabel::{MARGIN, Tolerance, objective};

const CASES: u64 = 400;
const REPEATS: usize = 3;
const TOLERANCE: Tolerance = Tolerance(1e-5);

/// Costs of one method.
#[derive(Debug, Default)]
struct Costs {
    times_us: Vec<f64>,
    iterations: Vec<f64>,
}

impl Costs {
    fn push(&mut self, (time_us, iterations): (f64, u32)) {
        self.times_us.push(time_us);
        self.iterations.push(f64::from(iterations));
    }

    fn columns(&self) -> String {
        let [p50, p99, max] = quantiles(&self.times_us, [0.5, 0.99, 1.0]).unwrap_or_default();
        let [i50, i99, i_max] = quantiles(&self.iterations, [0.5, 0.99, 1.0]).unwrap_or_default();
        format!("{p50:7.0} {p99:7.0} {max:7.0} us, {i50:2.0} {i99:2.0} {i_max:2.0} it")
    }
}

/// The shortest time (us) of some runs, and the result.
fn shortest<T>(mut run: impl FnMut() -> T) -> (f64, T) {
    let mut time = || {
        let begin = Instant::now();
        let result = black_box(run());
        (begin.elapsed().as_secs_f64() * 1e6, result)
    };
    let mut best = time();
    for _ in 1..REPEATS {
        let next = time();
        if next.0 < best.0 {
            best = next;
        }
    }
    best
}

fn measure(kind: Kind, solver: &mut CurveSolver) {
    let [mut clarabel, mut ours] = [[(); 2], [(); 2]].map(|pair| pair.map(|()| Costs::default()));
    let (mut only_clarabel, mut only_ours, mut refused_at_start) = (0, 0, 0);
    let mut costs_off: Vec<f64> = Vec::new();
    let mut curves = Vec::new();
    for seed in 0..CASES {
        let case = Case::random(kind, seed);
        let specs = case.specs();
        let (their_us, theirs) = shortest(|| {
            with_clarabel::solve(&case.start, &specs, &case.target, &case.limits, MARGIN, TOLERANCE)
        });
        let (our_us, own) =
            shortest(|| solver.solve(&case.start, &specs, &case.target, &case.limits, &mut curves));
        if own == Err(Infeasible::Start) {
            refused_at_start += 1;
            continue;
        }
        only_clarabel += u32::from(theirs.curves.is_ok() && own.is_err());
        only_ours += u32::from(theirs.curves.is_err() && own.is_ok());
        if let (Ok(theirs), Ok(())) = (&theirs.curves, own) {
            let [theirs, own] = [theirs, &curves].map(|curves| objective(curves, &specs, &case.target));
            costs_off.push(100.0 * (own / theirs - 1.0));
        }
        let verdict = usize::from(theirs.curves.is_err());
        clarabel[verdict].push((their_us, theirs.iterations));
        ours[verdict].push((our_us, solver.iterations()));
    }
    for (verdict, what) in ["feasible", "infeasible"].iter().enumerate() {
        let count = ours[verdict].times_us.len();
        if count > 0 {
            let kind = format!("{kind:?}");
            let (theirs, own) = (clarabel[verdict].columns(), ours[verdict].columns());
            println!("{kind:<9} {what:<10} {count:4}  {theirs}   {own}");
        }
    }
    let [least, most] = quantiles(&costs_off, [0.0, 1.0]).unwrap_or_default();
    println!(
        "{:<9} refused at the start {refused_at_start}, solved only by Clarabel {only_clarabel}, only by us {only_ours}; \
         our cost is {least:+.3} to {most:+.3} % higher",
        ""
    );
}

fn main() {
    println!(
        "{:<26} {:<43} ours: median, p99, max",
        "kind, Clarabel's verdict", "Clarabel: median, p99, max"
    );
    let mut solver = CurveSolver::with_capacity(PIECES_MAX);
    for kind in KINDS {
        measure(kind, &mut solver);
    }
}
