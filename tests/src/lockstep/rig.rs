//! What a flight changes of its processes: the addresses of the radio link, the vehicle, the world, the user's planner.

use super::VEHICLE;
use crate::board::Rig;
use crate::proposer::{Plan, ProposerService};
use jink_runtime::config::Config;
use jink_runtime::lockstep::Member;
use jink_simulated_world::world::World;
use jink_simulator::autopilot::AutopilotConfig;
use jink_simulator::service::{SensorService, VehicleService};
use std::any::Any;
use std::cell::RefCell;
use std::rc::Rc;

/// What is flown, and where: no configuration can say it as exactly.
pub(super) struct Flown {
    pub(super) autopilot: AutopilotConfig,
    pub(super) world: World,
    pub(super) proposer: Plan,
}

/// Sets the processes of a flight up.
pub(super) struct FlightRig {
    pub(super) wire: String,
    pub(super) vehicle: String,
    pub(super) flown: Rc<RefCell<Flown>>,
}

impl Rig for FlightRig {
    /// The vehicle and the gateway are at the two ends of the radio.
    fn configure(&self, process: &str, config: &mut Config) {
        let side = if process == VEHICLE {
            &self.vehicle
        } else {
            &self.wire
        };
        config.link.address.clone_from(side);
    }

    fn fit(&self, process: &mut dyn Any) {
        let flown = self.flown.borrow();
        if let Some(member) = process.downcast_mut::<Member<VehicleService>>()
            && let Ok(autopilot) = flown.autopilot.clone().build()
        {
            member.service_mut().replace(autopilot, flown.world.clone());
        }
        if let Some(member) = process.downcast_mut::<Member<SensorService>>() {
            member.service_mut().move_world(flown.world.clone());
        }
        if let Some(member) = process.downcast_mut::<Member<ProposerService>>() {
            member.service_mut().plan = flown.proposer;
        }
    }
}
