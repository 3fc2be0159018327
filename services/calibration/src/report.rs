//! From what was measured while the vehicle stood to sentences, and rows to copy.

use super::mounting::{Mounting, MountingTable};
use super::{Axis, CalibrateError, Correction, Ground, Points, against_gravity, against_sensor};
use jink_control::findings::{Finding, Grade};
use jink_shared_types::ranges::{PointCloud, RayKind};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::view::{COLUMNS, FieldOfView, ROWS, STEP_RAD};
use nalgebra::{UnitQuaternion, Vector3};
use serde_json::{Map, Value, json};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

/// A vehicle stands still up to this speed (m/s) and this turn rate (rad/s), as its autopilot estimates them.
const SPEED_MAX_MPS: f64 = 0.15;
const RATE_MAX_RADPS: f64 = 0.05;
/// Of the states, so many may be beyond: an estimator jumps now and then.
const MOVING_MAX: f64 = 0.02;
/// A mounting that differs by more than this (deg, m) from the configured one is worth a correction.
const DIFFERS: (f64, f64) = (1.0, 0.03);

/// Whether the vehicle stood still, and where down was.
#[derive(Clone, Debug, Default)]
pub struct Still {
    states: u64,
    moving: u64,
    down: Vector3<f64>,
}

impl Still {
    /// Takes a state.
    pub fn take(&mut self, state: &VehicleState) {
        let Some(local_q_body) = state.attitude.rotation() else {
            return;
        };
        self.states += 1;
        self.down += local_q_body.inverse() * Vector3::z();
        let is_still =
            state.velocity.vector().norm() <= SPEED_MAX_MPS && state.rates.vector().norm() <= RATE_MAX_RADPS;
        self.moving += u64::from(!is_still);
    }

    /// Whether it moved. Without a state nobody knows.
    pub fn has_moved(&self) -> bool {
        self.moving as f64 > MOVING_MAX * self.states as f64
    }

    /// Gravity in the body frame; `None` if the autopilot has sent no attitude.
    pub fn down(&self) -> Option<Vector3<f64>> {
        self.down.try_normalize(1e-9)
    }
}

/// What one three-dimensional sensor has measured.
#[derive(Clone, Debug)]
struct Measured {
    table: MountingTable,
    points: Points,
    view: FieldOfView,
}

/// What all of them have.
#[derive(Clone, Debug)]
pub struct Collector {
    sensors: Vec<Measured>,
    /// Whether the vehicle stood still.
    pub still: Still,
}

impl Collector {
    /// Nothing yet, of the sensors of these tables that publish clouds.
    pub fn new(tables: impl IntoIterator<Item = MountingTable>) -> Self {
        let sensors = tables.into_iter().map(|table| Measured {
            table,
            points: Points::default(),
            view: FieldOfView::default(),
        });
        Self {
            sensors: sensors.collect(),
            still: Still::default(),
        }
    }

    /// Takes a cloud of the sensor called `name`; what is nearer to the vehicle's centre than `own_m` is the vehicle.
    pub fn cloud(&mut self, name: &str, cloud: &PointCloud, own_m: f64) {
        let Some(sensor) = self.sensors.iter_mut().find(|sensor| sensor.table.name == name) else {
            return;
        };
        sensor.points.add(cloud, own_m);
        let origin = cloud.origin.vector();
        for point in cloud
            .points()
            .iter()
            .filter(|one| one.kind.get() != RayKind::Unknown)
        {
            let end = Vector3::new(point.forward_m, point.right_m, point.down_m).cast::<f64>();
            if (end - origin).iter().all(|part| part.is_finite()) {
                sensor.view.add(&(end - origin));
            }
        }
    }

    /// The sensor that looks into the largest part of the sphere.
    fn widest(&self) -> Option<&Measured> {
        self.sensors
            .iter()
            .max_by(|a, b| solid_angle(&a.view).total_cmp(&solid_angle(&b.view)))
    }
}

/// Of the directions in view (sr).
fn solid_angle(view: &FieldOfView) -> f64 {
    let of_row = |row: usize| {
        let seen = (0..COLUMNS).filter(|column| view.is_seen(row, *column)).count() as f64;
        seen * STEP_RAD * STEP_RAD * ((row as f64 + 0.5) * STEP_RAD - FRAC_PI_2).cos()
    };
    (0..ROWS).map(of_row).sum()
}

/// All that follows.
#[derive(Clone, Debug, Default)]
pub struct Calibrated {
    /// As people read it.
    pub findings: Vec<Finding>,
    /// Rows to copy into the tables, with comments.
    pub rows: String,
    /// For scripts.
    pub figures: Map<String, Value>,
}

impl Calibrated {
    fn say(&mut self, grade: Grade, about: &str, is: String, remedy: &str) {
        self.findings.push(Finding {
            grade,
            about: about.to_owned(),
            is,
            remedy: remedy.to_owned(),
        });
    }
}

