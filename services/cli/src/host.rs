//! What the board is set up for, as far as it bears on how late a process is woken: read from the kernel's files, and judged.
//!
//! | finding | reads |
//! |---|---|
//! | kernel | `/sys/kernel/realtime`, `/proc/version` |
//! | governor | `/sys/devices/system/cpu/cpu*/cpufreq/scaling_governor` |
//! | isolation | `/sys/devices/system/cpu/isolated`, `/proc/irq/default_smp_affinity`, the process table's cores |
//! | clock | `/sys/devices/system/clocksource/clocksource0/current_clocksource` |
//! | throttle | `/proc/sys/kernel/sched_rt_runtime_us` |
//! | swap | `/proc/swaps`, `/proc/sys/vm/swappiness` |
//! | heat | `/sys/class/thermal/thermal_zone*/temp` |
//! | rights | what was granted to a thread that asked |
//! | wake-up | how late a thread was woken that slept a millisecond, again and again |

use jink_control::findings::{Finding, Grade};
use jink_shared_types::quantile::quantiles;
use std::path::Path;

/// Above this a processor is slowed down soon, or already (deg C).
const HOT_DEG_C: f64 = 85.0;
/// A 99th percentile above this is a good part of a planner's period (ms).
const LATE_P99_MS: f64 = 1.0;
/// A wake-up later than this misses a setpoint's period at 50 Hz (ms).
const LATE_MAX_MS: f64 = 10.0;
/// Processor time that a hypervisor may have given to others without a word (percent of all).
const STOLEN_PERCENT: f64 = 1.0;
/// Clocks that are read without a system call.
const FAST_CLOCKS: [&str; 4] = [
    "tsc",
    "kvm-clock",
    "arch_sys_counter",
    "hyperv_clocksource_tsc_page",
];

/// How late a thread was woken (ms), in the order of measurement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WakeUps {
    /// Without a priority.
    pub ordinary_ms: Vec<f64>,
    /// With SCHED_FIFO; empty if that was refused.
    pub fifo_ms: Vec<f64>,
}

/// What the process table asks for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Asked {
    /// Processes with a SCHED_FIFO priority.
    pub priorities: usize,
    /// Processes that lock their memory.
    pub locked: usize,
    /// Cores that processes are to stay on.
    pub cores: Vec<usize>,
}

/// What is known of the board.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Host {
    /// First line of `/proc/version`.
    pub version: String,
    /// PREEMPT_RT, as the kernel says of itself.
    pub is_realtime: bool,
    /// Governors of all cores; empty where the frequency is not ours to choose.
    pub governors: Vec<String>,
    /// Cores that exist.
    pub cores: usize,
    /// Cores that the scheduler gives to nobody who does not ask.
    pub isolated: Vec<usize>,
    /// Cores that interrupts go to by default, one bit each; `None` if the kernel does not say.
    pub interrupts: Option<u64>,
    /// The clock.
    pub clock: String,
    /// Of every second, what real-time processes may take (us); -1 = all of it; `None` if the kernel does not say.
    pub throttle_us: Option<i64>,
    /// Swap areas.
    pub swaps: usize,
    /// How readily the kernel swaps.
    pub swappiness: Option<u32>,
    /// The hottest sensor (deg C).
    pub hottest_deg_c: Option<f64>,
    /// SCHED_FIFO was granted.
    pub may_have_priority: bool,
    /// Memory may be locked.
    pub may_lock_memory: bool,
    /// How late threads were woken.
    pub wake_ups: WakeUps,
    /// Processor time that the hypervisor gave to others meanwhile (percent).
    pub stolen_percent: f64,
    /// What the process table asks for.
    pub asked: Asked,
}

fn text(root: &Path, file: &str) -> String {
    let text = std::fs::read_to_string(root.join(file)).unwrap_or_default();
    text.trim().to_owned()
}

