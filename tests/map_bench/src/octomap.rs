//! OctoMap (Hornung et al., "OctoMap: an efficient probabilistic 3D mapping framework based on octrees", 2013), measured with the same
//! clouds: a small C++ program, compiled when it is needed.

use crate::clouds::Series;
use crate::jink::Took;
use crate::rays::{local_rays, middle_m, reach_m};
use jink_shared_types::map::{CELL_M, CELLS, SIZE_X, SIZE_Y, SIZE_Z};
use jink_shared_types::params::ParamSet;
use nalgebra::Vector3;
use std::path::{Path, PathBuf};
use std::process::Command;

const SOURCE: &str = include_str!("../../octomap/insert.cpp");
/// Rays without an answer are lengthened by this: OctoMap then frees them up to the maximum range and puts no obstacle at their end.
const BEYOND: f64 = 2.0;
/// Bytes of the times of one cloud.
const TIMES_BYTES: usize = 16;

/// The compiled program, in a folder of its own that goes with it.
pub struct OctoMap {
    folder: PathBuf,
}

/// Occupancy of a cell in OctoMap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occupancy {
    /// Never seen.
    Unknown,
    /// Below the threshold.
    Free,
    /// Above the threshold.
    Occupied,
}

/// What came of a series.
pub struct Run {
    /// `insertPointCloud` as its defaults are, of every cloud.
    pub clouds: Vec<Took>,
    /// Cells of the window, x fastest, from its smallest.
    pub cells: Vec<Occupancy>,
}

impl Drop for OctoMap {
    fn drop(&mut self) {
        let _gone_already = std::fs::remove_dir_all(&self.folder);
    }
}

impl OctoMap {
    /// Compiles the program.
    ///
    /// # Errors
    /// A sentence that says what is missing, with the name of the Debian package.
    pub fn compile() -> Result<Self, String> {
        let folder = std::env::temp_dir().join(format!("jink-octomap-{}", std::process::id()));
        std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        let octomap = Self { folder };
        let source = octomap.path("insert.cpp");
        std::fs::write(&source, SOURCE).map_err(|error| format!("{}: {error}", source.display()))?;
        let output = Command::new("c++")
            .args(["-std=c++17", "-O3", "-o"])
            .arg(octomap.path("insert"))
            .arg(&source)
            .args(["-loctomap", "-loctomath"])
            .output()
            .map_err(|error| {
                format!("c++ does not start ({error}): apt install build-essential liboctomap-dev")
            })?;
        if output.status.success() {
            return Ok(octomap);
        }
        let said = String::from_utf8_lossy(&output.stderr);
        let missing = ["octomap/octomap.h", "octomap/OcTree.h", "-loctomap"];
        if missing.iter().any(|part| said.contains(part)) {
            return Err("the library of OctoMap is missing: apt install liboctomap-dev".to_owned());
        }
        let first = said
            .lines()
            .find(|line| line.contains("error"))
            .unwrap_or_default();
        Err(format!("c++ does not compile the program with OctoMap: {first}"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Enters the clouds of `series` into a tree, and looks the cells of the window at `min_cell` up.
    ///
    /// # Errors
    /// A sentence that says what failed.
    pub fn run(&self, series: &Series, params: &ParamSet, min_cell: [i32; 3]) -> Result<Run, String> {
        let (input, output) = (self.path("input"), self.path("output"));
        let cannot = |path: &Path, error: std::io::Error| format!("{}: {error}", path.display());
        std::fs::write(&input, encoded(series, params, min_cell)).map_err(|error| cannot(&input, error))?;
        let program = self.path("insert");
        let done = Command::new(&program)
            .args([&input, &output])
            .output()
            .map_err(|error| cannot(&program, error))?;
        if !done.status.success() {
            return Err(format!(
                "the program with OctoMap failed ({}): {}",
                done.status,
                String::from_utf8_lossy(&done.stderr).trim()
            ));
        }
        let bytes = std::fs::read(&output).map_err(|error| cannot(&output, error))?;
        decoded(&bytes, series.shots.len()).ok_or_else(|| {
            format!(
                "{}: {} bytes are not what was asked for",
                output.display(),
                bytes.len()
            )
        })
    }
}

fn encoded(series: &Series, params: &ParamSet, min_cell: [i32; 3]) -> Vec<u8> {
    // One sensor: every cloud of it has the same range.
    let range_m = series.shots.first().map_or(0.0, |shot| reach_m(shot, params));
    let mut bytes = Vec::new();
    bytes.extend(CELL_M.to_le_bytes());
    bytes.extend(range_m.to_le_bytes());
    for value in min_cell {
        bytes.extend(value.to_le_bytes());
    }
    for value in [SIZE_X, SIZE_Y, SIZE_Z] {
        bytes.extend((value as i32).to_le_bytes());
    }
    bytes.extend((series.shots.len() as u32).to_le_bytes());
    let put = |bytes: &mut Vec<u8>, point: Vector3<f64>| {
        for value in point.iter() {
            bytes.extend((*value as f32).to_le_bytes());
        }
    };
    for shot in &series.shots {
        let origin_m = middle_m(series, shot);
        put(&mut bytes, origin_m);
        let count_at = bytes.len();
        bytes.extend([0; 4]);
        let mut count = 0u32;
        for ray in local_rays(series, shot, params) {
            let scale = if ray.is_hit { 1.0 } else { BEYOND };
            put(&mut bytes, origin_m + (ray.end_m - origin_m) * scale);
            count += 1;
        }
        bytes[count_at..count_at + 4].copy_from_slice(&count.to_le_bytes());
    }
    bytes
}

fn decoded(bytes: &[u8], clouds: usize) -> Option<Run> {
    if bytes.len() != clouds * TIMES_BYTES + CELLS {
        return None;
    }
    let (times, cells) = bytes.split_at(clouds * TIMES_BYTES);
    let ms = |bytes: &[u8]| {
        bytes
            .try_into()
            .map_or(f64::NAN, |ns| u64::from_le_bytes(ns) as f64 * 1e-6)
    };
    let took = |bytes: &[u8]| Took {
        wall_ms: ms(&bytes[..8]),
        cpu_ms: ms(&bytes[8..]),
    };
    Some(Run {
        clouds: times.chunks_exact(TIMES_BYTES).map(took).collect(),
        cells: cells
            .iter()
            .map(|cell| match cell {
                2 => Occupancy::Occupied,
                1 => Occupancy::Free,
                _ => Occupancy::Unknown,
            })
            .collect(),
    })
}
