//! PX4's simulator interface: sensor messages go out over TCP, motor commands come back. The autopilot's clock is that of the
//! messages: lock-step.
//!
//! | out | rate |
//! |---|---|
//! | HIL_SENSOR | 250 Hz; `fields_updated` says which instruments are new |
//! | HIL_GPS | 10 Hz |
//! | HIL_STATE_QUATERNION (truth, for PX4's log) | 50 Hz |
//!
//! In: HIL_ACTUATOR_CONTROLS, one for each HIL_SENSOR once lock-step runs (bit 0 of its `flags`). Source: PX4's simulator_mavlink
//! module, and `simulator` before 1.14.

use super::error::StartError;
use super::instruments::{Fix, Instruments, Reading};
use super::launch::{HOME_HEIGHT_M, HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG};
use super::options::SitlOptions;
use super::quadrotor::{Quadrotor, QuadrotorConfig};
use super::stage::{CONNECT_PATIENCE, Stage};
use jink_shared_types::geo::{GlobalPoint, Projection};
use jink_simulated_world::vehicle::{GRAVITY_MPS2, STEP_S, STEP_US, VehicleTruth};
use mavlink::dialect::{
    HIL_ACTUATOR_CONTROLS_DATA, HIL_GPS_DATA, HIL_SENSOR_DATA, HIL_STATE_QUATERNION_DATA,
    HilActuatorControlsFlags, HilSensorUpdatedFlags, MavMessage,
};
use mavlink::{MavHeader, MavlinkReader};
use nalgebra::{Vector2, Vector3};
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// Steps between two messages with the truth.
const TRUTH_STEPS: u64 = 5;
/// Standard deviations the GPS claims, horizontal and vertical (cm).
const GPS_CLAIMS_CM: [u16; 2] = [60, 90];
const GPS_SATELLITES: u8 = 14;
const GPS_FIX_3D: u8 = 3;
/// HIL_GPS `cog`: unknown.
const COURSE_UNKNOWN: u16 = 65_535;
/// Below this speed a course means nothing (m/s).
const COURSE_SPEED_MPS: f64 = 0.1;
/// Ids of the sender: those that PX4's other simulators use.
const HEADER: MavHeader = MavHeader {
    system_id: 1,
    component_id: 51,
    sequence: 0,
};
/// Longest wait for the commands that answer a step. PX4 lets some steps go without an answer while it starts.
const ANSWER_PATIENCE: Duration = Duration::from_millis(500);
/// Longest sleep in a wait.
const LOOK: Duration = Duration::from_millis(50);

/// The messages of step number `step`, which ended in `truth`.
pub fn messages(step: u64, truth: &VehicleTruth, reading: &Reading, out: &mut Vec<MavMessage>) {
    let time_usec = step * STEP_US;
    if let Some(fix) = &reading.gps {
        out.push(MavMessage::HIL_GPS(gps(time_usec, fix)));
    }
    if step.is_multiple_of(TRUTH_STEPS) {
        out.push(MavMessage::HIL_STATE_QUATERNION(state(time_usec, truth, reading)));
    }
    out.push(MavMessage::HIL_SENSOR(sensor(time_usec, reading)));
}

fn sensor(time_usec: u64, reading: &Reading) -> HIL_SENSOR_DATA {
    use HilSensorUpdatedFlags as Flags;
    let mut fields = Flags::HIL_SENSOR_UPDATED_XACC
        | Flags::HIL_SENSOR_UPDATED_YACC
        | Flags::HIL_SENSOR_UPDATED_ZACC
        | Flags::HIL_SENSOR_UPDATED_XGYRO
        | Flags::HIL_SENSOR_UPDATED_YGYRO
        | Flags::HIL_SENSOR_UPDATED_ZGYRO;
    let [xacc, yacc, zacc] = single(reading.accelerometer);
    let [xgyro, ygyro, zgyro] = single(reading.gyroscope);
    let mut message = HIL_SENSOR_DATA {
        time_usec,
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        ..HIL_SENSOR_DATA::DEFAULT
    };
    if let Some(field) = reading.magnetometer {
        fields |=
            Flags::HIL_SENSOR_UPDATED_XMAG | Flags::HIL_SENSOR_UPDATED_YMAG | Flags::HIL_SENSOR_UPDATED_ZMAG;
        [message.xmag, message.ymag, message.zmag] = single(field);
    }
    if let Some(air) = reading.barometer {
        fields |= Flags::HIL_SENSOR_UPDATED_ABS_PRESSURE
            | Flags::HIL_SENSOR_UPDATED_PRESSURE_ALT
            | Flags::HIL_SENSOR_UPDATED_TEMPERATURE;
        message.abs_pressure = air.pressure_hpa as f32;
        message.pressure_alt = air.height_m as f32;
        message.temperature = air.temperature_degc as f32;
    }
    message.fields_updated = fields;
    message
}

