//! Sensors as their manuals describe them, written without a look at the decoders: checksums by long division of
//! polynomials, packets byte by byte.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a helper that cannot do its work fails the test"
)]

use jink_lidar_driver::LidarSpec;
use jink_lidar_driver::config::SensorTable;

/// The spec of a lidar called "top".
pub fn spec(kind: &str, model: &str, device: &str, keys: &str) -> LidarSpec {
    let text =
        format!("name = \"top\"\nkind = \"{kind}\"\nmodel = \"{model}\"\ndevice = \"{device}\"\n{keys}");
    let table: SensorTable = text.parse::<toml::Table>().unwrap().into_iter().collect();
    LidarSpec::find(&[table], "top").unwrap()
}

/// Remainder of `message * x^width` divided by a polynomial, bit by bit; `reflected` takes the lowest bit of a byte
/// first.
fn remainder(message: &[u8], width: u32, polynomial: u128, start: u128, reflected: bool) -> u128 {
    let mask = (1u128 << width) - 1;
    let mut register = start & mask;
    for byte in message {
        for position in 0..8 {
            let bit = if reflected {
                byte >> position & 1
            } else {
                byte >> (7 - position) & 1
            };
            let carry = (register >> (width - 1) & 1 == 1) != (bit == 1);
            register = register << 1 & mask;
            if carry {
                register ^= polynomial;
            }
        }
    }
    register
}

fn reverse(value: u128, width: u32) -> u128 {
    (0..width).fold(0, |sum, bit| sum << 1 | (value >> bit & 1))
}

/// CRC-64 of Ouster's packets.
pub fn crc64(message: &[u8]) -> u64 {
    let all = u128::from(u64::MAX);
    (reverse(remainder(message, 64, 0x42F0_E1EB_A9EA_3693, all, true), 64) ^ all) as u64
}

/// CRC-32 of Ethernet, with the start that the first Livox protocol gives it.
pub fn crc32(message: &[u8], start: u32) -> u32 {
    let begin = reverse(u128::from(!start), 32);
    !reverse(remainder(message, 32, 0x04C1_1DB7, begin, true), 32) as u32
}

/// CRC-16 of CCITT.
pub fn crc16(message: &[u8], start: u16, reflected: bool) -> u16 {
    if reflected {
        reverse(
            remainder(message, 16, 0x1021, reverse(start.into(), 16), true),
            16,
        ) as u16
    } else {
        remainder(message, 16, 0x1021, start.into(), false) as u16
    }
}

/// CRC-8 of LDROBOT's packets.
pub fn crc8(message: &[u8]) -> u8 {
    remainder(message, 8, 0x4D, 0, false) as u8
}

/// What a VLP-16 sees: range (2 mm) of firing and laser of a packet, and of which of two returns.
pub type Sight<'a> = &'a dyn Fn(usize, usize, usize) -> u16;

/// A data packet of a VLP-16: azimuth (0.01 deg) of its first firing and between firings.
pub fn vlp16(
    stamp_us: u32,
    azimuth_cdeg: f64,
    step_cdeg: f64,
    dual: bool,
    product: u8,
    ranges: Sight<'_>,
) -> Vec<u8> {
    let mut packet = Vec::new();
    for block in 0..12usize {
        let firing = if dual { block / 2 * 2 } else { 2 * block };
        let azimuth = (azimuth_cdeg + firing as f64 * step_cdeg).round() as u32 % 36_000;
        packet.extend([0xFF, 0xEE]);
        packet.extend((azimuth as u16).to_le_bytes());
        for channel in 0..32 {
            let range = ranges(
                firing + channel / 16,
                channel % 16,
                if dual { block % 2 } else { 0 },
            );
            packet.extend(range.to_le_bytes());
            packet.push(100);
        }
    }
    packet.extend(stamp_us.to_le_bytes());
    packet.extend([if dual { 0x39 } else { 0x37 }, product]);
    assert_eq!(packet.len(), 1206);
    packet
}

/// A packet of Livox's second protocol.
pub fn livox2(number: u16, stamp_ns: u64, interval_100ns: u16, data_type: u8, points: &[Vec<u8>]) -> Vec<u8> {
    let mut tail = stamp_ns.to_le_bytes().to_vec();
    tail.extend(points.concat());
    let length = 28 + tail.len();
    let mut packet = vec![0];
    packet.extend((length as u16).to_le_bytes());
    packet.extend(interval_100ns.to_le_bytes());
    packet.extend((points.len() as u16).to_le_bytes());
    packet.extend(number.to_le_bytes());
    packet.extend([0, data_type, 0]);
    packet.extend([0; 12]);
    packet.extend(crc32(&tail, 0).to_le_bytes());
    packet.extend(tail);
    packet
}

/// A packet of Livox's first protocol.
pub fn livox1(stamp_ns: u64, data_type: u8, points: &[Vec<u8>]) -> Vec<u8> {
    let mut packet = vec![5, 1, 1, 0, 0, 0, 0, 0, 0, data_type];
    packet.extend(stamp_ns.to_le_bytes());
    packet.extend(points.concat());
    packet
}

