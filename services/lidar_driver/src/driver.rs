//! The step of a network lidar: received datagrams become point clouds, silence becomes a change to report.
//!
//! **Time.** A datagram arrives when its last measurement is over, or later. [`SourceClock`] maps the sensor's own
//! stamps to the board's clock through the least delayed datagram of the last second, and every point has its own time.
//!
//! **Senders.** Without `sensor_address` the first sender whose datagram is sound is the sensor, until it has been
//! silent for a second.

use crate::cloud::CloudAssembler;
use crate::config::LidarSpec;
use crate::counters::{LOSS_S, LidarCounters};
use crate::decode::{Decode, Fault, Item};
use crate::decoder::Decoder;
use jink_runtime::device::{DeviceChange, Rate, SilenceMonitor};
use jink_shared_types::Timestamp;
use jink_shared_types::source_clock::SourceClock;
use std::net::IpAddr;

/// A scan ends when nothing has come for this time (s): twenty times as long as between packets of any model, and short
/// beside a turn, so that a sensor that sends a part of it only does not wait for the next one.
const PAUSE_S: f64 = 0.03;
/// Datagrams in a row that are late or doubled after which the stream has begun anew: three frames of a lidar.
const BEHIND: u32 = 200;
/// Silence (s) after which another sender may be the sensor.
const SENDER_S: f64 = 1.0;

/// One network lidar.
#[derive(Debug)]
pub struct NetworkLidarDriver {
    spec: LidarSpec,
    decoder: Option<Decoder>,
    clock: SourceClock,
    /// By how much the sensor's clock was set ahead (s), until that is reported.
    clock_step_s: Option<f64>,
    cloud: CloudAssembler,
    counters: LidarCounters,
    silence: SilenceMonitor,
    sender: Option<IpAddr>,
    /// Datagrams in a row that were late or doubled.
    behind: u32,
    /// When a datagram of the scan at hand came last.
    last: Timestamp,
    rate: Rate,
}

impl NetworkLidarDriver {
    /// For the lidar that `spec` describes; `decoder` is `None` as long as its metadata are not known.
    pub fn new(spec: LidarSpec, decoder: Option<Decoder>) -> Self {
        let mut driver = Self {
            decoder: None,
            clock: SourceClock::default(),
            clock_step_s: None,
            cloud: CloudAssembler::new(spec.cloud.clone(), None),
            counters: LidarCounters::default(),
            silence: SilenceMonitor::new(LOSS_S),
            sender: spec.sensor_address,
            behind: 0,
            last: Timestamp::NEVER,
            rate: Rate::default(),
            spec,
        };
        if let Some(decoder) = decoder {
            driver.known(decoder);
        }
        driver
    }

    /// From now on packets are decoded.
    pub fn known(&mut self, decoder: Decoder) {
        self.cloud = CloudAssembler::new(self.spec.cloud.clone(), decoder.directions());
        self.decoder = Some(decoder);
    }

    /// Whether neighbouring columns are merged, because a scan can have more points than a cloud.
    pub fn merges(&self) -> bool {
        self.cloud.merges()
    }

    /// What it is.
    pub fn spec(&self) -> &LidarSpec {
        &self.spec
    }

    /// The address that is taken for the sensor's.
    pub fn sender(&self) -> Option<IpAddr> {
        self.sender
    }

    /// The source was opened anew: the mapping of the sensor's clock, and the unfinished scan, are dropped.
    pub fn connected(&mut self) {
        self.clock = SourceClock::default();
        self.cloud.clear();
        if let Some(decoder) = &mut self.decoder {
            decoder.finish(&mut |_| {});
            decoder.restart();
        }
        self.behind = 0;
    }

    /// Takes a datagram that arrived at `arrived` from `source`, and hands every cloud that it completes to `publish`.
    pub fn datagram(
        &mut self,
        arrived: Timestamp,
        source: IpAddr,
        bytes: &[u8],
        publish: &mut dyn FnMut(&CloudAssembler),
    ) {
        let Some(decoder) = &mut self.decoder else {
            return;
        };
        let free = self.spec.sensor_address.is_none() && self.silence.is_silent(arrived, SENDER_S);
        if !free && self.sender.is_some_and(|sender| sender != source) {
            self.counters.count(Fault::Foreign);
            return;
        }
        let Self {
            clock,
            clock_step_s,
            cloud,
            counters,
            ..
        } = self;
        let decoded = decoder.packet(bytes, &mut |item| match item {
            Item::ScanEnds { lost } => end(cloud, counters, lost, publish),
            Item::Packet { first_ns, last_ns } => {
                if let Some(step) = clock.observe(last_ns, arrived) {
                    *clock_step_s = Some(step.ahead_s);
                }
                cloud.packet(clock.map(first_ns), clock.map(last_ns));
            }
            Item::Ray(ray) => cloud.ray(clock.map(ray.stamp_ns), &ray),
        });
        match decoded {
            Ok(()) => {
                self.behind = 0;
                self.counters.good += 1;
                self.sender = Some(source);
                self.silence.received(arrived);
                self.last = arrived;
            }
            Err(fault) => {
                self.counters.count(fault);
                self.behind = match fault {
                    Fault::Late | Fault::Doubled => self.behind + 1,
                    _ => self.behind,
                };
                // A sensor that has started anew counts, and dates, from an earlier place.
                if self.behind >= BEHIND {
                    self.connected();
                }
            }
        }
    }

    /// Ends a scan of which nothing more comes.
    pub fn tick(&mut self, now: Timestamp, publish: &mut dyn FnMut(&CloudAssembler)) {
        if now < self.due() {
            return;
        }
        self.last = Timestamp::NEVER;
        let Self {
            cloud,
            counters,
            decoder,
            ..
        } = self;
        if let Some(decoder) = decoder {
            decoder.finish(&mut |item| {
                if let Item::ScanEnds { lost } = item {
                    end(cloud, counters, lost, publish);
                }
            });
        }
    }

    /// When [`Self::tick`] has something to do even if nothing arrives.
    pub fn due(&self) -> Timestamp {
        if self.last.is_set() {
            self.last.plus_seconds(PAUSE_S)
        } else {
            Timestamp::from_ns(u64::MAX)
        }
    }

    /// Whether nothing was measured for `silence_s`.
    pub fn is_silent(&self, now: Timestamp, silence_s: f64) -> bool {
        self.silence.is_silent(now, silence_s)
    }

    /// Whether the sensor has fallen silent, or measures again; once per change.
    pub fn take_change(&mut self, now: Timestamp) -> Option<DeviceChange> {
        self.silence.take_change(now)
    }

    /// By how much the sensor's clock was set ahead (s); once per step.
    pub fn take_clock_step(&mut self) -> Option<f64> {
        self.clock_step_s.take()
    }

    /// What has become of its packets, with the rate since the last look.
    pub fn counters(&mut self, now: Timestamp) -> LidarCounters {
        self.counters.rate_hz = self.rate.look(now, self.counters.published);
        self.counters.overflow = self.cloud.overflow();
        self.counters
    }
}

fn end(
    cloud: &mut CloudAssembler,
    counters: &mut LidarCounters,
    lost: u32,
    publish: &mut dyn FnMut(&CloudAssembler),
) {
    counters.lost += u64::from(lost);
    if !cloud.is_empty() {
        counters.published += 1;
        publish(cloud);
    }
    cloud.clear();
}
