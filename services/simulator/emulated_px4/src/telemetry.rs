//! The messages of the streams, made from the autopilot's state.

use super::Px4;
use super::current_mode;
use super::flight_task::CONTROL_STEPS;
use super::obstacle_messages;
use super::streams::{Stream, Streams};
use jink_emulated_autopilot::link::Packet;
use jink_emulated_autopilot::messages;
use jink_emulated_autopilot::modes::px4::{base_mode, custom_mode};
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::vehicle::STEP_US;
use jink_simulated_world::vehicle::estimator::Estimate;
use mavlink::dialect as m;
use mavlink::dialect::{MavMessage, MavSysStatusSensor};

/// `mission_mode` of MISSION_CURRENT: items are executed.
const MISSION_MODE_ACTIVE: u8 = 1;
/// `mission_mode` of MISSION_CURRENT: another mode flies.
const MISSION_MODE_SUSPENDED: u8 = 2;

impl Px4 {
    /// Sends what is due.
    pub(super) fn send_streams(&mut self, outbox: &mut Vec<Packet>) {
        let (mode, intended) = (self.commander.mode(), self.commander.intended());
        self.mode_update.step(self.now_us, mode, intended);
        for index in 0..Streams::COUNT {
            let Some((link, stream)) = self.streams.due(index, self.now_us) else {
                continue;
            };
            if stream == Stream::CurrentMode && !self.mode_update.is_due(self.now_us, link) {
                continue;
            }
            let message = self.message(stream);
            self.streams.served(index, self.now_us, message.is_some());
            if let Some(message) = message {
                self.wire.send(outbox, link, message);
            }
            if stream == Stream::CurrentMode {
                self.mode_update.reported(link);
            }
        }
        while let Some(seq) = self.reached_items.pop_front() {
            let reached = MavMessage::MISSION_ITEM_REACHED(m::MISSION_ITEM_REACHED_DATA { seq });
            self.wire.broadcast(outbox, &reached);
            if let Some(current) = self.message(Stream::MissionCurrent) {
                self.wire.broadcast(outbox, &current);
            }
        }
    }

    /// The message of `stream` now; `None` if there is nothing to say.
    pub(super) fn message(&self, stream: Stream) -> Option<MavMessage> {
        let now_us = self.now_us;
        match stream {
            Stream::Heartbeat => Some(self.heartbeat()),
            Stream::SysStatus => Some(self.sys_status()),
            Stream::ManualControl => self.manual_control(),
            Stream::SystemTime => Some(messages::system_time(now_us, self.config.unix_start_us)),
            Stream::Timesync => Some(messages::timesync_request(now_us)),
            Stream::Attitude => Some(messages::attitude(now_us, &self.estimate)),
            Stream::AttitudeQuaternion => Some(messages::attitude_quaternion(now_us, &self.estimate)),
            Stream::LocalPosition if self.is_ready() => {
                Some(messages::local_position(now_us, &self.estimate))
            }
            Stream::GlobalPosition if self.is_ready() => Some(MavMessage::GLOBAL_POSITION_INT(
                messages::global_position(now_us, &self.estimate, &self.frame, &self.home),
            )),
            Stream::Altitude if self.is_ready() => Some(self.altitude()),
            Stream::HomePosition if self.is_ready() => {
                Some(messages::home_position(now_us, &self.frame, &self.home))
            }
            Stream::PositionTarget => self.position_target(),
            Stream::PositionTargetGlobal => self.position_target_global(),
            Stream::ExtendedSysState => Some(MavMessage::EXTENDED_SYS_STATE(m::EXTENDED_SYS_STATE_DATA {
                vtol_state: m::MavVtolState::MAV_VTOL_STATE_UNDEFINED,
                landed_state: self.landed_state(),
            })),
            Stream::MissionCurrent => self.mission_current(),
            Stream::OrbitStatus => self.orbit_status(),
            Stream::CurrentMode => Some(current_mode::message(
                self.commander.mode(),
                self.commander.intended(),
            )),
            Stream::ObstacleDistance => self.fused_obstacles(),
            Stream::Odometry if self.is_ready() => Some(self.odometry()),
            Stream::Trajectory => self.trajectory(),
            _ => None,
        }
    }

