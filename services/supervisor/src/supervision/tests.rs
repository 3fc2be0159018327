use super::{Action, End, Exit, Observation, ProcessActivity, Supervision};
use crate::policy::RestartRule;
use crate::shadow::{SwapProgress, SwapRefusal};
use crate::slowness::SlowRule;
use crate::table::{OnFailure, ProcessRules};
use jink_shared_types::Timestamp;
use jink_shared_types::coded::Coded;
use jink_shared_types::control::{Control, ControlEntry};
use jink_shared_types::events;
use jink_shared_types::health::{Health, Heartbeat, ServiceState, SystemStatus};
use proptest::prelude::*;

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
    clean_ups: usize,
    /// Second instances.
    shadows: Vec<Child>,
    commits: usize,
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
            clean_ups: 0,
            shadows: vec![Child::None; rules_len],
            commits: 0,
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
                Action::ReportSwap { progress, .. } => self.progress.push(progress),
                Action::CleanUp => self.clean_ups += 1,
                Action::PublishEvent(event) => self.events.push(event.id),
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

#[test]
fn processes_start_in_order_and_an_essential_one_is_waited_for() {
    let extra = ProcessRules {
        essential: false,
        ..rules("b")
    };
    let mut host = SimulatedHost::new(vec![rules("a"), extra, rules("c")]);
    host.pass(0.01);
    assert_eq!(host.spawns.len(), 1, "a is not seen yet");
    host.children[0] = Child::Alive(1, Some(ServiceState::Starting));
    host.pass(0.01);
    let order: Vec<usize> = host.spawns.iter().map(|(process, _)| *process).collect();
    assert_eq!(order, [0, 1, 2], "nobody waits for what is not essential");
}

#[test]
fn a_process_without_heartbeat_holds_up_the_others_for_its_grace_only() {
    let mut host = SimulatedHost::new(vec![rules("a"), rules("b")]);
    for _ in 0..102 {
        host.pass(0.01);
    }
    assert!(host.spawns.iter().any(|(process, _)| *process == 1));
    assert!(
        host.signals.contains(&Action::Kill { process: 0 }),
        "and is a hang then"
    );
}

#[test]
fn standing_by_is_starting_and_all_active_is_healthy() {
    let mut host = SimulatedHost::new(vec![rules("a"), rules("b")]);
    for _ in 0..10 {
        host.pass(0.01);
        host.let_all_work();
    }
    assert_eq!(host.supervision.health(), Health::Healthy);
    assert_eq!(host.events, [events::AVOIDANCE_READY.id]);
    let mut waiting = SimulatedHost::new(vec![rules("a")]);
    waiting.pass(0.01);
    waiting.children[0] = Child::Alive(1, Some(ServiceState::Standby));
    waiting.pass(0.01);
    assert!(waiting.supervision.is_up());
    assert_eq!(waiting.supervision.health(), Health::Starting);
}

#[test]
fn a_dead_process_is_replaced_in_the_same_step_and_its_resources_are_removed_afterwards() {
    let mut host = SimulatedHost::running(vec![rules("a"), rules("b")]);
    let before = host.spawns.len();
    let died_at = host.now;
    let mut actions = Vec::new();
    host.supervision.step(
        host.now,
        &[Observation::Died {
            process: 1,
            exit: Exit::Signal(11),
        }],
        &mut actions,
    );
    let (spawn, clean_up) = (
        Action::Spawn {
            process: 1,
            generation: 2,
        },
        Action::CleanUp,
    );
    assert_eq!(actions, [spawn, clean_up]);
    assert_eq!(host.supervision.health(), Health::Degraded);
    host.children[1] = Child::Alive(2, Some(ServiceState::Starting));
    host.pass(0.004);
    assert_eq!(host.supervision.health(), Health::Degraded);
    host.children[1] = Child::Alive(2, Some(ServiceState::Active));
    host.pass(0.006);
    assert_eq!(host.supervision.health(), Health::Healthy);
    let status = host.status().processes[1];
    assert_eq!((status.restarts, status.last_exit), (1, 256 + 11));
    let outage_us = (host.now.seconds_since(died_at) * 1e6).round() as u32;
    assert!(
        status.recovery_us.abs_diff(outage_us) <= 1,
        "{} of {outage_us}",
        status.recovery_us
    );
    assert_eq!(host.events.last(), Some(&events::PROCESS_RESTARTED.id));
    assert_eq!(host.spawns.len(), before, "and nothing else was started");
}

