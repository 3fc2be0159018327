//! The flight: recorded samples as they are read, the cycles that can be replayed with them, and what comes of it.

use crate::difference;
use crate::instance::{Instance, InstanceName, Params, RecordedCycle, Start};
use crate::report::{Compared, Difference, Report};
use crate::{ReplayError, layout};
use jink_recorder::reading::{Message, Reading, RecordedSample};
use jink_recorder::{Channel, RecordingCopy};
use jink_runtime::lockstep::replay::Known;
use jink_shared_types::cycles::{CycleEntries, CycleEntry, topic_id};
use jink_shared_types::events::EventSample;
use jink_shared_types::layout::{bytes_of, from_bytes};
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::topics::{CYCLES, EVENT, HEALTH, PARAMETERS, RANGE_CLOUD, SIM_TRUTH, TABLE, TopicRow};
use jink_shared_types::{SampleHeader, Timestamp};
use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// A recording holds what was published before a moment at the latest so much after what was published then (s): the recorder hands over
/// five times a second.
const OUT_OF_ORDER_S: f64 = 2.0;
/// The longest cycle (s): the supervisor ends what is silent for longer.
const CYCLE_MAX_S: f64 = 5.0;
/// Samples that are older than this are kept only if they are the newest of their topic (s): who comes late takes that.
const KEPT_S: f64 = 15.0;
/// How much is read before the next cycles are run (s).
const STEP_S: f64 = 0.1;

/// What is to be replayed.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The recordings of one flight, in the order in which they were begun.
    pub files: Vec<PathBuf>,
    /// The processes; empty: all.
    pub services: Vec<String>,
    /// A program in the place of the services' own.
    pub program: Option<PathBuf>,
    /// Parameters that have other values than in the flight, at every start.
    pub params: Vec<(String, f64)>,
    /// A service takes what the replayed ones have published, not what was recorded of them.
    pub is_chain: bool,
    /// Not faster than it was flown.
    pub is_realtime: bool,
    /// Where the recording of the replay goes.
    pub out: Option<PathBuf>,
}

/// How far a replay is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Of the flight (s).
    pub flight_s: f64,
    /// Cycles.
    pub cycles: u64,
}

/// Replays a flight.
///
/// # Errors
/// [`ReplayError`]; differences are none.
pub fn replay(options: &Options, progress: &mut dyn FnMut(Progress)) -> Result<Report, ReplayError> {
    let mut flight = Flight::of(options);
    for file in &options.files {
        let reading = Reading::open(file)?;
        if flight.start.is_none() {
            flight.start = Some(Start::of(&reading.files)?);
            let out = options.out.as_deref();
            flight.out = out
                .map(|out| RecordingCopy::begin(out, &reading, &options.files))
                .transpose()?;
        }
        let mut failed = None;
        reading.each(|message| match flight.read(message, progress) {
            Ok(()) => true,
            Err(error) => {
                failed = Some(error);
                false
            }
        })?;
        if let Some(error) = failed {
            return Err(error);
        }
    }
    flight.finish()
}

/// A topic of the recording.
#[derive(Debug, Default)]
struct RecordedTopic {
    channel: Channel,
    samples: VecDeque<Recorded>,
    /// Samples that are not in the recording.
    lost: u64,
    /// The number of the first recorded sample of each start of its producer: what was published before was not seen.
    begins: BTreeMap<u32, u32>,
}

/// A sample of the recording.
#[derive(Debug)]
struct Recorded {
    header: SampleHeader,
    payload: Vec<u8>,
    replayed: Replacement,
    is_written: bool,
}

/// What a replayed service has published in the place of a sample.
#[derive(Debug)]
enum Replacement {
    None,
    Sample(Box<(SampleHeader, Vec<u8>)>),
    /// Nothing.
    Gone,
}

impl Recorded {
    fn in_force(&self) -> Option<(&SampleHeader, &[u8])> {
        match &self.replayed {
            Replacement::None => Some((&self.header, &self.payload)),
            Replacement::Sample(sample) => Some((&sample.0, &sample.1)),
            Replacement::Gone => None,
        }
    }
}

struct Flight<'a> {
    options: &'a Options,
    start: Option<Start>,
    out: Option<RecordingCopy>,
    topics: BTreeMap<String, RecordedTopic>,
    instances: BTreeMap<InstanceName, Instance>,
    compared: BTreeMap<InstanceName, Compared>,
    begin: Timestamp,
    /// Everything that was published before has been read.
    read_until: Timestamp,
    advanced: Timestamp,
    began: Instant,
    cycles: u64,
}

