//! The step: received bytes become scans, silence becomes a change to report.
//!
//! **Time.** A byte that was read at some moment has been on the wire before: the last one for the time of one byte,
//! each one before it for one byte longer, and a frame began as long before its last byte as it has bytes. So a
//! measurement is dated to the beginning of its frame, which the device sends when it has measured. What a USB adapter
//! keeps back (an FTDI chip up to 16 ms) cannot be detected here.

use crate::beam_filter::BeamFilter;
use crate::config::RangefinderSpec;
use crate::decode::{Decoder, DeviceFrame, FrameContent};
use crate::device_protocol::DeviceProtocol;
use crate::devices::Range;
use crate::scan_assembler::{ScanAssembler, ScanPart};
use crate::scan_view::ScanView;
use jink_runtime::device::{DeviceChange, Rate, SilenceMonitor};
use jink_shared_types::Timestamp;

/// Bits of a byte on the line: a start and a stop bit besides its own eight.
const BITS_PER_BYTE: f64 = 10.0;
/// Silence that is reported to the pilot (s): four times as long as a scan counts, so that a device that is set up
/// again within half a second is not reported.
const SILENCE_S: f64 = 1.0;

/// What was received on the line since it was opened first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RangefinderCounters {
    /// Measurements that were read.
    pub good: u64,
    /// What looked like a frame and was none.
    pub damaged: u64,
    /// Bytes that belong to no frame.
    pub skipped_bytes: u64,
    /// Measurements per second since the last call (Hz).
    pub rate_hz: f64,
}

#[derive(Clone, Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "there is one in a process: a box would save nothing"
)]
enum Assembly {
    Beam(BeamFilter),
    Scan(ScanAssembler),
}

/// One rangefinder.
#[derive(Clone, Debug)]
pub struct RangefinderDriver {
    spec: RangefinderSpec,
    byte_s: f64,
    decoder: Decoder,
    device: DeviceProtocol,
    assembly: Assembly,
    measured: u64,
    /// Time of the newest measurement.
    newest: Timestamp,
    silence: SilenceMonitor,
    rate: Rate,
}

impl RangefinderDriver {
    /// For the rangefinder that `spec` describes; nothing is open yet.
    pub fn new(spec: RangefinderSpec) -> Self {
        let period_s = 1.0 / spec.rate_hz;
        let assembly = if spec.model.scans {
            Assembly::Scan(ScanAssembler::new(period_s))
        } else {
            Assembly::Beam(BeamFilter::new(period_s, spec.model.confirm, spec.sigma_m))
        };
        Self {
            byte_s: BITS_PER_BYTE / f64::from(spec.baud),
            decoder: Decoder::new(spec.model.format),
            device: DeviceProtocol::new(spec.model.format, &spec.scan),
            assembly,
            measured: 0,
            newest: Timestamp::NEVER,
            silence: SilenceMonitor::new(SILENCE_S),
            rate: Rate::default(),
            spec,
        }
    }

    /// What it is.
    pub fn spec(&self) -> &RangefinderSpec {
        &self.spec
    }

    /// The port was opened at `now`: unfinished frames and scans are dropped, the set-up begins.
    pub fn connected(&mut self, now: Timestamp) {
        self.decoder.interrupted();
        self.device.begin(now);
        match &mut self.assembly {
            Assembly::Beam(beam) => beam.clear(),
            Assembly::Scan(scan) => scan.clear(),
        }
    }