/// Numbers of a list like `0,2-3`.
fn cores_of(list: &str) -> Vec<usize> {
    let parts = list.split(',').filter_map(|part| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        Some(first.trim().parse().ok()?..=last.trim().parse().ok()?)
    });
    parts.flatten().collect()
}

impl Host {
    /// What the files below `root` say (`/` on a board).
    pub fn read(root: &Path) -> Self {
        let version = text(root, "proc/version");
        let folder = |name: &str| {
            let entries = std::fs::read_dir(root.join(name)).into_iter().flatten().flatten();
            let mut paths: Vec<_> = entries.map(|entry| entry.path()).collect();
            paths.sort();
            paths
        };
        let governors = folder("sys/devices/system/cpu")
            .into_iter()
            .map(|core| text(&core, "cpufreq/scaling_governor"))
            .filter(|governor| !governor.is_empty())
            .collect();
        let heats = folder("sys/class/thermal")
            .into_iter()
            .filter_map(|zone| text(&zone, "temp").parse().ok())
            .map(|millidegrees: f64| millidegrees * 1e-3);
        let affinity = text(root, "proc/irq/default_smp_affinity").replace(',', "");
        Self {
            is_realtime: text(root, "sys/kernel/realtime") == "1" || version.contains("PREEMPT_RT"),
            version,
            governors,
            cores: cores_of(&text(root, "sys/devices/system/cpu/online")).len(),
            isolated: cores_of(&text(root, "sys/devices/system/cpu/isolated")),
            interrupts: u64::from_str_radix(&affinity, 16).ok(),
            clock: text(
                root,
                "sys/devices/system/clocksource/clocksource0/current_clocksource",
            ),
            throttle_us: text(root, "proc/sys/kernel/sched_rt_runtime_us").parse().ok(),
            swaps: text(root, "proc/swaps").lines().skip(1).count(),
            swappiness: text(root, "proc/sys/vm/swappiness").parse().ok(),
            hottest_deg_c: heats.reduce(f64::max),
            ..Self::default()
        }
    }

    /// Everything that was found, in the order in which it is worth mending.
    pub fn findings(&self) -> Vec<Finding> {
        let mut found = vec![self.wake_up("ordinary", &self.wake_ups.ordinary_ms)];
        if !self.wake_ups.fifo_ms.is_empty() {
            found.push(self.wake_up("SCHED_FIFO", &self.wake_ups.fifo_ms));
        }
        found.extend([
            self.rights(),
            self.governor(),
            self.kernel(),
            self.isolation(),
            self.clock(),
            self.throttle(),
            self.swap(),
            self.heat(),
        ]);
        if self.stolen_percent > 0.0 {
            found.push(self.stolen());
        }
        found
    }

    fn wake_up(&self, scheduling: &str, late_ms: &[f64]) -> Finding {
        let Some([p50, p99, max]) = quantiles(late_ms, [0.5, 0.99, 1.0]) else {
            return warning("wake-up", "not measured".to_owned(), "run it again");
        };
        let is = format!(
            "{scheduling}: {p50:.3} / {p99:.3} / {max:.3} ms late (p50 / p99 / max of {})",
            late_ms.len()
        );
        match p99 > LATE_P99_MS || max > LATE_MAX_MS {
            true if scheduling == "ordinary" => warning(
                "wake-up",
                is,
                "other programs keep the cores busy: give jink's processes `priority` in services.toml, or a core of their own",
            ),
            true => warning(
                "wake-up",
                is,
                "not even a priority helps: look for the hypervisor, the firmware, long interrupts; try a PREEMPT_RT kernel",
            ),
            false => good("wake-up", is),
        }
    }

