//! `jink check sensors`: listens to every configured sensor and to the guard, and has it judged.

use super::{Outcome, Progress};
use jink_calibration::{Collector, MountingTable, calibrate};
use jink_cli::sensors_seen::{Seen, SensorTable, judge, subject};
use jink_control::findings::Findings;
use jink_control::watch::{PROGRAM, SpaceWatch, Watch};
use jink_control::{Interrupt, Problem, running};
use jink_runtime::config::{self, Config, SensorOutput};
use jink_runtime::{Checks, Input, Instance, Session};
use jink_shared_types::events::EventSample;
use jink_shared_types::faults::SensorFault;
use jink_shared_types::map::LocalMap;
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::topics;
use jink_shared_types::vehicle::VehicleState;
use serde_json::{Map, Value};
use std::time::{Duration, Instant};

/// How often new samples are read: the queue of a scan holds four, 20 ms of the fastest sensor.
const LOOK: Duration = Duration::from_millis(2);
/// How often progress is shown.
const SHOW: Duration = Duration::from_millis(500);

/// For how long.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// How long to listen (s)
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=600))]
    pub(super) seconds: u32,
    /// One JSON object instead of a table: findings, and the figures of every sensor and of the ring
    #[arg(long)]
    pub(super) json: bool,
    /// Estimate where three-dimensional sensors are mounted instead, with the vehicle standing still on level ground; prints rows to
    /// copy, and changes nothing
    #[arg(long)]
    pub(super) calibrate: bool,
    /// The sensor that the others are compared with; without it, the one with the largest field of view
    #[arg(long, value_name = "NAME", requires = "calibrate")]
    pub(super) against: Option<String>,
    /// Height of the vehicle's centre of gravity above the ground, as measured with a rule (m): then heights are estimated, too
    #[arg(long, value_name = "METRES", requires = "calibrate", value_parser = height_m)]
    pub(super) height_m: Option<f64>,
}

fn height_m(text: &str) -> Result<f64, String> {
    let height_m: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.0..=5.0).contains(&height_m) {
        Ok(height_m)
    } else {
        Err("a number from 0 to 5".to_owned())
    }
}

/// Examines the sensors.
pub fn run(instance: &Instance, args: &Args) -> Result<Outcome, Problem> {
    if running::find(instance)?.is_none() || !Watch::is_ready(instance) {
        return Ok(Outcome::NotRunning);
    }
    let folder = instance.run_config();
    let (config, tables) = match (Config::load(&folder), config::sensors::<SensorTable>(&folder)) {
        (Ok(config), Ok(tables)) => (config, tables),
        (Err(error), _) | (_, Err(error)) => return Ok(Outcome::Refused(error.to_string())),
    };
    let interrupt = Interrupt::listen()?;
    let session = Session::open(instance, PROGRAM)?;
    let mut topics = Topics::open(&session, &config)?;
    let mut space = SpaceWatch::open(&session)?;
    // What had come before is not of this time; only the parameters still hold.
    let mut before = Seen::new(tables.clone(), config.params);
    topics.take(&mut before, None);
    let mut seen = Seen::new(tables, before.params);
    let mut collector = if args.calibrate {
        let is_cloud = |table: &MountingTable| {
            let sensor = config.sensors.iter().find(|sensor| sensor.name == table.name);
            sensor.is_some_and(|sensor| sensor.output == SensorOutput::Cloud)
        };
        match config::sensors::<MountingTable>(&folder) {
            Ok(tables) => Some(Collector::new(tables.into_iter().filter(is_cloud))),
            Err(error) => return Ok(Outcome::Refused(error.to_string())),
        }
    } else {
        None
    };
    let mut screen = Progress::default();
    let (whole, begin) = (Duration::from_secs(args.seconds.into()), Instant::now());
    let mut shown = begin;
    while begin.elapsed() < whole {
        if interrupt.has_come() {
            screen.clear();
            return Ok(Outcome::Interrupted);
        }
        topics.take(&mut seen, collector.as_mut());
        seen.space = space.look().or(seen.space);
        if shown.elapsed() >= SHOW {
            shown = Instant::now();
            screen.show(&progress(&seen, begin.elapsed(), whole));
        }
        std::thread::sleep(LOOK);
    }
    screen.clear();
    seen.seconds = begin.elapsed().as_secs_f64();
    if let Some(collector) = collector {
        let calibrated = calibrate(&collector, args.against.as_deref(), args.height_m);
        let mut figures = Map::new();
        figures.insert("mounting".to_owned(), Value::Object(calibrated.figures));
        let findings = Findings {
            findings: calibrated.findings,
            subject: "mounting".to_owned(),
            seconds: seen.seconds,
        };
        return Ok(Outcome::Found(findings, figures, calibrated.rows));
    }
    let findings = Findings {
        findings: judge(&seen),
        subject: subject(&seen),
        seconds: seen.seconds,
    };
    Ok(Outcome::Found(findings, seen.figures(), String::new()))
}

