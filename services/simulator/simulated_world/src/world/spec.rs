//! Which world to build: its kind, its seed, and the errors of a wrong request.

use jink_shared_types::suggestion::{DidYouMean, nearest};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Trees per square metre of the default forest: the densest of the published Poisson forests (1/49, 1/36, 1/25).
pub const DEFAULT_DENSITY_PER_M2: f64 = 1.0 / 25.0;

/// Densest forest offered (trees/m2): half of its maps have no way through. At 0.25 it is 19 of 20, so that the few
/// maps that pass would be no sample of a Poisson forest any more.
pub const MAX_DENSITY_PER_M2: f64 = 0.2;

/// The kinds of world.
#[derive(Clone, Debug, PartialEq)]
pub enum WorldKind {
    /// Trees placed by a homogeneous Poisson process, 60 m by 30 m.
    Forest {
        /// Trees per square metre, above 0 and at most [`MAX_DENSITY_PER_M2`].
        density_per_m2: f64,
    },
    /// A wall across the way with one gap of 2 m.
    Gap,
    /// Two parallel walls with boxes alternating on both sides.
    Corridor,
    /// A U-shaped wall, open towards the start, across the straight line to the goal.
    UTrap,
    /// The corridor of a real building, 2.5 m wide and high, with what stands and hangs in it (worlds/README.md).
    Building,
    /// Ground only.
    Empty,
    /// A file of the user's own ([`super::file`]).
    File(PathBuf),
    /// One that planners are compared in.
    Benchmark(Benchmark),
}

/// Worlds that follow those of published comparisons of planners: as closed as there, and as narrow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Benchmark {
    /// A forest like [`WorldKind::Forest`] that a disc of 0.35 m can pass, however narrow that is for a larger one.
    Forest {
        /// Trees per square metre, as there.
        density_per_m2: f64,
    },
    /// A U-shaped wall across the way, 6 to 10 m wide.
    Trap {
        /// Its depth (m).
        depth_m: f64,
    },
    /// A maze of 20 m by 20 m, divided again and again, from one corner to the opposite one; its corridors are 2 m wide.
    Maze,
    /// A trap 12 m deep and wide whose mouth is half as wide.
    Bugtrap,
    /// 40 m by 20 m of rooms of 4 to 6 m with doors of 0.9 m, under a ceiling.
    Office,
    /// A wall across the way with one gap.
    Gap {
        /// Width of the gap (m).
        width_m: f64,
    },
    /// A wall across the way with one horizontal slot of 1.2 m.
    Slot,
    /// A corridor around a corner, with a box right behind it.
    Corner,
    /// A forest of 40 m by 20 m with 1/36 trees/m2: what moves in it is added by whoever flies.
    Glade,
}

impl Benchmark {
    /// Its name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Forest { .. } => "forest",
            Self::Trap { .. } => "trap",
            Self::Maze => "maze",
            Self::Bugtrap => "bugtrap",
            Self::Office => "office",
            Self::Gap { .. } => "gap",
            Self::Slot => "slot",
            Self::Corner => "corner",
            Self::Glade => "glade",
        }
    }
}

impl WorldKind {
    /// The name on the command line and in JSON.
    pub fn name(&self) -> &str {
        match self {
            Self::File(file) => file.to_str().unwrap_or("file"),
            Self::Benchmark(benchmark) => benchmark.name(),
            Self::Forest { .. } => "forest",
            Self::Gap => "gap",
            Self::Corridor => "corridor",
            Self::UTrap => "utrap",
            Self::Building => "building",
            Self::Empty => "empty",
        }
    }

    /// Trees per square metre, of a forest.
    pub fn density_per_m2(&self) -> Option<f64> {
        match self {
            Self::Forest { density_per_m2 } | Self::Benchmark(Benchmark::Forest { density_per_m2 }) => {
                Some(*density_per_m2)
            }
            _ => None,
        }
    }

