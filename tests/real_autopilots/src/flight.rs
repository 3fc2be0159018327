//! One flight: autopilot, relay, jink and station are started, the script is played, the expectation is waited for.

use crate::autopilot::{Build, Ports, Running, Start};
use crate::jink::{self, Jink};
use crate::judge::{self, Aim, Verdict};
use crate::mission::{Anchor, Item, Place};
use crate::record::{Record, Shared};
use crate::relay::Relay;
use crate::scenarios::Scenario;
use crate::setup::{Autopilot, Setup};
use crate::station::Station;
use crate::wire::Wire;
use jink_emulated_ground_station::Make;
use jink_shared_types::coded::Wire as _;
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::world::{World, WorldSpec};
use mavlink::dialect::{MavCmd, MavResult};
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// OA_VEH_RADIUS: nearer than this, the vehicle has hit something (m).
pub const VEHICLE_RADIUS_M: f64 = 0.30;
/// Height of missions and go-tos (m).
pub const HEIGHT_M: f64 = 2.5;
/// How often the record is looked at.
const LOOK: Duration = Duration::from_millis(20);
/// Longest time until an autopilot knows where it is (s).
const POSITION_LIMIT_S: f64 = 90.0;
/// Longest time until the motors run (s): checks of the autopilot, and jink's readiness.
const ARM_LIMIT_S: f64 = 60.0;

/// Why a script cannot go on.
#[derive(Clone, Debug)]
pub enum Trouble {
    /// Something could not be started.
    Start(String),
    /// The vehicle hit something.
    Collision,
    /// Something was waited for and never came.
    Never {
        /// What.
        what: String,
        /// For how long (s).
        limit_s: f64,
    },
    /// A request was not granted.
    Refused {
        /// Which.
        what: String,
        /// The answer.
        answer: String,
    },
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Start(text) => write!(f, "{text}"),
            Self::Collision => write!(f, "collision"),
            Self::Never { what, limit_s } => write!(f, "no {what} in {limit_s:.0} s"),
            Self::Refused { what, answer } => write!(f, "{what} refused: {answer}"),
        }
    }
}

/// What a flight needs from outside.
#[derive(Clone, Debug)]
pub struct Means {
    /// Folder of jink's programs.
    pub programs: PathBuf,
    /// Its configuration folder.
    pub config: PathBuf,
    /// Folder for the flight's files.
    pub folder: PathBuf,
    /// Distinguishes flights side by side.
    pub instance: u16,
    /// Keep what the processes wrote.
    pub keeps_logs: bool,
}

/// A flight under way: what scripts act on.
pub struct Flight {
    /// Which autopilot and profile.
    pub setup: Setup,
    /// Everything seen.
    pub record: Shared,
    /// The station.
    pub station: Station,
    /// The line between autopilot and jink.
    pub relay: Relay,
    /// The jink.
    pub jink: Jink,
    /// The world.
    pub world: Arc<World>,
    /// The autopilot's process.
    pub autopilot: Running,
    /// What the script wants judged.
    pub aim: Aim,
    anchor: Option<Anchor>,
    /// Restarts counted before jink was taken down by a script.
    restarts: u64,
}

/// Flies `scenario` on `setup` and judges it.
pub fn fly(scenario: &Scenario, setup: Setup, build: &Build, means: &Means) -> (Verdict, Option<Shared>) {
    let begin = Instant::now();
    let mut flight = match Flight::start(scenario, setup, build, means) {
        Ok(flight) => flight,
        Err(trouble) => return (Verdict::not_flown(scenario, setup, &trouble.to_string()), None),
    };
    let outcome = flight.ready().and_then(|()| (scenario.script)(&mut flight));
    let outcome = outcome.and_then(|()| flight.await_expectation(scenario));
    let restarts = flight.restarts.max(flight.jink.restarts());
    let record = flight.record.clone();
    let mut verdict = judge::verdict(scenario, setup, &record.lock(), &flight.aim, &outcome);
    verdict.restarts = restarts;
    verdict.wall_s = begin.elapsed().as_secs_f64();
    if means.keeps_logs {
        keep(&flight, means);
    }
    (verdict, Some(record))
}

