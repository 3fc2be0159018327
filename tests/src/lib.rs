//! Promises across processes: the lock-step harness that flies the whole chain in one process, the multi-process harness
//! that runs the real programs, and the campaigns made of them.

pub mod approach;
pub mod assisted;
mod board;
pub mod campaign;
pub mod flights;
pub mod lockstep;
pub mod lossy;
pub mod machine;
pub mod on_udp;
pub mod pairing;
pub mod peers;
pub mod permit;
pub mod pilot;
pub mod ports;
pub mod processes;
pub mod proposer;
mod remote;
pub mod station;
pub mod suite;

pub use jink_testkit::not_tested;
