//! Reads what flows, and posts what readers want of it.
//!
//! Small topics are read always: what was reported and where it has flown is shown to whoever comes later. Maps and clouds are only
//! open while somebody looks.

use crate::board::{Board, Part};
use crate::layers::{self, Points, Pose};
use crate::scene::{self, Scene};
use crate::words::Facts;
use jink_control::known_space::KnownSpace;
use jink_control::parameters::Listed;
use jink_control::status::Report;
use jink_control::watch::{SpaceWatch, Watch};
use jink_runtime::members::Members;
use jink_runtime::{Input, Instance, OpenError, Session};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::far_map::FarMap;
use jink_shared_types::health::SystemStatus;
use jink_shared_types::motion::{ApprovedTrajectory, Route, RouteMode};
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::PointCloud;
use jink_shared_types::ring::SectorRing;
use jink_shared_types::topics::{self, TopicRow};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Stamped, Timestamp};
use serde_json::json;
use std::collections::VecDeque;
use tungstenite::Message;

/// Events that are kept.
const EVENTS_MAX: usize = 200;
/// Points of the trail; beyond, every second one is forgotten.
const TRAIL_MAX: usize = 6000;
/// Distance of two of them (m).
const TRAIL_STEP_M: f64 = 0.15;
/// Poses that are kept for the points of clouds: two seconds.
const POSES_MAX: usize = 100;
/// A pose belongs to what was measured this near to it (s): the state comes every 20 ms.
const POSE_NEAR_S: f64 = 0.06;
/// How long maps stay open when nobody looks any more (s): a page that is loaded again finds them.
const OPEN_FOR_S: f64 = 3.0;
/// How long a report waits for map and planner (s), as `jink status` does.
const SPACE_PATIENCE_S: f64 = 0.3;
/// What the planner wanted for an instant is said for so long (s): most routes say that nothing is new.
const WANTED_FOR_S: f64 = 1.2;

/// How often parts are posted (s).
const STATUS_PERIOD_S: f64 = 0.5;
const MAP_PERIOD_S: f64 = 0.2;
const BORDER_PERIOD_S: f64 = 0.5;
const CLOUD_PERIOD_S: f64 = 0.2;
const FAR_PERIOD_S: f64 = 1.0;
const TRAIL_PERIOD_S: f64 = 5.0;

/// What is open while somebody looks.
struct Large {
    space: SpaceWatch,
    far: Option<Input<FarMap>>,
    clouds: Vec<Input<PointCloud>>,
    opened: Timestamp,
    used: Timestamp,
}

/// When a part is due, and the sample that it was made of last.
#[derive(Clone, Copy, Debug, Default)]
struct Due {
    at: Timestamp,
    made_of: Timestamp,
}

impl Due {
    /// Whether something that was published at `publish` is due now: it is new, and enough time has passed.
    fn is_now(&mut self, now: Timestamp, publish: Timestamp, period_s: f64) -> bool {
        if now < self.at || publish == self.made_of {
            return false;
        }
        (self.at, self.made_of) = (now.plus_seconds(period_s), publish);
        true
    }
}

/// See the module.
pub struct Spectator {
    instance: Instance,
    large: Option<Large>,
    vehicle: Input<VehicleState>,
    approved: Input<ApprovedTrajectory>,
    ring: Input<SectorRing>,
    moving: Input<MovingObstacles>,
    parameters: Input<ParameterValues>,
    events: Input<EventSample>,
    clouds: Vec<String>,
    known: ParamSet,
    poses: VecDeque<(Timestamp, Pose)>,
    trail: Vec<[f32; 3]>,
    /// Estimator resets, and whether it was armed: another one begins another trail.
    trail_of: (u32, bool),
    reported: VecDeque<serde_json::Value>,
    has_new_events: bool,
    wanted: Option<(Timestamp, RouteMode)>,
    /// The last route that was a plan, with the time of its publication: most routes say that nothing is new.
    plan: Option<(Timestamp, Box<Route>)>,
    status: Option<(Timestamp, SystemStatus)>,
    shown_parameters: Option<ParameterValues>,
    due: [Due; crate::board::PARTS],
    /// A reader was there the last time.
    had_readers: bool,
    /// Last: the inputs above belong to its connection.
    watch: Watch,
}

