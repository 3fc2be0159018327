//! CRC-64 of ECMA-182, reflected (the one of xz), by which Ouster closes packets of all profiles but LEGACY.

use crc::{CRC_64_XZ, Crc};

static XZ: Crc<u64> = Crc::<u64>::new(&CRC_64_XZ);

/// The checksum of `bytes`.
pub fn crc64(bytes: &[u8]) -> u64 {
    XZ.checksum(bytes)
}

#[cfg(test)]
mod tests {
    use super::crc64;

    #[test]
    fn it_is_the_one_of_the_catalogue() {
        // CRC-64/XZ in the catalogue of parametrised CRC algorithms.
        assert_eq!(crc64(b"123456789"), 0x995D_C9BB_DF19_39FA);
    }
}
