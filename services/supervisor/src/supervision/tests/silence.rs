//! Processes that send no heartbeat: what counts as a hang, and what does not.

use super::{Child, SimulatedHost, rules};
use crate::supervision::{Action, Observation, ProcessActivity};
use jink_shared_types::events;
use jink_shared_types::health::Health;

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

#[test]
fn the_machine_asks_to_be_woken_in_time_for_a_hang() {
    let host = SimulatedHost::running(vec![rules("a")]);
    let wait_s = host.supervision.next_wake(host.now).seconds_since(host.now);
    assert!((wait_s - 0.1).abs() < 1e-6, "{wait_s}");
}
