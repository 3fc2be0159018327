//! What was measured, as a table and as JSON.

use crate::agreement::{Agreement, REASONS};
use crate::jink::{self, Stage, Took};
use crate::octomap;
use jink_shared_types::quantile::quantiles;
use serde_json::{Map, Value, json};
use std::fmt::Write as _;

/// Percentiles of a time (ms).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Percentiles([f64; 4]);

const PERCENTILES: [(&str, f64); 4] = [
    ("p50_ms", 0.5),
    ("p90_ms", 0.9),
    ("p99_ms", 0.99),
    ("max_ms", 1.0),
];

impl Percentiles {
    fn of(times_ms: impl Iterator<Item = f64>) -> Self {
        let times_ms: Vec<f64> = times_ms.collect();
        let shares = PERCENTILES.map(|(_, share)| share);
        Self(quantiles(&times_ms, shares).unwrap_or([f64::NAN; PERCENTILES.len()]))
    }

    /// The median (ms).
    pub fn p50_ms(&self) -> f64 {
        self.0[0]
    }

    fn json(&self) -> Value {
        let values = PERCENTILES.iter().zip(self.0);
        Value::Object(
            values
                .map(|((name, _), ms)| ((*name).to_owned(), rounded(ms)))
                .collect(),
        )
    }
}

/// One sensor's clouds.
pub struct Row {
    /// Name.
    pub name: String,
    /// Rays per scan that say something, on average.
    pub points: f64,
    /// Wall and CPU time of every stage.
    pub stages: Vec<(Stage, [Percentiles; 2])>,
    /// Wall and CPU time of all stages that every map takes: all but [`Stage::InflateOthers`].
    pub total: [Percentiles; 2],
    /// Wall and CPU time of OctoMap's `insertPointCloud`.
    pub octomap: Option<[Percentiles; 2]>,
    /// Cell by cell.
    pub agreement: Option<Agreement>,
}

impl Row {
    /// From what both came to.
    pub fn new(
        name: &str,
        points: f64,
        clouds_per_scan: usize,
        run: &jink::Run,
        octomap: Option<&octomap::Run>,
        agreement: Option<Agreement>,
    ) -> Self {
        let scans = &run.scans;
        let stages = Stage::ALL.iter().enumerate();
        let of_stage = |index: usize| both(scans.iter().map(|stages| stages[index]));
        let sum = |stages: &[Took; Stage::ALL.len()]| {
            let mut sum = Took::default();
            stages[..3].iter().for_each(|took| sum += *took);
            sum
        };
        let per_scan = |clouds: &[Took]| {
            both(clouds.chunks(clouds_per_scan).map(|clouds| {
                let mut sum = Took::default();
                clouds.iter().for_each(|took| sum += *took);
                sum
            }))
        };
        Self {
            name: name.to_owned(),
            points,
            stages: stages.map(|(index, stage)| (*stage, of_stage(index))).collect(),
            total: both(scans.iter().map(sum)),
            octomap: octomap.map(|run| per_scan(&run.clouds)),
            agreement,
        }
    }

    /// Wall and CPU time of [`Stage::Insert`].
    pub fn insert(&self) -> [Percentiles; 2] {
        self.stages[0].1
    }

    /// How many times as long OctoMap takes to insert a scan, by medians of CPU time.
    pub fn ratio(&self) -> Option<f64> {
        let insert_ms = self.insert()[1].p50_ms();
        self.octomap.map(|[_, cpu]| cpu.p50_ms() / insert_ms)
    }

    fn points_per_second(&self) -> f64 {
        self.points / (self.insert()[1].p50_ms() * 1e-3)
    }

    fn json(&self) -> Value {
        let both = |[wall, cpu]: [Percentiles; 2]| json!({ "wall": wall.json(), "cpu": cpu.json() });
        let mut stages: Map<String, Value> = Map::new();
        for (stage, times) in &self.stages {
            stages.insert(stage.name().to_owned(), both(*times));
        }
        json!({
            "name": self.name,
            "points_per_scan": rounded(self.points),
            "points_per_second": rounded(self.points_per_second()),
            "stages": stages,
            "total": both(self.total),
            "octomap": self.octomap.map(both),
            "octomap_ratio": self.ratio().map(rounded),
            "agreement": self.agreement,
        })
    }
}

fn both(times: impl Iterator<Item = Took> + Clone) -> [Percentiles; 2] {
    [
        Percentiles::of(times.clone().map(|took| took.wall_ms)),
        Percentiles::of(times.map(|took| took.cpu_ms)),
    ]
}

/// Four places are more than any clock here is good for.
fn rounded(value: f64) -> Value {
    json!((value * 1e4).round() / 1e4)
}

