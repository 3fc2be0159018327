//! Finds a build of PX4 or ArduCopter for simulation, and what it offers.
//!
//! | in | out |
//! |---|---|
//! | a folder: the source with a build inside, or the build | [`SitlBuild`]: program, start-up files, version, interfaces, profile |

use jink_emulated_ground_station::Make;
use std::fmt;
use std::path::{Path, PathBuf};

/// How the simulation reaches the autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interface {
    /// PX4's simulator interface: HIL messages over TCP in lock-step; vehicle and wind are ours.
    Px4Hil,
    /// PX4's built-in quadrotor (SIH): PX4 computes the vehicle, this program takes its truth.
    Px4Sih,
    /// ArduPilot's JSON interface: servo packets and JSON lines over UDP in lock-step; vehicle and wind are ours.
    ArduPilotJson,
}

impl Interface {
    /// Names as in options.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("hil", Self::Px4Hil),
        ("sih", Self::Px4Sih),
        ("json", Self::ArduPilotJson),
    ];

    /// By its name in an option.
    pub fn named(name: &str) -> Option<Self> {
        Self::NAMES
            .into_iter()
            .find_map(|(known, interface)| (known == name).then_some(interface))
    }

    /// Its name in an option.
    pub fn name(self) -> &'static str {
        match self {
            Self::Px4Hil => "hil",
            Self::Px4Sih => "sih",
            Self::ArduPilotJson => "json",
        }
    }

    /// Whether vehicle and wind are this simulator's own.
    pub fn has_our_vehicle(self) -> bool {
        self != Self::Px4Sih
    }
}

/// A build that can be started.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SitlBuild {
    /// Whose firmware it is.
    pub make: Make,
    /// The program.
    pub program: PathBuf,
    /// PX4: the folder `etc` with its start-up scripts. ArduPilot: the file of default parameters.
    pub startup: PathBuf,
    /// Version as the build names it; empty if it does not.
    pub version: String,
    /// What it can be simulated by, the best one first.
    pub interfaces: Vec<Interface>,
    /// PX4 model (`PX4_SIM_MODEL`) for each of the interfaces; empty for ArduPilot.
    pub models: Vec<String>,
    /// The profile of jink that fits it.
    pub profile: &'static str,
    /// How late its estimator expects the GPS to be (ms).
    pub gps_delay_ms: u16,
}

/// Why there is no build.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FindError {
    /// The folder does not exist.
    NoFolder {
        /// Folder.
        folder: PathBuf,
    },
    /// None of the programs is there.
    NoProgram {
        /// Folder.
        folder: PathBuf,
        /// Where it was looked for.
        looked: Vec<PathBuf>,
    },
    /// Several builds, and none with the usual name.
    Ambiguous {
        /// Programs found.
        found: Vec<PathBuf>,
    },
    /// A program without what it needs at its start.
    NoStartup {
        /// Program.
        program: PathBuf,
        /// What is missing.
        what: &'static str,
        /// Where it was looked for.
        looked: Vec<PathBuf>,
    },
    /// PX4 without a quadrotor that can be simulated.
    NoModel {
        /// Where airframes were looked for.
        airframes: PathBuf,
        /// Where modules were looked for.
        modules: PathBuf,
    },
    /// A file could not be read.
    Io {
        /// File.
        path: PathBuf,
        /// Why not.
        cause: String,
    },
}

impl fmt::Display for FindError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoFolder { folder } => write!(f, "{}: there is no such folder", folder.display()),
            Self::NoProgram { folder, looked } => write!(
                f,
                "{} holds no build of PX4 or ArduCopter for simulation: there is no {}; build it with `make px4_sitl_default`, \
                 or with `./waf configure --board sitl && ./waf copter`",
                folder.display(),
                list(looked)
            ),
            Self::Ambiguous { found } => write!(
                f,
                "several builds: {}; give the folder of one, the one above `bin`",
                list(found)
            ),
            Self::NoStartup {
                program,
                what,
                looked,
            } => write!(
                f,
                "{} is there, its {what} is not: there is no {}",
                program.display(),
                list(looked)
            ),
            Self::NoModel { airframes, modules } => write!(
                f,
                "no quadrotor to simulate: neither an airframe NUMBER_none_iris or NUMBER_iris with a module px4-simulator_mavlink or \
                 px4-simulator, nor NUMBER_sihsim_quadx with px4-simulator_sih or px4-sih; airframes in {}, modules in {}",
                airframes.display(),
                modules.display()
            ),
            Self::Io { path, cause } => write!(f, "{}: {cause}", path.display()),
        }
    }
}
impl std::error::Error for FindError {}

