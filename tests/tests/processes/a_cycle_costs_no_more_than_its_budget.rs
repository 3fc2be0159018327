//! What one cycle of each service costs: system calls, and requests to the allocator, in a flight of the real processes. Neither depends
//! on how fast the machine is. The budgets are in `budgets.toml` beside this file; a cycle that costs more fails with
//! the numbers, and a change that makes it cheaper lowers the budget.

use jink_runtime::{Checks, Instance, Session, now};
use jink_shared_types::topics;
use jink_tests::processes::{Flight, TempFolder, workspace};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// How long is counted.
const WINDOW: Duration = Duration::from_secs(6);

/// What a cycle may cost, on average over the flight.
#[derive(Clone, Copy, Debug, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Budget {
    syscalls: f64,
    allocations: f64,
}

fn source_folder() -> PathBuf {
    workspace().join("tests/tests/processes")
}

fn budgets() -> BTreeMap<String, Budget> {
    let text = std::fs::read_to_string(source_folder().join("budgets.toml")).unwrap();
    toml::from_str(&text).unwrap()
}

/// The library that counts allocations, compiled into `folder`.
fn counting_library(folder: &Path) -> Result<PathBuf, String> {
    let library = folder.join("count_allocations.so");
    let compiled = Command::new("cc")
        .args(["-O1", "-shared", "-fPIC", "-o"])
        .arg(&library)
        .arg(source_folder().join("preload/count_allocations.c"))
        .status();
    match compiled {
        Ok(status) if status.success() => Ok(library),
        other => Err(format!("no C compiler: {other:?}")),
    }
}

/// A `strace` that counts the calls of one process.
struct Tracer {
    child: Child,
    file: PathBuf,
}

impl Tracer {
    fn attach(folder: &Path, pid: u32) -> Result<Self, String> {
        let file = folder.join(format!("{pid}.calls"));
        let child = Command::new("strace")
            .args(["-f", "-c", "-qq", "-U", "calls,name", "-o"])
            .arg(&file)
            .args(["-p", &pid.to_string()])
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|error| format!("no strace: {error}"))?;
        Ok(Self { child, file })
    }

    /// Lets go of the process; the calls counted.
    fn end(mut self) -> Option<f64> {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).ok()?;
        self.child.wait().ok()?;
        let text = std::fs::read_to_string(&self.file).ok()?;
        let total = text.lines().find(|line| line.trim_end().ends_with("total"))?;
        total.split_whitespace().next()?.parse().ok()
    }
}

/// Requests to the allocator since the start of `pid`.
fn allocations(folder: &Path, pid: u32) -> Option<f64> {
    let bytes = std::fs::read(folder.join(pid.to_string())).ok()?;
    Some(u64::from_ne_bytes(bytes.try_into().ok()?) as f64)
}

#[test]
fn no_service_costs_more_than_its_budget_in_flight() {
    let budgets = budgets();
    let folder = TempFolder::new("budgets");
    let library = match counting_library(folder.path()) {
        Ok(library) => library,
        Err(why) => {
            eprintln!("NOT COUNTED, {why}");
            return;
        }
    };
    let flight = Flight::begin_in(
        &["--seed", "1", "--legs", "4"],
        &[
            ("LD_PRELOAD", library.as_path()),
            ("JINK_ALLOCATIONS", folder.path()),
        ],
    );
    flight.until_it_flies();
    // Every path has been walked once, and every buffer has its size.
    std::thread::sleep(Duration::from_secs(3));
    let instance: Instance = flight.instance().parse().unwrap();
    let session = Session::open(&instance, "cli").unwrap();
    let mut health: BTreeMap<&String, _> = budgets
        .keys()
        .map(|name| {
            (
                name,
                session
                    .input(topics::HEALTH, name)
                    .unwrap()
                    .with_checks(Checks::None),
            )
        })
        .collect();
    std::thread::sleep(Duration::from_millis(200));
    let mut look = |name: &String| {
        let beat = health.get_mut(name)?.latest(now()).fresh()?.sample;
        Some((beat.pid, beat.cycles))
    };
    let pids: BTreeMap<&String, u32> = budgets.keys().map(|name| (name, look(name).unwrap().0)).collect();

    // First what is allocated, then the calls: whoever is traced is slower.
    let begin: Vec<_> = budgets
        .keys()
        .map(|name| {
            (
                look(name).unwrap(),
                allocations(folder.path(), pids[name]).unwrap(),
            )
        })
        .collect();
    std::thread::sleep(WINDOW);
    let end: Vec<_> = budgets
        .keys()
        .map(|name| {
            (
                look(name).unwrap(),
                allocations(folder.path(), pids[name]).unwrap(),
            )
        })
        .collect();
    let allocated: Vec<f64> = begin
        .iter()
        .zip(&end)
        .map(|((before, from), (after, to))| {
            assert_eq!(before.0, after.0, "a service was started again");
            (to - from) / (after.1 - before.1) as f64
        })
        .collect();

    let tracers: Result<Vec<Tracer>, String> = pids
        .values()
        .map(|pid| Tracer::attach(folder.path(), *pid))
        .collect();
    let called: Vec<Option<f64>> = match tracers {
        Ok(tracers) => {
            std::thread::sleep(Duration::from_millis(500));
            let begin: Vec<u64> = budgets.keys().map(|name| look(name).unwrap().1).collect();
            std::thread::sleep(WINDOW);
            let end: Vec<u64> = budgets.keys().map(|name| look(name).unwrap().1).collect();
            let seconds = (WINDOW + Duration::from_millis(500)).as_secs_f64() / WINDOW.as_secs_f64();
            let cycles = begin
                .iter()
                .zip(&end)
                .map(|(begin, end)| (end - begin) as f64 * seconds);
            tracers
                .into_iter()
                .zip(cycles)
                .map(|(tracer, cycles)| tracer.end().map(|calls| calls / cycles))
                .collect()
        }
        Err(why) => {
            eprintln!("SYSTEM CALLS NOT COUNTED, {why}");
            vec![None; budgets.len()]
        }
    };
    drop(health);
    drop(session);
    drop(flight);

    let mut table = format!(
        "{:20} {:>22} {:>22}\n",
        "", "system calls / cycle", "allocations / cycle"
    );
    let mut too_much = Vec::new();
    for (((name, budget), allocated), called) in budgets.iter().zip(&allocated).zip(&called) {
        let called_text = called.map_or("-".to_owned(), |called| format!("{called:.1}"));
        let _never_fails = writeln!(
            table,
            "{name:20} {called_text:>10} of {:>6.1}   {allocated:>10.1} of {:>6.1}",
            budget.syscalls, budget.allocations
        );
        if *allocated > budget.allocations || called.is_some_and(|called| called > budget.syscalls) {
            too_much.push(name.as_str());
        }
    }
    println!("{table}");
    assert!(
        too_much.is_empty(),
        "over budget: {}\n{table}",
        too_much.join(", ")
    );
}
