//! Worlds that users write: a file of their own with solids, meshes and maps.
//!
//! ```toml
//! # Where it is flown to, in order: north, east, up of the start (m). The start is the local origin, on the ground.
//! goals = [[30, 0, 1.5]]
//! # Height of the take-off (m); without it 2.5
//! flight_height_m = 1.5
//!
//! [[cylinder]]
//! north_m = 5.0
//! east_m = 1.0
//! radius_m = 0.3
//! top_m = 6.0
//!
//! [[box]]
//! north_m = 12.0
//! east_m = -2.0
//! length_m = 3.0        # along yaw_deg, clockwise from north
//! width_m = 0.3
//! yaw_deg = 90.0
//! bottom_m = 0.0
//! top_m = 2.0
//!
//! [[sphere]]
//! north_m = 20.0
//! east_m = 0.0
//! up_m = 2.0
//! radius_m = 0.5
//!
//! # Triangles of an STL file, or occupied cells of an OctoMap (.bt); x of the file points along yaw_deg, z up
//! [[structure]]
//! file = "hall.stl"     # beside this file
//! north_m = 0.0
//! east_m = 0.0
//! up_m = 0.0
//! yaw_deg = 0.0
//! scale = 1.0           # metres per unit of the file (STL only)
//! ```

use super::octomap::Octomap;
use super::solids::{Cylinder, Obstacle, Sphere, YawedBox};
use super::structure::{Placement, Structure};
use super::{Bounds, FLIGHT_HEIGHT_M, Scene, World, WorldError, stl};
use jink_shared_types::Point;
use serde::Deserialize;
use std::path::Path;