impl std::fmt::Debug for Spectator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Spectator({})", self.instance)
    }
}

impl Spectator {
    /// Looks at `instance` over `session`; `known` are the rows of its parameters.
    ///
    /// # Errors
    /// A topic cannot be opened.
    pub fn open(
        instance: &Instance,
        session: Session,
        members: Members,
        known: ParamSet,
    ) -> Result<Self, OpenError> {
        Ok(Self {
            instance: instance.clone(),
            large: None,
            vehicle: session.input(topics::VEHICLE_STATE, "")?,
            approved: session.input(topics::APPROVED, "")?,
            ring: session.input(topics::RING, "")?,
            moving: session.input(topics::MOVING_OBSTACLES, "")?,
            parameters: session.input(topics::PARAMETERS, "")?,
            events: session.input(topics::EVENT, "")?.of_all_producers(),
            clouds: members.clouds,
            known,
            poses: VecDeque::with_capacity(POSES_MAX + 1),
            trail: Vec::new(),
            trail_of: (0, false),
            reported: VecDeque::with_capacity(EVENTS_MAX + 1),
            has_new_events: true,
            wanted: None,
            plan: None,
            status: None,
            shown_parameters: None,
            due: [Due::default(); crate::board::PARTS],
            had_readers: false,
            watch: Watch::over(session)?,
        })
    }

    /// The connection, for what is published.
    pub fn session(&self) -> &Session {
        self.watch.session()
    }

    /// The newest values of all parameters, if they are fresh and of the same rows.
    pub fn parameters(&mut self, now: Timestamp) -> Option<ParameterValues> {
        let values = *self.parameters.latest(now).fresh()?.sample;
        values.rows(&self.known).next().is_some().then_some(values)
    }

    /// Whether motors are armed, or might be.
    pub fn may_be_armed(&mut self, now: Timestamp) -> bool {
        self.vehicle
            .latest(now)
            .fresh()
            .is_none_or(|vehicle| vehicle.armed.is_set() || vehicle.mode_pending.is_set())
    }

    /// Takes what has come, and posts what is due.
    pub fn look(&mut self, now: Timestamp, board: &Board) {
        self.follow();
        self.note_events();
        if let Some(status) = self.watch.status() {
            self.status = Some((now, status));
        }
        let (has_readers, is_asked) = (board.readers() > 0, board.report_is_asked());
        if has_readers || is_asked {
            self.open_large(now);
        } else if self
            .large
            .as_ref()
            .is_some_and(|large| now.seconds_since(large.used) > OPEN_FOR_S)
        {
            self.large = None;
        }
        if is_asked && self.space_is_known(now) {
            board.post_report(self.report());
        }
        if has_readers {
            if !self.had_readers {
                // All of it is new for whoever comes.
                self.due = Default::default();
                self.shown_parameters = None;
                self.has_new_events = true;
            }
            self.post_all(now, board);
        } else if self.had_readers {
            board.clear();
        }
        self.had_readers = has_readers;
    }