    fn rights(&self) -> Finding {
        let Asked {
            priorities, locked, ..
        } = self.asked;
        let missing: Vec<&str> = [
            (self.may_have_priority, "SCHED_FIFO"),
            (self.may_lock_memory, "locked memory"),
        ]
        .iter()
        .filter_map(|(granted, what)| (!granted).then_some(*what))
        .collect();
        let asked = format!("services.toml asks for {priorities} priorities and {locked} locked memories");
        if missing.is_empty() {
            good(
                "rights",
                format!("SCHED_FIFO and locked memory are granted; {asked}"),
            )
        } else {
            let is = format!("no {} for this user; {asked}", missing.join(", no "));
            let remedy = "start jink with CAP_SYS_NICE and CAP_IPC_LOCK (deploy/jink.service), or raise LimitRTPRIO and LimitMEMLOCK";
            if self.asked.priorities + self.asked.locked > 0 {
                warning("rights", is, remedy)
            } else {
                good("rights", is)
            }
        }
    }

    fn governor(&self) -> Finding {
        let slow: Vec<&str> = self
            .governors
            .iter()
            .map(String::as_str)
            .filter(|name| *name != "performance")
            .collect();
        match (self.governors.len(), slow.first()) {
            (0, _) => good(
                "governor",
                "the frequency of the cores is not chosen by this kernel".to_owned(),
            ),
            (cores, None) => good("governor", format!("performance on all {cores} cores")),
            (cores, Some(name)) => warning(
                "governor",
                format!(
                    "{name} on {} of {cores} cores: a core that slept begins slowly",
                    slow.len()
                ),
                "cpupower frequency-set -g performance (and at every start: a service, or cpufreq.default_governor=performance)",
            ),
        }
    }

    fn kernel(&self) -> Finding {
        let name = self.version.split_whitespace().nth(2).unwrap_or("unknown");
        let is_full = self.version.contains("PREEMPT");
        match (self.is_realtime, is_full) {
            (true, _) => good("kernel", format!("{name}, PREEMPT_RT")),
            (false, true) => good(
                "kernel",
                format!("{name}, preemptible; PREEMPT_RT bounds the longest wake-up further"),
            ),
            (false, false) => warning(
                "kernel",
                format!("{name} does not say that it is preemptible"),
                "boot with preempt=full, or a kernel with PREEMPT_RT",
            ),
        }
    }

    fn isolation(&self) -> Finding {
        let Self {
            isolated,
            cores,
            asked,
            ..
        } = self;
        let unknown: Vec<String> = asked
            .cores
            .iter()
            .filter(|core| **core >= *cores)
            .map(usize::to_string)
            .collect();
        if !unknown.is_empty() {
            return warning(
                "cores",
                format!(
                    "services.toml wants core {}, there are {cores}",
                    unknown.join(", ")
                ),
                "change `core` in services.toml: a process that cannot stay on its core runs on any",
            );
        }
        if isolated.is_empty() {
            return good(
                "cores",
                format!(
                    "{cores}, none isolated; `core` of {} processes is set",
                    asked.cores.len()
                ),
            );
        }
        let unused: Vec<String> = isolated
            .iter()
            .filter(|core| !asked.cores.contains(core))
            .map(usize::to_string)
            .collect();
        let interrupted = |core: &&usize| {
            self.interrupts
                .is_some_and(|mask| mask.checked_shr(**core as u32).unwrap_or(0) & 1 == 1)
        };
        if !unused.is_empty() {
            warning(
                "cores",
                format!(
                    "core {} is isolated and no process of services.toml is put there: it idles",
                    unused.join(", ")
                ),
                "set `core` of the flight path's processes in services.toml, or take isolcpus away",
            )
        } else if let Some(core) = isolated.iter().find(interrupted) {
            warning(
                "cores",
                format!("core {core} is isolated, but interrupts go there as well"),
                "irqaffinity= of the kernel's command line without that core, and no irqbalance",
            )
        } else {
            good(
                "cores",
                format!(
                    "{cores}, {} isolated and used, interrupts elsewhere",
                    isolated.len()
                ),
            )
        }
    }

