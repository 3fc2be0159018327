//! The folder of the cases, and its programs in Python.

use jink_tests::not_tested;
use jink_tests::peers::{PYMAVLINK, python_or_say};
use jink_tests::processes::workspace;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Runs a program of the folder with other ports than those written in it: `FOLDER SCRIPT FROM=TO,.. [ARGUMENT..]`.
const WITH_PORTS: &str = "
import os, sys, types
sys.dont_write_bytecode = True
folder, script, ports = sys.argv[1:4]
def text(name):
    with open(os.path.join(folder, name)) as file: written = file.read()
    for pair in ports.split(','):
        if pair: written = written.replace(*pair.split('='))
    return compile(written, name, 'exec')
autopilot = types.ModuleType('small_autopilot')
if os.path.exists(os.path.join(folder, 'small_autopilot.py')):
    exec(text('small_autopilot.py'), autopilot.__dict__)
sys.modules['small_autopilot'] = autopilot
sys.argv = sys.argv[4:] and [script] + sys.argv[4:] or [script]
os.chdir(folder)
exec(text(script), {'__name__': '__main__', '__doc__': script})
";

/// The folder.
#[derive(Clone, Debug)]
pub struct Case {
    folder: PathBuf,
}

impl Case {
    /// The folder, if it is there.
    pub fn find() -> Option<Self> {
        let folder = workspace().join("../shared/cases");
        if !folder.is_dir() {
            not_tested("there is no ../shared/cases");
            return None;
        }
        let folder = folder.canonicalize().unwrap();
        Some(Self { folder })
    }

    /// A file of it.
    pub fn path(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    /// A Python for its programs, if one can be had.
    pub fn python(&self) -> Option<Python<'_>> {
        let python = python_or_say(&PYMAVLINK)?;
        Some(Python {
            folder: &self.folder,
            python,
        })
    }
}

/// A Python with pymavlink.
#[derive(Debug)]
pub struct Python<'a> {
    folder: &'a Path,
    python: PathBuf,
}

impl Python<'_> {
    /// A command that runs `script` with `arguments`; each of `ports` stands in the place of the one that is written there.
    pub fn script(&self, script: &str, arguments: &[&str], ports: &[(&str, u16)]) -> Command {
        let ports: Vec<String> = ports.iter().map(|(from, to)| format!("{from}={to}")).collect();
        let mut command = Command::new(&self.python);
        command.arg("-c").arg(WITH_PORTS).arg(self.folder);
        command.arg(script).arg(ports.join(",")).args(arguments);
        command
    }
}

/// The number behind the last `name` in `text`; not a number if there is none.
pub fn figure(text: &str, name: &str) -> f64 {
    let behind = text.rsplit_once(name).map_or("", |(_, behind)| behind);
    let end = behind.find(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'));
    behind[..end.unwrap_or(behind.len())].parse().unwrap_or(f64::NAN)
}

/// The processes of an instance.
pub fn processes_of(instance: &str) -> Vec<i32> {
    let is_of = |pid: &i32| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let mut arguments = line.split(|byte| *byte == 0);
        let is_jink = arguments.next().is_some_and(|name| {
            let name = String::from_utf8_lossy(name);
            name.rsplit('/')
                .next()
                .is_some_and(|name| name.starts_with("jink"))
        });
        is_jink && arguments.any(|argument| argument == instance.as_bytes())
    };
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    pids.filter(is_of).collect()
}
