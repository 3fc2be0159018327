//! The contract between jink's processes: what they say to each other, in which units and frames, how often,
//! and what happens when it does not arrive. Everything else is derived from the tables in this crate.
//!
//! | module | holds |
//! |---|---|
//! | [`topics`] | the topic table: name, payload, producer, consumers, rate, deadline |
//! | [`params`] | the parameter table: name, type, default, range, unit, help |
//! | [`events`] | the event table: what is reported to pilots and logs |
//! | [`mod@sample`] | the header every sample carries, and `Fresh / Stale / Never` |
//! | [`vehicle`], [`ranges`], [`view`], [`map`], [`far_map`], [`ring`], [`motion`], [`moving`], [`proposal`], [`prevention`], [`health`], [`link`], [`param_messages`], [`truth`] | the payloads |
//! | [`beams`] | range messages of other makers, as scans |
//! | [`bezier`] | the mathematics of the curves that several services evaluate |
//! | [`pose_history`] | where the vehicle was at a moment between two of its states |
//! | [`mod@quantile`] | quantiles of measurements |
//! | [`suggestion`] | the name that a mistyped one stands for |
//! | [`orientation`] | how sensors are mounted, as configurations say it |
//! | [`frames`], [`clock`], [`source_clock`], [`coded`] | units and frames, time, enums on the wire |
//! | [`layout`], [`shape`], [`reserved`], [`hash`] | what a sample is made of, its layout hash, room for later fields |
//!
//! Units stand in field names (`_m`, `_mps`, `_rad`, `_ns`); frames stand in types
//! ([`frames::LocalNed`], [`frames::BodyFrd`]).

pub mod beams;
pub mod bezier;
pub mod clock;
pub mod coded;
pub mod control;
pub mod cycles;
pub mod events;
pub mod far_map;
pub mod faults;
pub mod frames;
pub mod geo;
pub mod ground;
pub mod hash;
pub mod health;
pub mod layout;
pub mod link;
pub mod map;
pub mod motion;
pub mod moving;
pub mod orientation;
pub mod param_messages;
pub mod params;
pub mod pose_history;
pub mod prevention;
pub mod proposal;
pub mod quantile;
pub mod ranges;
pub mod reserved;
pub mod ring;
pub mod sample;
pub mod shape;
pub mod source_clock;
pub mod suggestion;
pub mod topics;
pub mod tracking;
pub mod truth;
pub mod vehicle;
pub mod view;

pub use clock::Timestamp;
pub use coded::{Coded, Flag};
pub use frames::{Acceleration, BodyFrd, LocalNed, Point, Velocity};
pub use reserved::{Added, Reserved};
pub use sample::{Reading, STAGE_NAMES, STAGE_ROOM, STAGES, SampleHeader, Stage, StageTime, Stamped};
