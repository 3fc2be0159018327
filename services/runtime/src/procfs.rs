//! What the kernel says of processes and of the board (proc(5)).
//!
//! | file | read as |
//! |---|---|
//! | `/proc/stat` | [`CpuTimes`] |
//! | `/proc/uptime` | [`Uptime`] |
//! | `/proc/meminfo` | [`Memory`] |
//! | `/proc/net/dev` | [`Interface`] |
//! | `/proc/<pid>/stat` | [`ProcessStat`] |
//! | `/proc/<pid>/stat`, `/proc/<pid>/status` | [`Disturbances`] |
//! | `/proc/<pid>/status` | [`resident_kib`], [`locked_kib`] |
//!
//! What is missing or not understood is `None`; what stands beside it is read all the same.

/// Ticks of a second (USER_HZ): the same on every architecture that jink runs on.
const TICKS_PER_S: f64 = 100.0;
/// The flag of a process whose exit has begun (the kernel's linux/sched.h).
const PF_EXITING: u64 = 0x4;
/// SIGKILL among signals as bits: the first one is the lowest.
const SIGKILL_PENDING: u64 = 1 << 8;

/// Empty if it is not there.
fn text(file: &str) -> String {
    std::fs::read_to_string(file).unwrap_or_default()
}

/// What a processor has done since the board was switched on (ticks of 10 ms).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CpuTicks {
    /// Neither idle nor waiting for a disk.
    pub busy: u64,
    /// All of them.
    pub all: u64,
    /// Given to others by the hypervisor; 0 where the kernel does not say.
    pub stolen: u64,
}

impl CpuTicks {
    /// Time that the hypervisor gave to others (ms).
    pub fn stolen_ms(self) -> f64 {
        self.stolen as f64 * (1e3 / TICKS_PER_S)
    }

    fn of(line: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        words.next()?.strip_prefix("cpu")?;
        // user nice system idle iowait irq softirq steal; what follows is contained in user and nice.
        let mut ticks = [0_u64; 8];
        let known = ticks.iter_mut().zip(words.map_while(|word| word.parse().ok()));
        let count = known.map(|(ticks, said)| *ticks = said).count();
        let all = ticks.iter().fold(0_u64, |sum, ticks| sum.saturating_add(*ticks));
        let [_, _, _, idle, waiting, _, _, stolen] = ticks;
        (count > 4).then(|| Self {
            busy: all.saturating_sub(idle.saturating_add(waiting)),
            all,
            stolen,
        })
    }
}

/// `/proc/stat`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CpuTimes {
    /// All processors together.
    pub all: CpuTicks,
    /// Each.
    pub cores: Vec<CpuTicks>,
}

impl CpuTimes {
    /// Now.
    pub fn now() -> Option<Self> {
        Self::of(&text("/proc/stat"))
    }

    /// Out of the text of the file.
    pub fn of(stat: &str) -> Option<Self> {
        let mut lines = stat.lines().map_while(CpuTicks::of);
        Some(Self {
            all: lines.next()?,
            cores: lines.collect(),
        })
    }
}

/// `/proc/uptime`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uptime {
    /// Since the board was switched on (s); not negative.
    pub up_s: f64,
}

impl Uptime {
    /// Now.
    pub fn now() -> Option<Self> {
        Self::of(&text("/proc/uptime"))
    }

    /// Out of the text of the file.
    pub fn of(uptime: &str) -> Option<Self> {
        let up_s: f64 = uptime.split_whitespace().next()?.parse().ok()?;
        (up_s >= 0.0).then_some(Self { up_s })
    }
}

/// `/proc/meminfo`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// All there is (KiB).
    pub total_kib: u64,
    /// What programs could still have without swapping (KiB).
    pub available_kib: u64,
}

impl Memory {
    /// Now.
    pub fn now() -> Option<Self> {
        Self::of(&text("/proc/meminfo"))
    }

    /// Out of the text of the file.
    pub fn of(meminfo: &str) -> Option<Self> {
        Some(Self {
            total_kib: number_behind("MemTotal:", meminfo)?,
            available_kib: number_behind("MemAvailable:", meminfo)?,
        })
    }
}

/// The first number of the line that begins with `name`.
fn number_behind(name: &str, text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse().ok()
}

/// A line of `/proc/net/dev`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Its name.
    pub name: String,
    /// Received since it is up (bytes).
    pub received: u64,
    /// Sent since it is up (bytes).
    pub sent: u64,
}

impl Interface {
    /// All there are now, in the kernel's order.
    pub fn all() -> Vec<Self> {
        Self::all_of(&text("/proc/net/dev"))
    }

