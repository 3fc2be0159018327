//! The mission, where jink flies it in the autopilot's stead: what the executive sees and what becomes of its intents.

use super::Gateway;
use super::echoes::Echoes;
use crate::demand::Demand;
use crate::executive::client::MissionClient;
use crate::executive::georeference::Georeference;
use crate::executive::go_to::GoToWatch;
use crate::executive::record::Record;
use crate::executive::{Executive, FlightGoal, Intent, Part, PilotText, Scene, SpeedCommand};
use crate::io::Outputs;
use crate::note::Note;
use crate::profile::pilot::Nearness;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::message::{Body, COMPONENT_AUTOPILOT, Content, Received};
use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::events::{EventSample, MODE_REFUSED};
use jink_shared_types::link::AvoidanceState;
use jink_shared_types::params::OA_UNGUARDED;
use jink_shared_types::vehicle::{DesiredPath, NavMode};
use jink_shared_types::{Coded, Timestamp};
use mavlink::MessageData;
#[allow(deprecated)]
use mavlink::dialect::MISSION_SET_CURRENT_DATA;
use mavlink::dialect::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MavCmd, MavFrame, MavMessage, MavModeFlag,
    MavResult, POSITION_TARGET_LOCAL_NED_DATA, PositionTargetTypemask,
};
use nalgebra::Vector3;

/// Rate at which the wish is repeated (Hz), as the topic table says.
const WISH_RATE_HZ: f64 = 5.0;
/// An autopilot that does not report changes of its mode at once is asked for it this often (Hz): within that time it
/// may fly a metre.
const MODE_QUESTIONS_HZ: f64 = 5.0;

/// A mission of ten items over a slow link is read within this time (s); a trajectory that is committed ends at rest about as soon.
const READS_S: f64 = 5.0;

