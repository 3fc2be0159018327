//! Lidars on the network and scanners on serial ports.
//!
pub mod capture;
pub mod clock_filter;
pub mod decode;
pub mod decoder;
pub mod dump;
pub mod livox;
pub mod models;
pub mod ouster;
pub mod velodyne;
