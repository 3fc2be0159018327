//! The goal: what the autopilot's mode and desired path ask for, between the heights allowed.

use super::{Planner, PlannerInputs};
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::vehicle::{DesiredPath, NavMode, VehicleState};

impl Planner {
    /// `None`: mirror. `Some(None)`: plan, but the desired path is stale. `Some(Some(_))`: plan.
    pub(super) fn desired_path(
        &mut self,
        state: &VehicleState,
        inputs: &PlannerInputs<'_>,
    ) -> Option<Option<DesiredPath>> {
        let desired = inputs.desired.fresh();
        if let Some(desired) = &desired {
            self.follows_setpoints = desired.mode.get() == NavMode::Offboard;
        }
        let planned_mode = match state.mode.get() {
            // Setpoints of another program may be followed as well.
            NavMode::Offboard => self.follows_setpoints,
            mode => mode.is_automatic(),
        };
        if !planned_mode || !state.armed.is_set() {
            return None;
        }
        match desired {
            // It belongs to the mode before; that of this mode comes next.
            Some(desired) if desired.mode.get().is_automatic() && desired.mode != state.mode => Some(None),
            Some(desired) => desired.wants_planning().then_some(Some(*desired.sample)),
            None => Some(None),
        }
    }

    /// The waypoint, kept between the heights allowed.
    pub(super) fn clamped_goal(&self, desired: &DesiredPath, state: &VehicleState) -> Point<LocalNed> {
        let waypoint = desired.points[1].position;
        let (highest_m, lowest_m) = self.down_range_m(state);
        Point::new(
            waypoint.x_m,
            waypoint.y_m,
            waypoint.z_m.clamp(highest_m, lowest_m),
        )
    }

    /// Smallest and largest down coordinate allowed (m). Never empty: two parameters that contradict each other leave
    /// the greatest height.
    pub(super) fn down_range_m(&self, state: &VehicleState) -> (f64, f64) {
        let home_m = if state.home_down_m.is_finite() {
            state.home_down_m
        } else {
            0.0
        };
        let (highest_m, lowest_m) = (home_m - self.height_range_m.1, home_m - self.height_range_m.0);
        (highest_m, lowest_m.max(state.position.z_m).max(highest_m))
    }
}
