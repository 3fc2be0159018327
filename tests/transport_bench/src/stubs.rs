//! Services that compute nothing, on jink's runtime and topics: what they are woken by, what they publish and who may is as in flight.

use crate::samples::Sample;
use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, Wake, now};
use jink_shared_types::layout::bytes_of;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{ApprovedTrajectory, Route, Trajectory};
use jink_shared_types::ranges::PointCloud;
use jink_shared_types::topics::{self, Topic};
use jink_shared_types::{SampleHeader, Stage};
use jink_transport_chain::{Account, Chain, Fault, PLACES, message, stage};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// Says which of the services a process is to be; its command line is that of every service.
const PLACE: &str = "JINK_TRANSPORT_BENCH_PLACE";
/// The topic of the only sensor.
const SENSOR: &str = "lidar";

/// The arguments behind `--`.
struct Arguments {
    folder: PathBuf,
    points: u32,
    rate_hz: u32,
}

impl Arguments {
    fn of(ports: &Ports) -> Result<Self, StartError> {
        let needs = |cause: String| StartError::Needs {
            what: "FOLDER POINTS HZ".to_owned(),
            cause,
        };
        let [folder, points, rate_hz] = ports.setup().arguments.as_slice() else {
            return Err(needs(format!("the arguments are {:?}", ports.setup().arguments)));
        };
        let number = |text: &String| text.parse().map_err(|error| needs(format!("{text}: {error}")));
        Ok(Self {
            folder: folder.into(),
            points: number(points)?,
            rate_hz: number(rate_hz)?,
        })
    }
}

/// What a process has counted; written when it ends.
struct Counted {
    account: Account,
    arguments: Arguments,
    place: usize,
}

impl Drop for Counted {
    fn drop(&mut self) {
        if let Err(fault) = self.account.write(&self.arguments.folder, self.place) {
            tracing::error!("{fault}");
        }
    }
}

/// The sensor: publishes a cloud at each beat.
struct Sensor {
    output: Output<PointCloud>,
    counted: Counted,
}

impl Service for Sensor {
    const PROGRAM: &'static str = "simulator";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            output: ports.output_of(topics::RANGE_CLOUD, SENSOR)?,
            counted: Counted {
                account: Account::default(),
                arguments: Arguments::of(ports)?,
                place: Stage::Sensor as usize,
            },
        })
    }

    fn cycle(&mut self, _cycle: &mut Cycle<'_>) -> Wake {
        let Self {
            output,
            counted: Counted {
                account, arguments, ..
            },
        } = self;
        let mark = now();
        account.sends(mark.ns);
        let mut header = SampleHeader::at(mark);
        header.stages[Stage::Sensor as usize].begin = mark;
        output.write(header, |cloud| cloud.fill(mark.ns, arguments.points));
        Wake::at(now().next_beat(arguments.rate_hz))
    }
}

/// A hop into and a hop out of a service.
trait Between {
    const PROGRAM: &'static str;
    const STAGE: Stage;
    const FROM: Topic<Self::From>;
    const TO: Topic<Self::To>;
    type From: Sample;
    type To: Sample;
}

/// A service that reads a sample and publishes another one.
struct Relay<B: Between> {
    input: Input<B::From>,
    output: Output<B::To>,
    counted: Counted,
    between: PhantomData<B>,
}

/// Reads all of a sample that its producer has written; its mark is when the measurement was taken.
fn read<T: Sample>(sample: &T, header: &SampleHeader, points: u32) -> u64 {
    std::hint::black_box(message::mark_of(&bytes_of(sample)[..T::used(points)]));
    header.capture.ns
}