    /// Poses and trail.
    fn follow(&mut self) {
        let (poses, trail, trail_of) = (&mut self.poses, &mut self.trail, &mut self.trail_of);
        self.vehicle.each(|vehicle| {
            if !vehicle.position_valid.is_set() {
                return;
            }
            let position = vehicle.position.vector();
            if let Some(attitude) = vehicle.attitude.rotation() {
                poses.push_back((vehicle.header.capture, (position, attitude)));
                if poses.len() > POSES_MAX {
                    poses.pop_front();
                }
            }
            let resets = vehicle.estimator_resets;
            // Of a gateway that has just started it is not known: what is flown goes on.
            let is_armed = match vehicle.mode_pending.is_set() {
                true => trail_of.1,
                false => vehicle.armed.is_set(),
            };
            if trail_of.0 != resets || is_armed && !trail_of.1 {
                trail.clear();
            }
            *trail_of = (resets, is_armed);
            let far = trail.last().is_none_or(|last| {
                let offset = position - nalgebra::Vector3::from(last.map(f64::from));
                offset.norm() >= TRAIL_STEP_M
            });
            if far {
                trail.push([position.x, position.y, position.z].map(|axis| axis as f32));
            }
            if trail.len() > TRAIL_MAX {
                let mut number = 0;
                trail.retain(|_| {
                    number += 1;
                    number % 2 == 1
                });
            }
        });
    }

    fn note_events(&mut self) {
        let (reported, is_new) = (&mut self.reported, &mut self.has_new_events);
        self.events.each(|event| {
            *is_new = true;
            reported.push_front(json!({
                "at_s": scene::round(event.header.publish.seconds()),
                "process": event.process.as_str(),
                "severity": event.severity.get().to_string(),
                "code": event.severity.get() as u8,
                "text": event.text(),
                "action": events::find(event.id).map(|row| row.action),
            }));
            reported.truncate(EVENTS_MAX);
        });
    }

    fn open_large(&mut self, now: Timestamp) {
        if let Some(large) = &mut self.large {
            large.used = now;
            return;
        }
        match SpaceWatch::open(self.watch.session()) {
            Ok(space) => {
                self.large = Some(Large {
                    space,
                    far: None,
                    clouds: Vec::new(),
                    opened: now,
                    used: now,
                });
            }
            // Every place of a spectator is taken: later there may be one.
            Err(error) => tracing::debug!("map and route cannot be read: {error}"),
        }
    }

    /// Whether map and planner have said something since they were opened, or will not.
    fn space_is_known(&mut self, now: Timestamp) -> bool {
        let Some(large) = &mut self.large else { return true };
        large.space.look().is_some() || now.seconds_since(large.opened) > SPACE_PATIENCE_S
    }

    fn space(
        &mut self,
    ) -> (
        Option<KnownSpace>,
        Option<jink_control::planned_speed::PlannedSpeed>,
    ) {
        let space = self.large.as_mut().map(|large| &mut large.space);
        space.map_or((None, None), |space| (space.look(), space.speed()))
    }

    /// What `jink status --json` prints.
    fn report(&mut self) -> Result<String, String> {
        let Some(status) = self.watch.status() else {
            return Err(format!(
                "jink {}: the supervisor gives no status\n",
                self.instance
            ));
        };
        let (space, speed) = self.space();
        let report = Report::of_instance(&self.instance, &status, &mut self.watch, space, speed);
        report.json().map_err(|error| error.to_string())
    }

    fn post_all(&mut self, now: Timestamp, board: &Board) {
        self.post_scene(now, board);
        let status_due = self.due[Part::Status as usize].is_now(now, now, STATUS_PERIOD_S);
        if status_due && let Some((at, status)) = self.status {
            let (space, speed) = self.space();
            let report = Report::of_instance(&self.instance, &status, &mut self.watch, space, speed);
            if let Ok(report) = serde_json::to_value(&report) {
                let age_s = scene::round(now.seconds_since(at));
                let is_stale = now.seconds_since(at) * 1e3 > topics::SYSTEM_STATUS.row.deadline_ms;
                post_text(
                    board,
                    Part::Status,
                    &json!({"type": "status", "age_s": age_s, "stale": is_stale, "report": report}),
                );
            }
        }
        if std::mem::take(&mut self.has_new_events) {
            post_text(
                board,
                Part::Events,
                &json!({"type": "events", "events": self.reported}),
            );
        }
        let values = self.parameters(now);
        if let Some(values) = values.filter(|values| self.shown_parameters.as_ref() != Some(values)) {
            let rows: Vec<Listed> = values
                .rows(&self.known)
                .map(|(row, value)| Listed::of(row, value))
                .collect();
            post_text(
                board,
                Part::Parameters,
                &json!({"type": "parameters", "parameters": rows}),
            );
            self.shown_parameters = Some(values);
        }
        if self.due[Part::Trail as usize].is_now(now, now, TRAIL_PERIOD_S) {
            board.post(Part::Trail, Message::binary(layers::trail(&self.trail)));
        }
        self.post_maps(now, board);
        self.post_clouds(now, board);
    }

