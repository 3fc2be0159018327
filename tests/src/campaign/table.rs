//! What is printed of a campaign: a summary of one cell, a table of several, both beside their targets.

use super::{FlightOutcome, FlightReport, percentiles};
use crate::suite::anchors::{self, Anchor};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// Flights by their outcome.
fn count(reports: &[&FlightReport], outcome: FlightOutcome) -> usize {
    reports.iter().filter(|report| report.outcome == outcome).count()
}

/// Flights that did what they could: reached the goal, or stopped where their sensors or their companion died.
pub fn successes(reports: &[&FlightReport]) -> usize {
    count(reports, FlightOutcome::Goal) + count(reports, FlightOutcome::Stopped)
}

pub(super) fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

/// Wilson's score interval for a proportion at 95 % (percent). Source: E. B. Wilson, JASA 22 (1927).
pub fn wilson(successes: usize, trials: usize) -> (f64, f64) {
    const Z: f64 = 1.959_964;
    let n = trials.max(1) as f64;
    let p = successes as f64 / n;
    let middle = p + Z * Z / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 100.0 / (1.0 + Z * Z / n);
    ((middle - half) * scale, (middle + half) * scale)
}

fn values(reports: &[&FlightReport], of: impl Fn(&FlightReport) -> Option<f64>) -> Vec<f64> {
    reports.iter().filter_map(|report| of(report)).collect()
}

/// One number over all flights, the same whatever the order they were flown in.
pub fn hash(reports: &[&FlightReport]) -> u64 {
    let mut sorted = reports.to_vec();
    sorted.sort_by_key(|report| (&report.cell, report.seed));
    sorted.iter().fold(0, |hash, report| {
        jink_shared_types::hash::text(hash ^ report.seed, &report.hash)
    })
}

/// The reports of each cell, and of each value of what is varied in it, in the order in which they first come.
pub fn by_cell(reports: &[FlightReport]) -> Vec<Vec<&FlightReport>> {
    let mut cells: Vec<Vec<&FlightReport>> = Vec::new();
    for report in reports {
        match cells.iter_mut().find(|cell| is_alike(cell[0], report)) {
            Some(cell) => cell.push(report),
            None => cells.push(vec![report]),
        }
    }
    cells
}

fn is_alike(a: &FlightReport, b: &FlightReport) -> bool {
    a.cell == b.cell && a.variation == b.variation
}

/// The figures of the flights of one cell, a line each.
pub fn summary(reports: &[&FlightReport], wall_s: f64) -> String {
    let Some(first) = reports.first() else {
        return "  no flights\n".to_owned();
    };
    let n = reports.len();
    let goals = successes(reports);
    let (low, high) = wilson(goals, n);
    let mut text = String::new();
    // Writing into a string does not fail.
    let mut line = |words: String| {
        let _written = writeln!(text, "  {words}");
    };
    line(format!(
        "goal             {goals} ({:.1} %, 95 % interval {low:.1} to {high:.1} %)",
        percent(goals, n)
    ));
    for (words, outcome) in [
        ("collision       ", FlightOutcome::CollisionStatic),
        ("collision, moving", FlightOutcome::CollisionDynamic),
        ("limit violation ", FlightOutcome::LimitViolation),
        ("stuck           ", FlightOutcome::Stuck),
        ("timeout         ", FlightOutcome::Timeout),
        ("refused         ", FlightOutcome::Refused),
    ] {
        line(format!("{words} {}", count(reports, outcome)));
    }
    let mut row = |what: &str, values: Vec<f64>, unit: &str| {
        let smallest = values.iter().copied().fold(f64::INFINITY, f64::min);
        let [p50, _, max] = percentiles(&values);
        if !values.is_empty() {
            line(format!(
                "{what:<16} min {smallest:.2}, median {p50:.2}, max {max:.2} {unit}"
            ));
        }
    };
    row("clearance", values(reports, |r| Some(r.min_clearance_m)), "m");
    row("mean speed", values(reports, |r| Some(r.mean_speed_mps)), "m/s");
    row("top speed", values(reports, |r| Some(r.top_speed_mps)), "m/s");
    row("mean jerk", values(reports, |r| Some(r.mean_jerk_mps3)), "m/s3");
    row("path ratio", values(reports, |r| Some(r.path_ratio)), "");
    row("over shortest", values(reports, |r| r.path_over_shortest), "");
    row("setpoint gap", values(reports, |r| Some(r.setpoint_gap_ms)), "ms");
    row("plan, p50", values(reports, |r| Some(r.plan_ms[0])), "ms");
    row("plan, p99", values(reports, |r| Some(r.plan_ms[1])), "ms");
    row("curve, p50", values(reports, |r| Some(r.curve_ms[0])), "ms");
    row("curve, p99", values(reports, |r| Some(r.curve_ms[1])), "ms");
    row("map, p50", values(reports, |r| Some(r.map_ms[0])), "ms");
    row(
        "speed-up",
        values(reports, |r| Some(r.speed_up)),
        "x real time per core",
    );
    if let Some(reached_mps) = reports.iter().find_map(|report| report.speed_cut_mps) {
        line(format!(
            "speed            plans reach {reached_mps:.1} m/s of the {:.1} allowed",
            first.speed_mps
        ));
    }
    if let Some(words) = lost(reports) {
        line(words);
    }
    let sum = |value: fn(&FlightReport) -> usize| reports.iter().map(|report| value(report)).sum::<usize>();
    line(format!("guard brakes     {}", sum(|r| r.guard_brakes as usize)));
    line(format!("ways blocked     {}", sum(|r| r.commitments_changed)));
    line(format!("certificates lost {}", sum(|r| r.certificates_lost)));
    line(format!(
        "commitments      {} laid into the true world, {} touch it",
        sum(|r| r.commitments as usize),
        sum(|r| r.commitments_touching as usize)
    ));
    line(format!("falls to Hold    {}", sum(|r| r.hold_count as usize)));
    if let Some(words) = difficulty(reports) {
        line(words);
    }
    if let Some(anchor) = anchor_of(first) {
        line(format!("goal target      {}", against(&anchor, goals, n)));
        line(format!("published        {}", anchor.published));
    }
    line(format!("hash             {:016x}", hash(reports)));
    line(format!("wall time        {wall_s:.1} s"));
    text
}

