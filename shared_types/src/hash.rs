//! FNV-1a: a small hash that can be computed at compile time and that is the same in every build. It distinguishes
//! builds; it keeps nobody out. Source: Fowler, Noll, Vo, "The FNV hash".

/// Where a hash begins.
pub const START: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

/// Continues `hash` with `text` and its length, so that two texts in a row are not taken for one.
pub const fn text(hash: u64, text: &str) -> u64 {
    number(bytes(hash, text.as_bytes()), text.len() as u64)
}

/// Continues `hash` with `texts` and their number.
pub const fn texts(mut hash: u64, texts: &[&str]) -> u64 {
    let mut i = 0;
    while i < texts.len() {
        hash = text(hash, texts[i]);
        i += 1;
    }
    number(hash, texts.len() as u64)
}

/// Continues `hash` with the eight little-endian bytes of `number`.
pub const fn number(hash: u64, number: u64) -> u64 {
    bytes(hash, &number.to_le_bytes())
}

/// Continues `hash` with `bytes`.
pub const fn bytes(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(PRIME);
        i += 1;
    }
    hash
}
