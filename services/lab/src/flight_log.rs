//! The course of a flight: what the simulation and the gateway said, and the summary of it.

use crate::drill::Fault;
use crate::handover::SeamFigures;
use jink_control::figures::{StageLatency, latency_ms, latency_text, round};
use jink_shared_types::STAGE_ROOM;
use jink_shared_types::health::Histogram;
use jink_shared_types::link::LinkStatus;
use jink_shared_types::truth::SimTruth;
use jink_shared_types::vehicle::NavMode;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Distance between two kept points of the course (m): finer than anything in a picture of it.
const SPACING_M: f64 = 0.1;
/// Time between two kept points of a vehicle that does not move (s).
const SPACING_S: f64 = 0.5;

/// A point of the course.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoursePoint {
    /// North of the start (m).
    pub north_m: f64,
    /// East of the start (m).
    pub east_m: f64,
    /// Above the start (m).
    pub up_m: f64,
    /// Speed (m/s).
    pub speed_mps: f64,
    /// Since the mission began (s); negative before.
    pub time_s: f64,
    /// From the vehicle's hull to the nearest obstacle (m); infinity = there is none.
    pub clearance_m: f64,
}

impl CoursePoint {
    /// Where and when the vehicle is; the time is the simulation's.
    fn of(truth: &SimTruth) -> Self {
        Self {
            time_s: truth.time_s,
            clearance_m: truth.clearance_m,
            north_m: truth.position.x_m,
            east_m: truth.position.y_m,
            up_m: -truth.position.z_m,
            speed_mps: truth.velocity.vector().norm(),
        }
    }

    fn is_apart(&self, other: &Self) -> bool {
        let (north, east) = (self.north_m - other.north_m, self.east_m - other.east_m);
        let moved_m = (north * north + east * east + (self.up_m - other.up_m).powi(2)).sqrt();
        moved_m >= SPACING_M || self.time_s - other.time_s >= SPACING_S
    }
}

/// How a flight ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The last mission item was reached without touching anything.
    Goal,
    /// The vehicle touched an obstacle.
    Collision,
    /// The time was over first.
    Timeout,
    /// Whoever looked on has seen enough.
    Enough,
    /// With what the sensors see no motion can be certified: said before anything moved.
    Refused {
        /// What is not seen, and what would help.
        reason: String,
    },
    /// Something else kept it from flying.
    Failed {
        /// What.
        reason: String,
    },
}

impl Outcome {
    /// The word in the summary.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Goal => "goal",
            Self::Collision => "collision",
            Self::Timeout => "timeout",
            Self::Enough => "enough",
            Self::Refused { .. } => "refused",
            Self::Failed { .. } => "failed",
        }
    }
}

/// A fault during the flight, and what came of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultRecord {
    /// What was done.
    pub fault: Fault,
    /// To which process.
    pub process: String,
    /// When, after the start of the mission (s); negative before.
    pub at_s: f64,
    /// In which mode of the autopilot.
    pub phase: String,
    /// The process works (again): of a kill or a stop that its replacement was seen, of a swap that it was made.
    pub survived: bool,
    /// Of a hang: from its begin until it was seen (ms), as far as looking fifty times a second can show.
    pub detection_ms: Option<f64>,
    /// Until the first heartbeat of the replacement's loop (ms): of a kill from the signal on, of a hang from its detection.
    pub recovery_ms: Option<f64>,
    /// Largest time between two setpoints from the fault until a second and a half after its end (ms).
    pub gap_ms: f64,
    /// Contacts with obstacles meanwhile.
    pub collisions: u32,
    /// Falls of the autopilot to Hold meanwhile.
    pub holds: u32,
    /// Where the vehicle was, north of the start (m).
    pub north_m: f64,
    /// Where the vehicle was, east of the start (m).
    pub east_m: f64,
    /// Of a swap: what the readers of its topics saw of it.
    pub seams: Vec<SeamFigures>,
    /// Of a swap that was not made: why.
    pub reason: Option<String>,
}

