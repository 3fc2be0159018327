//! Whether a vehicle with these sensors can be planned for at all: reported while it stands on the ground, and, with
//! what the user declares, when it is armed.
//!
//! What nothing was seen of yet is not missing. Some sensors do not say where they got no answer: while all send and have
//! answered, they look where their models do. And who begins to plan in the air does not judge: on the ground it was judged, and
//! there what is below was hidden.

use super::Planner;
use crate::speed_tiers::CRAWL_TIER;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::map::{LocalMap, declared_as};
use jink_shared_types::params::{self, ParamSet};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::view::{FieldOfView, Missing, Needs};

/// Time in which every sensor has covered its field of view (s).
const OBSERVED_S: f64 = 1.5;

/// State of the check.
#[derive(Clone, Copy, Debug)]
pub(super) struct SensorCoverage {
    needs: Needs,
    /// Where the sensors look by their models.
    nominal: FieldOfView,
    /// Since when there are answers of sensors.
    since: Timestamp,
    /// What was missing at the last check; the outer `None`: not checked yet.
    judged: Option<Option<Missing>>,
    was_armed: Option<bool>,
}

impl SensorCoverage {
    /// For a vehicle that needs `clearance_m` in the slowest speed tier.
    pub fn new(params: &ParamSet, clearance_m: f64) -> Self {
        Self {
            needs: Needs {
                clearance_m,
                start_bubble_m: params.get(&params::OA_DCL_START),
                no_overhang: false,
                is_landed: false,
            },
            nominal: FieldOfView::default(),
            since: Timestamp::NEVER,
            judged: None,
            was_armed: None,
        }
    }

    /// The directions at which a sensor looks by its model, besides those of others.
    pub fn add_nominal(&mut self, view: &FieldOfView) {
        self.nominal.join(view);
    }

    /// What no sensor sees, by the last check.
    pub fn unseen(&self) -> Missing {
        self.judged.flatten().unwrap_or(Missing::Nothing)
    }
}

impl Planner {
    /// Checks what is seen; reports what is missing once, and again when the vehicle is armed, with what is declared.
    pub(super) fn watch_sensors(&mut self, now: Timestamp, state: &VehicleState, map: Option<&LocalMap>) {
        let Some(map) = map.filter(|map| !map.view.is_empty()) else {
            return;
        };
        if !self.coverage.since.is_set() {
            self.coverage.since = now;
        }
        let is_armed = state.armed.is_set();
        let was_armed = self.coverage.was_armed.replace(is_armed);
        let is_arming = is_armed && was_armed == Some(false);
        if is_arming {
            let declared = declared_as::NAMES
                .iter()
                .filter(|(bit, _)| map.declarations & bit != 0);
            self.events
                .extend(declared.map(|(_, name)| EventSample::new(&events::DECLARED, name, [0.0; 2])));
        }
        let is_late = is_armed && !is_arming && (self.coverage.judged.is_some() || !state.landed.is_set());
        if now.seconds_since(self.coverage.since) < OBSERVED_S || is_late {
            return;
        }
        let needs = Needs {
            no_overhang: map.declarations & declared_as::NO_OVERHANG != 0,
            is_landed: state.landed.is_set(),
            clearance_m: self.space.radius_m(CRAWL_TIER),
            ..self.coverage.needs
        };
        let mut view = map.view;
        // In the open a frame may be without an answer.
        let sending = map.sending_sensors.get().map_or(map.live_sensors, u16::from);
        if sending >= self.sensors && view.sensors >= u32::from(self.sensors) {
            view.join(&self.coverage.nominal);
        }
        let missing = view.missing(&needs);
        let is_new = self.coverage.judged.replace(missing) != Some(missing) || is_arming;
        if let (Some(missing), true) = (missing, is_new) {
            self.events.push(EventSample::new(
                &events::SENSORS_UNFIT,
                &missing.to_string(),
                [0.0; 2],
            ));
        }
    }
}
