//! Processes that die: how they are restarted, and when they are given up.

use super::{CANNOT_START, Child, SimulatedHost, rules};
use crate::policy::RestartRule;
use crate::supervision::{Action, End, Exit, Observation};
use crate::table::OnFailure;
use jink_shared_types::Timestamp;
use jink_shared_types::coded::Coded;
use jink_shared_types::events;
use jink_shared_types::health::{Health, Heartbeat, ServiceState};

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
fn what_the_kernel_refuses_to_start_is_tried_again_for_as_long_as_it_takes() {
    let mut host = SimulatedHost::running(vec![rules("a")]);
    host.die(0, Exit::Signal(9));
    let (died_at, mut refusals) = (host.now, 0);
    while host.now.seconds_since(died_at) < 60.0 {
        if host.children[0] == Child::None {
            host.pass(0.005);
        } else {
            host.die(0, Exit::NotSpawned);
            refusals += 1;
        }
    }
    assert!((30..50).contains(&refusals), "{refusals}");
    assert_ne!(host.state(0), ServiceState::Failed);
    while host.children[0] == Child::None {
        host.pass(0.005);
    }
    host.let_all_work();
    host.pass(0.01);
    assert_eq!(host.supervision.health(), Health::Healthy);
    assert!(!host.events.contains(&events::PROCESS_FAILED.id));
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

/// A second at 20 Hz in which every cycle is over its budget and the process computes all the time.
fn slow_second(host: &mut SimulatedHost) {
    let Child::Alive(generation, Some(_)) = host.children[0] else {
        panic!("{:?}", host.children);
    };
    for _ in 0..20 {
        host.now = host.now.plus_seconds(0.05);
        let beat = (host.now.seconds_since(Timestamp::NEVER) * 20.0).round() as u32;
        let heartbeat = Heartbeat {
            generation,
            state: Coded::new(ServiceState::Active),
            budget_misses: u64::from(beat),
            cpu_ms: 50 * beat,
            ..Heartbeat::default()
        };
        let time = host.now;
        host.observe(&[Observation::Heartbeat {
            process: 0,
            heartbeat,
            time,
        }]);
        if host.children[0] != Child::Alive(generation, Some(ServiceState::Active)) {
            return;
        }
    }
}

#[test]
fn who_is_slow_is_replaced_once_and_a_successor_that_is_as_slow_stays() {
    let mut host = SimulatedHost::running(vec![rules("a")]);
    let too_slow = |host: &SimulatedHost| {
        let events = host.events.iter();
        events.filter(|id| **id == events::PROCESS_TOO_SLOW.id).count()
    };
    slow_second(&mut host);
    assert_eq!((too_slow(&host), host.spawns.len()), (1, 2));
    for _ in 0..30 {
        host.let_all_work();
        slow_second(&mut host);
    }
    assert_eq!((too_slow(&host), host.spawns.len()), (1, 2));
    assert_eq!(host.state(0), ServiceState::Degraded);
    assert!(!host.events.contains(&events::PROCESS_FAILED.id));
    // After a minute it may be worth it again.
    for _ in 0..40 {
        host.let_all_work();
        host.pass(0.05);
        slow_second(&mut host);
    }
    assert_eq!((too_slow(&host), host.spawns.len()), (2, 3));
}
