//! The topic table: the whole data flow on one screen. Service names, quality of service, wait-set deadlines, the
//! commands that look at topics and the documentation are derived from it; nothing about a topic is said twice.
//!
//! A name that ends in `*` is a family: one topic per sensor or per process, e.g. `range/cloud/front`. A service
//! cannot open a topic in whose row it does not stand.
//!
//! Programs of others stand in no row. A configuration may declare topics for them ([`USER_TOPICS`]), and let them publish
//! those of [`OPEN_TO_OTHERS`] and read any.

use crate::control::Control;
use crate::cycles::CycleEntries;
use crate::events::EventSample;
use crate::far_map::FarMap;
use crate::ground::{GroundAnswer, GroundRequest};
use crate::hash;
use crate::health::{Heartbeat, SystemStatus};
use crate::layout::Layout;
use crate::link::{Delivery, LinkStatus, StopRequest};
use crate::map::LocalMap;
use crate::motion::{ApprovedTrajectory, Route, Trajectory};
use crate::moving::MovingObstacles;
use crate::param_messages::{ParameterChange, ParameterValues};
use crate::prevention::{PilotDemand, PreventedDemand};
use crate::proposal::{Proposal, ProposalAnswer};
use crate::ranges::{PointCloud, RangeScan};
use crate::ring::SectorRing;
use crate::sample::SampleHeader;
use crate::truth::SimTruth;
use crate::vehicle::{DesiredPath, VehicleState};
use std::fmt::Debug;
use std::marker::PhantomData;

/// Publishers of a topic: active, shadow, and one dead that has not been cleaned up yet.
pub const MAX_PUBLISHERS: usize = 3;
/// The command line: it may read every topic, and only looks on. It never takes a place that a service may need
/// ([`TopicRow::spectators`]).
pub const SPECTATOR: &str = "cli";
/// The recorder: it may read every topic, too, and keeps its place.
const RECORDER: &str = "recorder";
/// The live page: a spectator as the command line is.
const VIEWER: &str = "viewer";

/// Whether a program only looks on, and is refused where services may need the place.
pub fn is_spectator(program: &str) -> bool {
    program == SPECTATOR || program == VIEWER
}

/// The same of a topic on which every process publishes.
const MAX_PUBLISHERS_SHARED: usize = 40;
/// Readers besides the programs of the row: a recorder, a live page, command line tools, and a program that has died and is not cleaned up yet.
const SPECTATORS: usize = 8;
/// The same of samples from [`LARGE_BYTES`] on: each costs several of them in memory.
const SPECTATORS_OF_LARGE: usize = 4;
const LARGE_BYTES: usize = 64 * 1024;
/// Subscribers of a topic that every process and its shadow may read. Each subscriber that might come costs a publisher
/// room for the samples it might hold, and time at its start.
const MAX_SUBSCRIBERS_ALL: usize = 40;
/// Nodes that may know a topic at once.
pub const MAX_NODES: usize = 64;
/// Samples that a reader may hold at once: the newest it has read, and the next one while it changes over.
pub const MAX_BORROWED: usize = 2;
/// Samples that a publisher may fill at once: one, and one spare.
pub const MAX_LOANED: usize = 2;

/// What iceoryx2 writes before each sample (bytes).
const CHUNK_HEADER_BYTES: usize = 64;

/// Begins the names of topics that a configuration declares.
pub const USER_TOPICS: &str = "user/";
/// Rows whose topics a configuration may let programs of others publish: whoever reads them checks what they say.
pub const OPEN_TO_OTHERS: &[&str] = &[PROPOSAL.row.name, RANGE_SCAN.row.name, RANGE_CLOUD.row.name];

/// One row of the table.
#[derive(Clone, Copy, Debug)]
pub struct TopicRow {
    /// Name, or family if it ends in `*`.
    pub name: &'static str,
    /// Name of the payload type.
    pub payload: &'static str,
    /// Size of the payload (bytes).
    pub payload_bytes: usize,
    /// Programs that may publish it.
    pub producers: &'static [&'static str],
    /// Programs that may read it; `*` = every one. The command line tool may read every topic.
    pub consumers: &'static [&'static str],
    /// Rate that is kept at least while there is something to say (Hz); 0 = on change.
    pub rate_hz: f64,
    /// Age at which a sample counts as stale (ms).
    pub deadline_ms: f64,
    /// Samples a reader can fall behind before the oldest is dropped.
    pub buffer: usize,
    /// The recorder keeps it.
    pub logged: bool,
    /// Its samples start cycles of readers that ask for that; each such topic costs every start of its users an event
    /// service more.
    pub wakes: bool,
}

