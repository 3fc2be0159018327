//! What the gateway makes of each message it receives.

use super::Gateway;
use super::assist::AssistedFlight;
use super::mission::MissionFlight;
use super::steering::Steering;
use crate::desired::{self, VerticalMotions};
use crate::executive::record::Record;
use crate::executive::{FlightGoal, Part};
use crate::io::Outputs;
use crate::note::Note;
use crate::ranges::Arrived;
use crate::vehicle::AttitudeNews;
use jink_mavlink_link::clock_map::ClockMap;
use jink_mavlink_link::message::{Body, COMPONENT_AUTOPILOT, Content, Destination, Outgoing, Received};
use jink_mavlink_link::vehicle_selector::{is_autopilot, is_from_autopilot};
use jink_shared_types::Timestamp;
use jink_shared_types::beams::BeamRefused;
use jink_shared_types::events::{AUTOPILOT_RESTARTED, CLOCK_STEPPED, EventSample};
use mavlink::Message;
use mavlink::dialect::{MavMessage, TIMESYNC_DATA};

impl Gateway {
    /// Takes in one message.
    pub(super) fn take(&mut self, now: Timestamp, received: &Received, outputs: &mut Outputs) {
        let header = received.header;
        if self.serve(now, received, outputs) {
            return;
        }
        if let Content::Message(message) = &received.content
            && header.component_id == COMPONENT_AUTOPILOT
            && !self.config.ground_station_links.contains(received.link)
            && let Ok(system_id) = u8::try_from(header.system_id)
        {
            if is_from_autopilot(message) {
                self.selector.observe(system_id, received.time);
            }
            if self.selector.system_id(now) == Some(system_id)
                && self.selector.is_selected_link(received.link, received.time)
            {
                self.wire.status.received += 1;
                self.vehicle.received(received.time);
                self.take_message(now, received, message, outputs);
                return;
            }
        }
        self.take_row(now, received, outputs);
        if let Content::Message(MavMessage::HEARTBEAT(heartbeat)) = &received.content
            && self.selector.system_id(now).is_some()
            && received.link == self.autopilot_link()
        {
            self.radio.observe(received.time, heartbeat);
        }
        self.observe(now, received);
        self.ignored += 1;
    }

    /// Rows of ranges of another component are taken from our vehicle only, and not from a ground station's link.
    fn take_row(&mut self, now: Timestamp, received: &Received, outputs: &mut Outputs) {
        let header = received.header;
        let is_ours = self.selector.system_id(now).map(u32::from) == Some(header.system_id)
            && header.component_id != COMPONENT_AUTOPILOT
            && !self.config.ground_station_links.contains(received.link);
        if let Content::Message(MavMessage::OBSTACLE_DISTANCE(row)) = &received.content
            && is_ours
        {
            let arrived = self.sources.take_row(header.component_id, row, received.time);
            see(header.component_id, arrived, outputs);
        }
    }

