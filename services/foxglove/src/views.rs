//! What is shown of each sample: Foxglove's own schemas, the same live and of a recording.
//!
//! | sample | channel | schema |
//! |---|---|---|
//! | `vehicle/state` | `/tf` | FrameTransforms: where `base_link` is in `map` |
//! | | `/vehicle/state` | PoseInFrame |
//! | | `/vehicle/body` | SceneUpdate: a drone |
//! | | `/vehicle/state/numbers` | JSON |
//! | `plan/route` | `/plan/route` | SceneUpdate: goal, guide, corridor |
//! | | `/plan/route/numbers` | JSON |
//! | `guard/approved` | `/guard/approved` | SceneUpdate: the committed trajectory, red where it stops |
//! | | `/guard/approved/poses` | PosesInFrame: the same for programs that draw no scenes |
//! | | `/guard/approved/numbers` | JSON |
//! | `guard/ring` | `/guard/ring` | LaserScan |
//! | | `/guard/ring/numbers` | JSON |
//! | `map/local`, `map/far` | the same | PointCloud: centres of occupied cells |
//! | `map/moving` | `/map/moving` | SceneUpdate: cylinders |
//! | `range/cloud/*` | the same | PointCloud, each point where the vehicle was when it was measured |
//! | `event` | `/event` | Log |
//!
//! Times are those of the samples: of messages that of the publication, inside of them that of the measurement. Nothing is made that nobody
//! has subscribed to. What stands in a scene is taken away after [`LIFETIME_S`] without a new sample,
//! so that nothing old looks new.

use crate::frames::{self, BASE_LINK, MAP};
use crate::numbers::Numbers;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    ArrowPrimitive, Color, CubePrimitive, CylinderPrimitive, Duration, FrameTransform, FrameTransforms,
    LaserScan, LinePrimitive, Log, PackedElementField, PointCloud, PoseInFrame, PosesInFrame, SceneEntity,
    SceneUpdate, SpherePrimitive, Timestamp as Time, line_primitive, log,
};
use foxglove::{Channel, Context, Encode, FoxgloveError};
use jink_shared_types::events::{EventSample, Severity};
use jink_shared_types::far_map::{self, FAR_X, FAR_Y, FAR_Z, FarMap};
use jink_shared_types::layout::Layout;
use jink_shared_types::map::{self, Cell, LocalMap, SIZE_X, SIZE_Y, SIZE_Z};
use jink_shared_types::motion::{ApprovedTrajectory, HalfSpace, Route, RouteMode, TrajectoryMode, Verdict};
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::pose_history::{Estimate, PoseHistory, Reach};
use jink_shared_types::ranges::{self, RayKind};
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS, SectorRing};
use jink_shared_types::topics::{self, Topic};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Stage, Stamped, Timestamp};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A payload that is shown.
pub trait View: Layout + Sized {
    /// Its topic.
    const TOPIC: Topic<Self>;
    /// Whether somebody has subscribed to anything that is made of it.
    fn is_wanted(views: &Views, member: &str) -> bool;
    /// Shows a sample; `member` says of which member of a family it is.
    fn show(sample: Stamped<'_, Self>, member: &str, views: &mut Views);
}

/// Something that is done with every payload that is shown.
pub trait Visitor {
    /// Does it.
    fn visit<V: View>(&mut self);
}

/// Everything that is shown, poses before what they place.
pub fn each(visitor: &mut impl Visitor) {
    visitor.visit::<VehicleState>();
    visitor.visit::<Route>();
    visitor.visit::<ApprovedTrajectory>();
    visitor.visit::<SectorRing>();
    visitor.visit::<LocalMap>();
    visitor.visit::<FarMap>();
    visitor.visit::<MovingObstacles>();
    visitor.visit::<ranges::PointCloud>();
    visitor.visit::<EventSample>();
}

/// Entities of a scene are taken away after this time (s): the rarest come once a second, and plans in flight at least that often.
const LIFETIME_S: i32 = 3;
/// How often pictures of trajectories and goals are sent (s): ten times a second, if every third of thirty samples is taken.
const SCENE_PERIOD_S: f64 = 0.08;
/// The same of a map (s): every second of ten samples.
const MAP_PERIOD_S: f64 = 0.15;
/// The same of what hardly changes (s): once a second.
const SLOW_PERIOD_S: f64 = 0.9;
/// The same of numbers (s): every second of fifty samples a second.
const NUMBERS_PERIOD_S: f64 = 0.03;
/// Points of a cloud that are shown at most, evenly thinned: a sweep of a Mid-360, and a depth image as its driver reduces it.
const POINTS_MAX: usize = ranges::IMAGE_POINTS;
/// Points that a trajectory is drawn with.
const LINE_POINTS: usize = 72;
/// A pose belongs to what was measured this near to it: the state comes every 20 ms, and is carried on to what comes before the next one.
const REACH: Reach = Reach {
    state_s: 0.06,
    gap_s: 0.25,
};

const GREEN: Color = color(0.25, 0.85, 0.4, 1.0);
const YELLOW: Color = color(1.0, 0.85, 0.2, 1.0);
const RED: Color = color(0.95, 0.2, 0.2, 1.0);
const VIOLET: Color = color(0.65, 0.4, 0.95, 1.0);
const BLUE: Color = color(0.3, 0.55, 1.0, 0.5);
const ORANGE: Color = color(1.0, 0.55, 0.1, 0.7);
const GREY: Color = color(0.35, 0.37, 0.4, 1.0);

const fn color(r: f64, g: f64, b: f64, a: f64) -> Color {
    Color { r, g, b, a }
}

/// A channel on which a message is made if somebody has subscribed to it, and enough time has passed.
struct Out<M: Encode> {
    channel: Channel<M>,
    due: Timestamp,
}

impl<M: Encode> Out<M> {
    fn new(context: &Arc<Context>, topic: &str) -> Self {
        Self {
            channel: context.channel_builder(topic).build(),
            due: Timestamp::NEVER,
        }
    }

