//! What an autopilot logged itself: where its controller wanted to be, and where its estimator was.
//!
//! | log | wanted | was |
//! |---|---|---|
//! | PX4, ULog | `vehicle_local_position_setpoint` | `vehicle_local_position` |
//! | ArduPilot, DataFlash | `PSCN`, `PSCE`, `PSCD`: `TPN`, `TPE`, `TPD` | `XKF1` of the first core: `PN`, `PE`, `PD` |
//!
//! Places are local NED (m), as in LOCAL_POSITION_NED; times are those since the autopilot's boot, as in TIMESYNC.

use crate::ReportError;
use ardupilot_binlog::{Entry, Reader};
use nalgebra::Vector3;
use px4_ulog::stream_parser::file_reader::{Message, SimpleCallbackResult, read_file_with_simple_callback};
use px4_ulog::stream_parser::model::{Completeness, DataMessage};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// The first bytes of a ULog.
const ULOG: &[u8] = b"ULog";
/// The first bytes of every message of a DataFlash log.
const DATAFLASH: &[u8] = &[0xa3, 0x95];
/// Between two places that are kept (us): what charts show.
const EVERY_US: u64 = 50_000;

/// A place at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Since the autopilot's boot (us).
    pub boot_us: u64,
    /// Local NED (m).
    pub position: Vector3<f64>,
}

/// Places, in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Places(Vec<Place>);

impl Places {
    /// Adds a place, unless one of just before is there, or it is none.
    pub fn push(&mut self, boot_us: u64, position: Vector3<f64>) {
        let is_due = self
            .0
            .last()
            .is_none_or(|last| boot_us >= last.boot_us.saturating_add(EVERY_US));
        if is_due && position.iter().all(|x| x.is_finite()) {
            self.0.push(Place { boot_us, position });
        }
    }

    /// All of them.
    pub fn all(&self) -> &[Place] {
        &self.0
    }

    /// Where it was at `boot_us`, between two places that are at most `apart_us` from each other.
    pub fn at(&self, boot_us: u64, apart_us: u64) -> Option<Vector3<f64>> {
        let after = self.0.partition_point(|place| place.boot_us <= boot_us);
        let (before, after) = (self.0.get(after.checked_sub(1)?)?, self.0.get(after)?);
        let span_us = after.boot_us - before.boot_us;
        let share = (boot_us - before.boot_us) as f64 / span_us as f64;
        (span_us <= apart_us).then(|| before.position.lerp(&after.position, share))
    }
}

/// An autopilot's log, as far as it concerns what jink sends.
#[derive(Clone, Debug, Default)]
pub struct AutopilotLog {
    /// Whose it is.
    pub maker: &'static str,
    /// Where the controller wanted to be.
    pub wanted: Places,
    /// Where the estimator was.
    pub was: Places,
    /// How it ends, if not whole.
    pub damage: Option<String>,
}

impl AutopilotLog {
    /// Reads a log; what it is, its first bytes say.
    ///
    /// # Errors
    /// [`ReportError`] if it is none of the two, or holds no positions.
    pub fn read(path: &Path) -> Result<Self, ReportError> {
        let unreadable = |error| ReportError::File(path.to_owned(), error);
        let mut begin = Vec::new();
        let file = File::open(path).map_err(unreadable)?;
        file.take(ULOG.len() as u64)
            .read_to_end(&mut begin)
            .map_err(unreadable)?;
        let log = if begin == ULOG {
            Self::of_px4(path)?
        } else if begin.starts_with(DATAFLASH) {
            Self::of_ardupilot(BufReader::new(File::open(path).map_err(unreadable)?))
        } else {
            return Err(ReportError::ForeignLog(path.to_owned()));
        };
        match log.was.all() {
            [] => Err(ReportError::NoPositions(path.to_owned())),
            _ => Ok(log),
        }
    }