    fn clock(&self) -> Finding {
        let clock = &self.clock;
        match clock.is_empty() || FAST_CLOCKS.contains(&clock.as_str()) {
            true => good(
                "clock",
                if clock.is_empty() {
                    "not named by this kernel".to_owned()
                } else {
                    clock.clone()
                },
            ),
            false => warning(
                "clock",
                format!("{clock}: every look at it is a system call"),
                "find out why the processor's own counter is not trusted (dmesg | grep clocksource)",
            ),
        }
    }

    fn throttle(&self) -> Finding {
        match self.throttle_us {
            None => good("throttle", "not stated by this kernel".to_owned()),
            Some(-1) => warning(
                "throttle",
                "real-time processes may take all of a core: one that never rests keeps everybody else from it".to_owned(),
                "sysctl kernel.sched_rt_runtime_us=950000",
            ),
            Some(us) => good("throttle", format!("real-time processes may take {:.0} % of a core", us as f64 * 1e-4)),
        }
    }

    fn swap(&self) -> Finding {
        match (self.swaps, self.may_lock_memory && self.asked.locked > 0) {
            (0, _) => good("swap", "none".to_owned()),
            (_, true) => good(
                "swap",
                "there is some; jink's processes keep their memory".to_owned(),
            ),
            (_, false) => warning(
                "swap",
                format!(
                    "there is some (swappiness {}), and processes do not keep their memory: a cycle may wait for a disk",
                    self.swappiness
                        .map_or("unknown".to_owned(), |value| value.to_string())
                ),
                "swapoff -a, or `lock_memory = true` in services.toml with the right to it",
            ),
        }
    }

    fn heat(&self) -> Finding {
        match self.hottest_deg_c {
            None => good("heat", "no sensor".to_owned()),
            Some(deg) if deg > HOT_DEG_C => warning(
                "heat",
                format!("{deg:.0} deg C: the cores are slowed down soon, or already"),
                "more air, a heat sink, or a lower frequency that it can hold",
            ),
            Some(deg) => good("heat", format!("{deg:.0} deg C at most")),
        }
    }

    fn stolen(&self) -> Finding {
        let is = format!(
            "{:.1} % of the processor time went to others on the same machine",
            self.stolen_percent
        );
        match self.stolen_percent > STOLEN_PERCENT {
            true => warning(
                "stolen",
                is,
                "this is a virtual machine: nothing that runs in it can help",
            ),
            false => good("stolen", is),
        }
    }
}

fn good(about: &str, is: String) -> Finding {
    Finding {
        grade: Grade::Good,
        about: about.to_owned(),
        is,
        remedy: String::new(),
    }
}

