//! ArduCopter with ArduPilot's own quadrotor. Truth is SIM_STATE on a serial port of its own.

use super::{Process, Running, Source, Start, clearance, truth_wire};
use crate::wire::{Reader, frames, note};
use jink_emulated_ground_station::Make;
use jink_mavlink_link::frame::Splitter;
use jink_shared_types::geo::GlobalPoint;
use mavlink::MessageData;
use mavlink::dialect::{
    COMMAND_LONG_DATA, GLOBAL_POSITION_INT_DATA, LOCAL_POSITION_NED_DATA, MISSION_CURRENT_DATA, MavCmd,
    MavMessage, MavParamType, PARAM_SET_DATA, SIM_STATE_DATA,
};
use nalgebra::Vector3;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Faster than time until the estimator is content: that takes half a minute.
const WARM_UP: f64 = 10.0;
/// Where it stands: as PX4's simulators have it.
const HOME: &str = "47.397742,8.545594,488,0";
/// What is asked for: message and interval (us).
const WANTED: [(u32, f32); 4] = [
    (SIM_STATE_DATA::ID, 20_000.0),
    (LOCAL_POSITION_NED_DATA::ID, 100_000.0),
    (GLOBAL_POSITION_INT_DATA::ID, 200_000.0),
    (MISSION_CURRENT_DATA::ID, 200_000.0),
];

/// Program and source folder.
pub(super) fn find(folder: &Path) -> Option<(PathBuf, PathBuf)> {
    let program = folder.join("build/sitl/bin/arducopter");
    let defaults = folder.join(DEFAULTS);
    (program.is_file() && defaults.is_file()).then(|| (program, folder.to_owned()))
}

/// Parameters of the simulated frame.
const DEFAULTS: &str = "Tools/autotest/default_params/copter.parm";

pub(super) fn start(start: &Start<'_>) -> Result<Running, String> {
    let ports = start.ports;
    let (autopilot, truth_port) = (start.build.autopilot, ports.truth(start.build.autopilot));
    let wire = truth_wire(truth_port)?;
    let mut text = String::from("SERIAL0_PROTOCOL 2\nSERIAL1_PROTOCOL 2\nSERIAL2_PROTOCOL 2\n");
    for (name, value) in start.parameters() {
        // Writing into a string cannot fail.
        let _infallible = writeln!(text, "{name} {value}");
    }
    let [north_mps, east_mps] = start.wind_mps;
    let speed_mps = north_mps.hypot(east_mps);
    if speed_mps > 0.0 {
        // ArduPilot says where wind comes from.
        let from_deg = (-east_mps).atan2(-north_mps).to_degrees().rem_euclid(360.0);
        let _infallible = writeln!(
            text,
            "SIM_WIND_SPD {speed_mps}\nSIM_WIND_DIR {from_deg}\nSIM_WIND_TURB 0.5"
        );
    }
    let own = start.folder.join("suite.parm");
    std::fs::write(&own, text).map_err(|error| error.to_string())?;
    let defaults = start.build.folder.join(DEFAULTS);
    let udp = move |port: u16| format!("udpclient:127.0.0.1:{port}");
    let base = move |speedup: f64, wipe: bool| {
        let mut arguments = vec![
            "--model".to_owned(),
            "+".to_owned(),
            "--speedup".to_owned(),
            speedup.to_string(),
            "-I".to_owned(),
            ports.instance.to_string(),
            "-O".to_owned(),
            HOME.to_owned(),
            "--defaults".to_owned(),
            format!("{},{}", defaults.display(), own.display()),
            "--serial0".to_owned(),
            udp(ports.station()),
            "--serial1".to_owned(),
            udp(ports.companion(autopilot)),
            "--serial2".to_owned(),
            udp(truth_port),
        ];
        if wipe {
            arguments.push("-w".to_owned());
        }
        arguments
    };
    let (program, folder) = (start.build.program.clone(), start.folder.clone());
    let run = move |speedup: f64, wipe: bool| {
        let log = folder.join("autopilot.log");
        Process::start(&program, &base(speedup, wipe), &[], &folder, &log)
    };
    let process = run(WARM_UP, true).map_err(|error| format!("ArduCopter cannot be started: {error}"))?;
    let truth = read_truth(start, wire);
    let source = Source::Program {
        process,
        again: Box::new(move || run(1.0, false)),
    };
    Ok(Running {
        source,
        _truth: truth,
    })
}

/// Asks for the truth, writes it down, and slows the simulator to real time once the vehicle knows where it is.
fn read_truth(start: &Start<'_>, wire: Arc<crate::wire::Wire>) -> Reader {
    let (record, clearance) = (start.record.clone(), clearance(&start.world));
    let mut splitter = Splitter::new();
    let mut asked = Instant::now() - Duration::from_secs(1);
    let mut is_slow = false;
    let ours = Arc::clone(&wire);
    Reader::start(wire, move |datagram| {
        // An autopilot that has started again has forgotten what was asked for.
        if asked.elapsed() > Duration::from_secs(1) {
            asked = Instant::now();
            for (id, interval_us) in WANTED {
                ours.say(254, 190, interval(id, interval_us));
            }
            if record.lock().local.is_some() || is_slow {
                is_slow = true;
                ours.say(254, 190, real_time());
            }
        }
        frames(
            &mut splitter,
            datagram,
            |_| true,
            |seen| {
                let mut record = record.lock();
                match &seen.message {
                    Some(MavMessage::SIM_STATE(truth)) => {
                        let velocity = Vector3::new(truth.vn, truth.ve, truth.vd).map(f64::from);
                        let global = GlobalPoint::from_e7(truth.lat_int, truth.lon_int);
                        record.see_truth(global, f64::from(truth.alt), velocity, &clearance);
                    }
                    _ => note(&mut record, Make::ArduCopter, &seen),
                }
            },
        );
    })
}

fn interval(id: u32, interval_us: f32) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        target_system: 1,
        target_component: 1,
        command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        param1: id as f32,
        param2: interval_us,
        ..COMMAND_LONG_DATA::default()
    })
}

fn real_time() -> MavMessage {
    MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_value: 1.0,
        target_system: 1,
        target_component: 1,
        param_id: "SIM_SPEEDUP".into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    })
}