#[test]
fn a_late_heartbeat_of_the_dead_does_not_pass_for_its_replacement() {
    let mut host = SimulatedHost::running(vec![rules("a")]);
    host.die(0, Exit::Signal(9));
    let late = host.beat(0, 1, ServiceState::Active);
    host.observe(&[late]);
    assert_eq!(host.state(0), ServiceState::Starting);
}

#[test]
fn the_last_heartbeat_of_the_dead_is_no_recovery() {
    let mut host = SimulatedHost::running(vec![rules("a")]);
    let last_word = host.beat(0, 1, ServiceState::Active);
    host.now = host.now.plus_seconds(0.02);
    host.children[0] = Child::None;
    let death = Observation::Died {
        process: 0,
        exit: Exit::Signal(9),
    };
    host.observe(&[death, last_word]);
    assert_eq!(host.events, [events::AVOIDANCE_READY.id]);
    assert_eq!(
        (host.state(0), host.status().processes[0].recovery_us),
        (ServiceState::Starting, 0)
    );
}

#[test]
fn silence_beyond_the_timeout_is_a_hang_and_the_process_is_replaced() {
    let mut host = SimulatedHost::running(vec![rules("a"), rules("b")]);
    host.children[0] = Child::Alive(1, None);
    for _ in 0..9 {
        host.pass(0.01);
    }
    assert!(host.signals.is_empty(), "one late heartbeat is no hang");
    for _ in 0..3 {
        host.pass(0.01);
    }
    assert_eq!(host.signals, [Action::Kill { process: 0 }]);
    assert!(host.events.contains(&events::PROCESS_HUNG.id));
    assert!(matches!(host.children[0], Child::Alive(2, None)));
}

#[test]
fn a_process_that_gets_no_cpu_is_not_replaced_unless_it_lasts() {
    let mut host = SimulatedHost::running(vec![rules("a"), rules("b")]);
    host.starved = true;
    host.children[0] = Child::Alive(1, None);
    for _ in 0..140 {
        host.pass(0.01);
    }
    assert!(host.signals.is_empty(), "its replacement would get no CPU either");
    for _ in 0..20 {
        host.pass(0.01);
    }
    assert_eq!(
        host.signals,
        [Action::Kill { process: 0 }],
        "after fifteen times the time allowed"
    );
}

#[test]
fn a_process_that_loops_without_an_end_is_not_taken_for_starved() {
    let mut host = SimulatedHost::running(vec![rules("a")]);
    host.now = host.now.plus_seconds(0.101);
    let looping = Observation::Inspected {
        process: 0,
        activity: ProcessActivity::Runnable,
        cpu_s: 0.09,
        core_runs: true,
    };
    let mut actions = Vec::new();
    host.supervision.step(host.now, &[looping], &mut actions);
    assert!(actions.contains(&Action::Kill { process: 0 }), "{actions:?}");
}

#[test]
fn on_a_core_that_stands_still_no_process_is_judged_by_what_it_seems_to_do() {
    for (activity, replaced) in [
        (ProcessActivity::Runnable, false),
        (ProcessActivity::Sleeping, false),
        (ProcessActivity::Stopped, true),
    ] {
        let mut host = SimulatedHost::running(vec![rules("a")]);
        host.now = host.now.plus_seconds(0.4);
        let seen = Observation::Inspected {
            process: 0,
            activity,
            cpu_s: 0.09,
            core_runs: false,
        };
        let mut actions = Vec::new();
        host.supervision.step(host.now, &[seen], &mut actions);
        let killed = actions.contains(&Action::Kill { process: 0 });
        assert_eq!(killed, replaced, "{activity:?}: {actions:?}");
    }
}

#[test]
fn a_stall_of_the_whole_machine_is_no_hang() {
    let mut host = SimulatedHost::running(vec![rules("a"), rules("b")]);
    host.now = host.now.plus_seconds(5.0);
    host.observe(&[]);
    assert!(
        host.signals.is_empty(),
        "everybody was silent, the supervisor too"
    );
    host.children[0] = Child::Alive(1, None);
    for _ in 0..12 {
        host.pass(0.01);
    }
    assert_eq!(
        host.signals,
        [Action::Kill { process: 0 }],
        "who stays silent hangs"
    );
}

