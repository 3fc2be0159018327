//! Rangefinders on serial ports: bytes in, range scans out. One process per port; all of it but the port itself is
//! pure.
//!
//! | in | out |
//! |---|---|
//! | bytes with the time at which they arrived ([`RangefinderDriver::bytes`]) | scans with the time at which they were measured ([`ScanView`]) |
//! | time ([`RangefinderDriver::tick`]) | bytes to write to the device ([`RangefinderDriver::next_write`]), changes to report to the pilot ([`RangefinderDriver::take_change`]) |
//!
//! | module | holds |
//! |---|---|
//! | [`config`] | the `[[sensor]]` table of one rangefinder, and every way in which it can be wrong |
//! | [`devices`] | the models: line, beam, range, and the meaning of special values |
//! | [`decode`] | byte stream to measurements, one file per format |
//! | [`device_protocol`] | what is written to a device: set-up, requests |
//! | [`beam_filter`] | measurements of a device that does not scan -> scans of one beam |
//! | [`scan_assembler`] | measurements of a scanning device -> partial sweeps |
//! | [`driver`] | all of it together: the step |

pub mod beam_filter;
pub mod config;
pub mod crc;
pub mod decode;
pub mod device_protocol;
pub mod devices;
pub mod driver;
pub mod scan_assembler;
pub mod scan_view;
mod service;

pub use config::{Mistake, RangefinderSpec};
pub use decode::{Decoder, FrameContent, RangeReading};
pub use devices::{Range, RangefinderModel};
pub use driver::{RangefinderCounters, RangefinderDriver};
pub use scan_view::ScanView;
pub use service::RangefinderService;
