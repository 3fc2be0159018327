//! Messages that every emulated autopilot says alike, made from what it knows.
//!
//! `now_us` is the time since boot (us).

use crate::mission::MissionFrame;
use jink_simulated_world::vehicle::estimator::Estimate;
use mavlink::MavHeader;
use mavlink::dialect as m;
use mavlink::dialect::MavMessage;
use nalgebra::Vector3;

/// Time since boot as most messages carry it (ms).
pub fn boot_ms(now_us: u64) -> u32 {
    (now_us / 1_000) as u32
}

/// COMMAND_ACK to the sender of `command`, whose header is `header`.
pub fn acknowledgement(header: &MavHeader, command: m::MavCmd, result: m::MavResult) -> MavMessage {
    MavMessage::COMMAND_ACK(m::COMMAND_ACK_DATA {
        command,
        result,
        target_system: header.system_id as u8,
        target_component: header.component_id,
        ..m::COMMAND_ACK_DATA::default()
    })
}

/// MESSAGE_INTERVAL of message `id`. `interval_us`: 0 = off, `None` = there is no such message.
pub fn message_interval(id: u32, interval_us: Option<u64>) -> MavMessage {
    MavMessage::MESSAGE_INTERVAL(m::MESSAGE_INTERVAL_DATA {
        interval_us: match interval_us {
            Some(0) => -1,
            Some(interval_us) => interval_us as i32,
            None => 0,
        },
        message_id: id as u16,
    })
}

/// TIMESYNC that asks for the other's time.
pub fn timesync_request(now_us: u64) -> MavMessage {
    MavMessage::TIMESYNC(m::TIMESYNC_DATA {
        tc1: 0,
        ts1: now_us as i64 * 1_000,
        ..m::TIMESYNC_DATA::default()
    })
}

/// TIMESYNC that answers a request with the time stamp `asked_ns`.
pub fn timesync_answer(now_us: u64, asked_ns: i64) -> MavMessage {
    MavMessage::TIMESYNC(m::TIMESYNC_DATA {
        tc1: now_us as i64 * 1_000,
        ts1: asked_ns,
        ..m::TIMESYNC_DATA::default()
    })
}

/// SYSTEM_TIME. `unix_start_us`: wall clock at boot (us since 1970).
pub fn system_time(now_us: u64, unix_start_us: u64) -> MavMessage {
    MavMessage::SYSTEM_TIME(m::SYSTEM_TIME_DATA {
        time_unix_usec: unix_start_us + now_us,
        time_boot_ms: boot_ms(now_us),
    })
}

/// What SYS_STATUS always says is there.
pub fn always_there() -> m::MavSysStatusSensor {
    use m::MavSysStatusSensor as S;
    S::MAV_SYS_STATUS_SENSOR_3D_GYRO
        | S::MAV_SYS_STATUS_SENSOR_3D_ACCEL
        | S::MAV_SYS_STATUS_SENSOR_3D_MAG
        | S::MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
        | S::MAV_SYS_STATUS_SENSOR_GPS
        | S::MAV_SYS_STATUS_AHRS
        | S::MAV_SYS_STATUS_PREARM_CHECK
}

/// ATTITUDE.
pub fn attitude(now_us: u64, estimate: &Estimate) -> MavMessage {
    let unknown = (f64::NAN, f64::NAN, f64::NAN);
    let local_q_body = estimate.attitude.rotation();
    let (roll, pitch, yaw) = local_q_body.map_or(unknown, |rotation| rotation.euler_angles());
    let rates = estimate.rates;
    MavMessage::ATTITUDE(m::ATTITUDE_DATA {
        time_boot_ms: boot_ms(now_us),
        roll: roll as f32,
        pitch: pitch as f32,
        yaw: yaw as f32,
        rollspeed: rates.x_radps as f32,
        pitchspeed: rates.y_radps as f32,
        yawspeed: rates.z_radps as f32,
    })
}

/// ATTITUDE_QUATERNION.
pub fn attitude_quaternion(now_us: u64, estimate: &Estimate) -> MavMessage {
    let (q, rates) = (estimate.attitude, estimate.rates);
    MavMessage::ATTITUDE_QUATERNION(m::ATTITUDE_QUATERNION_DATA {
        time_boot_ms: boot_ms(now_us),
        q1: q.w as f32,
        q2: q.x as f32,
        q3: q.y as f32,
        q4: q.z as f32,
        rollspeed: rates.x_radps as f32,
        pitchspeed: rates.y_radps as f32,
        yawspeed: rates.z_radps as f32,
        repr_offset_q: [0.0; 4],
    })
}