    fn is_wanted(&self) -> bool {
        self.channel.has_sinks()
    }

    fn log(&mut self, header: &SampleHeader, ahead_ns: i64, period_s: f64, message: impl FnOnce() -> M) {
        if self.is_wanted() && header.publish >= self.due {
            self.due = header.publish.plus_seconds(period_s);
            self.channel
                .log_with_time(&message(), unix_ns(header.publish, ahead_ns));
        }
    }
}

/// See the module.
pub struct Views {
    context: Arc<Context>,
    /// Time of the day minus the clock of the samples (ns).
    pub ahead_ns: i64,
    poses: PoseHistory,
    frames: Out<FrameTransforms>,
    vehicle: Out<PoseInFrame>,
    body: Out<SceneUpdate>,
    route: Out<SceneUpdate>,
    approved: Out<SceneUpdate>,
    approved_poses: Out<PosesInFrame>,
    ring: Out<LaserScan>,
    map: Out<PointCloud>,
    far: Out<PointCloud>,
    moving: Out<SceneUpdate>,
    event: Out<Log>,
    clouds: BTreeMap<String, Out<PointCloud>>,
    vehicle_numbers: Numbers<4>,
    route_numbers: Numbers<3>,
    approved_numbers: Numbers<3>,
    ring_numbers: Numbers<1>,
}

impl std::fmt::Debug for Views {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Views({} clouds)", self.clouds.len())
    }
}

impl Views {
    /// Channels in `context`; at the moment 0 of the samples' clock it is `ahead_ns` of the day.
    ///
    /// # Errors
    /// A channel that Foxglove's library does not take.
    pub fn new(context: &Arc<Context>, ahead_ns: i64) -> Result<Self, FoxgloveError> {
        Ok(Self {
            context: Arc::clone(context),
            ahead_ns,
            poses: PoseHistory::new(REACH),
            frames: Out::new(context, "/tf"),
            vehicle: Out::new(context, "/vehicle/state"),
            body: Out::new(context, "/vehicle/body"),
            route: Out::new(context, "/plan/route"),
            approved: Out::new(context, "/guard/approved"),
            approved_poses: Out::new(context, "/guard/approved/poses"),
            ring: Out::new(context, "/guard/ring"),
            map: Out::new(context, "/map/local"),
            far: Out::new(context, "/map/far"),
            moving: Out::new(context, "/map/moving"),
            event: Out::new(context, "/event"),
            clouds: BTreeMap::new(),
            vehicle_numbers: Numbers::new(
                context,
                "/vehicle/state/numbers",
                [
                    ("speed_mps", "speed (m/s)"),
                    ("climb_mps", "speed upwards (m/s)"),
                    ("height_m", "height above the home position (m)"),
                    ("heading_deg", "heading, clockwise from north (degrees)"),
                ],
            )?,
            route_numbers: Numbers::new(
                context,
                "/plan/route/numbers",
                [
                    ("plan_ms", "time that the planner took for this answer (ms)"),
                    ("reached_mps", "highest speed that plans reach (m/s)"),
                    ("allowed_mps", "highest speed that is allowed (m/s)"),
                ],
            )?,
            approved_numbers: Numbers::new(
                context,
                "/guard/approved/numbers",
                [
                    ("limit_mps", "speed limit of what is approved (m/s)"),
                    ("free_way_m", "way to the first conflict that the guard sees (m)"),
                    ("stopping_m", "way to a stop from here (m)"),
                ],
            )?,
            ring_numbers: Numbers::new(
                context,
                "/guard/ring/numbers",
                [(
                    "clearance_m",
                    "horizontal distance from the vehicle's centre to the nearest obstacle (m)",
                )],
            )?,
        })
    }

