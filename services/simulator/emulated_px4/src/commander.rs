//! Modes and arming: who may do what, and what happens when nobody does anything.

mod failsafe;

use super::avoidance::HoldCause;
use super::companion_health::{CompanionHealth, ForeignHeartbeat};
use super::firmware::Firmware;
use super::heartbeat_watch::Change;
use super::parameters::{Parameter as P, Parameters};
use super::refusal::Refusal;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::MavSeverity;

/// From the flight task's demand for Hold to the change of mode: one round of PX4's command queue (us).
const COMMAND_DELAY_US: u64 = 20_000;
/// Arming again this soon after disarming skips all checks (us).
const QUICK_REARM_US: u64 = 5_000_000;
/// Sticks not received for this long are no sticks (us).
const STICK_TIMEOUT_US: u64 = 500_000;
/// Falls to Hold that are remembered one by one; all are counted.
pub const HOLD_FALLS_KEPT: usize = 64;

/// The companion failed, and the autopilot left the mode in which it obeyed it: to Hold, or, from OFFBOARD, to whatever
/// follows the loss there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldFall {
    /// Boot time (s).
    pub time_s: f64,
    /// Mode before.
    pub from: NavMode,
    /// Why.
    pub cause: HoldCause,
}

/// The situation a decision is made in.
#[derive(Clone, Copy, Debug)]
pub struct Situation {
    /// Boot time (us).
    pub now_us: u64,
    /// On the ground.
    pub landed: bool,
    /// The estimator has a position.
    pub position_ready: bool,
    /// There is a mission.
    pub has_mission: bool,
    /// OFFBOARD setpoints arrive.
    pub offboard_alive: bool,
}

/// A text for the pilot.
pub type Text<'a> = (MavSeverity, std::fmt::Arguments<'a>);

/// What overrides the mode somebody wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Failsafe {
    /// Nothing.
    None,
    /// PX4 of 2021: sticks or setpoints are missing.
    UntilAsked,
    /// Setpoints are missing, or are back since `back_us` (boot time).
    OffboardLost { back_us: Option<u64> },
    /// Sticks are missing since `since_us` (boot time).
    SticksLost { since_us: u64 },
}

/// Modes and arming.
#[derive(Clone, Debug)]
pub struct Commander {
    firmware: Firmware,
    mode: NavMode,
    /// What an operator or the normal course last asked for: what a failsafe that ends goes back to.
    intended: NavMode,
    armed: bool,
    failsafe: Failsafe,
    changed_us: u64,
    was_in_air: bool,
    landed_us: Option<u64>,
    disarmed_us: Option<u64>,
    sticks_us: Option<u64>,
    /// What is known of the companion.
    pub companion: CompanionHealth,
    demanded_hold: Option<(u64, HoldCause)>,
    falls: Vec<HoldFall>,
    fall_count: u32,
}

impl Commander {
    /// Disarmed in MANUAL.
    pub fn new(firmware: Firmware) -> Self {
        Self {
            firmware,
            mode: NavMode::Manual,
            intended: NavMode::Manual,
            armed: false,
            failsafe: Failsafe::None,
            changed_us: 0,
            was_in_air: false,
            landed_us: None,
            disarmed_us: None,
            sticks_us: None,
            companion: CompanionHealth::new(firmware),
            demanded_hold: None,
            falls: Vec::with_capacity(HOLD_FALLS_KEPT),
            fall_count: 0,
        }
    }

    /// Mode in force.
    pub fn mode(&self) -> NavMode {
        self.mode
    }

    /// The mode somebody wants, in force or not.
    pub fn intended(&self) -> NavMode {
        self.intended
    }

    /// Motors armed.
    pub fn is_armed(&self) -> bool {
        self.armed
    }

    /// In a failsafe of its own (not the companion's).
    pub fn in_failsafe(&self) -> bool {
        self.failsafe != Failsafe::None
    }

    /// Falls to Hold because of the companion, the first [`HOLD_FALLS_KEPT`] of them.
    pub fn falls(&self) -> &[HoldFall] {
        &self.falls
    }

