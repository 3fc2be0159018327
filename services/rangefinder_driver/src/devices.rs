//! The models: everything that differs between them, in one table.
//!
//! docs/rangefinders.md says which devices they are.
//!
//! Every beam is a round cone: its opening angle is the same in height and in width.
//!
//! How a measurement is interpreted is decided here, for all models alike ([`Reach::range`]):
//!
//! | measurement | becomes |
//! |---|---|
//! | nearer than the device measures | an obstacle right before the shortest range: never nothing |
//! | within the configured range (`range_max_m`) | a hit |
//! | beyond that, within the device's own range | nothing up to `range_max_m`: what reflected is behind it |
//! | beyond the device's own range | unknown |
//! | "nothing in range", where the manual defines it | nothing up to `range_max_m` |
//! | weak or saturated signal | unknown |
//!
//! Ranges hold for things that reflect well; dark or mirroring ones are measured from nearer only. `range_max_m` in the
//! configuration should be the range at which the expected obstacles are still measured.
//!
//! Sources: those of [`crate::decode`]; 6 m for the Lanbao is ArduPilot's figure (the data sheet says 8 m).

use crate::decode::{RangeReading, WireFormat, benewake};

/// One model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangefinderModel {
    /// Name in the configuration.
    pub name: &'static str,
    /// The format in which it sends.
    pub format: WireFormat,
    /// Its line as delivered, or as its page in the documentation says to set it up (bit/s).
    pub baud: u32,
    /// Full opening angle of its beam (deg).
    pub beam_width_deg: f64,
    /// Measurements per second as delivered, or as the driver asks for (Hz).
    pub rate_hz: f64,
    /// Shortest range (m).
    pub range_min_m: f64,
    /// Longest range (m).
    pub range_max_m: f64,
    /// One standard deviation of a range (m): half of the accuracy in the data sheet.
    pub sigma_m: f64,
    /// It turns its beam.
    pub scans: bool,
    /// A frame can be damaged and look sound: a measurement counts when a second one agrees.
    pub confirm: bool,
}

const fn benewake(
    name: &'static str,
    beam_width_deg: f64,
    range_m: [f64; 2],
    rules: benewake::SignalLimits,
) -> RangefinderModel {
    RangefinderModel {
        name,
        format: WireFormat::Benewake(rules),
        baud: 115_200,
        beam_width_deg,
        rate_hz: 100.0,
        range_min_m: range_m[0],
        range_max_m: range_m[1],
        sigma_m: 0.03,
        scans: false,
        confirm: true,
    }
}

const fn lightware_text(name: &'static str, beam_width_deg: f64, range_max_m: f64) -> RangefinderModel {
    RangefinderModel {
        name,
        format: WireFormat::LightwareText,
        baud: 115_200,
        beam_width_deg,
        rate_hz: 20.0,
        range_min_m: 0.2,
        range_max_m,
        sigma_m: 0.05,
        scans: false,
        confirm: true,
    }
}

/// Strengths of the TFmini-S and the TFmini Plus.
const S_AND_PLUS: benewake::SignalLimits = benewake::SignalLimits {
    strength_min: 101,
    strength_max: 65_534,
    beyond_cm: None,
};

/// Every model.
pub const TABLE: &[RangefinderModel] = &[
    RangefinderModel {
        name: "sf45b",
        format: WireFormat::Sf45,
        baud: 921_600,
        beam_width_deg: 0.5,
        rate_hz: 1000.0,
        range_min_m: 0.2,
        range_max_m: 50.0,
        sigma_m: 0.05,
        scans: true,
        confirm: false,
    },
    RangefinderModel {
        name: "cm8jl65",
        format: WireFormat::Cm8jl65,
        baud: 115_200,
        beam_width_deg: 2.8,
        rate_hz: 20.0,
        range_min_m: 0.17,
        range_max_m: 6.0,
        sigma_m: 0.03,
        scans: false,
        confirm: false,
    },
    benewake(
        "tfmini",
        2.3,
        [0.3, 12.0],
        benewake::SignalLimits {
            strength_min: 20,
            strength_max: 2_000,
            beyond_cm: Some(1_200),
        },
    ),
    benewake("tfmini_s", 2.0, [0.1, 12.0], S_AND_PLUS),
    benewake("tfmini_plus", 3.6, [0.1, 12.0], S_AND_PLUS),
    benewake(
        "tf_luna",
        2.0,
        [0.2, 8.0],
        benewake::SignalLimits {
            strength_min: 100,
            strength_max: 65_534,
            beyond_cm: None,
        },
    ),
    lightware_text("sf11c", 0.2, 120.0),
    lightware_text("lw20c", 0.5, 100.0),
];

/// The model called `name`.
pub fn find(name: &str) -> Option<&'static RangefinderModel> {
    TABLE.iter().find(|model| model.name == name)
}

/// How jink interprets a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Range {
    /// An obstacle at this range (m); below the shortest range: there or nearer.
    Hit(f32),
    /// Nothing up to the configured range.
    Clear,
    /// Nothing is known.
    Unknown,
}

impl Range {
    /// The range as in a scan (m).
    pub fn metres(self) -> f32 {
        match self {
            Self::Hit(range_m) => range_m,
            Self::Clear => f32::INFINITY,
            Self::Unknown => f32::NAN,
        }
    }
}

/// The ranges of one sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Shortest range (m).
    pub min_m: f32,
    /// Configured maximum (m).
    pub max_m: f32,
    /// Longest range of the device itself (m).
    pub device_max_m: f32,
}

impl Reach {
    /// Interprets `answer`.
    pub fn range(&self, answer: RangeReading) -> Range {
        match answer {
            RangeReading::Unreliable => Range::Unknown,
            RangeReading::Nothing => Range::Clear,
            RangeReading::Distance(distance_m) if distance_m < self.min_m => {
                Range::Hit(self.min_m.next_down())
            }
            RangeReading::Distance(distance_m) if distance_m <= self.max_m => Range::Hit(distance_m),
            RangeReading::Distance(distance_m) if distance_m <= self.device_max_m => Range::Clear,
            RangeReading::Distance(_) => Range::Unknown,
        }
    }
}