    /// Announces the cloud of a sensor.
    pub fn add_cloud(&mut self, sensor: &str) {
        if !self.clouds.contains_key(sensor) {
            let topic = format!("/{}", topics::RANGE_CLOUD.row.topic_name(sensor));
            self.clouds
                .insert(sensor.to_owned(), Out::new(&self.context, &topic));
        }
    }

    /// A time of the samples' clock, as Foxglove writes it.
    fn time(&self, at: Timestamp) -> Option<Time> {
        time(unix_ns(at, self.ahead_ns))
    }

    fn entity(&self, header: &SampleHeader, id: &str) -> SceneEntity {
        SceneEntity {
            timestamp: self.time(header.publish),
            frame_id: MAP.to_owned(),
            id: id.to_owned(),
            lifetime: Some(Duration::new(LIFETIME_S, 0)),
            ..SceneEntity::default()
        }
    }
}

/// Nanoseconds of the day; zero of what is before its beginning, or was never.
pub(crate) fn unix_ns(at: Timestamp, ahead_ns: i64) -> u64 {
    match at.is_set() {
        true => at.ns.saturating_add_signed(ahead_ns),
        false => 0,
    }
}

fn time(unix_ns: u64) -> Option<Time> {
    const SECOND_NS: u64 = 1_000_000_000;
    let seconds = u32::try_from(unix_ns / SECOND_NS).ok()?;
    Time::new_checked(seconds, (unix_ns % SECOND_NS) as u32)
}

fn scene(entities: Vec<SceneEntity>) -> SceneUpdate {
    SceneUpdate {
        deletions: Vec::new(),
        entities,
    }
}

fn line(
    kind: line_primitive::Type,
    points: Vec<Vector3<f64>>,
    colors: Vec<Color>,
    color: Color,
) -> LinePrimitive {
    LinePrimitive {
        r#type: kind as i32,
        // In pixels.
        thickness: 2.0,
        scale_invariant: true,
        points: points
            .into_iter()
            .map(frames::map_of)
            .map(frames::point)
            .collect(),
        color: Some(color),
        colors,
        ..LinePrimitive::default()
    }
}

/// Points (local, m) as a cloud in `map`.
fn cloud(timestamp: Option<Time>, points: impl Iterator<Item = Vector3<f64>>) -> PointCloud {
    let mut data = Vec::new();
    for point in points {
        for axis in frames::map_of(point).iter() {
            data.extend_from_slice(&(*axis as f32).to_le_bytes());
        }
    }
    let field = |(name, offset): (&str, u32)| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: NumericType::Float32 as i32,
    };
    PointCloud {
        timestamp,
        frame_id: MAP.to_owned(),
        pose: Some(frames::pose(Vector3::zeros(), UnitQuaternion::identity())),
        point_stride: 12,
        fields: [("x", 0), ("y", 4), ("z", 8)].map(field).to_vec(),
        data: data.into(),
    }
}

impl View for VehicleState {
    const TOPIC: Topic<Self> = topics::VEHICLE_STATE;

    fn is_wanted(views: &Views, _: &str) -> bool {
        views.frames.is_wanted()
            || views.vehicle.is_wanted()
            || views.body.is_wanted()
            || views.vehicle_numbers.is_wanted()
            || views.clouds.values().any(Out::is_wanted)
    }

    fn show(state: Stamped<'_, Self>, _: &str, views: &mut Views) {
        let (header, ahead_ns) = (state.header, views.ahead_ns);
        let speed_mps = state.velocity.vector().norm();
        let height_m = state.home_down_m - state.position.z_m;
        let numbers = [
            speed_mps,
            -state.velocity.z_mps,
            height_m,
            state.attitude.yaw_rad().to_degrees().rem_euclid(360.0),
        ];
        views
            .vehicle_numbers
            .log(header, ahead_ns, NUMBERS_PERIOD_S, numbers);
        let Some(estimate) = Estimate::of(state.sample) else {
            return;
        };
        views.poses.push(estimate, header.capture);
        let timestamp = views.time(header.capture);
        let at = frames::map_of(estimate.position_m);
        let turn = frames::attitude_of(estimate.local_q_body);
        views.frames.log(header, ahead_ns, 0.0, || FrameTransforms {
            transforms: vec![FrameTransform {
                timestamp,
                parent_frame_id: MAP.to_owned(),
                child_frame_id: BASE_LINK.to_owned(),
                translation: Some(frames::vector(at)),
                rotation: Some(frames::quaternion(turn)),
            }],
        });
        views.vehicle.log(header, ahead_ns, 0.0, || PoseInFrame {
            timestamp,
            frame_id: MAP.to_owned(),
            pose: Some(frames::pose(at, turn)),
        });
        let entity = views.entity(header, "drone");
        views
            .body
            .log(header, ahead_ns, SLOW_PERIOD_S, || scene(vec![drone(entity)]));
    }
}