    #[allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; this profile is for the versions before.
    fn take_message(
        &mut self,
        now: Timestamp,
        received: &Received,
        message: &MavMessage,
        outputs: &mut Outputs,
    ) {
        let time = received.time;
        if let Some(ahead_s) = self.clock.take_step() {
            self.vehicle.clock_was_set(ahead_s);
            outputs.report(EventSample::new(&CLOCK_STEPPED, "autopilot", [ahead_s, 0.0]));
        }
        self.streams.arrived(message.message_id());
        self.profile_check.fit.take(message);
        if let Some(flight) = &mut self.mission {
            flight.take(now, message);
            if let Some(home_down_m) = flight.home_down_m() {
                self.vehicle.infer_home(home_down_m);
            }
        }
        match message {
            MavMessage::HEARTBEAT(heartbeat) if is_autopilot(heartbeat) => {
                self.vehicle.take_heartbeat(heartbeat);
            }
            MavMessage::LOCAL_POSITION_NED(position) => {
                let mapped = self.clock.map_ms(position.time_boot_ms, time);
                if self.vehicle.take_position(position, time, mapped) {
                    self.autopilot_restarted(now, outputs);
                }
            }
            MavMessage::ATTITUDE_QUATERNION(attitude) => {
                let mapped = self.clock.map_ms(attitude.time_boot_ms, time);
                match self.vehicle.take_attitude(attitude, time, mapped) {
                    AttitudeNews::Taken => outputs.vehicle_state = self.vehicle_state(now),
                    AttitudeNews::Ignored => {}
                    AttitudeNews::Reboot => self.autopilot_restarted(now, outputs),
                }
            }
            MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(waypoints) if self.mission.is_none() => {
                let mut path = desired::read(waypoints, self.vehicle.heartbeat_mode());
                self.vehicle.infer_mode(path.mode.get());
                self.vertical_motions
                    .separate(&mut path, self.vehicle.present(now).as_ref());
                let capture = self.clock.map_us(path.autopilot_time_us, time);
                self.wire.status.desired_paths += 1;
                self.desired = Some(path);
                outputs.desired_path = Some((path, capture));
            }
            MavMessage::TIMESYNC(sync) => self.take_timesync(now, received, sync, outputs),
            MavMessage::DISTANCE_SENSOR(beam) => {
                see(COMPONENT_AUTOPILOT, self.sources.take_beam(beam, time), outputs);
            }
            MavMessage::OBSTACLE_DISTANCE(row) => {
                let arrived = self.sources.take_row(COMPONENT_AUTOPILOT, row, time);
                see(COMPONENT_AUTOPILOT, arrived, outputs);
            }
            MavMessage::EXTENDED_SYS_STATE(state) => self.vehicle.take_landed(state),
            MavMessage::ALTITUDE(altitude) => self.vehicle.take_altitude(altitude, time),
            MavMessage::HOME_POSITION(home) if self.mission.is_none() => self.vehicle.take_home(home),
            MavMessage::MISSION_CURRENT(current) => {
                let total = (1..u16::MAX).contains(&current.total).then_some(current.total);
                self.current_item = Some((current.seq, total));
            }
            MavMessage::POSITION_TARGET_GLOBAL_INT(target) => {
                self.take_target(now, (target.lat_int, target.lon_int), target.alt);
            }
            MavMessage::POSITION_TARGET_LOCAL_NED(echo) => self.take_echo(now, echo, outputs),
            MavMessage::MANUAL_CONTROL(control) => self.steering.sticks.take(control, time),
            MavMessage::RC_CHANNELS(channels) => self.take_channels(channels, time),
            MavMessage::PARAM_VALUE(reported) => {
                if let Some(autopilot) = self.profile_check.fit.autopilot() {
                    self.assist.take_parameter(autopilot, reported);
                }
            }
            MavMessage::CURRENT_MODE(current) => self.vehicle.take_mode(current.custom_mode),
            MavMessage::ORBIT_EXECUTION_STATUS(_) => self.vehicle.infer_orbit(),
            MavMessage::COMMAND_ACK(ack) => {
                self.streams.answered(now, ack);
                self.take_mode_answer(ack, outputs);
            }
            _ => {}
        }
    }

    /// A request (`tc1 == 0`) is answered in the autopilot's own clock, in which it is sent stamps: what it then takes for the difference
    /// of the clocks is half a round trip, also after one of them has stood still. An answer to us goes to the clock map.
    fn take_timesync(
        &mut self,
        now: Timestamp,
        received: &Received,
        sync: &TIMESYNC_DATA,
        outputs: &mut Outputs,
    ) {
        let ours = self.selector.system_id(now).unwrap_or(0);
        let for_another = |target: u8, own: u8| target != 0 && target != own;
        if for_another(sync.target_system, ours)
            || for_another(sync.target_component, self.config.component_id)
        {
            return;
        }
        if sync.tc1 != 0 {
            self.clock.on_response(received.time, sync.tc1, sync.ts1);
            return;
        }
        let spares = self.spares_radio(now);
        if !self.radio.answers(now, spares) {
            return;
        }
        let answer = MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: sync.ts1,
            ts1: sync.ts1,
            target_system: received.header.system_id as u8,
            target_component: received.header.component_id,
        });
        outputs.answer(Outgoing {
            to: Destination::Link(received.link),
            ..self.outgoing(now, Body::Message(answer))
        });
    }

    /// Its clock and its coordinates have begun anew. A mission that was flown is flown on, once it is read and the autopilot follows
    /// again; a place in its former coordinates is none any more.
    fn autopilot_restarted(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let flown = self
            .record(now)
            .filter(|record| record.armed)
            .map(|record| Record {
                flight_goal: match record.flight_goal {
                    FlightGoal::GoTo(_) => FlightGoal::None,
                    goal => goal,
                },
                ..record
            });
        self.clock = ClockMap::default();
        self.profile_check.restart();
        self.streams = self.needed_streams();
        self.steering = Steering::default();
        self.assist = AssistedFlight::default();
        if let Some(flight) = &mut self.mission {
            *flight = MissionFlight::new(Part::of(&self.config));
            if let Some(flown) = &flown {
                flight.resume(now, flown);
            }
            flight.read_anew(now);
        }
        self.desired = None;
        self.vertical_motions = VerticalMotions::default();
        self.current_item = None;
        self.was_announced = false;
        self.profile.reset();
        self.wire.interrupted();
        outputs.report(EventSample::new(&AUTOPILOT_RESTARTED, "", [0.0; 2]));
    }
}

/// Gives out the ranges that came from `component`, or why they cannot be used.
fn see(component: u8, arrived: Option<Result<Arrived, BeamRefused>>, outputs: &mut Outputs) {
    match arrived {
        Some(Ok(arrived)) => outputs.see(arrived),
        Some(Err(cause)) => outputs.note(Note::RangesRefused { component, cause }),
        None => {}
    }
}