    /// Out of the text of the file.
    pub fn all_of(net_dev: &str) -> Vec<Self> {
        let one = |line: &str| {
            let (name, numbers) = line.split_once(':')?;
            let mut numbers = numbers.split_whitespace().map_while(|word| word.parse().ok());
            Some(Self {
                name: name.trim().to_owned(),
                received: numbers.next()?,
                sent: numbers.nth(7)?,
            })
        };
        net_dev.lines().filter_map(one).collect()
    }
}

/// `/proc/<pid>/stat`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProcessStat {
    /// The letter of its state: R running, S sleeping, D waiting for a disk, I idle, T stopped, Z ended, and others.
    pub state: char,
    /// User and system time that it has used (s).
    pub cpu_s: f64,
    /// The core it runs on, or ran on last.
    pub core: usize,
    /// Its priority under SCHED_FIFO or SCHED_RR; 0 under ordinary scheduling.
    pub fifo_priority: u8,
    /// A SIGKILL is on its way, or its exit has begun: nothing of its program runs any more.
    pub is_ending: bool,
}

impl ProcessStat {
    /// That of process `pid`; `None` if it has gone.
    pub fn now(pid: u32) -> Option<Self> {
        Self::of(&text(&format!("/proc/{pid}/stat")))
    }

    /// Out of the text of the file: behind the name in parentheses, which may contain anything, the state is the first field, the
    /// kernel's flags are the 7th, user and system time the 12th and 13th, the signals on their way the 29th, the core is the 37th, the
    /// real-time priority comes behind that.
    pub fn of(stat: &str) -> Option<Self> {
        let (_, fields) = stat.rsplit_once(") ")?;
        let fields: Vec<&str> = fields.split_whitespace().collect();
        let field = |number: usize| fields.get(number - 1).copied();
        let bits = |number: usize| field(number)?.parse::<u64>().ok();
        let ticks = |number: usize| field(number)?.parse::<f64>().ok();
        Some(Self {
            state: field(1)?.chars().next()?,
            cpu_s: (ticks(12)? + ticks(13)?) / TICKS_PER_S,
            core: field(37)?.parse().ok()?,
            fifo_priority: field(38)?.parse().ok()?,
            is_ending: bits(7)? & PF_EXITING > 0 || bits(29)? & SIGKILL_PENDING > 0,
        })
    }
}

/// How often a process has been kept from computing since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Disturbances {
    /// Times it gave up its core to wait for something.
    pub waits: u64,
    /// Times its core was taken away.
    pub preemptions: u64,
    /// Pages that were found in memory when they were touched.
    pub minor_faults: u64,
    /// Pages that had to be read from a disk.
    pub major_faults: u64,
}

impl Disturbances {
    /// Those of process `pid`; `None` if it has gone.
    pub fn now(pid: u32) -> Option<Self> {
        Self::of(
            &text(&format!("/proc/{pid}/stat")),
            &text(&format!("/proc/{pid}/status")),
        )
    }

    /// Out of the texts of the two files: of the first, behind the name in parentheses, the 8th and the 10th field.
    pub fn of(stat: &str, status: &str) -> Option<Self> {
        let (_, fields) = stat.rsplit_once(") ")?;
        let mut fields = fields.split_whitespace().skip(7);
        Some(Self {
            minor_faults: fields.next()?.parse().ok()?,
            major_faults: fields.nth(1)?.parse().ok()?,
            waits: number_behind("voluntary_ctxt_switches:", status)?,
            preemptions: number_behind("nonvoluntary_ctxt_switches:", status)?,
        })
    }

    /// What has been added since `before`.
    pub fn since(self, before: Self) -> Self {
        Self {
            waits: self.waits.saturating_sub(before.waits),
            preemptions: self.preemptions.saturating_sub(before.preemptions),
            minor_faults: self.minor_faults.saturating_sub(before.minor_faults),
            major_faults: self.major_faults.saturating_sub(before.major_faults),
        }
    }
}

/// Resident memory of process `pid`, shared memory it has touched included (KiB); `None` if it has gone.
pub fn resident_kib(pid: u32) -> Option<u64> {
    number_behind("VmRSS:", &text(&format!("/proc/{pid}/status")))
}

/// Memory of process `pid` that stays where it is once touched (KiB); `None` if it has gone.
pub fn locked_kib(pid: u32) -> Option<u64> {
    number_behind("VmLck:", &text(&format!("/proc/{pid}/status")))
}