impl TopicRow {
    /// Whether the row is a family of topics.
    pub fn is_family(&self) -> bool {
        self.name.ends_with('*')
    }

    /// Whether every process publishes on this one topic: sequence numbers are then each producer's own.
    pub fn is_shared(&self) -> bool {
        !self.is_family() && self.producers.contains(&"*")
    }

    /// Publishers that there is room for: each program of the row with its shadow, one dead, and the command line as often as it may
    /// be there.
    pub fn max_publishers(&self) -> usize {
        if self.is_shared() {
            return MAX_PUBLISHERS_SHARED;
        }
        if self.is_family() {
            return MAX_PUBLISHERS;
        }
        let services = self.producers.iter().filter(|name| **name != SPECTATOR);
        let spectators = match self.producers.contains(&SPECTATOR) {
            true => self.spectators(),
            false => 0,
        };
        (2 * services.count() + 1 + spectators).max(MAX_PUBLISHERS)
    }

    /// How often the command line may have the topic open at once: the places besides those of the row's programs.
    pub fn spectators(&self) -> usize {
        match self.payload_bytes < LARGE_BYTES {
            true => SPECTATORS,
            false => SPECTATORS_OF_LARGE,
        }
    }

    /// Subscribers that there is room for: each program of the row with its shadow, and some spectators.
    pub fn max_subscribers(&self) -> usize {
        if self.consumers.contains(&"*") {
            MAX_SUBSCRIBERS_ALL
        } else {
            2 * self.consumers.len() + self.spectators()
        }
    }

    /// Samples that each publisher has memory for: what every subscriber may have queued and hold, the history of one, and what is
    /// being filled.
    pub fn slots(&self) -> usize {
        self.max_subscribers() * (self.buffer + MAX_BORROWED) + 1 + MAX_LOANED
    }

    /// Samples whose memory a publisher takes before the first one. Of large samples those that the programs of the row may have
    /// queued and hold; what shadows and spectators hold besides is taken when they do, if there is room.
    pub fn reserved_slots(&self) -> usize {
        match self.payload_bytes < LARGE_BYTES {
            true => self.slots(),
            false => self.consumers.len() * (self.buffer + MAX_BORROWED) + 1 + MAX_LOANED,
        }
    }

    /// Shared memory for the samples of one publisher, headers included (bytes).
    pub fn memory_bytes(&self) -> usize {
        self.slots() * self.slot_bytes()
    }

    /// What of it is taken before the first sample (bytes).
    pub fn reserved_bytes(&self) -> usize {
        self.reserved_slots() * self.slot_bytes()
    }

    fn slot_bytes(&self) -> usize {
        self.payload_bytes + size_of::<SampleHeader>() + CHUNK_HEADER_BYTES
    }

    /// What stands for the `*` in `name`, empty if this row is no family; `None` if `name` is not of this row.
    pub fn member_of<'a>(&self, name: &'a str) -> Option<&'a str> {
        match self.name.strip_suffix('*') {
            Some(family) => name.strip_prefix(family).filter(|member| !member.is_empty()),
            None => (name == self.name).then_some(""),
        }
    }

    /// The name of one topic of this row: `member` replaces the `*` of a family and is ignored elsewhere.
    pub fn topic_name(&self, member: &str) -> String {
        self.name.replace('*', member)
    }

    /// The row, its payload's layout, and who may use it, folded into `before`.
    const fn fold(&self, before: u64, layout: u64) -> u64 {
        let users = hash::texts(hash::texts(before, self.producers), self.consumers);
        let named = hash::text(hash::text(users, self.name), self.payload);
        let typed = hash::number(hash::number(named, layout), self.wakes as u64);
        hash::number(
            hash::number(typed, self.buffer as u64),
            self.deadline_ms.to_bits(),
        )
    }

    /// Whether `program` may publish the topic.
    pub fn may_publish(&self, program: &str) -> bool {
        self.producers.iter().any(|name| *name == "*" || *name == program)
    }

    /// Whether `program` may read the topic.
    pub fn may_read(&self, program: &str) -> bool {
        is_spectator(program)
            || program == RECORDER
            || self.consumers.iter().any(|name| *name == "*" || *name == program)
    }
}

/// A row with its payload type.
#[derive(Debug)]
pub struct Topic<T> {
    /// The row.
    pub row: TopicRow,
    payload: PhantomData<fn() -> T>,
}
impl<T> Clone for Topic<T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for Topic<T> {}

/// Something that can be done with a topic of any payload: what commands that take a topic's name are made of.
pub trait Visitor {
    /// What comes of it.
    type Output;
    /// Does it.
    fn visit<T: Layout + Debug + 'static>(self, topic: Topic<T>) -> Self::Output;
}