/// How far from the local origin things may stand (m), and how large they may be.
const FAR_M: f64 = 10_000.0;
/// What belongs to the world around start and goals (m).
const MARGIN_M: f64 = 15.0;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    goals: Vec<[f64; 3]>,
    flight_height_m: Option<f64>,
    #[serde(default)]
    cylinder: Vec<Cylinder>,
    #[serde(default, rename = "box")]
    boxes: Vec<WrittenBox>,
    #[serde(default)]
    sphere: Vec<Sphere>,
    #[serde(default)]
    structure: Vec<WrittenStructure>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenBox {
    north_m: f64,
    east_m: f64,
    length_m: f64,
    width_m: f64,
    #[serde(default)]
    yaw_deg: f64,
    #[serde(default)]
    bottom_m: f64,
    top_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenStructure {
    file: String,
    #[serde(default)]
    north_m: f64,
    #[serde(default)]
    east_m: f64,
    #[serde(default)]
    up_m: f64,
    #[serde(default)]
    yaw_deg: f64,
    scale: Option<f64>,
}

/// Reads the world in `file`; `seed` only goes with it.
pub(super) fn read(file: &Path, seed: u64) -> Result<World, WorldError> {
    let text = std::fs::read_to_string(file).map_err(|error| wrong(file, &error.to_string()))?;
    let written: File = jink_runtime::config::parse_toml(file, &text).map_err(|error| WorldError::File {
        file: String::new(),
        message: error.to_string(),
    })?;
    written.check(file)?;
    let mut structures = Vec::new();
    for structure in &written.structure {
        structures.push(structure.read(file)?);
    }
    let goals: Vec<_> = written
        .goals
        .iter()
        .map(|[north_m, east_m, up_m]| Point::new(*north_m, *east_m, -up_m))
        .collect();
    let places = written.goals.iter().chain([&[0.0; 3]]);
    let extent =
        |axis: usize, pick: fn(f64, f64) -> f64| places.clone().map(|place| place[axis]).fold(0.0, pick);
    let bounds = Bounds {
        north_min_m: extent(0, f64::min) - MARGIN_M,
        north_max_m: extent(0, f64::max) + MARGIN_M,
        east_min_m: extent(1, f64::min) - MARGIN_M,
        east_max_m: extent(1, f64::max) + MARGIN_M,
        up_max_m: extent(2, f64::max) + MARGIN_M,
    };
    let boxes = written.boxes.iter().map(|one| {
        let yaw_rad = one.yaw_deg.to_radians();
        let solid = YawedBox::new(
            one.north_m,
            one.east_m,
            one.length_m,
            one.width_m,
            yaw_rad,
            one.top_m,
        );
        Obstacle::Box(solid.raised(one.bottom_m))
    });
    let obstacles = boxes
        .chain(written.cylinder.iter().copied().map(Obstacle::Cylinder))
        .chain(written.sphere.iter().copied().map(Obstacle::Sphere));
    let name = file
        .file_stem()
        .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    Ok(World::new(Scene {
        name,
        seed,
        goals,
        bounds,
        flight_height_m: written.flight_height_m.unwrap_or(FLIGHT_HEIGHT_M),
        obstacles: obstacles.collect(),
        structures,
    }))
}

fn wrong(file: &Path, message: &str) -> WorldError {
    WorldError::File {
        file: file.display().to_string(),
        message: message.to_owned(),
    }
}

impl File {
    /// Every number is one, sizes are positive, tops above bottoms.
    fn check(&self, file: &Path) -> Result<(), WorldError> {
        let places = self.goals.iter().flatten().copied().chain(self.flight_height_m);
        let mut places: Vec<f64> = places.collect();
        let mut sizes: Vec<f64> = self.flight_height_m.into_iter().collect();
        for one in &self.cylinder {
            places.extend([one.north_m, one.east_m]);
            sizes.extend([one.radius_m, one.top_m]);
        }
        for one in &self.boxes {
            places.extend([one.north_m, one.east_m, one.yaw_deg, one.bottom_m]);
            sizes.extend([one.length_m, one.width_m, one.top_m - one.bottom_m]);
        }
        for one in &self.sphere {
            places.extend([one.north_m, one.east_m, one.up_m]);
            sizes.push(one.radius_m);
        }
        for one in &self.structure {
            places.extend([one.north_m, one.east_m, one.up_m, one.yaw_deg]);
            sizes.extend(one.scale);
        }
        if self.goals.is_empty() {
            return Err(wrong(file, "there are no goals in it"));
        }
        if let Some(place) = places.iter().find(|place| !(-FAR_M..=FAR_M).contains(*place)) {
            return Err(wrong(file, &format!("{place} is too far away, or no number")));
        }
        match sizes.iter().find(|size| !(**size > 0.0 && **size <= FAR_M)) {
            None => Ok(()),
            Some(size) => Err(wrong(
                file,
                &format!("{size} is no size: more than 0, tops above bottoms"),
            )),
        }
    }
}

impl WrittenStructure {
    fn read(&self, world: &Path) -> Result<Structure, WorldError> {
        let path = world.parent().unwrap_or(Path::new("")).join(&self.file);
        let name = path.display().to_string();
        let bytes = std::fs::read(&path).map_err(|error| wrong(&path, &error.to_string()))?;
        let place = Placement {
            north_m: self.north_m,
            east_m: self.east_m,
            up_m: self.up_m,
            yaw_rad: self.yaw_deg.to_radians(),
        };
        let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
        match extension.as_ref().and_then(|extension| extension.to_str()) {
            Some("bt") if self.scale.is_none() => Ok(Structure::cells(Octomap::parse(&name, &bytes)?, place)),
            Some("bt") => Err(wrong(
                &path,
                "an OctoMap says itself how large it is: it takes no scale",
            )),
            Some("stl") => {
                let scale = self.scale.unwrap_or(1.0);
                let mut triangles = stl::parse(&name, &bytes)?;
                for number in triangles.iter_mut().flatten().flatten() {
                    *number *= scale;
                }
                Structure::mesh(triangles, place).map_err(|message| wrong(&path, &message))
            }
            _ => Err(wrong(&path, "structures are .stl (meshes) or .bt (OctoMaps)")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::read;
    use crate::world::Target;
    use jink_testkit::temp_folder::TempFolder;
    use nalgebra::Vector3;

    const WALL: &str =
        "solid wall\nvertex 5 -2 0\nvertex 5 2 0\nvertex 5 2 4\nvertex 5 -2 0\nvertex 5 2 4\nvertex 5 -2 4\n";

    #[test]
    fn a_world_of_the_users_own_has_all_that_stands_in_it() {
        let folder = TempFolder::new("world_own");
        folder.write("wall.stl", WALL);
        let file = folder.write(
            "yard.toml",
            "goals = [[30, 0, 1.5]]\nflight_height_m = 1.5\n\
             [[box]]\nnorth_m = 12\neast_m = 0\nlength_m = 4\nwidth_m = 1\nbottom_m = 1\ntop_m = 2\n\
             [[structure]]\nfile = \"wall.stl\"\nnorth_m = 15\nscale = 1.0\n",
        );
        let world = read(&file, 3).unwrap();
        assert_eq!(
            (world.name(), world.seed(), world.flight_height_m()),
            ("yard", 3, 1.5)
        );
        let north = Vector3::new(1.0, 0.0, 0.0);
        let range = |up: f64| {
            let from = jink_shared_types::Point::new(0.0, 0.0, -up);
            world.cast(from, &north, 50.0).map(|hit| (hit.range_m, hit.what))
        };
        assert_eq!(range(1.5), Some((10.0, Target::Obstacle(0))));
        let (wall_m, what) = range(0.5).unwrap();
        assert!((wall_m - 20.0).abs() < 1e-9 && what == Target::Structure(0));
        assert_eq!(range(4.5), None);
        let beside = jink_shared_types::Point::new(20.0, 3.0, -1.0);
        assert!((world.clearance_to_obstacles_m(beside) - 1.0).abs() < 1e-9);
        assert!(
            world.json()["boxes"].as_array().unwrap().len() >= 2,
            "the wall is drawn"
        );
    }

    #[test]
    fn every_mistake_is_one_sentence_with_the_file() {
        let folder = TempFolder::new("world_wrong");
        folder.write("wall.stl", "nonsense");
        let cases = [
            ("goals = []\n", "world.toml: there are no goals in it"),
            ("goals = [[30, 0, 1]]\n[[box]]\nnorth_m = 1\n", "world.toml:2: "),
            ("goals = [[30, 0, 1]]\nspeed = 3\n", "world.toml:2: "),
            ("goals = [[30, 0, nan]]\n", "too far away, or no number"),
            (
                "goals = [[30, 0, 1]]\n[[sphere]]\nnorth_m = 1\neast_m = 1\nup_m = 1\nradius_m = 0\n",
                "0 is no size",
            ),
            (
                "goals = [[30, 0, 1]]\n[[structure]]\nfile = \"wall.stl\"\n",
                "wall.stl: it is no STL file",
            ),
            (
                "goals = [[30, 0, 1]]\n[[structure]]\nfile = \"hall.stl\"\n",
                "hall.stl: No such file",
            ),
            (
                "goals = [[30, 0, 1]]\n[[structure]]\nfile = \"hall.obj\"\n",
                "hall.obj: ",
            ),
        ];
        for (text, words) in cases {
            let error = read(&folder.write("world.toml", text), 1)
                .unwrap_err()
                .to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
