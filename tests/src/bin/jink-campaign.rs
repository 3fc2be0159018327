//! Flight campaigns in lock-step: deterministic, seeded, faster than real time.

use clap::Parser;
use jink_simulated_world::world::WorldKind;
use jink_tests::campaign::{
    Cell, FlightOutcome, FlightReport, SPHERE, fly_as, percentiles, sensor_set, sensors_of, setup,
};
use jink_tests::pairing::Pairing;
use jink_tests::station::StationColumn;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::mpsc;
use std::time::Instant;

/// Flies the whole chain in lock-step, one flight per seed; prints one table and, on request, one JSON line per flight
///
/// Exit codes: 0 no collision; 1 a collision; 2 wrong arguments.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// World: forest, gap, corridor, utrap, building, empty, or FILE.toml
    #[arg(long, visible_alias = "world", default_value = "forest")]
    suite: String,
    /// Sensors: sphere, mid360, os0, os1, vlp16, d435, d435x3, sf45, rplidar (the last two with a rangefinder down), several with
    /// a plus between them, or FILE.toml with `sensor` tables, and declarations under `params`
    #[arg(long, default_value = SPHERE)]
    sensor: String,
    /// Trees per square metre (forest only; default 1/25)
    #[arg(long)]
    density: Option<f64>,
    /// Highest speed (m/s)
    #[arg(long, default_value_t = 3.0)]
    speed: f64,
    /// Autopilot and profile: px4_trajectory, px4_offboard, px4_2021_offboard, px4_deviation, ardupilot_guided
    #[arg(long, default_value = "px4_trajectory", value_parser = pairing)]
    profile: Pairing,
    /// What the ground station does in flight
    #[arg(long, value_enum, default_value_t)]
    station: StationColumn,
    /// Seeds FIRST..LAST, both included
    #[arg(long, default_value = "1..20", value_parser = seeds)]
    seeds: (u64, u64),
    /// Flights at a time
    #[arg(long, default_value_t = 2)]
    jobs: usize,
    /// Part of the campaign to fly, I/N, for several machines
    #[arg(long, default_value = "1/1", value_parser = shard)]
    shard: (u64, u64),
    /// Longest mission (s)
    #[arg(long, default_value_t = 120.0)]
    timeout: f64,
    /// File for one JSON object per flight
    #[arg(long)]
    json: Option<PathBuf>,
    /// Print a line per flight
    #[arg(long, short)]
    verbose: bool,
}

fn pairing(text: &str) -> Result<Pairing, String> {
    Pairing::named(text).ok_or_else(|| format!("no profile {text:?}"))
}

fn seeds(text: &str) -> Result<(u64, u64), String> {
    let parts = text.split_once("..").ok_or("expected FIRST..LAST")?;
    let number = |part: &str| part.parse::<u64>().map_err(|error| error.to_string());
    match (number(parts.0)?, number(parts.1)?) {
        (first, last) if first <= last => Ok((first, last)),
        _ => Err("the first seed must not exceed the last".to_owned()),
    }
}