/// Copies jink's logs beside the autopilot's and writes down what was seen. What cannot be kept is missing there.
fn keep(flight: &Flight, means: &Means) {
    let target = means.folder.join("jink");
    let _exists = std::fs::create_dir_all(&target);
    for entry in std::fs::read_dir(flight.jink.log_folder())
        .into_iter()
        .flatten()
        .flatten()
    {
        let _missing = std::fs::copy(entry.path(), target.join(entry.file_name()));
    }
    let record = flight.record.lock();
    let mut truth = String::from("t_s,north_m,east_m,up_m,speed_mps,clearance_m\n");
    for state in &record.truth {
        truth += &format!(
            "{:.3},{:.3},{:.3},{:.3},{:.3},{:.3}\n",
            state.at_s,
            state.place.x_m,
            state.place.y_m,
            -state.place.z_m,
            state.speed_mps(),
            state.clearance_m
        );
    }
    let _missing = std::fs::write(means.folder.join("truth.csv"), truth);
    let mut events: Vec<(f64, String)> = record
        .modes
        .iter()
        .map(|(at_s, mode)| {
            (
                *at_s,
                format!(
                    "mode {} ({:#x}) armed {}",
                    mode.mode.name(),
                    mode.custom,
                    mode.is_armed
                ),
            )
        })
        .collect();
    events.extend(
        record
            .texts
            .iter()
            .map(|text| (text.at_s, format!("text {} {}", text.severity, text.text))),
    );
    events.extend(
        record
            .current
            .iter()
            .map(|(at_s, item)| (*at_s, format!("item {item}"))),
    );
    events.extend(
        record
            .active
            .iter()
            .map(|(at_s, active)| (*at_s, format!("active {active}"))),
    );
    events.extend(
        record
            .acks
            .iter()
            .map(|(at_s, command, result)| (*at_s, format!("ack {command:?} {result:?}"))),
    );
    let wishes = record.requests.iter();
    events.extend(wishes.map(|wish| {
        (
            wish.at_s,
            format!(
                "{} asks for {:?}",
                if wish.is_jinks { "jink" } else { "station" },
                wish.mode
            ),
        )
    }));
    events.sort_by(|a, b| a.0.total_cmp(&b.0));
    let text: String = events
        .iter()
        .map(|(at_s, event)| format!("{at_s:8.3} {event}\n"))
        .collect();
    let _missing = std::fs::write(means.folder.join("events.txt"), text);
}

