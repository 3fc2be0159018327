//! The CRC-32 of MAVLink's file transfer and component metadata.
//!
//! The polynomial is the one of Ethernet and zlib (reflected, 0xEDB88320), but the register starts at zero and is not
//! inverted at the end: PX4's build computes it so for its metadata, ground stations compare with that. zlib's own value
//! would be another one.

use crc::{Algorithm, CRC_32_ISO_HDLC, Crc};

static MAVLINK: Crc<u32> = Crc::<u32>::new(&OF_FILES);

const OF_FILES: Algorithm<u32> = Algorithm {
    init: 0,
    xorout: 0,
    check: 0x2dfd_2d88,
    residue: 0,
    ..CRC_32_ISO_HDLC
};

/// The checksum of `bytes`.
pub fn crc32(bytes: &[u8]) -> u32 {
    MAVLINK.checksum(bytes)
}

#[cfg(test)]
mod tests {
    use super::crc32;

    #[test]
    fn it_is_the_one_of_mavlink_and_not_the_one_of_zlib() {
        // Python: zlib.crc32(data, 0xffffffff) ^ 0xffffffff.
        assert_eq!(crc32(b"123456789"), 0x2dfd_2d88);
        assert_eq!(crc32(b""), 0);
    }
}