    fn post_scene(&mut self, now: Timestamp, board: &Board) {
        self.note_routes();
        let (space, _) = self.space();
        self.watch.link();
        let large = self.large.as_mut();
        let (map, route) = match large {
            Some(large) => {
                let far = large
                    .far
                    .as_ref()
                    .and_then(|far| far.newest().map(|far| *far.header));
                let clouds = large
                    .clouds
                    .iter()
                    .filter_map(|cloud| cloud.newest().map(|cloud| *cloud.header));
                let cloud = clouds.max_by_key(|header| header.publish);
                let map = large.space.map().map(|map| *map.header);
                (
                    [map, far, cloud],
                    large.space.route().map(|route| (*route.header, route.sample)),
                )
            }
            None => ([None; 3], None),
        };
        self.approved.latest(now);
        self.ring.latest(now);
        self.moving.latest(now);
        let wanted = self
            .wanted
            .filter(|(at, _)| now.seconds_since(*at) < WANTED_FOR_S);
        let (vehicle, approved) = (self.vehicle.newest(), self.approved.newest());
        let link = self.watch.link_seen();
        let is_fresh = |header: &SampleHeader, row: &TopicRow| header.is_fresh(now, row.deadline_ms);
        let facts = Facts {
            status: self
                .status
                .as_ref()
                .filter(|(at, _)| now.seconds_since(*at) * 1e3 <= topics::SYSTEM_STATUS.row.deadline_ms)
                .map(|(_, status)| status),
            link: link
                .filter(|link| is_fresh(link.header, &topics::LINK_STATUS.row))
                .map(|link| link.sample),
            vehicle: vehicle
                .filter(|vehicle| is_fresh(vehicle.header, &topics::VEHICLE_STATE.row))
                .map(|vehicle| vehicle.sample),
            route: route
                .filter(|(header, _)| is_fresh(header, &topics::ROUTE.row))
                .map(|(_, route)| route),
            wanted: wanted.map(|(_, mode)| mode),
            approved: approved
                .filter(|approved| is_fresh(approved.header, &topics::APPROVED.row))
                .map(|approved| approved.sample),
            space: space.as_ref(),
            now,
        };
        let [map, far, cloud] = map;
        let scene = Scene {
            now,
            vehicle,
            approved,
            route: route.as_ref().map(|(header, sample)| Stamped {
                sample: *sample,
                header,
            }),
            plan: self
                .plan
                .as_ref()
                .filter(|(at, plan)| {
                    let is_flown = approved.is_some_and(|approved| approved.trajectory.route_id == plan.id);
                    is_flown || now.seconds_since(*at) < WANTED_FOR_S
                })
                .map(|(_, plan)| &**plan),
            ring: self.ring.newest(),
            moving: self.moving.newest(),
            map,
            far,
            cloud,
        };
        let mut value = scene.value();
        value["lines"] = json!(facts.lines());
        value["instance"] = json!(self.instance.to_string());
        post_text(board, Part::Scene, &value);
    }