impl Flight {
    fn start(scenario: &Scenario, setup: Setup, build: &Build, means: &Means) -> Result<Self, Trouble> {
        let text = |error: &dyn fmt::Display| Trouble::Start(error.to_string());
        let (kind, seed) = scenario.world;
        let spec = WorldSpec {
            kind: kind.parse().map_err(|error| text(&error))?,
            seed,
            density_per_m2: None,
        };
        let world = Arc::new(World::from_spec(&spec).map_err(|error| text(&error))?);
        let record = Shared::default();
        let ports = Ports {
            instance: means.instance,
        };
        let (autopilot, make) = (setup.autopilot(), setup.autopilot().make());
        let relay = Relay::start(ports.companion(autopilot), ports.jink(), make, record.clone())
            .map_err(|error| text(&error))?;
        // PX4's own simulator leaves the station's port to PX4, which answers the first that talks to it.
        let wire = match autopilot {
            Autopilot::ArduCopter | Autopilot::Px4Of2021 => Wire::listen(ports.station()),
            Autopilot::Px4 => Wire::towards(ports.station(), 18570 + ports.instance),
        };
        let wire = wire.map_err(|error| text(&error))?;
        let target = match autopilot {
            Autopilot::ArduCopter => 1,
            _ => (1 + ports.instance) as u8,
        };
        let station = Station::start(wire, make, target, record.clone(), true);
        let start = Start {
            build,
            setup,
            ports,
            folder: means.folder.join("autopilot"),
            parameters: scenario.parameters,
            wind_mps: scenario.wind_mps,
            record: record.clone(),
            world: Arc::clone(&world),
        };
        let autopilot = Running::start(&start).map_err(Trouble::Start)?;
        let overrides = setup
            .overrides()
            .iter()
            .chain(scenario.settings)
            .map(|text| (*text).to_owned())
            .collect();
        let jink = Jink::new(jink::Options {
            programs: means.programs.clone(),
            config: means.config.clone(),
            instance: jink::instance_name(means.instance),
            port: ports.jink(),
            world: kind,
            seed,
            overrides,
        });
        let goal = world.goals().last().copied().unwrap_or_default();
        let goal = Place::new(goal.x_m, goal.y_m, HEIGHT_M);
        Ok(Self {
            setup,
            record,
            station,
            relay,
            jink,
            world,
            autopilot,
            aim: Aim::at(goal),
            anchor: None,
            restarts: 0,
        })
    }

