//! The rig of every simulated flight: a whole system is started in an instance of its own, waited for, flown through a mission with
//! faults on the way, and taken down.
//!
//! | in | out |
//! |---|---|
//! | [`Plan`], drills | [`Flown`]: outcome, figures, course |

mod drills;
mod flight;
pub mod instance;
pub mod live_page;
mod machine;
mod memory;
mod pilot;
pub mod show;

pub use flight::Flown;

use crate::drill::Drill;
use crate::flight_log::Summary;
use crate::picture::{Scene, World, svg};
use drills::Drills;
use flight::Flight;
use jink_control::supervisor::{StartOptions, Supervisor};
use jink_control::{Interrupt, Problem, autopilot, ports, worlds};
use jink_runtime::{Instance, Session};
use jink_shared_types::health::SystemStatus;
use live_page::{LivePage, ShownPage};
use machine::Machine;
use pilot::Pilot;
use show::Show;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::time::Duration;

/// What to fly.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Folder of the programs.
    pub programs: PathBuf,
    /// Configuration folder.
    pub config: PathBuf,
    /// Kind of world, or its file.
    pub world: String,
    /// Its seed.
    pub seed: u64,
    /// Trees per square metre; `None` = the world's own.
    pub density: Option<f64>,
    /// Set of sensors instead of the configuration's.
    pub sensors: Option<String>,
    /// Highest speed (m/s); `None` = the configuration's.
    pub speed: Option<f64>,
    /// So often the way is flown: there, back, there.
    pub legs: u32,
    /// Longest flight (s).
    pub limit_s: f64,
    /// `section.key=value`, over everything else.
    pub overrides: Vec<String>,
    /// Whose autopilot.
    pub autopilot: autopilot::Args,
    /// What becomes of the address of the live page.
    pub live_page: ShownPage,
}

/// Longest time for one leg unless set otherwise (s).
const LEG_LIMIT_S: f64 = 180.0;
/// What a real autopilot takes besides until it has found its position and lets itself be armed (s).
const SITL_BOOT_S: f64 = 90.0;

/// Longest flight of so many legs unless set otherwise (s).
pub fn usual_limit_s(legs: u32, is_sitl: bool) -> f64 {
    LEG_LIMIT_S * f64::from(legs) + if is_sitl { SITL_BOOT_S } else { 0.0 }
}

/// Somebody who looks at a flight, for figures of his own.
pub trait Observer {
    /// Every service is active: topics can be opened.
    ///
    /// # Errors
    /// One cannot.
    fn begin(&mut self, session: &Session) -> Result<(), Problem>;

    /// Fifty times a second during the mission; whether enough was seen, which ends the flight.
    fn look(&mut self, status: Option<&SystemStatus>) -> bool;

    /// Lets go of the topics: the system is going to be taken down.
    fn end(&mut self);
}

/// Nobody.
struct NoObserver;

impl Observer for NoObserver {
    fn begin(&mut self, _session: &Session) -> Result<(), Problem> {
        Ok(())
    }

    fn look(&mut self, _status: Option<&SystemStatus>) -> bool {
        false
    }

    fn end(&mut self) {}
}

impl Plan {
    /// One flight with `drills`, in `instance`, from start to stop; its figures, and how the stop went.
    ///
    /// # Errors
    /// The system could not be started, or watched.
    pub fn fly(
        &self,
        instance: &Instance,
        drills: Vec<Drill>,
        show: &mut Show,
        interrupt: &Interrupt,
    ) -> Result<(Flown, Result<ExitStatus, Problem>), Problem> {
        self.fly_observed(instance, drills, show, interrupt, &mut NoObserver)
    }

    /// The same, looked at by `observer`.
    ///
    /// # Errors
    /// The same, and what the observer says.
    pub fn fly_observed(
        &self,
        instance: &Instance,
        drills: Vec<Drill>,
        show: &mut Show,
        interrupt: &Interrupt,
        observer: &mut dyn Observer,
    ) -> Result<(Flown, Result<ExitStatus, Problem>), Problem> {
        let [gateway, ground_station] = ports::free()?;
        let options = self.options(gateway, ground_station, show)?;
        let mut supervisor = Supervisor::start(instance, &options)?;
        let drills = Drills::new(drills, instance.clone(), gateway);
        let flown = self.fly_with(
            &mut supervisor,
            ground_station,
            drills,
            show,
            interrupt,
            &mut *observer,
        );
        observer.end();
        show.finish();
        // Whatever happened, the system is taken down before anything is said about it.
        let stopped = supervisor.stop();
        Ok((flown?, stopped))
    }

