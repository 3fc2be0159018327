//! Devices as their manuals describe them, written independently of the decoders: checksums by long division of
//! polynomials, frames byte by byte.
#![allow(dead_code, reason = "every test uses a part")]

pub mod device;

use jink_rangefinder_driver::{Decoder, FrameContent, RangefinderModel, RangefinderSpec, devices};

/// Remainder of the message times x^16 divided by x^16 + `poly`, the register starting at `start`; bits in the order
/// given.
fn remainder(bits: impl Iterator<Item = bool>, poly: u32, start: u32) -> u16 {
    let mut register = start;
    for bit in bits {
        let carry = (register >> 15 & 1 == 1) != bit;
        register = (register << 1) & 0xFFFF;
        if carry {
            register ^= poly;
        }
    }
    register as u16
}

fn bits_high_first(bytes: &[u8]) -> impl Iterator<Item = bool> {
    bytes
        .iter()
        .flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1 == 1))
}

fn bits_low_first(bytes: &[u8]) -> impl Iterator<Item = bool> {
    bytes
        .iter()
        .flat_map(|byte| (0..8).map(move |bit| byte >> bit & 1 == 1))
}

/// One packet of LightWare's binary protocol.
pub fn lightware_packet(command: u8, write: bool, data: &[u8]) -> Vec<u8> {
    let mut packet = vec![0xAA];
    let flags = (data.len() as u16 + 1) * 64 + u16::from(write);
    packet.extend([(flags % 256) as u8, (flags / 256) as u8, command]);
    packet.extend(data);
    let crc = remainder(bits_high_first(&packet), 0x1021, 0);
    packet.extend([(crc % 256) as u8, (crc / 256) as u8]);
    packet
}

/// A measurement of an SF45/B.
pub fn sf45(distance_cm: i16, yaw_cdeg: i16) -> Vec<u8> {
    let mut data = distance_cm.to_le_bytes().to_vec();
    data.extend(yaw_cdeg.to_le_bytes());
    lightware_packet(44, false, &data)
}

/// A measurement of a Lanbao PSK-CM8JL65-CC5.
pub fn cm8jl65(distance_mm: u16) -> Vec<u8> {
    let mut frame = vec![0xA5, 0x5A, (distance_mm / 256) as u8, (distance_mm % 256) as u8];
    let crc = remainder(bits_low_first(&frame), 0x8005, 0xFFFF).reverse_bits();
    frame.extend([(crc % 256) as u8, (crc / 256) as u8]);
    frame
}

/// A measurement of a Benewake device.
pub fn benewake(distance_cm: i16, strength: u16, temperature_c: f32) -> Vec<u8> {
    let mut frame = vec![0x59, 0x59];
    frame.extend(distance_cm.to_le_bytes());
    frame.extend(strength.to_le_bytes());
    frame.extend((((temperature_c + 256.0) * 8.0) as u16).to_le_bytes());
    let sum: u32 = frame.iter().map(|byte| u32::from(*byte)).sum();
    frame.push((sum % 256) as u8);
    frame
}

/// A measurement of an SF11/C or LW20/C.
pub fn text(distance_cm: i32) -> Vec<u8> {
    format!("{:.2}\r\n", f64::from(distance_cm) / 100.0).into_bytes()
}

/// The model called `name`.
pub fn model(name: &str) -> &'static RangefinderModel {
    devices::find(name).unwrap()
}

/// A rangefinder of model `name` at `device`, with further keys.
pub fn spec(name: &str, device: &str, keys: &str) -> RangefinderSpec {
    let text = format!(
        "name = \"front\"\nkind = \"rangefinder\"\nmodel = \"{name}\"\ndevice = \"{device}\"\n{keys}"
    );
    let table: jink_rangefinder_driver::config::SensorTable =
        text.parse::<toml::Table>().unwrap().into_iter().collect();
    RangefinderSpec::find(&[table], "front").unwrap()
}

/// Everything that a decoder of `model` finds in `bytes`.
pub fn decode(model: &RangefinderModel, bytes: &[u8]) -> Vec<FrameContent> {
    let mut decoder = Decoder::new(model.format);
    let mut items = Vec::new();
    for byte in bytes {
        decoder.push(*byte, |frame| items.push(frame.item));
    }
    items
}
