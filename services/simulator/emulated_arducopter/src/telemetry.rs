//! The messages that can be asked for, made from the autopilot's state.

// NAV_CONTROLLER_OUTPUT and others have successors that ArduCopter does not send.
#![allow(deprecated)]

use super::ArduCopter;
use super::auto::State;
use super::command::version_message;
use super::proximity::SECTORS;
use super::streams::{Stream, Streams};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::link::{Link, Packet};
use jink_emulated_autopilot::messages;
use jink_emulated_autopilot::modes::arducopter::{Mode, base_mode};
use jink_shared_types::frames::Attitude;
use jink_simulated_world::vehicle::GRAVITY_MPS2;
use mavlink::dialect as m;
use mavlink::dialect::{MavMessage, MavSensorOrientation, MavSysStatusSensor};

/// Orientation of each sector's DISTANCE_SENSOR.
const ORIENTATIONS: [MavSensorOrientation; SECTORS] = [
    MavSensorOrientation::MAV_SENSOR_ROTATION_NONE,
    MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_45,
    MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_90,
    MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_135,
    MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_180,
    MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_225,
    MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_270,
    MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_315,
];
/// Id of the DISTANCE_SENSOR of sector 0.
const FIRST_SECTOR_ID: u8 = 10;

impl ArduCopter {
    /// Sends what is due.
    pub(super) fn send_streams(&mut self, outbox: &mut Vec<Packet>) {
        for index in 0..Streams::COUNT {
            if let Some((link, stream)) = self.streams.take(index, self.now_us) {
                self.send_stream(link, stream, outbox);
            }
        }
        if self.streams.take_timesync(self.now_us) {
            let request = messages::timesync_request(self.now_us);
            self.wire.broadcast(outbox, &request);
        }
        while let Some(seq) = self.reached_items.pop_front() {
            self.last_reached = seq;
            let reached = MavMessage::MISSION_ITEM_REACHED(m::MISSION_ITEM_REACHED_DATA { seq });
            self.wire.broadcast(outbox, &reached);
        }
    }

    /// Sends what `stream` says now, if it says something.
    pub(super) fn send_stream(&mut self, link: Link, stream: Stream, outbox: &mut Vec<Packet>) {
        if stream == Stream::DistanceSensor {
            for sector in 0..SECTORS {
                if let Some(message) = self.distance_sensor(sector) {
                    self.wire.send(outbox, link, message);
                }
            }
            return;
        }
        if let Some(message) = self.message(stream) {
            self.wire.send(outbox, link, message);
        }
    }

    fn message(&self, stream: Stream) -> Option<MavMessage> {
        let now_us = self.now_us;
        Some(match stream {
            Stream::Heartbeat => self.heartbeat(),
            Stream::SysStatus => self.sys_status(),
            Stream::SystemTime => messages::system_time(now_us, self.config.unix_start_us),
            Stream::GpsRaw => self.gps_raw(),
            Stream::Attitude => messages::attitude(now_us, &self.estimate),
            Stream::AttitudeQuaternion => messages::attitude_quaternion(now_us, &self.estimate),
            Stream::LocalPosition if self.is_ready() => messages::local_position(now_us, &self.estimate),
            Stream::GlobalPosition => MavMessage::GLOBAL_POSITION_INT(self.global_position()),
            Stream::ServoOutput => self.servo_output(),
            Stream::MissionCurrent => MavMessage::MISSION_CURRENT(self.mission_current()),
            Stream::MissionItemReached => MavMessage::MISSION_ITEM_REACHED(m::MISSION_ITEM_REACHED_DATA {
                seq: self.last_reached,
            }),
            Stream::NavController => {
                MavMessage::NAV_CONTROLLER_OUTPUT(m::NAV_CONTROLLER_OUTPUT_DATA::default())
            }
            Stream::RcChannels => self.rc_channels(),
            Stream::VfrHud => self.vfr_hud(),
            Stream::AttitudeTarget => self.attitude_target(),
            Stream::PositionTarget => return self.position_target(),
            Stream::PositionTargetGlobal => self.position_target_global(),
            Stream::HighresImu => self.highres_imu(),
            Stream::ScaledImu2 => self.scaled_imu2(),
            Stream::BatteryStatus => MavMessage::BATTERY_STATUS(m::BATTERY_STATUS_DATA {
                battery_remaining: 100,
                ..m::BATTERY_STATUS_DATA::default()
            }),
            Stream::AutopilotVersion => version_message(),
            Stream::HomePosition if self.is_ready() => {
                messages::home_position(now_us, &self.frame, &self.home)
            }
            Stream::ExtendedSysState => MavMessage::EXTENDED_SYS_STATE(m::EXTENDED_SYS_STATE_DATA {
                vtol_state: m::MavVtolState::MAV_VTOL_STATE_UNDEFINED,
                landed_state: self.landed_state(),
            }),
            Stream::LocalPosition | Stream::HomePosition | Stream::DistanceSensor => return None,
        })
    }

