//! An SF45/B as its manual describes it.

use super::{lightware_packet, sf45};
use std::collections::BTreeMap;

/// The device: takes commands, acknowledges them, and streams once its stream is on.
#[derive(Debug, Default)]
pub struct Device {
    /// What was set, by command.
    pub settings: BTreeMap<u8, Vec<u8>>,
    received: Vec<u8>,
    /// Every command that came.
    pub commands: Vec<u8>,
    /// Degrees of its way since its last reset.
    way_deg: f32,
    out: Vec<u8>,
}

impl Device {
    pub fn take(&mut self, bytes: &[u8]) {
        self.received.extend(bytes);
        while self.received.len() >= 4 {
            let payload = usize::from(u16::from_le_bytes([self.received[1], self.received[2]]) >> 6);
            let len = payload + 5;
            if self.received.len() < len {
                return;
            }
            let packet: Vec<u8> = self.received.drain(..len).collect();
            let (command, data) = (packet[3], &packet[4..len - 2]);
            assert_eq!(packet, lightware_packet(command, true, data), "a sound packet");
            self.commands.push(command);
            self.settings.insert(command, data.to_vec());
            self.out.extend(lightware_packet(command, true, data));
        }
    }

    pub fn float(&self, command: u8) -> f32 {
        f32::from_le_bytes(self.settings[&command][..].try_into().unwrap())
    }

    fn streams(&self) -> bool {
        self.settings.get(&30).is_some_and(|data| *data == [5, 0, 0, 0])
            && self.settings.get(&27).is_some_and(|data| *data == [1, 1, 0, 0])
    }

    /// One millisecond: a measurement, if it streams. A wall stands 4 m to the right, 2 m to the left.
    pub fn step(&mut self) -> Vec<u8> {
        if self.streams() {
            let (low_deg, high_deg) = (self.float(98), self.float(99));
            let span_deg = high_deg - low_deg;
            self.way_deg = (self.way_deg + 1.6) % (2.0 * span_deg);
            let to = self.way_deg.min(2.0 * span_deg - self.way_deg);
            let yaw_deg = low_deg + to;
            let cm = if yaw_deg > 5.0 { 400 } else { 200 };
            self.out.extend(sf45(cm, (yaw_deg * 100.0) as i16));
        }
        std::mem::take(&mut self.out)
    }

    pub fn reset(&mut self) {
        *self = Self::default();
    }
}