impl<'a> Flight<'a> {
    fn of(options: &'a Options) -> Self {
        Self {
            options,
            start: None,
            out: None,
            topics: BTreeMap::new(),
            instances: BTreeMap::new(),
            compared: BTreeMap::new(),
            begin: Timestamp::NEVER,
            read_until: Timestamp::NEVER,
            advanced: Timestamp::NEVER,
            began: Instant::now(),
            cycles: 0,
        }
    }

    fn read(&mut self, message: &Message<'_>, progress: &mut dyn FnMut(Progress)) -> Result<(), ReplayError> {
        let sample = match message {
            Message::Sample(sample) => sample,
            Message::Lost(topic, count) => {
                self.topics.entry((*topic).to_owned()).or_default().lost += count;
                let out = self.out.as_mut();
                return out.map_or(Ok(()), |out| {
                    Ok(out.write_lost(self.read_until, topic, *count)?)
                });
            }
        };
        let publish = sample.header.publish;
        if !self.begin.is_set() {
            self.begin = publish;
        }
        self.read_until = self.read_until.max(before(publish, OUT_OF_ORDER_S));
        match CYCLES.row.member_of(sample.topic) {
            Some(process) => self.read_cycles(process, sample),
            None => self.keep(sample),
        }
        if self.read_until.seconds_since(self.advanced) >= STEP_S {
            self.advanced = self.read_until;
            self.advance(self.read_until)?;
            self.release(self.read_until)?;
            progress(Progress {
                flight_s: self.read_until.seconds_since(self.begin).max(0.0),
                cycles: self.cycles,
            });
        }
        Ok(())
    }

    fn read_cycles(&mut self, process: &str, sample: &RecordedSample<'_>) {
        let name = InstanceName {
            process: process.to_owned(),
            generation: sample.header.generation,
        };
        let entries = from_bytes::<CycleEntries>(sample.payload);
        let (shadow, number) = (entries.shadow.is_set(), sample.header.sequence as u32);
        let instance = self.instances.entry(name).or_default();
        instance.read(number, shadow, entries.entries());
        if self.out.is_some() {
            self.keep(sample);
        }
    }

    fn keep(&mut self, sample: &RecordedSample<'_>) {
        let is_of = |row: &TopicRow| row.member_of(sample.topic).is_some();
        if self.out.is_none() && (is_of(&HEALTH.row) || is_of(&SIM_TRUTH.row)) {
            return;
        }
        let topic = self.topics.entry(sample.topic.to_owned()).or_default();
        if topic.channel.topic.is_empty() {
            topic.channel = Channel::from(sample);
        }
        let SampleHeader {
            generation, sequence, ..
        } = *sample.header;
        topic.begins.entry(generation).or_insert(sequence as u32);
        topic.samples.push_back(Recorded {
            header: *sample.header,
            payload: sample.payload.to_vec(),
            replayed: Replacement::None,
            is_written: false,
        });
    }

    fn finish(mut self) -> Result<Report, ReplayError> {
        let end = self.read_until;
        self.advance(Timestamp::from_ns(u64::MAX))?;
        self.release(Timestamp::from_ns(u64::MAX))?;
        let there: Vec<String> = self.instances.keys().map(|name| name.process.clone()).collect();
        let mut services = self.options.services.iter();
        if let Some(missing) = services.find(|service| !there.contains(service)) {
            let mut there = there;
            there.dedup();
            return Err(ReplayError::NoCycles(Some(missing.clone()), there));
        }
        if there.is_empty() {
            return Err(ReplayError::NoCycles(None, Vec::new()));
        }
        for (name, instance) in &mut self.instances {
            if let (Some(why), true) = (instance.broken.take(), is_wanted(self.options, name)) {
                compared(&mut self.compared, name).ends = Some(why);
            }
        }
        if let Some(out) = self.out.take() {
            out.finish()?;
        }
        Ok(Report {
            instances: self.compared.into_values().collect(),
            flight_s: end.seconds_since(self.begin).max(0.0) + OUT_OF_ORDER_S,
        })
    }