/// Everything about a mission that jink flies.
#[derive(Clone, Debug)]
pub(super) struct MissionFlight {
    client: MissionClient,
    executive: Executive,
    georeference: Georeference,
    go_to: GoToWatch,
    /// Latitude and longitude of home (1e-7 deg), where the autopilot reports them.
    home: Option<(i32, i32)>,
    /// The speed that a station has asked for last.
    speed_command: Option<SpeedCommand>,
    /// The last wish, and when it is due again.
    wish: Option<DesiredPath>,
    /// A gateway that was started in flight reads the mission first, at the latest until then.
    reads_until: Timestamp,
    repeat: Ticker,
    mode_questions: Ticker,
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
            go_to: GoToWatch::default(),
            home: None,
            speed_command: None,
            wish: None,
            reads_until: Timestamp::NEVER,
            repeat: Ticker::new(WISH_RATE_HZ),
            mode_questions: Ticker::new(MODE_QUESTIONS_HZ),
            mode: NavMode::Unknown,
            was_refused: false,
            echoes: Echoes::default(),
        }
    }

    /// What is wanted now; the setpoints are flown, or are about to be.
    pub(super) fn wants_a_plan(&self) -> bool {
        self.wish.is_some_and(|wish| wish.wants_planning())
    }

    /// Whether this gateway was started in a flight and does not know its mission yet: what is approved goes on, even where it is
    /// flown only with a wish.
    pub(super) fn is_reading_after_start(&self, now: Timestamp) -> bool {
        self.reads_until.is_set() && now <= self.reads_until && !self.wants_a_plan()
    }

    /// Takes a message of the autopilot's.
    pub(super) fn take(&mut self, now: Timestamp, message: &MavMessage) {
        match message {
            MavMessage::LOCAL_POSITION_NED(position) => self.georeference.take_local(position),
            MavMessage::GLOBAL_POSITION_INT(position) => self.georeference.take_global(position),
            MavMessage::HEARTBEAT(_) => self.go_to.receive_mode(now),
            MavMessage::CURRENT_MODE(_) => self.go_to.receive_current_mode(now),
            MavMessage::HOME_POSITION(home) => {
                let home = Some((home.latitude, home.longitude));
                // ArduPilot's item 0 has moved with it.
                if std::mem::replace(&mut self.home, home) != home && self.client.version() != 0 {
                    self.client.read_again(now);
                }
            }
            _ => {}
        }
        self.client.take(now, message);
    }

    /// The autopilot is seen for the first time, or again.
    pub(super) fn read_anew(&mut self, now: Timestamp) {
        self.client.begin(now);
    }

    /// What is wanted, as it was said last.
    pub(super) fn wish(&self) -> Option<DesiredPath> {
        self.wish
    }

    /// What is flown while the autopilot follows setpoints is the mission, and no go-to.
    pub(super) fn flies_an_item(&self) -> bool {
        self.executive.flight_goal() == FlightGoal::Mission
    }

    /// The item that is flown to is left out.
    pub(super) fn skip(&mut self) {
        self.executive.skip();
    }

    pub(super) fn home_down_m(&self) -> Option<f64> {
        self.georeference.home_down_m()
    }

    /// Takes what ArduCopter says that it flies to.
    pub(super) fn take_echo(&mut self, now: Timestamp, echo: &POSITION_TARGET_LOCAL_NED_DATA) {
        self.go_to.take_echo(now, echo);
    }

    /// Whether the autopilot's target may be somebody else's: nothing is to be sent before it has shown, and nothing needs to be
    /// while it holds a place of jink's own.
    pub(super) fn may_rest(&self, now: Timestamp, position: Vector3<f64>) -> bool {
        let waits = self.executive.flight_goal() == FlightGoal::None;
        waits && (self.go_to.is_waited_for(now) || self.go_to.holds_ours(now, position))
    }

    /// Goes on where the gateway before has stopped.
    pub(super) fn resume(&mut self, now: Timestamp, record: &Record) {
        self.executive.resume(record);
        self.reads_until = now.plus_seconds(READS_S);
        self.mode = record.mode;
    }

    /// Home in the local frame (m).
    fn home(&self, make: AutopilotType) -> Option<Vector3<f64>> {
        // ArduPilot's item 0 is home, and zeros before there is one.
        let item = self
            .client
            .items()
            .and_then(<[_]>::first)
            .filter(|_| make == AutopilotType::ArduPilot)
            .map(|home| (home.x, home.y))
            .filter(|home| *home != (0, 0));
        let home = item.or(self.home)?;
        self.georeference.locate(MavFrame::MAV_FRAME_GLOBAL, home, 0.0)
    }
}

impl Gateway {
    /// One step of the mission, if jink flies it.
    pub(super) fn run_mission(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let Some(system_id) = self.selector.system_id(now).filter(|_| self.was_alive) else {
            return;
        };
        if self.mission.is_some() {
            self.ask_for_footing(now, (system_id, COMPONENT_AUTOPILOT), outputs);
            self.ask_for_mode(now, (system_id, COMPONENT_AUTOPILOT), outputs);
        }
        let nearness = self.profile.nearness();
        let ready = self.heartbeats.said() == AvoidanceState::Active;
        let present = self.vehicle.present(now);
        let mode = self.mode_for_missions();
        let in_air = self.vehicle.has_taken_off();
        let lets_fly_unguarded = self.params().get(&OA_UNGUARDED) > 0.0;
        let make = self.vehicle.make().unwrap_or(AutopilotType::Px4);
        let Some(flight) = &mut self.mission else { return };
        flight.client.set_make(make);
        let before = std::mem::replace(&mut flight.mode, mode);
        // A mission may have been changed while nobody looked.
        let begins = match mode {
            NavMode::Mission => before != mode,
            NavMode::Offboard => !matches!(before, NavMode::Offboard | NavMode::Mission),
            _ => false,
        };
        if begins {
            flight.client.refresh(now);
        } else if in_air && matches!(mode, NavMode::Mission | NavMode::Offboard) {
            flight.client.watch(now);
        }
        flight.go_to.notice(now, mode, in_air);
        let scene = Scene {
            now,
            mode,
            armed: self.vehicle.is_armed(),
            in_air,
            position: present.map(|present| present.position),
            speed_mps: present.map_or(f64::INFINITY, |present| present.velocity.norm()),
            level_mps: present.map_or(f64::INFINITY, |present| present.velocity.xy().norm()),
            items: flight.client.items(),
            is_reading: flight.client.is_reading(),
            version: flight.client.version(),
            read_at: flight.client.read_at(),
            current: self.current_item.map(|(item, _)| item),
            make,
            home: flight.home(make),
            is_located: flight.georeference.is_known(),
            go_to: flight.go_to.go_to(),
            speed_command: flight.speed_command,
            lets_fly_unguarded,
            ready,
            on_plan: nearness == Nearness::OnPlan,
        };
        let Intent {
            path,
            demand,
            update,
            note,
            read_again,
        } = flight
            .executive
            .step(&scene, |item, from| flight.georeference.place(make, item, from));
        if read_again {
            flight.client.read_again(now);
        }
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
        for note in [note, flight.client.take_note()].into_iter().flatten() {
            outputs.note(note);
        }
        let request = flight.client.request(now, (system_id, COMPONENT_AUTOPILOT));
        if let Some(request) = request {
            outputs.send(self.outgoing(now, Body::Message(request)));
        }
        if let Some(demand) = demand {
            self.demand(now, demand, outputs);
        }
        if let Some(update) = update {
            Self::notify_pilot(&update, outputs);
        }
    }

