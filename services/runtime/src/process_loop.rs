//! The loop of a service's process: sleep until a topic, a socket or a timer wakes it, run one cycle.
//!
//! Nothing polls for data: the process sleeps in one `ppoll` over the wake-ups of its trigger topics and the file
//! descriptors the service watches, at most until the next moment the service or the heartbeat asked for. The control
//! record wakes it, too: whoever has become the owner by it runs a cycle at once, and says so.

use crate::config::{Config, Foreign, is_foreign};
use crate::ports::WAKEUPS;
use crate::prefault::Prefault;
use crate::realtime::{self, RealtimeWish, Scheduling};
use crate::running::Running;
use crate::service::{EXIT_CANNOT_START, EXIT_RESTART, Service, WATCHED_FDS};
use crate::session::Session;
use crate::setup::{Setup, StartError};
use crate::transport::Wakeup;
use jink_shared_types::Timestamp;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The control record, trigger topics and watched descriptors together.
const POLL_FDS: usize = 1 + WAKEUPS + WATCHED_FDS;

/// Runs service `S` until SIGTERM or SIGINT: the whole `main` of a service.
pub fn run<S: Service>() -> ExitCode {
    crate::descriptors::reserve();
    let name = format!("jink-{}", S::PROGRAM.replace('_', "-"));
    let setup = match Setup::try_parse_as(&name) {
        Ok(setup) => setup,
        Err(answer) => answer.exit(),
    };
    crate::logging::init(&setup.process, setup.log);
    match start::<S>(setup) {
        Ok(Ended::Stopped) => ExitCode::SUCCESS,
        Ok(Ended::WantsRestart) => ExitCode::from(EXIT_RESTART),
        Err(error) => {
            tracing::error!("{} cannot start: {error}", S::PROGRAM);
            ExitCode::from(match error.passes() {
                true => EXIT_RESTART,
                false => EXIT_CANNOT_START,
            })
        }
    }
}

/// How the loop has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ended {
    Stopped,
    WantsRestart,
}

fn start<S: Service>(setup: Setup) -> Result<Ended, StartError> {
    setup.wants(S::PROGRAM)?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(|error| StartError::Needs {
            what: "a signal handler".to_owned(),
            cause: error.to_string(),
        })?;
    }
    let config = Config::load(&setup.config)?;
    if let Some(socket) = setup.lockstep.clone() {
        return crate::lockstep::remote::serve::<S>(&socket, setup, config);
    }
    let wish = RealtimeWish {
        priority: setup.priority,
        core: setup.core,
        lock_memory: setup.lock_memory,
    };
    for refusal in realtime::apply(wish) {
        tracing::warn!("{refusal}");
    }
    let session = match is_foreign(&setup.process) {
        // What its program calls itself says nothing about what it may use.
        true => Session::open(&setup.instance, &setup.process)?.with(&Foreign::load(&setup.config)?),
        false => Session::open(&setup.instance, S::PROGRAM)?,
    };
    let mut running = Running::<S>::start(session, setup, config)?;
    tracing::debug!(pid = std::process::id(), "{} runs", running.ports.setup().process);
    let ended = serve(&mut running, &stop)?;
    running.end();
    Ok(ended)
}

fn serve<S: Service>(running: &mut Running<S>, stop: &AtomicBool) -> Result<Ended, StartError> {
    let mut prefault = None;
    while !stop.load(Ordering::Relaxed) {
        let wake = running.turn();
        match &mut prefault {
            Some(prefault) => Prefault::step(prefault),
            None => {
                if running.ports.setup().priority == 0 {
                    // The supervisor lets a replacement start ahead of others. Whoever was not has nothing to give up.
                    let _refused_to_nobody = realtime::schedule(0, Scheduling::Ordinary);
                }
                running.settle()?;
                prefault = Some(Prefault::of_this_process());
            }
        }
        if wake.restart {
            return Ok(Ended::WantsRestart);
        }
        sleep(running, wake.at, stop);
    }
    Ok(Ended::Stopped)
}

/// Sleeps until data come, until `until`, or until this instance has become the owner; heartbeats go out meanwhile.
fn sleep<S: Service>(running: &mut Running<S>, until: Timestamp, stop: &AtomicBool) {
    loop {
        let has_data = wait(running, until.min(running.beat_due()));
        let is_new_owner = running.attend();
        if has_data || is_new_owner || realtime::now() >= until || stop.load(Ordering::Relaxed) {
            return;
        }
    }
}

/// One `ppoll` over topics, watched descriptors and the control record. Returns whether it was ended by data, not by the
/// control record or the time.
fn wait<S: Service>(running: &Running<S>, until: Timestamp) -> bool {
    let left_ns = until.ns_since(realtime::now());
    let timeout = Timespec {
        tv_sec: i64::try_from(left_ns / 1_000_000_000).unwrap_or(i64::MAX),
        tv_nsec: (left_ns % 1_000_000_000) as i64,
    };
    let control = &running.control.wakeup;
    let watched = running.service.watched();
    let mut sources = std::iter::once(control)
        .chain(&running.ports.wakeups)
        .filter_map(Wakeup::fd)
        .chain(watched.into_iter().flatten());
    let stdin = rustix::stdio::stdin();
    let mut used = 0;
    // Unused places hold a descriptor with no events asked for, and are not handed to the kernel.
    let mut fds: [PollFd<'_>; POLL_FDS] = std::array::from_fn(|_| match sources.next() {
        Some(fd) => {
            used += 1;
            PollFd::from_borrowed_fd(fd, PollFlags::IN)
        }
        None => PollFd::from_borrowed_fd(stdin, PollFlags::empty()),
    });
    // Interrupted by a signal: as good as a time-out, the caller looks at the stop flag.
    let ready = poll(&mut fds[..used], Some(&timeout)).unwrap_or(0);
    let by_control = ready > 0 && !fds[0].revents().is_empty();
    let by_data = ready > usize::from(by_control);
    if by_control {
        control.clear();
    }
    if by_data {
        for wakeup in &running.ports.wakeups {
            wakeup.clear();
        }
    }
    by_data
}
