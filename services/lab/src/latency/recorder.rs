//! Looks on while a system flies, and keeps the history of each trajectory that has reached the autopilot.

use super::figures::Figures;
use super::load::Load;
use crate::rig::Observer;
use jink_control::Problem;
use jink_control::figures::round;
use jink_runtime::procfs::{Disturbances, ProcessStat, locked_kib};
use jink_runtime::{Input, Session};
use jink_shared_types::health::SystemStatus;
use jink_shared_types::link::Delivery;
use jink_shared_types::{STAGE_NAMES, SampleHeader, Stage, Timestamp, topics};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Left out at the begin of the mission: the vehicle speeds up, memory is touched for the first time.
const SETTLE: Duration = Duration::from_secs(3);

/// One stage of the way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageFigures {
    /// Its name.
    pub stage: String,
    /// From the publication of its input until it was free for it; all of the time to its begin if a cycle before had it already.
    pub busy: Figures,
    /// From then to its begin: the wake-up.
    pub wake_up: Figures,
    /// From its begin to its own publication.
    pub compute: Figures,
}

/// What one process has used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProcessFigures {
    /// Its name.
    pub process: String,
    /// Share of one core (percent).
    pub cpu_percent: f64,
    /// Times it went to sleep, per second.
    pub waits_per_s: f64,
    /// Times its core was taken away, per second.
    pub preemptions_per_s: f64,
    /// Pages found in memory when they were first touched, per second.
    pub minor_faults_per_s: f64,
    /// Pages read from a disk, all together.
    pub major_faults: u64,
}

/// Everything that one load has shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// The load.
    pub load: Load,
    /// How long it was looked at (s).
    pub seconds: f64,
    /// From the capture to the bytes handed to the kernel.
    pub total: Figures,
    /// From the sensor's publication to that.
    pub after_sensor: Figures,
    /// The same of trajectories that were the first of their map. The others are not slow: the goal changed while that map was the newest,
    /// or no plan was found at first.
    #[serde(default)]
    pub first_of_map: Figures,
    /// The stages that were passed, in their order.
    pub stages: Vec<StageFigures>,
    /// The processes, in start order.
    pub processes: Vec<ProcessFigures>,
    /// All times from the sensor's publication to the wire (ms), the shortest first.
    pub sorted_after_sensor_ms: Vec<f64>,
    /// All times from the capture to the wire (ms), the shortest first.
    pub sorted_total_ms: Vec<f64>,
    /// Processes that were started again: then the figures are not those of a quiet flight.
    pub restarts: u32,
}

/// What a process had used at some moment.
#[derive(Clone, Copy, Debug)]
struct Used {
    pid: u32,
    cpu_s: f64,
    disturbances: Disturbances,
}

impl Used {
    fn now(pid: u32) -> Option<Self> {
        Some(Self {
            pid,
            cpu_s: ProcessStat::now(pid)?.cpu_s,
            disturbances: Disturbances::now(pid)?,
        })
    }
}

/// See the module's text.
pub struct Recorder {
    window: Duration,
    deliveries: Option<Input<Delivery>>,
    first: Option<Instant>,
    begun: Option<(Instant, BTreeMap<String, Used>)>,
    headers: Vec<SampleHeader>,
    processes: Vec<ProcessFigures>,
    seconds: f64,
    restarts: u32,
    /// Every process had SCHED_FIFO and kept its memory.
    is_realtime: bool,
}

impl std::fmt::Debug for Recorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Recorder({} deliveries)", self.headers.len())
    }
}

impl Recorder {
    /// Looks on for so long once the vehicle is on its way.
    pub fn new(window: Duration) -> Self {
        Self {
            window,
            deliveries: None,
            first: None,
            begun: None,
            headers: Vec::new(),
            processes: Vec::new(),
            seconds: 0.0,
            restarts: 0,
            is_realtime: false,
        }
    }

    /// Whether every process had SCHED_FIFO and kept its memory: who asks for it may be refused.
    pub fn is_realtime(&self) -> bool {
        self.is_realtime
    }