/// A quadcopter of usual size: the samples do not say how large the vehicle is.
fn drone(entity: SceneEntity) -> SceneEntity {
    const ARM_M: f64 = 0.6;
    const ROTOR_M: f64 = 0.28;
    let half_m = 0.5 * ARM_M * std::f64::consts::FRAC_1_SQRT_2;
    let size = |x: f64, y: f64, z: f64| Some(frames::vector(Vector3::new(x, y, z)));
    let arm = |angle_deg: f64| CubePrimitive {
        pose: Some(frames::pose(
            Vector3::zeros(),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_deg.to_radians()),
        )),
        size: size(ARM_M, 0.05, 0.05),
        color: Some(GREY),
    };
    let rotor = |(x, y): (f64, f64)| CylinderPrimitive {
        pose: Some(frames::pose(
            Vector3::new(x * half_m, y * half_m, 0.06),
            UnitQuaternion::identity(),
        )),
        size: size(ROTOR_M, ROTOR_M, 0.02),
        bottom_scale: 1.0,
        top_scale: 1.0,
        color: Some(if x > 0.0 { ORANGE } else { GREY }),
    };
    SceneEntity {
        frame_id: BASE_LINK.to_owned(),
        frame_locked: true,
        cubes: vec![arm(45.0), arm(-45.0)],
        cylinders: [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
            .map(rotor)
            .to_vec(),
        ..entity
    }
}

impl View for Route {
    const TOPIC: Topic<Self> = topics::ROUTE;

    fn is_wanted(views: &Views, _: &str) -> bool {
        views.route.is_wanted() || views.route_numbers.is_wanted()
    }

    fn show(route: Stamped<'_, Self>, _: &str, views: &mut Views) {
        let (header, ahead_ns) = (route.header, views.ahead_ns);
        let stage = header.stages[Stage::Planner as usize];
        let plan_ms = match stage.begin.is_set() && stage.end.is_set() {
            true => stage.end.seconds_since(stage.begin) * 1e3,
            false => f64::NAN,
        };
        let numbers = [
            plan_ms,
            f64::from(route.reached_mps),
            f64::from(route.allowed_mps),
        ];
        views
            .route_numbers
            .log(header, ahead_ns, NUMBERS_PERIOD_S, numbers);
        // Most routes say that nothing is new: the guide and the corridor stay. A plan is always shown.
        if route.mode == RouteMode::Plan {
            views.route.due = Timestamp::NEVER;
        }
        let [goal, guide, corridor] = ["goal", "guide", "corridor"].map(|id| views.entity(header, id));
        views.route.log(header, ahead_ns, SCENE_PERIOD_S, || {
            let mut entities = vec![with_goal(route.sample, goal)];
            if route.mode != RouteMode::Keep {
                entities.push(with_guide(route.sample, guide));
                entities.push(with_corridor(route.sample, corridor));
            }
            scene(entities)
        });
    }
}

/// A ball at the goal and a beam through it, which is seen from afar.
fn with_goal(route: &Route, mut entity: SceneEntity) -> SceneEntity {
    const BALL_M: f64 = 0.5;
    const BEAM_M: f64 = 30.0;
    let goal = route.goal.vector();
    if route.mode != RouteMode::Mirror && route.goal.is_finite() && goal != Vector3::zeros() {
        let pose = frames::pose(frames::map_of(goal), UnitQuaternion::identity());
        let size = |x: f64, y: f64, z: f64| Some(frames::vector(Vector3::new(x, y, z)));
        entity.spheres.push(SpherePrimitive {
            pose: Some(pose),
            size: size(BALL_M, BALL_M, BALL_M),
            color: Some(GREEN),
        });
        entity.cylinders.push(CylinderPrimitive {
            pose: Some(pose),
            size: size(0.1, 0.1, BEAM_M),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color: Some(Color { a: 0.4, ..GREEN }),
        });
    }
    entity
}

fn with_guide(route: &Route, mut entity: SceneEntity) -> SceneEntity {
    let points = route.guide().iter().map(|point| point.vector()).collect();
    entity
        .lines
        .push(line(line_primitive::Type::LineStrip, points, Vec::new(), VIOLET));
    entity
}

