//! Obstacle fusion as a process: woken by every range sample, one map per sample of an area sensor unless it sends too many
//! ([`crate::pace`]).

use crate::pace::MapPace;
use crate::{DeclaredOfSensor, Fusion, FusionConfig};
use jink_runtime::{Cycle, Input, Output, Ports, RangeInputs, RangeSample, Service, StartError, Wake};
use jink_shared_types::far_map::FarMap;
use jink_shared_types::map::LocalMap;
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::ranges::SENSORS;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Stage, Timestamp, events, topics};
use std::fmt;

/// Without new ranges the map is published again at this period, so that its readers learn that it is stale (s). Longer
/// than the period of any usable sensor: a map published again just before the next frame would be used for planning
/// although it is a period old.
const IDLE_PERIOD_S: f64 = 0.2;

/// The vehicle's state is read at least this often (s): otherwise, between two frames of a slow sensor, its newest
/// sample would look old, and this input would count as missing.
const STATE_PERIOD_S: f64 = 0.05;

/// The far map is published at this period (s): 2.5 m of flight at 5 m/s.
const FAR_PERIOD_S: f64 = 0.5;

/// The service: see [`crate`].
pub struct FusionService {
    fusion: Fusion,
    ranges: RangeInputs,
    state: Input<VehicleState>,
    output: Output<LocalMap>,
    moving: Output<MovingObstacles>,
    far: Output<FarMap>,
    far_sent: Timestamp,
    epoch: u32,
    /// Names of the sensors, by number.
    names: Vec<String>,
    header: SampleHeader,
    pace: MapPace,
    sent: Timestamp,
}

impl fmt::Debug for FusionService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("FusionService")
    }
}

impl Service for FusionService {
    const PROGRAM: &'static str = "obstacle_fusion";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let ranges = RangeInputs::open(ports)?;
        if ranges.is_empty() {
            return Err(StartError::Needs {
                what: "a range sensor".to_owned(),
                cause: "the configuration has no [[sensor]]".to_owned(),
            });
        }
        let mut declared = [DeclaredOfSensor::default(); SENSORS];
        for (declared, sensor) in declared.iter_mut().zip(&ports.config().sensors) {
            *declared = DeclaredOfSensor {
                band_m: sensor.band_m,
                no_return_is_clear: sensor.no_return_is_clear,
                rate_hz: sensor.rate_hz.unwrap_or(0.0),
                repeats_hits: sensor.kind == "lidar_3d",
            };
        }
        let config = FusionConfig {
            declared,
            // A restart continues the epochs, as far as its generation says.
            first_epoch: ports.setup().generation << 16,
            ..FusionConfig::from_params(&ports.config().params, ranges.len())
        };
        Ok(Self {
            fusion: Fusion::new(config),
            ranges,
            state: ports.input(topics::VEHICLE_STATE)?.needed(),
            output: ports.output(topics::LOCAL_MAP)?,
            moving: ports.output(topics::MOVING_OBSTACLES)?,
            far: ports.output(topics::FAR_MAP)?,
            far_sent: Timestamp::NEVER,
            epoch: config.first_epoch,
            names: ports
                .config()
                .sensors
                .iter()
                .map(|sensor| sensor.name.clone())
                .collect(),
            header: SampleHeader::default(),
            pace: MapPace::new(&declared.map(|declared| declared.rate_hz)),
            sent: Timestamp::NEVER,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        let Self {
            fusion,
            ranges,
            state,
            epoch,
            header,
            pace,
            ..
        } = self;
        state.each(|state| {
            fusion.vehicle(state.sample, state.header);
            // A map that has moved with the local frame is as good as before.
            if std::mem::replace(epoch, fusion.epoch()) != fusion.epoch() {
                cycle.events.raise(now, &events::ESTIMATOR_RESET, "", [0.0; 2]);
            }
        });
        // The map is as young as the newest frame in it, whichever sensor was read last.
        let mut newest = |frame: &SampleHeader| {
            if frame.capture > header.capture {
                *header = *frame;
            }
        };
        ranges.each(|number, sample| match sample {
            RangeSample::Cloud(cloud) => {
                fusion.cloud(number, cloud.sample, cloud.header);
                newest(cloud.header);
                pace.on_frame(number);
            }
            RangeSample::Scan(scan) => {
                fusion.scan(number, scan.sample, scan.header);
                // A single beam refines the map; a scan of many beams counts as new data of its own.
                if scan.beams > 1 {
                    newest(scan.header);
                    pace.on_frame(number);
                }
            }
        });
        let is_due = self.pace.due().is_some_and(|due| due <= now);
        if is_due || now.seconds_since(self.sent) >= IDLE_PERIOD_S {
            self.sent = now;
            self.pace.on_map(now);
            if self.fusion.finds_overhang() {
                cycle.events.raise(now, &events::OVERHANG_SEEN, "", [0.0; 2]);
            }
            let fusion = &self.fusion;
            self.output.write(self.header.derived(Stage::Fusion, now), |map| {
                fusion.write(now, map);
            });
            let fusion = &mut self.fusion;
            self.moving
                .write(self.header.derived(Stage::Fusion, now), |moving| {
                    fusion.write_moving(moving);
                });
            if !self.far_sent.is_set() || now.seconds_since(self.far_sent) >= FAR_PERIOD_S {
                self.far_sent = now;
                let fusion = &mut self.fusion;
                self.far.write(self.header.derived(Stage::Fusion, now), |map| {
                    fusion.write_far(map);
                });
            }
        }
        while let Some(finding) = self.fusion.next_finding() {
            let name = self.names.get(finding.sensor).map_or("", String::as_str);
            cycle.events.publish(now, &finding.event(name));
        }
        if let Some(is_adrift) = self.fusion.adrift_change() {
            let seen_by = self.fusion.adrift_seen_by();
            let name = seen_by.and_then(|sensor| self.names.get(sensor));
            let name = name.map_or("estimate", String::as_str);
            let event = if is_adrift {
                &events::POSITION_ADRIFT
            } else {
                &events::POSITION_CREDIBLE
            };
            cycle.events.raise(now, event, name, [0.0; 2]);
        }
        let regular = self
            .sent
            .plus_seconds(IDLE_PERIOD_S)
            .min(now.plus_seconds(STATE_PERIOD_S));
        Wake::at(self.pace.due().map_or(regular, |due| due.min(regular)))
    }
}