#[cfg(test)]
mod tests {
    use super::{CpuTicks, CpuTimes, Disturbances, Interface, Memory, ProcessStat, Uptime, resident_kib};
    use proptest::prelude::*;

    #[test]
    fn the_kernels_words_are_understood() {
        let stat = "cpu  100 0 50 800 50 0 0 7 0 0\ncpu0 50 0 25 400 25\ncpu1 50 0 25 400\nintr 1 2 3\n";
        let times = CpuTimes::of(stat).unwrap();
        let all = CpuTicks {
            busy: 157,
            all: 1007,
            stolen: 7,
        };
        assert_eq!((times.all, all.stolen_ms()), (all, 70.0));
        let core = CpuTicks {
            busy: 75,
            all: 500,
            stolen: 0,
        };
        assert_eq!(times.cores, [core], "a line that is too short ends them");
        assert_eq!(Uptime::of("12.34 20.00\n").map(|uptime| uptime.up_s), Some(12.34));
        assert_eq!(Uptime::of("-1 2"), None);
        let meminfo = "MemTotal:        4096000 kB\nMemFree: 1 kB\nMemAvailable:    1024000 kB\n";
        let memory = Memory {
            total_kib: 4_096_000,
            available_kib: 1_024_000,
        };
        assert_eq!(Memory::of(meminfo), Some(memory));
        let links = Interface::all_of(
            "Inter-| Receive\n lo: 9 9 0 0 0 0 0 0 9 9\n  wlan0: 5 1 0 0 0 0 0 0 6 1 0 0\n x: 1\n",
        );
        let seen: Vec<_> = links
            .iter()
            .map(|link| (link.name.as_str(), link.received, link.sent))
            .collect();
        assert_eq!(seen, [("lo", 9, 9), ("wlan0", 5, 6)]);
    }

    #[test]
    fn a_process_is_understood_whatever_its_name() {
        let rest = "1 2 2 0 -1 4194304 100 0 0 0 12 30 0 0 20 0 1 0 100 1000 10 \
                    0 0 0 0 0 0 0 0 0 0 0 0 0 17 3 7 1 0 0 0";
        for name in ["x", "a (b) c", ") R 1", ""] {
            let seen = ProcessStat {
                state: 'S',
                cpu_s: 0.42,
                core: 3,
                fifo_priority: 7,
                is_ending: false,
            };
            assert_eq!(ProcessStat::of(&format!("7 ({name}) S {rest}")), Some(seen));
            let status = "voluntary_ctxt_switches:\t40\nnonvoluntary_ctxt_switches:\t2\n";
            let disturbed = Disturbances {
                waits: 40,
                preemptions: 2,
                minor_faults: 100,
                major_faults: 0,
            };
            assert_eq!(
                Disturbances::of(&format!("7 ({name}) S {rest}"), status),
                Some(disturbed)
            );
        }
    }

    #[test]
    fn whoever_was_killed_is_ending_reaped_or_not() {
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let stat = || ProcessStat::now(child.id()).unwrap();
        assert!(!stat().is_ending);
        rustix::process::kill_process(
            rustix::process::Pid::from_child(&child),
            rustix::process::Signal::KILL,
        )
        .unwrap();
        assert!(stat().is_ending, "the signal is on its way");
        while stat().state != 'Z' {
            std::thread::yield_now();
        }
        assert!(stat().is_ending);
        child.wait().unwrap();
    }

    #[test]
    fn this_machine_can_be_read() {
        let own = std::process::id();
        assert!(ProcessStat::now(own).is_some_and(|stat| (0.0..1e6).contains(&stat.cpu_s)));
        assert!(resident_kib(own).unwrap() > 100);
        assert!(Disturbances::now(own).is_some_and(|disturbed| disturbed.minor_faults > 10));
        assert!(
            CpuTimes::now().is_some_and(|times| !times.cores.is_empty() && times.all.busy <= times.all.all)
        );
        assert!(Uptime::now().is_some());
        assert!(Memory::now().is_some_and(|memory| memory.available_kib <= memory.total_kib));
        assert_eq!((ProcessStat::now(u32::MAX), resident_kib(u32::MAX)), (None, None));
    }

    proptest! {
        #[test]
        fn words_that_nobody_understands_stay_unknown(text in "(cpu[0-9]?|MemTotal:|MemAvailable:|wlan0:|[()]|[0-9 .-]{0,30}|\\PC|\n| ){0,20}") {
            let _unknown = (CpuTimes::of(&text), Uptime::of(&text), Memory::of(&text), ProcessStat::of(&text));
            Interface::all_of(&text);
        }
    }
}