fn with_corridor(route: &Route, mut entity: SceneEntity) -> SceneEntity {
    let edges = route.corridor().iter().flat_map(|piece| edges_of(piece.planes()));
    let points = edges.flatten().collect();
    entity
        .lines
        .push(line(line_primitive::Type::LineList, points, Vec::new(), BLUE));
    entity
}

/// The edges of a convex piece of space (local, m): for each pair of planes what is left of their common line within all others.
fn edges_of(planes: &[HalfSpace]) -> Vec<[Vector3<f64>; 2]> {
    /// No piece is longer (m): a line that reaches farther is open.
    const LONGEST_M: f64 = 1e3;
    /// Shorter edges are rounding (m).
    const SHORTEST_M: f64 = 1e-3;
    /// Directions this near to each other are the same.
    const PARALLEL: f64 = 1e-6;
    let mut edges = Vec::new();
    for (index, one) in planes.iter().enumerate() {
        for other in &planes[index + 1..] {
            let (one_normal, other_normal) = (Vector3::from(one.normal), Vector3::from(other.normal));
            let along = one_normal.cross(&other_normal);
            if along.norm() < PARALLEL {
                continue;
            }
            let start = (one.offset_m * other_normal.cross(&along)
                + other.offset_m * along.cross(&one_normal))
                / along.norm_squared();
            let along = along.normalize();
            let (mut low_m, mut high_m) = (-LONGEST_M, LONGEST_M);
            for plane in planes {
                if std::ptr::eq(plane, one) || std::ptr::eq(plane, other) {
                    continue;
                }
                let (slope, depth_m) = (Vector3::from(plane.normal).dot(&along), plane.depth_m(&start));
                if slope > PARALLEL {
                    high_m = high_m.min(depth_m / slope);
                } else if slope < -PARALLEL {
                    low_m = low_m.max(depth_m / slope);
                } else if depth_m < -SHORTEST_M {
                    high_m = low_m;
                }
            }
            let length_m = high_m - low_m;
            if length_m > SHORTEST_M && length_m < LONGEST_M {
                edges.push([start + along * low_m, start + along * high_m]);
            }
        }
    }
    edges
}

impl View for ApprovedTrajectory {
    const TOPIC: Topic<Self> = topics::APPROVED;

    fn is_wanted(views: &Views, _: &str) -> bool {
        views.approved.is_wanted() || views.approved_poses.is_wanted() || views.approved_numbers.is_wanted()
    }

    fn show(approved: Stamped<'_, Self>, _: &str, views: &mut Views) {
        let (header, ahead_ns) = (approved.header, views.ahead_ns);
        let ahead = Ahead::of(approved.sample, header.publish);
        let limit_mps = match ahead.points.is_empty() {
            true => f64::NAN,
            false => approved.trajectory.limits.speed_mps,
        };
        let numbers = [limit_mps, approved.free_way_m, approved.stopping_m];
        views
            .approved_numbers
            .log(header, ahead_ns, NUMBERS_PERIOD_S, numbers);
        let timestamp = views.time(header.publish);
        views
            .approved_poses
            .log(header, ahead_ns, SCENE_PERIOD_S, || PosesInFrame {
                timestamp,
                frame_id: MAP.to_owned(),
                poses: ahead.poses(),
            });
        let entity = views.entity(header, "trajectory");
        views.approved.log(header, ahead_ns, SCENE_PERIOD_S, || {
            scene(vec![ahead.drawn(entity)])
        });
    }
}

/// What is left of a committed trajectory.
#[derive(Debug, Default)]
struct Ahead {
    /// Position (local, m), heading (rad), speed (m/s).
    points: Vec<(Vector3<f64>, f64, f64)>,
    /// The point from which on it only brakes: the stop with which each one ends.
    stop_from: usize,
    limit_mps: f64,
}

impl Ahead {
    fn of(approved: &ApprovedTrajectory, now: Timestamp) -> Self {
        let trajectory = &approved.trajectory;
        let from = now.max(trajectory.start);
        let left_s = trajectory.end().seconds_since(from);
        let flies = approved.verdict != Verdict::Hold
            && trajectory.mode != TrajectoryMode::Mirror
            && trajectory.is_sound();
        if !flies || left_s <= 0.0 {
            return Self::default();
        }
        let points: Vec<_> = (0..LINE_POINTS)
            .filter_map(|number| {
                let state =
                    trajectory.at(from.plus_seconds(left_s * number as f64 / (LINE_POINTS - 1) as f64))?;
                Some((
                    state.position.vector(),
                    state.yaw_rad,
                    state.velocity.vector().norm(),
                ))
            })
            .collect();
        // Backwards from the rest as long as it was faster before: where it was not, it was flown steadily.
        let mut stop_from = points.len().saturating_sub(1);
        while stop_from > 0 && points[stop_from - 1].2 > points[stop_from].2 {
            stop_from -= 1;
        }
        Self {
            points,
            stop_from,
            limit_mps: trajectory.limits.speed_mps,
        }
    }

