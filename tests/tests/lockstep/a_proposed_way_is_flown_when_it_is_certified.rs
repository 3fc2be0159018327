//! A planner that a user brings proposes ways through a forest: what can be certified is flown, what cannot is refused with the
//! reason, and the goal is reached without a contact either way.

use jink_emulated_ground_station::Outcome;
use jink_shared_types::events;
use jink_shared_types::motion::RouteMode;
use jink_shared_types::proposal::ProposalVerdict;
use jink_shared_types::vehicle::NavMode;
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::{COPTER, PX4_CURRENT, PX4_TRAJECTORY, Pairing};
use jink_tests::proposer::Plan;
use std::collections::BTreeMap;

/// Between two of whatever happens (s).
const PERIOD_S: f64 = 4.0;
/// Outside of the forest, which is 30 m wide.
const OUTSIDE_EAST_M: f64 = 20.0;

/// What a flight to its end was like.
struct Flown {
    flight: LockStep,
    /// Plans, and those of them that were made of proposals.
    plans: u32,
    proposed: u32,
    east_max_m: f64,
    top_speed_mps: f64,
    /// How often each verdict was given.
    verdicts: BTreeMap<String, u32>,
}

impl Flown {
    fn share(&self) -> f64 {
        f64::from(self.proposed) / f64::from(self.plans)
    }

    fn count(&self, verdict: ProposalVerdict) -> u32 {
        let name = format!("{verdict:?}");
        self.verdicts.get(&name).copied().unwrap_or(0)
    }
}

/// A flight through a forest to its end; once a period in the mission something happens.
fn fly(
    pairing: Pairing,
    seed: u64,
    plan: Option<Plan>,
    mut happens: impl FnMut(&mut LockStep, usize),
) -> Flown {
    let mut setup = pairing.forest(seed).unwrap();
    setup.proposer = plan;
    let mut flown = Flown {
        flight: LockStep::new(setup).unwrap(),
        plans: 0,
        proposed: 0,
        east_max_m: 0.0,
        top_speed_mps: 0.0,
        verdicts: BTreeMap::new(),
    };
    let (mut times, mut under_way_s, mut route, mut answers) = (0, 0.0, 0, 0);
    while flown.flight.outcome().is_none() {
        flown.flight.step();
        let flight = &mut flown.flight;
        let newest = flight.route();
        if newest.mode == RouteMode::Plan && std::mem::replace(&mut route, newest.id) != newest.id {
            flown.plans += 1;
            flown.proposed += u32::from(newest.proposal_id.get().is_some());
        }
        // Who was started again has none.
        let received = flight.proposer().map_or(&[][..], |proposer| &proposer.answers);
        answers = if received.len() < answers { 0 } else { answers };
        for answer in &received[answers..] {
            *flown
                .verdicts
                .entry(format!("{:?}", answer.verdict.get()))
                .or_default() += 1;
        }
        answers = received.len();
        let truth = flight.truth();
        flown.east_max_m = flown.east_max_m.max(truth.position.y_m.abs());
        if matches!(truth.mode.get(), NavMode::Mission | NavMode::Offboard) {
            flown.top_speed_mps = flown.top_speed_mps.max(truth.velocity.vector().norm());
            under_way_s += 0.004;
        }
        if under_way_s > PERIOD_S * (times + 1) as f64 {
            happens(flight, times);
            times += 1;
        }
    }
    let truth = flown.flight.truth();
    println!(
        "{} {plan:?}: {:?}, {} of {} plans of proposals ({:.0} %), {:.1} m to the side, top {:.2} m/s, {:.1} s, clearance {:.2} m, {:?}",
        pairing.autopilot,
        flown.flight.outcome(),
        flown.proposed,
        flown.plans,
        1e2 * flown.share(),
        flown.east_max_m,
        flown.top_speed_mps,
        truth.cruise_s,
        truth.min_clearance_m,
        flown.verdicts
    );
    assert_eq!(flown.flight.outcome(), Some(&Outcome::Done));
    assert_eq!(truth.collisions, 0);
    assert_eq!(truth.hold_count, 0);
    assert!(truth.setpoint_gap_max_s < 0.1, "{}", truth.setpoint_gap_max_s);
    assert_eq!(flown.flight.count(&events::CERTIFICATE_LOST), 0);
    flown
}

fn around(speed_mps: f64) -> Option<Plan> {
    Some(Plan::Around {
        east_m: OUTSIDE_EAST_M,
        speed_mps,
    })
}