/// What follows from what was collected: every sensor against gravity, and against the one called `against` (without a name, that with
/// the largest field of view). With the height of the vehicle's centre of gravity above the ground, `height_m`, heights of sensors
/// follow, too.
pub fn calibrate(collected: &Collector, against: Option<&str>, height_m: Option<f64>) -> Calibrated {
    let mut out = Calibrated::default();
    let reference = match against {
        Some(name) => collected.sensors.iter().find(|sensor| sensor.table.name == name),
        None => collected.widest(),
    };
    let Some(reference) = reference else {
        let names: Vec<&str> = collected
            .sensors
            .iter()
            .map(|sensor| sensor.table.name.as_str())
            .collect();
        let is = match against {
            Some(name) => format!(
                "there is no three-dimensional sensor {name:?}; there are: {}",
                names.join(", ")
            ),
            None => "no three-dimensional sensor (lidar_3d, depth_camera) is configured".to_owned(),
        };
        out.say(
            Grade::Blocker,
            "mounting",
            is,
            "name one that there is with --against",
        );
        return out;
    };
    if collected.still.has_moved() {
        let is = "the vehicle has moved while its sensors were read".to_owned();
        let remedy = "let it stand on level ground, with people and things at rest, and try again";
        out.say(Grade::Blocker, "mounting", is, remedy);
        return out;
    }
    let down = collected.still.down();
    if down.is_none() {
        let is = "the autopilot has said no attitude: nothing is compared with gravity".to_owned();
        let remedy = "`jink check link` says what is missing";
        out.say(Grade::Warning, "mounting", is, remedy);
    }
    for sensor in &collected.sensors {
        one(&mut out, sensor, reference, down, height_m);
    }
    out
}

fn one(
    out: &mut Calibrated,
    sensor: &Measured,
    reference: &Measured,
    down: Option<Vector3<f64>>,
    height_m: Option<f64>,
) {
    let name = &sensor.table.name;
    let configured = match sensor.table.mounting() {
        Ok(mounting) => mounting,
        Err(problem) => {
            out.say(Grade::Blocker, name, problem, "docs/lidars.md lists the keys");
            return;
        }
    };
    let mut figures = Map::new();
    if let Some(down) = down {
        let ground = against_gravity(&sensor.points, &down);
        figures.insert(
            "gravity".to_owned(),
            gravity(out, name, &configured, &ground, height_m),
        );
    }
    if !std::ptr::eq(sensor, reference) {
        let correction = against_sensor(&reference.points, &sensor.points, configured.origin());
        let whom = &reference.table.name;
        figures.insert("against".to_owned(), json!(whom));
        figures.insert(
            "relative".to_owned(),
            relative(out, name, whom, &configured, &correction),
        );
    }
    out.figures.insert(name.clone(), Value::Object(figures));
}

/// Roll, pitch and height.
fn gravity(
    out: &mut Calibrated,
    name: &str,
    configured: &Mounting,
    ground: &Result<Ground, CalibrateError>,
    height_m: Option<f64>,
) -> Value {
    let ground = match ground {
        Ok(ground) => ground,
        Err(error) => {
            let is = format!("against gravity: not sure: {error}");
            out.say(
                Grade::Warning,
                name,
                is,
                "nothing, if it does not look at the ground",
            );
            return json!({"sure": false, "why": error.to_string()});
        }
    };
    // The ground is as deep below the centre of gravity as the user says, and below the sensor as it has measured.
    let lower_m = height_m.map_or(0.0, |height_m| {
        height_m - ground.height_m - configured.body_t_sensor.translation.vector.z
    });
    let mounting = configured.turned(&ground.turn, lower_m);
    let (angle_deg, distance_m) = mounting.apart(configured);
    let sure = ground.is_sure();
    let is = format!(
        "against gravity: {} (sigma {:.2} deg, {:.3} m); {:.2} m above the ground; residual {:.3} m; differs from the configured by {angle_deg:.1} deg, {distance_m:.3} m",
        if sure { "sure" } else { "not sure" },
        ground.sigma_rad.to_degrees(),
        ground.height_sigma_m,
        ground.height_m,
        ground.residual_m,
    );
    let differs = angle_deg > DIFFERS.0 || distance_m > DIFFERS.1;
    let (grade, remedy) = match (sure, differs) {
        (true, false) => (Grade::Good, ""),
        (true, true) => (
            Grade::Warning,
            "is the ground level, and the autopilot's attitude right? Turn the vehicle around and try again; then copy the row below",
        ),
        (false, _) => (Grade::Warning, "stand where more level ground is in view"),
    };
    out.say(grade, name, is, remedy);
    if sure {
        let known = if height_m.is_some() {
            "roll, pitch, height"
        } else {
            "roll, pitch"
        };
        row(out, name, &format!("against gravity: {known} only"), &mounting);
    }
    json!({
        "sure": sure,
        "angle_deg": angle_deg,
        "sigma_deg": ground.sigma_rad.to_degrees(),
        "height_above_ground_m": ground.height_m,
        "height_sigma_m": ground.height_sigma_m,
        "residual_m": ground.residual_m,
        "mounting": figures(&mounting),
    })
}