    fn of_px4(path: &Path) -> Result<Self, ReportError> {
        let mut log = Self {
            maker: "PX4",
            ..Self::default()
        };
        let name = path
            .to_str()
            .ok_or_else(|| ReportError::UnreadableLog(path.to_owned(), "its path is no UTF-8".to_owned()))?;
        let ends = contained(|| {
            read_file_with_simple_callback(name, &mut |message| {
                if let Message::Data(data) = message {
                    log.take_px4(data);
                }
                SimpleCallbackResult::KeepReading
            })
        });
        log.damage = match ends
            .transpose()
            .map_err(|error| ReportError::File(path.to_owned(), error))?
        {
            Some(Completeness::Complete) => None,
            Some(Completeness::Truncated) => Some("cut off".to_owned()),
            Some(Completeness::MalformedRecord(why)) => Some(format!("damaged: {why}")),
            None => Some("damaged".to_owned()),
        };
        Ok(log)
    }

    fn take_px4(&mut self, data: &DataMessage<'_>) {
        let format = data.flattened_format;
        let places = match format.message_name() {
            "vehicle_local_position" => &mut self.was,
            "vehicle_local_position_setpoint" => &mut self.wanted,
            _ => return,
        };
        let coordinate = |name| {
            Some(f64::from(
                format.get_field_parser::<f32>(name).ok()?.parse(data.data),
            ))
        };
        let time = format.get_field_parser::<u64>("timestamp");
        if let (Ok(time), Some(x), Some(y), Some(z)) =
            (time, coordinate("x"), coordinate("y"), coordinate("z"))
        {
            places.push(time.parse(data.data), Vector3::new(x, y, z));
        }
    }

    fn of_ardupilot(file: impl Read) -> Self {
        let mut log = Self {
            maker: "ArduPilot",
            ..Self::default()
        };
        let mut wanted = Axes::default();
        for entry in Reader::new(file) {
            match entry {
                Ok(entry) => log.take_ardupilot(&entry, &mut wanted),
                Err(error) => {
                    log.damage = Some(error.to_string());
                    break;
                }
            }
        }
        log
    }

    fn take_ardupilot(&mut self, entry: &Entry, wanted: &mut Axes) {
        let number = |name| entry.get_f64(name);
        let Some(boot_us) = entry.timestamp_usec else {
            return;
        };
        match entry.name.as_str() {
            "XKF1" if number("C").is_none_or(|core| core == 0.0) => {
                if let (Some(x), Some(y), Some(z)) = (number("PN"), number("PE"), number("PD")) {
                    self.was.push(boot_us, Vector3::new(x, y, z));
                }
            }
            "PSCN" => wanted.begin(boot_us, number("TPN")),
            "PSCE" => wanted.take(boot_us, 1, number("TPE")),
            "PSCD" => {
                wanted.take(boot_us, 2, number("TPD"));
                if wanted.boot_us == boot_us {
                    self.wanted.push(boot_us, wanted.position);
                }
            }
            _ => {}
        }
    }
}

/// What `read` answers; `None` if it panics, as px4-ulog 0.6 does where a damaged message is shorter than its format says. That is not
/// printed: it is how this log ends, and nothing else is wrong.
fn contained<T>(read: impl FnOnce() -> T) -> Option<T> {
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let answer = std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)).ok();
    std::panic::set_hook(hook);
    answer
}

/// The three axes of a target come as three messages with one time.
#[derive(Debug)]
struct Axes {
    boot_us: u64,
    position: Vector3<f64>,
}

impl Default for Axes {
    fn default() -> Self {
        Self {
            boot_us: 0,
            position: Vector3::repeat(f64::NAN),
        }
    }
}

impl Axes {
    fn begin(&mut self, boot_us: u64, north_m: Option<f64>) {
        *self = Self {
            boot_us,
            ..Self::default()
        };
        self.take(boot_us, 0, north_m);
    }

    fn take(&mut self, boot_us: u64, axis: usize, value_m: Option<f64>) {
        if let Some(value_m) = value_m.filter(|_| self.boot_us == boot_us) {
            self.position[axis] = value_m;
        }
    }
}
