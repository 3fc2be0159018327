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
/// A tracer that has been started has attached after so long.
const SETTLE: Duration = Duration::from_millis(500);
/// Windows that are tried until none of the services is started again in one.
const ATTEMPTS: u32 = 4;

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
    fn end(&mut self) -> Option<f64> {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).ok()?;
        self.child.wait().ok()?;
        let text = std::fs::read_to_string(&self.file).ok()?;
        let total = text.lines().find(|line| line.trim_end().ends_with("total"))?;
        total.split_whitespace().next()?.parse().ok()
    }
}

impl Drop for Tracer {
    fn drop(&mut self) {
        // Ended already, or the process goes on without it.
        let _ended_already = self.child.kill();
        let _reaped = self.child.wait();
    }
}

/// Requests to the allocator since the start of `pid`.
fn allocations(folder: &Path, pid: u32) -> Option<f64> {
    let bytes = std::fs::read(folder.join(pid.to_string())).ok()?;
    Some(u64::from_ne_bytes(bytes.try_into().ok()?) as f64)
}

/// Requests to the allocator and system calls per cycle of each service; the latter `None` where they cannot be counted. `None` if a
/// service was started again meanwhile.
#[allow(clippy::type_complexity)]
fn count(
    budgets: &BTreeMap<String, Budget>,
    folder: &Path,
    look: &mut impl FnMut(&String, Option<u32>) -> Option<(u32, u64)>,
) -> Option<(Vec<f64>, Vec<Option<f64>>)> {
    let pids: Option<Vec<u32>> = budgets.keys().map(|name| Some(look(name, None)?.0)).collect();
    let pids = pids?;
    let services = || budgets.keys().zip(pids.iter().copied());
    // First what is allocated, then the calls: whoever is traced is slower.
    let mut allocations_at = || -> Option<Vec<(u64, f64)>> {
        services()
            .map(|(name, pid)| Some((look(name, Some(pid))?.1, allocations(folder, pid)?)))
            .collect()
    };
    let begin = allocations_at()?;
    std::thread::sleep(WINDOW);
    let end = allocations_at()?;
    let counted = begin.iter().zip(&end);
    let allocated = counted.map(|((from, before), (to, after))| (after - before) / (to - from).max(1) as f64);

    let tracers: Result<Vec<Tracer>, String> = pids.iter().map(|pid| Tracer::attach(folder, *pid)).collect();
    let called = match tracers {
        Ok(tracers) => {
            let mut cycles = || -> Option<Vec<u64>> {
                services()
                    .map(|(name, pid)| Some(look(name, Some(pid))?.1))
                    .collect()
            };
            std::thread::sleep(SETTLE);
            let begin = cycles()?;
            std::thread::sleep(WINDOW);
            let end = cycles()?;
            let traced_for = (WINDOW + SETTLE).as_secs_f64() / WINDOW.as_secs_f64();
            let cycles = begin
                .iter()
                .zip(&end)
                .map(|(from, to)| (to - from).max(1) as f64 * traced_for);
            tracers
                .into_iter()
                .zip(cycles)
                .map(|(mut tracer, cycles)| tracer.end().map(|calls| calls / cycles))
                .collect()
        }
        Err(why) => {
            eprintln!("SYSTEM CALLS NOT COUNTED, {why}");
            vec![None; budgets.len()]
        }
    };
    Some((allocated.collect(), called))
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
        &["--seed", "1", "--legs", "4", "--sensor", "sphere"],
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
    // What a service has counted, of the process that `pids` names: `None` if it was started again, or the machine stands still.
    let mut look = |name: &String, pid: Option<u32>| {
        let beat = health.get_mut(name)?.latest(now()).fresh()?.sample;
        (pid.is_none_or(|pid| pid == beat.pid)).then_some((beat.pid, beat.cycles))
    };
    // A machine that stalls has services restarted, which is no cost of theirs: what is counted then is counted again.
    let (allocated, called) = (0..ATTEMPTS)
        .find_map(|_| count(&budgets, folder.path(), &mut look))
        .expect("never a window without a restart");
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
