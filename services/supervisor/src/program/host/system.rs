//! The loop: sleep until a process ends, a signal comes or something is due; observe; step; act.

use super::children::Children;
use super::notify::Notifier;
use super::post_mortem::PostMortem;
use super::requests::{CLIENTS, Requests, refusal};
use super::sweeper::Sweeper;
use super::upgrade::{Trial, supervisor_in};
use crate::shadow::{PROBATION_CYCLES, SwapProgress, SwapRefusal};
use crate::shared::{PROGRAM, SupervisorTopics};
use crate::supervision::{Action, End, Exit, Observation, Supervision};
use jink_runtime::Instance;
use jink_runtime::programs;
use jink_runtime::request::{Answer, Request};
use jink_shared_types::Timestamp;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::health::{Health, PROCESSES};
use jink_shared_types::suggestion::{DidYouMean, nearest};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::Access;
use rustix::process::Signal;
use std::io::Read;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};

/// How often the logs are measured (s); in that time even a chatty process writes little against their limit.
const LOGS_PERIOD_S: f64 = 1.0;
/// A log that has grown beyond this is moved aside once (bytes): in memory all of them together take some 40 MB at most.
const LOG_MAX_BYTES: u64 = 1 << 20;

/// For whom a client waits that has asked for another supervisor.
const UPGRADE: usize = usize::MAX;
/// The signal, both instances of every process, and the clients.
const FDS: usize = 1 + 2 * PROCESSES + 1 + CLIENTS;

/// What is known at the end.
#[derive(Debug, Default)]
pub struct Report {
    /// A process ended otherwise than on request.
    pub any_failed: bool,
    /// The last such end, in one sentence.
    pub reason: String,
}

/// The running system.
pub struct System {
    supervision: Supervision,
    children: Children,
    shared: SupervisorTopics,
    notifier: Notifier,
    stop_signal: UnixStream,
    sweeper: Sweeper,
    requests: Requests,
    trial: Option<Trial>,
    upgrade: Option<PathBuf>,
    instance: Instance,
    /// Whether what is written into them stays, as far as the pilot was told.
    logs_are_kept: bool,
    logs_due: Timestamp,
    observations: Vec<Observation>,
    actions: Vec<Action>,
    report: Report,
    dead: Vec<PostMortem>,
}

impl System {
    /// A system that has not started anything.
    pub fn new(
        supervision: Supervision,
        children: Children,
        shared: SupervisorTopics,
        notifier: Notifier,
        stop_signal: UnixStream,
        requests: Requests,
        sweeper: Sweeper,
        instance: &Instance,
    ) -> Self {
        Self {
            supervision,
            children,
            shared,
            notifier,
            stop_signal,
            sweeper,
            requests,
            trial: None,
            upgrade: None,
            instance: instance.clone(),
            logs_are_kept: true,
            logs_due: Timestamp::NEVER,
            observations: Vec::with_capacity(4 * PROCESSES),
            actions: Vec::with_capacity(4 * PROCESSES),
            report: Report::default(),
            dead: Vec::new(),
        }
    }

    /// Reports to the pilot that an earlier supervisor's processes were found flying.
    pub fn report_adopted(&mut self, adopted: u32) {
        let event = EventSample::new(&events::SUPERVISOR_BACK, "", [f64::from(adopted), 0.0]);
        self.shared.raise(jink_runtime::now(), &event);
    }

    /// Runs until everything has ended.
    pub fn run(&mut self) -> End {
        Children::raise_priority();
        loop {
            let now = jink_runtime::now();
            self.actions.clear();
            let changed = self.supervision.step(now, &self.observations, &mut self.actions);
            self.observations.clear();
            if let Some(end) = self.act(now) {
                self.log_ends();
                self.publish(now, true);
                self.requests.close();
                return end;
            }
            self.publish(now, changed);
            self.judge_upgrade();
            if let Some(program) = self.upgrade.take() {
                self.exec_program(&program);
            }
            self.children.restore_priority(now);
            self.log_ends();
            self.notifier.update(now, &self.supervision);
            if now >= self.logs_due {
                self.logs_due = now.plus_seconds(LOGS_PERIOD_S);
                self.children.limit_logs(LOG_MAX_BYTES);
                self.watch_logs(now);
                self.shared.announce();
            }
            // The results of an action are processed before anything else.
            if self.observations.is_empty() {
                self.sleep();
                // Before deaths are looked for: a last heartbeat belongs before its sender's end.
                self.shared.read_heartbeats(&mut self.observations);
                self.observe();
            }
        }
    }

    /// Everything has ended: releases shared memory and returns the report.
    pub fn into_report(self) -> Report {
        self.report
    }

