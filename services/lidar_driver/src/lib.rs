//! Lidars on the network, and scanners on serial ports: packets in, point clouds and range scans out. One process per
//! sensor; all of it but sockets, ports and files is pure.
//!
//! | in | out |
//! |---|---|
//! | datagrams with the time at which they arrived ([`NetworkLidarDriver::datagram`]) | point clouds in the body frame ([`CloudAssembler::write`]) |
//! | bytes of a serial line ([`ScannerDriver::bytes`]) | range scans ([`Turn::write`]), what is to be written to the scanner |
//! | time | changes to report to the pilot ([`DeviceChange`](jink_runtime::device::DeviceChange)), messages that set a sensor up ([`livox::control`]) |
//!
//! | module | holds |
//! |---|---|
//! | [`config`] | the `[[sensor]]` table of one lidar, and every way in which it can be wrong |
//! | [`models`] | the models: connection, range, rate |
//! | [`decode`], [`decoder`] | packets to rays on the sensor's clock, and what can be wrong with them |
//! | [`ouster`], [`velodyne`], [`livox`] | one format each |
//! | [`cloud`] | rays of one scan -> a point cloud |
//! | [`driver`] | all of that together: the step of a network lidar |
//! | [`scanner`] | the same of a serial scanner |
//! | [`capture`] | datagrams out of recordings |
//! | [`datagrams`], [`network`] | sockets and recordings as the service runs them |
//! | [`dump`] | the returns in a recording as a table |

pub mod capture;
pub mod cloud;
pub mod config;
pub mod counters;
pub mod datagrams;
pub mod decode;
pub mod decoder;
pub mod driver;
pub mod dump;
pub mod livox;
pub mod models;
pub mod network;
pub mod ouster;
pub mod scanner;
mod service;
pub mod velodyne;

pub use cloud::CloudAssembler;
pub use config::{LidarSpec, Mistake};
pub use counters::LidarCounters;
pub use decoder::Decoder;
pub use driver::NetworkLidarDriver;
pub use scanner::driver::ScannerDriver;
pub use scanner::turn::Turn;
pub use service::LidarService;