#[test]
fn a_start_that_cannot_work_is_not_retried_but_shown() {
    let mut host = SimulatedHost::new(vec![rules("a"), rules("b")]);
    host.pass(0.01);
    host.let_all_work();
    host.pass(0.01);
    host.die(1, CANNOT_START);
    assert_eq!(host.end, Some(End::CannotStart { process: 1 }));
    assert_eq!(host.signals, [Action::Terminate { process: 0 }]);
}

#[test]
fn in_flight_what_cannot_start_is_retried_at_the_longest_delay() {
    let mut host = SimulatedHost::running(vec![rules("a")]);
    host.die(0, Exit::Signal(9));
    host.die(0, CANNOT_START);
    let refused_at = host.now;
    while host.spawns.len() < 3 {
        host.pass(0.01);
    }
    let delay_s = host.now.seconds_since(refused_at);
    assert!(
        (delay_s - RestartRule::default().ceiling_s).abs() < 0.02,
        "{delay_s}"
    );
    assert_eq!(host.end, None);
}

#[test]
fn what_is_not_essential_never_keeps_the_system_from_starting() {
    let extra = ProcessRules {
        essential: false,
        ..rules("b")
    };
    let mut host = SimulatedHost::new(vec![rules("a"), extra]);
    host.pass(0.01);
    host.let_all_work();
    host.pass(0.01);
    host.die(1, CANNOT_START);
    assert_eq!((host.end, host.supervision.health()), (None, Health::Healthy));
}

fn given_up(on_failure: OnFailure) -> SimulatedHost {
    let mut loser = rules("loser");
    loser.on_failure = on_failure;
    loser.restart.intensity = 2;
    let mut host = SimulatedHost::running(vec![rules("gateway"), loser]);
    for _ in 0..3 {
        while host.children[1] == Child::None {
            host.pass(0.005);
        }
        host.die(1, Exit::Code(1));
    }
    host
}

#[test]
fn a_process_that_is_given_up_stays_down_and_its_row_says_what_follows() {
    for on_failure in [OnFailure::Hold, OnFailure::Ignore, OnFailure::StopOutput] {
        let mut host = given_up(on_failure);
        let spawned = host.spawns.len();
        for _ in 0..2_000 {
            host.pass(0.01);
        }
        assert_eq!(host.spawns.len(), spawned);
        assert_eq!(host.state(1), ServiceState::Failed);
        assert!(host.events.contains(&events::PROCESS_FAILED.id));
        let (health, output_runs) = match on_failure {
            OnFailure::Ignore => (Health::Degraded, true),
            OnFailure::StopOutput => (Health::Failed, false),
            _ => (Health::Failed, true),
        };
        assert_eq!(host.supervision.health(), health, "{on_failure:?}");
        assert_eq!(host.children[0] != Child::None, output_runs, "{on_failure:?}");
    }
    assert_eq!(
        given_up(OnFailure::Shutdown).end,
        Some(End::GaveUp { process: 1 })
    );
}

#[test]
fn a_stop_goes_backwards_and_kills_what_ignores_sigterm() {
    let mut host = SimulatedHost::running(vec![rules("a"), rules("b"), rules("c")]);
    host.obedient = false;
    host.observe(&[Observation::StopRequested]);
    assert_eq!(host.supervision.health(), Health::Stopping);
    for _ in 0..320 {
        host.pass(0.01);
    }
    let order: Vec<Action> = (0..3)
        .rev()
        .flat_map(|process| [Action::Terminate { process }, Action::Kill { process }])
        .collect();
    assert_eq!(host.signals, order);
    assert_eq!(host.end, Some(End::Stopped));
}

#[test]
fn the_machine_asks_to_be_woken_in_time_for_a_hang() {
    let host = SimulatedHost::running(vec![rules("a")]);
    let wait_s = host.supervision.next_wake(host.now).seconds_since(host.now);
    assert!((wait_s - 0.1).abs() < 1e-6, "{wait_s}");
}

/// What may happen to the processes.
#[derive(Clone, Debug)]
enum Incident {
    Pass(f64),
    Die(usize, Exit),
    FallSilent(usize),
    Speak(usize, ServiceState),
    Disobey,
    Starve,
    Stop,
}