fn shard(text: &str) -> Result<(u64, u64), String> {
    let parts = text.split_once('/').ok_or("expected I/N")?;
    let number = |part: &str| part.parse::<u64>().map_err(|error| error.to_string());
    match (number(parts.0)?, number(parts.1)?) {
        (i, n) if (1..=n).contains(&i) => Ok((i, n)),
        _ => Err("expected I/N with 1 <= I <= N".to_owned()),
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let kind: WorldKind = match arguments.suite.parse() {
        Ok(kind) => kind,
        Err(error) => {
            eprintln!("jink-campaign: {error}");
            return ExitCode::from(2);
        }
    };
    let sensors = match sensor_set(&arguments.sensor).and_then(|set| sensors_of(&set).map(|_| set)) {
        Ok(set) => set,
        Err(error) => {
            eprintln!("jink-campaign: {error}");
            return ExitCode::from(2);
        }
    };
    let cell = Cell {
        sensors,
        kind,
        density_per_m2: arguments.density,
        speed_mps: arguments.speed,
        limit_s: arguments.timeout,
    };
    let begin = Instant::now();
    match run(&arguments, &cell) {
        Ok(reports) => {
            summary(&arguments, &reports, begin.elapsed().as_secs_f64());
            ExitCode::from(u8::from(reports.iter().any(|report| report.collisions > 0)))
        }
        Err(error) => {
            eprintln!("jink-campaign: {error}");
            ExitCode::from(2)
        }
    }
}

/// Flies all seeds of this shard on `jobs` threads; reports come back in order of seed.
fn run(arguments: &Arguments, cell: &Cell) -> Result<Vec<FlightReport>, String> {
    let (shard, shards) = arguments.shard;
    let mine: Vec<u64> = (arguments.seeds.0..=arguments.seeds.1)
        .filter(|seed| seed % shards == shard - 1)
        .collect();
    let mut file = match &arguments.json {
        Some(path) => {
            Some(std::fs::File::create(path).map_err(|error| format!("{}: {error}", path.display()))?)
        }
        None => None,
    };
    let (sender, receiver) = mpsc::channel();
    let next = std::sync::atomic::AtomicUsize::new(0);
    let mut reports = Vec::with_capacity(mine.len());
    std::thread::scope(|scope| {
        for _ in 0..arguments.jobs.max(1) {
            let (sender, next, mine) = (sender.clone(), &next, &mine);
            scope.spawn(move || {
                while let Some(seed) = mine.get(next.fetch_add(1, std::sync::atomic::Ordering::Relaxed)) {
                    if sender.send(fly(arguments, cell, *seed)).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        for answer in receiver {
            let report = answer?;
            if let Some(file) = &mut file {
                let line = serde_json::to_string(&report).map_err(|error| error.to_string())?;
                writeln!(file, "{line}").map_err(|error| error.to_string())?;
            }
            if arguments.verbose {
                println!("{}", line(&report));
            } else {
                eprint!("\r{} of {} flights", reports.len() + 1, mine.len());
            }
            reports.push(report);
        }
        Ok::<(), String>(())
    })?;
    if !arguments.verbose {
        eprintln!();
    }
    reports.sort_by_key(|report| report.seed);
    Ok(reports)
}

fn fly(arguments: &Arguments, cell: &Cell, seed: u64) -> Result<FlightReport, String> {
    let mut setup = arguments.profile.fly(setup(cell, seed)?)?;
    arguments.station.plan(&mut setup.plan);
    fly_as(setup, cell)
}

fn line(report: &FlightReport) -> String {
    format!(
        "seed {:4} {:?}: {}{:.1} s, {:.2} m/s mean, {:.2} top, clearance {:.2} m, ratio {:.2}, brakes {}, changed {}, lost {}, hold {}, gap {:.0} ms, plan {:.1}/{:.1} ms, {:.1}x",
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

fn summary(arguments: &Arguments, reports: &[FlightReport], wall_s: f64) {
    let n = reports.len();
    let count = |outcome: FlightOutcome| reports.iter().filter(|report| report.outcome == outcome).count();
    let goals = count(FlightOutcome::Goal);
    let (low, high) = wilson(goals, n);
    println!(
        "{} with {} at {} m/s, {:?}, station {:?}, {n} flights",
        arguments.suite, arguments.sensor, arguments.speed, arguments.profile.profile, arguments.station
    );
    println!(
        "  goal             {goals} ({:.1} %, 95 % interval {:.1} to {:.1} %)",
        percent(goals, n),
        low,
        high
    );
    println!("  collision        {}", count(FlightOutcome::CollisionStatic));
    println!("  limit violation  {}", count(FlightOutcome::LimitViolation));
    println!("  stuck            {}", count(FlightOutcome::Stuck));
    println!("  timeout          {}", count(FlightOutcome::Timeout));
    println!("  refused          {}", count(FlightOutcome::Refused));
    let of = |value: fn(&FlightReport) -> f64| -> Vec<f64> { reports.iter().map(value).collect() };
    let row = |what: &str, values: Vec<f64>, unit: &str| {
        let smallest = values.iter().copied().fold(f64::INFINITY, f64::min);
        let [p50, _, max] = percentiles(&values);
        println!("  {what:<16} min {smallest:.2}, median {p50:.2}, max {max:.2} {unit}");
    };
    row("clearance", of(|r| r.min_clearance_m), "m");
    row("mean speed", of(|r| r.mean_speed_mps), "m/s");
    row("top speed", of(|r| r.top_speed_mps), "m/s");
    if let Some(reached_mps) = reports.iter().find_map(|report| report.speed_cut_mps) {
        println!(
            "  speed            plans reach {reached_mps:.1} m/s of the {:.1} allowed",
            arguments.speed
        );
    }
    row("path ratio", of(|r| r.path_ratio), "");
    row("setpoint gap", of(|r| r.setpoint_gap_ms), "ms");
    row("plan, p50", of(|r| r.plan_ms[0]), "ms");
    row("plan, p99", of(|r| r.plan_ms[1]), "ms");
    row("curve, p50", of(|r| r.curve_ms[0]), "ms");
    row("map, p50", of(|r| r.map_ms[0]), "ms");
    row("speed-up", of(|r| r.speed_up), "x real time per core");
    let sum = |value: fn(&FlightReport) -> usize| reports.iter().map(value).sum::<usize>();
    println!("  guard brakes     {}", sum(|r| r.guard_brakes as usize));
    println!("  ways blocked     {}", sum(|r| r.commitments_changed));
    println!("  certificates lost {}", sum(|r| r.certificates_lost));
    println!("  falls to Hold    {}", sum(|r| r.hold_count as usize));
    let hash = reports.iter().fold(0u64, |hash, report| {
        jink_shared_types::hash::text(hash ^ report.seed, &report.hash)
    });
    println!("  hash             {hash:016x}");
    println!("  wall time        {wall_s:.1} s");
}

fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

/// Wilson's score interval for a proportion at 95 % (percent). Source: E. B. Wilson, JASA 22 (1927).
fn wilson(successes: usize, trials: usize) -> (f64, f64) {
    const Z: f64 = 1.959_964;
    let n = trials.max(1) as f64;
    let p = successes as f64 / n;
    let middle = p + Z * Z / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 100.0 / (1.0 + Z * Z / n);
    ((middle - half) * scale, (middle + half) * scale)
}
