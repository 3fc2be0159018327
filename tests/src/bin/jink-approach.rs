//! How a vehicle that is pushed at obstacles comes to rest: jink and PX4 side by side, in lock-step.

use clap::Parser;
use jink_control::arguments;
use jink_tests::approach::{
    Approach, Ending, Filter, Moment, Scene, Who, cells, fly, is_drawn, plots, table,
};
use std::fs::File;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Instant;

/// Pushes a vehicle at walls, posts, corners, gaps, corridors and people, with jink's collision prevention and with PX4's own; prints one
/// table and, on request, one JSON line per approach and plots
///
/// Exit codes: 0 nothing was hit with jink; 1 something was; 2 wrong arguments.
#[derive(Parser)]
#[command(name = "jink approach", bin_name = "jink approach", version)]
struct Arguments {
    /// Only these scenes: wall, post, corner, narrow_gap, wide_gap, corridor, crossing, towards
    #[arg(long, value_delimiter = ',', value_parser = scene)]
    scene: Vec<Scene>,
    /// Only these speeds (m/s)
    #[arg(long, value_delimiter = ',', value_parser = speed)]
    speed: Vec<f64>,
    /// Only these delays of the sensor (s)
    #[arg(long, value_delimiter = ',', value_parser = delay)]
    delay: Vec<f64>,
    /// A few speeds and delays, everything head-on
    #[arg(long)]
    quick: bool,
    /// Approaches at a time
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: u16,
    /// File for one JSON object per approach
    #[arg(long)]
    json: Option<PathBuf>,
    /// Folder for plots
    #[arg(long)]
    svg: Option<PathBuf>,
}

fn speed(text: &str) -> Result<f64, String> {
    arguments::number(text, 0.1..=20.0)
}

fn delay(text: &str) -> Result<f64, String> {
    arguments::number(text, 0.0..=2.0)
}

fn scene(name: &str) -> Result<Scene, String> {
    Scene::named(name).ok_or_else(|| {
        let names: Vec<_> = Scene::ALL.iter().map(|scene| scene.name()).collect();
        format!("expected one of {}", names.join(", "))
    })
}

fn main() -> ExitCode {
    let arguments: Arguments = arguments::parse();
    let begin = Instant::now();
    match run(&arguments) {
        Ok(approaches) => {
            print!("{}", table(&approaches));
            println!(
                "\n{} approaches, wall time {:.0} s",
                approaches.len(),
                begin.elapsed().as_secs_f64()
            );
            let hits = |a: &Approach| {
                a.cell.who == Who::Jink && a.ending == Ending::Collision && a.cell.scene != Scene::Towards
            };
            ExitCode::from(u8::from(approaches.iter().any(hits)))
        }
        Err(error) => {
            eprintln!("jink approach: {error}");
            ExitCode::from(2)
        }
    }
}

/// Flies all of them on `jobs` threads; they come back in their order.
fn run(arguments: &Arguments) -> Result<Vec<Approach>, String> {
    let wanted = cells(&Filter {
        scenes: arguments.scene.clone(),
        speeds_mps: arguments.speed.clone(),
        delays_s: arguments.delay.clone(),
        is_quick: arguments.quick,
    });
    let unwritable = |path: &PathBuf, error: std::io::Error| format!("{}: {error}", path.display());
    let mut lines = match &arguments.json {
        Some(path) => Some((path, File::create(path).map_err(|error| unwritable(path, error))?)),
        None => None,
    };
    let (sender, receiver) = mpsc::channel();
    let next = AtomicUsize::new(0);
    let mut flown: Vec<(usize, Approach, Vec<Moment>)> = Vec::with_capacity(wanted.len());
    std::thread::scope(|scope| {
        for _ in 0..arguments.jobs {
            let (sender, next, wanted) = (sender.clone(), &next, &wanted);
            scope.spawn(move || {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(cell) = wanted.get(index) else { return };
                    if sender.send((index, *cell, fly(cell))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        for (index, cell, answer) in receiver {
            let (approach, moments) = answer.map_err(|error| format!("{}: {error}", cell.name()))?;
            if let Some((path, file)) = &mut lines {
                let line = serde_json::to_string(&approach).map_err(|error| error.to_string())?;
                writeln!(file, "{line}").map_err(|error| unwritable(path, error))?;
            }
            let keep = arguments.svg.is_some() && is_drawn(&cell, wanted.len());
            flown.push((index, approach, if keep { moments } else { Vec::new() }));
            eprint!("\r{} of {} approaches", flown.len(), wanted.len());
        }
        eprintln!();
        Ok::<(), String>(())
    })?;
    flown.sort_by_key(|(index, ..)| *index);
    let flown: Vec<(Approach, Vec<Moment>)> = flown.into_iter().map(|(_, a, m)| (a, m)).collect();
    if let Some(folder) = &arguments.svg {
        let write = || -> std::io::Result<()> {
            std::fs::create_dir_all(folder)?;
            for (name, text) in plots(&flown) {
                std::fs::write(folder.join(name), text)?;
            }
            Ok(())
        };
        write().map_err(|error| unwritable(folder, error))?;
    }
    Ok(flown.into_iter().map(|(approach, _)| approach).collect())
}
