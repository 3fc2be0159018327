//! The board as its kernel describes it, read by a thread of its own: a file system that hangs must not hang the setpoints.
//!
//! | from | what | how often |
//! |---|---|---|
//! | `/proc/stat` | load of the processors | 10 Hz: ONBOARD_COMPUTER_STATUS wants slices of 100 ms |
//! | `/proc/uptime`, `/proc/meminfo`, `/proc/net/dev` | uptime, memory, traffic | 1 Hz |
//! | `/sys/class/thermal/thermal_zone0/temp`, the root's file system | temperature, space | 1 Hz |
//!
//! Whatever is missing or not understood stays unknown.

use crate::computer::{BoardReading, CORES, LINKS, LinkLoad, SLICES, UNKNOWN_SHARE};
use jink_runtime::realtime::{self, Scheduling};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

/// Length of a slice.
const SLICE: Duration = Duration::from_millis(100);
/// Stack of the thread (bytes): where memory is locked, all of it is touched when the thread begins.
const STACK_BYTES: usize = 128 * 1024;
/// MiB of a reading in KiB, and KiB of one in bytes.
const KIBI: u64 = 1024;

/// Reads the board for as long as somebody listens.
#[derive(Debug)]
pub struct Board {
    readings: Receiver<BoardReading>,
}

impl Board {
    /// Begins to read, once a second.
    ///
    /// # Errors
    /// If there can be no more threads.
    pub fn watch() -> std::io::Result<Self> {
        let (sender, readings) = sync_channel(1);
        std::thread::Builder::new()
            .name("board".to_owned())
            .stack_size(STACK_BYTES)
            .spawn(move || {
                // It has inherited the priority of whoever flies.
                let _at_its_own = realtime::schedule(0, Scheduling::Ordinary);
                let mut watcher = Watcher::default();
                loop {
                    std::thread::sleep(SLICE);
                    if let Some(reading) = watcher.look()
                        && let Err(std::sync::mpsc::TrySendError::Disconnected(_)) = sender.try_send(reading)
                    {
                        return;
                    }
                }
            })?;
        Ok(Self { readings })
    }

    /// A reading that has not been taken yet.
    pub fn news(&self) -> Option<BoardReading> {
        self.readings.try_recv().ok()
    }
}

/// What a reading is the difference to.
#[derive(Debug, Default)]
struct Watcher {
    slices: Vec<u8>,
    last_slice: Option<CpuTimes>,
    last_second: Option<CpuTimes>,
    last_traffic: Vec<Interface>,
}

impl Watcher {
    /// One look after each slice; every tenth makes a reading.
    fn look(&mut self) -> Option<BoardReading> {
        let cpu = CpuTimes::of(&text("/proc/stat"));
        self.slices.push(match (&self.last_slice, &cpu) {
            (Some(last), Some(cpu)) => load_pct(last.all, cpu.all),
            _ => UNKNOWN_SHARE,
        });
        self.last_slice = cpu.clone();
        let slices_pct = self.slices.as_slice().try_into().ok()?;
        self.slices.clear();
        let traffic = interfaces(&text("/proc/net/dev"));
        let (ram_used_mib, ram_total_mib) = memory_mib(&text("/proc/meminfo")).unzip();
        let (storage_used_mib, storage_total_mib) = storage_mib().unzip();
        let unknown = BoardReading::default();
        let reading = BoardReading {
            uptime_ms: uptime_ms(&text("/proc/uptime")).unwrap_or(unknown.uptime_ms),
            cores_pct: match (&self.last_second, &cpu) {
                (Some(last), Some(cpu)) => cores_pct(last, cpu),
                _ => unknown.cores_pct,
            },
            slices_pct,
            ram_used_mib: ram_used_mib.unwrap_or(unknown.ram_used_mib),
            ram_total_mib: ram_total_mib.unwrap_or(unknown.ram_total_mib),
            storage_used_mib: storage_used_mib.unwrap_or(unknown.storage_used_mib),
            storage_total_mib: storage_total_mib.unwrap_or(unknown.storage_total_mib),
            temperature_c: temperature_c(&text("/sys/class/thermal/thermal_zone0/temp"))
                .unwrap_or(unknown.temperature_c),
            links: loads(&self.last_traffic, &traffic),
        };
        self.last_second = cpu;
        self.last_traffic = traffic;
        Some(reading)
    }
}