    /// Waits until the autopilot knows where it is, starts jink, and fixes the frame in which everything is judged.
    fn ready(&mut self) -> Result<(), Trouble> {
        self.wait("position of the autopilot", POSITION_LIMIT_S, |record| {
            record.global.is_some() && record.local.is_some()
        })?;
        if self.setup == Setup::Guided {
            // The simulator slows down to real time; jink's clock is that of the world.
            self.station.command(
                MavCmd::MAV_CMD_REQUEST_MESSAGE,
                [148.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            );
        }
        self.jink.up().map_err(Trouble::Start)?;
        self.station.command(
            MavCmd::MAV_CMD_REQUEST_MESSAGE,
            [148.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        );
        self.fix_frame()
    }

    fn fix_frame(&mut self) -> Result<(), Trouble> {
        let mut record = self.record.lock();
        let fixed = record.fix_frame();
        self.anchor = record
            .global
            .zip(record.local)
            .map(|(global, local)| Anchor::new(global, local));
        if fixed {
            return Ok(());
        }
        Err(Trouble::Never {
            what: "truth".to_owned(),
            limit_s: 0.0,
        })
    }

    /// Waits for a condition; a collision ends it at once.
    ///
    /// # Errors
    /// [`Trouble::Never`], [`Trouble::Collision`].
    pub fn wait(
        &self,
        what: &str,
        limit_s: f64,
        mut condition: impl FnMut(&Record) -> bool,
    ) -> Result<(), Trouble> {
        let begin = Instant::now();
        loop {
            {
                let record = self.record.lock();
                if judge::has_collided(&record) {
                    return Err(Trouble::Collision);
                }
                if condition(&record) {
                    return Ok(());
                }
            }
            if begin.elapsed().as_secs_f64() > limit_s {
                return Err(Trouble::Never {
                    what: what.to_owned(),
                    limit_s,
                });
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Lets time pass; only a collision ends it early.
    ///
    /// # Errors
    /// [`Trouble::Collision`].
    pub fn watch(&self, for_s: f64) -> Result<(), Trouble> {
        match self.wait("end", for_s, |_| false) {
            Err(Trouble::Never { .. }) => Ok(()),
            other => other,
        }
    }

    /// Waits until the autopilot reports the mode.
    ///
    /// # Errors
    /// As [`Flight::wait`].
    pub fn wait_mode(&self, mode: NavMode, limit_s: f64) -> Result<(), Trouble> {
        self.wait(&format!("mode {}", mode.name()), limit_s, |record| {
            record.mode().mode == mode
        })
    }

    /// Waits until component 196 says ACTIVE.
    ///
    /// # Errors
    /// As [`Flight::wait`].
    pub fn wait_active(&self) -> Result<(), Trouble> {
        self.wait("ACTIVE of component 196", 30.0, Record::is_active)
    }

    /// Sets a mode, repeated until the autopilot reports it.
    ///
    /// # Errors
    /// [`Trouble::Refused`].
    pub fn mode(&self, mode: NavMode) -> Result<(), Trouble> {
        let answer = self.station.set_mode(mode);
        if answer == Some(MavResult::MAV_RESULT_ACCEPTED) {
            return Ok(());
        }
        Err(Trouble::Refused {
            what: format!("mode {}", mode.name()),
            answer: format!("{answer:?}"),
        })
    }

    /// The anchor between metres and degrees.
    ///
    /// # Errors
    /// If the autopilot has no position yet.
    pub fn anchor(&self) -> Result<Anchor, Trouble> {
        self.anchor
            .ok_or_else(|| Trouble::Start("no position yet".to_owned()))
    }

    /// Uploads a mission.
    ///
    /// # Errors
    /// [`Trouble::Refused`].
    pub fn upload(&self, items: &[Item]) -> Result<(), Trouble> {
        match self.station.upload(&self.anchor()?, items) {
            Some(0) => Ok(()),
            other => Err(Trouble::Refused {
                what: "mission".to_owned(),
                answer: format!("{other:?}"),
            }),
        }
    }

    /// Uploads a mission and lets the autopilot fly it: take-off by its first item, where the autopilot takes an item so low.
    ///
    /// # Errors
    /// As its steps.
    pub fn fly_mission(&mut self, items: &[Item]) -> Result<(), Trouble> {
        self.wait_active()?;
        if self.items_before_waypoints() == 0 && items.first().is_some_and(Item::is_takeoff_at_start) {
            self.take_off()?;
            self.upload(&items[1..])?;
            return self.mode_patiently(NavMode::Mission);
        }
        self.upload(items)?;
        match self.make() {
            Make::ArduCopter => {
                self.arm_in(NavMode::Offboard)?;
                self.start_mission()
            }
            Make::Px4 => {
                self.mode_patiently(NavMode::Mission)?;
                self.arm()
            }
        }?;
        self.aim.mark(&self.record);
        self.wait("take-off", 30.0, |record| height_m(record) > 1.0)
    }

    /// Number of the first waypoint in the autopilot's mission. ArduPilot's item 0 is home; PX4 of 2021 refuses to take off
    /// lower than its acceptance radius and a metre, so that it takes off in its mode for that, without an item.
    pub fn items_before_waypoints(&self) -> u16 {
        match self.setup.autopilot() {
            Autopilot::ArduCopter => 2,
            Autopilot::Px4 => 1,
            Autopilot::Px4Of2021 => 0,
        }
    }

    /// MISSION_START.
    ///
    /// # Errors
    /// [`Trouble::Refused`].
    pub fn start_mission(&self) -> Result<(), Trouble> {
        self.station.expect_mode_change();
        let answer = self.station.command(MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
        if answer == Some(MavResult::MAV_RESULT_ACCEPTED) {
            return Ok(());
        }
        Err(Trouble::Refused {
            what: "MISSION_START".to_owned(),
            answer: format!("{answer:?}"),
        })
    }

    /// Takes off in the autopilot's own way and waits until it hovers.
    ///
    /// # Errors
    /// As its steps.
    pub fn take_off(&mut self) -> Result<(), Trouble> {
        self.wait_active()?;
        match self.make() {
            Make::ArduCopter => {
                self.arm_in(NavMode::Offboard)?;
                self.command_take_off()?;
            }
            Make::Px4 => {
                self.station.set_parameter("MIS_TAKEOFF_ALT", HEIGHT_M);
                self.arm_in(NavMode::Hold)?;
                self.mode(NavMode::Takeoff)?;
            }
        }
        self.aim.mark(&self.record);
        self.wait("hover after take-off", 40.0, |record| {
            height_m(record) > 0.85 * HEIGHT_M && record.rests(1.0, 0.3)
        })
    }

    /// NAV_TAKEOFF of ArduCopter, without waiting for anything.
    ///
    /// # Errors
    /// [`Trouble::Refused`].
    pub fn command_take_off(&self) -> Result<(), Trouble> {
        let answer = self.station.command(
            MavCmd::MAV_CMD_NAV_TAKEOFF,
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, HEIGHT_M as f32],
        );
        if answer == Some(MavResult::MAV_RESULT_ACCEPTED) {
            return Ok(());
        }
        Err(Trouble::Refused {
            what: "NAV_TAKEOFF".to_owned(),
            answer: format!("{answer:?}"),
        })
    }

    /// Arms in `mode`, as often as it takes.
    ///
    /// # Errors
    /// [`Trouble::Never`].
    pub fn arm_in(&self, mode: NavMode) -> Result<(), Trouble> {
        self.mode_patiently(mode)?;
        self.arm()
    }

    fn mode_patiently(&self, mode: NavMode) -> Result<(), Trouble> {
        let begin = Instant::now();
        loop {
            let set = self.mode(mode);
            if set.is_ok() || begin.elapsed().as_secs_f64() > ARM_LIMIT_S {
                return set;
            }
            self.watch(0.5)?;
        }
    }

    fn arm(&self) -> Result<(), Trouble> {
        let begin = Instant::now();
        loop {
            let answer = self.station.arm();
            if answer == Some(MavResult::MAV_RESULT_ACCEPTED) {
                return self.wait("motors", 5.0, |record| record.mode().is_armed);
            }
            if begin.elapsed().as_secs_f64() > ARM_LIMIT_S {
                let said = self.record.lock().texts.last().map(|text| text.text.clone());
                return Err(Trouble::Refused {
                    what: format!("arming for {ARM_LIMIT_S:.0} s"),
                    answer: format!("{answer:?}, {}", said.unwrap_or_default()),
                });
            }
            self.watch(0.5)?;
        }
    }

    /// Waits until it flies at least so fast and so far from the start.
    ///
    /// # Errors
    /// As [`Flight::wait`].
    pub fn wait_cruise(&self, speed_mps: f64, north_m: f64) -> Result<(), Trouble> {
        self.wait(
            &format!("{speed_mps} m/s beyond {north_m} m north"),
            40.0,
            |record| {
                record
                    .last()
                    .is_some_and(|truth| truth.speed_mps() > speed_mps && truth.place.x_m > north_m)
            },
        )
    }

    /// What the script does next is what the expectation is about.
    pub fn mark(&mut self) {
        self.aim.mark(&self.record);
    }

    /// Takes jink down on purpose.
    pub fn jink_down(&mut self) {
        self.restarts += self.jink.restarts();
        self.jink.down();
    }

    /// Whose commands are sent.
    pub fn make(&self) -> Make {
        self.setup.autopilot().make()
    }

    /// Where it is.
    pub fn place(&self) -> Place {
        let record = self.record.lock();
        record.last().map_or(Place::new(0.0, 0.0, 0.0), |truth| {
            Place::new(truth.place.x_m, truth.place.y_m, -truth.place.z_m)
        })
    }

    fn await_expectation(&mut self, scenario: &Scenario) -> Result<(), Trouble> {
        let (expectation, aim) = (scenario.expectation, self.aim.clone());
        let limit_s = expectation.limit_s() + scenario.extra_s;
        self.wait(&expectation.to_string(), limit_s, |record| {
            expectation.is_decided(record, &aim)
        })
    }
}

/// True height above the ground (m).
pub fn height_m(record: &Record) -> f64 {
    record.last().map_or(0.0, |truth| -truth.place.z_m)
}