pub fn detour_flights() -> Flights {
    let mut flights = Flights::new();
    for pairing in [PX4_TRAJECTORY, PX4_CURRENT, COPTER] {
        flights.add(pairing.name(), false, move || {
            let own = fly(pairing, 3, None, |_, _| {});
            assert!(own.east_max_m < 10.0);
            assert_eq!(own.proposed, 0);
            let flown = fly(pairing, 3, around(0.0), |_, _| {});
            assert!(flown.east_max_m > OUTSIDE_EAST_M - 2.5, "{}", flown.east_max_m);
            assert!(flown.share() > 0.8, "{}", flown.share());
            assert!(flown.flight.count(&events::PROPOSAL_FLOWN) >= 1);
            assert!(flown.count(ProposalVerdict::Accepted) + flown.count(ProposalVerdict::Shortened) >= 1);
        });
    }
    flights
}

pub fn a_speed_wished_is_not_exceeded() -> Flights {
    Flights::of_one("a_speed_wished_is_not_exceeded", || {
        let flown = fly(PX4_TRAJECTORY, 3, around(1.5), |_, _| {});
        assert!(flown.share() > 0.8, "{}", flown.share());
        assert!(
            (1.2..1.65).contains(&flown.top_speed_mps),
            "{}",
            flown.top_speed_mps
        );
    })
}

pub fn tree_flights() -> Flights {
    let mut flights = Flights::new();
    for seed in [3, 5, 7, 9] {
        flights.add(&format!("seed {seed}"), false, move || {
            let flown = fly(PX4_TRAJECTORY, seed, Some(Plan::Straight), |_, _| {});
            let refused = flown.count(ProposalVerdict::Occupied) + flown.count(ProposalVerdict::TooNarrow);
            assert!(refused >= 1, "{:?}", flown.verdicts);
            assert!(flown.share() < 1.0);
        });
    }
    flights
}

pub fn a_way_that_leads_nowhere_ends_at_the_goal_all_the_same() -> Flights {
    Flights::of_one("a_way_that_leads_nowhere_ends_at_the_goal_all_the_same", || {
        let nowhere = Plan::Nowhere {
            east_m: -OUTSIDE_EAST_M,
        };
        let flown = fly(PX4_TRAJECTORY, 3, Some(nowhere), |_, _| {});
        assert!(flown.count(ProposalVerdict::Accepted) + flown.count(ProposalVerdict::Shortened) >= 1);
        assert_eq!(flown.flight.count(&events::GOAL_BLOCKED), 0);
    })
}

pub fn a_proposer_that_is_killed_in_flight_leaves_no_gap_and_is_received_again() -> Flights {
    Flights::of_one(
        "a_proposer_that_is_killed_in_flight_leaves_no_gap_and_is_received_again",
        || {
            let mut kills = 0;
            let flown = fly(PX4_TRAJECTORY, 3, around(0.0), |flight, times| {
                if times.is_multiple_of(2) {
                    flight.board().kill("proposer");
                    kills += 1;
                }
            });
            assert!(kills >= 3, "{kills}");
            assert_eq!(flown.flight.count(&events::PROCESS_RESTARTED), kills);
            assert!(flown.east_max_m > OUTSIDE_EAST_M - 2.5, "{}", flown.east_max_m);
            assert!(flown.share() > 0.6, "{}", flown.share());
        },
    )
}

pub fn a_proposer_that_stays_silent_half_way_leaves_the_rest_to_the_planner() -> Flights {
    Flights::of_one(
        "a_proposer_that_stays_silent_half_way_leaves_the_rest_to_the_planner",
        || {
            let flown = fly(PX4_TRAJECTORY, 3, around(0.0), |flight, times| {
                if times == 4 {
                    flight.silence_proposer();
                }
            });
            assert!((0.1..0.9).contains(&flown.share()), "{}", flown.share());
            assert!(flown.flight.count(&events::PROPOSAL_ENDED) >= 1);
        },
    )
}

pub fn the_same_proposals_give_the_same_flight() -> Flights {
    Flights::of_one("the_same_proposals_give_the_same_flight", || {
        let track = || {
            let mut track = Vec::new();
            fly(PX4_TRAJECTORY, 5, around(0.0), |flight, _| {
                let place = flight.truth().position;
                track.push([place.x_m, place.y_m, place.z_m].map(f64::to_bits));
            });
            track
        };
        assert_eq!(track(), track());
    })
}
