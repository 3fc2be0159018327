//! The ring sector by sector, with the directions turned to local NED.

use jink_shared_types::Timestamp;
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS, SectorRing, sector_bearing_rad, sector_of};
use nalgebra::Vector2;

/// Distances that differ by less are equal (m): rounding must not choose between two obstacles.
const ALIKE_M: f64 = 1e-3;

/// What is known of a sector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SectorState {
    /// Nothing.
    Unknown,
    /// No obstacle within the sensor's reach.
    Clear {
        /// That reach (m).
        reach_m: f64,
    },
    /// An obstacle.
    Hit {
        /// Its horizontal distance (m).
        distance_m: f64,
        /// How long ago it was measured (s).
        age_s: f64,
    },
}

impl SectorState {
    /// How far it is known (m): to the obstacle, or as far as the sensor reaches. `None`: not at all.
    pub fn reach_m(&self) -> Option<f64> {
        match *self {
            SectorState::Unknown => None,
            SectorState::Clear { reach_m } => Some(reach_m),
            SectorState::Hit { distance_m, .. } => Some(distance_m),
        }
    }
}

/// All sectors at one time.
#[derive(Clone, Debug)]
pub struct SectorStates {
    /// Heading of the vehicle (rad).
    pub yaw_rad: f64,
    /// The sectors.
    pub states: [SectorState; SECTORS],
    /// Directions of their centres, north and east.
    pub directions: [Vector2<f64>; SECTORS],
    /// Shortest range that any sensor measures (m).
    pub range_min_m: f64,
}

impl SectorStates {
    /// The sectors of `ring` at `now`: all unknown, if it does not say where its sectors point.
    pub fn of(ring: &SectorRing, now: Timestamp) -> Self {
        let heading_rad = ring.attitude.yaw_rad();
        let is_oriented = heading_rad.is_finite();
        let yaw_rad = if is_oriented { heading_rad } else { 0.0 };
        Self {
            yaw_rad,
            states: std::array::from_fn(|sector| match is_oriented {
                true => state_of(ring, sector, now),
                false => SectorState::Unknown,
            }),
            directions: std::array::from_fn(|sector| {
                let (east, north) = (yaw_rad + sector_bearing_rad(sector)).sin_cos();
                Vector2::new(north, east)
            }),
            range_min_m: f64::from(ring.range_min_m.max(0.0)),
        }
    }

    /// Whether anything is known at all.
    pub fn has_data(&self) -> bool {
        self.states.iter().any(|state| *state != SectorState::Unknown)
    }

    /// Every known sector: its number, its direction, how far it is known (m).
    pub fn known(&self) -> impl Iterator<Item = (usize, Vector2<f64>, f64)> + '_ {
        self.states
            .iter()
            .enumerate()
            .filter_map(|(sector, state)| Some((sector, self.directions[sector], state.reach_m()?)))
    }

    /// The sector that ends first, and where (m): the first of equals, as in PX4.
    pub fn nearest(&self) -> Option<(usize, f64)> {
        self.known()
            .map(|(sector, _, reach_m)| (sector, reach_m))
            .reduce(|nearest, other| {
                if other.1 < nearest.1 - ALIKE_M {
                    other
                } else {
                    nearest
                }
            })
    }

    /// The sector that holds a direction.
    pub fn sector_toward(&self, direction: &Vector2<f64>) -> usize {
        sector_of(self.bearing_rad(direction))
    }

    /// The two sectors whose centres enclose a direction, and the share of the angle from the first to the second.
    pub fn between(&self, direction: &Vector2<f64>) -> (usize, usize, f64) {
        let sectors = (self.bearing_rad(direction) / SECTOR_WIDTH_RAD).rem_euclid(SECTORS as f64);
        let before = sectors.floor();
        let sector = before as usize % SECTORS;
        (sector, (sector + 1) % SECTORS, sectors - before)
    }

    /// A direction as an angle from the nose, clockwise (rad).
    pub fn bearing_rad(&self, direction: &Vector2<f64>) -> f64 {
        direction.y.atan2(direction.x) - self.yaw_rad
    }
}

fn state_of(ring: &SectorRing, sector: usize, now: Timestamp) -> SectorState {
    let distance_m = f64::from(ring.distance_m[sector]);
    let reach_m = f64::from(ring.range_max_m[sector]);
    if distance_m.is_nan() {
        SectorState::Unknown
    } else if distance_m.is_finite() {
        SectorState::Hit {
            distance_m: distance_m.max(0.0),
            age_s: now.seconds_since(ring.seen[sector]).max(0.0),
        }
    } else if reach_m > 0.0 && reach_m.is_finite() {
        SectorState::Clear { reach_m }
    } else {
        SectorState::Unknown
    }
}