/// Empty if it is not there.
fn text(file: &str) -> String {
    std::fs::read_to_string(file).unwrap_or_default()
}

/// Ticks since the start: busy ones, and all.
type Ticks = (u64, u64);

/// `/proc/stat`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct CpuTimes {
    all: Ticks,
    cores: Vec<Ticks>,
}

impl CpuTimes {
    fn of(stat: &str) -> Option<Self> {
        let mut lines = stat.lines().map_while(|line| {
            let mut words = line.split_whitespace();
            words.next()?.strip_prefix("cpu")?;
            // user nice system idle iowait irq softirq steal; what follows is contained in user and nice.
            let numbers: Vec<u64> = words.take(8).map_while(|word| word.parse().ok()).collect();
            let all = numbers.iter().fold(0u64, |sum, ticks| sum.saturating_add(*ticks));
            let idle = numbers.get(3)?.saturating_add(*numbers.get(4)?);
            Some((all.saturating_sub(idle), all))
        });
        Some(Self {
            all: lines.next()?,
            cores: lines.collect(),
        })
    }
}

/// Load between two counts (%); unknown if nothing was counted.
fn load_pct(before: Ticks, after: Ticks) -> u8 {
    let busy = after.0.saturating_sub(before.0);
    match after.1.saturating_sub(before.1) {
        0 => UNKNOWN_SHARE,
        all => u8::try_from(u128::from(busy.min(all)) * 100 / u128::from(all)).unwrap_or(UNKNOWN_SHARE),
    }
}

fn cores_pct(before: &CpuTimes, after: &CpuTimes) -> [u8; CORES] {
    let mut loads = [UNKNOWN_SHARE; CORES];
    for ((load, before), after) in loads.iter_mut().zip(&before.cores).zip(&after.cores) {
        *load = load_pct(*before, *after);
    }
    loads
}

/// `/proc/uptime` (ms); of a board that is up for more than 49 days the largest that can be said.
fn uptime_ms(uptime: &str) -> Option<u32> {
    let seconds: f64 = uptime.split_whitespace().next()?.parse().ok()?;
    // Saturates.
    (seconds >= 0.0).then_some((seconds * 1e3) as u32)
}

/// Memory in use and all of it, from `/proc/meminfo` (MiB).
fn memory_mib(meminfo: &str) -> Option<(u32, u32)> {
    let kib = |name: &str| -> Option<u64> {
        let line = meminfo.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().next()?.parse().ok()
    };
    let (total, available) = (kib("MemTotal:")?, kib("MemAvailable:")?);
    let mib = |kib: u64| u32::try_from(kib / KIBI).ok();
    Some((mib(total.saturating_sub(available))?, mib(total)?))
}

/// Space in use and all of it on the root's file system (MiB).
fn storage_mib() -> Option<(u32, u32)> {
    let system = rustix::fs::statvfs("/").ok()?;
    let mib = |blocks: u64| {
        let bytes = u128::from(blocks) * u128::from(system.f_frsize);
        u32::try_from(bytes / u128::from(KIBI * KIBI)).ok()
    };
    Some((
        mib(system.f_blocks.saturating_sub(system.f_bfree))?,
        mib(system.f_blocks)?,
    ))
}

/// Thousandths of a degree to degrees.
fn temperature_c(thousandths: &str) -> Option<i8> {
    let value: i64 = thousandths.trim().parse().ok()?;
    i8::try_from(value / 1000).ok().filter(|value| *value != i8::MAX)
}

/// A line of `/proc/net/dev`.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Interface {
    name: String,
    kind: u32,
    received: u64,
    sent: u64,
}

/// The wired and the wireless ones; what exists only inside the board is no link of it.
fn interfaces(net_dev: &str) -> Vec<Interface> {
    let one = |line: &str| {
        let (name, numbers) = line.split_once(':')?;
        let name = name.trim();
        let kind = match name {
            name if name.starts_with("wl") => 20,
            name if name.starts_with("eth") || name.starts_with("en") => 10,
            _ => return None,
        };
        let numbers: Vec<u64> = numbers
            .split_whitespace()
            .map_while(|word| word.parse().ok())
            .collect();
        Some(Interface {
            name: name.to_owned(),
            kind,
            received: *numbers.first()?,
            sent: *numbers.get(8)?,
        })
    };
    net_dev.lines().filter_map(one).take(LINKS).collect()
}

