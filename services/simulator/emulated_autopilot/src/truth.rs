//! The ground truth of a flight: how close it came, how fast it went, what failed.

use crate::Autopilot;
use crate::{MissionProgress, SetpointStatistics};
use jink_shared_types::truth::SimTruth;
use jink_shared_types::vehicle::NavMode;
use jink_shared_types::{Coded, Flag};
use jink_simulated_world::vehicle::VehicleTruth;
use jink_simulated_world::world::World;
use nalgebra::Vector3;

/// A contact counts again after the vehicle has been this far from everything (m).
const CLEAR_AGAIN_M: f64 = 0.05;

/// What there is to be seen of a flight after a step.
#[derive(Clone, Copy, Debug)]
pub struct Observed<'a> {
    /// Simulated time (s).
    pub time_s: f64,
    /// Where the vehicle really is.
    pub truth: &'a VehicleTruth,
    /// Mode in force.
    pub mode: NavMode,
    /// Motors armed.
    pub armed: bool,
    /// On the ground.
    pub landed: bool,
    /// How far the mission has come.
    pub mission: MissionProgress,
    /// What arrived from the companion.
    pub setpoints: &'a SetpointStatistics,
    /// How often the autopilot fell to Hold because its companion failed it.
    pub hold_count: u32,
}

impl<'a> Observed<'a> {
    /// What there is to be seen of an emulated autopilot.
    pub fn of(autopilot: &'a dyn Autopilot) -> Self {
        Self {
            time_s: autopilot.time_s(),
            truth: autopilot.truth(),
            mode: autopilot.mode(),
            armed: autopilot.is_armed(),
            landed: autopilot.is_landed(),
            mission: autopilot.mission(),
            setpoints: autopilot.setpoint_statistics(),
            hold_count: autopilot.hold_count(),
        }
    }
}

/// Watches one flight.
#[derive(Clone, Debug)]
pub struct Observer {
    hull_radius_m: f64,
    min_clearance_m: f64,
    collisions: u32,
    touching: bool,
    flown_m: f64,
    cruise_s: f64,
    cruise_m: f64,
    last: Option<(f64, Vector3<f64>)>,
}

impl Observer {
    /// For a vehicle within a sphere of `hull_radius_m`.
    pub fn new(hull_radius_m: f64) -> Self {
        Self {
            hull_radius_m,
            min_clearance_m: f64::INFINITY,
            collisions: 0,
            touching: false,
            flown_m: 0.0,
            cruise_s: 0.0,
            cruise_m: 0.0,
            last: None,
        }
    }

    /// Looks at an emulated autopilot after a step.
    pub fn observe(&mut self, autopilot: &dyn Autopilot, world: &World) -> SimTruth {
        self.judge(&Observed::of(autopilot), world)
    }

    /// Looks at the state after a step; the ground is no obstacle.
    pub fn judge(&mut self, seen: &Observed<'_>, world: &World) -> SimTruth {
        let truth = seen.truth;
        let in_air = seen.armed && !truth.on_ground;
        let clearance_m = world.clearance_to_obstacles_m(truth.position) - self.hull_radius_m;
        if in_air {
            self.min_clearance_m = self.min_clearance_m.min(clearance_m);
        }
        if clearance_m < 0.0 && !self.touching {
            self.collisions += 1;
        }
        self.touching = clearance_m < 0.0 || self.touching && clearance_m < CLEAR_AGAIN_M;
        self.measure_way(seen, in_air);
        let (mission, setpoints) = (seen.mission, seen.setpoints);
        SimTruth {
            position: truth.position,
            velocity: truth.velocity,
            attitude: truth.attitude,
            clearance_m,
            min_clearance_m: self.min_clearance_m,
            flown_m: self.flown_m,
            cruise_s: self.cruise_s,
            cruise_m: self.cruise_m,
            time_s: seen.time_s,
            setpoint_gap_max_s: setpoints.gap_max_s,
            setpoints: setpoints.count,
            sequence_breaks: setpoints.sequence_breaks,
            collisions: self.collisions,
            hold_count: seen.hold_count,
            mission_item: mission.current,
            mission_items: mission.total,
            mode: Coded::new(seen.mode),
            armed: Flag::from(seen.armed),
            landed: Flag::from(seen.landed),
            mission_done: Flag::from(mission.done),
            hull_radius_m: self.hull_radius_m,
            late_max_s: 0.0,
        }
    }

    fn measure_way(&mut self, seen: &Observed<'_>, in_air: bool) {
        let (now_s, position) = (seen.time_s, seen.truth.position.vector());
        if let (Some((last_s, last)), true) = (self.last, in_air) {
            let way_m = (position - last).norm();
            self.flown_m += way_m;
            let cruises = matches!(seen.mode, NavMode::Mission | NavMode::Offboard);
            if cruises && !seen.mission.done {
                self.cruise_s += now_s - last_s;
                self.cruise_m += way_m;
            }
        }
        self.last = Some((now_s, position));
    }
}
