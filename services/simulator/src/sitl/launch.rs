//! How an autopilot is started: program, arguments, environment and the files it reads at its start. Nothing here touches
//! the system.

use super::build::{Interface, SitlBuild};
use super::ports::SitlPorts;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Latitude of the local origin (deg): PX4's own in simulation.
pub const HOME_LATITUDE_DEG: f64 = 47.397_742;
/// Longitude of the local origin (deg).
pub const HOME_LONGITUDE_DEG: f64 = 8.545_594;
/// Height of the ground above the sea (m).
pub const HOME_HEIGHT_M: f64 = 488.0;
/// Truth of PX4's built-in vehicle (Hz): its stream's own rate is 25.
const SIH_TRUTH_HZ: u32 = 250;
/// Drag of PX4's built-in vehicle (N/(m/s)): a light, real one. Its default of 1 on 1 kg spoils tracking and braking.
const SIH_DRAG: (&str, f64) = ("SIH_KDV", 0.1);
/// The end of that stream that is PX4's, instance 0.
const SIH_PORT: u16 = 19450;
/// Where ground stations such as QGroundControl listen.
pub const STATION_PORT: u16 = 14550;

/// One start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Launch {
    /// Program.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<OsString>,
    /// What is set in its environment.
    pub environment: Vec<(OsString, OsString)>,
    /// Files in its working folder.
    pub files: Vec<(String, String)>,
    /// What an earlier flight left there and must go: stored parameters and missions.
    pub stale: Vec<String>,
}

/// The start of `build` for `interface` on `ports` in the absolute `folder`; `with_station`: the port for our own ground
/// station is served, too.
pub fn launch(
    build: &SitlBuild,
    interface: Interface,
    ports: &SitlPorts,
    folder: &Path,
    with_station: bool,
    parameters: &[(String, f64)],
) -> Launch {
    match interface {
        Interface::Px4Hil | Interface::Px4Sih => {
            px4(build, interface, ports, folder, with_station, parameters)
        }
        Interface::ArduPilotJson => copter(build, ports, folder, with_station, parameters),
    }
}

fn px4(
    build: &SitlBuild,
    interface: Interface,
    ports: &SitlPorts,
    folder: &Path,
    with_station: bool,
    parameters: &[(String, f64)],
) -> Launch {
    // PX4 looks for its scripts along PATH: those of this folder come first.
    let mut path = OsString::from(folder.join("bin"));
    if let Some(programs) = build.program.parent() {
        path.push(":");
        path.push(programs);
    }
    path.push(":");
    path.push(std::env::var_os("PATH").unwrap_or_else(|| "/usr/bin:/bin".into()));
    let mut environment: Vec<(OsString, OsString)> = vec![
        (
            "PX4_SIM_MODEL".into(),
            build.model(interface).unwrap_or_default().into(),
        ),
        ("PX4_SIM_HOST_ADDR".into(), "127.0.0.1".into()),
        ("PX4_HOME_LAT".into(), HOME_LATITUDE_DEG.to_string().into()),
        ("PX4_HOME_LON".into(), HOME_LONGITUDE_DEG.to_string().into()),
        ("PX4_HOME_ALT".into(), HOME_HEIGHT_M.to_string().into()),
        ("PATH".into(), path),
    ];
    let mut settings = "#!/bin/sh\n".to_owned();
    let light = (SIH_DRAG.0.to_owned(), SIH_DRAG.1);
    let drag = (interface == Interface::Px4Sih).then_some(&light);
    for (name, value) in drag.into_iter().chain(parameters) {
        // Firmware from 1.14 on takes them from the environment, earlier firmware from the script.
        environment.push((format!("PX4_PARAM_{name}").into(), value.to_string().into()));
        settings += &format!("param set {name} {value}\n");
    }
    let mut links = format!(
        "#!/bin/sh\n. \"{}\"\n",
        build.startup.join("init.d-posix/px4-rc.mavlink").display()
    );
    if with_station {
        links += &format!(
            "mavlink start -x -u {} -r 4000000 -f -o {}\n",
            ports.own, ports.ground_station
        );
    }
    if interface == Interface::Px4Sih {
        links += &format!(
            "mavlink stream -r {SIH_TRUTH_HZ} -s HIL_STATE_QUATERNION -u {}\n",
            SIH_PORT + u16::from(ports.instance)
        );
    }
    Launch {
        program: build.program.clone(),
        arguments: vec![
            "-i".into(),
            ports.instance.to_string().into(),
            "-d".into(),
            build.startup.clone().into(),
            "-s".into(),
            "etc/init.d-posix/rcS".into(),
            "-w".into(),
            folder.into(),
        ],
        environment,
        files: vec![
            ("bin/px4-rc.params".to_owned(), settings),
            ("bin/px4-rc.mavlink".to_owned(), links),
        ],
        stale: [
            "eeprom",
            "etc",
            "dataman",
            "parameters.bson",
            "parameters_backup.bson",
        ]
        .map(str::to_owned)
        .to_vec(),
    }
}

/// Parameters that make ArduCopter the quadrotor of this simulator, with MAVLink on all three links.
const COPTER_BASE: &str =
    "FRAME_CLASS 1\nFRAME_TYPE 1\nSERIAL0_PROTOCOL 2\nSERIAL1_PROTOCOL 2\nSERIAL2_PROTOCOL 2\n";

