//! What a report says of a flight, collected from its recordings in one pass.

mod timeline;

use crate::autopilot_log::AutopilotLog;
use crate::{ReportError, page};
use jink_control::parameters::Listed;
use jink_control::speed_limit::{SpeedLimit, flies};
use jink_recorder::reading::{Ends, Message, Reading, RecordedSample};
use jink_shared_types::health::{Histogram, SystemStatus};
use jink_shared_types::layout::{Layout, from_bytes, type_name};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::map::{self, LocalMap, SIZE_X, SIZE_Y, declared_as};
use jink_shared_types::motion::{ApprovedTrajectory, Route};
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ring::{SectorRing, sector_bearing_rad};
use jink_shared_types::topics::{
    APPROVED, EVENT, LINK_STATUS, LOCAL_MAP, PARAMETERS, RING, ROUTE, SIM_TRUTH, SYSTEM_STATUS, Topic,
    VEHICLE_STATE,
};
use jink_shared_types::truth::SimTruth;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{LocalNed, Point, STAGE_NAMES, SampleHeader, Timestamp};
use nalgebra::Vector3;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use timeline::Timeline;

/// A recording holds what was published before a moment at the latest so much after what was published then (s): the recorder hands over
/// five times a second.
const OUT_OF_ORDER_S: f64 = 2.0;
/// Between two rows of the charts (s): what a screen shows of a flight of minutes.
const ROW_S: f64 = 0.1;
/// What is older is not shown as of now (s): ring, route and truth come ten times a second.
const FRESH_S: f64 = 1.0;
/// Between two looks at the map (s): the window slides by a few metres, and is 25 m wide.
const LOOK_S: f64 = 0.5;
/// Cells above and below the vehicle's own that are drawn.
const BAND_CELLS: i32 = 2;
/// Below this height the band would show the ground (m).
const HEIGHT_MIN_M: f64 = 1.5;
/// An autopilot's log and what it sent to jink are at most so far apart in the median (m): 100 ms at 10 m/s. They are one estimate, as
/// old as the link is slow.
const LOG_OFF_MAX_M: f64 = 1.0;
/// Between two places of an autopilot's log between which one is interpolated (us): five of the slowest streams.
const LOG_APART_US: u64 = 500_000;

