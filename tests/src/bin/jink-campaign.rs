//! Flight campaigns in lock-step: deterministic, seeded, faster than real time.

use clap::Parser;
use jink_control::{arguments, places};
use jink_shared_types::params::OA_SPD_MAX;
use jink_shared_types::suggestion::{DidYouMean, nearest};
use jink_simulated_world::world::{MAX_DENSITY_PER_M2, WorldKind};
use jink_tests::campaign::variation::Variations;
use jink_tests::campaign::{
    Cell, FlightReport, FlownFlight, SPHERE, fly_drawn, page, plot, recorded, sensor_set, sensors_of, setup,
    table,
};
use jink_tests::lockstep::UserPlanner;
use jink_tests::pairing::{PX4_CURRENT, PX4_TRAJECTORY, Pairing};
use jink_tests::station::StationColumn;
use jink_tests::suite::hindrance::Hindrance;
use jink_tests::suite::{self, Choice, Suite};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::mpsc;
use std::time::Instant;

/// Flies the whole chain in lock-step, one flight per cell and seed; prints a table and, on request, one JSON line per flight
///
/// Suites compare planners: S1 forests, S2 dead ends, S3 narrow places, S4 moving obstacles, S5 degraded sensing. Their vehicle is
/// half a metre wide; each has cells (--cell). A world is flown as it is.
///
/// Exit codes: 0 no collision; 1 a collision; 2 wrong arguments.
#[derive(Parser)]
#[command(name = "jink campaign", bin_name = "jink campaign", version)]
struct Arguments {
    /// Print all suites and their cells, and fly nothing
    #[arg(long)]
    list: bool,
    /// Suite: S1 to S5; or a world: forest, gap, corridor, utrap, building, empty, or FILE.toml
    #[arg(long, visible_alias = "world", default_value = "forest")]
    suite: String,
    /// Cells of the suite, with commas between them; without it all that count
    #[arg(long, value_delimiter = ',')]
    cell: Vec<String>,
    /// Sensors: sphere, mid360, os0, os1, vlp16, d435, d435x3, sf45, rplidar (the last two with a rangefinder down), several with
    /// a plus between them, or FILE.toml with `sensor` tables, and declarations under `params`; lidar8, lidar40 and depth4 are those
    /// of published comparisons. Default: that of the cell, sphere in a world
    #[arg(long)]
    sensor: Option<String>,
    /// Trees per square metre (forests only; default 1/25)
    #[arg(long, value_parser = density)]
    density: Option<f64>,
    /// Highest speed (m/s); default: that of the cell, 3 in a world
    #[arg(long, value_parser = speed)]
    speed: Option<f64>,
    /// Autopilot and profile: px4_trajectory, px4_offboard, px4_2021_offboard, px4_deviation, ardupilot_guided. Default:
    /// px4_offboard in suites, px4_trajectory in worlds
    #[arg(long, value_parser = pairing)]
    profile: Option<Pairing>,
    /// A planner of somebody else's that proposes ways, as process user_NAME: docs/bring_your_own_process.md. Time stands still while it
    /// thinks
    #[arg(long, value_name = "NAME=PROGRAM")]
    process: Option<UserPlanner>,
    /// What the ground station does in flight
    #[arg(long, value_enum, default_value_t)]
    station: StationColumn,
    /// Seeds FIRST..LAST, both included
    #[arg(long, default_value = "1..20", allow_hyphen_values = true, value_parser = seeds)]
    seeds: (u64, u64),
    /// Flights at a time
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: u16,
    /// Part of the campaign to fly, I/N, for several machines
    #[arg(long, default_value = "1/1", value_parser = shard)]
    shard: (u64, u64),
    /// Longest mission (s); default 180 in suites (300 in mazes), 120 in worlds
    #[arg(long, value_parser = arguments::seconds)]
    timeout: Option<f64>,
    /// File for one JSON object per flight
    #[arg(long)]
    json: Option<PathBuf>,
    /// Go on behind the flights that stand in the file of --json already
    #[arg(long, requires = "json")]
    resume: bool,
    /// Folder for a picture of every flight that neither reached its goal nor stopped where it had to
    #[arg(long)]
    svg: Option<PathBuf>,
    /// Make a page of the campaign, with pictures of what failed, which opens in any browser
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Fly everything once with each of these values: speed=3,5,7 (m/s), range=2,4,8 (of every sensor, m), latency=0,50,150 (of
    /// every frame, ms), or tube=1,1.5,2 (tracking error that plans assume, over that of the profile)
    #[arg(long, value_name = "NAME=VALUE,...")]
    vary: Option<Variations>,
    /// File for a plot over the values of --vary
    #[arg(long, requires = "vary", value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Print a line per flight
    #[arg(long, short)]
    verbose: bool,
}

fn speed(text: &str) -> Result<f64, String> {
    arguments::number(text, OA_SPD_MAX.min..=OA_SPD_MAX.max)
}

fn density(text: &str) -> Result<f64, String> {
    arguments::number(text, 0.001..=MAX_DENSITY_PER_M2)
}

fn pairing(text: &str) -> Result<Pairing, String> {
    Pairing::named(text).ok_or_else(|| {
        let names: Vec<&str> = Pairing::names().collect();
        let near = DidYouMean(nearest(text, Pairing::names()));
        format!("there are {}{near}", names.join(", "))
    })
}

fn seeds(text: &str) -> Result<(u64, u64), String> {
    let parts = text.split_once("..").ok_or("expected FIRST..LAST")?;
    match (arguments::seed(parts.0)?, arguments::seed(parts.1)?) {
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
    let arguments: Arguments = arguments::parse();
    if arguments.list {
        print!("{}", suite::list());
        return ExitCode::SUCCESS;
    }
    match fly_all(&arguments) {
        Ok(is_without_collision) => ExitCode::from(u8::from(!is_without_collision)),
        Err(error) => {
            eprintln!("jink campaign: {error}");
            ExitCode::from(2)
        }
    }
}

/// Flies and prints everything. Returns whether nothing was touched.
fn fly_all(arguments: &Arguments) -> Result<bool, String> {
    let cells = match &arguments.vary {
        Some(variations) => variations.of(&cells(arguments)?),
        None => cells(arguments)?,
    };
    for cell in &cells {
        sensors_of(&cell.sensors)?;
    }
    if let Some(folder) = &arguments.svg {
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    if let Some(file) = &arguments.report {
        places::writable(file).map_err(|error| format!("{}: {error}", file.display()))?;
    }
    let begin = Instant::now();
    let mut pictures = Pictures::new();
    let reports = run(arguments, &cells, &mut pictures)?;
    print(arguments, &cells, &reports, begin.elapsed().as_secs_f64());
    if let Some((file, variations)) = arguments.plot.as_ref().zip(arguments.vary.as_ref())
        && let Some(svg) = plot::svg(variations.quantity, &reports)
    {
        write(file, &svg)?;
    }
    if let Some(file) = &arguments.report {
        let command: Vec<String> = std::env::args().skip(1).collect();
        let command = format!("jink campaign {}", command.join(" "));
        write(file, &page::page(&command, &reports, &pictures))?;
        println!("report: {}", file.display());
    }
    Ok(reports.iter().all(|report| report.collisions == 0))
}

fn write(file: &Path, text: &str) -> Result<(), String> {
    std::fs::write(file, text).map_err(|error| format!("{}: {error}", file.display()))
}

/// What is to be flown.
fn cells(arguments: &Arguments) -> Result<Vec<Cell>, String> {
    if let Some(suite) = Suite::named(&arguments.suite) {
        return suite.cells(&Choice {
            cells: arguments.cell.clone(),
            density_per_m2: arguments.density,
            speed_mps: arguments.speed,
            sensor: arguments.sensor.clone(),
            limit_s: arguments.timeout,
        });
    }
    if !arguments.cell.is_empty() {
        return Err(format!(
            "--cell: {} is no suite, it has no cells",
            arguments.suite
        ));
    }
    let kind: WorldKind = arguments
        .suite
        .parse()
        .map_err(|error| format!("{error}; suites are S1 to S5"))?;
    Ok(vec![Cell {
        suite: None,
        sensors: sensor_set(arguments.sensor.as_deref().unwrap_or(SPHERE))?,
        kind,
        density_per_m2: arguments.density,
        speed_mps: arguments.speed.unwrap_or(3.0),
        limit_s: arguments.timeout.unwrap_or(120.0),
        radius_m: None,
        hindrance: Hindrance::None,
        variation: None,
    }])
}

fn profile(arguments: &Arguments) -> Pairing {
    let of_suite = Suite::named(&arguments.suite).map(|_| PX4_CURRENT);
    arguments.profile.or(of_suite).unwrap_or(PX4_TRAJECTORY)
}

/// Pictures of what failed, by their names.
type Pictures = BTreeMap<String, String>;

/// Flies all seeds of this shard in all cells on `jobs` threads; reports come back in order of cell and seed.
fn run(arguments: &Arguments, cells: &[Cell], pictures: &mut Pictures) -> Result<Vec<FlightReport>, String> {
    let (shard, shards) = arguments.shard;
    let (mut file, mut reports) = match &arguments.json {
        Some(path) => recorded::open(path, arguments.resume).map(|(file, reports)| (Some(file), reports))?,
        None => (None, Vec::new()),
    };
    let seeds = (arguments.seeds.0..=arguments.seeds.1).filter(|seed| seed % shards == shard - 1);
    let is_flown = |cell: &Cell, seed: u64| {
        let mut flown = reports.iter();
        flown.any(|report| report.seed == seed && is_of(report, arguments, cell))
    };
    let open: Vec<(&Cell, u64)> = seeds
        .flat_map(|seed| cells.iter().map(move |cell| (cell, seed)))
        .filter(|(cell, seed)| !is_flown(cell, *seed))
        .collect();
    let (resumed, all) = (reports.len(), reports.len() + open.len());
    let begin = Instant::now();
    let (sender, receiver) = mpsc::channel();
    let next = std::sync::atomic::AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..arguments.jobs {
            let (sender, next, open) = (sender.clone(), &next, &open);
            scope.spawn(move || {
                while let Some((cell, seed)) =
                    open.get(next.fetch_add(1, std::sync::atomic::Ordering::Relaxed))
                {
                    if sender.send(fly(arguments, cell, *seed)).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        for answer in receiver {
            let flown = answer?;
            if page::failed(&flown.report) && (arguments.svg.is_some() || arguments.report.is_some()) {
                let (name, svg) = (page::picture_of(&flown.report), picture(&flown)?);
                if let Some(folder) = &arguments.svg {
                    write(&folder.join(&name), &svg)?;
                }
                pictures.insert(name, svg);
            }
            if let Some(file) = &mut file {
                recorded::write(file, &flown.report)?;
            }
            if arguments.verbose {
                println!("{}", table::line(&flown.report));
            }
            reports.push(flown.report);
            if !arguments.verbose {
                let done = reports.len() - resumed;
                let left_s = begin.elapsed().as_secs_f64() / done as f64 * (open.len() - done) as f64;
                eprint!("\r{} of {all} flights, {left_s:.0} s left   ", reports.len());
            }
        }
        Ok::<(), String>(())
    })?;
    if !arguments.verbose {
        eprintln!();
    }
    let place = |report: &FlightReport| cells.iter().position(|cell| is_of(report, arguments, cell));
    reports.sort_by_key(|report| (place(report), report.seed));
    Ok(reports)
}

/// Whether a report is of a flight of `cell` as the arguments have it.
fn is_of(report: &FlightReport, arguments: &Arguments, cell: &Cell) -> bool {
    let (suite, name) = cell.suite.unwrap_or(("", cell.kind.name()));
    report.suite == suite
        && report.cell == name
        && report.profile == profile(arguments).name()
        && report.sensor == cell.sensors.name
        && report.process == arguments.process
        && report.station == arguments.station
        && report.limit_s == cell.limit_s
        && report.speed_mps == cell.speed_mps
        && report.variation == cell.variation
        && report.density_per_m2 == cell.density_per_m2.or(cell.kind.density_per_m2())
}

fn fly(arguments: &Arguments, cell: &Cell, seed: u64) -> Result<FlownFlight, String> {
    let profile = profile(arguments);
    let mut setup = profile.fly(setup(cell, seed)?)?;
    arguments.station.plan(&mut setup.plan);
    setup.planner.clone_from(&arguments.process);
    let mut flown = fly_drawn(setup, cell)?;
    profile.name().clone_into(&mut flown.report.profile);
    flown.report.station = arguments.station;
    flown.report.process.clone_from(&arguments.process);
    Ok(flown)
}

/// The picture of a flight that did not do what it should.
fn picture(flown: &FlownFlight) -> Result<String, String> {
    let report = &flown.report;
    let title = format!(
        "{} seed {}: {:?} after {:.0} s {}",
        report.cell, report.seed, report.outcome, report.time_s, report.reason
    );
    flown.course.svg(&flown.world, &title)
}

fn print(arguments: &Arguments, cells: &[Cell], reports: &[FlightReport], wall_s: f64) {
    let flown = table::by_cell(reports);
    let sensors: Vec<_> = cells.iter().map(|cell| cell.sensors.name.as_str()).collect();
    let sensor = if sensors.windows(2).all(|pair| pair[0] == pair[1]) {
        sensors[0]
    } else {
        "several sensors"
    };
    let speed = match cells {
        [cell] => format!("{} m/s", cell.speed_mps),
        _ => arguments.speed.map_or_else(
            || "the speed of each cell".to_owned(),
            |speed| format!("{speed} m/s"),
        ),
    };
    println!(
        "{} with {sensor} at {speed}, {:?}, station {:?}, {} flights",
        arguments.suite,
        profile(arguments).profile,
        arguments.station,
        reports.len()
    );
    if let [only] = &flown[..] {
        print!("{}", table::summary(only, wall_s));
        return;
    }
    print!("{}", table::table(&flown));
    let all: Vec<&FlightReport> = reports.iter().collect();
    let certified: u32 = reports.iter().map(|report| report.collisions_certified).sum();
    println!("static collisions under a certificate: {certified}");
    println!("hash {:016x}, wall time {wall_s:.1} s", table::hash(&all));
    if Suite::named(&arguments.suite).is_some() {
        println!(
            "radius of the vehicle {} m; targets and published figures: docs/campaigns.md",
            suite::RADIUS_M
        );
    }
}
