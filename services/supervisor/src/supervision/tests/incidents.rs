//! Deaths, silence and a stop in any order.

use super::{CANNOT_START, Child, SimulatedHost, rules};
use crate::policy::RestartRule;
use crate::supervision::{End, Exit, Observation};
use crate::table::ProcessRules;
use jink_shared_types::Timestamp;
use jink_shared_types::health::ServiceState;
use proptest::prelude::*;

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