impl FaultRecord {
    /// For people.
    pub fn line(&self) -> String {
        let came_of_it = match (self.fault, self.recovery_ms, self.survived) {
            (Fault::Kill | Fault::Stop, Some(ms), _) => format!("back after {ms:.0} ms"),
            (Fault::Kill | Fault::Stop, None, _) => "did not come back".to_owned(),
            (Fault::Swap, _, false) => self.reason.clone().unwrap_or_else(|| "no answer".to_owned()),
            _ => "done".to_owned(),
        };
        format!(
            "{} of {} at {:.1} s: {came_of_it}, largest gap {:.0} ms",
            self.fault, self.process, self.at_s, self.gap_ms
        )
    }
}

/// Whether a mission is under way: by the autopilot, or by jink, to which it may have gone between two heartbeats.
fn flies_mission(truth: &SimTruth) -> bool {
    let mode = truth.mode.get();
    truth.armed.is_set() && (mode == NavMode::Mission || mode == NavMode::Offboard && !truth.landed.is_set())
}

/// The stream of setpoints as the autopilot sees it.
#[derive(Clone, Copy, Debug, Default)]
struct Stream {
    setpoints: u64,
    since_s: f64,
    /// Largest gap since it was asked for last (s).
    gap_s: f64,
}

/// What is known of the flight so far.
#[derive(Clone, Debug, Default)]
pub struct FlightLog {
    course: Vec<CoursePoint>,
    truth: Option<SimTruth>,
    mission_began_s: Option<f64>,
    /// The newest figures of each start of the gateway: they count from its start.
    links: BTreeMap<u32, LinkStatus>,
    armed_s: Option<f64>,
    stream: Stream,
}

impl FlightLog {
    /// Takes a sample of the ground truth.
    pub fn see_truth(&mut self, truth: &SimTruth) {
        if self.mission_began_s.is_none() && flies_mission(truth) {
            self.mission_began_s = Some(truth.time_s);
        }
        if self.armed_s.is_none() && truth.armed.is_set() {
            self.armed_s = Some(truth.time_s);
        }
        self.see_stream(truth);
        let point = CoursePoint::of(truth);
        if self.armed_s.is_some() && self.course.last().is_none_or(|last| point.is_apart(last)) {
            self.course.push(point);
        }
        self.truth = Some(*truth);
    }

    fn see_stream(&mut self, truth: &SimTruth) {
        let stream = &mut self.stream;
        // On the ground, and where a pilot flies, nobody waits for setpoints.
        let mode = truth.mode.get();
        let follows = mode == NavMode::Offboard && !truth.landed.is_set();
        let counts = truth.armed.is_set() && (mode.is_automatic() || follows);
        if truth.setpoints != stream.setpoints || !counts {
            stream.setpoints = truth.setpoints;
            stream.since_s = truth.time_s;
        }
        stream.gap_s = stream.gap_s.max(truth.time_s - stream.since_s);
    }

    /// Largest time without a setpoint since this was asked last (s), to a step of the simulation.
    pub fn take_gap_s(&mut self) -> f64 {
        std::mem::take(&mut self.stream.gap_s)
    }

    /// Time since the motors were armed (s); `None` = not yet.
    pub fn armed_time_s(&self) -> Option<f64> {
        Some(self.truth.as_ref()?.time_s - self.armed_s?)
    }

    /// Takes the gateway's figures; `generation` distinguishes its starts.
    pub fn see_link(&mut self, generation: u32, link: &LinkStatus) {
        self.links.insert(generation, *link);
    }

    /// The newest ground truth.
    pub fn truth(&self) -> Option<&SimTruth> {
        self.truth.as_ref()
    }

    /// The course flown, from arming on.
    pub fn course(&self) -> Vec<CoursePoint> {
        let began_s = self.mission_began_s.or(self.armed_s).unwrap_or(0.0);
        let since_then = |point: &CoursePoint| CoursePoint {
            time_s: point.time_s - began_s,
            ..*point
        };
        self.course.iter().map(since_then).collect()
    }

    /// Time since the mission began (s); `None` = not yet.
    pub fn mission_time_s(&self) -> Option<f64> {
        Some(self.truth.as_ref()?.time_s - self.mission_began_s?)
    }

    /// Whether the vehicle has touched an obstacle.
    pub fn has_collided(&self) -> bool {
        self.truth.is_some_and(|truth| truth.collisions > 0)
    }