/// Traffic of the second between two looks.
fn loads(before: &[Interface], after: &[Interface]) -> [Option<LinkLoad>; LINKS] {
    let kib =
        |after: u64, before: u64| u32::try_from(after.saturating_sub(before) / KIBI).unwrap_or(u32::MAX - 1);
    let mut links = [None; LINKS];
    for (link, after) in links.iter_mut().zip(after) {
        *link = before
            .iter()
            .find(|before| before.name == after.name)
            .map(|before| LinkLoad {
                kind: after.kind,
                sent_kibps: kib(after.sent, before.sent),
                received_kibps: kib(after.received, before.received),
            });
    }
    links
}

const _: () = assert!(SLICES as u128 * SLICE.as_millis() == 1000);

#[cfg(test)]
mod tests {
    use super::{
        Board, CpuTimes, Watcher, cores_pct, interfaces, load_pct, loads, memory_mib, temperature_c,
        uptime_ms,
    };
    use crate::computer::{LinkLoad, SLICES, UNKNOWN_U32};
    use proptest::prelude::*;

    const STAT: &str = "cpu  100 0 50 800 50 0 0 0 0 0\ncpu0 50 0 25 400 25 0 0 0 0 0\n\
                        cpu1 50 0 25 400 25 0 0 0 0 0\nintr 1 2 3\n";

    #[test]
    fn the_kernels_words_are_understood() {
        let before = CpuTimes::of(STAT).unwrap();
        assert_eq!((before.all, before.cores.len()), ((150, 1000), 2));
        let after = CpuTimes::of(
            "cpu 150 0 50 850 50 0 0 0\ncpu0 100 0 25 400 25 0 0 0\ncpu1 50 0 25 450 25 0 0 0\n",
        );
        let after = after.unwrap();
        assert_eq!(load_pct(before.all, after.all), 50);
        assert_eq!(cores_pct(&before, &after)[..3], [100, 0, 255]);
        assert_eq!(uptime_ms("12.34 20.00\n"), Some(12_340));
        assert_eq!(uptime_ms("99999999.0 1"), Some(u32::MAX));
        let meminfo = "MemTotal:        4096000 kB\nMemFree: 1 kB\nMemAvailable:    1024000 kB\n";
        assert_eq!(memory_mib(meminfo), Some((3000, 4000)));
        assert_eq!(temperature_c("61234\n"), Some(61));
        let dev = |received: u32, sent: u32| {
            interfaces(&format!(
                "Inter-| Receive\n lo: 9 9 0 0 0 0 0 0 9 9\n  wlan0: {received} 1 0 0 0 0 0 0 {sent} 1 0 0\n"
            ))
        };
        let links = loads(&dev(0, 4096), &dev(2048, 8192));
        let expected = LinkLoad {
            kind: 20,
            sent_kibps: 4,
            received_kibps: 2,
        };
        assert_eq!((links[0], links[1]), (Some(expected), None));
    }

    #[test]
    fn this_machine_can_be_read() {
        let mut watcher = Watcher::default();
        for _ in 1..SLICES {
            assert!(watcher.look().is_none());
        }
        let reading = watcher.look().unwrap();
        assert!(reading.uptime_ms > 0);
        assert!(reading.ram_used_mib <= reading.ram_total_mib && reading.ram_total_mib != UNKNOWN_U32);
        assert!(
            reading.storage_used_mib <= reading.storage_total_mib && reading.storage_total_mib != UNKNOWN_U32
        );
    }

    #[test]
    fn readings_come_by_themselves() {
        let board = Board::watch().unwrap();
        while board.news().is_none() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }

    proptest! {
        #[test]
        fn words_that_nobody_understands_stay_unknown(text in "(cpu[0-9]?|MemTotal:|MemAvailable:|wlan0:|[0-9 .-]{0,30}|\\PC|\n| ){0,20}") {
            let _unknown = (CpuTimes::of(&text), uptime_ms(&text), memory_mib(&text), temperature_c(&text));
            let links = interfaces(&text);
            prop_assert!(links.len() <= 6);
            loads(&links, &links);
        }
    }
}
