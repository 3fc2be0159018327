//! Two and three instances of one process, in whatever order they are run: each input has one owner, no two instances publish in one
//! epoch, and what an owner leaves behind when it dies is taken over.
//!
//! The instances are real ones: loop, control record, inputs and outputs are those of a process, on a bus and a clock that the test
//! sets ([`jink_runtime::lockstep`]). Only the supervisor is a model; its own rules are tested where they are, and its lead before a
//! switch is longer than any delay here. Drawn by lot are when something happens, in which order the instances run in each
//! millisecond, whether inputs come before or after them, and who is not run for a while.
//!
//! Why no model checker of threads: one instance is one thread, and its ownership is cells that no other thread sees. What instances
//! share is shared memory of other processes, written by iceoryx2 whose atomics are not those of loom or shuttle. What may go wrong is
//! the order in which whole cycles see the record, the inputs and the clock; that is what is drawn here. A cycle itself is one
//! step: one that began before the record was written and takes inputs from after the switch would have to last for the whole
//! lead.

use clap::Parser;
use jink_runtime::config::Config;
use jink_runtime::lockstep::{LocalBus, Member};
use jink_runtime::{Cycle, Input, Output, Ports, Service, Session, Setup, StartError, Wake};
use jink_shared_types::control::{Control, ControlEntry};
use jink_shared_types::health::Name;
use jink_shared_types::link::LinkStatus;
use jink_shared_types::motion::{Route, Trajectory};
use jink_shared_types::topics::{self, Topic};
use jink_shared_types::{SampleHeader, Timestamp};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// From the decision to a switch, as the supervisor has it, and from the switch until it counts as done (ms).
const LEAD_MS: u64 = 100;
const SETTLE_MS: u64 = 100;
/// Between two inputs, and between two beats (ms).
const PERIOD_MS: u64 = 7;
const BEAT_MS: u64 = 50;
const BEAT_HZ: u32 = 20;
/// Longest that an instance is not run, and from a death to the record of it (ms).
const STALL_MS: u64 = 60;
const NOTICE_MS: u64 = 30;
/// After all that happens: everything is to be as usual again (ms).
const AFTER_MS: u64 = 400;

fn at(ms: u64) -> Timestamp {
    Timestamp::from_ns(1_000_000_000_000 + ms * 1_000_000)
}

fn ms_of(time: Timestamp) -> u64 {
    time.ns_since(at(0)) / 1_000_000
}

/// Answers the newest route with a trajectory for it.
struct Answering {
    routes: Input<Route>,
    trajectories: Output<Trajectory>,
}

impl Service for Answering {
    const PROGRAM: &'static str = "bezier_generator";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            routes: ports.trigger(topics::ROUTE)?,
            trajectories: ports.output(topics::TRAJECTORY)?,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let mut newest = None;
        self.routes.each(|route| newest = Some(route.id));
        if let Some(route_id) = newest {
            self.trajectories.write(SampleHeader::at(cycle.now), |slot| {
                *slot = Trajectory {
                    route_id,
                    ..Trajectory::default()
                };
            });
        }
        Wake::on_data()
    }
}

/// Says at every beat which one it is.
struct Beating {
    output: Output<LinkStatus>,
    due: Timestamp,
}

impl Service for Beating {
    const PROGRAM: &'static str = "mavlink_gateway";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            output: ports.output(topics::LINK_STATUS)?,
            due: ports.clock().now().next_beat(BEAT_HZ),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        if cycle.now >= self.due {
            let status = LinkStatus {
                setpoints: ms_of(cycle.now) / BEAT_MS,
                ..LinkStatus::default()
            };
            self.output.send(SampleHeader::at(cycle.now), &status);
            self.due = cycle.now.next_beat(BEAT_HZ);
        }
        Wake::at(self.due)
    }
}

/// What a test looks at: who said what, and when.
trait Watched: Service {
    type Sample: jink_shared_types::layout::Layout;
    const TOPIC: Topic<Self::Sample>;
    const READER: &'static str;
    /// Its outputs belong to the time of their cycle, not to an input's.
    const IS_TIMED: bool;
    fn subject(sample: &Self::Sample) -> u64;
}