/// LOCAL_POSITION_NED.
pub fn local_position(now_us: u64, estimate: &Estimate) -> MavMessage {
    let (p, v) = (estimate.position, estimate.velocity);
    MavMessage::LOCAL_POSITION_NED(m::LOCAL_POSITION_NED_DATA {
        time_boot_ms: boot_ms(now_us),
        x: p.x_m as f32,
        y: p.y_m as f32,
        z: p.z_m as f32,
        vx: v.x_mps as f32,
        vy: v.y_mps as f32,
        vz: v.z_mps as f32,
    })
}

/// Heading, clockwise from north (deg), 0 to 360.
pub fn heading_deg(estimate: &Estimate) -> f64 {
    estimate.attitude.yaw_rad().to_degrees().rem_euclid(360.0)
}

/// GLOBAL_POSITION_INT. `home`: local NED (m).
pub fn global_position(
    now_us: u64,
    estimate: &Estimate,
    frame: &MissionFrame,
    home: &Vector3<f64>,
) -> m::GLOBAL_POSITION_INT_DATA {
    let (p, v) = (estimate.position, estimate.velocity);
    let (lat, lon) = frame.projection.to_global(p.vector().xy()).to_e7();
    let millimetres = |metres: f64| (metres * 1e3).round() as i32;
    let centimetres = |mps: f64| (mps * 1e2).round() as i16;
    m::GLOBAL_POSITION_INT_DATA {
        time_boot_ms: boot_ms(now_us),
        lat,
        lon,
        alt: millimetres(frame.origin_altitude_m - p.z_m),
        relative_alt: millimetres(home.z - p.z_m),
        vx: centimetres(v.x_mps),
        vy: centimetres(v.y_mps),
        vz: centimetres(v.z_mps),
        hdg: (heading_deg(estimate) * 100.0) as u16 % 36_000,
    }
}

/// HOME_POSITION. `home`: local NED (m).
pub fn home_position(now_us: u64, frame: &MissionFrame, home: &Vector3<f64>) -> MavMessage {
    let (latitude, longitude) = frame.projection.to_global(home.xy()).to_e7();
    MavMessage::HOME_POSITION(m::HOME_POSITION_DATA {
        latitude,
        longitude,
        altitude: ((frame.origin_altitude_m - home.z) * 1e3).round() as i32,
        x: home.x as f32,
        y: home.y as f32,
        z: home.z as f32,
        q: [1.0, 0.0, 0.0, 0.0],
        time_usec: now_us,
        ..m::HOME_POSITION_DATA::default()
    })
}

/// POSITION_TARGET_LOCAL_NED of a motion (local NED; m, m/s, m/s^2) that says nothing of the heading.
pub fn position_target(
    now_us: u64,
    [position, velocity, acceleration]: [Vector3<f64>; 3],
) -> m::POSITION_TARGET_LOCAL_NED_DATA {
    let [x, y, z] = position.map(|c| c as f32).into();
    let [vx, vy, vz] = velocity.map(|c| c as f32).into();
    let [afx, afy, afz] = acceleration.map(|c| c as f32).into();
    m::POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms: boot_ms(now_us),
        x,
        y,
        z,
        vx,
        vy,
        vz,
        afx,
        afy,
        afz,
        yaw: 0.0,
        yaw_rate: 0.0,
        type_mask: m::PositionTargetTypemask::empty(),
        coordinate_frame: m::MavFrame::MAV_FRAME_LOCAL_NED,
    }
}

/// POSITION_TARGET_GLOBAL_INT of a place and a velocity (local NED; m, m/s) that says nothing of acceleration and heading.
pub fn position_target_global(
    now_us: u64,
    frame: &MissionFrame,
    [position, velocity]: [Vector3<f64>; 2],
) -> m::POSITION_TARGET_GLOBAL_INT_DATA {
    let (lat_int, lon_int) = frame.projection.to_global(position.xy()).to_e7();
    let [vx, vy, vz] = velocity.map(|c| c as f32).into();
    m::POSITION_TARGET_GLOBAL_INT_DATA {
        time_boot_ms: boot_ms(now_us),
        lat_int,
        lon_int,
        alt: (frame.origin_altitude_m - position.z) as f32,
        vx,
        vy,
        vz,
        type_mask: m::PositionTargetTypemask::empty(),
        coordinate_frame: m::MavFrame::MAV_FRAME_GLOBAL,
        ..m::POSITION_TARGET_GLOBAL_INT_DATA::default()
    }
}
