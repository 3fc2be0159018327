//! The flight from the outside: look at shared memory fifty times a second until it is over.

use super::Observer;
use super::drills::{Drills, View};
use super::live_page::LivePage;
use super::machine::MachineTimes;
use super::memory::Memory;
use super::pilot::Pilot;
use super::show::Show;
use crate::flight_log::{FlightLog, Outcome, Summary};
use jink_control::figures::round;
use jink_control::known_space::KnownSpace;
use jink_control::narrate::{Narrator, health_line};
use jink_control::supervisor::Supervisor;
use jink_control::watch::{SpaceWatch, Watch};
use jink_control::{Interrupt, Problem};
use jink_runtime::{Input, Session};
use jink_shared_types::health::{Health, SystemStatus};
use jink_shared_types::topics;
use jink_shared_types::truth::SimTruth;
use std::time::{Duration, Instant};

/// Period of the ground truth: each sample is seen.
const LOOK: Duration = Duration::from_millis(20);
/// Longest time until every service is active (s). It takes two; a kernel was seen to leave a runnable thread of its own, on
/// which sockets or descriptors waited, for a minute.
const READY_PATIENCE: Duration = Duration::from_secs(120);
/// The same with a real autopilot, which has to find its position first (s).
const SITL_READY_PATIENCE: Duration = Duration::from_secs(150);
/// The process of vehicle and autopilot.
const SIMULATOR: &str = "simulator";
/// Longest wait for the landing once the last mission item has been reached.
const LANDING_PATIENCE: Duration = Duration::from_secs(30);
/// What the planner says of the sensors for so long, it stays with.
const UNFIT_FOR: Duration = Duration::from_secs(1);

/// A flight under way.
pub struct Flight {
    truth: Input<SimTruth>,
    log: FlightLog,
    drills: Drills,
    narrator: Narrator,
    status: Option<SystemStatus>,
    done_since: Option<Instant>,
    memory: Memory,
    /// Open once everything works: before, its topics may not be there yet, and whoever opens one first gives it its room.
    space: Option<SpaceWatch>,
    /// What it flies through, as it was said last.
    known: KnownSpace,
    /// Since when the planner says that it cannot plan with these sensors.
    unfit_since: Option<Instant>,
    /// A real autopilot flies: if it ends, the flight has.
    is_sitl: bool,
    page: Option<LivePage>,
    // Last: the ports above belong to its connection.
    watch: Watch,
}

/// A flight that is over.
pub struct Flown {
    /// How it ended.
    pub outcome: Outcome,
    /// Its figures.
    pub summary: Summary,
    /// Its course.
    pub log: FlightLog,
}

impl Flight {
    /// A flight that has not begun; `is_sitl`: of a real autopilot.
    pub fn new(watch: Watch, is_sitl: bool, drills: Drills) -> Result<Self, Problem> {
        let session = watch.session();
        Ok(Self {
            truth: session.input(topics::SIM_TRUTH, "")?,
            log: FlightLog::default(),
            drills,
            narrator: Narrator::default(),
            status: None,
            done_since: None,
            memory: Memory::default(),
            space: None,
            known: KnownSpace::default(),
            unfit_since: None,
            is_sitl,
            page: None,
            watch,
        })
    }

    /// The same with a live page that is shown as soon as it is served.
    pub fn with_page(mut self, page: Option<LivePage>) -> Self {
        self.page = page;
        self
    }

    /// The connection to the system, for further topics.
    pub fn session(&self) -> &Session {
        self.watch.session()
    }

