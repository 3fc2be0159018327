//! Depth cameras at V4L2 devices: images in, point clouds out. One process per device; all of it but the device itself
//! is pure.
//!
//! | in | out |
//! |---|---|
//! | images with the time of their capture ([`DepthCameraDriver::image`]) | clouds ([`CloudView`]), what is reported to the pilot ([`DepthCameraDriver::take_change`]) |
//!
//! | module | holds |
//! |---|---|
//! | [`config`], [`config_error`] | the `[[sensor]]` table of one depth camera, and every way in which it can be wrong |
//! | [`models`] | the models: field of view, baseline, range |
//! | [`projection`] | where pixels look |
//! | [`flying`] | which pixels hang in the air between two surfaces |
//! | [`cloud_view`] | blocks of pixels -> points |
//! | [`driver`] | all of it together: the step |
//! | [`v4l2`], [`camera`] | the device: its calls, and how it comes and goes |

pub mod camera;
pub mod cloud_view;
pub mod config;
pub mod config_error;
pub mod driver;
pub mod flying;
pub mod models;
pub mod projection;
mod service;
pub mod v4l2;

pub use cloud_view::CloudView;
pub use config::DepthCameraSpec;
pub use config_error::DepthConfigError;
pub use driver::{DepthCameraCounters, DepthCameraDriver, Image};
pub use service::DepthCameraService;
