//! The checksums of both Livox protocols.
//!
//! | protocol | head | data |
//! |---|---|---|
//! | second | CRC-16/CCITT-FALSE (IBM-3740) | CRC-32 of Ethernet |
//! | first | CRC-16/MCRF4XX that starts at 0x4C49 | CRC-32 of Ethernet that starts at 0x564F580A |
//!
//! Source: the communication protocols of the Mid-360 and of the first SDK, "CRC Algorithm".

use crc::{Algorithm, CRC_16_IBM_3740, CRC_16_MCRF4XX, CRC_32_ISO_HDLC, Crc, NoTable};

/// Of the second protocol's head.
pub static SDK2_CRC16: Crc<u16, NoTable> = Crc::<u16, NoTable>::new(&CRC_16_IBM_3740);
/// Of the second protocol's data.
pub static SDK2_CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
/// Of the first protocol's head.
pub static SDK1_CRC16: Crc<u16, NoTable> = Crc::<u16, NoTable>::new(&SDK1_CRC16_ALGORITHM);
/// Of the whole frame of the first protocol.
pub static SDK1_CRC32: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&SDK1_CRC32_ALGORITHM);

const SDK1_CRC16_ALGORITHM: Algorithm<u16> = Algorithm {
    init: 0x4C49_u16.reverse_bits(),
    check: 0xAB4E,
    ..CRC_16_MCRF4XX
};
/// Its start goes into the register inverted.
const SDK1_CRC32_ALGORITHM: Algorithm<u32> = Algorithm {
    init: (!0x564F_580A_u32).reverse_bits(),
    check: 0xB08D_B5B1,
    ..CRC_32_ISO_HDLC
};

#[cfg(test)]
mod tests {
    use super::{SDK1_CRC16, SDK1_CRC32, SDK2_CRC16, SDK2_CRC32};

    #[test]
    fn they_are_those_of_the_catalogue() {
        // Check values of the catalogue of parametrised CRC algorithms.
        assert_eq!(SDK2_CRC16.checksum(b"123456789"), 0x29B1);
        assert_eq!(SDK2_CRC32.checksum(b"123456789"), 0xCBF4_3926);
    }

    #[test]
    fn those_of_the_first_protocol_start_where_it_says() {
        let digits = b"123456789";
        assert_eq!(SDK1_CRC16.checksum(digits), SDK1_CRC16.algorithm.check);
        assert_eq!(SDK1_CRC32.checksum(digits), SDK1_CRC32.algorithm.check);
    }
}
