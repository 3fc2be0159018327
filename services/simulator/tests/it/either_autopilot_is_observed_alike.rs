//! Who watches a flight need not know the make of the autopilot.

use jink_emulated_arducopter::{ArduCopter, ArduCopterConfig};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_px4::{Px4, Px4Config};
use jink_shared_types::vehicle::NavMode;

#[test]
fn both_makes_step_by_4_ms_and_stand_until_they_are_asked_to_move() {
    let px4 = Px4::new(Px4Config::default()).unwrap();
    let copter = ArduCopter::new(ArduCopterConfig::default()).unwrap();
    let autopilots: [Box<dyn Autopilot>; 2] = [Box::new(px4), Box::new(copter)];
    for mut autopilot in autopilots {
        let mut outbox = Vec::new();
        for _ in 0..500 {
            autopilot.step(&[], &mut outbox);
        }
        assert!((autopilot.time_s() - 2.0).abs() < 1e-9);
        assert!(autopilot.is_landed() && !autopilot.is_armed());
        assert_eq!(
            (autopilot.mode(), autopilot.aborted(), autopilot.hold_count()),
            (NavMode::Manual, None, 0)
        );
        assert!(outbox.len() >= 4, "heartbeats on both links");
    }
}
