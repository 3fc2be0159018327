//! The mission, where jink flies it in the autopilot's stead: what the executive sees and what becomes of its intents.

use super::Gateway;
use super::watch::Echoes;
use crate::executive::client::MissionClient;
use crate::executive::georeference::Georeference;
use crate::executive::{Demand, Executive, Intent, Part, Scene};
use crate::io::Outputs;
use crate::make::Make;
use crate::message::{Body, COMPONENT_AUTOPILOT};
use crate::profile::pilot::Nearness;
use crate::ticker::Ticker;
use jink_shared_types::events::{MODE_REFUSED, UNGUARDED};
use jink_shared_types::link::AvoidanceState;
use jink_shared_types::vehicle::{DesiredPath, NavMode};
use jink_shared_types::{Coded, Timestamp};
use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavModeFlag, MavResult,
};

/// Rate at which the wish is repeated (Hz), as the topic table says.
const WISH_RATE_HZ: f64 = 5.0;

/// Everything about a mission that jink flies.
#[derive(Clone, Debug)]
pub(super) struct MissionFlight {
    client: MissionClient,
    executive: Executive,
    georeference: Georeference,
    /// The last wish, and when it is due again.
    wish: Option<DesiredPath>,
    repeat: Ticker,
    /// Mode at the last step.
    mode: NavMode,
    was_refused: bool,
    pub(super) echoes: Echoes,
}

impl MissionFlight {
    pub(super) fn new(part: Part) -> Self {
        Self {
            client: MissionClient::default(),
            executive: Executive::new(part),
            georeference: Georeference::default(),
            wish: None,
            repeat: Ticker::new(WISH_RATE_HZ),
            mode: NavMode::Unknown,
            was_refused: false,
            echoes: Echoes::default(),
        }
    }

    /// What is wanted now; the setpoints are flown, or are about to be.
    pub(super) fn wants_a_plan(&self) -> bool {
        self.wish.is_some_and(|wish| wish.wants_planning())
    }

    /// Takes a message of the autopilot's.
    pub(super) fn take(&mut self, now: Timestamp, message: &MavMessage) {
        match message {
            MavMessage::LOCAL_POSITION_NED(position) => self.georeference.take_local(position),
            MavMessage::GLOBAL_POSITION_INT(position) => self.georeference.take_global(position),
            _ => {}
        }
        self.client.take(now, message);
    }

    /// The autopilot is heard for the first time, or again.
    pub(super) fn read_anew(&mut self, now: Timestamp) {
        self.client.begin(now);
    }

    /// What is wanted, as it was said last.
    pub(super) fn wish(&self) -> Option<DesiredPath> {
        self.wish
    }

    /// The item that is flown to is left out.
    pub(super) fn skip(&mut self) {
        self.executive.skip();
    }

    pub(super) fn home_down_m(&self) -> Option<f64> {
        self.georeference.home_down_m()
    }
}