/// What limited the speed: by the way that was not flown for being slower than allowed, most of it first.
fn lost(reports: &[&FlightReport]) -> Option<String> {
    let mut by_cause: BTreeMap<&str, f64> = BTreeMap::new();
    for (cause, m) in reports.iter().flat_map(|report| &report.lost_m) {
        *by_cause.entry(cause).or_default() += m;
    }
    let all_m: f64 = by_cause.values().sum();
    let mut causes: Vec<_> = by_cause.into_iter().collect();
    causes.sort_by(|a, b| b.1.total_cmp(&a.1));
    let shares = causes
        .iter()
        .map(|(cause, m)| format!("{cause} {:.0} %", 100.0 * m / all_m));
    (all_m > 0.0).then(|| format!("slower by        {}", shares.collect::<Vec<_>>().join("; ")))
}

fn difficulty(reports: &[&FlightReport]) -> Option<String> {
    let mean = |of: fn(&crate::suite::difficulty::Difficulty) -> f64| {
        let all = values(reports, |report| report.difficulty.as_ref().map(of));
        (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
    };
    let discarded: u32 = reports.iter().map(|report| report.discarded).sum();
    Some(format!(
        "difficulty       traversability {:.2}, view {:.2}, turning {:.4}; {discarded} worlds without a way left out",
        mean(|d| d.traversability)?,
        mean(|d| d.view)?,
        mean(|d| d.turning)?,
    ))
}

fn anchor_of(report: &FlightReport) -> Option<Anchor> {
    anchors::of(&report.suite, &report.cell, report.density_per_m2)
}

fn against(anchor: &Anchor, successes: usize, flights: usize) -> String {
    let is_met = percent(successes, flights) >= anchor.goal_percent;
    let words = if is_met { "met" } else { "MISSED" };
    format!("{:.1} % {words}", anchor.goal_percent)
}

/// Its cell, and the value of what is varied.
fn name(report: &FlightReport) -> String {
    match report.variation {
        Some(variation) => format!("{} {variation}", report.cell),
        None => report.cell.clone(),
    }
}

/// The columns of [`rows`].
const COLUMNS: [&str; 15] = [
    "cell",
    "flights",
    "goal %",
    "95 % interval",
    "static",
    "moving",
    "stuck",
    "timeout",
    "clear m",
    "mean",
    "top",
    "/shortest",
    "plan 50/99",
    "touching",
    "goal target",
];

/// The names of the columns, and a row per cell.
pub fn rows(cells: &[Vec<&FlightReport>]) -> Vec<[String; COLUMNS.len()]> {
    let of_cells = cells
        .iter()
        .filter_map(|reports| Some((*reports.first()?, reports)));
    let row = |(first, reports): (&FlightReport, &Vec<&FlightReport>)| {
        let (n, goals) = (reports.len(), successes(reports));
        let (low, high) = wilson(goals, n);
        let median = |of: fn(&FlightReport) -> Option<f64>| percentiles(&values(reports, of))[0];
        let least_m = values(reports, |r| Some(r.min_clearance_m))
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        let touching: u32 = reports.iter().map(|report| report.commitments_touching).sum();
        let late = count(reports, FlightOutcome::Timeout) + count(reports, FlightOutcome::Refused);
        let plan_ms = [median(|r| Some(r.plan_ms[0])), median(|r| Some(r.plan_ms[1]))];
        [
            name(first),
            n.to_string(),
            format!("{:.1}", percent(goals, n)),
            format!("{low:.1}..{high:.1}"),
            count(reports, FlightOutcome::CollisionStatic).to_string(),
            count(reports, FlightOutcome::CollisionDynamic).to_string(),
            count(reports, FlightOutcome::Stuck).to_string(),
            late.to_string(),
            format!("{least_m:.2}"),
            format!("{:.2}", median(|r| Some(r.mean_speed_mps))),
            format!("{:.2}", median(|r| Some(r.top_speed_mps))),
            format!("{:.2}", median(|r| r.path_over_shortest)),
            format!("{:.1}/{:.1}", plan_ms[0], plan_ms[1]),
            touching.to_string(),
            anchor_of(first).map_or_else(|| "-".to_owned(), |anchor| against(&anchor, goals, n)),
        ]
    };
    let header = COLUMNS.map(str::to_owned);
    std::iter::once(header).chain(of_cells.map(row)).collect()
}

/// A row per cell.
pub fn table(cells: &[Vec<&FlightReport>]) -> String {
    let mut text = String::new();
    jink_control::status::write_table(&mut text, &rows(cells));
    text
}

/// A line about one flight.
pub fn line(report: &FlightReport) -> String {
    format!(
        "{}seed {:4} {:?}: {}{:.1} s, {:.2} m/s mean, {:.2} top, clearance {:.2} m, ratio {:.2}, brakes {}, changed {}, lost {}, hold {}, gap {:.0} ms, plan {:.1}/{:.1} ms, {:.1}x",
        if report.suite.is_empty() {
            String::new()
        } else {
            format!("{} ", name(report))
        },
        report.seed,
        report.outcome,
        if report.reason.is_empty() {
            String::new()
        } else {
            format!("\"{}\" ", report.reason)
        },
        report.time_s,
        report.mean_speed_mps,
        report.top_speed_mps,
        report.min_clearance_m,
        report.path_ratio,
        report.guard_brakes,
        report.commitments_changed,
        report.certificates_lost,
        report.hold_count,
        report.setpoint_gap_ms,
        report.plan_ms[0],
        report.plan_ms[1],
        report.speed_up,
    )
}

/// The file of a flight's picture, without a folder. A world of the user's own is called by its path, of which the last part is enough.
pub fn picture_file(cell: &str, sensor: &str, varied: &str, seed: u64) -> String {
    let cell = Path::new(cell).file_stem().unwrap_or(cell.as_ref());
    format!("{}_{sensor}{varied}_{seed}.svg", cell.display())
}

#[cfg(test)]
mod tests {
    use super::{picture_file, wilson};

    #[test]
    fn a_picture_goes_into_the_folder_that_was_asked_for_whatever_the_world_is_called() {
        assert_eq!(picture_file("forest", "mid360", "", 7), "forest_mid360_7.svg");
        for world in ["/home/me/walls.toml", "worlds/walls.toml", "walls.toml"] {
            assert_eq!(
                picture_file(world, "sphere", "_speed_3", 1),
                "walls_sphere_speed_3_1.svg"
            );
        }
    }

    #[test]
    fn the_interval_is_wilsons() {
        // By hand: 8 of 10, z = 1.96: (0.8 + 0.19207 +- 1.96 sqrt(0.016 + 0.0096036)) / 1.384146.
        let (low, high) = wilson(8, 10);
        assert!(
            (low - 49.02).abs() < 0.02 && (high - 94.33).abs() < 0.02,
            "{low} {high}"
        );
        let (low, high) = wilson(1_000, 1_000);
        assert!(low > 99.6 && (high - 100.0).abs() < 1e-9);
        assert_eq!(wilson(0, 0).0, wilson(0, 1).0);
    }
}
