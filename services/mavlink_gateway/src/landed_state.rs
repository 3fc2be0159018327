//! Whether the vehicle is on the ground, as EXTENDED_SYS_STATE and the record of a flight say.

/// Whether the vehicle is on the ground.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LandedState {
    /// Nobody has said.
    #[default]
    Unknown,
    /// It stands.
    OnGround,
    /// It is on its way up from there.
    TakingOff,
    /// It flies.
    InAir,
}

impl LandedState {
    /// All of them, in the order of their numbers in a record.
    pub const ALL: [Self; 4] = [Self::Unknown, Self::OnGround, Self::TakingOff, Self::InAir];
}