impl Gateway {
    /// One step of the mission, if jink flies it.
    pub(super) fn run_mission(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let Some(system_id) = self.latch.system_id(now).filter(|_| self.was_alive) else {
            return;
        };
        let nearness = self.profile.nearness();
        let ready = self.heartbeats.said() == AvoidanceState::Active;
        let present = self.vehicle.present(now);
        let mode = self.vehicle.mode();
        let Some(flight) = &mut self.mission else { return };
        let before = std::mem::replace(&mut flight.mode, mode);
        // A mission may have been changed while nobody looked.
        let begins = match mode {
            NavMode::Mission => before != mode,
            NavMode::Offboard => !matches!(before, NavMode::Offboard | NavMode::Mission),
            _ => false,
        };
        if begins {
            flight.client.refresh(now);
        }
        let scene = Scene {
            now,
            mode,
            armed: self.vehicle.is_armed(),
            in_air: self.vehicle.has_taken_off(),
            position: present.map(|present| present.position),
            speed_mps: present.map_or(f64::INFINITY, |present| present.velocity.norm()),
            items: flight.client.items(),
            current: self.current_item.map(|(item, _)| item),
            ready,
            on_plan: nearness == Nearness::OnPlan,
        };
        let Intent {
            path,
            demand,
            unguarded,
        } = flight
            .executive
            .step(&scene, |item| flight.georeference.place(item));
        // What lies too far from the vehicle must be planned anew: nothing is wanted for a moment.
        let wish = path
            .filter(|_| nearness != Nearness::Astray)
            .unwrap_or(DesiredPath {
                mode: Coded::new(mode),
                ..DesiredPath::default()
            });
        let changed = flight.wish.is_none_or(|before| !is_same(&before, &wish));
        let keeps_flying = path.is_none() && mode == NavMode::Offboard && nearness != Nearness::Astray;
        flight.wish = Some(wish);
        if flight.repeat.take(now) || changed {
            // Without a wish what is committed is flown to its end: nothing is said, so nothing is mirrored.
            if !keeps_flying {
                outputs.desired_path = Some((wish, now));
                self.wire.status.desired_paths += 1;
            }
        }
        let request = flight.client.request(now, (system_id, COMPONENT_AUTOPILOT));
        if let Some(request) = request {
            outputs.send(self.outgoing(now, Body::Message(request)));
        }
        if let Some(demand) = demand {
            self.demand(now, demand, outputs);
        }
        if unguarded {
            self.tell(now, &UNGUARDED, 0.0, outputs);
        }
    }

    pub(super) fn demand(&mut self, now: Timestamp, demand: Demand, outputs: &mut Outputs) {
        let target = self.latch.system_id(now).zip(self.vehicle.make());
        let command =
            target.and_then(|(system_id, make)| command(demand, make, (system_id, COMPONENT_AUTOPILOT)));
        if let Some(command) = command {
            tracing::info!("asked of the autopilot: {demand:?}");
            outputs.send(self.outgoing(now, Body::Message(command)));
        }
    }

    /// The answer to a demand; a refusal is told once.
    pub(super) fn take_mode_answer(&mut self, now: Timestamp, ack: &COMMAND_ACK_DATA, outputs: &mut Outputs) {
        let Some(flight) = &mut self.mission else { return };
        if ack.command != MavCmd::MAV_CMD_DO_SET_MODE {
            return;
        }
        let refused = ack.result != MavResult::MAV_RESULT_ACCEPTED;
        let news = refused && !flight.was_refused;
        flight.was_refused = refused;
        if news {
            self.tell(now, &MODE_REFUSED, f64::from(ack.result as u8), outputs);
        }
    }
}

/// Whether a planner would make the same of both.
fn is_same(a: &DesiredPath, b: &DesiredPath) -> bool {
    let place = |path: &DesiredPath| path.points.map(|point| point.position.vector());
    let near = |(a, b): (&nalgebra::Vector3<f64>, &nalgebra::Vector3<f64>)| (a - b).norm() < 1e-3;
    a.mode == b.mode
        && a.wants_planning() == b.wants_planning()
        && (!a.wants_planning() || place(a).iter().zip(&place(b)).all(near))
}

/// The command that asks for it.
fn command(demand: Demand, make: Make, (target_system, target_component): (u8, u8)) -> Option<MavMessage> {
    let mode = |mode| {
        let (main, sub) = make.mode_numbers(mode)?;
        let custom = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.bits();
        let numbers = [f32::from(custom), main as f32, sub as f32];
        Some((MavCmd::MAV_CMD_DO_SET_MODE, numbers))
    };
    let (command, [param1, param2, param3]) = match demand {
        Demand::Follow => mode(NavMode::Offboard)?,
        Demand::Mission => mode(NavMode::Mission)?,
        Demand::Hold => mode(NavMode::Hold)?,
        // The second parameter resets the mission where it is 1.
        Demand::Current(item) => (
            MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT,
            [f32::from(item), 0.0, 0.0],
        ),
    };
    Some(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1,
        param2,
        param3,
        command,
        target_system,
        target_component,
        ..COMMAND_LONG_DATA::default()
    }))
}