impl<B: Between> Service for Relay<B> {
    const PROGRAM: &'static str = B::PROGRAM;

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let member = if B::FROM.row.is_family() { SENSOR } else { "" };
        Ok(Self {
            input: ports.trigger_of(B::FROM, member)?,
            output: ports.output(B::TO)?,
            counted: Counted {
                account: Account::default(),
                arguments: Arguments::of(ports)?,
                place: B::STAGE as usize,
            },
            between: PhantomData,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let Self {
            input,
            output,
            counted: Counted {
                account, arguments, ..
            },
            ..
        } = self;
        let before = input.newest().map(|newest| newest.header.sequence);
        if let Some(newest) = input.latest(cycle.now).fresh()
            && Some(newest.header.sequence) != before
        {
            let mark = read(newest.sample, newest.header, arguments.points);
            account.got(Some(mark), false);
            let header = newest.header.derived(B::STAGE, cycle.now);
            output.write(header, |sample| sample.fill(mark, arguments.points));
        }
        Wake::on_data()
    }
}

struct Fusion;
impl Between for Fusion {
    const PROGRAM: &'static str = "obstacle_fusion";
    const STAGE: Stage = Stage::Fusion;
    const FROM: Topic<PointCloud> = topics::RANGE_CLOUD;
    const TO: Topic<LocalMap> = topics::LOCAL_MAP;
    type From = PointCloud;
    type To = LocalMap;
}

struct Planner;
impl Between for Planner {
    const PROGRAM: &'static str = "planner";
    const STAGE: Stage = Stage::Planner;
    const FROM: Topic<LocalMap> = topics::LOCAL_MAP;
    const TO: Topic<Route> = topics::ROUTE;
    type From = LocalMap;
    type To = Route;
}

struct Generator;
impl Between for Generator {
    const PROGRAM: &'static str = "bezier_generator";
    const STAGE: Stage = Stage::Generator;
    const FROM: Topic<Route> = topics::ROUTE;
    const TO: Topic<Trajectory> = topics::TRAJECTORY;
    type From = Route;
    type To = Trajectory;
}

struct Guard;
impl Between for Guard {
    const PROGRAM: &'static str = "collision_guard";
    const STAGE: Stage = Stage::Guard;
    const FROM: Topic<Trajectory> = topics::TRAJECTORY;
    const TO: Topic<ApprovedTrajectory> = topics::APPROVED;
    type From = Trajectory;
    type To = ApprovedTrajectory;
}

/// The gateway: notes when it has read what it would send.
struct Gateway {
    input: Input<ApprovedTrajectory>,
    counted: Counted,
}

impl Service for Gateway {
    const PROGRAM: &'static str = "mavlink_gateway";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            input: ports.trigger(topics::APPROVED)?,
            counted: Counted {
                account: Account::default(),
                arguments: Arguments::of(ports)?,
                place: Stage::Gateway as usize,
            },
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let Self {
            input,
            counted: Counted {
                account, arguments, ..
            },
        } = self;
        let before = input.newest().map(|newest| newest.header.sequence);
        if let Some(newest) = input.latest(cycle.now).fresh()
            && Some(newest.header.sequence) != before
        {
            let mark = read(newest.sample, newest.header, arguments.points);
            account.got(Some(mark), true);
            if account.arrived.len() == 1
                && let Err(fault) = stage::announce_first(&arguments.folder)
            {
                tracing::error!("{fault}");
            }
        }
        Wake::on_data()
    }
}

/// If this process was started to be one of the services: becomes it.
pub fn as_service() -> Option<ExitCode> {
    let place = std::env::var(PLACE).ok()?;
    if let Err(fault) = stage::prepare(None) {
        eprintln!("{fault}");
        return Some(ExitCode::FAILURE);
    }
    Some(match place.as_str() {
        "sensor" => jink_runtime::run::<Sensor>(),
        "fusion" => jink_runtime::run::<Relay<Fusion>>(),
        "planner" => jink_runtime::run::<Relay<Planner>>(),
        "generator" => jink_runtime::run::<Relay<Generator>>(),
        "guard" => jink_runtime::run::<Relay<Guard>>(),
        _ => jink_runtime::run::<Gateway>(),
    })
}

/// Which jink the services belong to, and how they are started.
#[derive(Clone, Debug)]
pub struct Stubs {
    /// Their instance.
    pub instance: String,
    /// Folder with jink.toml.
    pub config: PathBuf,
    /// Points of a cloud.
    pub points: u32,
    /// SCHED_FIFO priority; 0 = ordinary scheduling.
    pub priority: u8,
}

impl Stubs {
    /// The program that the services are: this one.
    ///
    /// # Errors
    /// It cannot be found.
    pub fn program() -> Result<PathBuf, Fault> {
        Ok(std::env::current_exe()?)
    }

    /// The command that starts the service at `place` of `chain`.
    pub fn command(&self, program: &Path, chain: &Chain, place: usize) -> Command {
        let mut command = Command::new(program);
        command
            .env(PLACE, PLACES[place])
            .args([
                "--process",
                PLACES[place],
                "--instance",
                &self.instance,
                "--log",
                "warn",
            ])
            .args(["--priority", &self.priority.to_string(), "--config"])
            .arg(&self.config);
        if let Some(core) = chain.core_of(place) {
            command.args(["--core", &core.to_string()]);
        }
        command
            .arg("--")
            .arg(&chain.folder)
            .args([self.points.to_string(), chain.rate_hz.to_string()]);
        command
    }
}