    /// What was seen under `load`; `None` if no trajectory has reached the autopilot.
    pub fn measured(&self, load: Load) -> Option<Measured> {
        if self.headers.is_empty() {
            return None;
        }
        let ms = |us: u64| us as f64 * 1e-3;
        let gateway_end = |header: &SampleHeader| header.stages[Stage::Gateway as usize].end;
        let since = |header: &SampleHeader, time: Timestamp| ms(gateway_end(header).ns_since(time) / 1_000);
        let since_sensor = |header: &SampleHeader| since(header, header.stages[Stage::Sensor as usize].end);
        let all = || self.headers.iter();
        let total_ms: Vec<f64> = all().map(|header| since(header, header.capture)).collect();
        let after_sensor_ms: Vec<f64> = all().map(since_sensor).collect();
        let first_of_map_ms: Vec<f64> = all()
            .filter(|header| is_first_of_map(header))
            .map(since_sensor)
            .collect();
        let stages = Stage::ALL
            .into_iter()
            .filter_map(|stage| self.stage(stage))
            .collect();
        Some(Measured {
            load,
            seconds: round(self.seconds),
            total: Figures::of(&total_ms),
            after_sensor: Figures::of(&after_sensor_ms),
            first_of_map: Figures::of(&first_of_map_ms),
            stages,
            processes: self.processes.clone(),
            sorted_after_sensor_ms: sorted(after_sensor_ms),
            sorted_total_ms: sorted(total_ms),
            restarts: self.restarts,
        })
    }

    fn stage(&self, stage: Stage) -> Option<StageFigures> {
        let index = stage as usize;
        let (mut busy, mut wake_up, mut compute) = (Vec::new(), Vec::new(), Vec::new());
        for header in &self.headers {
            let time = header.stages[index];
            let Some([hop_us, busy_us]) = header.hop_us(stage) else {
                continue;
            };
            busy.push(busy_us as f64 * 1e-3);
            wake_up.push((hop_us - busy_us) as f64 * 1e-3);
            compute.push(time.end.ns_since(time.begin) as f64 * 1e-6);
        }
        (!compute.is_empty()).then(|| StageFigures {
            stage: STAGE_NAMES[index].to_owned(),
            busy: Figures::of(&busy),
            wake_up: Figures::of(&wake_up),
            compute: Figures::of(&compute),
        })
    }

    fn take_deliveries(&mut self) {
        let (headers, is_begun) = (&mut self.headers, self.begun.is_some());
        let mut has_come = false;
        if let Some(input) = &mut self.deliveries {
            input.each(|delivery| {
                has_come = true;
                if is_begun {
                    headers.push(*delivery.header);
                }
            });
        }
        if has_come {
            self.first.get_or_insert_with(Instant::now);
        }
    }
}

/// Whether the planner made the trajectory in the cycle that its map started: all of the time before any later one counts as busy.
fn is_first_of_map(header: &SampleHeader) -> bool {
    header
        .hop_us(Stage::Planner)
        .is_none_or(|[hop_us, busy_us]| busy_us < hop_us || hop_us == 0)
}

fn sorted(mut times: Vec<f64>) -> Vec<f64> {
    times.sort_by(f64::total_cmp);
    times.into_iter().map(round).collect()
}

fn used(status: &SystemStatus) -> BTreeMap<String, Used> {
    let processes = status.processes().iter();
    processes
        .filter_map(|process| {
            let used = Used::now(process.pid)?;
            Some((process.heartbeat.name.as_str().to_owned(), used))
        })
        .collect()
}

impl Observer for Recorder {
    fn begin(&mut self, session: &Session) -> Result<(), Problem> {
        self.deliveries = Some(session.input(topics::DELIVERY, "")?);
        Ok(())
    }

