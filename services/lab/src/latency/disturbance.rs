//! What may go wrong beside the processes that are measured.

use super::load::lidar_name;
use jink_control::Problem;
use jink_runtime::procfs::Memory;
use jink_runtime::realtime::bind_to_core;
use jink_runtime::{Instance, OpenError, Session, now};
use jink_shared_types::ranges::{RangeScan, SCAN_BEAMS};
use jink_shared_types::{SampleHeader, Stage, topics};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// The sensor that floods.
pub(crate) const FLOODING_SENSOR: &str = "flood";
/// Its scans per second: a hundred times those of a fast one.
const FLOOD_HZ: u32 = 2_000;
/// Of the memory that is available, the share that is taken.
const MEMORY_SHARE: f64 = 0.9;
/// Taken at a time (bytes).
const MEMORY_STEP: usize = 64 << 20;
/// Pages are touched again and again, a step at a time, with this pause.
const MEMORY_PAUSE: Duration = Duration::from_millis(2);
/// A disturbance that waits looks this often whether it is to end.
const PATIENCE: Duration = Duration::from_millis(50);

/// One of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Disturbance {
    /// Nothing.
    None,
    /// A program that computes and never rests, on the last core
    Hog,
    /// A sensor whose driver publishes 2,000 scans of 1,024 beams per second
    Flood,
    /// A reader of every large topic that holds what it has and fetches nothing more
    SlowReader,
    /// A program that takes nine tenths of the available memory and keeps touching it
    Memory,
}

impl Disturbance {
    /// What it is called in a line about a load.
    pub fn words(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Hog => "hog",
            Self::Flood => "flooding sensor",
            Self::SlowReader => "slow reader",
            Self::Memory => "memory pressure",
        }
    }

    /// Starts it beside `instance`, whose services are all there; `None` if there is nothing to start.
    ///
    /// # Errors
    /// A topic that it needs cannot be opened.
    pub fn start(self, instance: &Instance) -> Result<Option<Disturber>, Problem> {
        if self == Self::None {
            return Ok(None);
        }
        let instance = instance.clone();
        let disturber = Disturber::start(self.words(), move |stop, ready| match self {
            Self::None => Ok(()),
            Self::Hog => hog(stop, ready),
            Self::Flood => flood(&instance, stop, ready),
            Self::SlowReader => read_slowly(&instance, stop, ready),
            Self::Memory => take_memory(stop, ready),
        });
        disturber.map(Some)
    }
}

/// A disturbance that goes on; it ends with this.
#[derive(Debug)]
pub struct Disturber {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Disturber {
    /// Starts `work` in a thread of its own, which says when it is ready and ends when its flag is set; `words` name it.
    ///
    /// # Errors
    /// What `work` ends with before it is ready.
    pub(super) fn start(
        words: &str,
        work: impl FnOnce(&AtomicBool, &Ready) -> Result<(), OpenError> + Send + 'static,
    ) -> Result<Self, Problem> {
        let stop = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&stop);
        let (ready, is_ready) = channel();
        let thread = std::thread::spawn(move || {
            if let Err(error) = work(&ended, &ready) {
                // Whoever waited for it has gone.
                let _nobody_waits = ready.send(Err(error));
            }
        });
        // Joined when it is dropped, whatever comes.
        let disturber = Self {
            stop,
            thread: Some(thread),
        };
        match is_ready.recv() {
            Ok(Ok(())) => Ok(disturber),
            Ok(Err(error)) => Err(Problem::Other(format!("{words}: {error}"))),
            Err(_) => Err(Problem::Other(format!("the {words} ended at once"))),
        }
    }
}

impl Drop for Disturber {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It has nothing to say.
            let _ended = thread.join();
        }
    }
}

pub(super) type Ready = Sender<Result<(), OpenError>>;

pub(super) fn begins(ready: &Ready) {
    // Whoever waited for it has gone: its stop flag is set as well.
    let _nobody_waits = ready.send(Ok(()));
}