fn progress(seen: &Seen, elapsed: Duration, whole: Duration) -> String {
    let counts: Vec<String> = seen
        .sensors
        .iter()
        .map(|sensor| format!("{} {}", sensor.table.name, sensor.timing.samples()))
        .collect();
    let (elapsed_s, whole_s) = (elapsed.as_secs(), whole.as_secs());
    format!("listening, {elapsed_s} of {whole_s} s: {}", counts.join(", "))
}

enum Source {
    Scan(Input<RangeScan>),
    Cloud(Input<PointCloud>),
}

/// All that is listened to.
struct Topics {
    /// In the order of the configuration.
    sensors: Vec<Source>,
    ring: Input<SectorRing>,
    states: Input<VehicleState>,
    params: Input<ParameterValues>,
    events: Input<EventSample>,
    map: Input<LocalMap>,
}

impl Topics {
    fn open(session: &Session, config: &Config) -> Result<Self, Problem> {
        let mut sensors = Vec::new();
        for sensor in &config.sensors {
            sensors.push(match sensor.output {
                // What is wrong with a sensor is looked for here: everything is handed out.
                SensorOutput::Scan => Source::Scan(
                    session
                        .input(topics::RANGE_SCAN, &sensor.name)?
                        .with_checks(Checks::None),
                ),
                SensorOutput::Cloud => Source::Cloud(
                    session
                        .input(topics::RANGE_CLOUD, &sensor.name)?
                        .with_checks(Checks::None),
                ),
            });
        }
        Ok(Self {
            sensors,
            ring: session.input(topics::RING, "")?,
            states: session.input(topics::VEHICLE_STATE, "")?,
            params: session.input(topics::PARAMETERS, "")?,
            events: session.input(topics::EVENT, "")?.of_all_producers(),
            map: session.input(topics::LOCAL_MAP, "")?,
        })
    }

    /// Takes what has come.
    fn take(&mut self, seen: &mut Seen, mut collector: Option<&mut Collector>) {
        let (heading_rad, own_m) = (seen.ring.heading_rad(), seen.own_m());
        for (source, sensor) in self.sensors.iter_mut().zip(&mut seen.sensors) {
            match source {
                Source::Scan(input) => {
                    input.each(|scan| sensor.scan(scan.sample, scan.header, heading_rad, own_m));
                }
                Source::Cloud(input) => input.each(|cloud| {
                    sensor.cloud(cloud.sample, cloud.header, own_m);
                    if let Some(collector) = &mut collector {
                        collector.cloud(&sensor.table.name, cloud.sample, own_m);
                    }
                }),
            }
        }
        self.ring.each(|ring| seen.ring.take(ring.sample, ring.header));
        self.states.each(|state| {
            seen.states += u64::from(state.sample.position_valid.is_set());
            if let Some(collector) = &mut collector {
                collector.still.take(state.sample);
            }
        });
        self.map.each(|map| {
            for (number, fault) in seen.faults.iter_mut().enumerate() {
                *fault = map.sample.fault_of(number).unwrap_or(SensorFault::Unknown);
            }
        });
        self.events.each(|event| seen.events.push(*event.sample));
        let known = seen.params.clone();
        self.params.each(|values| {
            for (row, value) in values.sample.rows(&known) {
                // Values of another build may lie outside; the ones at hand stay.
                let _refused = seen.params.set(row.name, value);
            }
        });
    }
}
