//! The step: images that were dequeued become clouds, silence becomes a change to report.
//!
//! A measured image has noise: two of them are never the same to the last bit. One that repeats the image before it
//! shows what was, not what is; it is counted and not published, so that its readers find the sensor stale. An image
//! without any depth is published: it contains that nothing is known.

use crate::cloud_view::CloudView;
use crate::config::DepthCameraSpec;
use crate::flying::FlyingPixelFilter;
use jink_runtime::device::{DeviceChange, Rate, SilenceMonitor};
use jink_shared_types::Timestamp;

/// Silence that is reported to the pilot (s), and in periods: whichever is longer.
const SILENCE_S: f64 = 1.0;
const SILENCE_PERIODS: f64 = 4.0;
/// An image is dated by its driver if that is no longer ago than this (s): the buffers of a stalled stream hold less.
const STAMP_AGE_S: f64 = 1.0;

/// One buffer as the device handed it over.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    /// When it was dequeued.
    pub arrived: Timestamp,
    /// When it was captured, if the driver dates its buffers in CLOCK_MONOTONIC (V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC).
    pub stamp: Option<Timestamp>,
    /// The driver's count of images, with those that it has lost.
    pub sequence: u32,
    /// V4L2_BUF_FLAG_ERROR: the driver knows that the data are damaged.
    pub is_damaged: bool,
    /// Bytes from the beginning of one row to that of the next.
    pub row_bytes: usize,
    /// Depths in Z16: 16 bits each, the low byte first, row by row.
    pub bytes: &'a [u8],
}

/// What has become of the images since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DepthCameraCounters {
    /// Images that were published.
    pub good: u64,
    /// Images with V4L2_BUF_FLAG_ERROR.
    pub damaged: u64,
    /// Images with fewer bytes than their size needs.
    pub short: u64,
    /// Images that repeat the one before to the last bit.
    pub repeated: u64,
    /// Images that the driver counted and did not hand over.
    pub missed: u64,
    /// Images without a plausible time stamp, dated to their arrival.
    pub undated: u64,
    /// Pixels that were removed as flying pixels.
    pub flying_pixels: u64,
    /// Images published per second since the last look (Hz).
    pub rate_hz: f64,
}

/// One depth camera.
#[derive(Clone, Debug)]
pub struct DepthCameraDriver {
    spec: DepthCameraSpec,
    filter: FlyingPixelFilter,
    /// The image as it came, to be compared with the next one.
    raw: Vec<u16>,
    /// The same without flying pixels.
    depths: Vec<u16>,
    has_raw: bool,
    sequence: Option<u32>,
    /// Time of the newest image.
    newest: Timestamp,
    /// That of published images.
    silence: SilenceMonitor,
    counters: DepthCameraCounters,
    rate: Rate,
}

impl DepthCameraDriver {
    /// For the depth camera that `spec` describes; nothing is open yet.
    pub fn new(spec: DepthCameraSpec) -> Self {
        let [width_px, height_px] = spec.size_px.map(usize::from);
        Self {
            filter: FlyingPixelFilter::new(width_px, spec.flying_pixel_per_m, spec.depth_scale_m),
            raw: vec![0; width_px * height_px],
            depths: vec![0; width_px * height_px],
            has_raw: false,
            sequence: None,
            newest: Timestamp::NEVER,
            silence: SilenceMonitor::new(SILENCE_S.max(SILENCE_PERIODS / spec.rate_hz)),
            counters: DepthCameraCounters::default(),
            rate: Rate::default(),
            spec,
        }
    }

    /// What it is.
    pub fn spec(&self) -> &DepthCameraSpec {
        &self.spec
    }

    /// The stream was started: its count begins anew.
    pub fn connected(&mut self) {
        self.sequence = None;
        self.has_raw = false;
    }

    /// Takes an image, and hands the cloud that it becomes to `publish`, if it becomes one.
    pub fn image(&mut self, image: &Image<'_>, publish: &mut impl FnMut(&CloudView<'_>)) {
        self.count_missed(image.sequence);
        if image.is_damaged {
            self.counters.damaged += 1;
            return;
        }
        let Some(is_new) = self.copy(image) else {
            self.counters.short += 1;
            return;
        };
        if !is_new {
            self.counters.repeated += 1;
            return;
        }
        let capture = self.date(image);
        self.depths.copy_from_slice(&self.raw);
        self.counters.flying_pixels += self.filter.remove(&mut self.depths) as u64;
        self.counters.good += 1;
        self.silence.received(image.arrived);
        publish(&CloudView {
            spec: &self.spec,
            capture,
            depths: &self.depths,
        });
    }

    /// Whether the camera has fallen silent, or measures again; once per change.
    pub fn take_change(&mut self, now: Timestamp) -> Option<DeviceChange> {
        self.silence.take_change(now)
    }

    /// What has become of the images, with the rate since the last look.
    pub fn counters(&mut self, now: Timestamp) -> DepthCameraCounters {
        DepthCameraCounters {
            rate_hz: self.rate.look(now, self.counters.good),
            ..self.counters
        }
    }

    fn count_missed(&mut self, sequence: u32) {
        if let Some(before) = self.sequence {
            // A count that goes back has begun anew.
            let missed = sequence.wrapping_sub(before).wrapping_sub(1);
            if missed < u32::MAX / 2 {
                self.counters.missed += u64::from(missed);
            }
        }
        self.sequence = Some(sequence);
    }

    /// Copies the image out of the device's memory. Whether it differs from the one before, or has no depth at all;
    /// `None` if it is too short.
    fn copy(&mut self, image: &Image<'_>) -> Option<bool> {
        let [width_px, height_px] = self.spec.size_px.map(usize::from);
        let row_bytes = image.row_bytes.max(2 * width_px);
        let needed = (height_px - 1)
            .checked_mul(row_bytes)?
            .checked_add(2 * width_px)?;
        let bytes = image.bytes.get(..needed)?;
        let (mut changed, mut any) = (0, 0);
        for (row, bytes) in self.raw.chunks_exact_mut(width_px).zip(bytes.chunks(row_bytes)) {
            for (depth, pair) in row.iter_mut().zip(bytes.chunks_exact(2)) {
                let new = u16::from_le_bytes([pair[0], pair[1]]);
                changed |= *depth ^ new;
                any |= new;
                *depth = new;
            }
        }
        let is_first = !std::mem::replace(&mut self.has_raw, true);
        Some(is_first || changed != 0 || any == 0)
    }

    /// When the image was captured. Stamps are accepted that lie shortly before the arrival and after the image before.
    fn date(&mut self, image: &Image<'_>) -> Timestamp {
        let believed = image.stamp.filter(|stamp| {
            *stamp > self.newest
                && *stamp <= image.arrived
                && image.arrived.seconds_since(*stamp) <= STAMP_AGE_S
        });
        self.counters.undated += u64::from(believed.is_none());
        // Two images that are dequeued in one cycle may arrive at the same time.
        self.newest = believed.unwrap_or_else(|| image.arrived.max(self.newest.plus_seconds(1e-6)));
        self.newest
    }
}