impl<T> Topic<T> {
    /// The topic of a row that a configuration declares.
    pub const fn of_row(row: TopicRow) -> Self {
        Self {
            row,
            payload: PhantomData,
        }
    }

    /// The same topic with another payload, as a program of another version would have it: opening it is refused if the
    /// layouts differ. For tests of that.
    pub const fn with_payload<U>(self) -> Topic<U> {
        Topic {
            row: self.row,
            payload: PhantomData,
        }
    }
}

macro_rules! topics {
    ($(
        $(#[$meta:meta])*
        $name:ident: $payload:ident = $topic:literal, from $producers:expr, to $consumers:expr,
            $rate_hz:literal Hz, stale after $deadline_ms:literal ms, buffer $buffer:literal, logged $logged:literal, wakes $wakes:literal;
    )*) => {
        $(
            $(#[$meta])*
            pub const $name: Topic<$payload> = Topic {
                row: TopicRow {
                    name: $topic,
                    payload: stringify!($payload),
                    payload_bytes: size_of::<$payload>(),
                    producers: &$producers,
                    consumers: &$consumers,
                    rate_hz: $rate_hz,
                    deadline_ms: $deadline_ms,
                    buffer: $buffer,
                    logged: $logged,
                    wakes: $wakes,
                },
                payload: PhantomData,
            };
        )*
        /// Every row.
        pub const TABLE: &[TopicRow] = &[$($name.row),*];

        /// Does something with the topic of a row; `None` if the row is none of [`TABLE`].
        pub fn visit<V: Visitor>(row: &TopicRow, visitor: V) -> Option<V::Output> {
            $(if row.name == $name.row.name {
                return Some(visitor.visit($name));
            })*
            None
        }

        /// A number that two builds have in common if they agree on every topic: its name, what its samples say, which programs
        /// may use it, and what is shared when it is opened.
        pub const FINGERPRINT: u64 = {
            let mut all = hash::number(hash::START, SampleHeader::LAYOUT_HASH);
            $( all = $name.row.fold(all, <$payload>::LAYOUT_HASH); )*
            all
        };
    };
}

topics! {
    /// Planar scans and single beams, one topic per sensor.
    RANGE_SCAN: RangeScan = "range/scan/*",
        from ["simulator", "rangefinder_driver", "lidar_driver", "mavlink_gateway"],
        to ["obstacle_fusion", "collision_guard"],
        20.0 Hz, stale after 250.0 ms, buffer 4, logged true, wakes true;
    /// 3-D lidar sweeps and depth images as points, one topic per sensor. Deadline: two and a half periods of 10 Hz.
    RANGE_CLOUD: PointCloud = "range/cloud/*",
        from ["simulator", "lidar_driver", "depth_driver"],
        to ["obstacle_fusion", "collision_guard"],
        10.0 Hz, stale after 250.0 ms, buffer 2, logged true, wakes true;
    /// The vehicle as the autopilot estimates it.
    VEHICLE_STATE: VehicleState = "vehicle/state",
        from ["mavlink_gateway"], to ["*"],
        50.0 Hz, stale after 100.0 ms, buffer 16, logged true, wakes true;
    /// What the autopilot wants to do.
    DESIRED_PATH: DesiredPath = "vehicle/desired_path",
        from ["mavlink_gateway"], to ["planner", "proposer"],
        5.0 Hz, stale after 500.0 ms, buffer 2, logged true, wakes false;
    /// What is occupied, free and unknown around the vehicle.
    LOCAL_MAP: LocalMap = "map/local",
        from ["obstacle_fusion"], to ["planner", "proposer"],
        10.0 Hz, stale after 250.0 ms, buffer 2, logged true, wakes true;
    /// What stands farther away, and what was seen before: coarse, for guidance.
    FAR_MAP: FarMap = "map/far",
        from ["obstacle_fusion"], to ["planner", "proposer"],
        2.0 Hz, stale after 2000.0 ms, buffer 1, logged true, wakes false;
    /// What moves in the map.
    MOVING_OBSTACLES: MovingObstacles = "map/moving",
        from ["obstacle_fusion"], to ["planner", "collision_guard"],
        10.0 Hz, stale after 250.0 ms, buffer 2, logged true, wakes false;
    /// The planner's answer.
    ROUTE: Route = "plan/route",
        from ["planner"], to ["bezier_generator"],
        30.0 Hz, stale after 150.0 ms, buffer 4, logged true, wakes true;
    /// A way that another program proposes. Nobody is woken by it: it is looked at with the next map, however many there are.
    PROPOSAL: Proposal = "plan/proposal",
        from ["proposer"], to ["planner"],
        10.0 Hz, stale after 500.0 ms, buffer 2, logged true, wakes false;
    /// What becomes of it.
    PROPOSAL_ANSWER: ProposalAnswer = "plan/proposal_answer",
        from ["planner"], to ["*"],
        0.0 Hz, stale after 5000.0 ms, buffer 16, logged true, wakes false;
    /// Curves for the route.
    TRAJECTORY: Trajectory = "plan/trajectory",
        from ["bezier_generator"], to ["collision_guard"],
        10.0 Hz, stale after 250.0 ms, buffer 4, logged true, wakes true;
    /// What may leave for the autopilot.
    APPROVED: ApprovedTrajectory = "guard/approved",
        from ["collision_guard"], to ["mavlink_gateway", "planner", "bezier_generator"],
        30.0 Hz, stale after 150.0 ms, buffer 4, logged true, wakes true;
    /// The guard's own view: nearest obstacle per sector.
    RING: SectorRing = "guard/ring",
        from ["collision_guard"], to ["mavlink_gateway"],
        15.0 Hz, stale after 200.0 ms, buffer 2, logged true, wakes false;
    /// Where a pilot wants to fly who steers through jink.
    PILOT_DEMAND: PilotDemand = "pilot/demand",
        from ["mavlink_gateway"], to ["collision_guard"],
        20.0 Hz, stale after 500.0 ms, buffer 2, logged true, wakes false;
    /// What of it may be flown.
    PREVENTED: PreventedDemand = "guard/prevented",
        from ["collision_guard"], to ["mavlink_gateway"],
        20.0 Hz, stale after 300.0 ms, buffer 2, logged true, wakes false;
    /// Signs of life, one topic per process.
    HEALTH: Heartbeat = "health/*",
        from ["*"], to ["supervisor"],
        20.0 Hz, stale after 100.0 ms, buffer 4, logged true, wakes false;
    /// What each cycle took of its inputs, of every service that puts out nothing but what follows from them; only while it is recorded.
    CYCLES: CycleEntries = "cycles/*",
        from ["*"], to ["recorder"],
        20.0 Hz, stale after 1000.0 ms, buffer 8, logged true, wakes false;
    /// Events for the pilot, of every process.
    EVENT: EventSample = "event",
        from ["*"], to ["ground_services", "mavlink_gateway"],
        0.0 Hz, stale after 5000.0 ms, buffer 16, logged true, wakes false;
    /// Every process, and the health of the whole.
    SYSTEM_STATUS: SystemStatus = "system/status",
        from ["supervisor"], to ["*"],
        10.0 Hz, stale after 300.0 ms, buffer 2, logged true, wakes true;
    /// Who owns which inputs. At the start it changes with each process: the recorder keeps all of it.
    CONTROL: Control = "system/control",
        from ["supervisor"], to ["*"],
        10.0 Hz, stale after 300.0 ms, buffer 8, logged true, wakes true;
    /// The gateway's counters.
    LINK_STATUS: LinkStatus = "link/status",
        from ["mavlink_gateway"], to ["supervisor", "ground_services"],
        5.0 Hz, stale after 600.0 ms, buffer 2, logged true, wakes false;
    /// The way of each new trajectory from the capture of a range to the wire.
    DELIVERY: Delivery = "link/delivery",
        from ["mavlink_gateway"], to ["cli"],
        0.0 Hz, stale after 600.0 ms, buffer 32, logged true, wakes false;
    /// What ground stations ask of our components, apart from flying.
    GROUND_REQUEST: GroundRequest = "mavlink/requests",
        from ["mavlink_gateway"], to ["ground_services"],
        0.0 Hz, stale after 500.0 ms, buffer 32, logged true, wakes true;
    /// The answers, and what the gateway is asked to do for them.
    GROUND_ANSWER: GroundAnswer = "mavlink/answers",
        from ["ground_services"], to ["mavlink_gateway"],
        0.0 Hz, stale after 500.0 ms, buffer 32, logged true, wakes true;
    /// The values of all parameters; services take the live ones at once.
    PARAMETERS: ParameterValues = "parameters",
        from ["parameter_server"], to ["*"],
        1.0 Hz, stale after 2500.0 ms, buffer 2, logged true, wakes true;
    /// A value that the command line, the live page or a ground station wants changed, or that the planner has learned; the answer is in `parameters`.
    PARAMETER_CHANGE: ParameterChange = "parameters/change",
        from ["cli", "viewer", "ground_services", "planner"], to ["parameter_server"],
        0.0 Hz, stale after 5000.0 ms, buffer 4, logged true, wakes true;
    /// Somebody is about to end jink in flight: the vehicle is to be brought to rest and left to the autopilot.
    STOP_REQUEST: StopRequest = "vehicle/stop_request",
        from ["cli"], to ["mavlink_gateway"],
        0.0 Hz, stale after 5000.0 ms, buffer 4, logged true, wakes false;
    /// Ground truth, in simulations only. The sensor rendering uses it where the vehicle is simulated, too.
    SIM_TRUTH: SimTruth = "sim/truth",
        from ["simulator"], to ["simulator"],
        250.0 Hz, stale after 200.0 ms, buffer 32, logged true, wakes true;
}

#[cfg(test)]
mod tests {
    use super::{RANGE_CLOUD, SPECTATOR, TABLE, Topic, TopicRow, VEHICLE_STATE, Visitor, visit};
    use std::fmt::Debug;

    #[test]
    fn every_row_can_be_visited_and_reports_its_members() {
        struct NameOf;
        impl Visitor for NameOf {
            type Output = &'static str;
            fn visit<T: crate::layout::Layout + Debug + 'static>(self, topic: Topic<T>) -> &'static str {
                topic.row.name
            }
        }
        for row in TABLE {
            assert_eq!(visit(row, NameOf), Some(row.name));
        }
        assert_eq!(RANGE_CLOUD.row.member_of("range/cloud/front"), Some("front"));
        assert_eq!(RANGE_CLOUD.row.member_of("range/cloud/"), None);
        assert_eq!(RANGE_CLOUD.row.member_of("range/scan/front"), None);
        assert_eq!(VEHICLE_STATE.row.member_of("vehicle/state"), Some(""));
    }

    #[test]
    fn a_row_that_differs_changes_the_fingerprint() {
        let row = VEHICLE_STATE.row;
        let others = [
            TopicRow { name: "x", ..row },
            TopicRow {
                producers: &["planner"],
                ..row
            },
            TopicRow {
                consumers: &["planner"],
                ..row
            },
            TopicRow { payload: "X", ..row },
            TopicRow {
                wakes: !row.wakes,
                ..row
            },
            TopicRow {
                buffer: row.buffer + 1,
                ..row
            },
            TopicRow {
                deadline_ms: row.deadline_ms + 1.0,
                ..row
            },
        ];
        for other in others {
            assert_ne!(other.fold(0, 7), row.fold(0, 7), "{other:?}");
        }
        assert_ne!(row.fold(0, 8), row.fold(0, 7));
        assert_eq!(TopicRow { rate_hz: 1.0, ..row }.fold(0, 7), row.fold(0, 7));
    }

    #[test]
    fn spectators_leave_every_program_of_a_row_its_places() {
        for row in TABLE.iter().filter(|row| !row.consumers.contains(&"*")) {
            let services = 2 * row.consumers.iter().filter(|name| **name != SPECTATOR).count();
            assert!(
                row.max_subscribers() >= services + row.spectators(),
                "{}",
                row.name
            );
        }
        for row in TABLE.iter().filter(|row| !row.is_shared() && !row.is_family()) {
            let services = row.producers.iter().filter(|name| **name != SPECTATOR).count();
            let spectators = match row.may_publish(SPECTATOR) {
                true => row.spectators(),
                false => 0,
            };
            assert!(row.max_publishers() > 2 * services + spectators, "{}", row.name);
        }
    }

    #[test]
    fn names_are_unique() {
        for (i, row) in TABLE.iter().enumerate() {
            assert!(
                TABLE[..i].iter().all(|other| other.name != row.name),
                "{}",
                row.name
            );
        }
    }

    #[test]
    fn every_topic_has_a_producer_and_a_reader() {
        for row in TABLE {
            assert!(
                !row.producers.is_empty() && !row.consumers.is_empty(),
                "{}",
                row.name
            );
        }
    }

    #[test]
    fn a_deadline_allows_for_more_than_two_periods() {
        for row in TABLE.iter().filter(|row| row.rate_hz > 0.0) {
            assert!(row.deadline_ms * row.rate_hz / 1e3 >= 2.0, "{}", row.name);
        }
    }

    #[test]
    fn only_the_row_decides_who_may_publish() {
        assert!(VEHICLE_STATE.row.may_publish("mavlink_gateway"));
        assert!(!VEHICLE_STATE.row.may_publish("planner"));
        assert!(VEHICLE_STATE.row.may_read("planner"));
        assert!(
            !RANGE_CLOUD.row.may_read("planner"),
            "the planner sees the map, not the ranges"
        );
        assert!(RANGE_CLOUD.row.may_read("cli"));
    }
}
