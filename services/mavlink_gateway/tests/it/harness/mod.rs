//! What must hold whatever comes, as functions of arbitrary bytes: a broken law is a panic.
//!
//! | law book | the bytes are |
//! |---|---|
//! | [`decoder`] | a stream of frames, damaged frames and garbage, in pieces of any size |
//! | [`flight`] | a story: messages of any kind, trajectories, losses and pauses, in every profile |
//! | [`network`] | frames from several links, signed well, badly, twice or not at all |
//! | [`requests`] | requests for files and parameters |
//! | [`storage`] | the content of files, and what one gateway sends to the next |
//!
//! The same functions are run by a bounded test with bytes of a seeded generator, and by the targets of `fuzz/`, which look for
//! bytes that lead somewhere new.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![allow(dead_code)] // Every user runs its own part of the books.
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; a profile is for the versions before.

pub mod decoder;
pub mod dice;
pub mod flight;
pub mod ground;
pub mod messages;
pub mod network;
pub mod requests;
pub mod storage;