    /// How many there were.
    pub fn fall_count(&self) -> u32 {
        self.fall_count
    }

    /// Whether sticks are received.
    pub fn has_sticks(&self, now_us: u64) -> bool {
        self.sticks_us
            .is_some_and(|at_us| now_us - at_us < STICK_TIMEOUT_US)
    }

    /// Sticks were received.
    pub fn receive_sticks(&mut self, now_us: u64) {
        self.sticks_us = Some(now_us);
    }

    /// A heartbeat of somebody else was received.
    pub fn receive_heartbeat(&mut self, now_us: u64, own_system_id: u8, heartbeat: &ForeignHeartbeat) {
        self.companion.receive(now_us, own_system_id, heartbeat);
    }

    /// Changes the mode on demand of an operator.
    ///
    /// # Errors
    /// The reason why the mode cannot be flown now.
    pub fn set_mode(&mut self, mode: NavMode, situation: &Situation) -> Result<(), Refusal> {
        if self.armed || !self.firmware.remembers_wishes() {
            self.check_mode(mode, situation)?;
        }
        self.proceed_to(mode);
        self.failsafe = Failsafe::None;
        self.demanded_hold = None;
        Ok(())
    }

    /// Whether a mode can be flown now.
    fn check_mode(&self, mode: NavMode, situation: &Situation) -> Result<(), Refusal> {
        if mode.is_automatic() && !situation.position_ready {
            return Err(Refusal::NoPosition);
        }
        if mode == NavMode::Mission && !situation.has_mission {
            return Err(Refusal::NoMission);
        }
        if mode == NavMode::Offboard && !situation.offboard_alive {
            return Err(Refusal::NoOffboardSignal);
        }
        let needs_sticks = !situation.landed || self.firmware.remembers_wishes();
        let by_sticks = matches!(mode, NavMode::Manual | NavMode::Position);
        if by_sticks && needs_sticks && !self.has_sticks(situation.now_us) {
            return Err(Refusal::NoSticks);
        }
        Ok(())
    }

    /// Changes the mode as part of the normal course (take-off done, mission done).
    pub fn proceed_to(&mut self, mode: NavMode) {
        self.mode = mode;
        self.intended = mode;
    }

    /// Arms.
    ///
    /// # Errors
    /// The check that failed. Within 5 s of disarming nothing is checked.
    pub fn arm(
        &mut self,
        forced: bool,
        parameters: &Parameters,
        situation: &Situation,
    ) -> Result<(), Refusal> {
        if self.armed {
            return Ok(());
        }
        let now_us = situation.now_us;
        let quick = self
            .disarmed_us
            .is_some_and(|at_us| now_us - at_us < QUICK_REARM_US);
        if !quick && !forced {
            self.check_arming(parameters, situation)?;
        }
        self.armed = true;
        self.changed_us = now_us;
        self.was_in_air = false;
        self.landed_us = None;
        Ok(())
    }

    /// Whether arming would succeed now.
    ///
    /// # Errors
    /// The check that fails.
    pub fn check_arming(&self, parameters: &Parameters, situation: &Situation) -> Result<(), Refusal> {
        if !situation.position_ready {
            return Err(match self.firmware {
                Firmware::Trajectory(_) => Refusal::NoPosition,
                Firmware::Current => Refusal::UnhealthyToArm,
            });
        }
        if parameters.avoidance_enabled() && !self.companion.is_valid() {
            return Err(Refusal::AvoidanceNotReady);
        }
        if self.firmware.remembers_wishes() && self.check_mode(self.mode, situation).is_err() {
            return Err(Refusal::UnhealthyToArm);
        }
        Ok(())
    }

    /// Disarms; in the air only by force.
    ///
    /// # Errors
    /// [`Refusal::NotLanded`].
    pub fn disarm(&mut self, forced: bool, situation: &Situation) -> Result<(), Refusal> {
        if self.armed && !situation.landed && !forced {
            return Err(Refusal::NotLanded);
        }
        self.switch_off(situation.now_us);
        Ok(())
    }

