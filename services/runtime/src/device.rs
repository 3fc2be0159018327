//! A device that one instance of a driver reads at a time: who owns it, what the others do meanwhile, and what of a driver does not depend
//! on its device.

use crate::clock::Clock;
use crate::config::sensor_table::{SensorTable, Told};
use crate::config::{CONFIG_FILE, ConfigError, sensor_place};
use crate::ports::{ExclusiveOwnership, Ports};
use crate::serial::{Port, Read};
use crate::service::{Cycle, Service, WATCHED_FDS, Wake};
use crate::setup::StartError;
use jink_shared_types::events::{CLOCK_STEPPED, Event, EventSample};
use jink_shared_types::{SampleHeader, Stage, Timestamp};
use std::fmt;
use std::os::fd::BorrowedFd;
use std::process::ExitCode;

/// Changes of the device's state are looked for at least this often (Hz).
const CHECK_HZ: u32 = 10;
/// The counters go to the log this often (s).
const REPORT_S: f64 = 60.0;
/// Read at once from a serial port: what an SF45/B sends in a tenth of a second at its usual rate, the fastest scanner in a
/// hundredth.
const READ_BYTES: usize = 1024;
/// Reads per cycle at most: a port that never ends must not keep the heartbeat waiting.
const READS: usize = 16;

/// A driver of one sensor, which [`run`] makes a service of: woken by its device, at the latest when something is due.
pub trait Driver: Sized {
    /// The program's name in the topic table.
    const PROGRAM: &'static str;
    /// Events for the pilot: the sensor has fallen silent, and measures again.
    const EVENTS: [&'static Event; 2];

    /// Whether the table of the sensor called `name` among `tables` is right.
    ///
    /// # Errors
    /// The first mistake.
    fn check(tables: &[SensorTable], name: &str) -> Result<(), Told>;

    /// For the sensor called `name`, whose table among `tables` is right: opens its topic, not yet its device.
    ///
    /// # Errors
    /// [`needs`], if what the table names is not to be had; or what is wrong with the topic.
    fn open(ports: &mut Ports, name: &str, tables: &[SensorTable]) -> Result<Self, StartError>;

    /// Opens the device if that is due, reads what has arrived, and publishes what it completes. Returns when to run again.
    fn run(&mut self, clock: &Clock, now: Timestamp) -> Timestamp;

    /// Closes the device: another instance has it now.
    fn close(&mut self);

    /// Samples per second that a standby writes (Hz).
    fn standby_hz(&self) -> u32;

    /// Writes a sample without the device, which shows that a standby runs and can write it. It is not published.
    fn run_as_standby(&mut self, now: Timestamp);

    /// Whether the sensor has fallen silent, or measures again; once per change.
    fn take_change(&mut self, now: Timestamp) -> Option<DeviceChange>;

    /// What is reported to the pilot of a `change` of the sensor called `name`.
    fn event(change: DeviceChange, name: &str) -> EventSample {
        EventSample::new(Self::EVENTS[change as usize], name, [0.0; 2])
    }

    /// By how much the sensor's own clock was set ahead (s), where it dates what it sends; once per step.
    fn take_clock_step(&mut self) -> Option<f64> {
        None
    }

    /// Writes the counters to the log.
    fn report(&mut self, now: Timestamp);

    /// As [`Service::watched`].
    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS];
}

/// The `main` of a driver.
pub fn run<D: Driver>() -> ExitCode {
    crate::run::<DriverService<D>>()
}

/// A driver, and whether it owns its device.
struct DriverService<D> {
    name: String,
    driver: D,
    clock: Clock,
    ownership: DeviceOwnership,
}

impl<D: Driver> Service for DriverService<D> {
    const PROGRAM: &'static str = D::PROGRAM;
    const REPLAYS: bool = false;

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let name = ports.setup().sensor_name()?;
        let folder = ports.setup().config.clone();
        let tables: Vec<SensorTable> = crate::config::sensors(&folder)?;
        D::check(&tables, &name).map_err(|(key, message)| {
            let place = sensor_place(&folder, &name, key.as_deref().unwrap_or_default());
            let (file, line) = place.unwrap_or((folder.join(CONFIG_FILE), 0));
            ConfigError { file, line, message }
        })?;
        Ok(Self {
            driver: D::open(ports, &name, &tables)?,
            ownership: DeviceOwnership::new(ports),
            clock: ports.clock(),
            name,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        if !self.ownership.owns(now) {
            self.driver.close();
            if self.ownership.is_standby_due(now, self.driver.standby_hz()) {
                self.driver.run_as_standby(now);
            }
            return self.ownership.standby_wake(now);
        }
        let due = self.driver.run(&self.clock, now);
        if let Some(change) = self.driver.take_change(now) {
            cycle.events.publish(now, &D::event(change, &self.name));
        }
        if let Some(ahead_s) = self.driver.take_clock_step() {
            let event = EventSample::new(&CLOCK_STEPPED, &self.name, [ahead_s, 0.0]);
            cycle.events.publish(now, &event);
        }
        if self.ownership.is_report_due(now) {
            self.driver.report(now);
        }
        Wake::at(now.next_beat(CHECK_HZ).min(due))
    }

    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        self.driver.watched()
    }
}

