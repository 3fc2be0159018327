//! The step of a scanner: received bytes become scans, silence becomes a change to report.
//!
//! **Time.** A byte that was read at some moment has been on the line before: the last one for the time of one byte,
//! each one before it for one byte longer. What a USB adapter keeps back (an FTDI chip up to 16 ms) cannot be seen from
//! here.

use super::ldrobot::Ldrobot;
use super::rplidar::{Rplidar, Setup};
use super::turn::Turn;
use super::{Sample, SampleCounts};
use crate::config::{Device, LidarSpec};
use crate::counters::{LOSS_S, LidarCounters};
use crate::models::SerialProtocol;
use jink_runtime::device::{DeviceChange, Rate, SilenceMonitor};
use jink_shared_types::Timestamp;

/// Bits of a byte on the line: a start and a stop bit besides its own eight.
const BITS_PER_BYTE: f64 = 10.0;
/// Silence (s) after which a scanner is set up anew.
const SILENCE_S: f64 = 1.0;

#[derive(Clone, Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "there is one in a process: a box would save nothing"
)]
enum ScannerProtocol {
    Ldrobot(Ldrobot),
    Rplidar(Rplidar, Setup),
}

/// One scanner.
#[derive(Clone, Debug)]
pub struct ScannerDriver {
    spec: LidarSpec,
    byte_s: f64,
    protocol: ScannerProtocol,
    turn: Turn,
    published: u64,
    newest: Timestamp,
    silence: SilenceMonitor,
    rate: Rate,
}

impl ScannerDriver {
    /// For the scanner that `spec` describes; nothing is open yet.
    pub fn new(spec: LidarSpec, protocol: SerialProtocol) -> Self {
        let baud = match spec.device {
            Device::Serial { baud, .. } => baud,
            Device::Udp(_) | Device::Pcap { .. } => spec.model.baud,
        };
        Self {
            byte_s: BITS_PER_BYTE / f64::from(baud.max(1)),
            protocol: match protocol {
                SerialProtocol::Ldrobot => ScannerProtocol::Ldrobot(Ldrobot::default()),
                SerialProtocol::Rplidar { motor_pwm, .. } => {
                    ScannerProtocol::Rplidar(Rplidar::default(), Setup::new(motor_pwm))
                }
            },
            turn: Turn::new(&spec.cloud, spec.beams),
            published: 0,
            newest: Timestamp::NEVER,
            silence: SilenceMonitor::new(LOSS_S),
            rate: Rate::default(),
            spec,
        }
    }

    /// What it is.
    pub fn spec(&self) -> &LidarSpec {
        &self.spec
    }

    /// The port was opened at `now`: unfinished frames and scans are dropped, the set-up begins.
    pub fn connected(&mut self, now: Timestamp) {
        self.turn.clear();
        self.newest = Timestamp::NEVER;
        match &mut self.protocol {
            ScannerProtocol::Ldrobot(decoder) => decoder.interrupted(),
            ScannerProtocol::Rplidar(decoder, setup) => {
                decoder.interrupted();
                setup.begin(now);
            }
        }
    }

    /// Takes `bytes` that were read at `arrived`, and hands every scan that they complete to `publish`.
    pub fn bytes(&mut self, arrived: Timestamp, bytes: &[u8], publish: &mut dyn FnMut(&Turn)) {
        let Self {
            protocol,
            turn,
            published,
            newest,
            silence,
            byte_s,
            ..
        } = self;
        let mut take = |sample: Sample| {
            silence.received(arrived);
            // Two reads in quick succession may date their bytes in each other's time.
            let sample = Sample {
                time: sample.time.max(*newest),
                ..sample
            };
            *newest = sample.time;
            if turn.ends_before(&sample) && turn.finish() {
                *published += 1;
                publish(turn);
            }
            turn.take(&sample);
        };
        for (index, byte) in bytes.iter().enumerate() {
            let behind = (bytes.len() - 1 - index) as f64;
            let end = arrived.plus_seconds(-behind * *byte_s);
            match protocol {
                ScannerProtocol::Ldrobot(decoder) => decoder.push(end, *byte, &mut take),
                ScannerProtocol::Rplidar(decoder, _) => decoder.push(end, *byte, &mut take),
            }
        }
        if let ScannerProtocol::Rplidar(decoder, setup) = protocol
            && decoder.take_protection_stop()
        {
            setup.reset(arrived);
        }
    }

    /// The next bytes to write to the scanner now; `None` when there are none left.
    pub fn next_write(&mut self, now: Timestamp) -> Option<&[u8]> {
        let silent = self.silence.is_silent(now, SILENCE_S);
        match &mut self.protocol {
            ScannerProtocol::Ldrobot(_) => None,
            ScannerProtocol::Rplidar(decoder, setup) => {
                let write = setup.next_write(now, silent);
                // Whatever was on the line before is answered no more.
                if write.is_some_and(|bytes| bytes.len() != 6) {
                    decoder.interrupted();
                }
                write
            }
        }
    }

    /// When [`Self::next_write`] may have something even if nothing arrives.
    pub fn due(&self) -> Timestamp {
        match &self.protocol {
            ScannerProtocol::Ldrobot(_) => Timestamp::from_ns(u64::MAX),
            ScannerProtocol::Rplidar(_, setup) => setup.due(),
        }
    }

    /// Whether the scanner has fallen silent, or measures again; once per change.
    pub fn take_change(&mut self, now: Timestamp) -> Option<DeviceChange> {
        self.silence.take_change(now)
    }

    /// What has become of its bytes, with the rate since the last look.
    pub fn counters(&mut self, now: Timestamp) -> LidarCounters {
        let SampleCounts {
            good,
            damaged,
            skipped_bytes,
        } = match &self.protocol {
            ScannerProtocol::Ldrobot(decoder) => decoder.tally(),
            ScannerProtocol::Rplidar(decoder, _) => decoder.tally(),
        };
        LidarCounters {
            published: self.published,
            good,
            damaged,
            other: skipped_bytes,
            rate_hz: self.rate.look(now, self.published),
            ..LidarCounters::default()
        }
    }
}