    fn switch_off(&mut self, now_us: u64) {
        if self.armed {
            self.disarmed_us = Some(now_us);
            self.changed_us = now_us;
        }
        self.armed = false;
        self.failsafe = Failsafe::None;
        self.intended = self.mode;
    }

    /// The flight task demands Hold because the companion failed it. PX4 addresses that command to system 1, whatever
    /// its own number: other vehicles never take it.
    pub fn demand_hold(&mut self, now_us: u64, own_system_id: u8, cause: HoldCause) {
        if own_system_id == 1 && self.demanded_hold.is_none() {
            self.demanded_hold = Some((now_us + COMMAND_DELAY_US, cause));
        }
    }

    /// One step: time-outs, failsafes, automatic disarming. Texts go to `say`.
    pub fn step(&mut self, situation: &Situation, parameters: &Parameters, mut say: impl FnMut(Text)) {
        let now_us = situation.now_us;
        let required = parameters.avoidance_enabled();
        let changes = self
            .companion
            .check(now_us, required, parameters.get(P::COM_OBC_LOSS_T));
        match changes.controller {
            Some(Change::Lost) => say((
                MavSeverity::MAV_SEVERITY_CRITICAL,
                format_args!("Connection to mission computer lost"),
            )),
            Some(Change::Back) => say((
                MavSeverity::MAV_SEVERITY_INFO,
                format_args!("Onboard controller regained"),
            )),
            None => {}
        }
        if changes.ground_station == Some(Change::Lost) {
            let text = format_args!("Connection to ground station lost");
            say((MavSeverity::MAV_SEVERITY_INFO, text));
        }
        if let Some((due_us, cause)) = self.demanded_hold
            && now_us >= due_us
        {
            self.demanded_hold = None;
            self.fall_to_hold(now_us, cause);
        }
        if self.armed {
            match self.firmware {
                Firmware::Trajectory(_) => self.check_failsafes(situation, &mut say),
                Firmware::Current => self.check_wishes(situation, parameters, &mut say),
            }
        }
        self.disarm_when_done(situation, parameters, &mut say);
    }

    fn fall_to_hold(&mut self, now_us: u64, cause: HoldCause) {
        let under_sticks = cause == HoldCause::NoObstacleData;
        let concerned = if under_sticks {
            self.mode == NavMode::Position
        } else {
            self.mode.is_automatic() && self.mode != NavMode::Hold
        };
        if !concerned {
            return;
        }
        if under_sticks {
            // Setpoints that come back do not take a vehicle that was sent to Hold back to OFFBOARD.
            self.failsafe = Failsafe::None;
        }
        self.note_fall(now_us, cause);
        self.proceed_to(NavMode::Hold);
    }

    fn note_fall(&mut self, now_us: u64, cause: HoldCause) {
        self.fall_count += 1;
        tracing::warn!(?cause, from = ?self.mode, "the companion has failed");
        if self.falls.len() < HOLD_FALLS_KEPT {
            self.falls.push(HoldFall {
                time_s: now_us as f64 * 1e-6,
                from: self.mode,
                cause,
            });
        }
    }

    fn disarm_when_done(
        &mut self,
        situation: &Situation,
        parameters: &Parameters,
        say: &mut impl FnMut(Text),
    ) {
        if !self.armed {
            return;
        }
        let now_us = situation.now_us;
        let waited = |since_us: u64, limit: P| {
            let limit_s = parameters.get(limit);
            limit_s > 0.0 && (now_us - since_us) as f64 * 1e-6 > limit_s
        };
        if !situation.landed {
            self.was_in_air = true;
            self.landed_us = None;
            return;
        }
        let done = if self.was_in_air {
            let since_us = *self.landed_us.get_or_insert(now_us);
            waited(since_us, P::COM_DISARM_LAND)
        } else {
            waited(self.changed_us, P::COM_DISARM_PRFLT)
        };
        if done {
            self.switch_off(now_us);
            let text = if self.was_in_air {
                "Disarmed by landing"
            } else {
                "Disarmed by auto preflight disarming"
            };
            say((MavSeverity::MAV_SEVERITY_INFO, format_args!("{text}")));
        }
    }
}
