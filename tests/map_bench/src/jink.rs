//! Jink's map, as its process runs it, and what the planner makes of each map, measured by stage.

use crate::clouds::{Series, states_between};
use crate::flight::at;
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_planner::configuration_space::{Clearance, ConfigurationSpace};
use jink_planner::speed_tiers::{TIERS, speed_tiers};
use jink_shared_types::map::LocalMap;
use jink_shared_types::params::ParamSet;
use jink_shared_types::tracking::Tracking;
use jink_shared_types::{SampleHeader, Timestamp};
use rustix::time::{ClockId, clock_gettime};
use std::time::Instant;

/// Stages of a map update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// The cloud's rays are entered and count as evidence: in the fusion process.
    Insert,
    /// The map is written into a sample: in the fusion process.
    Write,
    /// The planner takes the map over and inflates it for the highest speed tier: in the planner's process.
    Inflate,
    /// The same for the other speed tiers, which most plans do not need.
    InflateOthers,
}

impl Stage {
    /// All of them, in order.
    pub const ALL: [Self; 4] = [Self::Insert, Self::Write, Self::Inflate, Self::InflateOthers];

    /// Its name in tables and in JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Insert => "insert",
            Self::Write => "write",
            Self::Inflate => "inflate",
            Self::InflateOthers => "inflate_others",
        }
    }
}

/// How long something took (ms).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Took {
    /// By the wall clock.
    pub wall_ms: f64,
    /// CPU time of the thread, which other programs do not lengthen.
    pub cpu_ms: f64,
}

impl std::ops::AddAssign for Took {
    fn add_assign(&mut self, other: Self) {
        self.wall_ms += other.wall_ms;
        self.cpu_ms += other.cpu_ms;
    }
}

/// What came of a series.
pub struct Run {
    /// Of every scan, of every repeat: what each of [`Stage::ALL`] took.
    pub scans: Vec<[Took; Stage::ALL.len()]>,
    /// The map after the last scan.
    pub map: Box<LocalMap>,
    /// Smallest cell of the window at each cloud.
    pub windows: Vec<[i32; 3]>,
}

/// Enters the clouds of `series` into `repeats` maps, one after the other.
pub fn run(series: &Series, params: &ParamSet, repeats: u32) -> Run {
    let mut run = Run {
        scans: Vec::new(),
        map: LocalMap::boxed(),
        windows: Vec::new(),
    };
    let limits = speed_tiers(params, &Tracking::PX4_TRAJECTORY);
    for _ in 0..repeats {
        let mut fusion = Fusion::new(FusionConfig::from_params(params, 1));
        let mut space = ConfigurationSpace::new(&limits, Clearance::from_params(params));
        let mut stated = Timestamp::NEVER;
        run.windows.clear();
        for scan in series.shots.chunks(series.clouds_per_scan) {
            let mut took = [Took::default(); Stage::ALL.len()];
            for shot in scan {
                let capture = shot.header.capture;
                for t_s in states_between(stated, capture) {
                    fusion.vehicle(&series.motion.state(t_s), &SampleHeader::at(at(t_s)));
                }
                stated = capture;
                took[0] += timed(|| fusion.cloud(0, &shot.cloud, &shot.header));
                took[1] += timed(|| fusion.write(capture, &mut run.map));
                took[2] += timed(|| {
                    space.load(&run.map);
                    space.prepare(0);
                });
                took[3] += timed(|| (1..TIERS).for_each(|tier| space.prepare(tier)));
                run.windows.push(run.map.min_cell);
            }
            run.scans.push(took);
        }
    }
    run
}

fn timed(work: impl FnOnce()) -> Took {
    let cpu = cpu_ms();
    let wall = Instant::now();
    work();
    Took {
        wall_ms: wall.elapsed().as_secs_f64() * 1e3,
        cpu_ms: cpu_ms() - cpu,
    }
}

/// CPU time of this thread so far (ms).
fn cpu_ms() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}
