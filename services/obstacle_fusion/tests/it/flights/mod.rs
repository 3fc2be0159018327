//! Rendered flights with every set of sensors, and the faults that they are flown with.

use jink_obstacle_fusion::{Fusion, FusionConfig, SensorFinding};
use jink_runtime::config::{Config, sensor_sets};
use jink_shared_types::frames::{Attitude, Point, Velocity};
use jink_shared_types::map::LocalMap;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Flag, SampleHeader, Timestamp};
use jink_simulated_world::sensors::{Output, Pose, PoseTrack, SensorRig, SensorSpec};
use jink_simulated_world::world::World;
use nalgebra::{UnitQuaternion, Vector3};

const STATE_S: f64 = 0.02;
const SPEED_MPS: f64 = 2.5;
const START_S: f64 = 10.0;

/// The sensors of the set called `name`, and their names with the rates that their tables say.
pub fn set(name: &str) -> Vec<SensorSpec> {
    #[derive(serde::Deserialize)]
    struct Tables {
        sensor: Vec<SensorSpec>,
        #[serde(rename = "params")]
        _params: Option<toml::Table>,
    }
    let set = sensor_sets::named(name).unwrap();
    Config::parse(&set.file, &set.text).unwrap();
    toml::from_str::<Tables>(&set.text).unwrap().sensor
}

/// A path with turns: along the world's own, if it has one, with the nose along it, rolling and pitching.
pub struct FlightPath {
    corners: Vec<Vector3<f64>>,
    pub speed_mps: f64,
    /// The estimate is so old (s).
    pub late_s: f64,
    /// From when on (s) the estimated position runs off, and how fast (m/s), as it does when a GPS repeats its last fix.
    pub runs_off: (f64, Vector3<f64>),
    /// When (s) the estimator is reset to the true position, and until when its velocity is off after that, by how much (m/s).
    pub reset: (f64, f64, Vector3<f64>),
}

impl FlightPath {
    pub fn through(world: &World) -> Self {
        let corners = world.way(0.8).unwrap();
        Self {
            corners: corners.iter().map(|corner| corner.vector()).collect(),
            speed_mps: SPEED_MPS,
            late_s: 0.0,
            runs_off: (f64::INFINITY, Vector3::zeros()),
            reset: (f64::INFINITY, f64::INFINITY, Vector3::zeros()),
        }
    }

    /// Where the vehicle is after `t_s`.
    pub fn pose(&self, t_s: f64) -> Pose {
        let mut rest_m = self.speed_mps * t_s;
        let mut place = self.corners[self.corners.len() - 1];
        for pair in self.corners.windows(2) {
            let leg = pair[1] - pair[0];
            if rest_m < leg.norm() {
                place = pair[0] + leg * (rest_m / leg.norm());
                break;
            }
            rest_m -= leg.norm();
        }
        // It yaws to both sides of its path, and sways.
        let yaw_rad = 0.9 * (0.5 * t_s).sin();
        let attitude =
            UnitQuaternion::from_euler_angles(0.12 * (1.3 * t_s).sin(), 0.1 * (0.9 * t_s).cos(), yaw_rad);
        Pose {
            position: Point::from_vector(place + Vector3::new(0.0, 0.0, 0.3 * (0.7 * t_s).sin())),
            attitude,
        }
    }
}

/// What a flight has come to.
pub struct FlightResult {
    /// Every change of a fault: number of the frame of the sensor, and what.
    pub findings: Vec<(u64, SensorFinding)>,
    /// When the position became adrift, or credible again (s).
    pub adrift: Vec<(f64, bool)>,
    pub frames: u64,
    pub fusion: Fusion,
    pub now: Timestamp,
}

impl FlightResult {
    pub fn map(&self) -> Box<LocalMap> {
        let mut map = LocalMap::boxed();
        self.fusion.write(self.now, &mut map);
        map
    }
}

