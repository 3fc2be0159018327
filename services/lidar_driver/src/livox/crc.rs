//! The checksums of both Livox protocols.
//!
//! | protocol | head | data |
//! |---|---|---|
//! | second | CRC-16/CCITT-FALSE | CRC-32 of Ethernet |
//! | first | CRC-16/MCRF4XX that starts at 0x4C49 | CRC-32 of Ethernet that starts at 0x564F580A |
//!
//! Source: the communication protocols of the Mid-360 and of the first SDK, "CRC Algorithm".

/// Start of the first protocol's checksums.
pub const SDK1_CRC16_START: u16 = 0x4C49;
/// The same of its CRC-32.
pub const SDK1_CRC32_START: u32 = 0x564F_580A;

/// CRC-16 of CCITT, most significant bit first, starting at 0xFFFF.
pub fn ccitt_false(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc: u16, _| {
            if crc & 0x8000 == 0 {
                crc << 1
            } else {
                crc << 1 ^ 0x1021
            }
        })
    })
}

/// CRC-16 of CCITT, least significant bit first, starting at `start`.
pub fn mcrf4xx(bytes: &[u8], start: u16) -> u16 {
    bytes.iter().fold(start, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc: u16, _| {
            if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0x8408 }
        })
    })
}

const CRC32: [u32; 256] = table();

const fn table() -> [u32; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 1 {
                crc >> 1 ^ 0xEDB8_8320
            } else {
                crc >> 1
            };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
}

/// CRC-32 of Ethernet; `start` is zero there.
pub fn crc32(bytes: &[u8], start: u32) -> u32 {
    !bytes.iter().fold(!start, |crc, byte| {
        CRC32[((crc ^ u32::from(*byte)) & 0xFF) as usize] ^ crc >> 8
    })
}

#[cfg(test)]
mod tests {
    use super::{ccitt_false, crc32, mcrf4xx};

    #[test]
    fn they_are_those_of_the_catalogue() {
        // Check values of the catalogue of parametrised CRC algorithms.
        assert_eq!(ccitt_false(b"123456789"), 0x29B1);
        assert_eq!(mcrf4xx(b"123456789", 0xFFFF), 0x6F91);
        assert_eq!(crc32(b"123456789", 0), 0xCBF4_3926);
    }
}