fn copter(
    build: &SitlBuild,
    ports: &SitlPorts,
    folder: &Path,
    with_station: bool,
    parameters: &[(String, f64)],
) -> Launch {
    let to = |port: u16| OsString::from(format!("udpclient:127.0.0.1:{port}"));
    let (base, extra) = (folder.join("base.parm"), folder.join("extra.parm"));
    let mut defaults = OsString::from(&build.startup);
    for file in [&base, &extra] {
        defaults.push(",");
        defaults.push(file);
    }
    let station = if with_station {
        ports.ground_station
    } else {
        STATION_PORT
    };
    let observer = if with_station { STATION_PORT } else { ports.own };
    let home = format!("{HOME_LATITUDE_DEG},{HOME_LONGITUDE_DEG},{HOME_HEIGHT_M},0");
    let settings: String = parameters
        .iter()
        .map(|(name, value)| format!("{name} {value}\n"))
        .collect();
    Launch {
        program: build.program.clone(),
        arguments: vec![
            "-w".into(),
            "--model".into(),
            "JSON:127.0.0.1".into(),
            "--sim-port-out".into(),
            ports.simulator.to_string().into(),
            "--speedup".into(),
            "1".into(),
            "-I".into(),
            ports.instance.to_string().into(),
            "-O".into(),
            home.into(),
            "--defaults".into(),
            defaults,
            "--serial0".into(),
            to(station),
            "--serial1".into(),
            to(ports.companion),
            "--serial2".into(),
            to(observer),
        ],
        environment: Vec::new(),
        files: vec![
            ("base.parm".to_owned(), COPTER_BASE.to_owned()),
            ("extra.parm".to_owned(), settings),
        ],
        stale: vec!["eeprom.bin".to_owned()],
    }
}

#[cfg(test)]
mod tests {
    use super::{Launch, launch};
    use crate::sitl::{Interface, SitlBuild, SitlPorts};
    use jink_emulated_ground_station::Make;
    use std::path::Path;

    fn start(make: Make, interface: Interface, parameters: &[(String, f64)]) -> Launch {
        let build = SitlBuild {
            make,
            program: "/b/bin/px4".into(),
            startup: "/b/etc".into(),
            version: String::new(),
            interfaces: vec![interface],
            models: vec!["none_iris".to_owned()],
            profile: "px4_offboard",
            gps_delay_ms: 10,
        };
        let ports = SitlPorts {
            instance: 2,
            simulator: 4_562,
            companion: 14_542,
            ground_station: 41_000,
            own: 41_001,
        };
        launch(&build, interface, &ports, Path::new("/w"), true, parameters)
    }

    #[test]
    fn px4_keeps_its_own_links_and_gets_one_for_our_ground_station() {
        let parameters = [("COM_OBL_RC_ACT".to_owned(), 5.0), ("SIH_KDV".to_owned(), 0.5)];
        let launch = start(Make::Px4, Interface::Px4Sih, &parameters);
        let (_, links) = &launch.files[1];
        assert!(links.contains(". \"/b/etc/init.d-posix/px4-rc.mavlink\""));
        assert!(links.contains("mavlink start -x -u 41001 -r 4000000 -f -o 41000\n"));
        assert!(links.contains("-s HIL_STATE_QUATERNION -u 19452\n"));
        let (_, settings) = &launch.files[0];
        let drags: Vec<_> = settings.lines().filter(|line| line.contains("SIH_KDV")).collect();
        assert_eq!(drags, ["param set SIH_KDV 0.1", "param set SIH_KDV 0.5"]);
        let set = |name: &str| {
            let mut values = launch.environment.iter().rev();
            values
                .find(|(known, _)| known == name)
                .map(|(_, value)| value.to_str().unwrap())
        };
        assert_eq!(set("PX4_PARAM_COM_OBL_RC_ACT"), Some("5"));
        assert_eq!(set("PX4_PARAM_SIH_KDV"), Some("0.5"));
        assert_eq!(set("PX4_SIM_MODEL"), Some("none_iris"));
        assert!(set("PATH").unwrap().starts_with("/w/bin:/b/bin:"));
    }

    #[test]
    fn arducopter_speaks_to_the_ports_it_is_given_and_to_14550() {
        let launch = start(
            Make::ArduCopter,
            Interface::ArduPilotJson,
            &[("GUID_TIMEOUT".to_owned(), 0.5)],
        );
        let line: Vec<_> = launch.arguments.iter().map(|one| one.to_str().unwrap()).collect();
        let line = line.join(" ");
        for part in [
            "--model JSON:127.0.0.1",
            "--sim-port-out 4562",
            "-I 2",
            "--serial0 udpclient:127.0.0.1:41000",
            "--serial1 udpclient:127.0.0.1:14542",
            "--serial2 udpclient:127.0.0.1:14550",
            "--defaults /b/etc,/w/base.parm,/w/extra.parm",
        ] {
            assert!(line.contains(part), "{part}: {line}");
        }
        assert_eq!(launch.files[1].1, "GUID_TIMEOUT 0.5\n");
    }
}
