//! The radio link between autopilot and gateway: datagram sockets, and frames that may be lost, doubled and damaged.

use super::folder::Folder;
use crate::lossy::{LinkFaults, Lossy};
use jink_simulator::service::local::LocalSocket;

/// Message ids of the sticks: RC_CHANNELS, MANUAL_CONTROL.
const STICKS: [u32; 2] = [65, 69];
/// Longest datagram.
const DATAGRAM_BYTES: usize = 2048;

/// The link between autopilot and gateway.
pub(super) struct Radio {
    autopilot: LocalSocket,
    gateway: LocalSocket,
    /// The way to the autopilot, and from it.
    ways: [Lossy; 2],
}

impl Radio {
    pub(super) fn new(folder: &Folder, faults: LinkFaults, seed: u64) -> std::io::Result<Self> {
        let pair = |own: &str, peer: &str| LocalSocket::bind(&folder.path(own), &folder.path(peer));
        Ok(Self {
            autopilot: pair("autopilot.jink", "autopilot")?,
            gateway: pair("wire", "wire.jink")?,
            ways: [0, 1].map(|way| Lossy::new(faults, 2 * seed + way)),
        })
    }

    pub(super) fn down(&mut self, now_s: f64, mute_sticks: bool) {
        let mut buffer = [0; DATAGRAM_BYTES];
        while let Some(frame) = self.autopilot.receive(&mut buffer) {
            if !(mute_sticks && STICKS.contains(&message_id(frame))) {
                self.ways[1].send(now_s, frame);
            }
        }
        for frame in self.ways[1].arrived(now_s) {
            self.gateway.send(&frame);
        }
    }

    pub(super) fn up(&mut self, now_s: f64) {
        let mut buffer = [0; DATAGRAM_BYTES];
        while let Some(frame) = self.gateway.receive(&mut buffer) {
            self.ways[0].send(now_s, frame);
        }
        for frame in self.ways[0].arrived(now_s) {
            self.autopilot.send(&frame);
        }
    }
}

/// Of a frame of MAVLink 2: bytes 7 to 9, little-endian.
fn message_id(frame: &[u8]) -> u32 {
    match frame {
        [_, _, _, _, _, _, _, low, middle, high, ..] => u32::from_le_bytes([*low, *middle, *high, 0]),
        _ => u32::MAX,
    }
}