fn hog(stop: &AtomicBool, ready: &Ready) -> Result<(), OpenError> {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    // Where it may not choose its core, it has whichever it gets.
    let _not_bound = bind_to_core(cores - 1);
    begins(ready);
    let mut number = 1u64;
    while !stop.load(Ordering::Relaxed) {
        for _ in 0..1_000 {
            number = std::hint::black_box(number.wrapping_mul(6_364_136_223_846_793_005) + 1);
        }
    }
    Ok(())
}

fn flood(instance: &Instance, stop: &AtomicBool, ready: &Ready) -> Result<(), OpenError> {
    let session = Session::open(instance, "lidar_driver")?;
    let mut output = session.output(topics::RANGE_SCAN, FLOODING_SENSOR, 1)?;
    begins(ready);
    // It knows nothing, and says so at length.
    let scan = RangeScan {
        range_max_m: 10.0,
        range_sigma_m: 0.05,
        angle_step_rad: std::f32::consts::TAU / SCAN_BEAMS as f32,
        beams: SCAN_BEAMS as u32,
        range_m: [f32::NAN; SCAN_BEAMS],
        ..RangeScan::default()
    };
    while !stop.load(Ordering::Relaxed) {
        let mut header = SampleHeader::at(now());
        header.stages[Stage::Sensor as usize].begin = header.capture;
        output.send(header, &scan);
        let pause_s = now().next_beat(FLOOD_HZ).seconds_since(now()).max(0.0);
        std::thread::sleep(Duration::from_secs_f64(pause_s));
    }
    Ok(())
}

fn read_slowly(instance: &Instance, stop: &AtomicBool, ready: &Ready) -> Result<(), OpenError> {
    let session = Session::open(instance, "cli")?;
    let mut cloud = session.input(topics::RANGE_CLOUD, &lidar_name(0))?;
    let mut map = session.input(topics::LOCAL_MAP, "")?;
    let mut approved = session.input(topics::APPROVED, "")?;
    begins(ready);
    let mut holds = [false; 3];
    while !stop.load(Ordering::Relaxed) {
        // One of each is held as long as this lasts.
        if !holds[0] {
            holds[0] = cloud.latest(now()).fresh().is_some();
        }
        if !holds[1] {
            holds[1] = map.latest(now()).fresh().is_some();
        }
        if !holds[2] {
            holds[2] = approved.latest(now()).fresh().is_some();
        }
        std::thread::sleep(PATIENCE);
    }
    Ok(())
}

fn take_memory(stop: &AtomicBool, ready: &Ready) -> Result<(), OpenError> {
    let available_kib = Memory::now().map_or(0, |memory| memory.available_kib);
    let wanted = (available_kib as f64 * 1024.0 * MEMORY_SHARE) as usize;
    begins(ready);
    let mut taken: Vec<Vec<u8>> = Vec::new();
    let mut step = 0;
    while !stop.load(Ordering::Relaxed) {
        if (taken.len() + 1) * MEMORY_STEP <= wanted {
            taken.push(vec![1; MEMORY_STEP]);
        } else if let Some(part) = taken.get_mut(step) {
            for page in part.chunks_mut(4096) {
                page[0] = page[0].wrapping_add(1);
            }
            std::thread::sleep(MEMORY_PAUSE);
            step += 1;
        } else if taken.is_empty() {
            std::thread::sleep(PATIENCE);
        } else {
            step = 0;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::Disturbance;
    use jink_runtime::Instance;
    use std::time::Duration;

    #[test]
    fn a_hog_uses_a_core_until_it_is_let_go() {
        let instance: Instance = "nobody".parse().unwrap();
        let before = jink_runtime::realtime::cpu_time_ms();
        let hog = Disturbance::Hog.start(&instance).unwrap();
        while jink_runtime::realtime::cpu_time_ms() < before + 20 {
            std::thread::sleep(Duration::from_millis(5));
        }
        // Comes back.
        drop(hog);
        assert!(Disturbance::None.start(&instance).unwrap().is_none());
    }
}
