//! What the packets of each UDP profile look like.

/// What a pixel of a packet looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Profile {
    /// `udp_profile_lidar`.
    pub name: &'static str,
    /// Bytes of one pixel.
    pub pixel_bytes: usize,
    /// Where its ranges begin; the second one only where there are two.
    pub range_at: [usize; 2],
    /// Ranges of a pixel.
    pub returns: u8,
    /// Bits of a range.
    pub bits: u32,
    /// Unit of a range (mm).
    pub unit_mm: u32,
}

const fn profile(name: &'static str, pixel_bytes: usize, returns: u8, bits: u32, unit_mm: u32) -> Profile {
    Profile {
        name,
        pixel_bytes,
        range_at: [0, 4],
        returns,
        bits,
        unit_mm,
    }
}

/// The profiles of firmware 1.12 to 3.2 (firmware user manual, "Lidar Data Packet Format").
pub const PROFILES: &[Profile] = &[
    profile("LEGACY", 12, 1, 20, 1),
    profile("RNG19_RFL8_SIG16_NIR16", 12, 1, 19, 1),
    profile("RNG19_RFL8_SIG16_NIR16_DUAL", 16, 2, 19, 1),
    profile("RNG15_RFL8_NIR8", 4, 1, 15, 8),
    profile("RNG15_RFL8_NIR8_DUAL", 8, 2, 15, 8),
    profile("FUSA_RNG15_RFL8_NIR8_DUAL", 8, 2, 15, 8),
    profile("RNG15_RFL8_WIN8", 4, 1, 15, 8),
    profile("RNG15_RFL8_NIR8_ZONE16", 8, 1, 15, 8),
    profile("RNG19_RFL8_SIG16_NIR16_ZONE16", 12, 1, 19, 1),
    profile("RNG19_RFL8_SIG16_ZONE16_DUAL", 16, 2, 19, 1),
    profile("RNG19_RFL8_SIG16_NIR16_RGB16", 16, 1, 19, 1),
    profile("RNG19_RFL8_SIG16_NIR16_RGB16_DUAL", 20, 2, 19, 1),
    profile("FIVE_WORD_PIXEL", 20, 2, 19, 1),
];

/// Head of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Header {
    /// None; the frame id stands in every column.
    Legacy,
    /// 32 bytes, a frame id of 16 bits, a CRC-64 at the end.
    Standard,
    /// 32 bytes, a frame id of 32 bits.
    Fusa,
}
