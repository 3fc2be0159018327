//! Empty: iceoryx2's build scripts name this crate on every host and use it on QNX only.