    fn act(&mut self, now: Timestamp) -> Option<End> {
        for action in std::mem::take(&mut self.actions) {
            match action {
                Action::Spawn { process, generation } => {
                    self.observations.extend(self.children.spawn(process, generation));
                }
                Action::SpawnShadow {
                    process,
                    generation,
                    candidate,
                } => {
                    let spawned = self.children.spawn_shadow(process, generation, candidate);
                    self.observations.extend(spawned);
                }
                Action::Inspect { process } => self.observations.extend(self.children.inspect(process)),
                Action::Terminate { process } => self.children.signal(process, Signal::TERM),
                Action::Kill { process } => self.children.signal(process, Signal::KILL),
                Action::KillShadow { process } => self.children.kill_shadow(process),
                Action::Promote { process } => self.children.promote(process),
                Action::Commit { process } => self.children.commit(process),
                Action::TakeBack { process } => self.children.take_back(process),
                Action::ReportSwap { process, progress } => self.report_swap(process, &progress),
                Action::CleanUp => self.sweeper.request(),
                Action::PublishEvent(event) => self.shared.raise(now, &event),
                Action::End(end) => return Some(end),
            }
        }
        None
    }

    fn report_swap(&mut self, process: usize, progress: &SwapProgress) {
        let mut text = progress.to_string();
        if let SwapProgress::Refused(SwapRefusal::Ended(_)) = progress
            && let Some(last) = self.children.last_shadow_lines(process).last()
        {
            text += &format!(": {last}");
        } else if let SwapProgress::Refused(SwapRefusal::Ended(Exit::Code(0))) = progress {
            text += " and without a word: is it this service's program?";
        }
        tracing::info!(process, "swap: {text}");
        let (last, good) = (progress.is_last(), progress.is_good());
        self.requests.notify(process, &Answer { text, last, good });
    }

    /// Reports when there is no memory for logs any more, and when there is again: nobody reads that in a log.
    fn watch_logs(&mut self, now: Timestamp) {
        let are_kept = self.instance.logs_have_room();
        if self.logs_are_kept != are_kept {
            self.logs_are_kept = are_kept;
            let event = if are_kept {
                &events::LOGS_KEPT
            } else {
                &events::LOGS_LOST
            };
            self.shared.raise(now, &EventSample::new(event, "", [0.0; 2]));
        }
    }

    fn publish(&mut self, now: Timestamp, changed: bool) {
        self.shared.publish(now, &self.supervision, changed);
        if changed {
            let supervision = &self.supervision;
            self.children.write_record(|index| supervision.adoptable(index));
        }
    }