    /// Runs the cycles that are complete, everything published before `until` being read.
    fn advance(&mut self, until: Timestamp) -> Result<(), ReplayError> {
        loop {
            let is_complete = |instance: &Instance| match (instance.cycles.front(), instance.cycles.get(1)) {
                (Some(_), Some(next)) => next.begin <= until,
                (Some(last), None) => last.begin.plus_seconds(CYCLE_MAX_S) <= until,
                _ => false,
            };
            let due = self.instances.iter().filter(|(name, instance)| {
                is_wanted(self.options, name) && is_complete(instance) && !is_at_end(&self.compared, name)
            });
            let begins =
                |(_, instance): &(&InstanceName, &Instance)| instance.cycles.front().map(|cycle| cycle.begin);
            let Some(name) = due.min_by_key(begins).map(|(name, _)| name.clone()) else {
                return Ok(());
            };
            self.run(&name)?;
        }
    }

    /// Runs the next cycle of an instance.
    fn run(&mut self, name: &InstanceName) -> Result<(), ReplayError> {
        let Some(mut instance) = self.instances.remove(name) else {
            return Ok(());
        };
        let ran = match instance.cycles.pop_front() {
            Some(cycle) => self.run_cycle(name, &mut instance, cycle),
            None => Ok(()),
        };
        if is_at_end(&self.compared, name) {
            instance.cycles.clear();
            instance.replayed = None;
        }
        self.instances.insert(name.clone(), instance);
        ran
    }

    fn run_cycle(
        &mut self,
        name: &InstanceName,
        instance: &mut Instance,
        cycle: RecordedCycle,
    ) -> Result<(), ReplayError> {
        if self.options.is_realtime {
            let after_s = cycle.begin.seconds_since(self.begin) - self.began.elapsed().as_secs_f64();
            std::thread::sleep(Duration::from_secs_f64(after_s.max(0.0)));
        }
        if instance.replayed.is_none() {
            self.start(name, instance, cycle.begin)?;
        }
        let Some(replayed) = &mut instance.replayed else {
            return Ok(());
        };
        let mut entries: Vec<CycleEntry> = Vec::new();
        let reads: BTreeMap<u32, String> = replayed
            .topics(false)
            .map(|known| (topic_id(&known.topic), known.topic))
            .collect();
        for entry in &cycle.takes {
            // The program in its place may read less.
            let Some(topic) = reads.get(&entry.topic) else {
                continue;
            };
            if self.options.is_chain {
                self.make(topic, entry.time)?;
            }
            let Some(sample) = self.sample(topic, entry.time) else {
                compared(&mut self.compared, name).ends = Some(missing(topic, entry.time, self.begin));
                return Ok(());
            };
            if let Some((header, payload)) = sample.in_force() {
                let changed = self.with_params(topic, payload);
                replayed.take(topic, header, changed.as_deref().unwrap_or(payload));
                entries.push(*entry);
            }
        }
        let mut published: Vec<(String, SampleHeader, Vec<u8>)> = Vec::new();
        let ran = replayed.cycle(cycle.begin, &entries, |topic, header, payload| {
            published.push((topic.to_owned(), *header, payload.to_vec()));
        });
        if let Err(ended) = ran {
            compared(&mut self.compared, name).ends = Some(format!("the program stopped: {ended}"));
            return Ok(());
        }
        self.cycles += 1;
        let known: Vec<Known> = replayed.topics(true).collect();
        if known.len() != instance.publishes.len() {
            instance.publishes = known;
            let publishes = instance.publishes.iter();
            publishes
                .cloned()
                .try_for_each(|known| self.check_layout(&known))?;
        }
        let end = instance.cycles.front().map(|next| next.begin);
        self.compare(name, instance, &cycle, end, published);
        Ok(())
    }

    /// The sample of a topic that was published at `publish`.
    fn sample(&self, topic: &str, publish: Timestamp) -> Option<&Recorded> {
        let mut samples = self.topics.get(topic)?.samples.iter().rev();
        samples.find(|sample| sample.header.publish == publish)
    }

    /// The sample with the parameters that are to have other values, if that is what it says.
    fn with_params(&self, topic: &str, payload: &[u8]) -> Option<Vec<u8>> {
        if topic != PARAMETERS.row.name || self.options.params.is_empty() {
            return None;
        }
        let mut values = from_bytes::<ParameterValues>(payload);
        for (row, value) in self.start.as_ref()?.rows(&self.options.params) {
            if let Some(place) = values.values.get_mut(row) {
                *place = value;
            }
        }
        Some(bytes_of(&*values).to_vec())
    }

