//! The clouds that are measured with: of a synthetic lidar that sees all around, of the real products as the simulator renders them,
//! and of an Ouster with more points than a cloud holds, as its driver publishes it.

use crate::flight::{self, Motion, at};
use jink_lidar_driver::CloudAssembler;
use jink_lidar_driver::config::{CloudSpec, NoReturn, Returns};
use jink_lidar_driver::decode::{Echo, Ray};
use jink_runtime::config::sensor_sets;
use jink_shared_types::frames::{Mounting, Point};
use jink_shared_types::ranges::PointCloud;
use jink_shared_types::{SampleHeader, Timestamp};
use jink_simulated_world::random::Random;
use jink_simulated_world::sensors::{Output, PoseTrack, SensorRig, SensorSpec};
use jink_simulated_world::world::World;
use nalgebra::Vector3;
use serde::Deserialize;
use serde::de::IgnoredAny;

/// Longest range of the synthetic lidar (m): that of a Mid-360.
const SPHERE_RANGE_M: f64 = 40.0;
/// Scans per second of the synthetic lidar and of the large Ouster (Hz).
const RATE_HZ: f64 = 10.0;

/// One cloud and when it was complete.
pub struct Shot {
    /// The cloud.
    pub cloud: Box<PointCloud>,
    /// Its header: `capture` is the time of its last point.
    pub header: SampleHeader,
}

/// Clouds of one sensor along one flight.
pub struct Series {
    /// Its name in tables.
    pub name: String,
    /// How the vehicle moves.
    pub motion: Motion,
    /// Where it was at every moment.
    pub track: PoseTrack,
    /// How many clouds make one scan: 2 where a scan has more points than a cloud holds.
    pub clouds_per_scan: usize,
    /// The clouds, in order of time.
    pub shots: Vec<Shot>,
}

/// A sensor that can be measured with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A lidar that sees all around, with so many points per scan.
    Sphere(u32),
    /// A set of `config/sensors`.
    Product(&'static str),
    /// 128 rows by 2048 columns, as the driver publishes them.
    LargeOuster,
}

/// Every source by the name on the command line.
pub const SOURCES: [(&str, Source); 9] = [
    ("20k", Source::Sphere(20_000)),
    ("100k", Source::Sphere(100_000)),
    ("200k", Source::Sphere(200_000)),
    ("mid360", Source::Product("mid360")),
    ("os0", Source::Product("os0")),
    ("os1", Source::Product("os1")),
    ("vlp16", Source::Product("vlp16")),
    ("d435", Source::Product("d435")),
    ("2048x128", Source::LargeOuster),
];

/// The clouds of `source` on a flight of `seconds` through the forest of `seed`.
///
/// # Errors
/// A sentence that says what cannot be built.
pub fn series(name: &str, source: Source, seed: u64, seconds: f64) -> Result<Series, String> {
    let (world, motion) = flight::forest(seed)?;
    let longest_s = motion.longest_s();
    if seconds > longest_s {
        return Err(format!(
            "--seconds {seconds}: the flight of seed {seed} takes {longest_s} s"
        ));
    }
    let track = motion.track(seconds);
    let (shots, clouds_per_scan) = match source {
        Source::Sphere(points) => sphere(&world, &track, points, seed, seconds)?,
        Source::Product(set) => (rendered(&world, &track, &specs(set)?, seed, seconds)?, 1),
        Source::LargeOuster => (large_ouster(&world, &track, seed, seconds)?, 1),
    };
    Ok(Series {
        name: name.to_owned(),
        motion,
        track,
        clouds_per_scan,
        shots,
    })
}

/// A scan of more points than a cloud holds comes in two clouds of half the time each.
fn sphere(
    world: &World,
    track: &PoseTrack,
    points: u32,
    seed: u64,
    seconds: f64,
) -> Result<(Vec<Shot>, usize), String> {
    let parts = points.div_ceil(jink_shared_types::ranges::CLOUD_POINTS as u32);
    let mut specs = specs("sphere")?;
    for spec in &mut specs {
        spec.rays = Some(points / parts);
        spec.rate_hz = Some(RATE_HZ * f64::from(parts));
        spec.range_max_m = Some(SPHERE_RANGE_M);
    }
    Ok((rendered(world, track, &specs, seed, seconds)?, parts as usize))
}

/// The `[[sensor]]` tables of a set.
fn specs(set: &str) -> Result<Vec<SensorSpec>, String> {
    #[derive(Deserialize)]
    struct Tables {
        sensor: Vec<SensorSpec>,
        #[serde(rename = "params")]
        _params: Option<IgnoredAny>,
    }
    let set = sensor_sets::named(set).map_err(|error| error.to_string())?;
    let tables: Tables =
        toml::from_str(&set.text).map_err(|error| format!("{}: {error}", set.file.display()))?;
    Ok(tables.sensor)
}

