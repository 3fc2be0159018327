//! One packet of MAVLink's file transfer, as it lies in the payload of FILE_TRANSFER_PROTOCOL.
//!
//! | bytes | field |
//! |---|---|
//! | 0, 1 | number of the packet |
//! | 2 | session |
//! | 3 | operation, or [`ACK`] or [`NAK`] |
//! | 4 | bytes of data |
//! | 5 | operation that is answered |
//! | 6 | whether a burst ends here |
//! | 8 to 11 | offset in the file, or number of the first entry |
//! | 12 to 250 | data |
//!
//! Source: MAVLink developer guide, "File Transfer Protocol".

/// Bytes of a payload.
pub const PAYLOAD: usize = 251;
/// Bytes of data in it.
pub const DATA: usize = 239;
/// A payload.
pub type Payload = [u8; PAYLOAD];

const HEADER: usize = PAYLOAD - DATA;

/// The operation was done.
pub const ACK: u8 = 128;
/// It was not; the first byte of data is the [`Nak`].
pub const NAK: u8 = 129;

/// Operations that are served.
pub mod op {
    /// Ends a session.
    pub const TERMINATE: u8 = 1;
    /// Ends all sessions.
    pub const RESET: u8 = 2;
    /// Lists a folder.
    pub const LIST: u8 = 3;
    /// Opens a file for reading.
    pub const OPEN: u8 = 4;
    /// Reads one piece.
    pub const READ: u8 = 5;
    /// Calculates the checksum of a file.
    pub const CRC: u8 = 14;
    /// Reads many pieces.
    pub const BURST: u8 = 15;
    /// Operations that would change something: they are known, and refused.
    pub const WRITING: [u8; 8] = [6, 7, 8, 9, 10, 11, 12, 13];
}

/// Why an operation was not done: MAV_FTP_ERR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nak {
    /// The data do not belong to the operation.
    InvalidDataSize = 3,
    /// No such session of this client.
    InvalidSession = 4,
    /// All sessions are in use.
    NoSessionsAvailable = 5,
    /// Behind the end.
    EndOfFile = 6,
    /// No such operation.
    UnknownCommand = 7,
    /// Nothing here can be changed.
    FileProtected = 9,
    /// No such file.
    FileNotFound = 10,
}

/// A packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet {
    /// Number.
    pub seq: u16,
    /// Session.
    pub session: u8,
    /// Operation or answer.
    pub opcode: u8,
    /// Bytes of data that count, or that are wanted.
    pub size: u8,
    /// What is answered.
    pub req_opcode: u8,
    /// A burst ends here.
    pub burst_complete: bool,
    /// Offset.
    pub offset: u32,
    /// Data.
    pub data: [u8; DATA],
}

impl Packet {
    /// From a payload; every payload is one.
    pub fn of(payload: &Payload) -> Self {
        let [
            seq0,
            seq1,
            session,
            opcode,
            size,
            req_opcode,
            burst,
            _,
            o0,
            o1,
            o2,
            o3,
            data @ ..,
        ] = payload;
        Self {
            seq: u16::from_le_bytes([*seq0, *seq1]),
            session: *session,
            opcode: *opcode,
            size: *size,
            req_opcode: *req_opcode,
            burst_complete: *burst != 0,
            offset: u32::from_le_bytes([*o0, *o1, *o2, *o3]),
            data: *data,
        }
    }

    /// As a payload.
    pub fn to_payload(self) -> Payload {
        let mut payload = [0; PAYLOAD];
        let [s0, s1] = self.seq.to_le_bytes();
        let [o0, o1, o2, o3] = self.offset.to_le_bytes();
        payload[..HEADER].copy_from_slice(&[
            s0,
            s1,
            self.session,
            self.opcode,
            self.size,
            self.req_opcode,
            u8::from(self.burst_complete),
            0,
            o0,
            o1,
            o2,
            o3,
        ]);
        payload[HEADER..].copy_from_slice(&self.data);
        payload
    }

    /// The data that count; `None` if it says that there are more than fit.
    pub fn given(&self) -> Option<&[u8]> {
        self.data.get(..usize::from(self.size))
    }

    /// The path in it, without the slashes in front and zeros behind; `None` if it is no text.
    pub fn path(&self) -> Option<&str> {
        let given = self.given()?;
        let end = given.iter().position(|byte| *byte == 0).unwrap_or(given.len());
        let path = std::str::from_utf8(given.get(..end)?).ok()?;
        Some(path.trim_start_matches('/'))
    }

    /// How many bytes a piece may have that is wanted by it.
    pub fn piece(&self) -> usize {
        match usize::from(self.size) {
            0 => DATA,
            size => size.min(DATA),
        }
    }

    /// An answer to it, without data.
    pub fn answer(&self, opcode: u8) -> Self {
        Self {
            seq: self.seq.wrapping_add(1),
            opcode,
            size: 0,
            req_opcode: self.opcode,
            burst_complete: false,
            data: [0; DATA],
            ..*self
        }
    }

    /// The refusal of it.
    pub fn refusal(&self, reason: Nak) -> Self {
        self.answer(NAK).with(&[reason as u8])
    }

    /// With these data; what does not fit is left out.
    pub fn with(mut self, data: &[u8]) -> Self {
        let len = data.len().min(DATA);
        self.data[..len].copy_from_slice(&data[..len]);
        self.size = len as u8;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::{PAYLOAD, Packet};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_packet_survives_its_bytes(mut bytes in proptest::collection::vec(any::<u8>(), PAYLOAD)) {
            bytes[6] &= 1;
            bytes[7] = 0;
            let payload = bytes.try_into().unwrap();
            prop_assert_eq!(Packet::of(&payload).to_payload(), payload);
        }
    }
}
