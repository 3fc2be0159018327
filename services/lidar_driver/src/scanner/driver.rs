//! The step of a scanner: bytes that arrived become scans, silence becomes news.
//!
//! **Time.** A byte that was read at some moment has been on the line before: the last one for the time of one byte, each one before it
//! for one byte longer. What a USB adapter keeps back (an FTDI chip up to 16 ms) cannot be seen from here.

use super::ldrobot::Ldrobot;
use super::rplidar::{Rplidar, Setup};
use super::turn::Turn;
use super::{Sample, Tally};
use crate::config::{Device, LidarSpec};
use crate::counters::{Counters, News, Rate, Silence};
use crate::models::SerialProtocol;
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
enum Protocol {
    Ldrobot(Ldrobot),
    Rplidar(Rplidar, Setup),
}

/// One scanner.
#[derive(Clone, Debug)]
pub struct ScannerDriver {
    spec: LidarSpec,
    byte_s: f64,
    protocol: Protocol,
    turn: Turn,
    published: u64,
    newest: Timestamp,
    silence: Silence,
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
                SerialProtocol::Ldrobot => Protocol::Ldrobot(Ldrobot::default()),
                SerialProtocol::Rplidar { motor_pwm, .. } => {
                    Protocol::Rplidar(Rplidar::default(), Setup::new(motor_pwm))
                }
            },
            turn: Turn::new(&spec.cloud, spec.beams),
            published: 0,
            newest: Timestamp::NEVER,
            silence: Silence::default(),
            rate: Rate::default(),
            spec,
        }
    }

    /// What it is.
    pub fn spec(&self) -> &LidarSpec {
        &self.spec
    }

    /// The port was opened at `now`: what was begun before is forgotten, the set-up begins.
    pub fn connected(&mut self, now: Timestamp) {
        self.turn.clear();
        self.newest = Timestamp::NEVER;
        match &mut self.protocol {
            Protocol::Ldrobot(decoder) => decoder.interrupted(),
            Protocol::Rplidar(decoder, setup) => {
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
                Protocol::Ldrobot(decoder) => decoder.push(end, *byte, &mut take),
                Protocol::Rplidar(decoder, _) => decoder.push(end, *byte, &mut take),
            }
        }
        if let Protocol::Rplidar(decoder, setup) = protocol
            && decoder.take_protection_stop()
        {
            setup.reset(arrived);
        }
    }

    /// What is to be written to the scanner now, if anything; ask again until there is nothing.
    pub fn next_write(&mut self, now: Timestamp) -> Option<&[u8]> {
        let silent = self.silence.is_silent(now, SILENCE_S);
        match &mut self.protocol {
            Protocol::Ldrobot(_) => None,
            Protocol::Rplidar(decoder, setup) => {
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
            Protocol::Ldrobot(_) => Timestamp::from_ns(u64::MAX),
            Protocol::Rplidar(_, setup) => setup.due(),
        }
    }

    /// Whether the scanner has fallen silent, or measures again; once per change.
    pub fn news(&mut self, now: Timestamp) -> Option<News> {
        self.silence.news(now)
    }

    /// What has become of its bytes, with the rate since the last look.
    pub fn counters(&mut self, now: Timestamp) -> Counters {
        let Tally {
            good,
            damaged,
            skipped_bytes,
        } = match &self.protocol {
            Protocol::Ldrobot(decoder) => decoder.tally(),
            Protocol::Rplidar(decoder, _) => decoder.tally(),
        };
        Counters {
            published: self.published,
            good,
            damaged,
            other: skipped_bytes,
            rate_hz: self.rate.look(now, self.published),
            ..Counters::default()
        }
    }
}
