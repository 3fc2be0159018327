//! A process of somebody else's on the board: a program of its own, in lock-step over a socket.

use crate::board::Process;
use jink_runtime::StartError;
use jink_runtime::lockstep::program::{PATIENCE, Program};
use jink_runtime::lockstep::{LocalBus, Looked};
use std::any::Any;
use std::ffi::OsString;
use std::path::Path;
use std::process::Stdio;

/// The program; it is killed with this.
pub(crate) struct Remote {
    name: String,
    program: Program,
}

impl Remote {
    /// Starts `program` with `arguments`. `socket` is a file that is not there yet.
    pub(crate) fn start(
        bus: &LocalBus,
        program: &Path,
        arguments: impl IntoIterator<Item = OsString>,
        socket: &Path,
    ) -> Result<Self, StartError> {
        Ok(Self {
            name: program.display().to_string(),
            program: Program::start(bus, program, arguments, socket, Stdio::inherit(), |relay| {
                relay.exchange(PATIENCE)
            })?,
        })
    }
}

impl Process for Remote {
    fn run_if_due(&mut self) -> Looked {
        let relay = &mut self.program.relay;
        if !relay.is_due() {
            return Looked::Slept;
        }
        match relay.exchange(PATIENCE) {
            Ok(()) => Looked::Ran,
            Err(error) => {
                let status = self.program.ended();
                tracing::error!("{}: {error}; it ended with {status}", self.name);
                Looked::Ended(status)
            }
        }
    }

    fn terminate(mut self: Box<Self>) {
        self.program.terminate();
    }

    fn as_any(&self) -> &dyn Any {
        self
    }

    fn as_any_mut(&mut self) -> &mut dyn Any {
        self
    }
}