    fn sleep(&self) {
        let now = jink_runtime::now();
        let until = [self.supervision.next_wake(now), self.shared.due(), self.logs_due]
            .into_iter()
            .chain(self.notifier.due())
            .chain(self.trial.as_ref().map(|_| Trial::due(now)))
            .min()
            .unwrap_or(now);
        let left_ns = until.ns_since(now);
        let timeout = Timespec {
            tv_sec: (left_ns / 1_000_000_000) as i64,
            tv_nsec: (left_ns % 1_000_000_000) as i64,
        };
        let signal = PollFd::from_borrowed_fd(self.stop_signal.as_fd(), PollFlags::IN);
        let mut fds: [PollFd<'_>; FDS] = std::array::from_fn(|_| signal.clone());
        let mut used = 1;
        let handles = self.children.handles().chain(self.requests.fds());
        for (slot, handle) in fds[1..].iter_mut().zip(handles) {
            *slot = PollFd::from_borrowed_fd(handle, PollFlags::IN);
            used += 1;
        }
        // A signal only means that the wait ends sooner: everything is checked anyway.
        let _ = poll(&mut fds[..used], Some(&timeout));
    }

    fn observe(&mut self) {
        let mut signals = [0; 16];
        if self.stop_signal.read(&mut signals).is_ok_and(|count| count > 0) {
            tracing::info!("stop requested");
            self.observations.push(Observation::StopRequested);
        }
        for process in 0..self.children.len() {
            if let Some(exit) = self.children.reap(process) {
                self.note_end(process, exit);
                self.observations.push(Observation::Died { process, exit });
            }
            if let Some(exit) = self.children.reap_shadow(process) {
                tracing::info!(process, "shadow ended: {exit}");
                self.observations.push(Observation::ShadowDied { process, exit });
            }
        }
        for (client, request) in self.requests.take() {
            if let Some(answer) = self.serve(client, &request) {
                self.requests.conclude(client, &answer);
            }
        }
    }

    /// Passes a request on; an answer if there is one at once.
    fn serve(&mut self, client: usize, request: &Request) -> Option<Answer> {
        tracing::info!("asked: {request:?}");
        let name = match request {
            Request::Upgrade { program } => return self.begin_upgrade(client, program),
            Request::Swap { process, .. } | Request::Restart { process } | Request::Stop { process } => {
                process
            }
        };
        let Some(process) = self.children.find(name) else {
            let names: Vec<_> = self.children.names().collect();
            return Some(refusal(match name.as_str() {
                PROGRAM => "the supervisor is replaced by `jink swap supervisor BINARY`, and `jink down` ends it with \
                            all processes"
                    .to_owned(),
                _ => format!(
                    "there is no process {name:?}{}; there are {}",
                    DidYouMean(nearest(name, names.iter().copied())),
                    names.join(", ")
                ),
            }));
        };
        match request {
            Request::Swap {
                program,
                cycles,
                dry_run,
                ..
            } => {
                match program {
                    Some(program) if !programs::file_of(program).is_file() => {
                        return Some(refusal(format!("{} is no file", program.display())));
                    }
                    Some(program)
                        if rustix::fs::access(programs::file_of(program), Access::EXEC_OK).is_err() =>
                    {
                        return Some(refusal(format!("{} is not executable", program.display())));
                    }
                    None if self.supervision.is_down(process) && !dry_run => {
                        self.children.stage(process, None);
                        self.children.commit(process);
                        self.observations.push(Observation::RestartRequested { process });
                        return Some(done(format!("{name} is started")));
                    }
                    _ => {}
                }
                // Neither its program nor its answers may meet those of a swap that is under way.
                let just_asked = self.observations.iter().any(
                    |seen| matches!(seen, Observation::SwapRequested { process: other, .. } if *other == process),
                );
                if just_asked || self.supervision.is_swapping(process) {
                    return Some(refusal(SwapProgress::Refused(SwapRefusal::Busy).to_string()));
                }
                self.children.stage(process, program.clone());
                self.requests.wait_for(client, process);
                self.observations.push(Observation::SwapRequested {
                    process,
                    cycles: cycles.unwrap_or(PROBATION_CYCLES),
                    dry_run: *dry_run,
                });
                None
            }
            Request::Restart { .. } => {
                self.children.stage(process, None);
                self.children.commit(process);
                self.observations.push(Observation::RestartRequested { process });
                Some(done(format!("{name} is restarted")))
            }
            Request::Stop { .. } => {
                self.observations.push(Observation::EndRequested { process });
                Some(done(format!(
                    "{name} is stopped; `jink restart {name}` starts it again"
                )))
            }
            Request::Upgrade { .. } => None,
        }
    }

    fn begin_upgrade(&mut self, client: usize, program: &Path) -> Option<Answer> {
        if self.trial.is_some() {
            return Some(refused_upgrade("another binary is being asked"));
        }
        match Trial::begin(program, jink_runtime::now()) {
            Ok(trial) => {
                self.trial = Some(trial);
                self.requests.wait_for(client, UPGRADE);
                None
            }
            Err(error) => Some(refused_upgrade(format!("{}: {error}", program.display()))),
        }
    }

    /// Looks at the binary that is asked.
    fn judge_upgrade(&mut self) {
        let judged = self
            .trial
            .as_mut()
            .and_then(|trial| trial.judge(jink_runtime::now()));
        let Some(judged) = judged else { return };
        self.trial = None;
        let answer = match judged {
            Ok(program) => {
                self.upgrade = Some(program);
                done("the new binary is the supervisor now".to_owned())
            }
            Err(why) => refused_upgrade(why),
        };
        self.requests.notify(UPGRADE, &answer);
    }

    /// Goes on as another binary, in the same process: the children stay children. Returns only if that fails.
    fn exec_program(&mut self, program: &Path) {
        let supervision = &self.supervision;
        self.children.write_record(|index| supervision.adoptable(index));
        let error = supervisor_in(program).args(std::env::args_os().skip(1)).exec();
        tracing::error!("{} cannot be executed: {error}", program.display());
    }

    /// Keeps the report of a death; logging it waits until the replacement has been started.
    fn note_end(&mut self, process: usize, exit: Exit) {
        let now = jink_runtime::now();
        let Some((name, lived_s)) = self.supervision.describe(process, now) else {
            return;
        };
        let asked_for = self.supervision.health() == Health::Stopping;
        if asked_for && matches!(exit, Exit::Code(0) | Exit::Unknown) {
            tracing::info!(process = name, "stopped");
            return;
        }
        let last_lines = self.children.last_lines(process);
        let last_line = last_lines.last().map_or("", String::as_str);
        // A reason why the system stops comes before what happens while it stops.
        if !asked_for {
            self.report.reason = format!("{name} ended with {exit}: {last_line}");
        }
        self.report.any_failed = true;
        match PostMortem::new(&self.supervision, process, exit, lived_s, last_lines) {
            Ok(report) => self.dead.push(report),
            Err(error) => tracing::warn!("no post-mortem: {error}"),
        }
    }

    /// Logs how processes have ended, with the last lines of their logs.
    fn log_ends(&mut self) {
        for report in self.dead.drain(..) {
            report.log();
            if let Err(error) = report.write(&self.instance) {
                tracing::warn!("the post-mortem cannot be written: {error}");
            }
        }
    }
}

fn refused_upgrade(why: impl std::fmt::Display) -> Answer {
    refusal(format!("refused, nothing was changed: {why}"))
}

/// A positive answer.
fn done(text: String) -> Answer {
    Answer {
        text,
        last: true,
        good: true,
    }
}