impl Watched for Answering {
    type Sample = Trajectory;
    const TOPIC: Topic<Trajectory> = topics::TRAJECTORY;
    const READER: &'static str = "collision_guard";
    const IS_TIMED: bool = false;
    fn subject(sample: &Trajectory) -> u64 {
        sample.route_id
    }
}

impl Watched for Beating {
    type Sample = LinkStatus;
    const TOPIC: Topic<LinkStatus> = topics::LINK_STATUS;
    const READER: &'static str = "supervisor";
    const IS_TIMED: bool = true;
    fn subject(sample: &LinkStatus) -> u64 {
        sample.setpoints
    }
}

/// One output as it was published.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Said {
    /// The route that was answered, or the beat.
    subject: u64,
    generation: u32,
    epoch: u32,
    sequence: u64,
    ms: u64,
}

/// What happens next.
#[derive(Clone, Copy, Debug)]
enum Event {
    /// Nothing for so long (ms).
    Wait(u64),
    /// A second instance is started, if there is none.
    Shadow,
    /// The second instance becomes the owner, so long after the lead (ms).
    Switch(u64),
    /// The former owner goes for good.
    Release,
    /// An instance is not run for so long (ms): the owner, or another one.
    Stall { owner: bool, ms: u64 },
    /// The owner is killed; that is noticed so long after (ms).
    Kill { notice_ms: u64 },
    /// The second instance is killed.
    KillOther { notice_ms: u64 },
}

struct Instance<S> {
    generation: u32,
    /// `None` when it is dead.
    member: Option<Member<S>>,
    stalled_until_ms: u64,
}

struct World<S: Watched> {
    bus: LocalBus,
    now_ms: u64,
    lot: u64,
    control: Output<Control>,
    routes: Output<Route>,
    reader: Input<S::Sample>,
    guarded: Input<S::Sample>,
    instances: Vec<Instance<S>>,
    entry: ControlEntry,
    /// As the supervisor counts: generations and epochs out of one row of numbers.
    last: u32,
    /// Deaths that will be noticed: when, and whose.
    deaths: Vec<(u64, u32)>,
    switched_ms: Option<u64>,
    next_route: u64,
    /// Every output.
    said: Vec<Said>,
    /// Those that a reader takes.
    taken: Vec<Said>,
    /// When each instance died.
    died: BTreeMap<u32, u64>,
    /// When an owner was killed or stalled, and until when that may be felt (ms).
    disturbed: Vec<(u64, u64)>,
}

impl<S: Watched> World<S> {
    fn new(lot: u64) -> Self {
        let bus = LocalBus::new(at(0));
        let open = |program| Session::local(&bus, program);
        let mut world = Self {
            now_ms: 0,
            lot: lot | 1,
            control: open("supervisor").output(topics::CONTROL, "", 1).unwrap(),
            routes: open("planner").output(topics::ROUTE, "", 1).unwrap(),
            reader: open(S::READER).input(S::TOPIC, "").unwrap().of_all_producers(),
            guarded: open(S::READER).input(S::TOPIC, "").unwrap(),
            instances: Vec::new(),
            entry: ControlEntry {
                name: Name::new(S::PROGRAM),
                ..ControlEntry::default()
            },
            last: 0,
            deaths: Vec::new(),
            switched_ms: None,
            next_route: 1,
            said: Vec::new(),
            taken: Vec::new(),
            died: BTreeMap::new(),
            disturbed: Vec::new(),
            bus,
        };
        world.start_owner();
        world
    }

