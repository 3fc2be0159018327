//! The state machine against a simulated host.

mod incidents;
mod restart;
mod second_instance;
mod silence;
mod start_and_stop;

use super::{Action, End, Exit, Observation, ProcessActivity, Supervision};
use crate::policy::RestartRule;
use crate::shadow::SwapProgress;
use crate::slowness::SlowRule;
use crate::table::{OnFailure, ProcessRules};
use jink_shared_types::Timestamp;
use jink_shared_types::coded::Coded;
use jink_shared_types::health::{Health, Heartbeat, ServiceState, SystemStatus};

const CANNOT_START: Exit = Exit::Code(78);

fn rules(name: &str) -> ProcessRules {
    ProcessRules {
        name: name.to_owned(),
        essential: true,
        is_output: name == "gateway",
        cycle_budget_us: 0,
        end_to_end_us: 0,
        slow: SlowRule::default(),
        has_shadow: true,
        hot_shadow: false,
        heartbeat_timeout_s: 0.1,
        start_grace_s: 1.0,
        restart: RestartRule::default(),
        on_failure: OnFailure::Hold,
    }
}

/// A child as the operating system would have it.
#[derive(Clone, Debug, PartialEq)]
enum Child {
    None,
    /// With its generation and the state in its heartbeats; `None` = silent.
    Alive(u32, Option<ServiceState>),
}

/// A machine without an operating system: time, children and what was done, all in memory.
struct SimulatedHost {
    supervision: Supervision,
    now: Timestamp,
    children: Vec<Child>,
    /// Every spawn with its time.
    spawns: Vec<(usize, Timestamp)>,
    /// SIGTERM and SIGKILL in order.
    signals: Vec<Action>,
    events: Vec<u16>,
    texts: Vec<String>,
    clean_ups: usize,
    /// Second instances.
    shadows: Vec<Child>,
    commits: usize,
    taken_back: usize,
    progress: Vec<SwapProgress>,
    end: Option<End>,
    /// Whether children end on SIGTERM.
    obedient: bool,
    /// Whether silent children are so because they get no CPU.
    starved: bool,
}

impl SimulatedHost {
    fn new(rules: Vec<ProcessRules>) -> Self {
        let now = Timestamp::from_seconds(100.0);
        let rules_len = rules.len();
        Self {
            children: vec![Child::None; rules.len()],
            supervision: Supervision::new(rules, now, 1),
            now,
            spawns: Vec::new(),
            signals: Vec::new(),
            events: Vec::new(),
            texts: Vec::new(),
            clean_ups: 0,
            shadows: vec![Child::None; rules_len],
            commits: 0,
            taken_back: 0,
            progress: Vec::new(),
            end: None,
            obedient: true,
            starved: false,
        }
    }

    /// All children are in their loops and well.
    fn running(rules: Vec<ProcessRules>) -> Self {
        let mut host = Self::new(rules);
        for _ in 0..40 {
            host.pass(0.01);
            host.let_all_work();
        }
        assert!(host.supervision.is_up());
        assert_eq!(host.supervision.health(), Health::Healthy);
        host
    }

    fn let_all_work(&mut self) {
        for child in &mut self.children {
            if let Child::Alive(_, state @ None) = child {
                *state = Some(ServiceState::Active);
            }
        }
    }

    /// Lets `seconds` pass; children that are not silent send heartbeats; then one step, repeated while it starts
    /// something.
    fn pass(&mut self, seconds: f64) {
        self.now = self.now.plus_seconds(seconds);
        let beats: Vec<Observation> = self
            .children
            .iter()
            .enumerate()
            .filter_map(|(process, child)| match child {
                Child::Alive(generation, Some(state)) => Some(self.beat(process, *generation, *state)),
                _ => None,
            })
            .collect();
        self.observe(&beats);
    }

    fn beat(&self, process: usize, generation: u32, state: ServiceState) -> Observation {
        Observation::Heartbeat {
            process,
            heartbeat: Heartbeat {
                generation,
                state: Coded::new(state),
                ..Heartbeat::default()
            },
            time: self.now,
        }
    }

    fn die(&mut self, process: usize, exit: Exit) {
        assert_ne!(self.children[process], Child::None);
        self.children[process] = Child::None;
        self.observe(&[Observation::Died { process, exit }]);
    }

    fn observe(&mut self, observations: &[Observation]) {
        let mut actions = Vec::new();
        self.supervision.step(self.now, observations, &mut actions);
        let mut next = Vec::new();
        for action in &actions {
            match *action {
                Action::Spawn { process, generation } => {
                    assert_eq!(
                        self.children[process],
                        Child::None,
                        "two live children of one name"
                    );
                    self.children[process] = Child::Alive(generation, None);
                    self.spawns.push((process, self.now));
                    next.push(Observation::Spawned { process, pid: 7 });
                }
                Action::Terminate { process } => {
                    self.signals.push(*action);
                    assert_ne!(self.children[process], Child::None, "a signal for nobody");
                    if self.obedient {
                        self.children[process] = Child::None;
                        let exit = Exit::Code(0);
                        next.push(Observation::Died { process, exit });
                    }
                }
                Action::Inspect { process } => {
                    assert_ne!(self.children[process], Child::None, "nobody to examine");
                    next.push(Observation::Inspected {
                        process,
                        activity: if self.starved {
                            ProcessActivity::Runnable
                        } else {
                            ProcessActivity::Stopped
                        },
                        cpu_s: 0.0,
                        core_runs: true,
                    });
                }
                Action::Kill { process } => {
                    self.signals.push(*action);
                    assert_ne!(self.children[process], Child::None, "a signal for nobody");
                    self.children[process] = Child::None;
                    let exit = Exit::Signal(9);
                    next.push(Observation::Died { process, exit });
                }
                Action::SpawnShadow {
                    process, generation, ..
                } => {
                    assert_eq!(self.shadows[process], Child::None, "two shadows of one name");
                    self.shadows[process] = Child::Alive(generation, None);
                    next.push(Observation::ShadowSpawned { process, pid: 8 });
                }
                Action::KillShadow { process } => {
                    assert_ne!(self.shadows[process], Child::None, "a signal for nobody");
                    self.shadows[process] = Child::None;
                    let exit = Exit::Signal(9);
                    next.push(Observation::ShadowDied { process, exit });
                }
                Action::Promote { process } => {
                    let shadow = std::mem::replace(&mut self.shadows[process], Child::None);
                    self.shadows[process] = std::mem::replace(&mut self.children[process], shadow);
                }
                Action::Commit { .. } => self.commits += 1,
                Action::TakeBack { .. } => self.taken_back += 1,
                Action::ReportSwap { progress, .. } => self.progress.push(progress),
                Action::CleanUp => self.clean_ups += 1,
                Action::PublishEvent(event) => {
                    self.events.push(event.id);
                    self.texts.push(event.text());
                }
                Action::End(end) => {
                    assert!(
                        self.children.iter().all(|child| *child == Child::None),
                        "somebody is left behind"
                    );
                    self.end = Some(end);
                }
            }
        }
        if !next.is_empty() {
            self.observe(&next);
        }
    }

    fn status(&self) -> SystemStatus {
        let mut status = SystemStatus::default();
        self.supervision.write_status(&mut status);
        status
    }

    fn state(&self, process: usize) -> ServiceState {
        self.status().processes[process].state.get()
    }
}