fn list(paths: &[PathBuf]) -> String {
    let names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
    names.join(", ")
}

/// Where PX4's program lies in a build folder.
const PX4_PROGRAM: &str = "bin/px4";
/// The build that `make px4_sitl` makes.
const PX4_BUILD: &str = "px4_sitl_default";
/// Where ArduCopter's program lies: in the source folder, in the build folder, in its `bin`.
const COPTER_PROGRAMS: [&str; 3] = ["build/sitl/bin/arducopter", "bin/arducopter", "arducopter"];
/// Where the default parameters lie below ArduPilot's source folder.
const COPTER_PARAMETERS: &str = "Tools/autotest/default_params/copter.parm";
/// PX4's models that this simulator can be the vehicle of, newest name first, and the modules that implement its
/// interface.
const HIL_MODELS: [&str; 2] = ["none_iris", "iris"];
const HIL_MODULES: [&str; 2] = ["px4-simulator_mavlink", "px4-simulator"];
/// PX4's built-in quadrotor, and the modules that simulate it.
const SIH_MODELS: [&str; 1] = ["sihsim_quadx"];
const SIH_MODULES: [&str; 2] = ["px4-simulator_sih", "px4-sih"];
/// The parameter that identifies a firmware with the trajectory interface: 1.16 has dropped both.
const TRAJECTORY_PARAMETER: &[u8] = b"COM_OBS_AVOID";
/// The parameter of PX4 that the delay of the GPS has moved to; its start-up scripts set it to 10 ms for this interface.
const GPS_DELAY_PARAMETER: &[u8] = b"SENS_GPS0_DELAY";
/// That delay, and the default of EKF2_GPS_DELAY before it (ms).
const GPS_DELAYS_MS: [u16; 2] = [10, 110];
/// What ArduCopter calls itself, version behind it.
const COPTER_VERSION: &[u8] = b"ArduCopter V";
/// Longest version text (bytes).
const VERSION_BYTES: usize = 40;

impl SitlBuild {
    /// The build in `folder`.
    ///
    /// # Errors
    /// What was looked for and where.
    pub fn find(folder: &Path) -> Result<Self, FindError> {
        if !folder.is_dir() {
            return Err(FindError::NoFolder {
                folder: folder.to_owned(),
            });
        }
        let folder = absolute(folder)?;
        if let Some(program) = px4_program(&folder)? {
            return px4(program);
        }
        let copters: Vec<PathBuf> = COPTER_PROGRAMS.iter().map(|name| folder.join(name)).collect();
        if let Some(program) = copters.iter().find(|path| path.is_file()) {
            return copter(program.clone());
        }
        let mut looked = vec![
            folder.join(PX4_PROGRAM),
            folder.join("build").join(PX4_BUILD).join(PX4_PROGRAM),
        ];
        looked.extend(copters);
        Err(FindError::NoProgram { folder, looked })
    }

    /// The profiles of jink that can fly it, the one that fits best first.
    pub fn profiles(&self) -> &'static [&'static str] {
        match (self.make, self.profile) {
            (Make::ArduCopter, _) => &["ardupilot_guided"],
            (Make::Px4, "px4_trajectory") => &["px4_trajectory", "px4_offboard"],
            (Make::Px4, _) => &["px4_offboard"],
        }
    }

    /// The parameters that jink's pages on connecting ask for with `profile`, as far as they differ from the defaults.
    pub fn parameters_for(&self, profile: &str) -> Vec<(String, f64)> {
        let wanted: &[(&str, f64)] = match profile {
            "px4_trajectory" => &[("COM_OBS_AVOID", 1.0)],
            "px4_offboard" => &[("COM_OBL_RC_ACT", 5.0)],
            "px4_deviation" => &[("EAV_EN", 1.0)],
            "ardupilot_guided" => &[("GUID_TIMEOUT", 0.5), ("PRX1_TYPE", 2.0), ("PRX_FILT", 0.0)],
            _ => &[],
        };
        wanted
            .iter()
            .map(|(name, value)| ((*name).to_owned(), *value))
            .collect()
    }

    /// How late its estimator expects the GPS to be (s).
    pub fn gps_delay_s(&self) -> f64 {
        f64::from(self.gps_delay_ms) * 1e-3
    }

    /// The model that PX4 is started with for `interface`.
    pub fn model(&self, interface: Interface) -> Option<&str> {
        let at = self.interfaces.iter().position(|known| *known == interface)?;
        self.models.get(at).map(String::as_str)
    }
}

fn absolute(folder: &Path) -> Result<PathBuf, FindError> {
    folder.canonicalize().map_err(|cause| FindError::Io {
        path: folder.to_owned(),
        cause: cause.to_string(),
    })
}