    fn options(&self, gateway: u16, ground_station: u16, show: &mut Show) -> Result<StartOptions, Problem> {
        let build = self.autopilot.describe(&self.programs)?;
        let mut overrides = vec![
            format!("link.address=udpin:127.0.0.1:{gateway}"),
            format!("simulation.ground_station_port={ground_station}"),
        ];
        overrides.extend(worlds::overrides(
            Some(&self.world),
            Some(self.seed),
            self.density,
        ));
        overrides.extend(self.autopilot.overrides(build.as_ref(), false, &self.overrides)?);
        if let Some(build) = &build {
            show.update(&build.text());
        }
        overrides.extend(self.speed.map(|speed| format!("params.OA_SPD_MAX={speed}")));
        overrides.extend(self.overrides.iter().cloned());
        Ok(StartOptions {
            programs: self.programs.clone(),
            config: self.config.clone(),
            profile: None,
            sensors: self.sensors.clone(),
            overrides,
            mode: "simulated_vehicle",
            // A flight that ended badly is looked into; after a good one the folder is removed.
            keep_logs: true,
        })
    }

    /// Everything between the start and the stop of the system. The readers of shared memory end with it.
    fn fly_with(
        &self,
        supervisor: &mut Supervisor,
        ground_station: u16,
        drills: Drills,
        show: &mut Show,
        interrupt: &Interrupt,
        observer: &mut dyn Observer,
    ) -> Result<Flown, Problem> {
        let watch = supervisor.watch(interrupt)?;
        show.update(&sensors(supervisor.instance()));
        let mut flight = Flight::new(watch, self.autopilot.is_sitl(), drills)?
            .with_page(LivePage::of(supervisor.instance(), self.live_page));
        let machine = Machine::watch();
        let outcome = match flight.wait_until_ready(supervisor, show, interrupt)? {
            Some(outcome) => outcome,
            None => {
                observer.begin(flight.session())?;
                let mut pilot = Pilot::start(self, ground_station)?;
                let limit_s = self.limit_s;
                let limit = Duration::try_from_secs_f64(limit_s)
                    .map_err(|error| Problem::Other(format!("--timeout {limit_s}: {error}")))?;
                flight.fly(supervisor, &mut pilot, show, interrupt, limit, observer)?
            }
        };
        Ok(flight.end(outcome, &self.world, self.seed, machine.times()))
    }

    /// The world as far as it can be drawn.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn world(&self) -> Result<World, Problem> {
        let mut command = worlds::describe(&self.programs, &self.world, self.seed, self.density)?;
        let answer = command
            .arg("--json")
            .output()
            .map_err(Problem::io("jink-simulator"))?;
        if !answer.status.success() {
            let words = String::from_utf8_lossy(&answer.stderr);
            return Err(Problem::Other(format!(
                "the world cannot be made: {}",
                words.trim().trim_start_matches("jink: ")
            )));
        }
        serde_json::from_slice(&answer.stdout).map_err(|error| {
            Problem::Other(format!("the description of the world is not understood: {error}"))
        })
    }
}

impl Flown {
    /// Draws the flight through `world`.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn draw(&self, world: &World, file: &Path) -> Result<(), Problem> {
        let picture = svg(&Scene {
            world,
            course: &self.log.course(),
            faults: &self.summary.faults,
            title: &title(&self.summary),
        });
        std::fs::write(file, picture).map_err(Problem::io(file.display().to_string()))
    }

    /// Keeps figures and picture in `folder`.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn keep(&self, world: &World, folder: &Path) -> Result<(), Problem> {
        let json = serde_json::to_string(&self.summary).map_err(|error| Problem::Other(error.to_string()))?;
        let file = folder.join("summary.json");
        std::fs::write(&file, json).map_err(Problem::io(file.display().to_string()))?;
        self.draw(world, &folder.join("flight.svg"))
    }
}

fn title(summary: &Summary) -> String {
    format!(
        "jink: {} {}, {}, {:.2} m/s mean, clearance {}",
        summary.world,
        summary.seed,
        summary.outcome,
        summary.mean_speed_mps,
        summary
            .min_clearance_m
            .map_or("-".to_owned(), |m| format!("{m:.2} m"))
    )
}

/// What the vehicle sees with, in one line: names, with the models of those that are products.
fn sensors(instance: &Instance) -> String {
    #[derive(serde::Deserialize)]
    struct Table {
        name: String,
        model: Option<String>,
    }
    let tables: Vec<Table> = jink_runtime::config::sensors(&instance.run_config()).unwrap_or_default();
    let named = tables.into_iter().map(|table| match table.model {
        Some(model) => format!("{} ({model})", table.name),
        None => table.name,
    });
    format!("sensors: {}", named.collect::<Vec<_>>().join(", "))
}