    pub(super) fn notify_pilot(text: &PilotText, outputs: &mut Outputs) {
        outputs.report(EventSample::new(text.event, text.name, [text.number, 0.0]));
    }

    /// What is to be known of this flight by a gateway that is started in it; `None` before a vehicle is known.
    pub fn record(&self, now: Timestamp) -> Option<Record> {
        let system_id = self.selector.system_id(now)?;
        let landed_state = self.vehicle.landed_state();
        let record = match &self.mission {
            Some(flight) => flight.executive.record(now, landed_state),
            None => Record::without_mission(now, self.vehicle.mode(), self.vehicle.is_armed(), landed_state),
        };
        Some(Record {
            vehicle: Some((system_id, self.selector.link())),
            assist: self.assist.record(),
            ..record
        })
    }

    /// With what the gateway before has left, if that was just now.
    #[must_use]
    pub fn resuming(mut self, now: Timestamp, record: Option<Record>) -> Self {
        let record = record.filter(|record| record.is_valid(now));
        if let Some((system_id, link)) = record.and_then(|record| record.vehicle) {
            self.selector.resume(system_id, link, now);
        }
        if let Some((flight, record)) = self.mission.as_mut().zip(record) {
            flight.resume(now, &record);
            self.vehicle
                .resume(record.mode, record.armed, record.landed_state);
            if let Some(assist) = &record.assist {
                self.vehicle.infer_mode(NavMode::Offboard);
                self.assist.resume(now, assist);
            }
        }
        self
    }

    /// An older PX4 reports its mode once a second, and flies to a station's place itself until it is known that it
    /// does: in flight its heartbeat is asked for.
    fn ask_for_mode(&mut self, now: Timestamp, target: (u8, u8), outputs: &mut Outputs) {
        let is_px4 = self.vehicle.make() == Some(AutopilotType::Px4);
        let is_followed = matches!(self.vehicle.mode(), NavMode::Offboard | NavMode::Hold);
        let is_flown = self.config.profile.flies_the_mission() && self.vehicle.has_taken_off();
        let Some(flight) = &mut self.mission else { return };
        let is_late = is_px4 && is_followed && is_flown && !flight.go_to.reports_at_once();
        if !is_late || !flight.mode_questions.take(now) {
            return;
        }
        self.request_message(now, HEARTBEAT_DATA::ID, target, outputs);
    }

