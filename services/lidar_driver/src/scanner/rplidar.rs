//! SLAMTEC RPLIDAR A1, A2, A3, S1, S2, C1: responses to SCAN and EXPRESS_SCAN, and the set-up that requests them.
//!
//! Source: SLAMTEC RPLIDAR interface protocol and application notes, "Measurement Commands Response".
//!
//! | answer | bytes | holds |
//! |---|---|---|
//! | 0x81 to SCAN | 5 | one sample: start bit and its opposite, quality; a bit that is 1, angle (1/64 deg); range (1/4 mm) |
//! | 0x82 to EXPRESS_SCAN | 84 | 0xA, 0x5 and eight bits of checksum; angle of its first sample (1/64 deg); 16 x 2 samples: range (mm), angle correction (1/8 deg) |
//! | 0x85 to EXPRESS_SCAN | 84 | the same head; 40 samples: range (mm) |
//!
//! A capsule contains where it begins; where it ends the next one contains, so it is read when that has come. Angles
//! count clockwise. A range of zero is an invalid sample.
//!
//! | when | what is written |
//! |---|---|
//! | the port was opened | STOP, GET_HEALTH, motor on where it is switched by a command, EXPRESS_SCAN |
//! | no samples for three seconds | the same, with SCAN, then EXPRESS_SCAN again: not every firmware has both |
//! | the scanner reports a protection stop | RESET, then the same |
//!
//! **What can be detected.** Capsules carry an exclusive or of eight bits, single samples three bits; capsules that
//! would turn by more than a sixth of a turn, or half as much again as the one before, are dropped, too.

use super::{Sample, SampleCounts, SlidingWindow};
use crate::decode::u16_at;
use jink_shared_types::Timestamp;

const START: u8 = 0xA5;
const DESCRIPTOR: [u8; 2] = [0xA5, 0x5A];
const DESCRIPTOR_BYTES: usize = 7;
const STOP: u8 = 0x25;
const RESET: u8 = 0x40;
const SCAN: u8 = 0x20;
const EXPRESS_SCAN: u8 = 0x82;
const GET_HEALTH: u8 = 0x52;
const SET_MOTOR_PWM: u8 = 0xF0;
/// Types of answers, with their lengths.
const HEALTH: (u8, u32) = (0x06, 3);
const SAMPLE: (u8, u32) = (0x81, 5);
const CAPSULE: (u8, u32) = (0x82, 84);
const DENSE: (u8, u32) = (0x85, 84);
const CAPSULE_BYTES: usize = 84;
const SAMPLE_BYTES: usize = 5;
const CAPSULE_SAMPLES: usize = 32;
const DENSE_SAMPLES: usize = 40;
/// A turn (1/64 deg).
const TURN_Q6: u32 = 360 * 64;
/// Farthest that a sound capsule turns (1/64 deg): 40 samples of the slowest mode at 15 Hz.
const CAPSULE_Q6: u32 = TURN_Q6 / 6;
/// Two capsules further apart in time (s) do not follow each other.
const CAPSULE_S: f64 = 0.1;
/// Health that needs a reset.
const PROTECTION_STOP: u8 = 2;
/// Samples must come within this time (s) of the set-up; a motor takes two seconds to its speed.
const PATIENCE_S: f64 = 3.0;
/// Pause (s) after a command: the scanner needs 10 ms after STOP, and less after the others.
const PAUSE_S: f64 = 0.05;
/// The same after RESET.
const RESET_PAUSE_S: f64 = 2.0;

/// What the bytes after a descriptor are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ScanMode {
    Descriptor,
    Health,
    Samples,
    Capsules { dense: bool },
}

/// Byte stream to samples.
#[derive(Clone, Debug)]
pub struct Rplidar {
    window: SlidingWindow,
    mode: ScanMode,
    /// The capsule before, and when it ended.
    before: Option<([u8; CAPSULE_BYTES], Timestamp)>,
    /// How far the capsule before turned (1/64 deg): one that turns much farther has lost its neighbour.
    span_q6: Option<u32>,
    tally: SampleCounts,
    protection_stop: bool,
}

