//! What takes a mode away in flight, and what gives it back.
//!
//! PX4 of 2021: a mode that sticks must fly, without sticks, becomes a return; OFFBOARD without setpoints becomes a
//! landing. Both last until somebody asks for another mode.
//!
//! Current PX4 keeps in mind what was asked for:
//!
//! | event | change | ends |
//! |---|---|---|
//! | OFFBOARD setpoints older than COM_OF_LOSS_T | what COM_OBL_RC_ACT says, at once | by itself when setpoints come again |
//! | sticks received since arming fall silent | Hold, a return COM_FAIL_ACT_T later, whatever setpoints do | with a new wish |
//! | sticks move fast in a mode without them | Position | is a wish itself |

use super::{Commander, Failsafe, Situation, Text};
use crate::avoidance::HoldCause;
use crate::parameters::{Parameter as P, Parameters};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::MavSeverity;

/// Current PX4 looks at the age of setpoints this often (us). It explains the observed spread of the loss, 1.02 to 1.12 s,
/// and why setpoints at 0.95 Hz, 1.053 s apart, lose the mode in every other gap only.
const CHECK_PERIOD_US: u64 = 100_000;
/// From the first setpoint after a loss to the change of mode (us): with the way onto the link 0.03 to 0.05 s were seen.
const RE_ENTRY_US: u64 = 20_000;
/// From the last stick message to the change of mode (us): COM_RC_LOSS_T of 0.5 s and the time PX4 took; 0.67 s were seen
/// on the link.
const STICK_LOSS_US: u64 = 650_000;
/// Sticks received this long before arming count as received at arming (us).
const STICKS_AT_ARMING_US: u64 = 500_000;

impl Commander {
    /// PX4 of 2021.
    pub(super) fn check_failsafes(&mut self, situation: &Situation, say: &mut impl FnMut(Text)) {
        let by_sticks = matches!(self.mode, NavMode::Manual | NavMode::Position);
        if by_sticks && !self.has_sticks(situation.now_us) {
            self.proceed_to(NavMode::Return);
            self.failsafe = Failsafe::UntilAsked;
            let text = format_args!("Failsafe enabled: No manual control stick input");
            say((MavSeverity::MAV_SEVERITY_CRITICAL, text));
        }
        if self.mode == NavMode::Offboard && !situation.offboard_alive {
            self.proceed_to(NavMode::Land);
            self.failsafe = Failsafe::UntilAsked;
            let text = format_args!("Failsafe enabled: no offboard");
            say((MavSeverity::MAV_SEVERITY_CRITICAL, text));
        }
    }

    /// Current PX4.
    pub(super) fn check_wishes(
        &mut self,
        situation: &Situation,
        parameters: &Parameters,
        say: &mut impl FnMut(Text),
    ) {
        let now_us = situation.now_us;
        if let Failsafe::SticksLost { since_us } = self.failsafe {
            let waited_s = (now_us - since_us) as f64 * 1e-6;
            if self.mode == NavMode::Hold && waited_s >= parameters.get(P::COM_FAIL_ACT_T) {
                self.mode = NavMode::Return;
            }
            return;
        }
        if self.sticks_fell_silent(now_us) && !matches!(self.mode, NavMode::Return | NavMode::Land) {
            self.mode = NavMode::Hold;
            self.failsafe = Failsafe::SticksLost { since_us: now_us };
            let wait_s = parameters.get(P::COM_FAIL_ACT_T);
            let text = format_args!("Failsafe activated: entering Hold for {wait_s} seconds");
            say((MavSeverity::MAV_SEVERITY_CRITICAL, text));
            return;
        }
        if let Failsafe::OffboardLost { back_us } = self.failsafe {
            self.wait_for_setpoints(now_us, back_us, situation.offboard_alive);
        } else if self.mode == NavMode::Offboard
            && !situation.offboard_alive
            && now_us.is_multiple_of(CHECK_PERIOD_US)
        {
            self.note_fall(now_us, HoldCause::StreamStopped);
            self.mode = self.mode_without_setpoints(now_us, parameters);
            self.failsafe = Failsafe::OffboardLost { back_us: None };
            let text = format_args!("Failsafe activated");
            say((MavSeverity::MAV_SEVERITY_CRITICAL, text));
        }
    }

    /// Sticks never received while armed are not missed.
    fn sticks_fell_silent(&self, now_us: u64) -> bool {
        self.sticks_us.is_some_and(|at_us| {
            at_us + STICKS_AT_ARMING_US >= self.changed_us && now_us - at_us >= STICK_LOSS_US
        })
    }

    /// Altitude mode (1) and manual flight (2) are not emulated and taken for Position; ending the flight (6, 7) neither.
    fn mode_without_setpoints(&self, now_us: u64, parameters: &Parameters) -> NavMode {
        match parameters.get(P::COM_OBL_RC_ACT) as i32 {
            4 => NavMode::Land,
            5 => NavMode::Hold,
            0..=2 if self.has_sticks(now_us) => NavMode::Position,
            _ => NavMode::Return,
        }
    }

    fn wait_for_setpoints(&mut self, now_us: u64, back_us: Option<u64>, alive: bool) {
        let back_us = alive.then(|| back_us.unwrap_or(now_us));
        self.failsafe = Failsafe::OffboardLost { back_us };
        if back_us.is_some_and(|since_us| now_us - since_us >= RE_ENTRY_US) {
            self.mode = self.intended;
            self.failsafe = Failsafe::None;
        }
    }

    /// Fast sticks: the pilot takes over from every mode that flies without them. Returns whether he did.
    pub fn take_over(&mut self, position_ready: bool) -> bool {
        let without_sticks = self.mode.is_automatic() || self.mode == NavMode::Offboard;
        let taken = self.firmware.remembers_wishes() && self.armed && position_ready && without_sticks;
        if taken {
            self.proceed_to(NavMode::Position);
            self.failsafe = Failsafe::None;
        }
        taken
    }
}