/// PX4's program in a build folder or in one of the builds of a source folder.
fn px4_program(folder: &Path) -> Result<Option<PathBuf>, FindError> {
    let builds = folder.join("build");
    for program in [folder.join(PX4_PROGRAM), builds.join(PX4_BUILD).join(PX4_PROGRAM)] {
        if program.is_file() {
            return Ok(Some(program));
        }
    }
    let Ok(entries) = std::fs::read_dir(&builds) else {
        return Ok(None);
    };
    let mut found: Vec<PathBuf> = entries
        .flatten()
        .map(|entry| entry.path().join(PX4_PROGRAM))
        .filter(|program| program.is_file())
        .collect();
    found.sort();
    match found.len() {
        0 | 1 => Ok(found.pop()),
        _ => Err(FindError::Ambiguous { found }),
    }
}

fn px4(program: PathBuf) -> Result<SitlBuild, FindError> {
    // bin/px4: the build folder lies two levels up.
    let build = program.ancestors().nth(2).unwrap_or(&program).to_owned();
    let etc = build.join("etc");
    let script = etc.join("init.d-posix/rcS");
    if !script.is_file() {
        return Err(FindError::NoStartup {
            program,
            what: "start-up script",
            looked: vec![script],
        });
    }
    let airframes = etc.join("init.d-posix/airframes");
    let names = file_names(&airframes);
    let has_airframe = |model: &&&str| names.iter().any(|name| is_airframe_of(name, model));
    let has_module = |module: &&str| program.with_file_name(module).exists();
    let (mut interfaces, mut models) = (Vec::new(), Vec::new());
    for (interface, known, modules) in [
        (Interface::Px4Hil, &HIL_MODELS[..], HIL_MODULES),
        (Interface::Px4Sih, &SIH_MODELS[..], SIH_MODULES),
    ] {
        let model = known.iter().find(has_airframe);
        if let (Some(model), true) = (model, modules.iter().any(has_module)) {
            interfaces.push(interface);
            models.push((*model).to_owned());
        }
    }
    if interfaces.is_empty() {
        let modules = build.join("bin");
        return Err(FindError::NoModel { airframes, modules });
    }
    let bytes = read(&program)?;
    let profile = match position(&bytes, TRAJECTORY_PARAMETER) {
        Some(_) => "px4_trajectory",
        None => "px4_offboard",
    };
    let [new_ms, old_ms] = GPS_DELAYS_MS;
    Ok(SitlBuild {
        gps_delay_ms: match position(&bytes, GPS_DELAY_PARAMETER) {
            Some(_) => new_ms,
            None => old_ms,
        },
        make: Make::Px4,
        version: px4_version(&build),
        program,
        startup: etc,
        interfaces,
        models,
        profile,
    })
}

/// Whether an airframe's file is called `NUMBER_model`, as PX4's start-up script looks for it.
fn is_airframe_of(name: &str, model: &str) -> bool {
    name.split_once('_').is_some_and(|(number, rest)| {
        !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit()) && rest == model
    })
}

fn file_names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect()
}

/// What git called the source when it was built.
fn px4_version(build: &Path) -> String {
    let header = build.join("src/lib/version/build_git_version.h");
    let text = std::fs::read_to_string(header).unwrap_or_default();
    let tag = text
        .lines()
        .find_map(|line| line.strip_prefix("#define PX4_GIT_TAG_STR"));
    tag.map(|tag| tag.trim().trim_matches('"').to_owned())
        .unwrap_or_default()
}

fn copter(program: PathBuf) -> Result<SitlBuild, FindError> {
    let mut looked: Vec<PathBuf> = program
        .ancestors()
        .skip(1)
        .map(|folder| folder.join(COPTER_PARAMETERS))
        .collect();
    looked.insert(0, program.with_file_name("copter.parm"));
    let Some(startup) = looked.iter().find(|path| path.is_file()).cloned() else {
        return Err(FindError::NoStartup {
            program,
            what: "file of default parameters",
            looked,
        });
    };
    let bytes = read(&program)?;
    Ok(SitlBuild {
        make: Make::ArduCopter,
        version: copter_version(&bytes),
        program,
        startup,
        interfaces: vec![Interface::ArduPilotJson],
        models: Vec::new(),
        profile: "ardupilot_guided",
        gps_delay_ms: 0,
    })
}

fn copter_version(bytes: &[u8]) -> String {
    let Some(at) = position(bytes, COPTER_VERSION) else {
        return String::new();
    };
    let text = bytes
        .iter()
        .skip(at + COPTER_VERSION.len() - 1)
        .take(VERSION_BYTES);
    text.take_while(|byte| byte.is_ascii_graphic())
        .map(|byte| char::from(*byte))
        .collect()
}