    /// Whether the last mission item has been reached.
    pub fn is_done(&self) -> bool {
        self.truth.is_some_and(|truth| truth.mission_done.is_set())
    }

    /// One line on how it goes.
    pub fn progress(&self, health: &str, restarts: u32) -> String {
        let Some(truth) = &self.truth else {
            return format!("waiting for the simulation ({health})");
        };
        let clearance = if truth.clearance_m.is_finite() {
            format!("{:.1} m", truth.clearance_m)
        } else {
            "-".to_owned()
        };
        format!(
            "{:5.1} s  {:<8} item {}/{}  north {:6.1} east {:6.1} up {:4.1} m  {:4.1} m/s  clearance {clearance:<7} \
             {health}, {restarts} restarts",
            self.mission_time_s().unwrap_or(0.0),
            truth.mode.get().to_string(),
            truth.mission_item,
            truth.mission_items,
            truth.position.x_m,
            truth.position.y_m,
            0.0 - truth.position.z_m,
            truth.velocity.vector().norm(),
        )
    }

    /// The summary of a flight that ended as `outcome` in `world`.
    pub fn summary(
        &self,
        outcome: &Outcome,
        world: &str,
        seed: u64,
        restarts: u32,
        faults: Vec<FaultRecord>,
    ) -> Summary {
        let mut latency = Histogram::default();
        let mut stages = [Histogram::default(); STAGE_ROOM];
        let mut hops = [Histogram::default(); STAGE_ROOM];
        for link in self.links.values() {
            latency.merge(&link.capture_to_wire);
            for (sum, stage) in stages.iter_mut().zip(&link.stages) {
                sum.merge(stage);
            }
            for (sum, hop) in hops.iter_mut().zip(&link.hops) {
                sum.merge(hop);
            }
        }
        let [p50_ms, p99_ms, max_ms] = latency_ms(&latency);
        let truth = self.truth.unwrap_or_default();
        let speed_mps = (truth.cruise_s > 0.0).then(|| truth.cruise_m / truth.cruise_s);
        Summary {
            outcome: outcome.word(),
            reason: match outcome {
                Outcome::Failed { reason } | Outcome::Refused { reason } => Some(reason.clone()),
                _ => None,
            },
            world: world.to_owned(),
            seed,
            declarations: Vec::new(),
            collisions: truth.collisions,
            min_clearance_m: Some(round(truth.min_clearance_m))
                .filter(|m| m.is_finite() && self.truth.is_some()),
            mean_speed_mps: round(speed_mps.unwrap_or(0.0)),
            flown_m: round(truth.flown_m),
            flight_time_s: round(self.mission_time_s().unwrap_or(0.0)),
            setpoint_max_gap_ms: round(truth.setpoint_gap_max_s * 1e3),
            setpoints: truth.setpoints,
            fcu_hold_count: truth.hold_count,
            latency_p50_ms: p50_ms,
            latency_p99_ms: p99_ms,
            latency_max_ms: max_ms,
            latency_stages: StageLatency::of(&stages, &hops),
            restarts,
            faults,
            simulator_late_max_ms: round(truth.late_max_s * 1e3),
            machine_stall_max_ms: 0.0,
            machine_stolen_ms: 0.0,
            memory: Vec::new(),
        }
    }
}