    fn poses(&self) -> Vec<foxglove::messages::Pose> {
        let pose = |(at, heading_rad, _): &(Vector3<f64>, f64, f64)| {
            frames::pose(frames::map_of(*at), frames::level_of(*heading_rad))
        };
        self.points.iter().map(pose).collect()
    }

    /// A line from yellow to green, the faster the greener; red is the stop, with a ball where it rests.
    fn drawn(&self, mut entity: SceneEntity) -> SceneEntity {
        const BALL_M: f64 = 0.3;
        let Some((rest, ..)) = self.points.last() else {
            return entity;
        };
        let color = |(index, (_, _, speed_mps)): (usize, &(Vector3<f64>, f64, f64))| {
            let share = (speed_mps / self.limit_mps.max(0.1)).clamp(0.0, 1.0);
            let mix = |slow: f64, fast: f64| slow + (fast - slow) * share;
            match index >= self.stop_from {
                true => RED,
                false => Color {
                    r: mix(YELLOW.r, GREEN.r),
                    g: mix(YELLOW.g, GREEN.g),
                    b: mix(YELLOW.b, GREEN.b),
                    a: 1.0,
                },
            }
        };
        let colors = self.points.iter().enumerate().map(color).collect();
        let points = self.points.iter().map(|(at, ..)| *at).collect();
        let drawn = line(line_primitive::Type::LineStrip, points, colors, GREEN);
        entity.lines.push(LinePrimitive {
            thickness: 4.0,
            ..drawn
        });
        entity.spheres.push(SpherePrimitive {
            pose: Some(frames::pose(frames::map_of(*rest), UnitQuaternion::identity())),
            size: Some(frames::vector(Vector3::repeat(BALL_M))),
            color: Some(RED),
        });
        entity
    }
}

impl View for SectorRing {
    const TOPIC: Topic<Self> = topics::RING;

    fn is_wanted(views: &Views, _: &str) -> bool {
        views.ring.is_wanted() || views.ring_numbers.is_wanted()
    }

    fn show(ring: Stamped<'_, Self>, _: &str, views: &mut Views) {
        let (header, ahead_ns) = (ring.header, views.ahead_ns);
        let seen = ring.distance_m.iter().filter(|m| m.is_finite());
        let clearance_m = seen.copied().fold(f32::INFINITY, f32::min);
        views
            .ring_numbers
            .log(header, ahead_ns, NUMBERS_PERIOD_S, [f64::from(clearance_m)]);
        let timestamp = views.time(header.capture);
        views.ring.log(header, ahead_ns, 0.0, || LaserScan {
            timestamp,
            frame_id: MAP.to_owned(),
            pose: Some(frames::pose(
                frames::map_of(ring.position.vector()),
                frames::level_of(ring.attitude.yaw_rad()),
            )),
            start_angle: 0.0,
            end_angle: SECTOR_WIDTH_RAD * (SECTORS - 1) as f64,
            ranges: ranges_of(ring.sample),
            intensities: Vec::new(),
        });
    }
}

/// The distances of a ring (m). Sectors are counted clockwise, the angles of a scan counterclockwise. Infinite: nothing is there. NaN:
/// unknown.
fn ranges_of(ring: &SectorRing) -> Vec<f64> {
    (0..SECTORS)
        .map(|step| f64::from(ring.distance_m[(SECTORS - step) % SECTORS]))
        .collect()
}

/// The centres (local, m) of the occupied cells of a window of `size` cells from `min` on: in rows along north in which there is one.
fn centres(
    cell_m: f64,
    min: Cell,
    [x, y, z]: [usize; 3],
    has_any: impl Fn(Cell) -> bool,
    is_occupied: impl Fn(Cell) -> bool,
) -> impl Iterator<Item = Vector3<f64>> {
    // What a damaged sample says of its window is anything.
    let cell = move |steps: [usize; 3]| [0, 1, 2].map(|axis| min[axis].wrapping_add(steps[axis] as i32));
    let rows = (0..y * z).map(move |row| [row % y, row / y]);
    let rows = rows.filter(move |[east, down]| has_any(cell([0, *east, *down])));
    let cells = rows.flat_map(move |[east, down]| (0..x).map(move |north| cell([north, east, down])));
    let occupied = cells.filter(move |cell| is_occupied(*cell));
    occupied.map(move |cell| Vector3::from(cell.map(|index| (f64::from(index) + 0.5) * cell_m)))
}

impl View for LocalMap {
    const TOPIC: Topic<Self> = topics::LOCAL_MAP;

