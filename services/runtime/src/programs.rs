//! Which file holds which of jink's programs: `jink` is all that an aircraft needs under many names, as BusyBox is, `jink-lab` all that
//! simulates. So each is linked once, and processes share its pages.
//!
//! A program is looked for beside this one: a file of its name, else the file that has it in it, which is started under its name.

use std::ffi::OsStr;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The file of what flies.
pub const JINK: &str = "jink";
/// The file of what simulates.
pub const LAB: &str = "jink-lab";
/// The program that renders sensors and flies emulated vehicles, in [`LAB`].
pub const SIMULATOR: &str = "jink-simulator";
/// The program that writes to disks, in [`JINK`].
pub const RECORDER: &str = "jink-recorder";
/// The programs in [`JINK`].
pub const IN_JINK: [&str; 14] = [
    "jink-supervisor",
    "jink-obstacle-fusion",
    "jink-planner",
    "jink-bezier-generator",
    "jink-collision-guard",
    "jink-mavlink-gateway",
    "jink-parameter-server",
    "jink-ground-services",
    RECORDER,
    "jink-viewer",
    "jink-rangefinder-driver",
    "jink-depth-driver",
    "jink-lidar-driver",
    "jink-link-check",
];

/// The file that `program` is started from: itself, or the one beside it that has it in it.
pub fn file_of(program: &Path) -> PathBuf {
    let name = program.file_name().and_then(OsStr::to_str).unwrap_or_default();
    match name {
        _ if program.is_file() => program.to_owned(),
        SIMULATOR => program.with_file_name(LAB),
        _ if IN_JINK.contains(&name) => program.with_file_name(JINK),
        _ => program.to_owned(),
    }
}

/// A command that starts `program`: where a file has many in it, as the one that `program` is called, else as the one called `name`.
pub fn command(program: &Path, name: &OsStr) -> Command {
    let file = file_of(program);
    let mut command = Command::new(&file);
    if [JINK, LAB].iter().any(|many| file.ends_with(many)) {
        let called = program.file_name().filter(|called| service_of(called).is_some());
        command.arg0(called.unwrap_or(name));
    }
    command
}

/// What the service behind a program of ours is called in the topic table: `planner` of `jink-planner`. `None` of any other program.
pub fn service_of(program: &OsStr) -> Option<String> {
    let name = program.to_str()?;
    let is_ours = name == SIMULATOR || IN_JINK.contains(&name);
    let service = name.strip_prefix("jink-").filter(|_| is_ours)?;
    Some(service.replace('-', "_"))
}

/// The name this process was started under, which becomes what `ps` and `top` show of it.
pub fn own_name() -> String {
    let path = PathBuf::from(std::env::args_os().next().unwrap_or_default());
    let name = path
        .file_name()
        .and_then(OsStr::to_str)
        .unwrap_or_default()
        .to_owned();
    if let Ok(shown) = std::ffi::CString::new(name.as_bytes()) {
        // Only what is shown depends on it.
        let _refused = rustix::thread::set_name(&shown);
    }
    name
}

#[cfg(test)]
mod tests {
    use super::{IN_JINK, command, file_of, service_of};
    use std::path::Path;

    #[test]
    fn a_program_is_started_under_the_name_that_it_was_called_by() {
        let shown = |program: &str| format!("{:?}", command(Path::new(program), "jink-planner".as_ref()));
        for (program, started) in [
            ("/a/jink", "[\"/a/jink\"] \"jink-planner\""),
            ("/a/jink-planner", "[\"/a/jink\"] \"jink-planner\""),
            (
                "/a/jink-bezier-generator",
                "[\"/a/jink\"] \"jink-bezier-generator\"",
            ),
            ("/a/own-planner", "\"/a/own-planner\""),
        ] {
            assert_eq!(shown(program), started);
        }
        assert_eq!(
            service_of("jink-bezier-generator".as_ref()).as_deref(),
            Some("bezier_generator")
        );
        assert_eq!(service_of("jink-bad-candidate".as_ref()), None);
    }

    #[test]
    fn a_file_of_its_own_counts_before_the_one_that_has_all() {
        let folder = std::env::temp_dir().join(format!("jink_programs_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let planner = folder.join(IN_JINK[2]);
        assert_eq!(file_of(&planner), folder.join("jink"));
        std::fs::write(&planner, "").unwrap();
        assert_eq!(file_of(&planner), planner);
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(file_of(Path::new("/a/jink-simulator")), Path::new("/a/jink-lab"));
        assert_eq!(file_of(Path::new("/a/own-planner")), Path::new("/a/own-planner"));
    }
}
