//! The binary that the supervisor is to go on as: asked for the layouts of its samples, beside the loop, which never waits for it.

use jink_runtime::programs;
use jink_shared_types::Timestamp;
use jink_shared_types::topics::FINGERPRINT;
use std::fs::File;
use std::io::{Read, Seek};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};

/// Time in which it answers (s).
const PATIENCE_S: f64 = 2.0;
/// How often its end is looked for (s).
const LOOK_S: f64 = 0.02;
/// What is kept of an answer (bytes).
const ANSWER_MAX: u64 = 1024;

/// A binary that was asked and has not answered yet.
pub struct Trial {
    program: PathBuf,
    child: Child,
    out: File,
    errors: File,
    until: Timestamp,
    /// It was killed because it had not answered.
    was_late: bool,
}

/// A file in memory for the output of a program: it never blocks, whoever keeps it open.
fn memory() -> std::io::Result<File> {
    let memory = rustix::fs::memfd_create("answer", rustix::fs::MemfdFlags::CLOEXEC)?;
    Ok(File::from(memory))
}

impl Trial {
    /// Asks `program`.
    pub fn begin(program: &Path, now: Timestamp) -> std::io::Result<Self> {
        let (out, errors) = (memory()?, memory()?);
        let child = supervisor_in(program)
            .arg("--fingerprint")
            .stdin(Stdio::null())
            .stdout(OwnedFd::from(out.try_clone()?))
            .stderr(OwnedFd::from(errors.try_clone()?))
            .spawn()?;
        Ok(Self {
            program: program.to_owned(),
            child,
            out,
            errors,
            until: now.plus_seconds(PATIENCE_S),
            was_late: false,
        })
    }

    /// When to look again.
    pub fn due(now: Timestamp) -> Timestamp {
        now.plus_seconds(LOOK_S)
    }

    /// The program once it has answered with our layouts, or why not; `None` until it has ended.
    pub fn judge(&mut self, now: Timestamp) -> Option<Result<PathBuf, String>> {
        match self.child.try_wait() {
            Ok(None) => {
                if now >= self.until && !self.was_late {
                    self.was_late = true;
                    // It may have ended meanwhile.
                    let _ended_already = self.child.kill();
                }
                None
            }
            Ok(Some(_)) if self.was_late => Some(Err(format!(
                "it has not answered --fingerprint within {PATIENCE_S} s"
            ))),
            Err(error) => Some(Err(error.to_string())),
            Ok(Some(status)) => Some(self.answer(status).map(|()| self.program.clone())),
        }
    }

    fn answer(&mut self, status: ExitStatus) -> Result<(), String> {
        if !status.success() {
            return Err(format!(
                "--fingerprint ended with {status}: {}",
                text_of(&mut self.errors)
            ));
        }
        let (own, theirs) = (format!("{FINGERPRINT:016x}"), text_of(&mut self.out));
        match theirs == own {
            true => Ok(()),
            false => Err(format!("its layouts differ ({theirs}, running {own})")),
        }
    }
}

fn text_of(file: &mut File) -> String {
    let mut bytes = Vec::new();
    // What cannot be read is empty.
    let _unread = file
        .rewind()
        .and_then(|()| file.take(ANSWER_MAX).read_to_end(&mut bytes));
    String::from_utf8_lossy(&bytes).trim().to_owned()
}

/// A command that starts the supervisor in another file.
pub fn supervisor_in(program: &Path) -> Command {
    programs::command(program, "jink-supervisor".as_ref())
}