impl Default for Rplidar {
    fn default() -> Self {
        Self {
            window: SlidingWindow::EMPTY,
            mode: ScanMode::Descriptor,
            before: None,
            span_q6: None,
            tally: SampleCounts::default(),
            protection_stop: false,
        }
    }
}

/// What the first bytes of the window are.
enum Head {
    TooFew,
    Nothing,
    Damaged,
    Frame(usize),
}

impl Rplidar {
    /// The line was interrupted, or the scanner set up anew: an answer begins with its descriptor.
    pub fn interrupted(&mut self) {
        self.window = SlidingWindow::EMPTY;
        self.mode = ScanMode::Descriptor;
        self.before = None;
    }

    /// What has become of the bytes.
    pub fn tally(&self) -> SampleCounts {
        self.tally
    }

    /// Whether the scanner has reported that it has stopped to protect itself; once.
    pub fn take_protection_stop(&mut self) -> bool {
        std::mem::take(&mut self.protection_stop)
    }

    /// Takes a byte that ended at `end`, and hands over the samples of the frame that it completes.
    pub fn push(&mut self, end: Timestamp, byte: u8, sink: &mut dyn FnMut(Sample)) {
        self.window.push(byte);
        while self.window.length > 0 {
            let used = match self.head(end, sink) {
                Head::TooFew => return,
                Head::Frame(bytes) => bytes,
                Head::Nothing => {
                    self.tally.skipped_bytes += 1;
                    1
                }
                Head::Damaged => {
                    self.tally.damaged += 1;
                    self.before = None;
                    1
                }
            };
            self.window.drop_first(used);
        }
    }

    fn head(&mut self, end: Timestamp, sink: &mut dyn FnMut(Sample)) -> Head {
        let window = self.window;
        let bytes = window.bytes();
        match self.mode {
            ScanMode::Descriptor => self.descriptor(bytes),
            ScanMode::Health if bytes.len() < HEALTH.1 as usize => Head::TooFew,
            ScanMode::Health => {
                self.protection_stop |= bytes[0] == PROTECTION_STOP;
                self.mode = ScanMode::Descriptor;
                Head::Frame(HEALTH.1 as usize)
            }
            ScanMode::Samples => self.sample(bytes, end, sink),
            ScanMode::Capsules { dense } => self.capsule(bytes, end, dense, sink),
        }
    }

    fn descriptor(&mut self, bytes: &[u8]) -> Head {
        if !bytes.iter().zip(DESCRIPTOR).all(|(byte, head)| *byte == head) {
            return Head::Nothing;
        }
        if bytes.len() < DESCRIPTOR_BYTES {
            return Head::TooFew;
        }
        // Thirty bits of length, two for one response or many.
        let length = u32::from_le_bytes([bytes[2], bytes[3], bytes[4], bytes[5]]) & 0x3FFF_FFFF;
        self.mode = match (bytes[6], length) {
            HEALTH => ScanMode::Health,
            SAMPLE => ScanMode::Samples,
            CAPSULE => ScanMode::Capsules { dense: false },
            DENSE => ScanMode::Capsules { dense: true },
            _ => return Head::Nothing,
        };
        Head::Frame(DESCRIPTOR_BYTES)
    }

    fn sample(&mut self, bytes: &[u8], end: Timestamp, sink: &mut dyn FnMut(Sample)) -> Head {
        let opposite = (bytes[0] ^ bytes[0] >> 1) & 1 == 1;
        if !opposite || bytes.get(1).is_some_and(|byte| byte & 1 == 0) {
            return Head::Damaged;
        }
        if bytes.len() < SAMPLE_BYTES {
            return Head::TooFew;
        }
        let angle_q6 = u32::from(u16_at(bytes, 1) >> 1);
        if angle_q6 >= TURN_Q6 {
            return Head::Damaged;
        }
        self.tally.good += 1;
        sink(Sample {
            time: end,
            angle_deg: angle_q6 as f32 / 64.0,
            range_m: f32::from(u16_at(bytes, 3)) * 0.25e-3,
        });
        Head::Frame(SAMPLE_BYTES)
    }

