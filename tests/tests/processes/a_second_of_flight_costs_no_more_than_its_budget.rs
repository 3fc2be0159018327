//! What a second of flight costs each service: system calls, and requests to the allocator, of the real processes. Neither depends on how
//! fast the machine is; load merges wake-ups, which makes them fewer. The budgets are in `budgets.toml` beside this file; a service that
//! costs more fails with the numbers, and a change that makes it cheaper lowers the budget.

use crate::preload;
use jink_runtime::{Checks, Input, Instance, Session, now};
use jink_shared_types::health::Heartbeat;
use jink_shared_types::topics;
use jink_testkit::not_tested;
use jink_tests::processes::{Flight, TempFolder, until, workspace};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How long is counted.
const WINDOW: Duration = Duration::from_secs(6);
/// How long before it services have run at least.
const SETTLED: Duration = Duration::from_secs(3);
/// Windows that are tried: what costs too much does so in all of them. In one of them a busy machine may have a service started again, or
/// plans made anew: beside two busy loops and a compiler a planner once made 98 requests to the allocator per second, of 72.
const ATTEMPTS: u32 = 4;
/// How long a tracer may take to let go.
const LETS_GO: Duration = Duration::from_secs(5);

/// What a second may cost, on average over the flight.
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

    /// Lets go of the process; the calls counted. `None` also if the tracer does not end, as once that of a process that was killed.
    fn end(&mut self) -> Option<f64> {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).ok()?;
        let begun = Instant::now();
        while self.child.try_wait().ok()?.is_none() {
            if begun.elapsed() > LETS_GO {
                return None;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
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

/// Requests to the allocator and system calls per second of each service; the latter `None` where they cannot be counted. `None` if a
/// service was started again meanwhile.
#[allow(clippy::type_complexity)]
fn count(
    budgets: &BTreeMap<String, Budget>,
    folder: &Path,
    mut pids: impl FnMut() -> Vec<u32>,
) -> Option<(Vec<f64>, Vec<Option<f64>>)> {
    let flying = pids();
    // First what is allocated, then the calls: whoever is traced is slower.
    let so_far = || -> Option<Vec<f64>> { flying.iter().map(|pid| allocations(folder, *pid)).collect() };
    let (before, begun) = (so_far()?, Instant::now());
    std::thread::sleep(WINDOW);
    let (after, seconds) = (so_far()?, begun.elapsed().as_secs_f64());
    let allocated = before
        .iter()
        .zip(&after)
        .map(|(before, after)| (after - before) / seconds);

    let begun = Instant::now();
    let tracers: Result<Vec<Tracer>, String> =
        flying.iter().map(|pid| Tracer::attach(folder, *pid)).collect();
    let called = match tracers {
        Ok(mut tracers) => {
            std::thread::sleep(WINDOW);
            let calls: Vec<Option<f64>> = tracers.iter_mut().map(Tracer::end).collect();
            if calls.contains(&None) {
                not_tested("system calls of a service are not counted: its tracer did not end or say");
            }
            let seconds = begun.elapsed().as_secs_f64();
            calls
                .iter()
                .map(|calls| calls.map(|calls| calls / seconds))
                .collect()
        }
        Err(why) => {
            not_tested(&format!("system calls are not counted, {why}"));
            vec![None; budgets.len()]
        }
    };
    (pids() == flying).then(|| (allocated.collect(), called))
}

#[test]
fn no_service_costs_more_than_its_budget_in_flight() {
    let budgets = budgets();
    let folder = TempFolder::new("budgets");
    let library = match preload::library(folder.path(), "count_allocations") {
        Ok(library) => library,
        Err(why) => {
            not_tested(&format!("nothing is counted, {why}"));
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
    let mut pids = || {
        let mut pids = None;
        until("the health of all services", || {
            let pid_of = |input: &mut Input<Heartbeat>| Some(input.latest(now()).fresh()?.sample.pid);
            pids = health.values_mut().map(pid_of).collect::<Option<Vec<u32>>>();
            pids.is_some()
        });
        pids.unwrap_or_default()
    };
    let mut over = String::new();
    for _ in 0..ATTEMPTS {
        // Every path has been walked once, and every buffer has its size; also of services that have just been started again.
        std::thread::sleep(SETTLED);
        // A machine that stalls has services restarted, which is no cost of theirs.
        let Some((allocated, called)) = count(&budgets, folder.path(), &mut pids) else {
            continue;
        };
        let (too_much, table) = judged(&budgets, &allocated, &called);
        println!("{table}");
        if too_much.is_empty() {
            return;
        }
        over += &format!("over budget: {}\n{table}", too_much.join(", "));
    }
    if over.is_empty() {
        not_tested("the machine stalls too often: a service was restarted in every window");
    }
    assert!(over.is_empty(), "{over}");
}

/// The services that cost more than their budgets, and what each costs as a table.
fn judged<'a>(
    budgets: &'a BTreeMap<String, Budget>,
    allocated: &[f64],
    called: &[Option<f64>],
) -> (Vec<&'a str>, String) {
    let mut table = format!("{:20} {:>22} {:>22}\n", "", "system calls / s", "allocations / s");
    let mut too_much = Vec::new();
    for (((name, budget), allocated), called) in budgets.iter().zip(allocated).zip(called) {
        let called_text = called.map_or("-".to_owned(), |called| format!("{called:.0}"));
        let _never_fails = writeln!(
            table,
            "{name:20} {called_text:>12} of {:>6}   {allocated:>12.0} of {:>6}",
            budget.syscalls, budget.allocations
        );
        if *allocated > budget.allocations || called.is_some_and(|called| called > budget.syscalls) {
            too_much.push(name.as_str());
        }
    }
    (too_much, table)
}
