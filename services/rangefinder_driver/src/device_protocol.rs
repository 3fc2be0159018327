//! What the driver writes to a device: nothing, requests at a fixed rate, or a set-up that is repeated until
//! measurements come.
//!
//! | devices | what is written |
//! |---|---|
//! | Lanbao, Benewake | nothing: they stream by themselves |
//! | SF11/C, LW20/C | `www` and a line end (an LW20 needs some bytes to choose its serial line), then `d` 40 times a second; both again after a second of silence |
//! | SF45/B | stream off, fields, rate, speed, angles, scan on, stream on, one by one as each is acknowledged; all again after half a second without measurements |
//!
//! The SF45/B forgets its stream when it is reset, so silence is all that has to be watched.

use crate::crc::xmodem;
use crate::decode::WireFormat;
use crate::decode::sf45;
use jink_shared_types::Timestamp;

/// Requests per second for a text device, which measures 20 times a second and answers with its latest result: each
/// result comes twice, so that a value damaged on the line can be distinguished from a measured one.
const REQUESTS_HZ: u32 = 40;
/// Silence after which a text device is woken again (s).
const TEXT_SILENCE_S: f64 = 1.0;
/// Silence after which a scanning device is set up again (s): hundreds of its measurements, and less than the pause of
/// its reset.
const SF45_SILENCE_S: f64 = 0.5;
/// Time for an acknowledgement (s); it takes milliseconds.
const ACKNOWLEDGE_S: f64 = 0.1;
/// How often a command is sent before the set-up goes on without it: an older firmware may not know it.
const ATTEMPTS: u32 = 3;

/// Number of commands in the set-up of an SF45/B.
const COMMANDS: usize = 8;
/// Head, number, at most four bytes, checksum.
const PACKET_BYTES: usize = 10;

/// Readings per second that an SF45/B offers, with their codes.
const SF45_RATES: [(f64, u8); 12] = [
    (50.0, 1),
    (100.0, 2),
    (200.0, 3),
    (400.0, 4),
    (500.0, 5),
    (625.0, 6),
    (1000.0, 7),
    (1250.0, 8),
    (1538.0, 9),
    (2000.0, 10),
    (2500.0, 11),
    (5000.0, 12),
];
/// Share of the line that measurements may fill: the rest is for acknowledgements and for a clock that is a little off.
const LINE_SHARE: f64 = 0.7;

/// The set-up of a scanning device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanSetup {
    /// Its line (bit/s).
    pub baud: u32,
    /// Most measurements per second (Hz).
    pub rate_hz: f64,
    /// Leftmost direction (deg), negative.
    pub low_deg: f32,
    /// Rightmost direction (deg), positive.
    pub high_deg: f32,
}

impl ScanSetup {
    /// Code and readings per second (Hz): the fastest that is asked for and that the line carries.
    pub fn rate(&self) -> (u8, f64) {
        let carried_hz = LINE_SHARE / sf45::frame_s(self.baud);
        let most_hz = self.rate_hz.min(carried_hz);
        let fits = SF45_RATES.iter().rev().find(|(rate_hz, _)| *rate_hz <= most_hz);
        let (rate_hz, code) = fits.unwrap_or(&SF45_RATES[0]);
        (*code, *rate_hz)
    }
}

/// One command as it goes over the line.
#[derive(Clone, Copy, Debug)]
struct Packet {
    bytes: [u8; PACKET_BYTES],
    len: usize,
}

impl Packet {
    /// A write of `data` to command `number`.
    fn write(number: u8, data: &[u8]) -> Self {
        let mut bytes = [0; PACKET_BYTES];
        let data = &data[..data.len().min(PACKET_BYTES - 6)];
        let flags = ((data.len() as u16 + 1) << 6) | 1;
        bytes[0] = 0xAA;
        bytes[1..3].copy_from_slice(&flags.to_le_bytes());
        bytes[3] = number;
        let end = 4 + data.len();
        bytes[4..end].copy_from_slice(data);
        let crc = xmodem(&bytes[..end]);
        bytes[end..end + 2].copy_from_slice(&crc.to_le_bytes());
        Self { bytes, len: end + 2 }
    }

    fn number(&self) -> u8 {
        self.bytes[3]
    }
}

/// The driver's side of one device's protocol.
#[derive(Clone, Debug)]
pub enum DeviceProtocol {
    /// Nothing.
    Silent,
    /// Requests.
    PollRequests(PollRequests),
    /// A set-up.
    SetUpSequence(SetUpSequence),
}

impl DeviceProtocol {
    /// For a device that sends `format`.
    pub fn new(format: WireFormat, scan: &ScanSetup) -> Self {
        match format {
            WireFormat::Cm8jl65 | WireFormat::Benewake(_) => Self::Silent,
            WireFormat::LightwareText => Self::PollRequests(PollRequests::default()),
            WireFormat::Sf45 => Self::SetUpSequence(SetUpSequence::new(scan)),
        }
    }

    /// The line is new: begin from the beginning.
    pub fn begin(&mut self, now: Timestamp) {
        match self {
            Self::Silent => {}
            Self::PollRequests(requests) => *requests = PollRequests::default(),
            Self::SetUpSequence(set_up) => set_up.restart(now),
        }
    }

    /// A measurement came.
    pub fn measured(&mut self, now: Timestamp) {
        match self {
            Self::Silent => {}
            Self::PollRequests(requests) => requests.last_measured = now,
            Self::SetUpSequence(set_up) => set_up.last_measured = now,
        }
    }

    /// The device has accepted a command.
    pub fn acknowledged(&mut self, number: u8) {
        if let Self::SetUpSequence(set_up) = self {
            set_up.acknowledged(number);
        }
    }

