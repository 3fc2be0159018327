//! The hot path allocates nothing: not for states, clouds, scans, rings, refusals, brakes.

use crate::common::{Lidar, World, beam, fly, guard, on, random, ring, straight, time};
use allocation_counter::measure;
use jink_collision_guard::guard::GuardInputs;
use jink_collision_guard::prevention::{PilotGuard, PreventionConfig};
use jink_shared_types::motion::{ApprovedTrajectory, GuardReason, Verdict};
use jink_shared_types::params::ParamSet;
use jink_shared_types::prevention::{PilotDemand, PreventionState};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::sample::Stamped;
use jink_shared_types::{Reading, SampleHeader, Velocity};

#[test]
fn a_flight_with_everything_in_it_allocates_nothing() {
    let world = World(vec![[22.0, 0.0, 0.3], [5.0, 4.0, 0.3], [12.0, -3.0, 0.3]]);
    let first = straight(7, 10.0, 3.0, 2.0, 40.0);
    let mut late = first;
    (late.id, late.base_id, late.splice) = (8, 7, time(10.0));
    let mut guard = guard();
    let mut ring = ring();
    let mut out = ApprovedTrajectory::default();
    let mut sectors = SectorRing::default();
    let mut verdicts = Vec::with_capacity(1_000);
    let mut flown = first;
    let mut params = ParamSet::default();
    params.set("CP_DIST", 2.0).unwrap();
    let mut watch = PilotGuard::new(PreventionConfig::from_params(&params));
    let mut states = Vec::with_capacity(1_000);
    for i in 0..140_u32 {
        let t = 10.0 + 0.05 * f64::from(i);
        let place = move |t: f64| on(&flown, t);
        // Made outside the count: worlds and clouds are the test's own.
        let (cloud, header) = Lidar::default().sweep(&world, &place, t, &mut random(u64::from(i)));
        let single = beam(6.0, 0.4, 1.0);
        let state = place(t).state();
        let state_header = SampleHeader::at(time(t));
        let candidate = match i {
            0 => Some(&first),
            20 => Some(&late),
            _ => None,
        };
        let counted = measure(|| {
            fly(&mut ring, &place, t - 0.2, t);
            // For a while there are no ranges at all.
            if !(30..45).contains(&i) {
                ring.cloud(0, &cloud, &header).unwrap();
                ring.scan(1, &single, &header).unwrap();
            }
            let inputs = GuardInputs {
                trajectory: candidate,
                state: Reading::Fresh(Stamped {
                    sample: &state,
                    header: &state_header,
                }),
                ring: &ring,
                moving: Reading::Never,
            };
            guard.step(time(t), &inputs, &mut out);
            ring.ring(time(t), &mut sectors);
            let demand = PilotDemand {
                velocity: Velocity::new(5.0, 0.2, 0.0),
                ..PilotDemand::default()
            };
            let demand = Reading::Fresh(Stamped {
                sample: &demand,
                header: &state_header,
            });
            let watched = watch.step(time(t), demand, inputs.state, &sectors).unwrap();
            states.push(watched.0.state.get());
        });
        assert_eq!(counted.count_total, 0, "at {t}");
        verdicts.push((out.verdict.get(), out.reason.get()));
        flown = out.trajectory;
    }
    // All of it happened.
    for needed in [
        (Verdict::Passed, GuardReason::None),
        (Verdict::Kept, GuardReason::Late),
        (Verdict::Braked, GuardReason::Obstacle),
    ] {
        assert!(verdicts.contains(&needed), "{needed:?}");
    }
    for needed in [PreventionState::Acting, PreventionState::Blind] {
        assert!(states.contains(&needed), "{needed:?}");
    }
}