    /// Takes `bytes` that were read at `arrived`, and hands every scan they complete to `publish`.
    pub fn bytes(&mut self, arrived: Timestamp, bytes: &[u8], publish: &mut impl FnMut(&ScanView<'_>)) {
        for (index, byte) in bytes.iter().enumerate() {
            let behind = (bytes.len() - index) as f64;
            let end = arrived.plus_seconds(-(behind - 1.0) * self.byte_s);
            // A frame in 16 bytes at most, two of them at most: on the stack.
            let mut frames: [Option<DeviceFrame>; 2] = [None; 2];
            let mut count = 0;
            self.decoder.push(*byte, |frame| {
                if let Some(place) = frames.get_mut(count) {
                    *place = Some(frame);
                    count += 1;
                }
            });
            for frame in frames.into_iter().flatten() {
                let began = end.plus_seconds(-(frame.bytes as f64) * self.byte_s);
                self.frame(arrived, began, frame.item, publish);
            }
        }
    }

    /// Ends what is due at `now`, data or not.
    pub fn tick(&mut self, now: Timestamp, publish: &mut impl FnMut(&ScanView<'_>)) {
        let due = match &self.assembly {
            Assembly::Beam(beam) => beam.due(),
            Assembly::Scan(scan) => scan.due(),
        };
        if now >= due {
            self.close(publish);
        }
    }

    /// The next bytes to write to the device now; `None` when there are none left.
    pub fn next_write(&mut self, now: Timestamp) -> Option<&[u8]> {
        self.device.next_write(now)
    }

    /// When [`Self::tick`] and [`Self::next_write`] have something to do even if nothing arrives.
    pub fn due(&self, now: Timestamp) -> Timestamp {
        let assembled = match &self.assembly {
            Assembly::Beam(beam) => beam.due(),
            Assembly::Scan(scan) => scan.due(),
        };
        assembled.min(self.device.due(now))
    }

    /// Whether the sensor has fallen silent, or measures again; once per change.
    pub fn take_change(&mut self, now: Timestamp) -> Option<DeviceChange> {
        self.silence.take_change(now)
    }

    /// What was received on the line, with the rate since the last call.
    pub fn counters(&mut self, now: Timestamp) -> RangefinderCounters {
        let counts = self.decoder.counts();
        RangefinderCounters {
            good: self.measured,
            damaged: counts.damaged,
            skipped_bytes: counts.skipped_bytes,
            rate_hz: self.rate.look(now, self.measured),
        }
    }

    fn frame(
        &mut self,
        arrived: Timestamp,
        began: Timestamp,
        item: FrameContent,
        publish: &mut impl FnMut(&ScanView<'_>),
    ) {
        match item {
            FrameContent::Acknowledged(number) => self.device.acknowledged(number),
            FrameContent::Measured { yaw_rad, answer } => {
                self.measured += 1;
                self.silence.received(arrived);
                self.device.measured(arrived);
                let range = self.spec.reach.range(answer);
                // Two reads in quick succession may date their bytes in each other's time.
                self.newest = began.max(self.newest);
                self.measurement(self.newest, yaw_rad, range, publish);
            }
        }
    }

    fn measurement(
        &mut self,
        time: Timestamp,
        yaw_rad: f32,
        range: Range,
        publish: &mut impl FnMut(&ScanView<'_>),
    ) {
        let ends = match &self.assembly {
            Assembly::Beam(beam) => time >= beam.due(),
            Assembly::Scan(scan) => scan.ends_before(time, yaw_rad),
        };
        if ends {
            self.close(publish);
        }
        match &mut self.assembly {
            Assembly::Beam(beam) => beam.take(time, range),
            Assembly::Scan(scan) => scan.take(time, yaw_rad, range),
        }
    }

    fn close(&mut self, publish: &mut impl FnMut(&ScanView<'_>)) {
        let Self { spec, assembly, .. } = self;
        match assembly {
            Assembly::Beam(beam) => {
                if let Some(result) = beam.close() {
                    publish(&ScanView {
                        spec,
                        first_beam: result.time,
                        capture: result.time,
                        angle_first_rad: 0.0,
                        angle_step_rad: 0.0,
                        range_m: &[result.range_m],
                    });
                }
            }
            Assembly::Scan(scan) => {
                if let Some(part) = scan.close() {
                    publish(&part_view(spec, &part));
                }
            }
        }
    }
}

fn part_view<'a>(spec: &'a RangefinderSpec, part: &ScanPart<'a>) -> ScanView<'a> {
    ScanView {
        spec,
        first_beam: part.first_beam,
        capture: part.capture,
        angle_first_rad: part.angle_first_rad,
        angle_step_rad: part.angle_step_rad,
        range_m: part.range_m,
    }
}