    /// The next bytes to write now; `None` when there are none left.
    pub fn next_write(&mut self, now: Timestamp) -> Option<&[u8]> {
        match self {
            Self::Silent => None,
            Self::PollRequests(requests) => requests.next_write(now),
            Self::SetUpSequence(set_up) => set_up.next_write(now),
        }
    }

    /// When to call again if nothing arrives.
    pub fn due(&self, now: Timestamp) -> Timestamp {
        match self {
            Self::Silent => Timestamp::from_ns(u64::MAX),
            Self::PollRequests(requests) => requests.due,
            Self::SetUpSequence(_) => now.plus_seconds(ACKNOWLEDGE_S),
        }
    }
}

/// Requests at a fixed rate.
#[derive(Clone, Debug, Default)]
pub struct PollRequests {
    last_measured: Timestamp,
    woken: Timestamp,
    due: Timestamp,
}

impl PollRequests {
    fn next_write(&mut self, now: Timestamp) -> Option<&[u8]> {
        let quiet_since = self.last_measured.max(self.woken);
        if !quiet_since.is_set() || now.seconds_since(quiet_since) > TEXT_SILENCE_S {
            self.woken = now;
            self.due = now.next_beat(REQUESTS_HZ);
            return Some(b"www\r\n");
        }
        if now < self.due {
            return None;
        }
        self.due = now.next_beat(REQUESTS_HZ);
        Some(b"d")
    }
}

/// A set-up, command by command.
#[derive(Clone, Debug)]
pub struct SetUpSequence {
    packets: [Packet; COMMANDS],
    /// The command in progress; beyond the last one: done.
    next: usize,
    /// How often it was sent, and when last.
    attempts: u32,
    sent: Timestamp,
    last_measured: Timestamp,
}

impl SetUpSequence {
    fn new(scan: &ScanSetup) -> Self {
        Self {
            packets: [
                // Nothing comes between the acknowledgements.
                Packet::write(30, &0u32.to_le_bytes()),
                // First return unfiltered, and yaw.
                Packet::write(27, &0x101u32.to_le_bytes()),
                Packet::write(66, &[scan.rate().0]),
                // The shortest delay between steps: the fastest scan.
                Packet::write(85, &5u16.to_le_bytes()),
                Packet::write(98, &scan.low_deg.to_le_bytes()),
                Packet::write(99, &scan.high_deg.to_le_bytes()),
                Packet::write(96, &[1]),
                // Distances in cm, as they are measured.
                Packet::write(30, &5u32.to_le_bytes()),
            ],
            next: 0,
            attempts: 0,
            sent: Timestamp::NEVER,
            last_measured: Timestamp::NEVER,
        }
    }

    fn restart(&mut self, now: Timestamp) {
        self.next = 0;
        self.attempts = 0;
        self.last_measured = now;
    }

    fn acknowledged(&mut self, number: u8) {
        let awaited = self.packets.get(self.next);
        if self.attempts > 0 && awaited.is_some_and(|packet| packet.number() == number) {
            self.next_command();
        }
    }

    fn next_command(&mut self) {
        self.next += 1;
        self.attempts = 0;
    }

    fn next_write(&mut self, now: Timestamp) -> Option<&[u8]> {
        if self.next == COMMANDS {
            let quiet_since = self.last_measured.max(self.sent);
            if now.seconds_since(quiet_since) <= SF45_SILENCE_S {
                return None;
            }
            self.restart(now);
        }
        if self.attempts > 0 && now.seconds_since(self.sent) < ACKNOWLEDGE_S {
            return None;
        }
        if self.attempts == ATTEMPTS {
            self.next_command();
        }
        let packet = self.packets.get(self.next)?;
        self.attempts += 1;
        self.sent = now;
        Some(&packet.bytes[..packet.len])
    }
}

#[cfg(test)]
mod tests {
    use super::{DeviceProtocol, ScanSetup};
    use crate::decode::WireFormat;
    use jink_shared_types::Timestamp;

    const SCAN: ScanSetup = ScanSetup {
        baud: 921_600,
        rate_hz: 1000.0,
        low_deg: -160.0,
        high_deg: 160.0,
    };

    fn at(t_s: f64) -> Timestamp {
        Timestamp::from_seconds(100.0 + t_s)
    }

    #[test]
    fn the_rate_is_one_that_the_line_carries() {
        let rate = |baud| ScanSetup { baud, ..SCAN }.rate();
        assert_eq!(rate(921_600), (7, 1000.0));
        assert_eq!(rate(115_200), (6, 625.0));
        assert_eq!(rate(9_600), (1, 50.0));
    }

    #[test]
    fn a_command_without_acknowledgement_is_skipped_in_the_end() {
        let mut device = DeviceProtocol::new(WireFormat::Sf45, &SCAN);
        device.begin(at(0.0));
        let mut numbers = Vec::new();
        for step in 0..40 {
            let now = at(f64::from(step) * 0.06);
            while let Some(bytes) = device.next_write(now) {
                numbers.push(bytes[3]);
            }
        }
        assert_eq!(numbers[..7], [30, 30, 30, 27, 27, 27, 66]);
    }

    #[test]
    fn requests_keep_their_rate_and_wake_the_device_after_silence() {
        let mut device = DeviceProtocol::new(WireFormat::LightwareText, &SCAN);
        device.begin(at(0.0));
        let (mut requests, mut wakings) = (0, 0);
        for ms in 0..2_000 {
            let now = at(f64::from(ms) * 1e-3);
            while let Some(bytes) = device.next_write(now) {
                match bytes {
                    b"d" => requests += 1,
                    _ => wakings += 1,
                }
            }
            if ms < 500 {
                device.measured(now);
            }
        }
        assert_eq!(wakings, 2, "at the start, and a second after the last answer");
        assert!((78..=80).contains(&requests), "{requests}");
    }
}