    fn is_wanted(views: &Views, _: &str) -> bool {
        views.map.is_wanted()
    }

    fn show(map: Stamped<'_, Self>, _: &str, views: &mut Views) {
        let (ahead_ns, timestamp) = (views.ahead_ns, views.time(map.header.capture));
        views.map.log(map.header, ahead_ns, MAP_PERIOD_S, || {
            let map = map.sample;
            let has_any = |cell| map.occupied[map::row_of(cell)] != [0; SIZE_X / 64];
            let is_occupied = |cell| map::test(&map.occupied, cell);
            let size = [SIZE_X, SIZE_Y, SIZE_Z];
            cloud(
                timestamp,
                centres(map.cell_m, map.min_cell, size, has_any, is_occupied),
            )
        });
    }
}

impl View for FarMap {
    const TOPIC: Topic<Self> = topics::FAR_MAP;

    fn is_wanted(views: &Views, _: &str) -> bool {
        views.far.is_wanted()
    }

    fn show(far: Stamped<'_, Self>, _: &str, views: &mut Views) {
        let (ahead_ns, timestamp) = (views.ahead_ns, views.time(far.header.capture));
        views.far.log(far.header, ahead_ns, SLOW_PERIOD_S, || {
            let far = far.sample;
            let has_any = |cell| far.occupied[far_map::far_row_of(cell)] != [0; FAR_X / 64];
            let is_occupied = |cell| far_map::test(&far.occupied, cell);
            let size = [FAR_X, FAR_Y, FAR_Z];
            cloud(
                timestamp,
                centres(far.cell_m, far.min_cell, size, has_any, is_occupied),
            )
        });
    }
}

impl View for MovingObstacles {
    const TOPIC: Topic<Self> = topics::MOVING_OBSTACLES;

    fn is_wanted(views: &Views, _: &str) -> bool {
        views.moving.is_wanted()
    }

    fn show(moving: Stamped<'_, Self>, _: &str, views: &mut Views) {
        let ahead_ns = views.ahead_ns;
        let mut entity = views.entity(moving.header, "moving");
        views.moving.log(moving.header, ahead_ns, SCENE_PERIOD_S, || {
            for obstacle in moving.obstacles() {
                let at = frames::map_of(obstacle.position.vector());
                let velocity = frames::map_of(obstacle.velocity.vector());
                let width_m = 2.0 * obstacle.radius_m;
                entity.cylinders.push(CylinderPrimitive {
                    pose: Some(frames::pose(at, UnitQuaternion::identity())),
                    size: Some(frames::vector(Vector3::new(
                        width_m,
                        width_m,
                        2.0 * obstacle.half_height_m,
                    ))),
                    bottom_scale: 1.0,
                    top_scale: 1.0,
                    color: Some(ORANGE),
                });
                // As long as the way of a second.
                if let Some(turn) = UnitQuaternion::rotation_between(&Vector3::x(), &velocity) {
                    entity.arrows.push(ArrowPrimitive {
                        pose: Some(frames::pose(at, turn)),
                        shaft_length: velocity.norm(),
                        shaft_diameter: 0.08,
                        head_length: 0.3,
                        head_diameter: 0.2,
                        color: Some(ORANGE),
                    });
                }
            }
            scene(vec![entity])
        });
    }
}

impl View for ranges::PointCloud {
    const TOPIC: Topic<Self> = topics::RANGE_CLOUD;

    fn is_wanted(views: &Views, member: &str) -> bool {
        views.clouds.get(member).is_some_and(Out::is_wanted)
    }

    fn show(sweep: Stamped<'_, Self>, member: &str, views: &mut Views) {
        views.add_cloud(member);
        let (header, ahead_ns) = (sweep.header, views.ahead_ns);
        let (timestamp, poses) = (views.time(header.capture), &views.poses);
        let Some(out) = views.clouds.get_mut(member) else {
            return;
        };
        out.log(header, ahead_ns, 0.0, || {
            let points = sweep.points();
            let every = points.len().div_ceil(POINTS_MAX).max(1);
            // Many points are measured at once: their pose is looked for once.
            let mut last = None;
            let placed = points.iter().step_by(every).filter_map(|point| {
                let body = Vector3::new(point.forward_m, point.right_m, point.down_m).map(f64::from);
                if point.kind != RayKind::Hit || !body.iter().all(|axis| axis.is_finite()) {
                    return None;
                }
                let pose = match last {
                    Some((offset, pose)) if offset == point.offset_10us => pose,
                    _ => poses.at(sweep
                        .first_point
                        .plus_seconds(f64::from(point.offset_10us) * 1e-5)),
                };
                last = Some((point.offset_10us, pose));
                pose.map(|pose| pose.position_m + pose.local_q_body * body)
            });
            cloud(timestamp, placed)
        });
    }
}