/// The error of a driver that cannot start: `what`, and why it cannot be had.
pub fn needs(what: &str, cause: &impl fmt::Display) -> StartError {
    StartError::Needs {
        what: what.to_owned(),
        cause: cause.to_string(),
    }
}

/// The header of what was measured at `capture`.
pub fn measured_at(capture: Timestamp) -> SampleHeader {
    let header = SampleHeader {
        capture,
        ..SampleHeader::default()
    };
    header.derived(Stage::Sensor, capture)
}

/// Shows `take` what has arrived at `port`, with the time at which it was read.
pub fn read_port(port: &mut Port, clock: &Clock, now: Timestamp, mut take: impl FnMut(Timestamp, &[u8])) {
    let mut bytes = [0; READ_BYTES];
    for _ in 0..READS {
        let Read::Bytes(count) = port.read(now, &mut bytes) else {
            break;
        };
        take(clock.now(), &bytes[..count]);
        if count < READ_BYTES {
            break;
        }
    }
}

/// A change to report to the pilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceChange {
    /// The sensor is silent, or gone.
    Lost,
    /// It measures again.
    Back,
}

/// Watches for silence: each loss and each return is reported once.
#[derive(Clone, Copy, Debug)]
pub struct SilenceMonitor {
    reported_s: f64,
    received: Timestamp,
    waiting: Timestamp,
    loss_reported: bool,
}

impl SilenceMonitor {
    /// Silence of more than `reported_s` is reported.
    pub fn new(reported_s: f64) -> Self {
        Self {
            reported_s,
            received: Timestamp::NEVER,
            waiting: Timestamp::NEVER,
            loss_reported: false,
        }
    }

    /// Something was measured, received at `now`.
    pub fn received(&mut self, now: Timestamp) {
        self.received = now;
    }

    /// Whether nothing was received for a while; true before the first time, too.
    pub fn is_silent(&self, now: Timestamp, silence_s: f64) -> bool {
        !self.received.is_set() || now.seconds_since(self.received) > silence_s
    }

    /// Whether the sensor has fallen silent, or measures again; once per change.
    pub fn take_change(&mut self, now: Timestamp) -> Option<DeviceChange> {
        if !self.waiting.is_set() {
            self.waiting = now;
        }
        let silent = now.seconds_since(self.received.max(self.waiting)) > self.reported_s;
        if silent == self.loss_reported {
            return None;
        }
        self.loss_reported = silent;
        Some(if silent {
            DeviceChange::Lost
        } else {
            DeviceChange::Back
        })
    }
}

/// The rate between two looks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rate(Timestamp, u64);

impl Rate {
    /// Per second since the last look (Hz); zero at the first.
    pub fn look(&mut self, now: Timestamp, count: u64) -> f64 {
        let Self(time, before) = std::mem::replace(self, Self(now, count));
        let since_s = now.seconds_since(time);
        if time.is_set() && since_s > 0.0 {
            (count - before) as f64 / since_s
        } else {
            0.0
        }
    }
}

/// Ownership of a device, and the schedule of its driver.
struct DeviceOwnership {
    exclusive_ownership: ExclusiveOwnership,
    standby_due: Timestamp,
    report_due: Timestamp,
}

impl DeviceOwnership {
    /// That of the instance with these `ports`.
    fn new(ports: &mut Ports) -> Self {
        Self {
            exclusive_ownership: ports.exclusive_ownership(),
            standby_due: Timestamp::NEVER,
            report_due: Timestamp::NEVER,
        }
    }

    /// Whether this instance reads the device from `now` on: a stream has one reader, and the next owner opens it when it owns the
    /// device. What is put out is published accordingly.
    fn owns(&self, now: Timestamp) -> bool {
        let is_ours = self.exclusive_ownership.is_due(now);
        self.exclusive_ownership.declare(is_ours);
        is_ours
    }

    /// Whether a standby is to show at `now` that it runs and can write its samples, which it does `rate_hz` times a second. None of
    /// them is published.
    fn is_standby_due(&mut self, now: Timestamp, rate_hz: u32) -> bool {
        let is_due = now >= self.standby_due;
        if is_due {
            self.standby_due = now.next_beat(rate_hz);
        }
        is_due
    }

    /// When a standby runs again: for its next sample, or when it becomes the owner.
    fn standby_wake(&self, now: Timestamp) -> Wake {
        let change = self.exclusive_ownership.changes_at();
        let change = change.filter(|change| *change > now);
        Wake::at(change.map_or(self.standby_due, |change| change.min(self.standby_due)))
    }

    /// Whether the counters are to be written to the log: once a minute, not at the start.
    fn is_report_due(&mut self, now: Timestamp) -> bool {
        if now < self.report_due {
            return false;
        }
        let is_first = !self.report_due.is_set();
        self.report_due = now.plus_seconds(REPORT_S);
        !is_first
    }
}