    fn start(
        &mut self,
        name: &InstanceName,
        instance: &mut Instance,
        begin: Timestamp,
    ) -> Result<(), ReplayError> {
        let values = self.topics.get(PARAMETERS.row.name).and_then(|topic| {
            let mut samples = topic.samples.iter().rev();
            samples.find(|sample| sample.header.publish < begin)
        });
        let values = values.map(|sample| from_bytes::<ParameterValues>(&sample.payload));
        let program = self.options.program.as_deref();
        let Some(start) = &self.start else {
            return Err(ReplayError::NoStart);
        };
        let params = Params {
            published: values.as_deref(),
            changed: &self.options.params,
        };
        let replayed = start.start(name, instance.is_shadow, program, &params, begin)?;
        let all: Vec<Known> = replayed.topics(false).chain(replayed.topics(true)).collect();
        all.into_iter().try_for_each(|known| self.check_layout(&known))?;
        instance.replayed = Some(replayed);
        Ok(())
    }

    /// A topic is understood only in the layout in which it was recorded.
    fn check_layout(&self, known: &Known) -> Result<(), ReplayError> {
        let recorded = self.topics.get(&known.topic).map(|topic| &topic.channel);
        match recorded {
            Some(channel) if !channel.topic.is_empty() && channel.type_name != known.type_name => {
                Err(ReplayError::Layout(layout::difference(
                    &known.topic,
                    &channel.type_name,
                    &channel.schema,
                    &known.type_name,
                )))
            }
            _ => Ok(()),
        }
    }

    /// Runs the cycle of the replayed service that published a sample, if it has not been run.
    fn make(&mut self, topic: &str, publish: Timestamp) -> Result<(), ReplayError> {
        let Some(sample) = self.sample(topic, publish) else {
            return Ok(());
        };
        let generation = sample.header.generation;
        loop {
            let makes = |(name, instance): &(&InstanceName, &Instance)| {
                let is_of_it = instance.publishes.iter().any(|known| known.topic == topic);
                let is_before = instance.cycles.front().is_some_and(|next| next.begin <= publish);
                let is_replayed = is_wanted(self.options, name) && !is_at_end(&self.compared, name);
                name.generation == generation && is_of_it && is_before && is_replayed
            };
            let Some(name) = self.instances.iter().find(makes).map(|(name, _)| name.clone()) else {
                return Ok(());
            };
            self.run(&name)?;
        }
    }

    /// Compares what one cycle has published with what was recorded of it: what was published until the next cycle began, at `end`.
    fn compare(
        &mut self,
        name: &InstanceName,
        instance: &Instance,
        cycle: &RecordedCycle,
        end: Option<Timestamp>,
        published: Vec<(String, SampleHeader, Vec<u8>)>,
    ) {
        let compared = compared(&mut self.compared, name);
        compared.cycles += 1;
        let at_ns = cycle.begin.ns_since(self.begin);
        let difference = |topic: &str, field, is_recorded| Difference {
            topic: topic.to_owned(),
            cycle: cycle.number,
            at_ns,
            field,
            is_recorded,
        };
        let is_compared = |known: &&Known| {
            let is_of = |row: &TopicRow| row.member_of(&known.topic).is_some();
            !is_of(&HEALTH.row) && !is_of(&CYCLES.row)
        };
        let keeps = self.options.is_chain || self.out.is_some();
        for known in instance.publishes.iter().filter(is_compared) {
            // Nothing of it is in the recording.
            let Some(topic) = self.topics.get_mut(&known.topic) else {
                continue;
            };
            let is_events = known.topic == EVENT.row.name;
            let row = TABLE.iter().find(|row| row.member_of(&known.topic).is_some());
            let is_of_others = !is_events && row.is_some_and(|row| row.producers.len() > 1);
            let is_own = |sample: &Recorded| {
                sample.header.generation == name.generation
                    && sample.header.publish >= cycle.begin
                    && end.is_none_or(|end| sample.header.publish < end)
                    && (!is_events || process_of(&sample.payload) == name.process)
            };
            let samples = topic.samples.iter_mut();
            let mut recorded: Vec<&mut Recorded> = samples.filter(|it| is_own(it)).collect();
            let begin = topic.begins.get(&name.generation).copied();
            let is_before =
                |header: &SampleHeader| begin.is_some_and(|begin| (header.sequence as u32) < begin);
            let of_topic = published.iter().filter(|(topic, ..)| *topic == known.topic);
            // By their order in the cycle, or, where some were not recorded, by their numbers.
            let is_partner = |recorded: &&mut Recorded, header: &SampleHeader| {
                topic.lost == 0 && !is_of_others || recorded.header.sequence as u32 == header.sequence as u32
            };
            for (_, header, payload) in of_topic {
                let same = recorded.iter().position(|it| is_partner(it, header));
                let found = match same {
                    Some(place) => {
                        let sample = recorded.remove(place);
                        let was = &sample.payload;
                        let now = &payload[..payload.len().min(was.len())];
                        let field = difference::of_headers(&sample.header, header)
                            .or_else(|| difference::of_payloads(&known.topic, was, now));
                        if keeps {
                            let header = replaced(&sample.header, header);
                            sample.replayed = Replacement::Sample(Box::new((header, payload.clone())));
                        }
                        compared.samples += 1;
                        field.map(|field| difference(&known.topic, Some(field), true))
                    }
                    None if topic.lost > 0 || is_before(header) => None,
                    None => Some(difference(&known.topic, None, false)),
                };
                if let Some(found) = found {
                    compared.differing += 1;
                    compared.first.get_or_insert(found);
                }
            }
            // What is behind the last cycle on record was published in cycles that are not: the process was killed.
            for sample in recorded.into_iter().filter(|_| !is_of_others && end.is_some()) {
                sample.replayed = Replacement::Gone;
                compared.differing += 1;
                compared.first.get_or_insert(difference(&known.topic, None, true));
            }
        }
    }