/// All six numbers.
fn relative(
    out: &mut Calibrated,
    name: &str,
    whom: &str,
    configured: &Mounting,
    correction: &Result<Correction, CalibrateError>,
) -> Value {
    let correction = match correction {
        Ok(correction) => correction,
        Err(error) => {
            let is = format!("against {whom}: not sure: {error}");
            out.say(Grade::Warning, name, is, "then try again");
            return json!({"sure": false, "why": error.to_string()});
        }
    };
    let mounting = configured.corrected(&correction.body_t_configured);
    let (angle_deg, distance_m) = mounting.apart(configured);
    let certainty = &correction.certainty;
    let sure = certainty.is_sure();
    let is = format!(
        "against {whom}: {} (sigma {}); residual {:.3} m, overlap {:.0} %; differs from the configured by {angle_deg:.1} deg, {distance_m:.3} m",
        if sure { "sure" } else { "not sure" },
        sigmas(&certainty.sigma),
        correction.residual_m,
        100.0 * correction.overlap,
    );
    let differs = angle_deg > DIFFERS.0 || distance_m > DIFFERS.1;
    match (sure, differs) {
        (true, false) => out.say(Grade::Good, name, is, ""),
        (true, true) => {
            let remedy = "copy the row below, unless it is the other one that is mounted otherwise: gravity says which";
            out.say(Grade::Warning, name, is, remedy);
        }
        (false, _) => out.say(Grade::Warning, name, is, &lacking(&certainty.unsure())),
    }
    if sure {
        row(out, name, &format!("against {whom}"), &mounting);
    }
    let axes = Axis::ALL.iter().zip(certainty.sigma).enumerate();
    let sigma: Map<String, Value> = axes
        .map(|(number, (axis, sigma))| {
            let in_its_unit = |sigma: f64| if number < 3 { sigma.to_degrees() } else { sigma };
            let unit = if number < 3 { "deg" } else { "m" };
            (format!("{axis}_{unit}"), json!(sigma.map(in_its_unit)))
        })
        .collect();
    let names = |axes: &[Axis]| axes.iter().map(ToString::to_string).collect::<Vec<_>>();
    json!({
        "sure": sure,
        "angle_deg": angle_deg,
        "distance_m": distance_m,
        "sigma": sigma,
        "unobservable": names(&certainty.unobservable),
        "residual_m": correction.residual_m,
        "overlap": correction.overlap,
        "mounting": figures(&mounting),
    })
}

/// What the scene lacks for these axes, each thing once.
fn lacking(axes: &[Axis]) -> String {
    let mut text = String::from("to be seen by both: ");
    let mut before = Vec::new();
    for axis in axes {
        let lacks = axis.lacks();
        if !before.contains(&lacks) {
            let separator = if before.is_empty() { "" } else { "; " };
            // Writing to a text cannot fail.
            let _ = write!(text, "{separator}for {axis} {lacks}");
            before.push(lacks);
        }
    }
    text
}

fn sigmas(sigma: &[Option<f64>; 6]) -> String {
    let text = |axes: std::ops::Range<usize>, factor: f64, decimals: usize| {
        let parts = axes.map(|axis| match sigma[axis] {
            Some(sigma) => format!("{:.decimals$}", sigma * factor),
            None => "not observable".to_owned(),
        });
        parts.collect::<Vec<_>>().join(" / ")
    };
    format!(
        "roll, pitch, yaw {} deg; forward, right, down {} m",
        text(0..3, 180.0 / std::f64::consts::PI, 2),
        text(3..6, 1.0, 3)
    )
}

fn row(out: &mut Calibrated, name: &str, how: &str, mounting: &Mounting) {
    // Writing to a text cannot fail.
    let _ = write!(out.rows, "\n# {name}, {how}\n{}", mounting.keys());
}

fn figures(mounting: &Mounting) -> Value {
    let place = mounting.body_t_sensor.translation.vector;
    let rotation: &UnitQuaternion<f64> = &mounting.body_t_sensor.rotation;
    let (roll_rad, pitch_rad, yaw_rad) = rotation.euler_angles();
    json!({
        "forward_m": place.x,
        "right_m": place.y,
        "down_m": place.z,
        "yaw_deg": yaw_rad.to_degrees(),
        "pitch_deg": pitch_rad.to_degrees(),
        "roll_deg": roll_rad.to_degrees(),
    })
}