    fn capsule(&mut self, bytes: &[u8], end: Timestamp, dense: bool, sink: &mut dyn FnMut(Sample)) -> Head {
        let marked = bytes
            .iter()
            .zip([0xA0, 0x50])
            .all(|(byte, mark)| byte & 0xF0 == mark);
        if !marked {
            return Head::Nothing;
        }
        let Some(capsule) = bytes.first_chunk::<CAPSULE_BYTES>() else {
            return Head::TooFew;
        };
        let said = bytes[0] & 0x0F | bytes[1] << 4;
        let sum = capsule[2..].iter().fold(0, |sum, byte| sum ^ byte);
        if said != sum || start_q6(capsule) >= TURN_Q6 {
            return Head::Damaged;
        }
        self.tally.good += 1;
        // The first one after a start has none before it.
        let starts = u16_at(capsule, 2) & 0x8000 != 0;
        let before = self.before.replace((*capsule, end)).filter(|_| !starts);
        if let Some((before, began)) = before.filter(|(_, began)| end.seconds_since(*began) <= CAPSULE_S) {
            let span_q6 = (start_q6(capsule) + TURN_Q6 - start_q6(&before)) % TURN_Q6;
            let gap = self.span_q6.is_some_and(|usual_q6| 2 * span_q6 > 3 * usual_q6);
            self.span_q6 = Some(span_q6).filter(|_| !gap);
            if span_q6 > CAPSULE_Q6 || gap {
                self.tally.damaged += 1;
            } else if dense {
                dense_samples(&before, span_q6, [began, end], sink);
            } else {
                express_samples(&before, span_q6, [began, end], sink);
            }
        }
        Head::Frame(CAPSULE_BYTES)
    }
}

fn start_q6(capsule: &[u8; CAPSULE_BYTES]) -> u32 {
    u32::from(u16_at(capsule, 2) & 0x7FFF)
}

/// The samples of a capsule were measured until it ended; the next one took as long.
fn time_of(index: usize, samples: usize, [began, end]: [Timestamp; 2]) -> Timestamp {
    let behind = (samples - 1 - index) as f64 / samples as f64;
    began.plus_seconds(-behind * end.seconds_since(began))
}

fn express_samples(
    capsule: &[u8; CAPSULE_BYTES],
    span_q6: u32,
    times: [Timestamp; 2],
    sink: &mut dyn FnMut(Sample),
) {
    let start_deg = start_q6(capsule) as f32 / 64.0;
    let step_deg = span_q6 as f32 / 64.0 / CAPSULE_SAMPLES as f32;
    for index in 0..CAPSULE_SAMPLES {
        let cabin = 4 + index / 2 * 5;
        let word = u16_at(capsule, cabin + index % 2 * 2);
        let low = if index % 2 == 0 {
            capsule[cabin + 4] & 0xF
        } else {
            capsule[cabin + 4] >> 4
        };
        let correction_q3 = u16::from(low) | (word & 3) << 4;
        let angle_deg = start_deg + index as f32 * step_deg - f32::from(correction_q3) / 8.0;
        sink(Sample {
            time: time_of(index, CAPSULE_SAMPLES, times),
            angle_deg: angle_deg.rem_euclid(360.0),
            range_m: f32::from(word >> 2) * 1e-3,
        });
    }
}

