//! What the system saw on its way: occupied cells of the local map near the height of flight.

use jink_runtime::{Input, OpenError, Session};
use jink_shared_types::map::{self, LocalMap, SIZE_X, SIZE_Y};
use jink_shared_types::{LocalNed, Point, topics};
use std::collections::BTreeSet;
use std::time::{Duration, Instant};

/// The window slides by a few metres in this time, and it is 25 m wide.
const PERIOD: Duration = Duration::from_millis(500);
/// Cells above and below the vehicle's own that count.
const BAND_CELLS: i32 = 2;
/// Below this height the band would show the ground (m).
const HEIGHT_MIN_M: f64 = 1.5;

/// Collects cells.
pub struct Sensed {
    map: Input<LocalMap>,
    cells: BTreeSet<(i32, i32)>,
    looked: Option<Instant>,
}

impl Sensed {
    /// Begins with nothing.
    pub fn new(session: &Session) -> Result<Self, OpenError> {
        Ok(Self {
            map: session.input(topics::LOCAL_MAP, "")?,
            cells: BTreeSet::new(),
            looked: None,
        })
    }

    /// Takes what is in the map now around the height of `vehicle`, above the ground.
    pub fn look(&mut self, vehicle: Point<LocalNed>) {
        let low = -vehicle.z_m < HEIGHT_MIN_M;
        if low || self.looked.is_some_and(|looked| looked.elapsed() < PERIOD) {
            return;
        }
        self.looked = Some(Instant::now());
        let Some(map) = self.map.latest(jink_runtime::now()).fresh() else {
            return;
        };
        let [_, _, height] = map::cell_of(vehicle);
        for z in height - BAND_CELLS..=height + BAND_CELLS {
            for y in map.min_cell[1]..map.min_cell[1] + SIZE_Y as i32 {
                for x in map.min_cell[0]..map.min_cell[0] + SIZE_X as i32 {
                    if map.is_occupied([x, y, z]) {
                        self.cells.insert((x, y));
                    }
                }
            }
        }
    }

    /// Centres of all cells seen: north, east (m).
    pub fn centres(&self) -> Vec<(f64, f64)> {
        let centre = |&(x, y): &(i32, i32)| map::center_of([x, y, 0]);
        self.cells
            .iter()
            .map(centre)
            .map(|point| (point.x_m, point.y_m))
            .collect()
    }
}