    /// PX4's target in Hold.
    pub(super) fn take_target(&mut self, now: Timestamp, target: (i32, i32), height_m: f32) {
        let px4 = self.vehicle.make() == Some(AutopilotType::Px4) && self.vehicle.mode() == NavMode::Hold;
        let Some((flight, present)) = self
            .mission
            .as_mut()
            .zip(self.vehicle.present(now))
            .filter(|_| px4)
        else {
            return;
        };
        let place = flight
            .georeference
            .locate(MavFrame::MAV_FRAME_GLOBAL, target, height_m);
        if let Some(place) = place {
            flight
                .go_to
                .take_target(now, place, present.position, present.velocity.norm());
        }
    }

    /// A station on a link of ours asks the autopilot for something: another speed, or ArduCopter to go to a place, seen before it is
    /// overwritten. No autopilot reports a speed that it was asked for, so from elsewhere none is known.
    pub(super) fn observe(&mut self, now: Timestamp, received: &Received) {
        let follows = self.vehicle.mode() == NavMode::Offboard;
        let copter = self.vehicle.make() == Some(AutopilotType::ArduPilot);
        let system_id = self.selector.system_id(now);
        let Content::Message(message) = &received.content else {
            return;
        };
        let Some(flight) = &mut self.mission else { return };
        let speed = match message {
            MavMessage::COMMAND_LONG(command) => Some((
                command.command,
                command.target_system,
                command.param1,
                command.param2,
            )),
            MavMessage::COMMAND_INT(command) => Some((
                command.command,
                command.target_system,
                command.param1,
                command.param2,
            )),
            _ => None,
        };
        if let Some((MavCmd::MAV_CMD_DO_CHANGE_SPEED, target, kind, speed_mps)) = speed
            && system_id == Some(target)
        {
            flight.speed_command = Some(SpeedCommand {
                kind,
                speed_mps,
                serial: flight.speed_command.map_or(0, |command| command.serial) + 1,
            });
        }
        if !follows || !copter {
            return;
        }
        let only_position = |mask: PositionTargetTypemask| {
            !mask.contains(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_X_IGNORE)
                && mask.contains(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_VX_IGNORE)
        };
        let place = match message {
            MavMessage::COMMAND_INT(command) if command.command == MavCmd::MAV_CMD_DO_REPOSITION => flight
                .georeference
                .locate(command.frame, (command.x, command.y), command.z),
            MavMessage::SET_POSITION_TARGET_GLOBAL_INT(target) if only_position(target.type_mask) => {
                flight.georeference.locate(
                    target.coordinate_frame,
                    (target.lat_int, target.lon_int),
                    target.alt,
                )
            }
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(target)
                if only_position(target.type_mask)
                    && target.coordinate_frame == MavFrame::MAV_FRAME_LOCAL_NED =>
            {
                Some(Vector3::new(target.x, target.y, target.z).map(f64::from))
            }
            _ => None,
        };
        if let Some(place) = place {
            flight.go_to.take_place(now, place);
        }
    }

    #[allow(deprecated)] // MISSION_SET_CURRENT is older than the command that replaces it, and so are the versions that need it.
    pub(super) fn demand(&mut self, now: Timestamp, demand: Demand, outputs: &mut Outputs) {
        let target = self.selector.system_id(now).zip(self.vehicle.make());
        let Some((system_id, make)) = target else { return };
        let autopilot = (system_id, COMPONENT_AUTOPILOT);
        // PX4 shows an item that is chosen by this message in every mode, one that is chosen by command in its mission only; older
        // versions know the message only.
        if let (Demand::Current(seq), AutopilotType::Px4) = (demand, make) {
            let message = MavMessage::MISSION_SET_CURRENT(MISSION_SET_CURRENT_DATA {
                seq,
                target_system: autopilot.0,
                target_component: autopilot.1,
            });
            outputs.send(self.outgoing(now, Body::Message(message)));
        }
        if !matches!(demand, Demand::Current(_)) {
            self.mode_choice.ask(now);
        }
        if let Some(command) = command(demand, make, autopilot) {
            outputs.note(Note::Asked(demand));
            outputs.send(self.outgoing(now, Body::Message(command)));
        }
    }

