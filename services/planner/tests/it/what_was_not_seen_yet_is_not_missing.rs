//! A planner that has just begun, and sensors that have had nothing to answer to: only what no sensor looks at is reported as missing.

use crate::common::{hovering, map, now, to};
use jink_planner::{Planner, PlannerInputs};
use jink_shared_types::events::SENSORS_UNFIT;
use jink_shared_types::motion::Route;
use jink_shared_types::params::ParamSet;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::view::{FieldOfView, Missing};
use jink_shared_types::{Added, Flag, Reading, SampleHeader, Stamped};
use nalgebra::Vector3;

const CYCLE_S: f64 = 0.1;
/// Longer than any sensor needs to cover its field of view (s).
const WATCHED_S: f64 = 5.0;

/// Seen all around, from `low_deg` to `high_deg` above the horizon, by one sensor.
fn all_around(low_deg: i32, high_deg: i32) -> FieldOfView {
    let mut view = FieldOfView {
        near_m: 0.1,
        far_m: 12.0,
        sensors: 1,
        ..FieldOfView::default()
    };
    for right_deg in 0..360 {
        for up_deg in low_deg..high_deg {
            let [right, up] = [right_deg, up_deg].map(|deg| (f64::from(deg) + 0.5).to_radians());
            view.add(&Vector3::new(
                up.cos() * right.cos(),
                up.cos() * right.sin(),
                -up.sin(),
            ));
        }
    }
    view
}

/// What `planner` says is missing after a while with `sending` sensors that have answered from `view`, but not lately; the text at
/// most once.
fn missing(mut planner: Planner, view: &FieldOfView, sending: u8, state: &VehicleState) -> Missing {
    fn fresh<'a, T>(sample: &'a T, header: &'a SampleHeader) -> Reading<'a, T> {
        Reading::Fresh(Stamped { sample, header })
    }
    let mut map = map(10.0, |_| false);
    (map.view, map.live_sensors, map.sending_sensors) = (*view, 0, Added::new(sending));
    let desired = to(9.0, 0.0);
    let mut route = Route::default();
    let mut texts = 0;
    for cycle in 0..(WATCHED_S / CYCLE_S) as u32 {
        let time = now().plus_seconds(f64::from(cycle) * CYCLE_S);
        let header = SampleHeader::at(time);
        let inputs = PlannerInputs {
            far: Reading::Never,
            moving: Reading::Never,
            map: fresh(&map, &header),
            state: fresh(state, &header),
            desired: fresh(&desired, &header),
            approved: None,
            is_guard_silent: false,
            proposal: Reading::Never,
        };
        planner.step(time, &inputs, &mut route);
        texts += planner
            .events()
            .iter()
            .filter(|event| event.id == SENSORS_UNFIT.id)
            .count();
    }
    let missing = route.unseen.get();
    assert_eq!(texts, usize::from(missing != Missing::Nothing));
    missing
}

fn planner(sensors: u16) -> Planner {
    Planner::new(&ParamSet::default(), 1).with_sensors(sensors)
}

fn on_the_ground() -> VehicleState {
    VehicleState {
        armed: Flag::NO,
        landed: Flag::YES,
        ..hovering()
    }
}

#[test]
fn who_begins_in_the_air_does_not_judge_what_the_ground_has_hidden() {
    let taking_off = all_around(0, 50);
    assert_eq!(missing(planner(1), &taking_off, 1, &hovering()), Missing::Nothing);
    assert_eq!(
        missing(planner(1), &taking_off, 1, &on_the_ground()),
        Missing::Nothing
    );
    let disarmed = VehicleState {
        landed: Flag::NO,
        ..on_the_ground()
    };
    assert_eq!(missing(planner(1), &taking_off, 1, &disarmed), Missing::Below);
}

#[test]
fn a_sensor_without_answers_in_the_open_looks_where_its_model_does() {
    let mut spurious = all_around(0, 0);
    spurious.add(&Vector3::new(1.0, 1.0, -1.0));
    let nominal = all_around(-7, 52);
    assert_eq!(
        missing(planner(1), &spurious, 1, &on_the_ground()),
        Missing::Ahead
    );
    let known = planner(1).with_nominal_view(&nominal);
    assert_eq!(missing(known, &spurious, 1, &on_the_ground()), Missing::Nothing);
}

#[test]
fn a_sensor_that_is_silent_or_has_never_answered_is_missed_all_the_same() {
    let mut spurious = all_around(0, 0);
    spurious.add(&Vector3::new(1.0, 1.0, -1.0));
    let nominal = all_around(-7, 52);
    let silent = planner(1).with_nominal_view(&nominal);
    assert_eq!(missing(silent, &spurious, 0, &on_the_ground()), Missing::Ahead);
    let one_is_blind = planner(2).with_nominal_view(&nominal);
    assert_eq!(
        missing(one_is_blind, &spurious, 2, &on_the_ground()),
        Missing::Ahead
    );
    let looks_up = planner(1).with_nominal_view(&all_around(30, 80));
    assert_eq!(missing(looks_up, &spurious, 1, &on_the_ground()), Missing::Ahead);
}