fn gps(time_usec: u64, fix: &Fix) -> HIL_GPS_DATA {
    let (lat, lon) = fix.place.to_e7();
    let speed_mps = fix.velocity.xy().norm();
    let course_deg = fix
        .velocity
        .y
        .atan2(fix.velocity.x)
        .to_degrees()
        .rem_euclid(360.0);
    let [vn, ve, vd] = centi(fix.velocity);
    let [eph, epv] = GPS_CLAIMS_CM;
    HIL_GPS_DATA {
        time_usec,
        fix_type: GPS_FIX_3D,
        lat,
        lon,
        alt: (fix.height_m * 1e3).round() as i32,
        eph,
        epv,
        vel: (speed_mps * 1e2).round() as u16,
        vn,
        ve,
        vd,
        cog: match speed_mps > COURSE_SPEED_MPS {
            true => (course_deg * 1e2).round() as u16 % 36_000,
            false => COURSE_UNKNOWN,
        },
        satellites_visible: GPS_SATELLITES,
        ..HIL_GPS_DATA::DEFAULT
    }
}

fn state(time_usec: u64, truth: &VehicleTruth, reading: &Reading) -> HIL_STATE_QUATERNION_DATA {
    let home = Projection::new(GlobalPoint {
        latitude_deg: HOME_LATITUDE_DEG,
        longitude_deg: HOME_LONGITUDE_DEG,
    });
    let position = truth.position;
    let (lat, lon) = home.to_global(Vector2::new(position.x_m, position.y_m)).to_e7();
    let q = truth.attitude;
    let [rollspeed, pitchspeed, yawspeed] = single(truth.rates.vector());
    let [vx, vy, vz] = centi(truth.velocity.vector());
    // In thousandths of gravity.
    let milli_g = reading.accelerometer * (1e3 / GRAVITY_MPS2);
    let airspeed_mps = (truth.velocity.vector() - truth.wind.vector()).norm();
    let airspeed_cmps = (airspeed_mps * 1e2).round() as u16;
    HIL_STATE_QUATERNION_DATA {
        time_usec,
        attitude_quaternion: [q.w, q.x, q.y, q.z].map(|c| c as f32),
        rollspeed,
        pitchspeed,
        yawspeed,
        lat,
        lon,
        alt: ((HOME_HEIGHT_M - position.z_m) * 1e3).round() as i32,
        vx,
        vy,
        vz,
        ind_airspeed: airspeed_cmps,
        true_airspeed: airspeed_cmps,
        xacc: milli_g.x as i16,
        yacc: milli_g.y as i16,
        zacc: milli_g.z as i16,
    }
}

