//! A service in a process of its own, in lock-step with a scheduler at the other end of a socket.

use super::relay::Relay;
use super::{LocalBus, Looked, Member};
use crate::config::Config;
use crate::process_loop::Ended;
use crate::service::Service;
use crate::setup::{Setup, StartError};
use std::io::{ErrorKind, Result};
use std::os::unix::net::UnixStream;
use std::path::Path;

/// Runs the service until the scheduler asks it to end, or is gone.
pub(crate) fn serve<S: Service>(
    socket: &Path,
    setup: Setup,
    config: Config,
) -> std::result::Result<Ended, StartError> {
    let needs = |error: std::io::Error| StartError::Needs {
        what: format!("lock-step at {}", socket.display()),
        cause: error.to_string(),
    };
    let bus = LocalBus::new(jink_shared_types::Timestamp::NEVER);
    let mut relay = UnixStream::connect(socket)
        .and_then(|stream| Relay::new(&bus, stream))
        .map_err(needs)?;
    let begin = relay.receive().map_err(needs)?;
    bus.set_clock(begin);
    let member = Member::<S>::start(&bus, setup, config)?;
    match run(&bus, &mut relay, member, begin) {
        // The scheduler has no more use for it.
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(Ended::Stopped),
        ended => ended.map_err(needs),
    }
}

fn run<S: Service>(
    bus: &LocalBus,
    relay: &mut Relay,
    mut member: Member<S>,
    begin: jink_shared_types::Timestamp,
) -> Result<Ended> {
    let mut wake = begin;
    loop {
        relay.announce()?;
        relay.send(wake)?;
        let time = relay.receive()?;
        if !time.is_set() {
            member.terminate();
            relay.send(time)?;
            return Ok(Ended::Stopped);
        }
        bus.set_clock(time);
        let looked = match relay.is_replay() {
            true => member.run(),
            false => member.run_if_due(),
        };
        if looked == Looked::WantsRestart {
            relay.send(time)?;
            return Ok(Ended::WantsRestart);
        }
        wake = member.due();
    }
}
