//! A live page for whoever watches a flight: the vehicle in its map, in three dimensions, and beside it in words what it does and why.
//!
//! | in | out |
//! |---|---|
//! | every topic, as a spectator | a page over HTTP, with a web socket for what changes |
//! | the folder of `[recorder]` | recordings to download |
//! | a change of a parameter, with the token | `parameters/change` |
//!
//! The service looks at its topics ten times a second and replaces what is posted on the [`board`]: one message each, the same for all
//! readers. Each connection has a thread of the lowest priority that takes from there what it has not sent yet. So a reader that is slow
//! misses something, one that is stuck is closed, and nobody makes the service wait. Without readers nothing is made, and maps and clouds
//! are not even open.
//!
//! Who may read and change what is decided in [`access`]. The picture is drawn in the browser, by `page/viewer.js` with three.js 0.170.0
//! (`build/three.module.min.js` of the npm package `three`, packed with `gzip -9n`; sha256 unpacked
//! `08fd7545d13d2c7fb65ab691530a802dafefd638596501854f267d0fb13c39e7`).

pub mod access;
pub mod board;
pub mod http;
pub mod layers;
pub mod recordings;
pub mod scene;
pub mod server;
mod service;
mod spectator;
#[cfg(test)]
mod tests;
pub mod words;

pub use service::ViewerService;
