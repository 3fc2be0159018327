//! A program of its own in lock-step, as its scheduler sees it: started, spoken to over a socket, killed at the end.

use super::LocalBus;
use super::relay::Relay;
use crate::programs;
use crate::setup::StartError;
use std::ffi::OsString;
use std::io::{ErrorKind, Result};
use std::os::unix::net::{UnixListener, UnixStream};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Real time that a program may take to come up, or think about one step: the board's time stands still meanwhile.
pub const PATIENCE: Duration = Duration::from_secs(60);
/// How often a program that comes up is looked at.
const LOOK: Duration = Duration::from_millis(2);

/// The program; it is killed with this.
#[derive(Debug)]
pub struct Program {
    child: Child,
    /// What it and the bus say to each other.
    pub relay: Relay,
}

impl Program {
    /// Starts `program` with `arguments`; `begin` says the first word to it. `socket` is a file that is not there yet. What the program logs
    /// goes to `log`.
    ///
    /// # Errors
    /// [`StartError::Needs`]: there is no such program, it ended, or did not connect.
    pub fn start(
        bus: &LocalBus,
        program: &Path,
        arguments: impl IntoIterator<Item = OsString>,
        socket: &Path,
        log: Stdio,
        begin: impl FnOnce(&mut Relay) -> Result<()>,
    ) -> std::result::Result<Self, StartError> {
        let needs = |error: std::io::Error| StartError::Needs {
            what: program.display().to_string(),
            cause: error.to_string(),
        };
        let file = programs::file_of(program);
        let _none_left = std::fs::remove_file(socket);
        let listener = UnixListener::bind(socket).map_err(needs)?;
        listener.set_nonblocking(true).map_err(needs)?;
        let mut command = programs::command(&file, program.as_os_str());
        command.arg("--lockstep").arg(socket).args(arguments).stderr(log);
        let mut child = command.spawn().map_err(needs)?;
        let connected = accept(&listener, &mut child).and_then(|stream| {
            stream.set_nonblocking(false)?;
            let mut relay = Relay::new(bus, stream)?;
            begin(&mut relay)?;
            Ok(relay)
        });
        match connected {
            Ok(relay) => Ok(Self { child, relay }),
            Err(error) => {
                end(&mut child);
                Err(needs(error))
            }
        }
    }

    /// How it ended, after the socket has failed.
    pub fn ended(&mut self) -> ExitStatus {
        match self.child.try_wait() {
            Ok(Some(status)) => status,
            _ => end(&mut self.child),
        }
    }

    /// Asks it to end.
    pub fn terminate(&mut self) {
        if self.relay.end(PATIENCE).is_ok() {
            // It has said its last word.
            let _reaped = self.child.wait();
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

fn accept(listener: &UnixListener, child: &mut Child) -> Result<UnixStream> {
    let begin = Instant::now();
    loop {
        match listener.accept() {
            Ok((stream, _)) => return Ok(stream),
            Err(error) if error.kind() != ErrorKind::WouldBlock => return Err(error),
            Err(_) => {}
        }
        if let Some(status) = child.try_wait()? {
            return Err(std::io::Error::other(format!("it ended with {status}")));
        }
        if begin.elapsed() > PATIENCE {
            return Err(ErrorKind::TimedOut.into());
        }
        std::thread::sleep(LOOK);
    }
}

/// Kills and reaps it.
fn end(child: &mut Child) -> ExitStatus {
    // It may have ended.
    let _gone_already = child.kill();
    child.wait().unwrap_or(ExitStatus::from_raw(0))
}
