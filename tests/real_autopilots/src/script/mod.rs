//! What the pilot and the ground station do in a flight, one function for each situation.
//!
//! | module | situations |
//! |---|---|
//! | [`missions`] | missions of all kinds of items |
//! | [`changes`] | missions that somebody changes in flight |
//! | [`modes`] | modes that somebody chooses, go-tos, returns, landings |
//! | [`assist`] | a pilot who is assisted |
//! | [`faults`] | processes killed, links cut, programs restarted |
//! | [`places`] | places in the world that make a situation |

pub mod assist;
pub mod changes;
pub mod faults;
pub mod missions;
pub mod modes;
pub mod places;