/// A packet of an LDROBOT scanner: first angle and step (deg), twelve ranges (mm).
pub fn ldrobot(speed_dps: u16, first_deg: f64, step_deg: f64, ranges_mm: [u16; 12], time_ms: u16) -> Vec<u8> {
    let cdeg = |angle_deg: f64| ((angle_deg * 100.0).round() as u32 % 36_000) as u16;
    let mut packet = vec![0x54, 0x2C];
    packet.extend(speed_dps.to_le_bytes());
    packet.extend(cdeg(first_deg).to_le_bytes());
    for range_mm in ranges_mm {
        packet.extend(range_mm.to_le_bytes());
        packet.push(200);
    }
    packet.extend(cdeg(first_deg + 11.0 * step_deg).to_le_bytes());
    packet.extend(time_ms.to_le_bytes());
    packet.push(crc8(&packet));
    packet
}

/// A descriptor of an RPLIDAR's answer.
pub fn rplidar_descriptor(kind: u8, length: u32, many: bool) -> Vec<u8> {
    let mut bytes = vec![0xA5, 0x5A];
    bytes.extend((length | u32::from(many) << 30).to_le_bytes());
    bytes.push(kind);
    bytes
}

/// One sample of an RPLIDAR's answer to SCAN.
pub fn rplidar_sample(starts: bool, angle_deg: f64, range_mm: f64) -> Vec<u8> {
    let mut bytes = vec![47 << 2 | if starts { 0b01 } else { 0b10 }];
    bytes.extend((((angle_deg * 64.0).round() as u16) << 1 | 1).to_le_bytes());
    bytes.extend(((range_mm * 4.0).round() as u16).to_le_bytes());
    bytes
}

fn capsule(starts: bool, first_deg: f64, body: &[u8]) -> Vec<u8> {
    let mut tail = ((first_deg * 64.0).round() as u16 | u16::from(starts) << 15)
        .to_le_bytes()
        .to_vec();
    tail.extend(body);
    let sum = tail.iter().fold(0, |sum, byte| sum ^ byte);
    let mut bytes = vec![0xA0 | sum & 0xF, 0x50 | sum >> 4];
    bytes.extend(tail);
    assert_eq!(bytes.len(), 84);
    bytes
}

/// A capsule of an RPLIDAR's answer to EXPRESS_SCAN: 32 ranges (mm), corrections in 1/8 deg.
pub fn rplidar_capsule(
    starts: bool,
    first_deg: f64,
    ranges_mm: &[u16; 32],
    corrections: &[u8; 32],
) -> Vec<u8> {
    let mut body = Vec::new();
    for pair in 0..16 {
        for index in [2 * pair, 2 * pair + 1] {
            body.extend((ranges_mm[index] << 2 | u16::from(corrections[index] >> 4)).to_le_bytes());
        }
        body.push(corrections[2 * pair] & 0xF | corrections[2 * pair + 1] << 4);
    }
    capsule(starts, first_deg, &body)
}

/// A dense capsule: 40 ranges (mm).
pub fn rplidar_dense(starts: bool, first_deg: f64, ranges_mm: &[u16; 40]) -> Vec<u8> {
    let body: Vec<u8> = ranges_mm.iter().flat_map(|range| range.to_le_bytes()).collect();
    capsule(starts, first_deg, &body)
}

/// Metadata of an Ouster sensor with `rows` beams.
pub fn ouster_metadata(rows: usize, columns: usize, profile: &str) -> String {
    let altitude: Vec<f64> = (0..rows)
        .map(|row| 20.0 - 40.0 * row as f64 / rows as f64)
        .collect();
    let azimuth: Vec<f64> = (0..rows).map(|row| [4.2, 1.4, -1.4, -4.2][row % 4]).collect();
    format!(
        "{{\"prod_line\": \"OS-1-{rows}\", \"prod_sn\": \"992200001234\", \"lidar_mode\": \"{columns}x10\", \"beam_altitude_angles\": {altitude:?}, \
         \"beam_azimuth_angles\": {azimuth:?}, \"lidar_origin_to_beam_origin_mm\": 15.806, \"data_format\": {{\"columns_per_frame\": {columns}, \
         \"columns_per_packet\": 16, \"pixels_per_column\": {rows}, \"udp_profile_lidar\": \"{profile}\", \"column_window\": [0, {}]}}}}",
        columns - 1
    )
}

/// A packet of profile RNG19_RFL8_SIG16_NIR16 that begins with column `first`.
pub fn ouster_standard(
    frame: u16,
    first: usize,
    rows: usize,
    stamp_ns: u64,
    range_mm: &dyn Fn(usize, usize) -> u32,
) -> Vec<u8> {
    let mut packet = vec![1, 0];
    packet.extend(frame.to_le_bytes());
    packet.extend([1, 2, 3]);
    packet.extend(&992_200_001_234u64.to_le_bytes()[..5]);
    packet.resize(32, 0);
    for column in first..first + 16 {
        packet.extend((stamp_ns + (column - first) as u64 * 97_656).to_le_bytes());
        packet.extend((column as u16).to_le_bytes());
        packet.extend([1, 0]);
        for row in 0..rows {
            packet.extend(range_mm(row, column).to_le_bytes());
            packet.extend([0; 8]);
        }
    }
    packet.resize(packet.len() + 24, 0);
    packet.extend(crc64(&packet).to_le_bytes());
    packet
}
