//! The CRC-32 of MAVLink's file transfer and component metadata.
//!
//! The polynomial is the one of Ethernet and zlib (reflected, 0xEDB88320), but the register starts at zero and is not
//! inverted at the end: PX4's build computes it so for its metadata, ground stations compare with that. zlib's own value
//! would be another one.

const TABLE: [u32; 256] = {
    let mut table = [0; 256];
    let mut i = 0;
    while i < 256 {
        let mut value = i as u32;
        let mut bit = 0;
        while bit < 8 {
            value = (value >> 1) ^ if value & 1 == 1 { 0xedb8_8320 } else { 0 };
            bit += 1;
        }
        table[i] = value;
        i += 1;
    }
    table
};

/// The checksum of `bytes`.
pub fn crc32(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |crc, byte| {
        TABLE[((crc ^ u32::from(*byte)) & 0xff) as usize] ^ (crc >> 8)
    })
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
