//! Whether sticks move fast enough for a pilot who wants the vehicle.
//!
//! Current PX4 looks at the speed of the sticks, not at where they are: full deflection within a second was a take-over,
//! within two seconds was none, and neither was a jump from one message to the next. So a movement counts that is fast
//! over several messages in a row.

use mavlink::dialect::MANUAL_CONTROL_DATA;

/// Fast messages in a row that make a movement: a jump is one of them, a ramp of a second at 10 Hz is ten.
const MESSAGES: u32 = 3;
/// Share of MAN_OVERRIDE_SPD that is fast: sticks travel as integers, and a ramp of exactly that speed did count.
const TOLERANCE: f64 = 0.9;

/// The sticks' memory.
#[derive(Clone, Copy, Debug, Default)]
pub struct StickSpeed {
    last: Option<(u64, [f64; 4])>,
    fast_messages: u32,
}

impl StickSpeed {
    /// Takes a message; `true` if the pilot takes over. `limit_per_s`: MAN_OVERRIDE_SPD, not positive = never.
    pub fn receive(&mut self, now_us: u64, message: &MANUAL_CONTROL_DATA, limit_per_s: f64) -> bool {
        let share = |value: i16| f64::from(value) / 1_000.0;
        let sticks = [
            share(message.x),
            share(message.y),
            2.0 * share(message.z) - 1.0,
            share(message.r),
        ];
        let Some((before_us, before)) = self.last.replace((now_us, sticks)) else {
            return false;
        };
        let passed_s = (now_us - before_us) as f64 * 1e-6;
        let moved = sticks
            .iter()
            .zip(before)
            .map(|(now, before)| (now - before).abs());
        let fast = moved.fold(0.0, f64::max) >= TOLERANCE * limit_per_s * passed_s;
        self.fast_messages = if fast && passed_s > 0.0 {
            self.fast_messages + 1
        } else {
            0
        };
        limit_per_s > 0.0 && self.fast_messages >= MESSAGES
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Whether a ramp to full deflection within `ramp_s`, sent every `interval_s`, is a take-over.
    fn ramp(ramp_s: f64, interval_s: f64) -> bool {
        let mut speed = StickSpeed::default();
        let mut taken = false;
        for i in 0..(4.0 / interval_s) as u32 {
            let time_s = f64::from(i) * interval_s;
            let message = MANUAL_CONTROL_DATA {
                x: (((time_s - 1.0) / ramp_s).clamp(0.0, 1.0) * 1_000.0) as i16,
                z: 500,
                ..MANUAL_CONTROL_DATA::default()
            };
            taken |= speed.receive((time_s * 1e6) as u64, &message, 1.0);
        }
        taken
    }

    proptest! {
        #[test]
        fn the_speed_decides_at_any_rate_of_messages(interval_s in 0.02..0.1f64, ramp_s in 0.4..3.0f64) {
            prop_assume!(!(1.0..1.25).contains(&ramp_s));
            prop_assert_eq!(ramp(ramp_s, interval_s), ramp_s < 1.0);
        }
    }

    #[test]
    fn a_jump_is_no_movement_and_neither_are_resting_sticks() {
        assert!(!ramp(0.001, 0.05));
        let mut speed = StickSpeed::default();
        let held = MANUAL_CONTROL_DATA {
            x: 900,
            z: 500,
            ..MANUAL_CONTROL_DATA::default()
        };
        assert!((0..100u64).all(|i| !speed.receive(i * 20_000, &held, 1.0)));
    }
}