    /// Every kind that has a name, with its default parameters.
    pub const ALL: [Self; 6] = [
        Self::Forest {
            density_per_m2: DEFAULT_DENSITY_PER_M2,
        },
        Self::Gap,
        Self::Corridor,
        Self::UTrap,
        Self::Building,
        Self::Empty,
    ];
}

impl FromStr for WorldKind {
    type Err = WorldError;

    fn from_str(text: &str) -> Result<Self, WorldError> {
        if text.ends_with(".toml") {
            return Ok(Self::File(PathBuf::from(text)));
        }
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == text)
            .ok_or_else(|| WorldError::UnknownKind {
                name: text.to_owned(),
            })
    }
}

/// A world as a user asks for it.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldSpec {
    /// Kind.
    pub kind: WorldKind,
    /// Seed: the same one gives the same world, to the bit.
    pub seed: u64,
    /// Trees per square metre instead of the kind's own; only a forest has any.
    pub density_per_m2: Option<f64>,
}

impl WorldSpec {
    /// The kind with the optional fields applied.
    ///
    /// # Errors
    /// [`WorldError::DensityWithoutTrees`] if a density is given for a world that has no trees.
    pub fn resolved_kind(&self) -> Result<WorldKind, WorldError> {
        match (&self.kind, self.density_per_m2) {
            (kind, None) => Ok(kind.clone()),
            (WorldKind::Forest { .. }, Some(density_per_m2)) => Ok(WorldKind::Forest { density_per_m2 }),
            (kind, Some(_)) => Err(WorldError::DensityWithoutTrees {
                kind: kind.name().to_owned(),
            }),
        }
    }
}

/// Why a world cannot be built.
#[derive(Clone, Debug, PartialEq)]
pub enum WorldError {
    /// No kind has this name.
    UnknownKind {
        /// The name given.
        name: String,
    },
    /// The forest's density is no number, not positive, or too large.
    DensityOutOfRange {
        /// The density given (trees/m2).
        density_per_m2: f64,
    },
    /// A density for a world without trees.
    DensityWithoutTrees {
        /// Name of the kind.
        kind: String,
    },
    /// A file of a world, or of what stands in it, cannot be used.
    File {
        /// The file; empty where the message names it.
        file: String,
        /// Why.
        message: String,
    },
    /// Every world of this kind that was drawn was closed.
    Closed {
        /// Name of the kind.
        kind: String,
        /// Worlds drawn.
        draws: u32,
    },
    /// Every forest drawn was closed.
    NoWayThrough {
        /// The density asked for (trees/m2).
        density_per_m2: f64,
        /// Forests drawn.
        draws: u32,
    },
}

impl WorldError {
    /// Whether the density is what is wrong.
    pub fn is_about_density(&self) -> bool {
        matches!(
            self,
            Self::DensityOutOfRange { .. } | Self::DensityWithoutTrees { .. } | Self::NoWayThrough { .. }
        )
    }
}

impl fmt::Display for WorldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownKind { name } => {
                let kinds = WorldKind::ALL;
                let names: Vec<&str> = kinds.iter().map(WorldKind::name).collect();
                let near = DidYouMean(nearest(name, names.iter().copied()));
                let names = names.join(", ");
                write!(
                    f,
                    "no world is called \"{name}\"; there are {names}, and files that end in .toml{near}"
                )
            }
            Self::DensityOutOfRange { density_per_m2 } => write!(
                f,
                "a forest of {density_per_m2} trees/m2 cannot be drawn: more than 0, at most {MAX_DENSITY_PER_M2}"
            ),
            Self::DensityWithoutTrees { kind } => {
                write!(f, "the world \"{kind}\" has no trees, so it takes no density")
            }
            Self::File { file, message } if file.is_empty() => f.write_str(message),
            Self::File { file, message } => write!(f, "{file}: {message}"),
            Self::Closed { kind, draws } => write!(f, "none of {draws} worlds \"{kind}\" has a way through"),
            Self::NoWayThrough {
                density_per_m2,
                draws,
            } => write!(
                f,
                "none of {draws} forests of {density_per_m2} trees/m2 has a way through"
            ),
        }
    }
}

impl std::error::Error for WorldError {}