fn single(v: Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// Hundredths, as MAVLink has velocities.
fn centi(v: Vector3<f64>) -> [i16; 3] {
    [v.x, v.y, v.z].map(|one| (one * 1e2).round() as i16)
}

/// The first four motor commands.
pub fn commands(message: &HIL_ACTUATOR_CONTROLS_DATA) -> [f64; 4] {
    let [first, second, third, fourth, ..] = message.controls.map(f64::from);
    [first, second, third, fourth]
}

/// The simulation behind the interface.
pub struct Hil {
    listener: TcpListener,
    quadrotor: Quadrotor,
    instruments: Instruments,
}

/// A connected PX4.
struct Connection {
    stream: TcpStream,
    reader: MavlinkReader<VecDeque<u8>>,
    sequence: u8,
    bytes: Vec<u8>,
    in_lockstep: bool,
    commands: [f64; 4],
}

impl Hil {
    /// Waits on TCP `port`.
    pub fn open(port: u16, options: &SitlOptions) -> Result<Self, StartError> {
        let io = |cause: std::io::Error| StartError::Io {
            what: format!("TCP port {port}"),
            cause: cause.to_string(),
        };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(io)?;
        listener.set_nonblocking(true).map_err(io)?;
        Ok(Self {
            listener,
            quadrotor: Quadrotor::new(&QuadrotorConfig {
                wind: options.wind.clone(),
                seed: options.seed,
                ..QuadrotorConfig::iris()
            }),
            instruments: Instruments::new(options.seed, options.build.gps_delay_s()),
        })
    }

    /// Simulates until the stage is over.
    pub(super) fn run(&mut self, stage: &mut Stage) -> Result<(), String> {
        let Some(mut px4) = self.connect(stage)? else {
            return Ok(());
        };
        let mut out = Vec::new();
        let mut step = 0;
        while stage.goes_on()? {
            step += 1;
            self.quadrotor.step(STEP_S, &px4.commands);
            let truth = self.quadrotor.truth();
            let reading = self.instruments.step(&truth, self.quadrotor.specific_force());
            out.clear();
            messages(step, &truth, &reading, &mut out);
            if !(px4.send(&out) && px4.receive_answer(stage)?) {
                // It has closed the connection: its end follows.
                std::thread::sleep(LOOK);
                stage.goes_on()?;
                return Err(stage.silence("PX4 closed the simulator's connection"));
            }
            stage.pace(truth);
        }
        Ok(())
    }

    fn connect(&mut self, stage: &mut Stage) -> Result<Option<Connection>, String> {
        let begin = Instant::now();
        while stage.goes_on()? {
            if let Ok((stream, _)) = self.listener.accept() {
                let prepared = stream
                    .set_nonblocking(false)
                    .and_then(|()| stream.set_nodelay(true))
                    .and_then(|()| stream.set_read_timeout(Some(LOOK)));
                prepared.map_err(|cause| stage.silence(&format!("PX4's connection: {cause}")))?;
                return Ok(Some(Connection {
                    stream,
                    reader: MavlinkReader::new(VecDeque::new()),
                    sequence: 0,
                    bytes: Vec::new(),
                    in_lockstep: false,
                    commands: [0.0; 4],
                }));
            }
            if begin.elapsed() > CONNECT_PATIENCE {
                let seconds = CONNECT_PATIENCE.as_secs();
                return Err(stage.silence(&format!(
                    "PX4 did not connect to the simulator within {seconds} s"
                )));
            }
            std::thread::sleep(LOOK);
        }
        Ok(None)
    }
}

impl Connection {
    /// Whether it could be sent.
    fn send(&mut self, messages: &[MavMessage]) -> bool {
        self.bytes.clear();
        for message in messages {
            let header = MavHeader {
                sequence: self.sequence,
                ..HEADER
            };
            self.sequence = self.sequence.wrapping_add(1);
            if mavlink::write_v2_msg(&mut self.bytes, header, message).is_err() {
                return false;
            }
        }
        self.stream.write_all(&self.bytes).is_ok()
    }

    /// Takes what has come; in lock-step waits for the commands that answer the step. Whether the connection is still there.
    fn receive_answer(&mut self, stage: &mut Stage) -> Result<bool, String> {
        let begin = Instant::now();
        let mut buffer = [0; 4_096];
        let mut answered = self.parse();
        loop {
            let waits = self.in_lockstep && !answered && begin.elapsed() < ANSWER_PATIENCE;
            if self.stream.set_nonblocking(!waits).is_err() {
                return Ok(false);
            }
            match self.stream.read(&mut buffer) {
                Ok(0) => return Ok(false),
                Ok(length) => {
                    let bytes = buffer.get(..length).unwrap_or_default();
                    self.reader.get_mut().extend(bytes);
                    answered |= self.parse();
                }
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock && !waits => {
                    return Ok(self.stream.set_nonblocking(false).is_ok());
                }
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {
                    if !stage.goes_on()? {
                        return Ok(true);
                    }
                }
                Err(_) => return Ok(false),
            }
        }
    }

    /// Whether there were motor commands in what has come.
    fn parse(&mut self) -> bool {
        let mut any = false;
        while let Ok((_, message)) = self.reader.read_any_message::<MavMessage>() {
            if let MavMessage::HIL_ACTUATOR_CONTROLS(controls) = message {
                self.commands = commands(&controls);
                self.in_lockstep |= controls
                    .flags
                    .contains(HilActuatorControlsFlags::HIL_ACTUATOR_CONTROLS_FLAGS_LOCKSTEP);
                any = true;
            }
        }
        any
    }
}

#[cfg(test)]
mod tests {
    use super::{HEADER, commands, gps, messages, sensor};
    use crate::sitl::instruments::{Fix, Instruments, Pressure, Reading};
    use crate::sitl::quadrotor::{Quadrotor, QuadrotorConfig};
    use jink_shared_types::geo::GlobalPoint;
    use jink_simulated_world::vehicle::{GRAVITY_MPS2, STEP_S};
    use mavlink::dialect::{HilActuatorControlsFlags, MavMessage};
    use nalgebra::Vector3;

    // Packed by pymavlink 2.4 (dialect ardupilotmega, system 1, component 51, sequence 0) from the same values.
    const SENSOR_ALL: &str = "fd3e00000001336b000080380100000000000000003f000080be00001cc10000003e000080bd0000003d0000803e000000be0000c03e00006f44000000000000f44300003c41ff1b049f";
    const SENSOR_INERTIAL: &str = "fd3d00000001336b0000a00f0000000000000000003f000080be00001cc10000003e000080bd0000003d000000000000000000000000000000000000000000000000000000003fd276";
    const GPS: &str =
        "fd240000000133710000a0860100000000004c52401c44f41705407207003c005a00f4012c0170fe1900df77030eb435";
    const ACTUATORS: &str = "fd5100000001335d000040e201000000000001000000000000000000003f0000803e0000403f0000803f000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000810ac8";

    fn hex(message: &MavMessage) -> String {
        let mut bytes = Vec::new();
        mavlink::write_v2_msg(&mut bytes, HEADER, message).unwrap();
        bytes.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    fn bytes(hex: &str) -> Vec<u8> {
        (0..hex.len())
            .step_by(2)
            .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap())
            .collect()
    }

    fn reading() -> Reading {
        Reading {
            accelerometer: Vector3::new(0.5, -0.25, -9.75),
            gyroscope: Vector3::new(0.125, -0.0625, 0.03125),
            magnetometer: None,
            barometer: None,
            gps: None,
        }
    }

    #[test]
    fn sensors_and_gps_are_written_as_pymavlink_writes_them() {
        let inertial = MavMessage::HIL_SENSOR(sensor(4_000, &reading()));
        assert_eq!(hex(&inertial), SENSOR_INERTIAL);
        let all = Reading {
            magnetometer: Some(Vector3::new(0.25, -0.125, 0.375)),
            barometer: Some(Pressure {
                pressure_hpa: 956.0,
                height_m: 488.0,
                temperature_degc: 11.75,
            }),
            ..reading()
        };
        assert_eq!(hex(&MavMessage::HIL_SENSOR(sensor(80_000, &all))), SENSOR_ALL);
        let fix = Fix {
            place: GlobalPoint {
                latitude_deg: 47.397_742,
                longitude_deg: 8.545_594,
            },
            height_m: 488.0,
            velocity: Vector3::new(3.0, -4.0, 0.25),
        };
        assert_eq!(hex(&MavMessage::HIL_GPS(gps(100_000, &fix))), GPS);
    }

    #[test]
    fn motor_commands_are_read_as_pymavlink_writes_them() {
        let bytes = bytes(ACTUATORS);
        let mut reader = mavlink::MavlinkReader::new(bytes.as_slice());
        let (_, message) = reader.read_any_message::<MavMessage>().unwrap();
        let MavMessage::HIL_ACTUATOR_CONTROLS(controls) = message else {
            panic!("{message:?}");
        };
        assert_eq!(commands(&controls), [0.5, 0.25, 0.75, 1.0]);
        let lockstep = HilActuatorControlsFlags::HIL_ACTUATOR_CONTROLS_FLAGS_LOCKSTEP;
        assert!(controls.flags.contains(lockstep));
    }

    #[test]
    fn every_step_ends_with_its_sensor_message_and_the_clock_goes_on_by_4_ms() {
        let mut quadrotor = Quadrotor::new(&QuadrotorConfig::iris());
        let mut instruments = Instruments::new(1, 0.11);
        let (mut fixes, mut truths) = (0, 0);
        for step in 1..=250u64 {
            quadrotor.step(STEP_S, &[0.6; 4]);
            let truth = quadrotor.truth();
            let reading = instruments.step(&truth, quadrotor.specific_force());
            let mut out = Vec::new();
            messages(step, &truth, &reading, &mut out);
            for message in &out {
                match message {
                    MavMessage::HIL_GPS(_) => fixes += 1,
                    MavMessage::HIL_STATE_QUATERNION(state) => {
                        truths += 1;
                        let up_m = f64::from(state.alt) * 1e-3 - super::HOME_HEIGHT_M;
                        assert!((up_m + truth.position.z_m).abs() < 1e-3);
                    }
                    MavMessage::HIL_SENSOR(sensor) => {
                        assert_eq!(sensor.time_usec, step * 4_000);
                        let lift = f64::from(-sensor.zacc) / GRAVITY_MPS2;
                        assert!((0.9..1.4).contains(&lift), "{lift}");
                    }
                    other => panic!("{other:?}"),
                }
            }
            assert!(matches!(out.last(), Some(MavMessage::HIL_SENSOR(_))));
        }
        assert_eq!((fixes, truths), (10, 50));
    }
}