    /// The circle that is flown.
    fn orbit_status(&self) -> Option<MavMessage> {
        let orbit = self.orbit.filter(|_| self.commander.mode() == NavMode::Orbit)?;
        Some(orbit.status(self.now_us, &self.frame))
    }

    fn heartbeat(&self) -> MavMessage {
        let (mode, armed) = (self.commander.mode(), self.commander.is_armed());
        MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
            custom_mode: custom_mode(mode),
            mavtype: m::MavType::MAV_TYPE_QUADROTOR,
            autopilot: m::MavAutopilot::MAV_AUTOPILOT_PX4,
            base_mode: base_mode(mode, armed),
            system_status: if self.commander.in_failsafe() {
                m::MavState::MAV_STATE_CRITICAL
            } else if armed {
                m::MavState::MAV_STATE_ACTIVE
            } else {
                m::MavState::MAV_STATE_STANDBY
            },
            ..m::HEARTBEAT_DATA::default()
        })
    }

    /// The avoidance bit: present if required or seen, enabled in automatic modes, healthy as the heartbeat says.
    fn sys_status(&self) -> MavMessage {
        use MavSysStatusSensor as S;
        let always = messages::always_there();
        let flag = |bit: S, set: bool| if set { bit } else { S::empty() };
        let avoidance = S::MAV_SYS_STATUS_OBSTACLE_AVOIDANCE;
        let required = self.parameters.avoidance_enabled();
        let valid = self.commander.companion.is_valid();
        let mode = self.commander.mode();
        let prearm_ok = self
            .commander
            .check_arming(&self.parameters, &self.situation())
            .is_ok();
        let healthy = always - flag(S::MAV_SYS_STATUS_PREARM_CHECK, !prearm_ok);
        let watched = mode.is_automatic() || mode == NavMode::Position;
        MavMessage::SYS_STATUS(m::SYS_STATUS_DATA {
            onboard_control_sensors_present: always | flag(avoidance, required || valid),
            onboard_control_sensors_enabled: always | flag(avoidance, required && mode.is_automatic()),
            onboard_control_sensors_health: healthy | flag(avoidance, valid && watched),
            voltage_battery: 16_200,
            current_battery: -1,
            battery_remaining: 100,
            ..m::SYS_STATUS_DATA::default()
        })
    }

    fn altitude(&self) -> MavMessage {
        let up_m = -self.estimate.position.z_m;
        let amsl_m = self.frame.origin_altitude_m + up_m;
        MavMessage::ALTITUDE(m::ALTITUDE_DATA {
            time_usec: self.now_us,
            altitude_monotonic: amsl_m as f32,
            altitude_amsl: amsl_m as f32,
            altitude_local: up_m as f32,
            altitude_relative: (up_m + self.home.z) as f32,
            altitude_terrain: f32::NAN,
            bottom_clearance: f32::NAN,
        })
    }

    /// The sticks, while somebody holds them.
    fn manual_control(&self) -> Option<MavMessage> {
        let thousandths = |share: f64| (share * 1000.0) as i16;
        let has_sticks = self.commander.has_sticks(self.now_us);
        has_sticks.then(|| {
            MavMessage::MANUAL_CONTROL(m::MANUAL_CONTROL_DATA {
                x: thousandths(self.sticks.forward),
                y: thousandths(self.sticks.right),
                z: thousandths(0.5 + 0.5 * self.sticks.up),
                r: thousandths(self.sticks.turn),
                target: self.config.system_id,
                ..m::MANUAL_CONTROL_DATA::default()
            })
        })
    }

    /// What the controller follows, once it flies.
    fn position_target(&self) -> Option<MavMessage> {
        self.command?;
        let setpoint = self.controller.followed();
        let motion = [setpoint.position, setpoint.velocity, setpoint.acceleration];
        Some(MavMessage::POSITION_TARGET_LOCAL_NED(
            m::POSITION_TARGET_LOCAL_NED_DATA {
                yaw: setpoint.yaw_rad as f32,
                yaw_rate: setpoint.yaw_rate_radps as f32,
                ..messages::position_target(self.now_us, motion)
            },
        ))
    }

    /// The place of the current waypoint, with the motion that the controller follows. In OFFBOARD and under sticks there is none.
    fn position_target_global(&self) -> Option<MavMessage> {
        self.command?;
        let place = self.navigator.triplet().current?.position;
        if !place.xy().iter().all(|c| c.is_finite()) {
            return None;
        }
        let setpoint = self.controller.followed();
        let [afx, afy, afz] = setpoint.acceleration.map(|c| c as f32).into();
        Some(MavMessage::POSITION_TARGET_GLOBAL_INT(
            m::POSITION_TARGET_GLOBAL_INT_DATA {
                afx,
                afy,
                afz,
                yaw: setpoint.yaw_rad as f32,
                yaw_rate: setpoint.yaw_rate_radps as f32,
                ..messages::position_target_global(self.now_us, &self.frame, [place, setpoint.velocity])
            },
        ))
    }

    /// The fused map of collision prevention, while it publishes one: in Position mode, switched on.
    fn fused_obstacles(&self) -> Option<MavMessage> {
        let published = self
            .fused_us
            .is_some_and(|at_us| self.now_us - at_us <= CONTROL_STEPS * STEP_US);
        published.then(|| MavMessage::OBSTACLE_DISTANCE(obstacle_messages::fused(&self.collision_prevention)))
    }

    /// Position and velocity in the local frame, as current PX4's estimator gives both; nothing is said of covariances.
    fn odometry(&self) -> MavMessage {
        let Estimate {
            position,
            velocity,
            attitude,
            rates,
            resets,
        } = self.estimate;
        let mut unknown = [0.0; 21];
        unknown[0] = f32::NAN;
        MavMessage::ODOMETRY(m::ODOMETRY_DATA {
            time_usec: self.now_us,
            frame_id: m::MavFrame::MAV_FRAME_LOCAL_NED,
            child_frame_id: m::MavFrame::MAV_FRAME_LOCAL_NED,
            x: position.x_m as f32,
            y: position.y_m as f32,
            z: position.z_m as f32,
            q: [attitude.w, attitude.x, attitude.y, attitude.z].map(|c| c as f32),
            vx: velocity.x_mps as f32,
            vy: velocity.y_mps as f32,
            vz: velocity.z_mps as f32,
            rollspeed: rates.x_radps as f32,
            pitchspeed: rates.y_radps as f32,
            yawspeed: rates.z_radps as f32,
            pose_covariance: unknown,
            velocity_covariance: unknown,
            reset_counter: resets as u8,
            estimator_type: m::MavEstimatorType::MAV_ESTIMATOR_TYPE_AUTOPILOT,
            ..m::ODOMETRY_DATA::default()
        })
    }

    fn mission_current(&self) -> Option<MavMessage> {
        use m::MissionState as S;
        let seq = self.navigator.shown_item() as u16;
        if self.mission.is_empty() && !self.config.firmware.describes_missions() {
            return None;
        }
        let mut current = m::MISSION_CURRENT_DATA {
            seq,
            ..m::MISSION_CURRENT_DATA::default()
        };
        if self.config.firmware.describes_missions() {
            let active = matches!(
                self.commander.mode(),
                NavMode::Mission | NavMode::Takeoff | NavMode::Land
            );
            current.total = if self.mission.is_empty() {
                u16::MAX
            } else {
                self.mission.len() as u16
            };
            current.mission_id = self.mission.identity();
            current.mission_state = if self.mission.is_empty() {
                S::MISSION_STATE_NO_MISSION
            } else if self.navigator.says_finished() {
                S::MISSION_STATE_COMPLETE
            } else if active {
                S::MISSION_STATE_ACTIVE
            } else if self.navigator.has_reached_items() {
                S::MISSION_STATE_PAUSED
            } else {
                S::MISSION_STATE_NOT_STARTED
            };
            current.mission_mode = if active {
                MISSION_MODE_ACTIVE
            } else {
                MISSION_MODE_SUSPENDED
            };
        }
        Some(MavMessage::MISSION_CURRENT(current))
    }

    fn landed_state(&self) -> m::MavLandedState {
        use m::MavLandedState as L;
        if self.land_detector.is_landed() {
            return L::MAV_LANDED_STATE_ON_GROUND;
        }
        match self.commander.mode() {
            NavMode::Takeoff => L::MAV_LANDED_STATE_TAKEOFF,
            NavMode::Land => L::MAV_LANDED_STATE_LANDING,
            _ => L::MAV_LANDED_STATE_IN_AIR,
        }
    }
}
