//! The two 16-bit checksums of the formats, bit by bit: at most ten bytes a frame, a table would gain nothing.

/// CRC-16/XMODEM: polynomial 0x1021, most significant bit first, start 0. LightWare's binary protocol.
pub fn xmodem(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |mut crc, byte| {
        crc ^= u16::from(*byte) << 8;
        for _ in 0..8 {
            crc = if crc & 0x8000 == 0 {
                crc << 1
            } else {
                (crc << 1) ^ 0x1021
            };
        }
        crc
    })
}

/// CRC-16/MODBUS: polynomial 0x8005 reflected, start 0xFFFF. Lanbao's frames.
pub fn modbus(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |mut crc, byte| {
        crc ^= u16::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 0 {
                crc >> 1
            } else {
                (crc >> 1) ^ 0xA001
            };
        }
        crc
    })
}

#[cfg(test)]
mod tests {
    use super::{modbus, xmodem};

    #[test]
    fn both_give_the_check_values_of_the_catalogue() {
        assert_eq!(xmodem(b"123456789"), 0x31C3);
        assert_eq!(modbus(b"123456789"), 0x4B37);
    }
}