    /// Without an identity: who did not upload a mission cannot distinguish it from another of the same length.
    pub(super) fn mission_current(&self) -> m::MISSION_CURRENT_DATA {
        use m::MissionState as S;
        let total = self.mission().total.saturating_sub(1);
        m::MISSION_CURRENT_DATA {
            seq: self.mission().current,
            total,
            mission_state: match self.auto.state() {
                _ if total == 0 => S::MISSION_STATE_NO_MISSION,
                State::Stopped => S::MISSION_STATE_NOT_STARTED,
                State::Running => S::MISSION_STATE_ACTIVE,
                State::Complete => S::MISSION_STATE_COMPLETE,
            },
            mission_mode: u8::from(self.mode == Mode::Auto),
            ..m::MISSION_CURRENT_DATA::default()
        }
    }

    /// HEARTBEAT now.
    pub(super) fn heartbeat(&self) -> MavMessage {
        MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
            custom_mode: self.mode.custom(),
            mavtype: m::MavType::MAV_TYPE_QUADROTOR,
            autopilot: m::MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode: base_mode(self.mode, self.armed),
            system_status: if self.station.is_lost() {
                m::MavState::MAV_STATE_CRITICAL
            } else if self.land_detector.is_landed() {
                m::MavState::MAV_STATE_STANDBY
            } else {
                m::MavState::MAV_STATE_ACTIVE
            },
            ..m::HEARTBEAT_DATA::default()
        })
    }

    fn sys_status(&self) -> MavMessage {
        use MavSysStatusSensor as S;
        let always = messages::always_there();
        let flag = |bit: S, set: bool| if set { bit } else { S::empty() };
        let proximity = S::MAV_SYS_STATUS_SENSOR_PROXIMITY;
        let present = self.proximity.is_enabled();
        let healthy = self.proximity.is_healthy(self.now_us);
        let may_arm = self.is_ready() && (!present || healthy);
        MavMessage::SYS_STATUS(m::SYS_STATUS_DATA {
            onboard_control_sensors_present: always | flag(proximity, present),
            onboard_control_sensors_enabled: always | flag(proximity, present),
            onboard_control_sensors_health: (always - flag(S::MAV_SYS_STATUS_PREARM_CHECK, !may_arm))
                | flag(proximity, healthy),
            voltage_battery: 12_600,
            current_battery: -1,
            battery_remaining: 100,
            ..m::SYS_STATUS_DATA::default()
        })
    }

    fn gps_raw(&self) -> MavMessage {
        let global = self.global_position();
        let fix_type = if self.is_ready() {
            m::GpsFixType::GPS_FIX_TYPE_RTK_FIXED
        } else {
            m::GpsFixType::GPS_FIX_TYPE_NO_GPS
        };
        MavMessage::GPS_RAW_INT(m::GPS_RAW_INT_DATA {
            time_usec: self.now_us,
            lat: global.lat,
            lon: global.lon,
            alt: global.alt,
            fix_type,
            satellites_visible: 10,
            ..m::GPS_RAW_INT_DATA::default()
        })
    }

    fn global_position(&self) -> m::GLOBAL_POSITION_INT_DATA {
        messages::global_position(self.now_us, &self.estimate, &self.frame, &self.home)
    }

    fn servo_output(&self) -> MavMessage {
        let us = 1_000 + (self.command.map_or(0.0, |c| c.thrust) * 1_000.0) as u16;
        MavMessage::SERVO_OUTPUT_RAW(m::SERVO_OUTPUT_RAW_DATA {
            time_usec: self.now_us as u32,
            servo1_raw: us,
            servo2_raw: us,
            servo3_raw: us,
            servo4_raw: us,
            ..m::SERVO_OUTPUT_RAW_DATA::default()
        })
    }

    fn rc_channels(&self) -> MavMessage {
        MavMessage::RC_CHANNELS(m::RC_CHANNELS_DATA {
            time_boot_ms: messages::boot_ms(self.now_us),
            chan1_raw: self.sticks.raw_us(0),
            chan2_raw: self.sticks.raw_us(1),
            chan3_raw: self.sticks.raw_us(2),
            chan4_raw: self.sticks.raw_us(3),
            chan5_raw: self.sticks.raw_us(4),
            chan6_raw: self.sticks.raw_us(5),
            chan7_raw: self.sticks.raw_us(6),
            chan8_raw: self.sticks.raw_us(7),
            chancount: 16,
            rssi: u8::MAX,
            ..m::RC_CHANNELS_DATA::default()
        })
    }

    fn vfr_hud(&self) -> MavMessage {
        let v = self.estimate.velocity;
        let speed = v.x_mps.hypot(v.y_mps) as f32;
        MavMessage::VFR_HUD(m::VFR_HUD_DATA {
            airspeed: speed,
            groundspeed: speed,
            alt: (self.frame.origin_altitude_m - self.estimate.position.z_m) as f32,
            climb: -v.z_mps as f32,
            heading: messages::heading_deg(&self.estimate) as i16,
            throttle: (self.command.map_or(0.0, |c| c.thrust) * 100.0) as u16,
        })
    }

    fn attitude_target(&self) -> MavMessage {
        let attitude = self
            .command
            .map_or(self.estimate.attitude, |c| Attitude::from_rotation(c.attitude));
        MavMessage::ATTITUDE_TARGET(m::ATTITUDE_TARGET_DATA {
            time_boot_ms: messages::boot_ms(self.now_us),
            q: [attitude.w, attitude.x, attitude.y, attitude.z].map(|c| c as f32),
            thrust: self.command.map_or(0.0, |c| c.thrust) as f32,
            ..m::ATTITUDE_TARGET_DATA::default()
        })
    }

    /// What GUIDED follows, reported by submode; nothing in other modes.
    fn position_target(&self) -> Option<MavMessage> {
        if self.mode != Mode::Guided {
            return None;
        }
        let target = self.guided.target();
        let motion = [target.position, target.velocity, target.acceleration];
        Some(MavMessage::POSITION_TARGET_LOCAL_NED(
            m::POSITION_TARGET_LOCAL_NED_DATA {
                type_mask: self.guided.submode().mask(),
                ..messages::position_target(self.now_us, motion)
            },
        ))
    }

    fn position_target_global(&self) -> MavMessage {
        let target = self.control.desired();
        let motion = [target.position, target.velocity];
        MavMessage::POSITION_TARGET_GLOBAL_INT(m::POSITION_TARGET_GLOBAL_INT_DATA {
            type_mask: m::PositionTargetTypemask::default(),
            ..messages::position_target_global(self.now_us, &self.frame, motion)
        })
    }

    /// What an accelerometer feels, in the body's axes (m/s^2).
    fn felt(&self) -> nalgebra::Vector3<f64> {
        let truth = self.vehicle.truth();
        let gravity = nalgebra::Vector3::new(0.0, 0.0, GRAVITY_MPS2);
        let unknown = nalgebra::Vector3::from_element(f64::NAN);
        truth.attitude.rotation().map_or(unknown, |local_q_body| {
            local_q_body.inverse() * (truth.acceleration.vector() - gravity)
        })
    }

    fn highres_imu(&self) -> MavMessage {
        let (felt, rates) = (self.felt(), self.estimate.rates);
        MavMessage::HIGHRES_IMU(m::HIGHRES_IMU_DATA {
            time_usec: self.now_us,
            xacc: felt.x as f32,
            yacc: felt.y as f32,
            zacc: felt.z as f32,
            xgyro: rates.x_radps as f32,
            ygyro: rates.y_radps as f32,
            zgyro: rates.z_radps as f32,
            ..m::HIGHRES_IMU_DATA::default()
        })
    }

    fn scaled_imu2(&self) -> MavMessage {
        let milli_g = |mps2: f64| (mps2 / GRAVITY_MPS2 * 1e3) as i16;
        let felt = self.felt();
        MavMessage::SCALED_IMU2(m::SCALED_IMU2_DATA {
            time_boot_ms: messages::boot_ms(self.now_us),
            xacc: milli_g(felt.x),
            yacc: milli_g(felt.y),
            zacc: milli_g(felt.z),
            ..m::SCALED_IMU2_DATA::default()
        })
    }

    fn distance_sensor(&self, sector: usize) -> Option<MavMessage> {
        let (distance_m, (nearest_m, farthest_m)) = self.proximity.sector(self.now_us, sector)?;
        let centimetres = |metres: f64| (metres * 100.0) as u16;
        Some(MavMessage::DISTANCE_SENSOR(m::DISTANCE_SENSOR_DATA {
            time_boot_ms: messages::boot_ms(self.now_us),
            min_distance: centimetres(nearest_m),
            max_distance: centimetres(farthest_m),
            current_distance: centimetres(distance_m),
            mavtype: m::MavDistanceSensor::MAV_DISTANCE_SENSOR_LASER,
            id: FIRST_SECTOR_ID + sector as u8,
            orientation: ORIENTATIONS[sector],
            ..m::DISTANCE_SENSOR_DATA::default()
        }))
    }

    fn landed_state(&self) -> m::MavLandedState {
        use m::MavLandedState as L;
        if self.land_detector.is_landed() {
            L::MAV_LANDED_STATE_ON_GROUND
        } else if self.mode == Mode::Land {
            L::MAV_LANDED_STATE_LANDING
        } else if self.mode == Mode::Guided && self.guided.is_taking_off() {
            L::MAV_LANDED_STATE_TAKEOFF
        } else {
            L::MAV_LANDED_STATE_IN_AIR
        }
    }
}