impl View for EventSample {
    const TOPIC: Topic<Self> = topics::EVENT;

    fn is_wanted(views: &Views, _: &str) -> bool {
        views.event.is_wanted()
    }

    fn show(event: Stamped<'_, Self>, _: &str, views: &mut Views) {
        let (ahead_ns, timestamp) = (views.ahead_ns, views.time(event.header.publish));
        views.event.log(event.header, ahead_ns, 0.0, || Log {
            timestamp,
            level: match event.severity.get() {
                Severity::Emergency | Severity::Alert | Severity::Critical => log::Level::Fatal,
                Severity::Error => log::Level::Error,
                Severity::Warning => log::Level::Warning,
                Severity::Notice | Severity::Info => log::Level::Info,
                Severity::Debug => log::Level::Debug,
            } as i32,
            message: event.text(),
            name: event.process.as_str().to_owned(),
            ..Log::default()
        });
    }
}

#[cfg(test)]
mod tests {
    use super::{centres, edges_of, ranges_of};
    use jink_shared_types::map::{self, Cell, LocalMap, SIZE_X, SIZE_Y, SIZE_Z, center_of};
    use jink_shared_types::motion::HalfSpace;
    use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SectorRing, sector_of};
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_box_has_twelve_edges_wherever_it_is_and_however_it_is_turned(
            centre in prop::array::uniform3(-50.0..50.0f64), angles in prop::array::uniform3(-1.5..1.5f64),
            half in prop::array::uniform3(0.2..5.0f64),
        ) {
            let (centre, [roll, pitch, yaw]) = (Vector3::from(centre), angles);
            let turn = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let planes: Vec<HalfSpace> = (0..6)
                .map(|side| {
                    let sign = if side % 2 == 0 { 1.0 } else { -1.0 };
                    let normal = turn * (Vector3::ith(side / 2, sign));
                    HalfSpace { normal: normal.into(), offset_m: normal.dot(&centre) + half[side / 2] }
                })
                .collect();
            let edges = edges_of(&planes);
            prop_assert_eq!(edges.len(), 12);
            let sum_m: f64 = edges.iter().map(|[from, to]| (to - from).norm()).sum();
            prop_assert!((sum_m - 8.0 * half.iter().sum::<f64>()).abs() < 1e-6);
            for end in edges.iter().flatten() {
                prop_assert!(planes.iter().all(|plane| plane.depth_m(end) > -1e-6));
            }
        }

        #[test]
        fn the_distance_of_a_sector_is_that_of_the_same_direction(bearing_rad in -3.1..3.1f64) {
            let mut ring = SectorRing::default();
            ring.distance_m[sector_of(bearing_rad)] = 7.0;
            let ranges = ranges_of(&ring);
            let index = ranges.iter().position(|range_m| *range_m == 7.0).unwrap();
            // Counterclockwise from forward, as a scan has it.
            let off_rad = index as f64 * SECTOR_WIDTH_RAD + bearing_rad;
            prop_assert!(off_rad.cos() > (0.51 * SECTOR_WIDTH_RAD).cos());
        }
    }

    #[test]
    fn what_is_open_has_no_edges_at_its_open_side() {
        assert!(edges_of(&[]).is_empty());
        let wall = |normal: [f64; 3]| HalfSpace {
            normal,
            offset_m: 1.0,
        };
        assert!(edges_of(&[wall([1.0, 0.0, 0.0]), wall([0.0, 1.0, 0.0])]).is_empty());
    }

    #[test]
    fn cells_are_shown_where_they_are_wherever_the_window_is() {
        for min in [[0, 0, 0], [-64, -64, -32], [37, -201, 11], [-1, 127, -63]] {
            let mut local = LocalMap::boxed();
            local.min_cell = min;
            let wanted = [[0, 0, 0], [5, 70, 9], [127, 127, 63]];
            let wanted = wanted.map(|cell: Cell| [0, 1, 2].map(|axis| min[axis] + cell[axis]));
            for cell in wanted {
                map::set(&mut local.occupied, cell);
            }
            let has_any = |cell| local.occupied[map::row_of(cell)] != [0; 2];
            let is_occupied = |cell| map::test(&local.occupied, cell);
            let shown = centres(local.cell_m, min, [SIZE_X, SIZE_Y, SIZE_Z], has_any, is_occupied);
            let shown: Vec<_> = shown.collect();
            assert_eq!(shown.len(), wanted.len());
            for cell in wanted {
                let centre = center_of(cell).vector();
                assert!(shown.iter().any(|at| (at - centre).norm() < 1e-9), "{cell:?}");
            }
        }
    }
}
