//! PX4 with its own quadrotor (SIH). Truth is HIL_STATE_QUATERNION.

use super::{Process, Running, Source, Start, clearance, truth_wire};
use crate::wire::{Reader, frames};
use jink_mavlink_link::frame::Splitter;
use jink_shared_types::geo::GlobalPoint;
use mavlink::MessageData;
use mavlink::dialect::{HIL_STATE_QUATERNION_DATA, MavMessage};
use nalgebra::Vector3;
use std::path::{Path, PathBuf};

/// Program and folder of a build, in the build's own folder or in one of the source's.
pub(super) fn find(folder: &Path) -> Option<(PathBuf, PathBuf)> {
    let inside = std::fs::read_dir(folder.join("build"))
        .into_iter()
        .flatten()
        .flatten();
    let mut candidates: Vec<PathBuf> = inside.map(|entry| entry.path()).collect();
    candidates.sort();
    candidates.insert(0, folder.to_owned());
    candidates.into_iter().find_map(|folder| {
        let program = folder.join("bin/px4");
        let is_build = program.is_file() && folder.join("etc/init.d-posix/rcS").is_file();
        is_build.then_some((program, folder))
    })
}

pub(super) fn start(start: &Start<'_>) -> Result<Running, String> {
    let ports = start.ports;
    let wire = truth_wire(ports.truth(start.build.autopilot))?;
    let build = start.build.folder.clone();
    let [north_mps, east_mps] = start.wind_mps;
    let wind = [("SIH_WIND_N", north_mps), ("SIH_WIND_E", east_mps)]
        .into_iter()
        .filter(|(_, speed_mps)| *speed_mps != 0.0);
    let mut environment: Vec<(String, String)> = start
        .parameters()
        .chain(wind)
        .map(|(name, value)| (format!("PX4_PARAM_{name}"), value.to_string()))
        .collect();
    let search = format!(
        "{}:{}",
        build.join("bin").display(),
        std::env::var("PATH").unwrap_or_default()
    );
    environment.extend([
        ("PX4_SIM_MODEL".to_owned(), "sihsim_quadx".to_owned()),
        ("PATH".to_owned(), search),
    ]);
    let (program, folder) = (start.build.program.clone(), start.folder.clone());
    let arguments = vec![
        "-i".to_owned(),
        ports.instance.to_string(),
        "-d".to_owned(),
        build.join("etc").display().to_string(),
        "-s".to_owned(),
        "etc/init.d-posix/rcS".to_owned(),
        "-w".to_owned(),
        folder.display().to_string(),
    ];
    let run = move || {
        Process::start(
            &program,
            &arguments,
            &environment,
            &folder,
            &folder.join("autopilot.log"),
        )
    };
    let process = run().map_err(|error| format!("PX4 cannot be started: {error}"))?;
    let (record, clearance) = (start.record.clone(), clearance(&start.world));
    let mut splitter = Splitter::new();
    let truth = Reader::start(wire, move |datagram| {
        frames(
            &mut splitter,
            datagram,
            |id| id == HIL_STATE_QUATERNION_DATA::ID,
            |seen| {
                if let Some(MavMessage::HIL_STATE_QUATERNION(truth)) = &seen.message {
                    let velocity =
                        Vector3::new(truth.vx, truth.vy, truth.vz).map(|cmps| f64::from(cmps) / 100.0);
                    let global = GlobalPoint::from_e7(truth.lat, truth.lon);
                    record
                        .lock()
                        .see_truth(global, f64::from(truth.alt) / 1000.0, velocity, &clearance);
                }
            },
        );
    });
    let source = Source::Program {
        process,
        again: Box::new(run),
    };
    Ok(Running {
        source,
        _truth: truth,
    })
}
