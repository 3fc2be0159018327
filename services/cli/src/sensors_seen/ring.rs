//! What the guard's ring has shown over some time.

use super::circle::{Interval, Sectors};
use super::timing::Timing;
use jink_control::figures::round;
use jink_shared_types::SampleHeader;
use jink_shared_types::quantile::quantile;
use jink_shared_types::ring::{SECTORS, SectorRing};
use serde::Serialize;

/// The guard's ring over some time.
#[derive(Clone, Debug)]
pub struct RingSeen {
    /// When it came.
    pub timing: Timing,
    rings: u64,
    unknown: [u64; SECTORS],
    /// How old the oldest direction was that each ring knew (s).
    oldest_s: Vec<f64>,
    heading_rad: f64,
}

impl Default for RingSeen {
    fn default() -> Self {
        Self {
            timing: Timing::default(),
            rings: 0,
            unknown: [0; SECTORS],
            oldest_s: Vec::new(),
            heading_rad: 0.0,
        }
    }
}

impl RingSeen {
    /// Takes the next one.
    pub fn take(&mut self, ring: &SectorRing, header: &SampleHeader) {
        self.timing.take(header);
        self.rings += 1;
        self.heading_rad = ring.attitude.yaw_rad();
        let mut oldest_s: Option<f64> = None;
        for sector in 0..SECTORS {
            if ring.distance_m[sector].is_nan() {
                self.unknown[sector] += 1;
            } else {
                let age_s = header.publish.seconds_since(ring.seen[sector]);
                oldest_s = Some(oldest_s.map_or(age_s, |oldest_s| oldest_s.max(age_s)));
            }
        }
        self.oldest_s.extend(oldest_s);
    }

    /// The vehicle's heading (rad), as the newest ring has it.
    pub fn heading_rad(&self) -> f64 {
        self.heading_rad
    }

    /// Directions that were unknown in half of the rings or more; all, if none came.
    pub fn blind(&self) -> Sectors {
        Sectors::of(|sector| 2 * self.unknown[sector] >= self.rings)
    }

    /// Directions that were unknown in one ring of twenty or more, and not blind.
    pub fn flickering(&self) -> Sectors {
        let blind = self.blind();
        Sectors::of(|sector| {
            !blind.0[sector] && self.unknown[sector] > 0 && 20 * self.unknown[sector] >= self.rings
        })
    }

    /// Age of the oldest direction that a ring knows (s): the `share` quantile; `None` if it never knew one.
    pub fn age_s(&self, share: f64) -> Option<f64> {
        quantile(&self.oldest_s, share)
    }

    /// For scripts.
    pub fn figures(&self) -> RingFigures {
        let ms = |seconds: Option<f64>| seconds.map(|s| round(s * 1e3));
        let blind = self.blind();
        RingFigures {
            rate_hz: self.timing.rate_hz().map(round),
            age_p50_ms: ms(self.age_s(0.5)),
            age_p99_ms: ms(self.age_s(0.99)),
            known_deg: 360.0 - blind.width_deg(),
            blind: blind.intervals(),
            flickering: self.flickering().intervals(),
        }
    }
}

/// The figures of the ring.
#[derive(Clone, Debug, Serialize)]
pub struct RingFigures {
    /// How often it came (Hz).
    pub rate_hz: Option<f64>,
    /// Age of the oldest direction that it knows (ms): in half of the rings it is younger.
    pub age_p50_ms: Option<f64>,
    /// In 99 of 100 (ms).
    pub age_p99_ms: Option<f64>,
    /// How much of the horizon is known (deg).
    pub known_deg: f64,
    /// What is not.
    pub blind: Vec<Interval>,
    /// What comes and goes.
    pub flickering: Vec<Interval>,
}
