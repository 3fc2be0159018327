//! How the system comes up and how it ends.

use super::{CANNOT_START, Child, SimulatedHost, rules};
use crate::supervision::{Action, End, Exit, Observation};
use crate::table::ProcessRules;
use jink_shared_types::events;
use jink_shared_types::health::{Health, ServiceState};

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
fn a_start_that_cannot_work_is_not_retried_but_shown() {
    let mut host = SimulatedHost::new(vec![rules("a"), rules("b")]);
    host.pass(0.01);
    host.let_all_work();
    host.pass(0.01);
    host.die(1, CANNOT_START);
    assert_eq!(host.end, Some(End::CannotStart { process: 1 }));
    assert_eq!(host.signals, [Action::Terminate { process: 0 }]);
    let mut host = SimulatedHost::new(vec![rules("a")]);
    host.pass(0.01);
    host.die(0, Exit::NotSpawned);
    assert_eq!(host.end, Some(End::CannotStart { process: 0 }));
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
