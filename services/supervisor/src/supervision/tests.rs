use super::{Action, Doing, End, Exit, Observation, Supervision};
use crate::policy::RestartRule;
use crate::shadow::{Refusal, SwapNews};
use crate::slowness::SlowRule;
use crate::table::{OnFailure, Rules};
use jink_shared_types::Timestamp;
use jink_shared_types::coded::Coded;
use jink_shared_types::control::{Control, ControlEntry};
use jink_shared_types::events;
use jink_shared_types::health::{Health, Heartbeat, ServiceState, SystemStatus};
use proptest::prelude::*;

const CANNOT_START: Exit = Exit::Code(78);

fn rules(name: &str) -> Rules {
    Rules {
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
    /// With its generation and the state its heartbeats say; `None` = silent.
    Alive(u32, Option<ServiceState>),
}

/// A machine without an operating system: time, children and what was done, all in memory.
struct World {
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
    news: Vec<SwapNews>,
    end: Option<End>,
    /// Whether children obey SIGTERM.
    obedient: bool,
    /// Whether silent children are so because they get no CPU.
    starved: bool,
}

impl World {
    fn new(rules: Vec<Rules>) -> Self {
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
            news: Vec::new(),
            end: None,
            obedient: true,
            starved: false,
        }
    }

    /// All children are in their loops and well.
    fn running(rules: Vec<Rules>) -> Self {
        let mut world = Self::new(rules);
        for _ in 0..40 {
            world.pass(0.01);
            world.let_all_work();
        }
        assert!(world.supervision.is_up());
        assert_eq!(world.supervision.health(), Health::Healthy);
        world
    }

    fn let_all_work(&mut self) {
        for child in &mut self.children {
            if let Child::Alive(_, state @ None) = child {
                *state = Some(ServiceState::Active);
            }
        }
    }

    /// Lets `seconds` pass; children that are not silent beat; then one step, repeated while it starts something.
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
                Action::Examine { process } => {
                    assert_ne!(self.children[process], Child::None, "nobody to examine");
                    next.push(Observation::Examined {
                        process,
                        doing: if self.starved {
                            Doing::Runnable
                        } else {
                            Doing::Stopped
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
                Action::Tell { news, .. } => self.news.push(news),
                Action::CleanUp => self.clean_ups += 1,
                Action::Raise(event) => self.events.push(event.id),
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
    let extra = Rules {
        essential: false,
        ..rules("b")
    };
    let mut world = World::new(vec![rules("a"), extra, rules("c")]);
    world.pass(0.01);
    assert_eq!(world.spawns.len(), 1, "a is not heard yet");
    world.children[0] = Child::Alive(1, Some(ServiceState::Starting));
    world.pass(0.01);
    let order: Vec<usize> = world.spawns.iter().map(|(process, _)| *process).collect();
    assert_eq!(order, [0, 1, 2], "nobody waits for what is not essential");
}

#[test]
fn a_process_that_is_never_heard_holds_up_the_others_for_its_grace_only() {
    let mut world = World::new(vec![rules("a"), rules("b")]);
    for _ in 0..102 {
        world.pass(0.01);
    }
    assert!(world.spawns.iter().any(|(process, _)| *process == 1));
    assert!(
        world.signals.contains(&Action::Kill { process: 0 }),
        "and is a hang then"
    );
}

#[test]
fn standing_by_is_starting_and_all_active_is_healthy() {
    let mut world = World::new(vec![rules("a"), rules("b")]);
    for _ in 0..10 {
        world.pass(0.01);
        world.let_all_work();
    }
    assert_eq!(world.supervision.health(), Health::Healthy);
    assert_eq!(world.events, [events::AVOIDANCE_READY.id]);
    let mut waiting = World::new(vec![rules("a")]);
    waiting.pass(0.01);
    waiting.children[0] = Child::Alive(1, Some(ServiceState::Standby));
    waiting.pass(0.01);
    assert!(waiting.supervision.is_up());
    assert_eq!(waiting.supervision.health(), Health::Starting);
}

#[test]
fn a_dead_process_is_replaced_in_the_same_step_and_its_remains_go_afterwards() {
    let mut world = World::running(vec![rules("a"), rules("b")]);
    let before = world.spawns.len();
    let died_at = world.now;
    let mut actions = Vec::new();
    world.supervision.step(
        world.now,
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
    assert_eq!(world.supervision.health(), Health::Degraded);
    world.children[1] = Child::Alive(2, Some(ServiceState::Starting));
    world.pass(0.004);
    assert_eq!(world.supervision.health(), Health::Degraded);
    world.children[1] = Child::Alive(2, Some(ServiceState::Active));
    world.pass(0.006);
    assert_eq!(world.supervision.health(), Health::Healthy);
    let status = world.status().processes[1];
    assert_eq!((status.restarts, status.last_exit), (1, 256 + 11));
    let outage_us = (world.now.seconds_since(died_at) * 1e6).round() as u32;
    assert!(
        status.recovery_us.abs_diff(outage_us) <= 1,
        "{} of {outage_us}",
        status.recovery_us
    );
    assert_eq!(world.events.last(), Some(&events::PROCESS_RESTARTED.id));
    assert_eq!(world.spawns.len(), before, "and nothing else was started");
}

#[test]
fn a_late_heartbeat_of_the_dead_does_not_pass_for_its_replacement() {
    let mut world = World::running(vec![rules("a")]);
    world.die(0, Exit::Signal(9));
    let late = world.beat(0, 1, ServiceState::Active);
    world.observe(&[late]);
    assert_eq!(world.state(0), ServiceState::Starting);
}

#[test]
fn the_last_word_of_the_dead_is_no_recovery() {
    let mut world = World::running(vec![rules("a")]);
    let last_word = world.beat(0, 1, ServiceState::Active);
    world.now = world.now.plus_seconds(0.02);
    world.children[0] = Child::None;
    let death = Observation::Died {
        process: 0,
        exit: Exit::Signal(9),
    };
    world.observe(&[death, last_word]);
    assert_eq!(world.events, [events::AVOIDANCE_READY.id]);
    assert_eq!(
        (world.state(0), world.status().processes[0].recovery_us),
        (ServiceState::Starting, 0)
    );
}

#[test]
fn silence_beyond_the_timeout_is_a_hang_and_the_process_is_replaced() {
    let mut world = World::running(vec![rules("a"), rules("b")]);
    world.children[0] = Child::Alive(1, None);
    for _ in 0..9 {
        world.pass(0.01);
    }
    assert!(world.signals.is_empty(), "one late heartbeat is no hang");
    for _ in 0..3 {
        world.pass(0.01);
    }
    assert_eq!(world.signals, [Action::Kill { process: 0 }]);
    assert!(world.events.contains(&events::PROCESS_HUNG.id));
    assert!(matches!(world.children[0], Child::Alive(2, None)));
}

#[test]
fn a_process_that_gets_no_cpu_is_not_replaced_unless_it_lasts() {
    let mut world = World::running(vec![rules("a"), rules("b")]);
    world.starved = true;
    world.children[0] = Child::Alive(1, None);
    for _ in 0..140 {
        world.pass(0.01);
    }
    assert!(
        world.signals.is_empty(),
        "its replacement would get no CPU either"
    );
    for _ in 0..20 {
        world.pass(0.01);
    }
    assert_eq!(
        world.signals,
        [Action::Kill { process: 0 }],
        "after fifteen times the time allowed"
    );
}

#[test]
fn a_process_that_loops_without_an_end_is_not_taken_for_starved() {
    let mut world = World::running(vec![rules("a")]);
    world.now = world.now.plus_seconds(0.101);
    let looping = Observation::Examined {
        process: 0,
        doing: Doing::Runnable,
        cpu_s: 0.09,
        core_runs: true,
    };
    let mut actions = Vec::new();
    world.supervision.step(world.now, &[looping], &mut actions);
    assert!(actions.contains(&Action::Kill { process: 0 }), "{actions:?}");
}

#[test]
fn on_a_core_that_stands_still_nobody_is_judged_by_what_he_seems_to_do() {
    for (doing, replaced) in [
        (Doing::Runnable, false),
        (Doing::Sleeping, false),
        (Doing::Stopped, true),
    ] {
        let mut world = World::running(vec![rules("a")]);
        world.now = world.now.plus_seconds(0.4);
        let seen = Observation::Examined {
            process: 0,
            doing,
            cpu_s: 0.09,
            core_runs: false,
        };
        let mut actions = Vec::new();
        world.supervision.step(world.now, &[seen], &mut actions);
        let killed = actions.contains(&Action::Kill { process: 0 });
        assert_eq!(killed, replaced, "{doing:?}: {actions:?}");
    }
}

#[test]
fn a_stall_of_the_whole_machine_is_nobodys_hang() {
    let mut world = World::running(vec![rules("a"), rules("b")]);
    world.now = world.now.plus_seconds(5.0);
    world.observe(&[]);
    assert!(
        world.signals.is_empty(),
        "everybody was silent, the supervisor too"
    );
    world.children[0] = Child::Alive(1, None);
    for _ in 0..12 {
        world.pass(0.01);
    }
    assert_eq!(
        world.signals,
        [Action::Kill { process: 0 }],
        "who stays silent hangs"
    );
}

#[test]
fn a_start_that_cannot_work_is_not_retried_but_shown() {
    let mut world = World::new(vec![rules("a"), rules("b")]);
    world.pass(0.01);
    world.let_all_work();
    world.pass(0.01);
    world.die(1, CANNOT_START);
    assert_eq!(world.end, Some(End::CannotStart { process: 1 }));
    assert_eq!(world.signals, [Action::Terminate { process: 0 }]);
}

#[test]
fn in_flight_what_cannot_start_is_retried_at_the_longest_delay() {
    let mut world = World::running(vec![rules("a")]);
    world.die(0, Exit::Signal(9));
    world.die(0, CANNOT_START);
    let refused_at = world.now;
    while world.spawns.len() < 3 {
        world.pass(0.01);
    }
    let delay_s = world.now.seconds_since(refused_at);
    assert!(
        (delay_s - RestartRule::default().ceiling_s).abs() < 0.02,
        "{delay_s}"
    );
    assert_eq!(world.end, None);
}

#[test]
fn what_is_not_essential_never_keeps_the_system_from_starting() {
    let extra = Rules {
        essential: false,
        ..rules("b")
    };
    let mut world = World::new(vec![rules("a"), extra]);
    world.pass(0.01);
    world.let_all_work();
    world.pass(0.01);
    world.die(1, CANNOT_START);
    assert_eq!((world.end, world.supervision.health()), (None, Health::Healthy));
}

fn given_up(on_failure: OnFailure) -> World {
    let mut loser = rules("loser");
    loser.on_failure = on_failure;
    loser.restart.intensity = 2;
    let mut world = World::running(vec![rules("gateway"), loser]);
    for _ in 0..3 {
        while world.children[1] == Child::None {
            world.pass(0.005);
        }
        world.die(1, Exit::Code(1));
    }
    world
}

#[test]
fn a_process_that_is_given_up_stays_down_and_its_row_says_what_follows() {
    for on_failure in [OnFailure::Hold, OnFailure::Ignore, OnFailure::StopOutput] {
        let mut world = given_up(on_failure);
        let spawned = world.spawns.len();
        for _ in 0..2_000 {
            world.pass(0.01);
        }
        assert_eq!(world.spawns.len(), spawned);
        assert_eq!(world.state(1), ServiceState::Failed);
        assert!(world.events.contains(&events::PROCESS_FAILED.id));
        let (health, output_runs) = match on_failure {
            OnFailure::Ignore => (Health::Degraded, true),
            OnFailure::StopOutput => (Health::Failed, false),
            _ => (Health::Failed, true),
        };
        assert_eq!(world.supervision.health(), health, "{on_failure:?}");
        assert_eq!(world.children[0] != Child::None, output_runs, "{on_failure:?}");
    }
    assert_eq!(
        given_up(OnFailure::Shutdown).end,
        Some(End::GaveUp { process: 1 })
    );
}

#[test]
fn a_stop_goes_backwards_and_kills_who_does_not_obey() {
    let mut world = World::running(vec![rules("a"), rules("b"), rules("c")]);
    world.obedient = false;
    world.observe(&[Observation::StopRequested]);
    assert_eq!(world.supervision.health(), Health::Stopping);
    for _ in 0..320 {
        world.pass(0.01);
    }
    let order: Vec<Action> = (0..3)
        .rev()
        .flat_map(|process| [Action::Terminate { process }, Action::Kill { process }])
        .collect();
    assert_eq!(world.signals, order);
    assert_eq!(world.end, Some(End::Stopped));
}

#[test]
fn the_machine_asks_to_be_woken_in_time_for_a_hang() {
    let world = World::running(vec![rules("a")]);
    let wait_s = world.supervision.next_wake(world.now).seconds_since(world.now);
    assert!((wait_s - 0.1).abs() < 1e-6, "{wait_s}");
}

/// What may befall the processes.
#[derive(Clone, Debug)]
enum Fate {
    Pass(f64),
    Die(usize, Exit),
    FallSilent(usize),
    Speak(usize, ServiceState),
    Disobey,
    Starve,
    Stop,
}

fn fate() -> impl Strategy<Value = Fate> {
    let exit = prop_oneof![Just(Exit::Code(1)), Just(CANNOT_START), Just(Exit::Signal(11))];
    let state = prop_oneof![
        Just(ServiceState::Active),
        Just(ServiceState::Standby),
        Just(ServiceState::Degraded)
    ];
    prop_oneof![
        8 => (0.001..0.06f64).prop_map(Fate::Pass),
        3 => (0..3usize, exit).prop_map(|(process, exit)| Fate::Die(process, exit)),
        2 => (0..3usize).prop_map(Fate::FallSilent),
        6 => (0..3usize, state).prop_map(|(process, state)| Fate::Speak(process, state)),
        1 => Just(Fate::Disobey),
        1 => Just(Fate::Starve),
        1 => Just(Fate::Stop),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Whatever happens: never two children of one name and never a signal for nobody (asserted by the world), never more
    /// restarts than the intensity allows, nothing started after a stop, and a stop always ends with nobody left.
    #[test]
    fn no_fate_leads_to_a_restart_storm_or_an_orphan(
        fates in proptest::collection::vec(fate(), 1..400),
        intensity in 0..5u32,
        period_s in 0.2..3.0f64,
    ) {
        let rule = RestartRule { intensity, period_s, ..RestartRule::default() };
        let three = ["gateway", "b", "c"].map(|name| Rules { restart: rule, ..rules(name) });
        let mut world = World::new(three.to_vec());
        let mut stopped_after = None;
        for fate in fates {
            match fate {
                Fate::Pass(seconds) => world.pass(seconds),
                Fate::Die(process, exit) if world.children[process] != Child::None => world.die(process, exit),
                Fate::FallSilent(process) => {
                    if let Child::Alive(_, state) = &mut world.children[process] {
                        *state = None;
                    }
                }
                Fate::Speak(process, said) => {
                    if let Child::Alive(_, state) = &mut world.children[process] {
                        *state = Some(said);
                    }
                }
                Fate::Disobey => world.obedient = false,
                Fate::Starve => world.starved = !world.starved,
                Fate::Stop => {
                    world.observe(&[Observation::StopRequested]);
                    stopped_after.get_or_insert(world.spawns.len());
                }
                Fate::Die(..) => {}
            }
        }
        for process in 0..3 {
            let times: Vec<Timestamp> =
                world.spawns.iter().filter(|(spawned, _)| *spawned == process).map(|(_, at)| *at).collect();
            let restarts = times.get(1..).unwrap_or(&[]);
            for (index, last) in restarts.iter().enumerate() {
                let within = restarts[..=index].iter().filter(|at| last.seconds_since(**at) < period_s).count();
                prop_assert!(within <= intensity as usize);
            }
        }
        world.observe(&[Observation::StopRequested]);
        stopped_after.get_or_insert(world.spawns.len());
        for _ in 0..400 {
            world.pass(0.01);
        }
        prop_assert!(world.end.is_some());
        if let (Some(End::Stopped), Some(spawns)) = (world.end, stopped_after) {
            prop_assert_eq!(world.spawns.len(), spawns, "something was started after the stop");
        }
    }
}

/// A swap of the only process, its candidate in its loop and in probation.
fn in_probation(cycles: u64) -> World {
    let mut world = World::running(vec![rules("a")]);
    world.observe(&[Observation::SwapRequested {
        process: 0,
        cycles,
        dry_run: false,
    }]);
    world.pass(0.01);
    assert!(
        matches!(world.shadows[0], Child::Alive(2, None)),
        "{:?}",
        world.shadows
    );
    world
}

/// One pass with a heartbeat of the owner and one of the second instance, whichever they are now.
fn pass_both(world: &mut World, seconds: f64, cycles: u64, misses: u64) {
    let beat = |generation: u32, misses: u64, world: &World| Observation::Heartbeat {
        process: 0,
        heartbeat: Heartbeat {
            generation,
            state: Coded::new(ServiceState::Active),
            cycles,
            budget_misses: misses,
            outputs: cycles,
            ..Heartbeat::default()
        },
        time: world.now,
    };
    world.now = world.now.plus_seconds(seconds);
    let mut beats = Vec::new();
    if let Child::Alive(generation, _) = world.children[0] {
        beats.push(beat(generation, 0, world));
    }
    if let Child::Alive(generation, _) = world.shadows[0] {
        beats.push(beat(generation, misses, world));
    }
    world.observe(&beats);
}

fn control(world: &World) -> ControlEntry {
    let mut control = Control::default();
    world.supervision.write_control(&mut control);
    control.entries[0]
}

#[test]
fn a_good_candidate_takes_over_at_a_moment_that_both_know_before_and_the_old_one_goes_last() {
    let mut world = in_probation(20);
    let mut cycles = 100;
    while world.signals.is_empty() && world.commits == 0 && cycles < 400 {
        cycles += 1;
        pass_both(&mut world, 0.05, cycles, 0);
        let entry = control(&world);
        if entry.next != 0 {
            assert_eq!((entry.active, entry.next), (1, 2));
        }
    }
    assert!(
        matches!(
            world.news[..],
            [
                SwapNews::Probation { .. },
                SwapNews::Switching { .. },
                SwapNews::Switched,
                SwapNews::Done
            ]
        ),
        "{:?}",
        world.news
    );
    assert_eq!(world.commits, 1);
    assert!(
        matches!(world.children[0], Child::Alive(2, _)),
        "{:?}",
        world.children
    );
    assert_eq!(world.shadows[0], Child::None);
    let entry = control(&world);
    assert_eq!((entry.active, entry.next, entry.epoch), (2, 0, 2));
    assert!(
        world.signals.is_empty(),
        "the owner was never touched: {:?}",
        world.signals
    );
}

#[test]
fn without_a_shadow_a_swap_ends_the_old_one_and_starts_the_new_program_at_once() {
    let alone = Rules {
        has_shadow: false,
        ..rules("gateway")
    };
    let mut world = World::running(vec![alone]);
    let swap = |dry_run| Observation::SwapRequested {
        process: 0,
        cycles: 50,
        dry_run,
    };
    world.observe(&[swap(true)]);
    assert_eq!(world.news, [SwapNews::Refused(Refusal::NoShadow)]);
    assert!(world.signals.is_empty() && world.commits == 0);
    world.observe(&[swap(false)]);
    assert_eq!(world.news.last(), Some(&SwapNews::Replaced));
    for _ in 0..3 {
        world.pass(0.01);
    }
    assert_eq!(world.signals, [Action::Terminate { process: 0 }]);
    assert_eq!((world.commits, world.spawns.len()), (1, 2));
    assert!(
        matches!(world.children[0], Child::Alive(2, _)),
        "{:?}",
        world.children
    );
    assert_eq!(control(&world).active, 2);
}

#[test]
fn a_slow_candidate_and_one_that_dies_are_refused_and_the_owner_never_notices() {
    let mut slow = in_probation(20);
    for step in 1..60 {
        pass_both(&mut slow, 0.05, 100 + step, step);
    }
    assert!(
        matches!(slow.news.last(), Some(SwapNews::Refused(Refusal::OverBudget(_)))),
        "{:?}",
        slow.news
    );
    let mut dying = in_probation(20);
    dying.shadows[0] = Child::None;
    let exit = Exit::Signal(11);
    dying.observe(&[Observation::ShadowDied { process: 0, exit }]);
    assert_eq!(dying.news, [SwapNews::Refused(Refusal::Ended(exit))]);
    for world in [&slow, &dying] {
        assert_eq!(world.children[0], Child::Alive(1, Some(ServiceState::Active)));
        assert_eq!((control(world).active, control(world).next), (1, 0));
        assert!(world.signals.is_empty());
    }
}

#[test]
fn a_candidate_that_dies_as_owner_is_rolled_back_at_once_in_a_new_epoch() {
    let mut world = in_probation(20);
    let mut cycles = 100;
    while !world.news.contains(&SwapNews::Switched) && cycles < 400 {
        cycles += 1;
        pass_both(&mut world, 0.05, cycles, 0);
    }
    world.children[0] = Child::None;
    let exit = Exit::Signal(6);
    world.observe(&[Observation::Died { process: 0, exit }]);
    assert_eq!(
        world.news.last(),
        Some(&SwapNews::RolledBack(Refusal::Ended(exit)))
    );
    assert!(
        matches!(world.children[0], Child::Alive(1, _)),
        "{:?}",
        world.children
    );
    let entry = control(&world);
    assert_eq!((entry.active, entry.next), (1, 0));
    assert!(
        entry.epoch > 2,
        "readers must take it for newer than the candidate"
    );
    assert_eq!(world.commits, 0);
}

#[test]
fn a_candidate_that_dies_in_the_moment_of_the_switch_leaves_an_owner_in_a_new_epoch() {
    let mut world = in_probation(20);
    let mut cycles = 100;
    while control(&world).next == 0 && cycles < 400 {
        cycles += 1;
        pass_both(&mut world, 0.05, cycles, 0);
    }
    world.shadows[0] = Child::None;
    let exit = Exit::Signal(6);
    world.observe(&[Observation::ShadowDied { process: 0, exit }]);
    assert_eq!(
        world.news.last(),
        Some(&SwapNews::RolledBack(Refusal::Ended(exit)))
    );
    let entry = control(&world);
    assert_eq!((entry.active, entry.next), (1, 0));
    assert!(entry.epoch > 2, "the candidate may have spoken already");
    assert!(world.signals.is_empty());
}

#[test]
fn a_hot_shadow_takes_over_without_a_start_and_gets_a_successor() {
    let hot = Rules {
        hot_shadow: true,
        ..rules("a")
    };
    let mut world = World::running(vec![hot]);
    for step in 0..60 {
        pass_both(&mut world, 0.05, 100 + step, 0);
    }
    let spawns = world.spawns.len();
    assert!(
        matches!(world.shadows[0], Child::Alive(2, _)),
        "{:?}",
        world.shadows
    );
    world.die(0, Exit::Signal(9));
    assert!(
        matches!(world.children[0], Child::Alive(2, _)),
        "{:?}",
        world.children
    );
    assert_eq!(world.spawns.len(), spawns, "nothing had to be started");
    assert_eq!((control(&world).active, control(&world).next), (2, 0));
    for step in 60..160 {
        pass_both(&mut world, 0.05, 100 + step, 0);
    }
    assert!(
        matches!(world.shadows[0], Child::Alive(3, _)),
        "{:?}",
        world.shadows
    );
}

#[test]
fn most_of_them_silent_at_once_is_the_machine_and_nobody_is_killed() {
    let mut world = World::running(vec![rules("a"), rules("b"), rules("c")]);
    for child in &mut world.children {
        if let Child::Alive(_, state) = child {
            *state = None;
        }
    }
    for _ in 0..80 {
        world.pass(0.01);
    }
    assert!(world.signals.is_empty(), "{:?}", world.signals);
    world.let_all_work();
    world.pass(0.01);
    assert_eq!(world.supervision.health(), Health::Healthy);
}

proptest! {
    /// Whatever dies, hangs, is asked for and goes well or badly: there is never more than one owner, never a signal
    /// for nobody, and the system ends with nobody left.
    #[test]
    fn swaps_and_deaths_in_any_order_leave_one_owner(story in proptest::collection::vec((0..7u8, 1..8u64), 1..120)) {
        let hot = Rules { hot_shadow: true, ..rules("a") };
        let mut world = World::running(vec![hot]);
        let mut cycles = 1000;
        for (what, amount) in story {
            match what {
                0 => world.observe(&[Observation::SwapRequested { process: 0, cycles: 5 * amount, dry_run: amount == 1 }]),
                1 if world.children[0] != Child::None => world.die(0, Exit::Signal(9)),
                2 if world.shadows[0] != Child::None => {
                    world.shadows[0] = Child::None;
                    world.observe(&[Observation::ShadowDied { process: 0, exit: Exit::Code(1) }]);
                }
                3 => world.observe(&[Observation::RestartRequested { process: 0 }]),
                4 => world.pass(0.02 * amount as f64),
                _ => for _ in 0..4 * amount {
                    cycles += 2;
                    pass_both(&mut world, 0.05, cycles, 0);
                },
            }
            let entry = control(&world);
            if let (Child::Alive(main, _), true) = (&world.children[0], entry.next == 0) {
                prop_assert_eq!(entry.active, *main, "the control record names who is in charge");
            }
            if let (Child::Alive(main, _), Child::Alive(shadow, _)) = (&world.children[0], &world.shadows[0]) {
                prop_assert_ne!(main, shadow);
            }
        }
        world.observe(&[Observation::StopRequested]);
        for _ in 0..20 {
            world.pass(0.1);
        }
        prop_assert_eq!(world.end, Some(End::Stopped));
        prop_assert_eq!(&world.shadows[0], &Child::None);
    }
}