    /// A number below `below`, drawn by lot (xorshift64*).
    fn draw(&mut self, below: u64) -> u64 {
        self.lot ^= self.lot >> 12;
        self.lot ^= self.lot << 25;
        self.lot ^= self.lot >> 27;
        (self.lot.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % below
    }

    fn number(&mut self) -> u32 {
        self.last += 1;
        self.last
    }

    fn start(&mut self, generation: u32, shadow: bool) {
        let mut setup = Setup::parse_from(["jink", "--process", S::PROGRAM, "--instance", "owners"]);
        setup.generation = generation;
        setup.shadow = shadow;
        self.instances.push(Instance {
            generation,
            member: Some(Member::start(&self.bus, setup, Config::default()).unwrap()),
            stalled_until_ms: 0,
        });
    }

    /// A restart: it does not wait for the record.
    fn start_owner(&mut self) {
        let generation = self.number();
        self.start(generation, false);
        self.entry = ControlEntry {
            active: generation,
            epoch: generation,
            ..self.without_a_change()
        };
        self.publish_record();
    }

    fn without_a_change(&self) -> ControlEntry {
        ControlEntry {
            next: 0,
            next_epoch: 0,
            from: Timestamp::NEVER,
            ..self.entry
        }
    }

    fn publish_record(&mut self) {
        let mut control = Control {
            len: 1,
            ..Control::default()
        };
        control.entries[0] = self.entry;
        self.control.send(SampleHeader::at(self.bus.now()), &control);
    }

    fn alive(&self, generation: u32) -> bool {
        self.instances
            .iter()
            .any(|instance| instance.generation == generation && instance.member.is_some())
    }

    /// Who owns inputs of this moment.
    fn owner(&self) -> u32 {
        match self.entry.next != 0 && self.bus.now() >= self.entry.from {
            true => self.entry.next,
            false => self.entry.active,
        }
    }

    fn other(&self) -> Option<u32> {
        let owner = self.owner();
        let mut others = self.instances.iter().filter(|one| one.generation != owner);
        others.find(|one| one.member.is_some()).map(|one| one.generation)
    }

    fn kill(&mut self, generation: u32, notice_ms: u64) {
        for instance in &mut self.instances {
            if instance.generation == generation && instance.member.take().is_some() {
                self.died.insert(generation, self.now_ms);
                self.deaths.push((self.now_ms + notice_ms, generation));
            }
        }
    }

    fn happens(&mut self, event: Event) {
        match event {
            Event::Wait(ms) => (0..ms).for_each(|_| self.pass()),
            Event::Shadow if self.other().is_none() && self.deaths.is_empty() => {
                let generation = self.number();
                self.start(generation, true);
            }
            Event::Switch(more_ms) if self.entry.next == 0 && self.deaths.is_empty() => {
                if let Some(next) = self.other() {
                    self.entry.next = next;
                    self.entry.next_epoch = self.number();
                    self.entry.from = at(self.now_ms + LEAD_MS + more_ms);
                    self.publish_record();
                }
            }
            Event::Release if self.entry.next == 0 => {
                if let Some(other) = self.other() {
                    self.kill(other, 0);
                }
            }
            Event::Stall { owner, ms } => {
                let whose = if owner { Some(self.owner()) } else { self.other() };
                let until_ms = self.now_ms + ms;
                for instance in &mut self.instances {
                    if Some(instance.generation) == whose {
                        instance.stalled_until_ms = until_ms;
                    }
                }
                // Whoever it is may own what comes meanwhile, and is as late with it.
                self.disturbed.push((self.now_ms, until_ms));
            }
            Event::Kill { notice_ms } => {
                self.kill(self.owner(), notice_ms);
                self.disturbed.push((self.now_ms, self.now_ms + notice_ms));
            }
            Event::KillOther { notice_ms } => {
                if let Some(other) = self.other() {
                    self.kill(other, notice_ms);
                    self.disturbed.push((self.now_ms, self.now_ms + notice_ms));
                }
            }
            _ => {}
        }
    }

    /// What the supervisor does about a death.
    fn notice(&mut self, dead: u32) {
        let is_next = self.entry.next == dead;
        if !is_next && self.entry.active != dead {
            return;
        }
        let left = if is_next {
            self.entry.active
        } else {
            self.entry.next
        };
        let left = Some(left)
            .filter(|left| self.alive(*left))
            .or_else(|| self.other());
        self.switched_ms = None;
        match left {
            // Whoever is left may have to follow one that has published: it goes on in a newer epoch.
            Some(left) => {
                self.entry = ControlEntry {
                    active: left,
                    epoch: self.number(),
                    ..self.without_a_change()
                };
                self.publish_record();
            }
            None => self.start_owner(),
        }
    }

    /// One millisecond.
    fn pass(&mut self) {
        self.now_ms += 1;
        self.bus.set_clock(at(self.now_ms));
        let due: Vec<u32> = self
            .deaths
            .iter()
            .filter(|(ms, _)| *ms <= self.now_ms)
            .map(|(_, dead)| *dead)
            .collect();
        self.deaths.retain(|(ms, _)| *ms > self.now_ms);
        due.into_iter().for_each(|dead| self.notice(dead));
        let is_over = at(self.now_ms.saturating_sub(SETTLE_MS)) >= self.entry.from;
        if self.entry.next != 0 && is_over && self.alive(self.entry.next) {
            self.entry = ControlEntry {
                active: self.entry.next,
                epoch: self.entry.next_epoch,
                ..self.without_a_change()
            };
            self.publish_record();
        }
        let routes_first = self.draw(2) == 0;
        if routes_first {
            self.publish_route();
        }
        let first = self.draw(self.instances.len() as u64) as usize;
        self.instances.rotate_left(first);
        for instance in &mut self.instances {
            if instance.stalled_until_ms <= self.now_ms
                && let Some(member) = &mut instance.member
            {
                member.run_if_due();
            }
        }
        if !routes_first {
            self.publish_route();
        }
        self.read();
    }

    fn publish_route(&mut self) {
        if self.now_ms.is_multiple_of(PERIOD_MS) {
            let id = self.next_route;
            self.next_route += 1;
            self.routes.write(SampleHeader::at(self.bus.now()), |route| {
                *route = Route {
                    id,
                    ..Route::default()
                };
            });
        }
    }

    fn read(&mut self) {
        for (input, list) in [
            (&mut self.reader, &mut self.said),
            (&mut self.guarded, &mut self.taken),
        ] {
            input.each(|stamped| {
                let header = stamped.header;
                list.push(Said {
                    subject: S::subject(stamped.sample),
                    generation: header.generation,
                    epoch: (header.sequence >> 32) as u32,
                    sequence: header.sequence,
                    ms: ms_of(header.publish),
                });
            });
        }
    }

    /// All of it, and then long enough for everything to be as usual.
    fn live(mut self, events: &[Event]) -> Self {
        (0..2 * BEAT_MS).for_each(|_| self.pass());
        for event in events {
            self.happens(*event);
            self.pass();
        }
        (0..AFTER_MS).for_each(|_| self.pass());
        self
    }

    /// What holds whatever happens.
    fn has_one_owner(&self) -> Result<(), TestCaseError> {
        let mut epochs: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        let mut answers: BTreeMap<u64, Vec<Said>> = BTreeMap::new();
        for said in &self.said {
            epochs.entry(said.epoch).or_default().insert(said.generation);
            answers.entry(said.subject).or_default().push(*said);
        }
        for (epoch, generations) in epochs {
            prop_assert_eq!(generations.len(), 1, "epoch {} of {:?}", epoch, generations);
        }
        for (subject, answers) in answers {
            for pair in answers.windows(2) {
                // Nobody knows what a dead owner has answered: its successor answers what it has itself.
                let died_ms = self.died.get(&pair[0].generation);
                let is_inherited =
                    pair[0].epoch != pair[1].epoch && died_ms.is_some_and(|ms| *ms <= pair[1].ms);
                // Who was not run when a beat was due, in silence, and owns the time at which it is: it beats late.
                let [before_ms, after_ms] = [pair[0].ms, pair[1].ms];
                let is_late = S::IS_TIMED
                    && pair[0].epoch != pair[1].epoch
                    && self
                        .disturbed
                        .iter()
                        .any(|(begin_ms, end_ms)| *begin_ms <= before_ms && after_ms <= *end_ms + 1);
                prop_assert!(is_inherited || is_late, "{} twice: {:?}", subject, answers);
            }
        }
        for pair in self.taken.windows(2) {
            prop_assert!(pair[0].sequence < pair[1].sequence, "{:?}", pair);
        }
        Ok(())
    }

    /// Between two outputs that a reader takes nothing is missing but what the disturbances in between account for.
    fn leaves_no_gap(&self, period_ms: u64) -> Result<(), TestCaseError> {
        let end = self.said.last().map_or(0, |said| said.ms);
        prop_assert!(end + 2 * period_ms + 2 >= self.now_ms, "silent since {} ms", end);
        for pair in self.taken.windows(2) {
            let (before_ms, after_ms) = (pair[0].ms, pair[1].ms);
            let felt_ms: u64 = self
                .disturbed
                .iter()
                .filter(|(begin_ms, end_ms)| *begin_ms <= after_ms && *end_ms + period_ms >= before_ms)
                // What is missed on both sides of it, one period each.
                .map(|(begin_ms, end_ms)| end_ms - begin_ms + 2 * period_ms)
                .sum();
            let most_ms = period_ms + 1 + felt_ms;
            prop_assert!(
                after_ms - before_ms <= most_ms,
                "{} ms: {:?}, {:?}",
                most_ms,
                pair,
                self.disturbed
            );
        }
        Ok(())
    }
}

/// Swaps, and nothing that goes wrong.
fn planned() -> impl Strategy<Value = Vec<Event>> {
    let event = prop_oneof![
        (1..250u64).prop_map(Event::Wait),
        Just(Event::Shadow),
        (0..120u64).prop_map(Event::Switch),
        Just(Event::Release),
    ];
    prop::collection::vec(event, 1..30)
}

/// Everything.
fn anything() -> impl Strategy<Value = Vec<Event>> {
    let event = prop_oneof![
        3 => (1..200u64).prop_map(Event::Wait),
        3 => Just(Event::Shadow),
        2 => (0..120u64).prop_map(Event::Switch),
        1 => Just(Event::Release),
        2 => (any::<bool>(), 1..STALL_MS).prop_map(|(owner, ms)| Event::Stall { owner, ms }),
        2 => (0..NOTICE_MS).prop_map(|notice_ms| Event::Kill { notice_ms }),
        1 => (0..NOTICE_MS).prop_map(|notice_ms| Event::KillOther { notice_ms }),
    ];
    prop::collection::vec(event, 1..40)
}

proptest! {
    /// However often ownership changes, each input is answered once, in order, and none is left out.
    #[test]
    fn swaps_answer_each_input_once(events in planned(), lot: u64) {
        let world = World::<Answering>::new(lot).live(&events);
        world.has_one_owner()?;
        let answered: Vec<u64> = world.said.iter().map(|said| said.subject).collect();
        let expected: Vec<u64> = (1..=answered.len() as u64).collect();
        prop_assert_eq!(&answered, &expected);
        prop_assert!(world.next_route - 1 - answered.len() as u64 <= 1);
        prop_assert_eq!(world.said, world.taken);
    }

    /// However often ownership changes, each beat is received once.
    #[test]
    fn swaps_leave_out_no_beat(events in planned(), lot: u64) {
        let world = World::<Beating>::new(lot).live(&events);
        world.has_one_owner()?;
        let beats: Vec<u64> = world.said.iter().map(|said| said.subject).collect();
        let expected: Vec<u64> = (1..=world.now_ms / BEAT_MS).collect();
        prop_assert_eq!(beats, expected);
        prop_assert_eq!(world.said, world.taken);
    }

    /// Whoever dies or is not run for a while, at whatever moment.
    #[test]
    fn deaths_and_delays_give_no_input_two_owners(events in anything(), lot: u64) {
        let world = World::<Answering>::new(lot).live(&events);
        world.has_one_owner()?;
        world.leaves_no_gap(PERIOD_MS)?;
    }

    /// Likewise what is put out at beats: a death costs as long as it takes to be noticed, and a beat.
    #[test]
    fn deaths_and_delays_cost_no_more_than_they_last(events in anything(), lot: u64) {
        let world = World::<Beating>::new(lot).live(&events);
        world.has_one_owner()?;
        world.leaves_no_gap(BEAT_MS)?;
    }
}
