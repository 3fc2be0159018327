//! What the tests of depth cameras share.
#![allow(
    dead_code,
    clippy::unwrap_used,
    reason = "each test uses a part; a helper that cannot do its work fails it"
)]

pub mod device;
pub mod images;