fn warning(about: &str, is: String, remedy: &str) -> Finding {
    Finding {
        grade: Grade::Warning,
        about: about.to_owned(),
        is,
        remedy: remedy.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::{Asked, Host, WakeUps};
    use jink_control::findings::Grade;
    use jink_testkit::temp_folder::TempFolder;
    use std::path::Path;

    /// A board as it should be.
    fn ready() -> Host {
        Host {
            version: "Linux version 6.12.0-rt1 (x) #1 SMP PREEMPT_RT".to_owned(),
            is_realtime: true,
            governors: vec!["performance".to_owned(); 4],
            cores: 4,
            isolated: vec![2, 3],
            interrupts: Some(0b0011),
            clock: "arch_sys_counter".to_owned(),
            throttle_us: Some(950_000),
            swaps: 0,
            swappiness: Some(60),
            hottest_deg_c: Some(60.0),
            may_have_priority: true,
            may_lock_memory: true,
            wake_ups: WakeUps {
                ordinary_ms: vec![0.05; 100],
                fifo_ms: vec![0.02; 100],
            },
            stolen_percent: 0.0,
            asked: Asked {
                priorities: 6,
                locked: 6,
                cores: vec![2, 3],
            },
        }
    }

    fn warnings(host: &Host) -> Vec<String> {
        let found = host.findings();
        let warned = found.iter().filter(|finding| finding.grade != Grade::Good);
        warned.map(|finding| finding.about.clone()).collect()
    }

    #[test]
    fn a_board_that_is_set_up_is_good_in_every_line() {
        assert_eq!(warnings(&ready()), Vec::<String>::new());
    }

    #[test]
    fn each_thing_that_makes_a_board_late_is_named_with_a_remedy() {
        type Change = fn(&mut Host);
        let changes: [(&str, Change); 12] = [
            ("wake-up", |host| host.wake_ups.ordinary_ms = vec![2.0; 100]),
            ("wake-up", |host| host.wake_ups.fifo_ms[7] = 20.0),
            ("rights", |host| host.may_have_priority = false),
            ("governor", |host| host.governors[1] = "ondemand".to_owned()),
            ("kernel", |host| {
                host.is_realtime = false;
                host.version = "Linux version 5.4 (x) #1 SMP".to_owned();
            }),
            ("cores", |host| host.asked.cores = vec![2]),
            ("cores", |host| host.interrupts = Some(0b1111)),
            ("cores", |host| host.asked.cores = vec![7]),
            ("clock", |host| host.clock = "hpet".to_owned()),
            ("throttle", |host| host.throttle_us = Some(-1)),
            ("heat", |host| host.hottest_deg_c = Some(90.0)),
            ("stolen", |host| host.stolen_percent = 5.0),
        ];
        for (about, change) in changes {
            let mut host = ready();
            change(&mut host);
            assert_eq!(warnings(&host), [about]);
            let findings = host.findings();
            let warned = findings
                .iter()
                .find(|finding| finding.grade == Grade::Warning)
                .unwrap();
            assert!(!warned.remedy.is_empty(), "{warned:?}");
        }
        let mut swapping = ready();
        swapping.swaps = 1;
        assert_eq!(
            warnings(&swapping),
            Vec::<String>::new(),
            "the processes keep their memory"
        );
        swapping.asked.locked = 0;
        assert_eq!(warnings(&swapping), ["swap"]);
    }

    #[test]
    fn files_are_read_as_the_kernel_writes_them() {
        let root = TempFolder::new("host");
        let write = |file: &str, text: &str| root.write(file, text);
        write("proc/version", "Linux version 6.1.0 (x) #1 SMP PREEMPT_DYNAMIC\n");
        write("sys/devices/system/cpu/online", "0-3\n");
        write("sys/devices/system/cpu/isolated", "2-3\n");
        write(
            "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor",
            "powersave\n",
        );
        write(
            "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor",
            "performance\n",
        );
        write(
            "sys/devices/system/clocksource/clocksource0/current_clocksource",
            "tsc\n",
        );
        write("sys/class/thermal/thermal_zone0/temp", "48312\n");
        write("sys/class/thermal/thermal_zone1/temp", "51000\n");
        write("proc/irq/default_smp_affinity", "0000,00000003\n");
        write("proc/sys/kernel/sched_rt_runtime_us", "950000\n");
        write("proc/sys/vm/swappiness", "60\n");
        write("proc/swaps", "Filename Type\n/dev/zram0 partition 1 0 100\n");
        let host = Host::read(&root);
        let expected = Host {
            version: "Linux version 6.1.0 (x) #1 SMP PREEMPT_DYNAMIC".to_owned(),
            governors: vec!["powersave".to_owned(), "performance".to_owned()],
            cores: 4,
            isolated: vec![2, 3],
            interrupts: Some(3),
            clock: "tsc".to_owned(),
            throttle_us: Some(950_000),
            swaps: 1,
            swappiness: Some(60),
            hottest_deg_c: Some(51.0),
            ..Host::default()
        };
        assert_eq!(host, expected);
        let nothing = Host::read(Path::new("/nowhere"));
        assert_eq!(nothing, Host::default());
        assert!(!nothing.findings().is_empty());
    }
}