fn incident() -> impl Strategy<Value = Incident> {
    let exit = prop_oneof![Just(Exit::Code(1)), Just(CANNOT_START), Just(Exit::Signal(11))];
    let state = prop_oneof![
        Just(ServiceState::Active),
        Just(ServiceState::Standby),
        Just(ServiceState::Degraded)
    ];
    prop_oneof![
        8 => (0.001..0.06f64).prop_map(Incident::Pass),
        3 => (0..3usize, exit).prop_map(|(process, exit)| Incident::Die(process, exit)),
        2 => (0..3usize).prop_map(Incident::FallSilent),
        6 => (0..3usize, state).prop_map(|(process, state)| Incident::Speak(process, state)),
        1 => Just(Incident::Disobey),
        1 => Just(Incident::Starve),
        1 => Just(Incident::Stop),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Whatever happens: never two children of one name and never a signal without a child (asserted by the host),
    /// never more restarts than the intensity allows, nothing started after a stop, and at the end of a stop no child
    /// is left.
    #[test]
    fn no_incident_leads_to_a_restart_storm_or_an_orphan(
        fates in proptest::collection::vec(incident(), 1..400),
        intensity in 0..5u32,
        period_s in 0.2..3.0f64,
    ) {
        let rule = RestartRule { intensity, period_s, ..RestartRule::default() };
        let three = ["gateway", "b", "c"].map(|name| ProcessRules { restart: rule, ..rules(name) });
        let mut host = SimulatedHost::new(three.to_vec());
        let mut stopped_after = None;
        for incident in fates {
            match incident {
                Incident::Pass(seconds) => host.pass(seconds),
                Incident::Die(process, exit) if host.children[process] != Child::None => host.die(process, exit),
                Incident::FallSilent(process) => {
                    if let Child::Alive(_, state) = &mut host.children[process] {
                        *state = None;
                    }
                }
                Incident::Speak(process, said) => {
                    if let Child::Alive(_, state) = &mut host.children[process] {
                        *state = Some(said);
                    }
                }
                Incident::Disobey => host.obedient = false,
                Incident::Starve => host.starved = !host.starved,
                Incident::Stop => {
                    host.observe(&[Observation::StopRequested]);
                    stopped_after.get_or_insert(host.spawns.len());
                }
                Incident::Die(..) => {}
            }
        }
        for process in 0..3 {
            let times: Vec<Timestamp> =
                host.spawns.iter().filter(|(spawned, _)| *spawned == process).map(|(_, at)| *at).collect();
            let restarts = times.get(1..).unwrap_or(&[]);
            for (index, last) in restarts.iter().enumerate() {
                let within = restarts[..=index].iter().filter(|at| last.seconds_since(**at) < period_s).count();
                prop_assert!(within <= intensity as usize);
            }
        }
        host.observe(&[Observation::StopRequested]);
        stopped_after.get_or_insert(host.spawns.len());
        for _ in 0..400 {
            host.pass(0.01);
        }
        prop_assert!(host.end.is_some());
        if let (Some(End::Stopped), Some(spawns)) = (host.end, stopped_after) {
            prop_assert_eq!(host.spawns.len(), spawns, "something was started after the stop");
        }
    }
}

/// A swap of the only process, its candidate in its loop and in probation.
fn in_probation(cycles: u64) -> SimulatedHost {
    let mut host = SimulatedHost::running(vec![rules("a")]);
    host.observe(&[Observation::SwapRequested {
        process: 0,
        cycles,
        dry_run: false,
    }]);
    host.pass(0.01);
    assert!(
        matches!(host.shadows[0], Child::Alive(2, None)),
        "{:?}",
        host.shadows
    );
    host
}

/// One pass with a heartbeat of the owner and one of the second instance, whichever they are now.
fn pass_both(host: &mut SimulatedHost, seconds: f64, cycles: u64, misses: u64) {
    let beat = |generation: u32, misses: u64, host: &SimulatedHost| Observation::Heartbeat {
        process: 0,
        heartbeat: Heartbeat {
            generation,
            state: Coded::new(ServiceState::Active),
            cycles,
            budget_misses: misses,
            outputs: cycles,
            ..Heartbeat::default()
        },
        time: host.now,
    };
    host.now = host.now.plus_seconds(seconds);
    let mut beats = Vec::new();
    if let Child::Alive(generation, _) = host.children[0] {
        beats.push(beat(generation, 0, host));
    }
    if let Child::Alive(generation, _) = host.shadows[0] {
        beats.push(beat(generation, misses, host));
    }
    host.observe(&beats);
}

fn control(host: &SimulatedHost) -> ControlEntry {
    let mut control = Control::default();
    host.supervision.write_control(&mut control);
    control.entries[0]
}

#[test]
fn a_good_candidate_takes_over_at_a_moment_that_both_know_before_and_the_old_one_goes_last() {
    let mut host = in_probation(20);
    let mut cycles = 100;
    while host.signals.is_empty() && host.commits == 0 && cycles < 400 {
        cycles += 1;
        pass_both(&mut host, 0.05, cycles, 0);
        let entry = control(&host);
        if entry.next != 0 {
            assert_eq!((entry.active, entry.next), (1, 2));
        }
    }
    assert!(
        matches!(
            host.progress[..],
            [
                SwapProgress::Probation { .. },
                SwapProgress::Switching { .. },
                SwapProgress::Switched,
                SwapProgress::Done
            ]
        ),
        "{:?}",
        host.progress
    );
    assert_eq!(host.commits, 1);
    assert!(
        matches!(host.children[0], Child::Alive(2, _)),
        "{:?}",
        host.children
    );
    assert_eq!(host.shadows[0], Child::None);
    let entry = control(&host);
    assert_eq!((entry.active, entry.next, entry.epoch), (2, 0, 2));
    assert!(
        host.signals.is_empty(),
        "the owner was never touched: {:?}",
        host.signals
    );
}

#[test]
fn without_a_shadow_a_swap_ends_the_old_one_and_starts_the_new_program_at_once() {
    let alone = ProcessRules {
        has_shadow: false,
        ..rules("gateway")
    };
    let mut host = SimulatedHost::running(vec![alone]);
    let swap = |dry_run| Observation::SwapRequested {
        process: 0,
        cycles: 50,
        dry_run,
    };
    host.observe(&[swap(true)]);
    assert_eq!(host.progress, [SwapProgress::Refused(SwapRefusal::NoShadow)]);
    assert!(host.signals.is_empty() && host.commits == 0);
    host.observe(&[swap(false)]);
    assert_eq!(host.progress.last(), Some(&SwapProgress::Replaced));
    for _ in 0..3 {
        host.pass(0.01);
    }
    assert_eq!(host.signals, [Action::Terminate { process: 0 }]);
    assert_eq!((host.commits, host.spawns.len()), (1, 2));
    assert!(
        matches!(host.children[0], Child::Alive(2, _)),
        "{:?}",
        host.children
    );
    assert_eq!(control(&host).active, 2);
}

#[test]
fn a_slow_candidate_and_one_that_dies_are_refused_and_the_owner_never_notices() {
    let mut slow = in_probation(20);
    for step in 1..60 {
        pass_both(&mut slow, 0.05, 100 + step, step);
    }
    assert!(
        matches!(
            slow.progress.last(),
            Some(SwapProgress::Refused(SwapRefusal::OverBudget(_)))
        ),
        "{:?}",
        slow.progress
    );
    let mut dying = in_probation(20);
    dying.shadows[0] = Child::None;
    let exit = Exit::Signal(11);
    dying.observe(&[Observation::ShadowDied { process: 0, exit }]);
    assert_eq!(dying.progress, [SwapProgress::Refused(SwapRefusal::Ended(exit))]);
    for host in [&slow, &dying] {
        assert_eq!(host.children[0], Child::Alive(1, Some(ServiceState::Active)));
        assert_eq!((control(host).active, control(host).next), (1, 0));
        assert!(host.signals.is_empty());
    }
}

#[test]
fn a_candidate_that_dies_as_owner_is_rolled_back_at_once_in_a_new_epoch() {
    let mut host = in_probation(20);
    let mut cycles = 100;
    while !host.progress.contains(&SwapProgress::Switched) && cycles < 400 {
        cycles += 1;
        pass_both(&mut host, 0.05, cycles, 0);
    }
    host.children[0] = Child::None;
    let exit = Exit::Signal(6);
    host.observe(&[Observation::Died { process: 0, exit }]);
    assert_eq!(
        host.progress.last(),
        Some(&SwapProgress::RolledBack(SwapRefusal::Ended(exit)))
    );
    assert!(
        matches!(host.children[0], Child::Alive(1, _)),
        "{:?}",
        host.children
    );
    let entry = control(&host);
    assert_eq!((entry.active, entry.next), (1, 0));
    assert!(
        entry.epoch > 2,
        "readers must take it for newer than the candidate"
    );
    assert_eq!(host.commits, 0);
}

#[test]
fn a_candidate_that_dies_in_the_moment_of_the_switch_leaves_an_owner_in_a_new_epoch() {
    let mut host = in_probation(20);
    let mut cycles = 100;
    while control(&host).next == 0 && cycles < 400 {
        cycles += 1;
        pass_both(&mut host, 0.05, cycles, 0);
    }
    host.shadows[0] = Child::None;
    let exit = Exit::Signal(6);
    host.observe(&[Observation::ShadowDied { process: 0, exit }]);
    assert_eq!(
        host.progress.last(),
        Some(&SwapProgress::RolledBack(SwapRefusal::Ended(exit)))
    );
    let entry = control(&host);
    assert_eq!((entry.active, entry.next), (1, 0));
    assert!(entry.epoch > 2, "the candidate may have published already");
    assert!(host.signals.is_empty());
}

#[test]
fn a_hot_shadow_takes_over_without_a_start_and_gets_a_successor() {
    let hot = ProcessRules {
        hot_shadow: true,
        ..rules("a")
    };
    let mut host = SimulatedHost::running(vec![hot]);
    for step in 0..60 {
        pass_both(&mut host, 0.05, 100 + step, 0);
    }
    let spawns = host.spawns.len();
    assert!(
        matches!(host.shadows[0], Child::Alive(2, _)),
        "{:?}",
        host.shadows
    );
    host.die(0, Exit::Signal(9));
    assert!(
        matches!(host.children[0], Child::Alive(2, _)),
        "{:?}",
        host.children
    );
    assert_eq!(host.spawns.len(), spawns, "nothing had to be started");
    assert_eq!((control(&host).active, control(&host).next), (2, 0));
    for step in 60..160 {
        pass_both(&mut host, 0.05, 100 + step, 0);
    }
    assert!(
        matches!(host.shadows[0], Child::Alive(3, _)),
        "{:?}",
        host.shadows
    );
}

#[test]
fn most_of_them_silent_at_once_is_the_machine_and_nobody_is_killed() {
    let mut host = SimulatedHost::running(vec![rules("a"), rules("b"), rules("c")]);
    for child in &mut host.children {
        if let Child::Alive(_, state) = child {
            *state = None;
        }
    }
    for _ in 0..80 {
        host.pass(0.01);
    }
    assert!(host.signals.is_empty(), "{:?}", host.signals);
    host.let_all_work();
    host.pass(0.01);
    assert_eq!(host.supervision.health(), Health::Healthy);
}

proptest! {
    /// Whatever dies, hangs or is requested, and succeeds or fails: there is never more than one owner, never a signal
    /// without a child, and at the end of the system no child is left.
    #[test]
    fn swaps_and_deaths_in_any_order_leave_one_owner(story in proptest::collection::vec((0..7u8, 1..8u64), 1..120)) {
        let hot = ProcessRules { hot_shadow: true, ..rules("a") };
        let mut host = SimulatedHost::running(vec![hot]);
        let mut cycles = 1000;
        for (what, amount) in story {
            match what {
                0 => host.observe(&[Observation::SwapRequested { process: 0, cycles: 5 * amount, dry_run: amount == 1 }]),
                1 if host.children[0] != Child::None => host.die(0, Exit::Signal(9)),
                2 if host.shadows[0] != Child::None => {
                    host.shadows[0] = Child::None;
                    host.observe(&[Observation::ShadowDied { process: 0, exit: Exit::Code(1) }]);
                }
                3 => host.observe(&[Observation::RestartRequested { process: 0 }]),
                4 => host.pass(0.02 * amount as f64),
                _ => for _ in 0..4 * amount {
                    cycles += 2;
                    pass_both(&mut host, 0.05, cycles, 0);
                },
            }
            let entry = control(&host);
            if let (Child::Alive(main, _), true) = (&host.children[0], entry.next == 0) {
                prop_assert_eq!(entry.active, *main, "the control record names who is in charge");
            }
            if let (Child::Alive(main, _), Child::Alive(shadow, _)) = (&host.children[0], &host.shadows[0]) {
                prop_assert_ne!(main, shadow);
            }
        }
        host.observe(&[Observation::StopRequested]);
        for _ in 0..20 {
            host.pass(0.1);
        }
        prop_assert_eq!(host.end, Some(End::Stopped));
        prop_assert_eq!(&host.shadows[0], &Child::None);
    }
}