    /// Waits until every service is active; an outcome if that does not happen.
    pub fn wait_until_ready(
        &mut self,
        supervisor: &mut Supervisor,
        show: &mut Show,
        interrupt: &Interrupt,
    ) -> Result<Option<Outcome>, Problem> {
        let begin = Instant::now();
        loop {
            self.look(show);
            if let Some(outcome) = self.trouble(supervisor, interrupt)? {
                return Ok(Some(outcome));
            }
            if let Some(status) = &self.status
                && status.health == Health::Healthy
            {
                return Ok(None);
            }
            let patience = if self.is_sitl {
                SITL_READY_PATIENCE
            } else {
                READY_PATIENCE
            };
            if begin.elapsed() > patience {
                let state = self.status.as_ref().map_or("no status".to_owned(), health_line);
                let reason = format!(
                    "not every service was active within {} s; {state}",
                    patience.as_secs()
                );
                return Ok(Some(Outcome::Failed { reason }));
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Follows the flight until it is over.
    pub fn fly(
        &mut self,
        supervisor: &mut Supervisor,
        pilot: &mut Pilot,
        show: &mut Show,
        interrupt: &Interrupt,
        limit: Duration,
        observer: &mut dyn Observer,
    ) -> Result<Outcome, Problem> {
        let begin = Instant::now();
        loop {
            self.look(show);
            if observer.look(self.status.as_ref()) {
                return Ok(Outcome::Enough);
            }
            for line in pilot.update() {
                show.update(&line);
            }
            self.drill(show);
            if let Some(outcome) = self.trouble(supervisor, interrupt)? {
                return Ok(outcome);
            }
            if let Some(outcome) = self.finish(pilot)? {
                return Ok(outcome);
            }
            if begin.elapsed() > limit {
                return Ok(Outcome::Timeout);
            }
            show.progress(|| self.progress());
            std::thread::sleep(LOOK);
        }
    }

    /// The figures of the flight that ended as `outcome`.
    pub fn end(self, outcome: Outcome, world: &str, seed: u64, machine: MachineTimes) -> Flown {
        let restarts = self.status.map_or(0, |status| status.restarts);
        let faults = self.drills.into_records();
        let mut summary = self.log.summary(&outcome, world, seed, restarts, faults);
        summary.machine_stall_max_ms = round(machine.stall_max_ms);
        summary.machine_stolen_ms = round(machine.stolen_ms);
        summary.memory = self.memory.uses();
        summary.declarations = self.known.declarations;
        Flown {
            summary,
            outcome,
            log: self.log,
        }
    }

    fn look(&mut self, show: &mut Show) {
        self.page = self.page.take().and_then(|page| page.look(show));
        let log = &mut self.log;
        self.truth.each(|truth| log.see_truth(truth.sample));
        if let Some(link) = self.watch.link() {
            log.see_link(link.header.generation, link.sample);
        }
        if let Some(status) = self.watch.status() {
            for line in self.narrator.update(&status) {
                show.update(&line);
            }
            self.memory.look(&status);
            self.status = Some(status);
        }
        let is_up = self.status.is_some_and(|status| status.health == Health::Healthy);
        if self.space.is_none() && is_up {
            self.space = SpaceWatch::open(self.watch.session()).ok();
        }
        if let Some(known) = self.space.as_mut().and_then(SpaceWatch::look) {
            let unfit = known.cannot_plan.is_some();
            self.unfit_since = unfit.then(|| self.unfit_since.unwrap_or_else(Instant::now));
            if known.declarations != self.known.declarations {
                show.update(&known.declared());
            }
            self.known = known;
        }
    }

    fn drill(&mut self, show: &mut Show) {
        let gap_s = self.log.take_gap_s();
        if let (Some(truth), Some(status)) = (self.log.truth(), &self.status) {
            let view = View {
                mission_time_s: self.log.mission_time_s(),
                armed_time_s: self.log.armed_time_s(),
                truth,
                status,
                gap_s,
            };
            for line in self.drills.step(&view) {
                show.update(&line);
            }
        }
    }

    /// What ends any flight: the user, the system, an obstacle.
    fn trouble(
        &self,
        supervisor: &mut Supervisor,
        interrupt: &Interrupt,
    ) -> Result<Option<Outcome>, Problem> {
        if interrupt.has_come() {
            let reason = "interrupted".to_owned();
            return Ok(Some(Outcome::Failed { reason }));
        }
        if supervisor.ended()?.is_some() {
            let reason = supervisor.reason();
            return Ok(Some(Outcome::Failed { reason }));
        }
        if self.log.has_collided() {
            return Ok(Some(Outcome::Collision));
        }
        if self.is_sitl && self.has_simulator_restarted() {
            let reason = supervisor
                .last_error_of(SIMULATOR)
                .unwrap_or_else(|| "the autopilot's simulation ended".to_owned());
            return Ok(Some(Outcome::Failed { reason }));
        }
        let has_moved = self.log.truth().is_some_and(|truth| truth.cruise_s > 0.0);
        let is_unfit = self.unfit_since.is_some_and(|since| since.elapsed() > UNFIT_FOR);
        if let (true, false, Some(reason)) = (is_unfit, has_moved, self.known.refusal()) {
            return Ok(Some(Outcome::Refused { reason }));
        }
        let failed = self
            .status
            .as_ref()
            .is_some_and(|status| status.health == Health::Failed);
        let reason = "an essential process was given up".to_owned();
        Ok(failed.then_some(Outcome::Failed { reason }))
    }

    fn has_simulator_restarted(&self) -> bool {
        let processes = self.status.iter().flat_map(|status| status.processes());
        processes
            .filter(|process| process.heartbeat.name.as_str() == SIMULATOR)
            .any(|process| process.restarts > 0)
    }

    /// The end of a good flight: the last item reached, and landed if the mission says so. Or a ground station that
    /// gave up.
    fn finish(&mut self, pilot: &mut Pilot) -> Result<Option<Outcome>, Problem> {
        let pilot_ended = pilot.ended()?;
        if self.log.is_done() {
            let since = *self.done_since.get_or_insert_with(Instant::now);
            let landed = self.log.truth().is_some_and(|truth| truth.landed.is_set());
            let over = landed || pilot_ended.is_some() || since.elapsed() > LANDING_PATIENCE;
            return Ok(over.then_some(Outcome::Goal));
        }
        let Some(status) = pilot_ended else {
            return Ok(None);
        };
        if status.success() {
            // It has seen the last item reached and landed there before the autopilot was given the end of its mission.
            return Ok(Some(Outcome::Goal));
        }
        pilot.update();
        let reason = format!(
            "the ground station ended before the goal ({status}): {}",
            pilot.last_words()
        );
        Ok(Some(Outcome::Failed { reason }))
    }

    fn progress(&self) -> String {
        let health = self
            .status
            .map_or("no status".to_owned(), |status| status.health.get().to_string());
        self.log
            .progress(&health, self.status.map_or(0, |status| status.restarts))
    }
}
