//! Collision prevention for a pilot who steers through jink: the demand in, what may be flown out, and events once per
//! change.

use super::{HorizontalSetpoint, Prevention, PreventionConfig, PreventionOutput};
use crate::step_events::StepEvents;
use jink_shared_types::coded::Wire;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::prevention::{PilotDemand, PreventedDemand, PreventionState};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Coded, Reading, Timestamp, Velocity};
use nalgebra::Vector2;

/// The end of its action is reported when it has not acted for so long (s): at the edge of acting it would be reported
/// again and again.
const RESTS_S: f64 = 1.0;

/// What was last reported to the pilot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum ReportedState {
    #[default]
    Nothing,
    Acts,
    Blind,
    Holds,
}

/// Limits the pilot's demands and reports changes.
#[derive(Clone, Debug)]
pub struct PilotGuard {
    prevention: Prevention,
    reported: ReportedState,
    /// When it last acted.
    acted: Timestamp,
}

impl PilotGuard {
    /// Without any data yet.
    pub fn new(config: PreventionConfig) -> Self {
        Self {
            prevention: Prevention::new(config),
            reported: ReportedState::Nothing,
            acted: Timestamp::NEVER,
        }
    }

    /// Uses new parameters from now on.
    pub fn configure(&mut self, config: PreventionConfig) {
        self.prevention.configure(config);
    }

    /// The parameters in force.
    pub fn config(&self) -> &PreventionConfig {
        self.prevention.config()
    }

    /// What of `demand` may be flown, with `ring` around the vehicle; `None` if no pilot steers.
    pub fn step(
        &mut self,
        now: Timestamp,
        demand: Reading<'_, PilotDemand>,
        state: Reading<'_, VehicleState>,
        ring: &SectorRing,
    ) -> Option<(PreventedDemand, StepEvents)> {
        let mut step_events = StepEvents::default();
        let Some(demand) = demand.fresh() else {
            self.reported = ReportedState::Nothing;
            return None;
        };
        let wanted = demand.sample.velocity.vector().xy();
        let velocity = state
            .fresh()
            .map_or_else(Vector2::zeros, |state| state.sample.velocity.vector().xy());
        let outcome = self
            .prevention
            .step(now, ring, HorizontalSetpoint::Velocity(wanted), velocity);
        self.report_events(now, &outcome, &mut step_events);
        let allowed = if outcome.setpoint.iter().all(|v| v.is_finite()) {
            outcome.setpoint
        } else {
            // Switched off, the demand is passed on; one that is not a number becomes zero.
            Vector2::zeros()
        };
        let prevented = PreventedDemand {
            velocity: Velocity::new(allowed.x, allowed.y, 0.0),
            nearest_m: outcome.nearest.map_or(0.0, |(_, reach_m)| reach_m as f32),
            state: Coded::new(outcome.state),
            cause: Coded::new(outcome.cause),
            ..PreventedDemand::default()
        };
        Some((prevented, step_events))
    }

    fn report_events(&mut self, now: Timestamp, outcome: &PreventionOutput, step_events: &mut StepEvents) {
        let state = match outcome.state {
            PreventionState::Hold => ReportedState::Holds,
            PreventionState::Blind if outcome.must_warn => ReportedState::Blind,
            PreventionState::Blind => self.reported,
            PreventionState::Acting => ReportedState::Acts,
            PreventionState::Off | PreventionState::Free => ReportedState::Nothing,
        };
        if state != ReportedState::Nothing {
            self.acted = now;
        }
        let rests = state == ReportedState::Nothing && now.seconds_since(self.acted) < RESTS_S;
        if state == self.reported || rests {
            return;
        }
        self.reported = state;
        let nearest_m = outcome.nearest.map_or(0.0, |(_, reach_m)| reach_m);
        step_events.add(match state {
            ReportedState::Acts => {
                EventSample::new(&events::PREVENTION_ACTS, outcome.cause.name(), [nearest_m, 0.0])
            }
            ReportedState::Blind => EventSample::new(&events::PREVENTION_BLIND, "", [0.0; 2]),
            ReportedState::Holds => EventSample::new(&events::PREVENTION_HOLDS, "", [0.0; 2]),
            ReportedState::Nothing => EventSample::new(&events::PREVENTION_RESTS, "", [0.0; 2]),
        });
    }
}