fn rendered(
    world: &World,
    track: &PoseTrack,
    specs: &[SensorSpec],
    seed: u64,
    seconds: f64,
) -> Result<Vec<Shot>, String> {
    let mut rig = SensorRig::new(specs, seed).map_err(|error| error.to_string())?;
    let mut shots = Vec::new();
    let steps = (seconds / flight::STEP_S).round() as u32;
    for step in 0..=steps {
        while let Some(frame) = rig.next_due(at(f64::from(step) * flight::STEP_S)) {
            if frame.output != Output::Cloud {
                continue;
            }
            let mut cloud = PointCloud::boxed();
            rig.render_cloud(&frame, world, track, &mut cloud)
                .map_err(|error| error.to_string())?;
            shots.push(Shot {
                cloud,
                header: SampleHeader::at(frame.end),
            });
        }
    }
    Ok(shots)
}

/// An OS1 with 128 rows in mode 2048x10: 262,144 directions, of which its driver publishes the nearer of every two columns.
fn large_ouster(world: &World, track: &PoseTrack, seed: u64, seconds: f64) -> Result<Vec<Shot>, String> {
    const ROWS: u16 = 128;
    const COLUMNS: u32 = 2_048;
    const RANGE_M: f64 = 90.0;
    const ELEVATION_RAD: f64 = 22.5 * std::f64::consts::PI / 180.0;
    const SIGMA_M: f64 = 0.015;
    let mut random = Random::new(seed, 1);
    let spec = CloudSpec {
        position: Point::ZERO,
        mounting: Mounting::default(),
        range_min_m: 0.3,
        range_max_m: RANGE_M as f32,
        sigma_m: SIGMA_M as f32,
        no_return: NoReturn::Clear,
        returns: Returns::Nearest,
        strongest: 0,
        blind: Vec::new(),
    };
    let mut assembler = CloudAssembler::new(spec, Some((usize::from(ROWS) * COLUMNS as usize, 1)));
    let mut shots = Vec::new();
    for scan in 0..(seconds * RATE_HZ) as u32 {
        for column in 0..COLUMNS {
            let t_s = (f64::from(scan) + f64::from(column) / f64::from(COLUMNS)) / RATE_HZ;
            let pose = track.at(at(t_s)).ok_or("there is no pose")?;
            assembler.packet(at(t_s), at(t_s));
            let azimuth_rad = std::f64::consts::TAU * f64::from(column) / f64::from(COLUMNS);
            for row in 0..ROWS {
                let elevation_rad = ELEVATION_RAD * (1.0 - 2.0 * f64::from(row) / f64::from(ROWS - 1));
                let level = elevation_rad.cos();
                // The sensor frame is x forward, y left, z up.
                let direction = Vector3::new(
                    level * azimuth_rad.cos(),
                    -level * azimuth_rad.sin(),
                    elevation_rad.sin(),
                );
                let body = Vector3::new(direction.x, -direction.y, -direction.z);
                let hit = world.cast(pose.position, &(pose.attitude * body), RANGE_M);
                let range_m = hit.map_or(0.0, |hit| (hit.range_m + SIGMA_M * random.normal()).max(0.3));
                let ray = Ray {
                    row,
                    column,
                    stamp_ns: 0,
                    range_m: range_m as f32,
                    base_m: [0.0; 3],
                    direction: direction.cast::<f32>().into(),
                    echo: Echo::ONLY,
                };
                assembler.ray(at(t_s), &ray);
            }
        }
        shots.push(taken(&mut assembler));
    }
    Ok(shots)
}

/// The cloud of `assembler`, which begins the next one.
pub fn taken(assembler: &mut CloudAssembler) -> Shot {
    let mut cloud = PointCloud::boxed();
    assembler.write(&mut cloud);
    let header = assembler.header();
    assembler.clear();
    Shot { cloud, header }
}

/// The moments of vehicle states (s after the start) that are due after `from` and by `until`.
pub fn states_between(from: Timestamp, until: Timestamp) -> impl Iterator<Item = f64> {
    let number = |time: Timestamp| (time.seconds_since(at(0.0)) * flight::STATES_HZ + 1e-6).floor() as i64;
    let first = if from.is_set() { number(from) + 1 } else { 0 };
    (first..=number(until)).map(|number| number as f64 / flight::STATES_HZ)
}
