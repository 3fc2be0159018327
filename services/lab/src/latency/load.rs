//! What the processes are measured under.

use jink_control::Problem;
use jink_runtime::realtime::bind_to_core;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// SCHED_FIFO priority of every process where real-time scheduling is measured.
const PRIORITY: u8 = 10;
/// Range of the measured lidar (m).
const RANGE_M: f64 = 20.0;

/// One load.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Load {
    /// Points of a frame.
    pub points: u32,
    /// Frames per second (Hz).
    pub rate_hz: f64,
    /// Whether a program that does nothing but compute has a core as well.
    pub hog: bool,
    /// Whether every process has SCHED_FIFO and keeps its memory.
    pub realtime: bool,
}

impl fmt::Display for Load {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} points, {} Hz{}{}",
            self.points,
            self.rate_hz,
            if self.hog { ", hog" } else { "" },
            if self.realtime { ", FIFO and mlock" } else { "" }
        )
    }
}

impl Load {
    /// Writes the set of sensors of this load into `folder`; its file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_sensors(&self, folder: &Path) -> Result<PathBuf, Problem> {
        let file = folder.join("sensors.toml");
        let text = format!(
            "[[sensor]]\nname = \"lidar\"\nkind = \"lidar_3d\"\nrate_hz = {}\nrays = {}\nrange_max_m = {RANGE_M}\n\
             elevation_min_deg = -90\nelevation_max_deg = 90\n",
            self.rate_hz, self.points
        );
        std::fs::write(&file, text).map_err(Problem::io(file.display().to_string()))?;
        Ok(file)
    }

    /// Copies the configuration at `from` into `folder`, with what this load asks of the scheduler.
    ///
    /// # Errors
    /// A file cannot be read or written.
    pub fn write_config(&self, from: &Path, folder: &Path) -> Result<(), Problem> {
        let entries = std::fs::read_dir(from).map_err(Problem::io(from.display().to_string()))?;
        for entry in entries.filter_map(Result::ok) {
            let (path, to) = (entry.path(), folder.join(entry.file_name()));
            if path.is_file() {
                let text = std::fs::read(&path).map_err(Problem::io(path.display().to_string()))?;
                std::fs::write(&to, text).map_err(Problem::io(to.display().to_string()))?;
            }
        }
        if self.realtime {
            let file = folder.join("services.toml");
            let name = || file.display().to_string();
            let text = std::fs::read_to_string(&file).map_err(Problem::io(name()))?;
            let with = format!("[defaults]\npriority = {PRIORITY}\nlock_memory = true\n\n{text}");
            std::fs::write(&file, with).map_err(Problem::io(name()))?;
        }
        Ok(())
    }
}

/// A thread that computes and never rests, on the last core; it ends with this.
#[derive(Debug)]
pub struct Hog {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Hog {
    /// Starts one.
    pub fn start() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
            // Where it may not choose its core, it has whichever it gets.
            let _not_bound = bind_to_core(cores - 1);
            let mut number = 1u64;
            while !stopped.load(Ordering::Relaxed) {
                for _ in 0..1_000 {
                    number = std::hint::black_box(number.wrapping_mul(6_364_136_223_846_793_005) + 1);
                }
            }
        });
        Self {
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Hog {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It has nothing to say.
            let _ended = thread.join();
        }
    }
}