    /// The answer to a demand; a refusal is reported once.
    pub(super) fn take_mode_answer(&mut self, ack: &COMMAND_ACK_DATA, outputs: &mut Outputs) {
        let Some(flight) = &mut self.mission else { return };
        if ack.command != MavCmd::MAV_CMD_DO_SET_MODE {
            return;
        }
        let refused = ack.result != MavResult::MAV_RESULT_ACCEPTED;
        if refused {
            self.assist.note_refusal();
        }
        let update = refused && !flight.was_refused;
        flight.was_refused = refused;
        if update {
            let result = f64::from(ack.result as u8);
            outputs.report(EventSample::new(&MODE_REFUSED, "", [result, 0.0]));
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
fn command(
    demand: Demand,
    make: AutopilotType,
    (target_system, target_component): (u8, u8),
) -> Option<MavMessage> {
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
        Demand::Land => mode(NavMode::Land)?,
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

#[cfg(test)]
mod tests {
    use super::{MissionFlight, Part};
    use jink_mavlink_link::autopilot_type::AutopilotType;
    use jink_shared_types::Timestamp;
    use mavlink::dialect::{
        GLOBAL_POSITION_INT_DATA, HOME_POSITION_DATA, LOCAL_POSITION_NED_DATA, MISSION_COUNT_DATA,
        MISSION_ITEM_INT_DATA, MavMessage,
    };

    const LATITUDE: i32 = 473_977_420;
    const LONGITUDE: i32 = 85_455_940;
    /// Some metres to the north (1e-7 deg).
    const NORTH: i32 = 1_000;

    /// Answers whatever is asked about a mission of one item, home at that latitude.
    fn answer(flight: &mut MissionFlight, home: i32) {
        for tick in 0..50 {
            let now = Timestamp::from_seconds(100.0 + f64::from(tick) * 0.1);
            let answer = match flight.client.request(now, (1, 1)) {
                Some(MavMessage::MISSION_REQUEST_LIST(_)) => MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
                    count: 1,
                    ..MISSION_COUNT_DATA::default()
                }),
                Some(MavMessage::MISSION_REQUEST_INT(_)) => {
                    MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
                        x: home,
                        y: if home == 0 { 0 } else { LONGITUDE },
                        ..MISSION_ITEM_INT_DATA::default()
                    })
                }
                _ => continue,
            };
            flight.take(now, &answer);
        }
    }

    fn home_north_m(flight: &MissionFlight) -> f64 {
        flight.home(AutopilotType::ArduPilot).unwrap().x.round()
    }

    #[test]
    fn home_is_where_it_has_moved_to_and_never_a_place_of_zeros() {
        let now = Timestamp::from_seconds(100.0);
        let mut flight = MissionFlight::new(Part::TakesOver);
        flight.client.set_make(AutopilotType::ArduPilot);
        for _ in 0..5 {
            flight.take(
                now,
                &MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA::default()),
            );
            let global = GLOBAL_POSITION_INT_DATA {
                lat: LATITUDE,
                lon: LONGITUDE,
                ..GLOBAL_POSITION_INT_DATA::default()
            };
            flight.take(now, &MavMessage::GLOBAL_POSITION_INT(global));
        }
        let reported = |latitude| {
            MavMessage::HOME_POSITION(HOME_POSITION_DATA {
                latitude,
                longitude: LONGITUDE,
                ..HOME_POSITION_DATA::default()
            })
        };
        flight.read_anew(now);
        answer(&mut flight, 0);
        assert_eq!(flight.home(AutopilotType::ArduPilot), None);
        flight.take(now, &reported(LATITUDE + NORTH));
        assert_eq!(home_north_m(&flight), 11.0, "what is reported counts meanwhile");
        answer(&mut flight, LATITUDE + NORTH);
        assert_eq!(home_north_m(&flight), 11.0);
        assert!(!flight.client.is_reading());
        flight.take(now, &reported(LATITUDE + 2 * NORTH));
        assert!(flight.client.is_reading(), "item 0 has moved with it");
        answer(&mut flight, LATITUDE + 2 * NORTH);
        assert_eq!(home_north_m(&flight), 22.0);
    }
}