/// A flight in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// `goal`, `collision`, `timeout`, `refused` or `failed`.
    pub outcome: &'static str,
    /// Why it failed or was refused; `None` otherwise.
    pub reason: Option<String>,
    /// Kind of world.
    pub world: String,
    /// Seed of the world.
    pub seed: u64,
    /// Declarations of the user that were in force.
    pub declarations: Vec<&'static str>,
    /// Contacts with obstacles.
    pub collisions: u32,
    /// Smallest distance from the vehicle's hull to an obstacle (m); `None` without obstacles.
    pub min_clearance_m: Option<f64>,
    /// Mean speed under way, without take-off and landing (m/s).
    pub mean_speed_mps: f64,
    /// Way flown (m).
    pub flown_m: f64,
    /// Duration of the mission (s).
    pub flight_time_s: f64,
    /// Largest time between two setpoints as the autopilot saw it (ms).
    pub setpoint_max_gap_ms: f64,
    /// Setpoints the autopilot received.
    pub setpoints: u64,
    /// How often the autopilot fell back to Hold because its companion failed it.
    pub fcu_hold_count: u32,
    /// Capture of the newest range behind a setpoint to its bytes handed to the kernel, median (ms); `None` without one.
    pub latency_p50_ms: Option<f64>,
    /// 99th percentile (ms).
    pub latency_p99_ms: Option<f64>,
    /// Longest (ms).
    pub latency_max_ms: Option<f64>,
    /// What each stage adds to it.
    pub latency_stages: Vec<StageLatency>,
    /// Restarts of processes.
    pub restarts: u32,
    /// What was done to it on purpose.
    pub faults: Vec<FaultRecord>,
    /// Largest time by which the simulation, autopilot included, ran behind the wall clock (ms): stand still of the
    /// machine as far as it hit the simulator itself.
    pub simulator_late_max_ms: f64,
    /// The longest time by which the machine woke an idle thread late (ms): what no flight code can make up for.
    pub machine_stall_max_ms: f64,
    /// Time that the hypervisor gave to others meanwhile (ms).
    pub machine_stolen_ms: f64,
    /// Memory of the processes that lived longer than their warm-up.
    pub memory: Vec<MemoryUse>,
}

/// Memory of one process.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MemoryUse {
    /// The process.
    pub process: String,
    /// Resident at the end, touched shared memory included (KiB).
    pub resident_kib: u64,
    /// Growth since half a minute after its start (KiB).
    pub growth_kib: i64,
}

impl Summary {
    /// For people.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let reason = self
            .reason
            .as_ref()
            .map_or(String::new(), |reason| format!(": {reason}"));
        let clearance = self.min_clearance_m.map_or("no obstacles".to_owned(), |m| {
            format!("smallest clearance {m:.2} m")
        });
        let stages = match self.latency_stages.as_slice() {
            [] => String::new(),
            stages => format!("\n    of that p50/p99: {}", StageLatency::line(stages)),
        };
        let verdict = format!(
            "{} (world {}, seed {}){reason}",
            self.outcome, self.world, self.seed
        );
        if self.flight_time_s <= 0.0 {
            return format!("{verdict}\n  the mission never began\n");
        }
        let lines = [
            verdict,
            format!("  {} collisions, {clearance}", self.collisions),
            format!("  declared: {}", or_nothing(&self.declarations)),
            format!(
                "  {:.1} m in {:.1} s, mean speed {:.2} m/s under way",
                self.flown_m, self.flight_time_s, self.mean_speed_mps
            ),
            format!(
                "  {} setpoints, largest gap {:.0} ms, autopilot fell back to Hold {} times",
                self.setpoints, self.setpoint_max_gap_ms, self.fcu_hold_count
            ),
            format!(
                "  capture to wire {}{stages}",
                latency_text([self.latency_p50_ms, self.latency_p99_ms, self.latency_max_ms])
            ),
            format!("  {} restarts", self.restarts),
            format!(
                "  the machine: an idle thread woken {:.0} ms late at most, the simulation {:.0} ms behind at most, {:.0} ms stolen by the hypervisor",
                self.machine_stall_max_ms, self.simulator_late_max_ms, self.machine_stolen_ms
            ),
        ];
        for line in lines {
            // Writing into a string cannot fail.
            let _infallible = writeln!(out, "{line}");
        }
        if let Some(most) = self.memory.iter().max_by_key(|one| one.growth_kib) {
            let _infallible = writeln!(
                out,
                "  memory after half a minute: {} more KiB in {} at most",
                most.growth_kib, most.process
            );
        }
        for fault in &self.faults {
            let _infallible = writeln!(out, "  {}", fault.line());
        }
        out
    }
}