fn dense_samples(
    capsule: &[u8; CAPSULE_BYTES],
    span_q6: u32,
    times: [Timestamp; 2],
    sink: &mut dyn FnMut(Sample),
) {
    let start_deg = start_q6(capsule) as f32 / 64.0;
    let step_deg = span_q6 as f32 / 64.0 / DENSE_SAMPLES as f32;
    for index in 0..DENSE_SAMPLES {
        sink(Sample {
            time: time_of(index, DENSE_SAMPLES, times),
            angle_deg: (start_deg + index as f32 * step_deg).rem_euclid(360.0),
            range_m: f32::from(u16_at(capsule, 4 + 2 * index)) * 1e-3,
        });
    }
}

/// Commands of the set-up, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SetupStep {
    Reset,
    Stop,
    Health,
    Motor,
    Scan,
    Wait,
}

/// What is written to the scanner.
#[derive(Clone, Debug)]
pub struct Setup {
    motor_pwm: Option<u16>,
    step: SetupStep,
    due: Timestamp,
    /// SCAN instead of EXPRESS_SCAN this time.
    plain: bool,
    command: [u8; 9],
}

impl Setup {
    /// For a scanner whose motor is started with this duty cycle, if by a command.
    pub fn new(motor_pwm: Option<u16>) -> Self {
        Self {
            motor_pwm,
            step: SetupStep::Stop,
            due: Timestamp::NEVER,
            plain: false,
            command: [0; 9],
        }
    }

    /// The port was opened at `now`.
    pub fn begin(&mut self, now: Timestamp) {
        self.step = SetupStep::Stop;
        self.due = now;
    }

    /// The scanner has stopped to protect itself.
    pub fn reset(&mut self, now: Timestamp) {
        self.step = SetupStep::Reset;
        self.due = now;
    }

    /// When there may be something to write.
    pub fn due(&self) -> Timestamp {
        self.due
    }

    /// The next request to write now, and whether the response to it begins with a descriptor; `None` when there is
    /// nothing. `silent`: no samples have come for a while.
    pub fn next_write(&mut self, now: Timestamp, silent: bool) -> Option<&[u8]> {
        if now < self.due {
            return None;
        }
        let (command, length, next, pause_s) = match self.step {
            SetupStep::Reset => (plain(RESET), 2, SetupStep::Stop, RESET_PAUSE_S),
            SetupStep::Stop => (plain(STOP), 2, SetupStep::Health, PAUSE_S),
            SetupStep::Health => (plain(GET_HEALTH), 2, SetupStep::Motor, PAUSE_S),
            SetupStep::Motor => {
                self.step = SetupStep::Scan;
                let Some(pwm) = self.motor_pwm else {
                    return self.next_write(now, silent);
                };
                let [low, high] = pwm.to_le_bytes();
                (
                    with_data(SET_MOTOR_PWM, &[low, high]),
                    6,
                    SetupStep::Scan,
                    PAUSE_S,
                )
            }
            SetupStep::Scan if self.plain => (plain(SCAN), 2, SetupStep::Wait, PATIENCE_S),
            SetupStep::Scan => (with_data(EXPRESS_SCAN, &[0; 5]), 9, SetupStep::Wait, PATIENCE_S),
            SetupStep::Wait => {
                self.due = now.plus_seconds(1.0);
                if silent {
                    self.plain = !self.plain;
                    self.begin(now);
                    return self.next_write(now, silent);
                }
                return None;
            }
        };
        self.command = command;
        self.step = next;
        self.due = now.plus_seconds(pause_s);
        Some(&self.command[..length])
    }
}

fn plain(command: u8) -> [u8; 9] {
    let mut bytes = [0; 9];
    bytes[0] = START;
    bytes[1] = command;
    bytes
}

/// A command with data: their number, they, and the exclusive or of everything.
fn with_data(command: u8, data: &[u8]) -> [u8; 9] {
    let mut bytes = plain(command);
    bytes[2] = data.len() as u8;
    bytes[3..3 + data.len()].copy_from_slice(data);
    let end = 3 + data.len();
    bytes[end] = bytes[..end].iter().fold(0, |sum, byte| sum ^ byte);
    bytes
}