/// Numbers by their names, a row for each moment.
#[derive(Debug, Default)]
struct Columns(BTreeMap<&'static str, Vec<f64>>);

impl Columns {
    fn push<const N: usize>(&mut self, row: [(&'static str, f64); N]) {
        for (name, value) in row {
            self.0.entry(name).or_default().push(value);
        }
    }

    fn get(&self, name: &str) -> &[f64] {
        self.0.get(name).map_or(&[], Vec::as_slice)
    }

    /// To millimetres and milliseconds; what is unknown is null, and a column that is unknown throughout is left out.
    fn json(&self) -> Value {
        let known = self
            .0
            .iter()
            .filter(|(_, values)| values.iter().any(|value| value.is_finite()));
        let rounded = known.map(|(name, values)| {
            let values: Vec<f64> = values.iter().map(|value| round(*value)).collect();
            ((*name).to_owned(), json!(values))
        });
        Value::Object(rounded.collect::<Map<String, Value>>())
    }
}

fn round(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

/// The newest sample of a topic.
#[derive(Debug)]
struct Newest<T>(Option<(Timestamp, Box<T>)>);

impl<T> Default for Newest<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T> Newest<T> {
    /// Unless it was published too long before `now`.
    fn at(&self, now: Timestamp) -> Option<&T> {
        let (published, sample) = self.0.as_ref()?;
        (now.seconds_since(*published) < FRESH_S).then_some(&**sample)
    }
}

/// A sample that waits until everything that was published before it has been read.
#[derive(Debug)]
struct Waiting {
    topic: String,
    type_name: String,
    header: SampleHeader,
    payload: Vec<u8>,
}

/// See the module.
#[derive(Debug, Default)]
pub struct Flight {
    files: Vec<PathBuf>,
    about: BTreeMap<String, String>,
    configuration: BTreeMap<String, String>,
    damage: Vec<String>,
    lost: BTreeMap<String, u64>,
    waiting: BTreeMap<(Timestamp, u64), Waiting>,
    taken: u64,
    vehicle: Newest<VehicleState>,
    route: Newest<Route>,
    approved: Newest<ApprovedTrajectory>,
    ring: Newest<SectorRing>,
    truth: Newest<SimTruth>,
    begin: Timestamp,
    last_row: Timestamp,
    looked: Timestamp,
    rows: Columns,
    sent: Vec<Option<Vector3<f64>>>,
    causes: Vec<Option<&'static str>>,
    cells: BTreeSet<(i32, i32)>,
    goals: Vec<Point<LocalNed>>,
    declarations: u8,
    /// The last of each start of the gateway.
    links: Vec<Box<LinkStatus>>,
    /// Board's clock, and what the autopilot's is ahead of it (ns).
    offsets: Vec<(Timestamp, i64)>,
    timeline: Timeline,
    parameters: Option<Box<ParameterValues>>,
    changes: Vec<Value>,
    log: Option<(String, AutopilotLog)>,
}

impl Flight {
    /// Reads the recordings of one flight, in the order in which they were begun; `progress` gets the bytes that have been read, and how
    /// many there are.
    ///
    /// # Errors
    /// [`ReportError`] if one cannot be read, was recorded with other layouts, or there is no vehicle in them. What a damaged file holds
    /// before its damage is used.
    pub fn read(files: &[PathBuf], progress: &mut dyn FnMut(u64, u64)) -> Result<Self, ReportError> {
        let mut flight = Self {
            files: files.to_vec(),
            ..Self::default()
        };
        let readings: Vec<Reading> = files
            .iter()
            .map(|file| Reading::open(file))
            .collect::<Result<_, _>>()?;
        let total = readings.iter().map(Reading::len_bytes).sum();
        let mut read = 0;
        for (reading, file) in readings.iter().zip(files) {
            if flight.about.is_empty() {
                flight.about.clone_from(&reading.about);
                flight.configuration.clone_from(&reading.files);
            }
            let mut refused = None;
            let ends = reading.each(|message| {
                match message {
                    Message::Sample(sample) => {
                        read += sample.payload.len() as u64;
                        flight.wait(sample);
                        refused = flight.advance(OUT_OF_ORDER_S, file).err();
                    }
                    Message::Lost(topic, count) => {
                        *flight.lost.entry((*topic).to_owned()).or_default() += count;
                    }
                }
                progress(read.min(total), total);
                refused.is_none()
            });
            if let Some(error) = refused {
                return Err(error);
            }
            match ends {
                Ok(Ends::Whole) => {}
                Ok(Ends::CutOff) => flight.damage.push(format!("{}: cut off", file.display())),
                Err(error) => flight.damage.push(error.to_string()),
            }
        }
        let last = files.last().map(PathBuf::as_path).unwrap_or(Path::new(""));
        flight.advance(0.0, last)?;
        match flight.rows.get("t") {
            [] => Err(ReportError::NoVehicle(last.to_owned())),
            _ => Ok(flight),
        }
    }

    /// Lays an autopilot's log over it.
    ///
    /// # Errors
    /// [`ReportError`] if the recording does not know the autopilot's clock, or the log is of another time.
    pub fn lay_over(&mut self, path: &Path, log: AutopilotLog) -> Result<(), ReportError> {
        if self.offsets.is_empty() {
            return Err(ReportError::NoClock(path.to_owned()));
        }
        let times = self.rows.get("t").to_vec();
        let mut columns = Columns::default();
        for ((t_s, sent), row) in times.iter().zip(&self.sent).zip(0..) {
            let boot_us = self.boot_us(self.begin.plus_seconds(*t_s));
            let place = |places: &crate::autopilot_log::Places| {
                boot_us.and_then(|boot_us| places.at(boot_us, LOG_APART_US))
            };
            let (wanted, was) = (place(&log.wanted), place(&log.was));
            let apart = |a: Option<Vector3<f64>>, b: Option<Vector3<f64>>| {
                a.zip(b).map_or(f64::NAN, |(a, b)| (a - b).norm())
            };
            let of = |place: Option<Vector3<f64>>, axis: usize| place.map_or(f64::NAN, |place| place[axis]);
            let at = |name: &str| self.rows.get(name).get(row).copied().unwrap_or(f64::NAN);
            let known = Vector3::new(at("n"), at("e"), -at("up"));
            columns.push([
                ("log_n", of(was, 0)),
                ("log_e", of(was, 1)),
                ("log_wanted_off", apart(wanted, *sent)),
                ("log_was_off", apart(was, *sent)),
                ("log_apart", apart(was, Some(known))),
            ]);
        }
        let apart_m = median(columns.get("log_apart"));
        if apart_m.is_nan() || apart_m > LOG_OFF_MAX_M {
            return Err(ReportError::OtherFlight(path.to_owned(), apart_m));
        }
        self.rows.0.extend(columns.0);
        self.log = Some((path.display().to_string(), log));
        Ok(())
    }

    /// The autopilot's clock at `time` of the board's (us).
    fn boot_us(&self, time: Timestamp) -> Option<u64> {
        let after = self.offsets.partition_point(|(known, _)| *known <= time);
        let (_, ahead_ns) = self.offsets.get(after.saturating_sub(1))?;
        u64::try_from((i128::from(time.ns) + i128::from(*ahead_ns)) / 1000).ok()
    }

    fn wait(&mut self, sample: &RecordedSample<'_>) {
        let shown = [
            VEHICLE_STATE.row.name,
            ROUTE.row.name,
            APPROVED.row.name,
            RING.row.name,
            SIM_TRUTH.row.name,
            LOCAL_MAP.row.name,
            EVENT.row.name,
            SYSTEM_STATUS.row.name,
            LINK_STATUS.row.name,
            PARAMETERS.row.name,
        ];
        if !shown.contains(&sample.topic) {
            return;
        }
        self.taken += 1;
        let waiting = Waiting {
            topic: sample.topic.to_owned(),
            type_name: sample.type_name.to_owned(),
            header: *sample.header,
            payload: sample.payload.to_vec(),
        };
        self.waiting.insert((sample.header.publish, self.taken), waiting);
    }

    /// Takes what was published more than `behind_s` before the newest.
    fn advance(&mut self, behind_s: f64, file: &Path) -> Result<(), ReportError> {
        let Some(((newest, _), _)) = self.waiting.last_key_value() else {
            return Ok(());
        };
        let newest = *newest;
        while let Some(first) = self.waiting.first_entry() {
            if newest.seconds_since(first.key().0) < behind_s {
                break;
            }
            let sample = first.remove();
            self.take(&sample).map_err(|ours| {
                let (topic, recorded) = (sample.topic.clone(), sample.type_name.clone());
                ReportError::Layout(file.to_owned(), topic, recorded, ours)
            })?;
        }
        Ok(())
    }

    /// Takes a sample; of another layout than ours, that is named.
    fn take(&mut self, sample: &Waiting) -> Result<(), &'static str> {
        let time = sample.header.publish;
        match sample.topic.as_str() {
            name if name == VEHICLE_STATE.row.name => {
                self.vehicle = Newest(Some((time, of(VEHICLE_STATE, sample)?)));
                self.row(time);
            }
            name if name == ROUTE.row.name => {
                let route = of(ROUTE, sample)?;
                self.take_goal(&route);
                self.route = Newest(Some((time, route)));
            }
            name if name == APPROVED.row.name => {
                self.approved = Newest(Some((time, of(APPROVED, sample)?)));
            }
            name if name == RING.row.name => self.ring = Newest(Some((time, of(RING, sample)?))),
            name if name == SIM_TRUTH.row.name => self.truth = Newest(Some((time, of(SIM_TRUTH, sample)?))),
            name if name == LOCAL_MAP.row.name => {
                let is_due = !self.looked.is_set() || time.seconds_since(self.looked) >= LOOK_S;
                if is_due && self.flies(time) {
                    self.looked = time;
                    self.look(&*of(LOCAL_MAP, sample)?);
                }
            }
            name if name == EVENT.row.name => self.timeline.take_event(time, &*of(EVENT, sample)?),
            name if name == SYSTEM_STATUS.row.name => {
                let status: Box<SystemStatus> = of(SYSTEM_STATUS, sample)?;
                self.timeline.take_status(time, &status);
            }
            name if name == LINK_STATUS.row.name => self.take_link(time, of(LINK_STATUS, sample)?),
            name if name == PARAMETERS.row.name => self.take_parameters(time, of(PARAMETERS, sample)?),
            _ => {}
        }
        Ok(())
    }

    fn take_goal(&mut self, route: &Route) {
        self.declarations |= route.declarations;
        let is_new = |goal: &Point<LocalNed>| (goal.vector() - route.goal.vector()).norm() > map::CELL_M;
        let is_wanted = flies_somewhere(route);
        if is_wanted && self.goals.last().is_none_or(is_new) {
            self.goals.push(route.goal);
        }
    }

    fn take_link(&mut self, time: Timestamp, link: Box<LinkStatus>) {
        if link.timesync_converged.is_set() {
            self.offsets.push((time, link.clock_offset_ns));
        }
        match self.links.last_mut() {
            // Its counters are those since its start.
            Some(last) if link.received >= last.received => *last = link,
            _ => self.links.push(link),
        }
    }

    fn take_parameters(&mut self, time: Timestamp, values: Box<ParameterValues>) {
        let known = ParamSet::default();
        if let Some(before) = &self.parameters {
            for ((row, was), (_, is)) in before.rows(&known).zip(values.rows(&known)) {
                if was != is {
                    let change = json!({ "t": round(self.t_s(time)), "name": row.name, "from": was, "to": is, "unit": row.unit });
                    self.changes.push(change);
                }
            }
        }
        self.parameters = Some(values);
    }

    fn t_s(&self, time: Timestamp) -> f64 {
        time.seconds_since(self.begin)
    }

    /// Whether the vehicle is so high that obstacles beside it are no ground.
    fn flies(&self, now: Timestamp) -> bool {
        let vehicle = self.vehicle.at(now).filter(|vehicle| vehicle.armed.is_set());
        vehicle.is_some_and(|vehicle| up_m(vehicle) > HEIGHT_MIN_M)
    }

    fn look(&mut self, local: &LocalMap) {
        self.declarations |= local.declarations;
        let Some((_, vehicle)) = &self.vehicle.0 else {
            return;
        };
        let [_, _, height] = map::cell_of(vehicle.position);
        for z in height - BAND_CELLS..=height + BAND_CELLS {
            for y in local.min_cell[1]..local.min_cell[1].saturating_add(SIZE_Y as i32) {
                for x in local.min_cell[0]..local.min_cell[0].saturating_add(SIZE_X as i32) {
                    if local.is_occupied([x, y, z]) {
                        self.cells.insert((x, y));
                    }
                }
            }
        }
    }

    /// A row of the charts, where one is due: from the first moment on at which the motors were armed, or else all.
    fn row(&mut self, now: Timestamp) {
        let Some(vehicle) = self
            .vehicle
            .at(now)
            .filter(|vehicle| vehicle.position_valid.is_set())
        else {
            return;
        };
        if !self.begin.is_set() || vehicle.armed.is_set() && !self.timeline.was_armed() {
            // What was before the motors ran is of no interest.
            self.begin = now;
            self.last_row = Timestamp::NEVER;
            self.rows = Columns::default();
            self.sent.clear();
            self.causes.clear();
        }
        self.timeline.take_vehicle(now, vehicle);
        if self.last_row.is_set() && now.seconds_since(self.last_row) < ROW_S {
            return;
        }
        self.last_row = now;
        let (position, velocity) = (vehicle.position.vector(), vehicle.velocity.vector());
        let flown = self.approved.at(now).filter(|approved| flies(approved, now));
        let sent = flown.and_then(|approved| approved.trajectory.at(now));
        let sent = sent.map(|state| state.position.vector());
        let limit = flown.zip(self.route.at(now));
        let limit = limit.and_then(|(approved, route)| SpeedLimit::of(route, approved, now));
        let (nearest_m, bearing_deg) = self.ring.at(now).map_or((f64::NAN, f64::NAN), nearest);
        let truth = self.truth.at(now);
        let true_m = truth.map_or(f64::NAN, |truth| truth.clearance_m);
        self.rows.push([
            ("t", now.seconds_since(self.begin)),
            ("n", position.x),
            ("e", position.y),
            ("up", -position.z),
            ("yaw_deg", vehicle.attitude.yaw_rad().to_degrees()),
            ("speed", velocity.norm()),
            ("limit", limit.map_or(f64::NAN, |limit| limit.limit_mps)),
            ("off", sent.map_or(f64::NAN, |sent| (sent - position).norm())),
            (
                "tube",
                flown.map_or(f64::NAN, |approved| approved.trajectory.limits.tube_m),
            ),
            ("nearest", nearest_m),
            ("bearing", bearing_deg),
            ("clearance", true_m),
        ]);
        self.sent.push(sent);
        self.causes.push(limit.map(|limit| limit.cause.words()));
    }

    /// The page.
    pub fn page(&self) -> String {
        let title = self.files.first().map_or_else(String::new, |file| {
            file.file_name()
                .map(|name| name.to_string_lossy().into_owned())
                .unwrap_or_default()
        });
        page::flight(&format!("jink: {title}"), &self.json())
    }

    fn json(&self) -> Value {
        let known = ParamSet::default();
        let parameters = self.parameters.as_ref().map(|values| {
            let rows = values.rows(&known).map(|(row, value)| {
                let listed = Listed::of(row, value);
                json!({ "name": listed.name, "value": listed.value, "default": listed.default, "unit": listed.unit, "help": row.help })
            });
            rows.collect::<Vec<_>>()
        });
        let names = declared_as::NAMES.iter();
        let declarations: Vec<&str> = names
            .filter(|(bit, _)| self.declarations & bit != 0)
            .map(|(_, name)| *name)
            .collect();
        let cells: Vec<[i32; 2]> = self.cells.iter().map(|(x, y)| [*x, *y]).collect();
        let goals: Vec<[f64; 2]> = self
            .goals
            .iter()
            .map(|goal| [round(goal.x_m), round(goal.y_m)])
            .collect();
        let log = self.log.as_ref().map(|(name, log)| {
            json!({
                "name": name,
                "maker": log.maker,
                "damage": log.damage,
                "apart_m": round(median(self.rows.get("log_apart"))),
            })
        });
        json!({
            "files": self.files,
            "about": self.about,
            "damage": self.damage,
            "lost": self.lost,
            "figures": self.figures(),
            "rows": self.rows.json(),
            "causes": self.causes,
            "map": { "cell_m": map::CELL_M, "cells": cells, "goals": goals },
            "timeline": self.timeline.json(self.begin),
            "latency": self.latency(),
            "parameters": parameters,
            "changes": self.changes,
            "declarations": declarations,
            "configuration": self.configuration,
            "log": log,
        })
    }

    /// The figures of the head.
    fn figures(&self) -> Value {
        let (n, e, up) = (self.rows.get("n"), self.rows.get("e"), self.rows.get("up"));
        let place = |i: usize| Vector3::new(n[i], e[i], up[i]);
        let way_m: f64 = (1..n.len()).map(|i| (place(i) - place(i - 1)).norm()).sum();
        let most = |name: &str| {
            self.rows
                .get(name)
                .iter()
                .copied()
                .filter(|v| v.is_finite())
                .reduce(f64::max)
        };
        let least = |name: &str| {
            self.rows
                .get(name)
                .iter()
                .copied()
                .filter(|v| v.is_finite())
                .reduce(f64::min)
        };
        let truth = self.truth.0.as_ref().map(|(_, truth)| truth);
        let gap_us = self.links.iter().map(|link| link.setpoint_gap_max_us).max();
        json!({
            "duration_s": self.rows.get("t").last().map(|t| round(*t)),
            "way_m": round(way_m),
            "top_mps": most("speed").map(round),
            "nearest_m": least("nearest").map(round),
            "clearance_m": truth.map(|truth| truth.min_clearance_m).filter(|m| m.is_finite()).map(round),
            "collisions": truth.map(|truth| truth.collisions),
            "off_m": most("off").map(round),
            "setpoints": self.links.iter().map(|link| link.setpoints).sum::<u64>(),
            "gap_sent_ms": gap_us.map(|us| round(f64::from(us) / 1e3)),
            "gap_received_ms": truth.map(|truth| round(truth.setpoint_gap_max_s * 1e3)),
            "profile": self.links.last().map(|link| link.profile.as_str().to_owned()),
        })
    }

    /// From the capture of a range to the wire, and what each stage added.
    fn latency(&self) -> Value {
        let merged = |of: &dyn Fn(&LinkStatus) -> Histogram| {
            let mut all = Histogram::default();
            for link in &self.links {
                all.merge(&of(link));
            }
            let ms = |quantile| round(all.quantile_us(quantile) / 1e3);
            json!({ "count": all.count, "p50": ms(0.5), "p99": ms(0.99), "max": round(f64::from(all.max_us) / 1e3) })
        };
        let stage = |(index, name): (usize, &&str)| {
            json!({
                "name": name,
                "took": merged(&|link| link.stages[index]),
                "waited": merged(&|link| link.hops[index]),
            })
        };
        json!({
            "whole": merged(&|link| link.capture_to_wire),
            "stages": STAGE_NAMES.iter().enumerate().map(stage).collect::<Vec<_>>(),
        })
    }
}

fn of<T: Layout>(_: Topic<T>, sample: &Waiting) -> Result<Box<T>, &'static str> {
    let ours = type_name::<T>();
    if sample.type_name == ours {
        Ok(from_bytes(&sample.payload))
    } else {
        Err(ours)
    }
}

fn up_m(vehicle: &VehicleState) -> f64 {
    match vehicle.home_down_m {
        home_m if home_m.is_finite() => home_m - vehicle.position.z_m,
        _ => -vehicle.position.z_m,
    }
}

/// Whether a route has a goal: where nothing new or nothing at all is wanted, it is that of before, or none.
fn flies_somewhere(route: &Route) -> bool {
    use jink_shared_types::motion::RouteMode;
    route.mode == RouteMode::Plan && route.goal.is_finite()
}

/// The nearest obstacle of a ring: distance (m), bearing clockwise from forward (deg, -180 to 180).
fn nearest(ring: &SectorRing) -> (f64, f64) {
    let seen = ring.distance_m.iter().enumerate().filter(|(_, m)| m.is_finite());
    seen.min_by(|(_, a), (_, b)| a.total_cmp(b))
        .map_or((f64::NAN, f64::NAN), |(sector, m)| {
            let bearing_deg = sector_bearing_rad(sector).to_degrees();
            (f64::from(*m), (bearing_deg + 180.0).rem_euclid(360.0) - 180.0)
        })
}

/// Of what is known; NaN of nothing.
fn median(values: &[f64]) -> f64 {
    let mut known: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    known.sort_by(f64::total_cmp);
    known.get(known.len() / 2).copied().unwrap_or(f64::NAN)
}