fn or_nothing(names: &[&str]) -> String {
    match names {
        [] => "nothing".to_owned(),
        names => names.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::{FaultRecord, FlightLog, Outcome};
    use crate::drill::Fault;
    use jink_shared_types::coded::{Coded, Flag};
    use jink_shared_types::frames::Point;
    use jink_shared_types::link::LinkStatus;
    use jink_shared_types::truth::SimTruth;
    use jink_shared_types::vehicle::NavMode;

    fn truth(time_s: f64, north_m: f64) -> SimTruth {
        SimTruth {
            position: Point::new(north_m, 0.0, -2.5),
            mode: Coded::new(NavMode::Mission),
            armed: Flag::YES,
            time_s,
            min_clearance_m: 0.7,
            cruise_s: 10.0,
            cruise_m: 28.0,
            setpoint_gap_max_s: 0.061,
            ..SimTruth::default()
        }
    }

    #[test]
    fn mission_time_runs_from_the_first_armed_mission_sample() {
        let mut log = FlightLog::default();
        log.see_truth(&SimTruth {
            armed: Flag::NO,
            ..truth(3.0, 0.0)
        });
        assert_eq!(log.mission_time_s(), None);
        log.see_truth(&truth(5.0, 0.0));
        log.see_truth(&truth(13.5, 4.0));
        assert_eq!(log.mission_time_s(), Some(8.5));
    }

    #[test]
    fn the_course_keeps_shape_not_samples() {
        let mut log = FlightLog::default();
        for step in 0..1000 {
            log.see_truth(&truth(f64::from(step) * 0.02, f64::from(step) * 0.01));
        }
        assert!((90..=110).contains(&log.course().len()), "{}", log.course().len());
    }

    #[test]
    fn latencies_of_all_starts_of_the_gateway_are_added() {
        let mut log = FlightLog::default();
        log.see_truth(&truth(1.0, 0.0));
        let mut first = LinkStatus::default();
        for _ in 0..100 {
            first.capture_to_wire.record_us(8_000);
        }
        log.see_link(1, &LinkStatus::default());
        log.see_link(1, &first);
        let mut second = LinkStatus::default();
        second.capture_to_wire.record_us(30_000);
        log.see_link(2, &second);
        let summary = log.summary(&Outcome::Goal, "forest", 7, 1, Vec::new());
        assert_eq!(summary.latency_max_ms, Some(30.0));
        assert!(
            summary.latency_p50_ms.is_some_and(|ms| (8.0..=9.0).contains(&ms)),
            "{:?}",
            summary.latency_p50_ms
        );
    }

    #[test]
    fn the_summary_has_the_figures_scripts_rely_on() {
        let mut log = FlightLog::default();
        log.see_truth(&truth(2.0, 0.0));
        log.see_truth(&truth(30.0, 40.0));
        let kill = FaultRecord {
            fault: Fault::Kill,
            process: "planner".to_owned(),
            at_s: 8.0,
            phase: "mission".to_owned(),
            survived: true,
            detection_ms: None,
            recovery_ms: Some(57.0),
            gap_ms: 52.0,
            collisions: 0,
            holds: 0,
            north_m: 10.0,
            east_m: 0.0,
            seams: Vec::new(),
            reason: None,
        };
        let mut link = LinkStatus::default();
        log.see_link(1, &link);
        link.capture_to_wire.record_us(9_000);
        log.see_link(1, &link);
        let summary = log.summary(&Outcome::Goal, "forest", 7, 1, vec![kill]);
        let json = serde_json::to_value(&summary).unwrap();
        assert_eq!(json["outcome"], "goal");
        assert_eq!(json["min_clearance_m"], 0.7);
        assert_eq!(json["mean_speed_mps"], 2.8);
        assert_eq!(json["setpoint_max_gap_ms"], 61.0);
        assert_eq!(json["flight_time_s"], 28.0);
        assert_eq!(json["faults"][0]["recovery_ms"], 57.0);
        for key in [
            "collisions",
            "latency_p50_ms",
            "latency_p99_ms",
            "latency_max_ms",
            "restarts",
            "fcu_hold_count",
        ] {
            assert!(json[key].is_number(), "{key}");
        }
        assert!(
            summary
                .text()
                .contains("kill of planner at 8.0 s: back after 57 ms, largest gap 52 ms")
        );
    }

    #[test]
    fn a_flight_that_never_began_has_a_reason_and_no_figures() {
        let reason = "no simulator".to_owned();
        let summary = FlightLog::default().summary(&Outcome::Failed { reason }, "gap", 1, 0, Vec::new());
        assert_eq!(summary.min_clearance_m, None);
        assert_eq!(summary.latency_max_ms, None);
        let text = "failed (world gap, seed 1): no simulator\n  the mission never began\n";
        assert_eq!(summary.text(), text, "no figures of nothing");
    }
}