    /// What the planner has wanted last, and its last plan.
    fn note_routes(&mut self) {
        let Some(large) = &mut self.large else { return };
        let (wanted, plan) = (&mut self.wanted, &mut self.plan);
        large.space.each_route(|route| {
            let publish = route.header.publish;
            if route.mode != RouteMode::Keep {
                *wanted = Some((publish, route.mode.get()));
            }
            if route.mode == RouteMode::Plan {
                match plan {
                    Some((at, kept)) => {
                        *at = publish;
                        **kept = *route.sample;
                    }
                    None => *plan = Some((publish, Box::new(*route.sample))),
                }
            }
        });
    }

    fn post_maps(&mut self, now: Timestamp, board: &Board) {
        let Some(large) = &mut self.large else { return };
        if let Some(map) = large.space.map() {
            let publish = map.header.publish;
            if board.is_wanted(Part::Map) && self.due[Part::Map as usize].is_now(now, publish, MAP_PERIOD_S) {
                board.post(Part::Map, Message::binary(layers::map(map.sample)));
            }
            if board.is_wanted(Part::Border)
                && self.due[Part::Border as usize].is_now(now, publish, BORDER_PERIOD_S)
            {
                board.post(Part::Border, Message::binary(layers::border(map.sample)));
            }
        }
        if !board.is_wanted(Part::Far) {
            large.far = None;
            return;
        }
        if large.far.is_none() {
            large.far = self.watch.session().input(topics::FAR_MAP, "").ok();
        }
        if let Some(input) = &mut large.far {
            input.latest(now);
            if let Some(far) = input.newest()
                && self.due[Part::Far as usize].is_now(now, far.header.publish, FAR_PERIOD_S)
            {
                board.post(Part::Far, Message::binary(layers::far(far.sample)));
            }
        }
    }

    fn post_clouds(&mut self, now: Timestamp, board: &Board) {
        let Some(large) = &mut self.large else { return };
        if !board.is_wanted(Part::Cloud) {
            large.clouds.clear();
            return;
        }
        if large.clouds.is_empty() {
            let session = self.watch.session();
            let open = |name: &String| session.input(topics::RANGE_CLOUD, name).ok();
            large.clouds = self.clouds.iter().filter_map(open).collect();
        }
        for cloud in &mut large.clouds {
            cloud.latest(now);
        }
        let clouds: Vec<_> = large.clouds.iter().filter_map(Input::newest).collect();
        let newest = clouds.iter().map(|cloud| cloud.header.publish).max();
        let Some((_, (origin, _))) = self.poses.back() else {
            return;
        };
        let Some(newest) = newest else { return };
        if !self.due[Part::Cloud as usize].is_now(now, newest, CLOUD_PERIOD_S) {
            return;
        }
        let mut points = Points::around(*origin);
        let row = &topics::RANGE_CLOUD.row;
        let fresh: Vec<_> = clouds
            .iter()
            .filter(|cloud| cloud.header.is_fresh(now, row.deadline_ms))
            .collect();
        for cloud in &fresh {
            let first = cloud.first_point;
            points.add(cloud.sample, fresh.len(), |after_s| {
                pose_at(&self.poses, first.plus_seconds(after_s))
            });
        }
        board.post(Part::Cloud, Message::binary(points.bytes()));
    }
}

/// The pose nearest to `time`, if one is near.
fn pose_at(poses: &VecDeque<(Timestamp, Pose)>, time: Timestamp) -> Option<Pose> {
    let after = poses.partition_point(|(at, _)| *at < time);
    let near = |index: usize| {
        let (at, pose) = poses.get(index)?;
        let off_s = at.seconds_since(time).abs();
        (off_s < POSE_NEAR_S).then_some((off_s, *pose))
    };
    let candidates = [near(after), after.checked_sub(1).and_then(near)];
    let nearest = candidates
        .into_iter()
        .flatten()
        .min_by(|one, other| one.0.total_cmp(&other.0));
    nearest.map(|(_, pose)| pose)
}

fn post_text(board: &Board, part: Part, value: &serde_json::Value) {
    board.post(part, Message::text(value.to_string()));
}
