//! Who watches a flight of ArduCopter sees it as any other, and as often as it is flown.

use crate::support::copter::{CopterFlight, PVA, at, level, setpoint};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::modes::arducopter::Mode;
use jink_emulated_autopilot::truth::Observer;
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::world::{World, WorldKind, WorldSpec};

fn world() -> World {
    World::from_spec(&WorldSpec {
        kind: WorldKind::Empty,
        seed: 1,
        density_per_m2: None,
    })
    .unwrap()
}

#[test]
fn the_truth_of_a_flight_in_guided_reports_mode_way_and_setpoints() {
    let world = world();
    let mut observer = Observer::new(0.3);
    let mut flight = CopterFlight::airborne(&[]);
    let mut truth = observer.observe(&flight.copter, &world);
    for step in 0..200 {
        let t = f64::from(step) * 0.02;
        flight.companion(setpoint(PVA, at(1.5 * t, 0.0), level(1.5, 0.0), level(0.0, 0.0)));
        for _ in 0..5 {
            flight.step();
            truth = observer.observe(&flight.copter, &world);
        }
    }
    assert_eq!(truth.mode.get(), NavMode::Offboard);
    assert!(truth.armed.is_set() && !truth.landed.is_set());
    assert_eq!(truth.setpoints, 200);
    assert!(truth.setpoint_gap_max_s < 15.0 && truth.flown_m > 4.0);
}

#[test]
fn the_same_messages_give_the_same_flight_to_the_bit() {
    let fly = || {
        let mut flight = CopterFlight::airborne(&[]);
        flight.stream(4.0, 50.0, |t| {
            setpoint(PVA, at(2.0 * t, t.sin()), level(2.0, t.cos()), level(0.0, 0.0))
        });
        flight.set_mode(Mode::Rtl);
        let sent = flight.collect(5.0, |packet| Some(packet.clone()));
        (*flight.copter.truth(), sent)
    };
    assert_eq!(fly(), fly());
}
