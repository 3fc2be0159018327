//! What the autopilot is asked for in commands.

/// What the autopilot is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Demand {
    /// To follow setpoints.
    Follow,
    /// To fly its mission again.
    Mission,
    /// To hold its place.
    Hold,
    /// To land where it is.
    Land,
    /// To count this item as the current one.
    Current(u16),
}
