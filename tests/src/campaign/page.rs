//! A campaign as a page: figures by cell, success by difficulty, pictures of what failed.

use super::table::{self, successes, wilson};
use super::{FlightOutcome, FlightReport};
use jink_report::campaign::{Campaign, Failure, Share};
use std::collections::BTreeMap;

/// Groups of equally many flights, from the easiest worlds to the hardest.
const DIFFICULTY_GROUPS: usize = 5;
/// Pictures in a page: some 100 kB each.
const PICTURES_MAX: usize = 60;

/// Whether a flight did neither reach its goal nor stop where it had to.
pub fn failed(report: &FlightReport) -> bool {
    !matches!(report.outcome, FlightOutcome::Goal | FlightOutcome::Stopped)
}

/// The name of a flight's picture.
pub fn picture_of(report: &FlightReport) -> String {
    let varied = report.variation.map_or(String::new(), |variation| {
        format!("_{}_{}", variation.quantity.name(), variation.value)
    });
    table::picture_file(&report.cell, &report.sensor, &varied, report.seed)
}

/// The page of `reports`, which `command` flew; `pictures` by their names.
pub fn page(command: &str, reports: &[FlightReport], pictures: &BTreeMap<String, String>) -> String {
    let all: Vec<&FlightReport> = reports.iter().collect();
    let mut shown = 0;
    let failure = |report: &&FlightReport| Failure {
        words: table::line(report),
        svg: pictures
            .get(&picture_of(report))
            .filter(|_| {
                shown += 1;
                shown <= PICTURES_MAX
            })
            .cloned(),
    };
    Campaign {
        command: command.to_owned(),
        whole: vec![share("flights".to_owned(), &all)],
        cells: table::rows(&table::by_cell(reports))
            .into_iter()
            .map(Vec::from)
            .collect(),
        difficulty: (
            "how much of the view ahead is taken by obstacles, five groups of equally many flights"
                .to_owned(),
            by_difficulty(&all),
        ),
        failures: all.iter().filter(|report| failed(report)).map(failure).collect(),
        flights: reports.iter().map(table::line).collect(),
    }
    .page()
}

fn share(name: String, reports: &[&FlightReport]) -> Share {
    let successes = successes(reports);
    Share {
        name,
        flights: reports.len(),
        successes,
        interval: wilson(successes, reports.len()),
    }
}

/// Groups by the view obstruction of their worlds; none where there are fewer flights than groups.
fn by_difficulty(reports: &[&FlightReport]) -> Vec<Share> {
    let measured = reports.iter().filter_map(|report| {
        let view = report.difficulty.as_ref()?.view;
        Some((view, *report))
    });
    let mut measured: Vec<(f64, &FlightReport)> = measured.collect();
    measured.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    if measured.len() < DIFFICULTY_GROUPS {
        return Vec::new();
    }
    let group = |number: usize| {
        let of = |number: usize| number * measured.len() / DIFFICULTY_GROUPS;
        let group = &measured[of(number)..of(number + 1)];
        let flights: Vec<&FlightReport> = group.iter().map(|(_, report)| *report).collect();
        let (low, high) = (group[0].0, group[group.len() - 1].0);
        share(format!("{low:.2} to {high:.2}"), &flights)
    };
    (0..DIFFICULTY_GROUPS).map(group).collect()
}
