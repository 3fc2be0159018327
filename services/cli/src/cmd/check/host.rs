//! `jink check host`.

use super::{Outcome, Progress};
use jink_cli::host::{Asked, Host, WakeUps};
use jink_control::findings::Findings;
use jink_control::{Interrupt, Problem, places};
use jink_runtime::config::PROCESS_FILE;
use jink_runtime::procfs::CpuTimes;
use jink_runtime::realtime::{Scheduling, schedule};
use jink_shared_types::quantile::quantiles;
use rustix::process::{Resource, getrlimit};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A measured thread sleeps for so long.
const SLEEP: Duration = Duration::from_millis(1);
/// The lowest priority there is: enough to be ahead of everybody without one.
const PRIORITY: u8 = 1;
/// CAP_IPC_LOCK in the sets of `/proc/self/status` (capabilities(7)).
const CAP_IPC_LOCK: u32 = 14;
/// What a small vehicle's processes lock at most (bytes).
const LOCKED_BYTES: u64 = 256 << 20;

/// For how long, for which configuration.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// How long wake-ups are measured, half of it with SCHED_FIFO (s)
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub(super) seconds: u32,
    /// Configuration folder; without it ./config, /etc/jink or that of the checkout
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    /// One JSON object instead of a table
    #[arg(long)]
    pub(super) json: bool,
}

/// The rows of the process table, as far as they ask something of the board.
#[derive(Debug, Default, Deserialize)]
struct Table {
    #[serde(default)]
    defaults: Row,
    #[serde(default)]
    process: Vec<Row>,
}

#[derive(Debug, Default, Deserialize)]
struct Row {
    core: Option<usize>,
    priority: Option<u8>,
    lock_memory: Option<bool>,
}

fn asked(folder: &Path) -> Result<Asked, String> {
    let file = folder.join(PROCESS_FILE);
    let text = std::fs::read_to_string(&file).map_err(|error| format!("{}: {error}", file.display()))?;
    let table: Table =
        toml::from_str(&text).map_err(|error| format!("{}: {}", file.display(), error.to_string().trim()))?;
    let Table { defaults, process } = table;
    let count = |is: &dyn Fn(&Row) -> bool| process.iter().filter(|row| is(row)).count();
    let mut cores: Vec<usize> = process
        .iter()
        .filter_map(|row| row.core.or(defaults.core))
        .collect();
    cores.sort_unstable();
    cores.dedup();
    Ok(Asked {
        priorities: count(&|row| row.priority.or(defaults.priority).unwrap_or(0) > 0),
        locked: count(&|row| row.lock_memory.or(defaults.lock_memory).unwrap_or(false)),
        cores,
    })
}

/// How late a thread is woken that sleeps again and again (ms), under `scheduling`; empty if that is refused.
fn wake_ups(scheduling: Scheduling, window: Duration, interrupt: &Interrupt) -> Vec<f64> {
    let interrupt = interrupt.clone();
    let thread = std::thread::spawn(move || {
        let mut late_ms = Vec::new();
        if schedule(0, scheduling).is_err() {
            return late_ms;
        }
        let begin = Instant::now();
        while begin.elapsed() < window && !interrupt.has_come() {
            let slept = Instant::now();
            std::thread::sleep(SLEEP);
            late_ms.push((slept.elapsed().saturating_sub(SLEEP)).as_secs_f64() * 1e3);
        }
        late_ms
    });
    thread.join().unwrap_or_default()
}

/// Whether memory may be locked, by right or by a limit that is high enough.
fn may_lock_memory() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let set = effective
        .and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok())
        .unwrap_or(0);
    set >> CAP_IPC_LOCK & 1 == 1
        || getrlimit(Resource::Memlock)
            .current
            .is_none_or(|bytes| bytes >= LOCKED_BYTES)
}

/// Reads what the board is set up for, and measures how late it wakes a thread.
pub fn run(args: &Args) -> Result<Outcome, Problem> {
    let begin = Instant::now();
    let asked = match asked(&places::config_folder(args.config.as_deref())?) {
        Ok(asked) => asked,
        Err(problem) => return Ok(Outcome::Refused(problem)),
    };
    let interrupt = Interrupt::listen()?;
    let mut screen = Progress::default();
    screen.show(&format!("measuring wake-ups for {} s ...", args.seconds));
    let before = CpuTimes::now();
    let half = Duration::from_secs_f64(f64::from(args.seconds) / 2.0);
    let wake_ups = WakeUps {
        ordinary_ms: wake_ups(Scheduling::Ordinary, half, &interrupt),
        fifo_ms: wake_ups(Scheduling::Fifo(PRIORITY), half, &interrupt),
    };
    screen.clear();
    if interrupt.has_come() {
        return Ok(Outcome::Interrupted);
    }
    let stolen_percent = before.zip(CpuTimes::now()).map_or(0.0, |(before, after)| {
        let all = after.all.all.saturating_sub(before.all.all).max(1);
        100.0 * after.all.stolen.saturating_sub(before.all.stolen) as f64 / all as f64
    });
    let host = Host {
        may_have_priority: !wake_ups.fifo_ms.is_empty(),
        may_lock_memory: may_lock_memory(),
        wake_ups,
        stolen_percent,
        asked,
        ..Host::read(Path::new("/"))
    };
    let findings = Findings {
        findings: host.findings(),
        subject: format!(
            "{}, {}",
            jink_control::provenance::cpu(),
            host.version.split(" (").next().unwrap_or_default()
        ),
        seconds: begin.elapsed().as_secs_f64(),
    };
    Ok(Outcome::Found(findings, figures(&host), String::new()))
}

fn figures(host: &Host) -> Map<String, Value> {
    let of = |late_ms: &[f64]| {
        quantiles(late_ms, [0.5, 0.99, 1.0])
            .map(|[p50, p99, max]| json!({ "n": late_ms.len(), "p50_ms": p50, "p99_ms": p99, "max_ms": max }))
    };
    let mut figures = Map::new();
    figures.insert(
        "wake_up_ordinary".to_owned(),
        json!(of(&host.wake_ups.ordinary_ms)),
    );
    figures.insert("wake_up_fifo".to_owned(), json!(of(&host.wake_ups.fifo_ms)));
    figures.insert("stolen_percent".to_owned(), json!(host.stolen_percent));
    figures
}

#[cfg(test)]
mod tests {
    use super::asked;
    use jink_cli::host::Asked;
    use jink_testkit::temp_folder::TempFolder;

    #[test]
    fn what_the_process_table_asks_for_is_counted() {
        let folder = TempFolder::new("asked");
        let text = "[defaults]\nlock_memory = true\n[[process]]\nname = \"a\"\ncore = 2\npriority = 5\n\
                    [[process]]\nname = \"b\"\ncore = 2\nlock_memory = false\n[[process]]\nname = \"c\"\n";
        folder.write("services.toml", text);
        let wanted = Asked {
            priorities: 1,
            locked: 2,
            cores: vec![2],
        };
        assert_eq!(asked(&folder), Ok(wanted));
        folder.write("services.toml", "[[process]\n");
        assert!(asked(&folder).unwrap_err().contains("services.toml"));
        std::fs::remove_dir_all(&*folder).unwrap();
        assert!(asked(&folder).is_err());
    }
}
