//! ArduPilot's JSON interface: a packet of servo outputs comes in, the motion of the vehicle goes back as one line of JSON. The
//! autopilot waits for it: lock-step.
//!
//! Source: `libraries/SITL/examples/JSON/readme.md` of ArduPilot. Position and attitude are true ones; ArduPilot makes its GPS,
//! barometer and compass of them, with errors of its own (`SIM_*` parameters).

use super::error::StartError;
use super::instruments::{ACCELEROMETER_SIGMA_MPS2, GYROSCOPE_SIGMA_RADPS};
use super::options::SitlOptions;
use super::quadrotor::{Quadrotor, QuadrotorConfig};
use super::stage::{CONNECT_PATIENCE, Stage};
use jink_simulated_world::random::Random;
use jink_simulated_world::vehicle::{STEP_US, VehicleTruth};
use nalgebra::Vector3;
use std::fmt::Write;
use std::net::{Ipv4Addr, UdpSocket};
use std::time::{Duration, Instant};

/// First number of a packet with 16 outputs, and of one with 32 (SERVO_32_ENABLE).
const MAGIC: [(u16, usize); 2] = [(18_458, 16), (29_569, 32)];
/// Bytes before the outputs: magic, rate, count.
const HEADER_BYTES: usize = 8;
/// One exchange (us): ArduPilot samples its gyroscope at 1 kHz, and the truth's step is a multiple.
const EXCHANGE_US: u64 = 1_000;
/// Longest wait for a packet before it is looked whether the autopilot lives.
const LOOK: Duration = Duration::from_millis(100);
/// Keeps the noise apart from other random streams of the same seed.
const NOISE_STREAM: u64 = 0x6a73_6f6e;

/// What the autopilot sends to the servos.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServoPacket {
    /// Counts up by one with each answer taken; the same again asks for the same answer.
    pub frame_count: u32,
    /// The first four outputs (us).
    pub pwm: [u16; 4],
}

impl ServoPacket {
    /// Reads a datagram; `None` for anything else.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let word = |at: usize| Some(u16::from_le_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
        let magic = word(0)?;
        let outputs = MAGIC
            .iter()
            .find_map(|(known, outputs)| (*known == magic).then_some(*outputs))?;
        if bytes.len() != HEADER_BYTES + 2 * outputs {
            return None;
        }
        let mut pwm = [0; 4];
        for (i, one) in pwm.iter_mut().enumerate() {
            *one = word(HEADER_BYTES + 2 * i)?;
        }
        Some(Self {
            frame_count: u32::from(word(4)?) | u32::from(word(6)?) << 16,
            pwm,
        })
    }

    /// Commands of the motors, 0 to 1.
    pub fn commands(&self) -> [f64; 4] {
        self.pwm
            .map(|pwm| ((f64::from(pwm) - 1_000.0) / 1_000.0).clamp(0.0, 1.0))
    }
}

/// What is sent to the autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JsonState {
    /// Simulated time (s).
    pub time_s: f64,
    /// Body rates, forward right down (rad/s).
    pub gyro: Vector3<f64>,
    /// Specific force, forward right down (m/s^2).
    pub accel: Vector3<f64>,
    /// Motion.
    pub truth: VehicleTruth,
}

impl JsonState {
    /// The line, with the line feed before and behind it that ArduPilot wants.
    pub fn write(&self, line: &mut String) {
        line.clear();
        let q = self.truth.attitude;
        let (position, velocity) = (self.truth.position.vector(), self.truth.velocity.vector());
        let wind = self.truth.wind.vector();
        // Writing into a string cannot fail.
        let _infallible = write!(
            line,
            "\n{{\"timestamp\":{:.6},\"imu\":{{\"gyro\":{},\"accel_body\":{}}},\"position\":{},\"quaternion\":[{},{},{},{}],\
             \"velocity\":{},\"velocity_wind\":{}}}\n",
            self.time_s,
            Array(self.gyro),
            Array(self.accel),
            Array(position),
            q.w,
            q.x,
            q.y,
            q.z,
            Array(velocity),
            Array(wind),
        );
    }
}

struct Array(Vector3<f64>);

impl std::fmt::Display for Array {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self(v) = self;
        write!(f, "[{:.9},{:.9},{:.9}]", v.x, v.y, v.z)
    }
}

/// The simulation behind the interface.
pub struct Json {
    socket: UdpSocket,
    quadrotor: Quadrotor,
    random: Random,
    line: String,
}