    /// Writes and forgets what nobody will take any more, everything published before `until` being read.
    fn release(&mut self, until: Timestamp) -> Result<(), ReplayError> {
        let wanted = self
            .instances
            .iter()
            .filter(|(name, _)| is_wanted(self.options, name));
        let begins = wanted.filter_map(|(_, instance)| Some(instance.cycles.front()?.begin));
        let needed = begins.fold(until, Timestamp::min);
        let old = match until.ns {
            u64::MAX => until,
            _ => before(needed, KEPT_S),
        };
        if let Some(out) = &mut self.out {
            let mut due: Vec<(&Channel, &mut Recorded)> = Vec::new();
            for topic in self.topics.values_mut() {
                let RecordedTopic { channel, samples, .. } = topic;
                let is_due = |sample: &&mut Recorded| !sample.is_written && sample.header.publish <= old;
                due.extend(
                    samples
                        .iter_mut()
                        .filter(is_due)
                        .map(|sample| (&*channel, sample)),
                );
            }
            due.sort_by_key(|(_, sample)| sample.header.publish);
            for (channel, sample) in due {
                sample.is_written = true;
                if let Some((header, payload)) = sample.in_force() {
                    out.write(channel, header, payload)?;
                }
            }
        }
        for topic in self.topics.values_mut() {
            let is_old = |sample: &Recorded| sample.header.publish <= old;
            while topic.samples.get(1).is_some_and(is_old) {
                topic.samples.pop_front();
            }
        }
        Ok(())
    }
}

fn is_wanted(options: &Options, name: &InstanceName) -> bool {
    options.services.is_empty() || options.services.contains(&name.process)
}

fn is_at_end(all: &BTreeMap<InstanceName, Compared>, name: &InstanceName) -> bool {
    all.get(name).is_some_and(|compared| compared.ends.is_some())
}

fn compared<'a>(all: &'a mut BTreeMap<InstanceName, Compared>, name: &InstanceName) -> &'a mut Compared {
    all.entry(name.clone()).or_insert_with(|| Compared {
        instance: name.clone(),
        cycles: 0,
        samples: 0,
        differing: 0,
        first: None,
        ends: None,
    })
}

fn missing(topic: &str, publish: Timestamp, begin: Timestamp) -> String {
    let at_s = publish.ns as f64 * 1e-9 - begin.ns as f64 * 1e-9;
    let hint = match RANGE_CLOUD.row.member_of(topic) {
        Some(_) => "; with `clouds = true` the recorder keeps clouds",
        None => "",
    };
    format!("it took a sample of {topic}, published at {at_s:.3} s, that is not in the recording{hint}")
}

/// Which process an event is of.
fn process_of(event: &[u8]) -> String {
    from_bytes::<EventSample>(event).process.as_str().to_owned()
}

/// The header of what was published in the place of a recorded sample: what it was made from is new, when it left is not.
fn replaced(recorded: &SampleHeader, replayed: &SampleHeader) -> SampleHeader {
    let mut header = *replayed;
    let own = |place: &usize| replayed.stages[*place].end == replayed.publish;
    for place in (0..header.stages.len()).filter(own) {
        header.stages[place].end = recorded.stages[place].end;
        header.busy_us[place] = recorded.busy_us[place];
    }
    header.publish = recorded.publish;
    header.sequence = recorded.sequence;
    header
}

fn before(time: Timestamp, seconds: f64) -> Timestamp {
    Timestamp::from_ns(time.ns.saturating_sub((seconds * 1e9) as u64))
}
