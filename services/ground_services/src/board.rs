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
use jink_runtime::procfs::{CpuTicks, CpuTimes, Interface, Memory, Uptime};
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
    pub fn update(&self) -> Option<BoardReading> {
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
        let cpu = CpuTimes::now();
        self.slices.push(match (&self.last_slice, &cpu) {
            (Some(last), Some(cpu)) => load_pct(last.all, cpu.all),
            _ => UNKNOWN_SHARE,
        });
        self.last_slice = cpu.clone();
        let slices_pct = self.slices.as_slice().try_into().ok()?;
        self.slices.clear();
        let traffic = links_of(Interface::all());
        let (ram_used_mib, ram_total_mib) = Memory::now().and_then(memory_mib).unzip();
        let (storage_used_mib, storage_total_mib) = storage_mib().unzip();
        let unknown = BoardReading::default();
        let reading = BoardReading {
            uptime_ms: Uptime::now().map_or(unknown.uptime_ms, uptime_ms),
            cores_pct: match (&self.last_second, &cpu) {
                (Some(last), Some(cpu)) => cores_pct(last, cpu),
                _ => unknown.cores_pct,
            },
            slices_pct,
            ram_used_mib: ram_used_mib.unwrap_or(unknown.ram_used_mib),
            ram_total_mib: ram_total_mib.unwrap_or(unknown.ram_total_mib),
            storage_used_mib: storage_used_mib.unwrap_or(unknown.storage_used_mib),
            storage_total_mib: storage_total_mib.unwrap_or(unknown.storage_total_mib),
            temperature_c: temperature_c(
                &std::fs::read_to_string("/sys/class/thermal/thermal_zone0/temp").unwrap_or_default(),
            )
            .unwrap_or(unknown.temperature_c),
            links: loads(&self.last_traffic, &traffic),
        };
        self.last_second = cpu;
        self.last_traffic = traffic;
        Some(reading)
    }
}

/// Load between two counts (%); unknown if nothing was counted.
fn load_pct(before: CpuTicks, after: CpuTicks) -> u8 {
    let busy = after.busy.saturating_sub(before.busy);
    match after.all.saturating_sub(before.all) {
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

/// Of a board that is up for more than 49 days the largest that can be said (ms).
fn uptime_ms(uptime: Uptime) -> u32 {
    // Saturates.
    (uptime.up_s * 1e3) as u32
}

/// Memory in use and all of it (MiB).
fn memory_mib(memory: Memory) -> Option<(u32, u32)> {
    let mib = |kib: u64| u32::try_from(kib / KIBI).ok();
    Some((
        mib(memory.total_kib.saturating_sub(memory.available_kib))?,
        mib(memory.total_kib)?,
    ))
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

/// The wired and the wireless ones; what exists only inside the board is no link of it.
fn links_of(interfaces: Vec<Interface>) -> Vec<Interface> {
    let is_one = |interface: &Interface| kind_of(&interface.name).is_some();
    interfaces.into_iter().filter(is_one).take(LINKS).collect()
}

fn kind_of(name: &str) -> Option<u32> {
    match name {
        name if name.starts_with("wl") => Some(20),
        name if name.starts_with("eth") || name.starts_with("en") => Some(10),
        _ => None,
    }
}

/// Traffic of the second between two looks.
fn loads(before: &[Interface], after: &[Interface]) -> [Option<LinkLoad>; LINKS] {
    let kib =
        |after: u64, before: u64| u32::try_from(after.saturating_sub(before) / KIBI).unwrap_or(u32::MAX - 1);
    let mut links = [None; LINKS];
    for (link, after) in links.iter_mut().zip(after) {
        let before = before.iter().find(|before| before.name == after.name);
        *link = before.zip(kind_of(&after.name)).map(|(before, kind)| LinkLoad {
            kind,
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
        Board, CpuTicks, CpuTimes, Interface, Memory, Uptime, Watcher, cores_pct, links_of, load_pct, loads,
        memory_mib, temperature_c, uptime_ms,
    };
    use crate::computer::{LinkLoad, SLICES, UNKNOWN_U32};

    #[test]
    fn readings_come_in_the_units_of_the_message() {
        let ticks = |busy, all| CpuTicks { busy, all, stolen: 0 };
        let before = CpuTimes {
            all: ticks(150, 1000),
            cores: vec![ticks(75, 500); 2],
        };
        let after = CpuTimes {
            all: ticks(200, 1100),
            cores: vec![ticks(125, 550), ticks(75, 550)],
        };
        assert_eq!(load_pct(before.all, after.all), 50);
        assert_eq!(cores_pct(&before, &after)[..3], [100, 0, 255]);
        assert_eq!(uptime_ms(Uptime { up_s: 12.34 }), 12_340);
        assert_eq!(uptime_ms(Uptime { up_s: 99_999_999.0 }), u32::MAX);
        let memory = Memory {
            total_kib: 4_096_000,
            available_kib: 1_024_000,
        };
        assert_eq!(memory_mib(memory), Some((3000, 4000)));
        assert_eq!(temperature_c("61234\n"), Some(61));
        assert_eq!(temperature_c("hot"), None);
        let dev = |received, sent| {
            let named = |name: &str| Interface {
                name: name.to_owned(),
                received,
                sent,
            };
            links_of(vec![named("lo"), named("wlan0")])
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
        while board.update().is_none() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }
}
