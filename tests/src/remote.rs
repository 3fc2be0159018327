//! A process of somebody else's on the board: a program of its own, in lock-step over a socket.

use crate::board::Process;
use jink_runtime::lockstep::relay::Relay;
use jink_runtime::lockstep::{LocalBus, Looked};
use jink_runtime::{StartError, programs};
use std::any::Any;
use std::ffi::OsString;
use std::io::ErrorKind;
use std::os::unix::net::{UnixListener, UnixStream};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, ExitStatus};
use std::time::{Duration, Instant};

/// Real time that a program may take to come up, or think about one step: the board's time stands still meanwhile.
const PATIENCE: Duration = Duration::from_secs(60);
/// How often a program that comes up is looked at.
const LOOK: Duration = Duration::from_millis(2);

/// The program; it is killed with this.
pub(crate) struct Remote {
    name: String,
    child: Child,
    relay: Relay,
}

impl Remote {
    /// Starts `program` with `arguments`. `socket` is a file that is not there yet.
    pub(crate) fn start(
        bus: &LocalBus,
        program: &Path,
        arguments: impl IntoIterator<Item = OsString>,
        socket: &Path,
    ) -> Result<Self, StartError> {
        let needs = |error: std::io::Error| StartError::Needs {
            what: program.display().to_string(),
            cause: error.to_string(),
        };
        let file = programs::file_of(program);
        let _none_left = std::fs::remove_file(socket);
        let listener = UnixListener::bind(socket).map_err(needs)?;
        listener.set_nonblocking(true).map_err(needs)?;
        let mut command = programs::command(&file, program.as_os_str());
        command.arg("--lockstep").arg(socket).args(arguments);
        let mut child = command.spawn().map_err(needs)?;
        let connected = accept(&listener, &mut child).and_then(|stream| {
            stream.set_nonblocking(false)?;
            let mut relay = Relay::new(bus, stream)?;
            relay.exchange(PATIENCE)?;
            Ok(relay)
        });
        match connected {
            Ok(relay) => Ok(Self {
                name: program.display().to_string(),
                child,
                relay,
            }),
            Err(error) => {
                end(&mut child);
                Err(needs(error))
            }
        }
    }
}

fn accept(listener: &UnixListener, child: &mut Child) -> std::io::Result<UnixStream> {
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

impl Process for Remote {
    fn run_if_due(&mut self) -> Looked {
        if !self.relay.is_due() {
            return Looked::Slept;
        }
        match self.relay.exchange(PATIENCE) {
            Ok(()) => Looked::Ran,
            Err(error) => {
                let status = match self.child.try_wait() {
                    Ok(Some(status)) => status,
                    _ => end(&mut self.child),
                };
                tracing::error!("{}: {error}; it ended with {status}", self.name);
                Looked::Ended(status)
            }
        }
    }

    fn terminate(mut self: Box<Self>) {
        if self.relay.end(PATIENCE).is_ok() {
            // It has said its last word.
            let _reaped = self.child.wait();
        }
    }

    fn as_any(&self) -> &dyn Any {
        self
    }

    fn as_any_mut(&mut self) -> &mut dyn Any {
        self
    }
}

impl Drop for Remote {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}
