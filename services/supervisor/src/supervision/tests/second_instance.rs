//! Swaps and hot shadows.

use super::{Child, SimulatedHost, rules};
use crate::shadow::{SwapProgress, SwapRefusal};
use crate::supervision::{Action, End, Exit, Observation};
use crate::table::ProcessRules;
use jink_runtime::service::EXIT_CANNOT_START;
use jink_shared_types::coded::Coded;
use jink_shared_types::control::{Control, ControlEntry};
use jink_shared_types::events;
use jink_shared_types::health::{Heartbeat, Name, ServiceState};
use proptest::prelude::*;

/// A swap of the only process, its candidate in its loop and in probation.
fn in_probation(cycles: u64) -> SimulatedHost {
    in_probation_beside(cycles, vec![rules("a")])
}

/// The same beside other processes.
fn in_probation_beside(cycles: u64, rules: Vec<ProcessRules>) -> SimulatedHost {
    let mut host = SimulatedHost::running(rules);
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
    for (process, child) in host.children.iter().enumerate().skip(1) {
        if let Child::Alive(generation, Some(state)) = child {
            beats.push(host.beat(process, *generation, *state));
        }
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
    host.observe(&[swap(false)]);
    assert_eq!(
        host.progress.last(),
        Some(&SwapProgress::Refused(SwapRefusal::Busy))
    );
    for _ in 0..25 {
        host.let_all_work();
        host.pass(0.1);
    }
    assert_eq!(host.progress.last(), Some(&SwapProgress::Done));
    assert_eq!(host.signals, [Action::Terminate { process: 0 }]);
    assert_eq!((host.commits, host.taken_back, host.spawns.len()), (1, 0, 2));
    assert!(
        matches!(host.children[0], Child::Alive(2, _)),
        "{:?}",
        host.children
    );
    assert_eq!(control(&host).active, 2);
}

#[test]
fn without_a_shadow_a_new_program_that_fails_soon_gives_way_to_the_former_one() {
    let alone = ProcessRules {
        has_shadow: false,
        ..rules("a")
    };
    // It cannot start; it ends in its loop; it never reaches it.
    for (works, dies) in [(false, true), (true, true), (false, false)] {
        let mut host = SimulatedHost::running(vec![alone.clone()]);
        host.observe(&[Observation::SwapRequested {
            process: 0,
            cycles: 50,
            dry_run: false,
        }]);
        if works {
            host.let_all_work();
        }
        if dies {
            host.pass(0.1);
            host.die(0, Exit::Code(78));
        }
        for _ in 0..200 {
            host.pass(0.01);
            if host.taken_back == 1 {
                host.let_all_work();
            }
        }
        let why = if dies { Exit::Code(78) } else { Exit::Signal(9) };
        assert_eq!(
            host.progress,
            [
                SwapProgress::Replaced,
                SwapProgress::RolledBack(SwapRefusal::Ended(why))
            ]
        );
        assert_eq!((host.commits, host.taken_back), (1, 1));
        assert!(host.events.contains(&events::SWAP_ROLLED_BACK.id));
        assert!(
            matches!(host.children[0], Child::Alive(3, _)),
            "{:?}",
            host.children
        );
    }
}

/// Swaps process 0 while process 1 lacks what it needs for `lack_s` after the switch.
fn swapped_with_a_lack_of(lack_s: f64) -> SimulatedHost {
    let mut host = in_probation_beside(20, vec![rules("a"), rules("b")]);
    let mut cycles = 100;
    let mut lacking_s = 0.0;
    while !host.progress.last().is_some_and(SwapProgress::is_last) && cycles < 400 {
        cycles += 1;
        let owns = host.progress.last() == Some(&SwapProgress::Switched);
        let lacks = owns && lacking_s < lack_s;
        lacking_s += if lacks { 0.05 } else { 0.0 };
        let state = if lacks {
            ServiceState::Degraded
        } else {
            ServiceState::Active
        };
        host.children[1] = Child::Alive(1, Some(state));
        pass_both(&mut host, 0.05, cycles, 0);
    }
    host
}

#[test]
fn a_candidate_whose_outputs_others_cannot_use_gives_the_place_back() {
    let host = swapped_with_a_lack_of(10.0);
    assert_eq!(
        host.progress.last(),
        Some(&SwapProgress::RolledBack(SwapRefusal::Lacking(Name::new("b"))))
    );
    assert_eq!((host.commits, host.taken_back), (0, 0));
    assert_eq!(host.signals, [Action::Kill { process: 0 }]);
    assert!(host.events.contains(&events::SWAP_ROLLED_BACK.id));
    assert!(
        matches!(host.children[0], Child::Alive(1, _)),
        "{:?}",
        host.children
    );
    assert_eq!(host.shadows[0], Child::None);
    let entry = control(&host);
    assert_eq!((entry.active, entry.next), (1, 0));
    assert!(entry.epoch > 2, "{entry:?}");
}

#[test]
fn a_lack_of_a_moment_at_the_switch_rolls_nothing_back() {
    let host = swapped_with_a_lack_of(0.3);
    assert_eq!(host.progress.last(), Some(&SwapProgress::Done));
    assert_eq!((host.commits, host.signals.len()), (1, 0));
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
    let mut other = in_probation(20);
    other.shadows[0] = Child::None;
    let exit = Exit::Code(EXIT_CANNOT_START);
    other.observe(&[Observation::ShadowDied { process: 0, exit }]);
    for (host, why) in [(&slow, "too slow"), (&dying, "died"), (&other, "cannot start")] {
        let text = host.texts.last().unwrap();
        assert!(text.ends_with(&format!(" swap refused, {why}")), "{text}");
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