/// A sample that may be corrupted: the number of the frame, the sample, its header.
pub enum SensorSample<'a> {
    Cloud(&'a mut PointCloud),
    Scan(&'a mut RangeScan),
}

/// Flies `specs` through `world` along `path` for `duration_s`; `corrupt` gets the number of each frame of the first
/// sensor, and returns how often it is entered.
pub fn fly(
    world: &World,
    specs: &[SensorSpec],
    path: &FlightPath,
    duration_s: f64,
    corrupt: impl FnMut(u64, SensorSample<'_>, &mut SampleHeader) -> u32,
) -> FlightResult {
    fly_until(world, specs, path, duration_s, |_| false, corrupt)
}

/// The same, and it ends as soon as the findings are what `is_enough` says.
pub fn fly_until(
    world: &World,
    specs: &[SensorSpec],
    path: &FlightPath,
    duration_s: f64,
    is_enough: impl Fn(&[(u64, SensorFinding)]) -> bool,
    mut corrupt: impl FnMut(u64, SensorSample<'_>, &mut SampleHeader) -> u32,
) -> FlightResult {
    let mut config = FusionConfig::from_params(&ParamSet::default(), specs.len());
    for (declared, spec) in config.declared.iter_mut().zip(specs) {
        declared.rate_hz = spec.rate_hz.unwrap_or(0.0);
    }
    let mut fusion = Fusion::new(config);
    let mut rig = SensorRig::new(specs, 3).unwrap();
    let mut track = PoseTrack::new(rig.longest_frame_s() + 0.1, 0.004);
    let (mut cloud, mut scan) = (PointCloud::boxed(), RangeScan::default());
    let (mut findings, mut adrift) = (Vec::new(), Vec::new());
    let mut frames = 0;
    let steps = (duration_s / 0.004) as u64;
    let mut now = Timestamp::NEVER;
    for step in 0..steps {
        if is_enough(&findings) {
            break;
        }
        let t_s = step as f64 * 0.004;
        now = Timestamp::from_seconds(START_S + t_s);
        track.push(now, path.pose(t_s));
        if step % (STATE_S / 0.004) as u64 == 0 {
            fusion.vehicle(&state(path, t_s), &SampleHeader::at(now));
        }
        while let Some(frame) = rig.next_due(now) {
            let mut header = SampleHeader::at(frame.end);
            match frame.output {
                Output::Cloud => rig.render_cloud(&frame, world, &track, &mut cloud).unwrap(),
                Output::Scan => rig.render_scan(&frame, world, &track, &mut scan).unwrap(),
            }
            let mut times = 1;
            if frame.sensor == 0 {
                frames += 1;
                let sample = match frame.output {
                    Output::Cloud => SensorSample::Cloud(&mut cloud),
                    Output::Scan => SensorSample::Scan(&mut scan),
                };
                times = corrupt(frames, sample, &mut header);
            }
            for _ in 0..times {
                match frame.output {
                    Output::Cloud => fusion.cloud(frame.sensor, &cloud, &header),
                    Output::Scan => fusion.scan(frame.sensor, &scan, &header),
                }
                header.capture = header.capture.plus_seconds(0.001);
            }
            while let Some(finding) = fusion.next_finding() {
                findings.push((frames, finding));
            }
            adrift.extend(fusion.adrift_change().map(|is_adrift| (t_s, is_adrift)));
        }
    }
    FlightResult {
        findings,
        adrift,
        frames,
        fusion,
        now,
    }
}

/// The estimator's state of the vehicle: off by a slow drift of 0.3 m, and by a degree.
fn state(path: &FlightPath, t_s: f64) -> VehicleState {
    let (reset_s, right_s, velocity_off_mps) = path.reset;
    let is_reset = t_s >= reset_s;
    let estimate = |t_s: f64| {
        let pose = path.pose(t_s - path.late_s);
        let (runs_from_s, off_mps) = path.runs_off;
        let off = if t_s > runs_from_s && !is_reset {
            off_mps * (t_s - runs_from_s)
        } else {
            Vector3::zeros()
        };
        let drift = off + Vector3::new((0.6 * t_s).sin(), (0.5 * t_s).cos(), 0.3 * (0.4 * t_s).sin()) * 0.3;
        (pose.position.vector() + drift, pose.attitude)
    };
    let (position, attitude) = estimate(t_s);
    let (next, _) = estimate(t_s + 0.001);
    let off = UnitQuaternion::from_euler_angles(0.017 * (0.3 * t_s).sin(), 0.01, 0.017);
    let mut velocity_mps = (next - position) / 0.001;
    if is_reset && t_s < right_s {
        velocity_mps += velocity_off_mps;
    }
    VehicleState {
        position: Point::from_vector(position),
        velocity: Velocity::from_vector(velocity_mps),
        estimator_resets: u32::from(is_reset),
        attitude: Attitude::from_rotation(attitude * off),
        position_valid: Flag::YES,
        armed: Flag::YES,
        ..VehicleState::default()
    }
}
