//! PX4's built-in quadrotor (SIH): PX4 computes the vehicle itself and sends its truth as HIL_STATE_QUATERNION.
//!
//! Its place comes in 1e-7 deg (11 mm) and its velocity in cm/s. PX4 paces itself to real time; its clock is mapped to the board's
//! by the least late message of the last second: on a busy machine PX4 runs slower than real time and does not catch up.

use super::error::StartError;
use super::launch::{HOME_HEIGHT_M, HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG};
use super::stage::{CONNECT_PATIENCE, Stage};
use jink_shared_types::frames::{AngularRate, Attitude};
use jink_shared_types::geo::{GlobalPoint, Projection};
use jink_shared_types::source_clock::SourceClock;
use jink_shared_types::{Acceleration, Point, Timestamp, Velocity};
use jink_simulated_world::vehicle::VehicleTruth;
use mavlink::MavlinkReader;
use mavlink::dialect::{HIL_STATE_QUATERNION_DATA, MavMessage};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::net::{Ipv4Addr, UdpSocket};
use std::time::{Duration, Instant};

/// Longest wait for the truth before it is looked whether the autopilot lives.
const LOOK: Duration = Duration::from_millis(100);
/// A vehicle lower than this that moves slower than that stands on the ground (m, m/s).
const GROUND_M: f64 = 0.05;
const GROUND_MPS: f64 = 0.05;

/// The truth of one message, about the place and height of `home`.
pub fn truth(message: &HIL_STATE_QUATERNION_DATA, home: &Projection, home_height_m: f64) -> VehicleTruth {
    let place = home.to_local(GlobalPoint::from_e7(message.lat, message.lon));
    let up_m = f64::from(message.alt) * 1e-3 - home_height_m;
    let velocity = Vector3::new(message.vx, message.vy, message.vz).map(|cmps| f64::from(cmps) * 1e-2);
    let [w, x, y, z] = message.attitude_quaternion.map(f64::from);
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let rates = Vector3::new(message.rollspeed, message.pitchspeed, message.yawspeed).map(f64::from);
    VehicleTruth {
        position: Point::new(place.x, place.y, -up_m),
        velocity: Velocity::from_vector(velocity),
        acceleration: Acceleration::ZERO,
        attitude: Attitude::from_rotation(rotation),
        rates: AngularRate::from_vector(rates),
        wind: Velocity::ZERO,
        on_ground: up_m < GROUND_M && velocity.norm() < GROUND_MPS,
    }
}

/// The receiver of the truth.
pub struct Sih {
    socket: UdpSocket,
    clock: SourceClock,
    last_us: u64,
    first_us: u64,
}

impl Sih {
    /// Waits on UDP `port`.
    pub fn open(port: u16) -> Result<Self, StartError> {
        let io = |cause: std::io::Error| StartError::Io {
            what: format!("UDP port {port}"),
            cause: cause.to_string(),
        };
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).map_err(io)?;
        socket.set_read_timeout(Some(LOOK)).map_err(io)?;
        Ok(Self {
            socket,
            clock: SourceClock::default(),
            last_us: 0,
            first_us: 0,
        })
    }

    /// Takes the truth until the stage is over.
    pub(super) fn run(&mut self, stage: &mut Stage) -> Result<(), String> {
        let home = Projection::new(GlobalPoint {
            latitude_deg: HOME_LATITUDE_DEG,
            longitude_deg: HOME_LONGITUDE_DEG,
        });
        let begin = Instant::now();
        let mut buffer = [0; 2_048];
        while stage.goes_on()? {
            let Ok((length, _)) = self.socket.recv_from(&mut buffer) else {
                if self.last_us == 0 && begin.elapsed() > CONNECT_PATIENCE {
                    let seconds = CONNECT_PATIENCE.as_secs();
                    return Err(
                        stage.silence(&format!("no truth of PX4's built-in vehicle within {seconds} s"))
                    );
                }
                continue;
            };
            let arrived = jink_runtime::now();
            let mut reader = MavlinkReader::new(buffer.get(..length).unwrap_or_default());
            while let Ok((_, message)) = reader.read_any_message::<MavMessage>() {
                let MavMessage::HIL_STATE_QUATERNION(state) = message else {
                    continue;
                };
                if state.time_usec <= self.last_us {
                    continue;
                }
                if self.last_us == 0 {
                    self.first_us = state.time_usec;
                }
                let (time, late_s) = self.on_boards_clock(arrived, state.time_usec);
                let time_s = (state.time_usec - self.first_us) as f64 * 1e-6;
                stage.publish(time, time_s, truth(&state, &home, HOME_HEIGHT_M), late_s);
            }
        }
        Ok(())
    }

    /// When PX4's time `us` was on the board's clock, and by how much the message was late.
    fn on_boards_clock(&mut self, arrived: Timestamp, us: u64) -> (Timestamp, f64) {
        self.last_us = us;
        let stamp_ns = us.saturating_mul(1_000);
        self.clock.observe(stamp_ns, arrived);
        let time = self.clock.map(stamp_ns);
        (time, arrived.seconds_since(time))
    }
}

#[cfg(test)]
mod tests {
    use super::{Sih, truth};
    use jink_shared_types::Timestamp;
    use jink_shared_types::geo::{GlobalPoint, Projection};
    use mavlink::dialect::HIL_STATE_QUATERNION_DATA;
    use nalgebra::{UnitQuaternion, Vector2};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_truth_is_read_to_the_rounding_of_the_message(
            north in -500.0..500.0f64, east in -500.0..500.0f64, up in 0.0..120.0f64, v in -20.0..20.0f64,
            roll in -1.0..1.0f64, pitch in -1.0..1.0f64, yaw in -3.0..3.0f64,
        ) {
            let home = Projection::new(GlobalPoint { latitude_deg: 47.4, longitude_deg: 8.5 });
            let (lat, lon) = home.to_global(Vector2::new(north, east)).to_e7();
            let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let message = HIL_STATE_QUATERNION_DATA {
                attitude_quaternion: [rotation.w, rotation.i, rotation.j, rotation.k].map(|one| one as f32),
                lat,
                lon,
                alt: ((488.0 + up) * 1e3) as i32,
                vx: (v * 1e2) as i16,
                ..HIL_STATE_QUATERNION_DATA::DEFAULT
            };
            let truth = truth(&message, &home, 488.0);
            prop_assert!((truth.position.x_m - north).abs() < 0.02 && (truth.position.y_m - east).abs() < 0.02);
            prop_assert!((truth.position.z_m + up).abs() < 2e-3 && (truth.velocity.x_mps - v).abs() < 0.011);
            prop_assert!(truth.attitude.rotation().unwrap().angle_to(&rotation) < 1e-3);
        }
    }

    #[test]
    fn a_px4_that_has_run_slow_is_caught_up_with() {
        let mut sih = Sih::open(0).unwrap();
        let (mut arrived, mut us) = (Timestamp::from_seconds(100.0), 7_000_000);
        let mut late_s = |period_s: f64| {
            arrived = arrived.plus_seconds(period_s);
            us += 4_000;
            sih.on_boards_clock(arrived, us).1
        };
        // A minute at two thirds of real time, then as fast as it should be.
        for _ in 0..15_000 {
            assert!(late_s(0.006) < 0.5);
        }
        let last_s = (0..500).map(|_| late_s(0.004)).last();
        assert!(last_s.is_some_and(|late_s| late_s < 1e-3), "{last_s:?}");
    }
}
