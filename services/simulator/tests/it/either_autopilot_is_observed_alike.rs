//! Who watches a flight need not know the make of the autopilot.

use jink_emulated_arducopter::{ArduCopter, ArduCopterConfig};
use jink_emulated_autopilot::Flyer;
use jink_emulated_px4::{Autopilot, AutopilotConfig};
use jink_shared_types::vehicle::NavMode;

#[test]
fn both_makes_step_by_4_ms_and_stand_until_they_are_told_otherwise() {
    let px4 = Autopilot::new(AutopilotConfig::default()).unwrap();
    let copter = ArduCopter::new(ArduCopterConfig::default()).unwrap();
    let flyers: [Box<dyn Flyer>; 2] = [Box::new(px4), Box::new(copter)];
    for mut flyer in flyers {
        let mut outbox = Vec::new();
        for _ in 0..500 {
            flyer.step(&[], &mut outbox);
        }
        assert!((flyer.time_s() - 2.0).abs() < 1e-9);
        assert!(flyer.is_landed() && !flyer.is_armed());
        assert_eq!(
            (flyer.mode(), flyer.aborted(), flyer.hold_count()),
            (NavMode::Manual, None, 0)
        );
        assert!(outbox.len() >= 4, "heartbeats on both links");
    }
}