/// What was asked for, and where.
pub struct Head {
    /// Seed of the forest and of the sensors' noise.
    pub seed: u64,
    /// Flown time (s).
    pub seconds: f64,
    /// Maps that each series was entered into.
    pub repeats: u32,
    /// The commit of the checkout; `None` outside of one.
    pub commit: Option<String>,
    /// Name of the CPU.
    pub cpu: String,
    /// Why there are no figures of OctoMap.
    pub no_octomap: Option<String>,
}

/// Everything as one JSON object.
pub fn json(head: &Head, rows: &[Row]) -> Value {
    let row = |name: &str| rows.iter().find(|row| row.name == name);
    let p50 = |name: &str, clock: usize| row(name).map(|row| rounded(row.insert()[clock].p50_ms()));
    let smallest = rows.iter().filter_map(Row::ratio).min_by(f64::total_cmp);
    json!({
        "p50_ms_20k": p50("20k", 0),
        "p50_ms_100k": p50("100k", 0),
        "p50_ms_200k": p50("200k", 0),
        "p50_cpu_ms_20k": p50("20k", 1),
        "p50_cpu_ms_100k": p50("100k", 1),
        "p50_cpu_ms_200k": p50("200k", 1),
        "octomap_ratio": smallest.map(rounded),
        "octomap_missing": head.no_octomap,
        "agreement": smallest_agreement(rows),
        "free_here_occupied_there_unexplained": rows
            .iter()
            .filter_map(|row| row.agreement.as_ref())
            .map(|agreement| agreement.free_here_occupied_there_unexplained)
            .reduce(|sum, cells| sum + cells),
        "commit": head.commit,
        "cpu": head.cpu,
        "seed": head.seed,
        "seconds": head.seconds,
        "repeats": head.repeats,
        "clouds": rows.iter().map(Row::json).collect::<Vec<_>>(),
    })
}

/// The smallest share of cells of which both maps say the same.
fn smallest_agreement(rows: &[Row]) -> Option<Value> {
    let shares = rows
        .iter()
        .filter_map(|row| row.agreement.as_ref())
        .map(|agreement| agreement.same);
    shares.min_by(f64::total_cmp).map(rounded)
}

/// The tables.
pub fn text(head: &Head, rows: &[Row]) -> String {
    let mut out = String::new();
    let _infallible = write_text(&mut out, head, rows);
    out
}

fn write_text(out: &mut String, head: &Head, rows: &[Row]) -> std::fmt::Result {
    writeln!(
        out,
        "forest 1/25 trees/m2, 5 m/s, {} s, seed {}, {} repeats; {}; commit {}",
        head.seconds,
        head.seed,
        head.repeats,
        head.cpu,
        head.commit.as_deref().unwrap_or("unknown")
    )?;
    writeln!(out, "milliseconds per scan; total: insert, write, inflate\n")?;
    writeln!(
        out,
        "{:<10} {:>8} {:<16} {:>8} {:>8} {:>8} {:>8} {:>9} {:>10}",
        "clouds", "points", "stage", "p50", "p90", "p99", "max", "CPU p50", "Mpoints/s"
    )?;
    for row in rows {
        let stages = row.stages.iter().map(|(stage, times)| (stage.name(), *times));
        let mut lines: Vec<(&str, [Percentiles; 2])> = stages.collect();
        lines.push(("total", row.total));
        lines.extend(row.octomap.map(|times| ("octomap insert", times)));
        for (index, (stage, [wall, cpu])) in lines.into_iter().enumerate() {
            let (name, points) = match index {
                0 => (row.name.as_str(), format!("{:.0}", row.points)),
                _ => ("", String::new()),
            };
            write!(out, "{name:<10} {points:>8} {stage:<16}")?;
            for ms in wall.0 {
                write!(out, " {ms:>8.2}")?;
            }
            write!(out, " {:>9.2}", cpu.p50_ms())?;
            if index == 0 {
                write!(out, " {:>10.1}", row.points_per_second() * 1e-6)?;
            }
            writeln!(out)?;
        }
        if let Some(ratio) = row.ratio() {
            writeln!(out, "{:<20}OctoMap takes {ratio:.0} times as long", "")?;
        }
    }
    match &head.no_octomap {
        Some(why) => writeln!(out, "\nNo figures of OctoMap: {why}"),
        None => write_agreement(out, rows),
    }
}

fn write_agreement(out: &mut String, rows: &[Row]) -> std::fmt::Result {
    writeln!(
        out,
        "\ncells of the window after the last scan, here and in OctoMap"
    )?;
    for row in rows {
        let Some(agreement) = &row.agreement else {
            continue;
        };
        writeln!(
            out,
            "{:<10} {:.2} % of {} cells are the same",
            row.name,
            100.0 * agreement.same,
            agreement.cells
        )?;
        for (difference, cells) in &agreement.differences {
            writeln!(out, "{cells:>12} {difference}")?;
        }
    }
    writeln!(out, "\nreasons")?;
    for (reason, means) in REASONS {
        writeln!(out, "  {reason:<20} {means}")?;
    }
    Ok(())
}