impl Json {
    /// Waits on UDP `port`.
    pub fn open(port: u16, options: &SitlOptions) -> Result<Self, StartError> {
        let io = |cause: std::io::Error| StartError::Io {
            what: format!("UDP port {port}"),
            cause: cause.to_string(),
        };
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).map_err(io)?;
        socket.set_read_timeout(Some(LOOK)).map_err(io)?;
        Ok(Self {
            socket,
            quadrotor: Quadrotor::new(&QuadrotorConfig {
                wind: options.wind.clone(),
                seed: options.seed,
                ..QuadrotorConfig::copter()
            }),
            random: Random::new(options.seed, NOISE_STREAM),
            line: String::new(),
        })
    }

    /// Simulates until the stage is over.
    pub(super) fn run(&mut self, stage: &mut Stage) -> Result<(), String> {
        let begin = Instant::now();
        let mut buffer = [0; 256];
        let mut last = None;
        let mut time_us = 0;
        while stage.goes_on()? {
            let Ok((length, from)) = self.socket.recv_from(&mut buffer) else {
                if last.is_none() && begin.elapsed() > CONNECT_PATIENCE {
                    let seconds = CONNECT_PATIENCE.as_secs();
                    return Err(stage.silence(&format!("no servo packet of ArduPilot within {seconds} s")));
                }
                continue;
            };
            let Some(packet) = ServoPacket::read(buffer.get(..length).unwrap_or_default()) else {
                continue;
            };
            // A packet that is sent again gets the answer that was lost.
            if last != Some(packet.frame_count) {
                last = Some(packet.frame_count);
                time_us += EXCHANGE_US;
                self.quadrotor.step(EXCHANGE_US as f64 * 1e-6, &packet.commands());
                if time_us.is_multiple_of(STEP_US) {
                    stage.pace(self.quadrotor.truth());
                }
                self.measure(time_us);
            }
            // It asks again for what got lost.
            let _lost = self.socket.send_to(self.line.as_bytes(), from);
        }
        Ok(())
    }

    fn measure(&mut self, time_us: u64) {
        let random = &mut self.random;
        let mut noise = |sigma: f64| Vector3::from_fn(|_, _| random.normal()) * sigma;
        let truth = self.quadrotor.truth();
        JsonState {
            time_s: time_us as f64 * 1e-6,
            gyro: truth.rates.vector() + noise(GYROSCOPE_SIGMA_RADPS),
            accel: self.quadrotor.specific_force() + noise(ACCELEROMETER_SIGMA_MPS2),
            truth,
        }
        .write(&mut self.line);
    }
}

#[cfg(test)]
mod tests {
    use super::{JsonState, ServoPacket};
    use jink_shared_types::frames::Attitude;
    use jink_shared_types::{Point, Velocity};
    use jink_simulated_world::vehicle::{Vehicle, VehicleConfig};
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    /// magic, rate 1200, count 70000, outputs 1000, 1250, 1500, 2000, 0 ...: 16 and 32 of them, as ArduPilot's readme lays them out.
    fn packet(magic: u16, outputs: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        bytes.extend(magic.to_le_bytes());
        bytes.extend(1_200u16.to_le_bytes());
        bytes.extend(70_000u32.to_le_bytes());
        for i in 0..outputs {
            let pwm = [1_000u16, 1_250, 1_500, 2_000].get(i).copied().unwrap_or(0);
            bytes.extend(pwm.to_le_bytes());
        }
        bytes
    }

    #[test]
    fn servo_packets_of_both_lengths_are_read() {
        for (magic, outputs) in [(18_458, 16), (29_569, 32)] {
            let read = ServoPacket::read(&packet(magic, outputs)).unwrap();
            assert_eq!(
                (read.frame_count, read.pwm),
                (70_000, [1_000, 1_250, 1_500, 2_000])
            );
            assert_eq!(read.commands(), [0.0, 0.25, 0.5, 1.0]);
        }
        assert_eq!(ServoPacket::read(&packet(18_458, 32)), None);
        assert_eq!(ServoPacket::read(&packet(18_459, 16)), None);
    }

    fn vector() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-1e3..1e3f64).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn no_datagram_is_too_strange_to_be_read(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Some(packet) = ServoPacket::read(&bytes) {
                prop_assert!(packet.commands().iter().all(|command| (0.0..=1.0).contains(command)));
            }
        }

        #[test]
        fn a_json_reader_gets_back_what_was_written(
            time_us in 0u64..4_000_000_000, gyro in vector(), accel in vector(), position in vector(), velocity in vector(),
            roll in -3.0..3.0f64, pitch in -1.5..1.5f64, yaw in -3.0..3.0f64,
        ) {
            let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let mut truth = *Vehicle::new(&VehicleConfig::default()).truth();
            truth.position = Point::from_vector(position);
            truth.velocity = Velocity::from_vector(velocity);
            truth.attitude = Attitude::from_rotation(rotation);
            let time_s = time_us as f64 * 1e-6;
            let mut line = String::new();
            JsonState { time_s, gyro, accel, truth }.write(&mut line);
            let framed = line.starts_with('\n') && line.ends_with("}\n");
            prop_assert!(framed);
            prop_assert_eq!(line.trim().lines().count(), 1);
            let json: serde_json::Value = serde_json::from_str(&line).unwrap();
            let vector = |value: &serde_json::Value| {
                Vector3::from_fn(|i, _| value[i].as_f64().unwrap())
            };
            prop_assert!((json["timestamp"].as_f64().unwrap() - time_s).abs() < 1e-6);
            prop_assert!((vector(&json["imu"]["gyro"]) - gyro).norm() < 1e-8);
            prop_assert!((vector(&json["imu"]["accel_body"]) - accel).norm() < 1e-8);
            prop_assert!((vector(&json["position"]) - position).norm() < 1e-8);
            prop_assert!((vector(&json["velocity"]) - velocity).norm() < 1e-8);
            let q = &json["quaternion"];
            let back = nalgebra::Quaternion::new(
                q[0].as_f64().unwrap(), q[1].as_f64().unwrap(), q[2].as_f64().unwrap(), q[3].as_f64().unwrap(),
            );
            prop_assert!(UnitQuaternion::new_normalize(back).angle_to(&rotation) < 1e-6);
        }
    }
}