fn read(path: &Path) -> Result<Vec<u8>, FindError> {
    std::fs::read(path).map_err(|cause| FindError::Io {
        path: path.to_owned(),
        cause: cause.to_string(),
    })
}

/// Where `pattern` begins in `bytes`.
fn position(bytes: &[u8], pattern: &[u8]) -> Option<usize> {
    let first = *pattern.first()?;
    let mut from = 0;
    while let Some(offset) = bytes.get(from..)?.iter().position(|byte| *byte == first) {
        let at = from + offset;
        if bytes.get(at..)?.starts_with(pattern) {
            return Some(at);
        }
        from = at + 1;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::{FindError, Interface, SitlBuild};
    use jink_emulated_ground_station::Make;
    use jink_testkit::temp_folder::TempFolder;
    use std::path::Path;

    fn px4(folder: &TempFolder, build: &str, content: &str, airframes: &[&str]) {
        folder.write(&format!("{build}/bin/px4"), content);
        folder.write(&format!("{build}/etc/init.d-posix/rcS"), "");
        folder.write(&format!("{build}/bin/px4-simulator_mavlink"), "");
        folder.write(&format!("{build}/bin/px4-simulator_sih"), "");
        for airframe in airframes {
            folder.write(&format!("{build}/etc/init.d-posix/airframes/{airframe}"), "");
        }
    }

    #[test]
    fn source_and_build_folder_lead_to_the_same_px4() {
        let folder = TempFolder::new("sitl_px4");
        px4(
            &folder,
            "build/px4_sitl_default",
            "..COM_OBS_AVOID..",
            &["10016_iris", "10018_iris_foggy"],
        );
        let build = SitlBuild::find(&folder).unwrap();
        assert_eq!(
            (build.make, build.profile, build.interfaces.as_slice()),
            (Make::Px4, "px4_trajectory", &[Interface::Px4Hil][..])
        );
        assert_eq!(build.model(Interface::Px4Hil), Some("iris"));
        assert_eq!(
            SitlBuild::find(&folder.join("build/px4_sitl_default")).unwrap(),
            build
        );
    }

    #[test]
    fn a_px4_without_the_trajectory_interface_is_flown_in_offboard() {
        let folder = TempFolder::new("sitl_px4_current");
        px4(
            &folder,
            "build/other",
            "COM_OBS",
            &["10016_none_iris", "10040_sihsim_quadx"],
        );
        let build = SitlBuild::find(&folder).unwrap();
        assert_eq!(build.profile, "px4_offboard");
        assert_eq!(build.interfaces, [Interface::Px4Hil, Interface::Px4Sih]);
        assert_eq!(build.model(Interface::Px4Sih), Some("sihsim_quadx"));
        px4(&folder, "build/another", "", &["10016_none_iris"]);
        let error = SitlBuild::find(&folder).unwrap_err();
        assert!(matches!(&error, FindError::Ambiguous { found } if found.len() == 2));
        assert!(error.to_string().contains("build/another/bin/px4"), "{error}");
    }

    #[test]
    fn source_build_and_program_folder_lead_to_the_same_copter() {
        let folder = TempFolder::new("sitl_copter");
        folder.write("build/sitl/bin/arducopter", "\0\0ArduCopter V4.7.0-dev\0x");
        let error = SitlBuild::find(&folder).unwrap_err();
        assert!(matches!(error, FindError::NoStartup { .. }));
        let parameters = folder.write("Tools/autotest/default_params/copter.parm", "");
        let build = SitlBuild::find(&folder).unwrap();
        assert_eq!(
            (build.make, build.version.as_str(), build.profile),
            (Make::ArduCopter, "V4.7.0-dev", "ardupilot_guided")
        );
        assert_eq!(build.startup, parameters.canonicalize().unwrap());
        for inner in ["build/sitl", "build/sitl/bin"] {
            assert_eq!(SitlBuild::find(&folder.join(inner)).unwrap(), build);
        }
    }

    #[test]
    fn what_was_looked_for_is_named() {
        let folder = TempFolder::new("sitl_nothing");
        let text = SitlBuild::find(&folder).unwrap_err().to_string();
        for name in ["bin/px4", "build/sitl/bin/arducopter", "make px4_sitl_default"] {
            assert!(text.contains(name), "{text}");
        }
        let missing = SitlBuild::find(Path::new("/nowhere/at/all")).unwrap_err();
        assert!(missing.to_string().starts_with("/nowhere/at/all"));
    }
}