    fn look(&mut self, status: Option<&SystemStatus>) -> bool {
        self.take_deliveries();
        let Some(status) = status else {
            return false;
        };
        let is_settled = self.first.is_some_and(|first| first.elapsed() >= SETTLE);
        if is_settled && self.begun.is_none() {
            self.begun = Some((Instant::now(), used(status)));
        }
        let Some((since, before)) = &self.begun else {
            return false;
        };
        if since.elapsed() < self.window {
            return false;
        }
        self.seconds = since.elapsed().as_secs_f64();
        self.restarts = status.restarts;
        self.is_realtime = status.processes().iter().all(|process| {
            let priority = ProcessStat::now(process.pid).map_or(0, |stat| stat.fifo_priority);
            priority > 0 && locked_kib(process.pid).unwrap_or(0) > 0
        });
        let now = used(status);
        let names = status
            .processes()
            .iter()
            .map(|process| process.heartbeat.name.as_str());
        self.processes = names
            .filter_map(|name| {
                let (before, now) = (before.get(name)?, now.get(name)?);
                (before.pid == now.pid).then(|| ProcessFigures::of(name, *before, *now, self.seconds))
            })
            .collect();
        true
    }

    fn end(&mut self) {
        self.deliveries = None;
    }
}

impl ProcessFigures {
    fn of(name: &str, before: Used, now: Used, seconds: f64) -> Self {
        let added = now.disturbances.since(before.disturbances);
        let per_s = |count: u64| round(count as f64 / seconds);
        Self {
            process: name.to_owned(),
            cpu_percent: round(100.0 * (now.cpu_s - before.cpu_s) / seconds),
            waits_per_s: per_s(added.waits),
            preemptions_per_s: per_s(added.preemptions),
            minor_faults_per_s: per_s(added.minor_faults),
            major_faults: added.major_faults,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Recorder;
    use crate::latency::disturbance::Disturbance;
    use crate::latency::load::Load;
    use jink_shared_types::{SampleHeader, Stage, StageTime, Timestamp};
    use std::time::Duration;

    fn us(us: u64) -> Timestamp {
        Timestamp::from_ns(1_000_000_000 + us * 1_000)
    }

    #[test]
    fn a_history_is_taken_apart_into_waiting_waking_and_computing() {
        let mut header = SampleHeader::at(us(0));
        for (stage, begin, end) in [
            (Stage::Sensor, 0, 4_000),
            (Stage::Fusion, 4_300, 6_300),
            (Stage::Gateway, 6_400, 7_000),
        ] {
            header.stages[stage as usize] = StageTime {
                begin: us(begin),
                end: us(end),
            };
        }
        header.busy_us[Stage::Fusion as usize] = 200;
        let load = Load {
            points: 1,
            rate_hz: 10.0,
            sensors: 1,
            readers: 0,
            beside: Disturbance::None,
            realtime: false,
        };
        let mut recorder = Recorder::new(Duration::ZERO);
        assert_eq!(recorder.measured(load), None);
        recorder.headers.push(header);
        let measured = recorder.measured(load).unwrap();
        assert_eq!((measured.total.p50_ms, measured.after_sensor.p50_ms), (7.0, 3.0));
        let fusion = measured
            .stages
            .iter()
            .find(|stage| stage.stage == "fusion")
            .unwrap();
        let [busy, wake_up, compute] =
            [fusion.busy, fusion.wake_up, fusion.compute].map(|figures| figures.max_ms);
        assert_eq!((busy, wake_up, compute), (0.2, 0.1, 2.0));
        assert!(measured.stages.iter().all(|stage| stage.stage != "planner"));
        assert_eq!(measured.first_of_map.n, 1);
    }

    #[test]
    fn a_second_plan_of_a_map_is_counted_apart() {
        let mut header = SampleHeader::at(us(0));
        for (stage, begin, end) in [
            (Stage::Sensor, 0, 4_000),
            (Stage::Planner, 37_000, 38_000),
            (Stage::Gateway, 38_100, 39_000),
        ] {
            header.stages[stage as usize] = StageTime {
                begin: us(begin),
                end: us(end),
            };
        }
        let load = Load {
            points: 1,
            rate_hz: 10.0,
            sensors: 1,
            readers: 0,
            beside: Disturbance::None,
            realtime: false,
        };
        let mut recorder = Recorder::new(Duration::ZERO);
        header.busy_us[Stage::Planner as usize] = 32_900;
        recorder.headers.push(header);
        header.busy_us[Stage::Planner as usize] = 33_000;
        recorder.headers.push(header);
        let measured = recorder.measured(load).unwrap();
        assert_eq!((measured.after_sensor.n, measured.first_of_map.n), (2, 1));
    }
}
