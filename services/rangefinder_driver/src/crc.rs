//! The two 16-bit checksums of the formats, without tables: at most ten bytes a frame, a table would gain nothing.

use crc::{CRC_16_MODBUS, CRC_16_XMODEM, Crc, NoTable};

const XMODEM: Crc<u16, NoTable> = Crc::<u16, NoTable>::new(&CRC_16_XMODEM);
const MODBUS: Crc<u16, NoTable> = Crc::<u16, NoTable>::new(&CRC_16_MODBUS);

/// CRC-16/XMODEM: LightWare's binary protocol.
pub fn xmodem(bytes: &[u8]) -> u16 {
    XMODEM.checksum(bytes)
}

/// CRC-16/MODBUS: Lanbao's frames.
pub fn modbus(bytes: &[u8]) -> u16 {
    MODBUS.checksum(bytes)
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
