//! Rangefinders on serial ports: bytes in, range scans out. One process per port; all of it but the port itself is pure.
//!
//! | in | out |
//! |---|---|
//! | bytes with the time at which they arrived ([`Driver::bytes`]) | scans with the time at which they were measured ([`ScanView`]) |
//! | time ([`Driver::tick`]) | what is to be written to the device ([`Driver::next_write`]), news for the pilot ([`Driver::news`]) |
//!
//! | module | holds |
//! |---|---|
//! | [`config`] | the `[[sensor]]` table of one rangefinder, and every way in which it can be wrong |
//! | [`devices`] | the models: line, beam, range, and what their special answers mean |
//! | [`decode`] | byte stream to answers, one file per format |
//! | [`dialogue`] | what is said to a device: set-up, requests |
//! | [`beam`] | answers of a device that looks one way -> scans of one beam |
//! | [`sweep`] | answers of a scanning device -> partial sweeps |
//! | [`driver`] | all of it together: the step |

pub mod beam;
pub mod config;
pub mod crc;
pub mod decode;
pub mod devices;
pub mod dialogue;
pub mod driver;
pub mod scan_view;
mod service;
pub mod sweep;

pub use config::{Mistake, RangefinderSpec};
pub use decode::{Answer, Decoder, Item};
pub use devices::{Model, Range};
pub use driver::{Counters, Driver, News};
pub use scan_view::ScanView;
pub use service::RangefinderService;
