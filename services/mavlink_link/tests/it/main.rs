//! What the links promise, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod a_link_passes_on_without_losing_a_byte;
mod common;
mod intact_frames_are_never_lost;
mod links_reopen_and_explain_themselves;
mod several_links_are_one_network;
