//! Where the vehicle's centre may be: the map inflated for every speed tier.
//!
//! | layer | holds | use |
//! |---|---|---|
//! | `blocked` | occupied and unknown cells, dilated, and `hit` | certificates: outside it the vehicle is safe |
//! | `hit` | occupied cells, dilated; with collision prevention what is nearer than CP_DIST at the vehicle's height | search (unknown may be explored), re-check of what is already committed |
//! | `near` | the hits of the highest speed tier, dilated further | cost only: prefer clearance |
//!
//! The lowest speed tier, which is for narrow places, has layers of half cells in the middle of the window: half a
//! metre to both sides of the vehicle's centre takes six of the map's cells there, and seven on the map's own. The
//! cells of that tier are half cells, those of all others the map's.
//!
//! A vehicle that rests where not even [`crate::speed_tiers::SLOW_TIER`] has clearance (a gust, a hard braking,
//! something that came, a take-off below a part of the sky that no sensor looks at) plans with the clearance that it
//! has, by the shortest path to where there is enough. On that path it comes no nearer to what is occupied or unknown
//! nearby, and it creeps, so that its tracking error is small. It keeps the usual distance from all other unknown
//! cells, and its radius from occupied ones, unless it is nearer to them than that already: a false hit, or a touch.
//!
//! A vehicle that is already nearer to something than CP_DIST plans without CP_DIST, because it could never leave
//! otherwise; the guard ensures that it comes no nearer.

mod cells;
mod clearance;
mod departure;
mod inflation;
mod moving;
mod segments;

pub(crate) use cells::distance_squared_cells;
pub use clearance::Clearance;
pub(crate) use moving::Meeting;

use crate::bit_layer::{BitLayer, DilationScratch, StructuringElement};
use crate::speed_tiers::TIERS;
use cells::{cell_holding, cell_m, cells_within, is_within, per_cell};
use jink_shared_types::map::{CELL_M, Cell, LocalMap, SIZE_X, SIZE_Y, SIZE_Z, center_of, declared_as};
use jink_shared_types::motion::MotionLimits;
use moving::Meetings;
use nalgebra::Vector3;

/// Additional clearance whose absence has a cost in the search (m).
const COMFORT_M: f64 = 0.4;

/// A place that is too narrow for a speed tier.
#[derive(Debug)]
struct NarrowPlace {
    /// The speed tier.
    tier: usize,
    /// The structuring element for occupied cells: the clearance that there is.
    element: StructuringElement,
    /// Where the vehicle is.
    from: Cell,
}

/// The inflated map.
#[derive(Debug)]
pub struct ConfigurationSpace {
    min_cell: Cell,
    clearance: Clearance,
    radii_m: [f64; TIERS],
    elements: [StructuringElement; TIERS],
    standoff_elements: [Option<StructuringElement>; TIERS],
    /// The vehicle is inside the standoff of an obstacle: it plans without standoff.
    is_inside_standoff: bool,
    /// What replaces a speed tier's own element while the vehicle is in a place that is too narrow for it.
    narrow: Option<NarrowPlace>,
    comfort: StructuringElement,
    not_free: BitLayer,
    occupied: BitLayer,
    scratch: DilationScratch,
    halves: BitLayer,
    unknown: BitLayer,
    /// The occupied cells farther than the vehicle's radius from a narrow place.
    other_occupied: BitLayer,
    /// The cells that are too near to a narrow place, and within which distance (m) the vehicle comes no nearer to
    /// them.
    too_near: Vec<(Cell, f64)>,
    ready: [bool; TIERS],
    blocked: [BitLayer; TIERS],
    hit: [BitLayer; TIERS],
    near: BitLayer,
    /// `near` is of this map.
    near_ready: bool,
    declared: BitLayer,
    /// What the user declares, bits of [`declared_as`].
    declarations: u8,
    loaded: bool,
    /// What moves, where the vehicle could meet it.
    meetings: Meetings,
    /// The tiers that hold it, and what they held before.
    painted: [bool; TIERS],
    unpainted_hit: [BitLayer; TIERS],
    unpainted_blocked: [BitLayer; TIERS],
}

impl ConfigurationSpace {
    /// For a vehicle that needs this clearance.
    pub fn new(speed_tiers: &[MotionLimits; TIERS], clearance: Clearance) -> Self {
        let radii_m = std::array::from_fn(|tier: usize| clearance.footprint_m + speed_tiers[tier].tube_m);
        let elements = std::array::from_fn(|tier| StructuringElement::of_cells(radii_m[tier], cell_m(tier)));
        let standoff_elements =
            std::array::from_fn(|tier| clearance.standoff_element(speed_tiers[tier].tube_m));
        let comfort = StructuringElement::new(COMFORT_M);
        let all = [&comfort].into_iter().chain(&elements);
        Self {
            scratch: DilationScratch::for_elements(all.chain(standoff_elements.iter().flatten())),
            comfort,
            elements,
            standoff_elements,
            min_cell: [0; 3],
            clearance,
            radii_m,
            is_inside_standoff: false,
            narrow: None,
            not_free: BitLayer::default(),
            occupied: BitLayer::default(),
            halves: BitLayer::default(),
            unknown: BitLayer::default(),
            other_occupied: BitLayer::default(),
            too_near: Vec::with_capacity(1_024),
            ready: [false; TIERS],
            blocked: std::array::from_fn(|_| BitLayer::default()),
            hit: std::array::from_fn(|_| BitLayer::default()),
            near: BitLayer::default(),
            near_ready: false,
            declared: BitLayer::default(),
            declarations: 0,
            loaded: false,
            meetings: Meetings::new(),
            painted: [false; TIERS],
            unpainted_hit: std::array::from_fn(|_| BitLayer::default()),
            unpainted_blocked: std::array::from_fn(|_| BitLayer::default()),
        }
    }

    /// Sets the standoff and the tubes; the footprint stays what it was.
    pub fn fit(&mut self, speed_tiers: &[MotionLimits; TIERS], standoff_m: f64) {
        let radii_m = speed_tiers.map(|limits| self.clearance.footprint_m + limits.tube_m);
        if standoff_m != self.clearance.standoff_m || radii_m != self.radii_m {
            self.clearance.standoff_m = standoff_m;
            self.radii_m = radii_m;
            self.elements =
                std::array::from_fn(|tier| StructuringElement::of_cells(radii_m[tier], cell_m(tier)));
            self.standoff_elements =
                std::array::from_fn(|tier| self.clearance.standoff_element(speed_tiers[tier].tube_m));
            let all = [&self.comfort].into_iter().chain(&self.elements);
            self.scratch = DilationScratch::for_elements(all.chain(self.standoff_elements.iter().flatten()));
            self.discard_tiers();
        }
    }

    /// Every speed tier has to be inflated again.
    fn discard_tiers(&mut self) {
        self.ready = [false; TIERS];
        self.near_ready = false;
    }

    /// Whether a speed tier plans with less clearance than it needs, to leave a place too narrow for it.
    pub fn is_narrow(&self) -> bool {
        self.narrow.is_some()
    }

    /// The speed tier that plans with less clearance than it needs.
    pub fn narrow_tier(&self) -> Option<usize> {
        self.narrow.as_ref().map(|narrow| narrow.tier)
    }

    /// Loads a new map. Speed tiers are inflated when they are needed ([`Self::prepare`]): most plans need only one.
    pub fn load(&mut self, map: &LocalMap) {
        self.min_cell = map.min_cell;
        self.loaded = true;
        self.unpaint();
        self.discard_tiers();
        self.not_free.load_unsafe(map);
        self.occupied.load_occupied(map);
        self.declarations = map.declarations;
        if map.declarations & !declared_as::NO_RETURN != 0 {
            self.declared.load_declared(map);
        }
    }

    /// Whether a planar sensor's readings are declared to stand for a band above and below its plane.
    pub fn has_band(&self) -> bool {
        self.declarations & declared_as::BAND != 0
    }

    /// The declarations of the user that a motion along `vertices` in `tier` depends on, bits of [`declared_as`]: those
    /// of space if any cell within the tier's radius is known by them alone. The declaration that rays without an
    /// answer met nothing may have freed any cell, so it always counts.
    pub fn declarations(&self, tier: usize, vertices: &[Vector3<f64>]) -> u8 {
        let of_rays = self.declarations & declared_as::NO_RETURN;
        let of_space = self.declarations & !declared_as::NO_RETURN;
        let is_declared = |cell: Cell| self.contains(cell) && self.declared.test(cell);
        let uses = |leg: &[Vector3<f64>]| {
            let is_near_declared = |_: &Self, cell: Cell| self.cells_within(tier, cell).any(is_declared);
            self.first_in(tier, &leg[0], &leg[1], is_near_declared).is_some()
        };
        if of_space != 0 && vertices.windows(2).any(uses) {
            of_rays | of_space
        } else {
            of_rays
        }
    }

    /// Whether a map has ever been loaded.
    pub fn is_loaded(&self) -> bool {
        self.loaded
    }

    /// Whether the map's cell `cell` lies inside the window.
    pub fn contains(&self, cell: Cell) -> bool {
        is_within(self.min_cell, cell)
    }

    /// How many cells of `tier` fit along an edge of a map cell. In a place that is too narrow for it, the map's cells
    /// are used.
    pub fn per_cell(&self, tier: usize) -> i32 {
        if self.narrow_tier() == Some(tier) {
            1
        } else {
            per_cell(tier)
        }
    }

    /// Edge of a cell of `tier` (m).
    pub fn cell_m(&self, tier: usize) -> f64 {
        CELL_M / f64::from(self.per_cell(tier))
    }

    /// The cell of `tier` that `place` (local, m) lies in.
    pub fn cell_of(&self, tier: usize, place: &Vector3<f64>) -> Cell {
        cell_holding(&(place * f64::from(self.per_cell(tier))))
    }

    /// The centre of a cell of `tier` (local, m).
    pub fn center_of(&self, tier: usize, cell: Cell) -> Vector3<f64> {
        center_of(cell).vector() / f64::from(self.per_cell(tier))
    }

    /// The map's cell that a cell of `tier` lies in.
    pub fn map_cell(&self, tier: usize, cell: Cell) -> Cell {
        if self.per_cell(tier) == 1 {
            cell
        } else {
            cell.map(|index| index >> 1)
        }
    }

    /// The map's cells that are nearer than the radius of `tier` to the one that its cell `cell` lies in.
    pub fn cells_within(&self, tier: usize, cell: Cell) -> impl Iterator<Item = Cell> {
        cells_within(self.map_cell(tier, cell), self.radii_m[tier]).map(|(there, _)| there)
    }

    /// Smallest cell of `tier` that its layers hold.
    pub fn min_cell(&self, tier: usize) -> Cell {
        if self.per_cell(tier) == 1 {
            self.min_cell
        } else {
            self.min_half()
        }
    }

    /// The layers of half cells cover the middle of the window, where the vehicle is.
    fn min_half(&self) -> Cell {
        let size = [SIZE_X, SIZE_Y, SIZE_Z].map(|size| size as i32);
        std::array::from_fn(|axis| 2 * self.min_cell[axis] + size[axis] / 2)
    }

    /// Whether the layers of `tier` are made for the present map.
    pub fn is_ready(&self, tier: usize) -> bool {
        self.ready[tier]
    }

    /// Whether the layers of `tier` hold its cell `cell`.
    pub fn holds(&self, tier: usize, cell: Cell) -> bool {
        is_within(self.min_cell(tier), cell)
    }

    /// Whether the vehicle's centre may be at `place` (local, m) in `tier`, and anywhere else in the same cell.
    pub fn is_safe_at(&self, tier: usize, place: &Vector3<f64>) -> bool {
        self.is_safe(tier, self.cell_of(tier, place))
    }

    /// Whether an obstacle is known within the speed tier's radius of the cell of `place` (local, m).
    pub fn is_hit_at(&self, tier: usize, place: &Vector3<f64>) -> bool {
        self.is_hit(tier, self.cell_of(tier, place))
    }

    /// Whether the vehicle's centre may be anywhere in `cell` in `tier`: everything around it is known free.
    pub fn is_safe(&self, tier: usize, cell: Cell) -> bool {
        self.ready[tier] && self.holds(tier, cell) && !self.blocked[tier].test(cell)
    }

    /// Whether an obstacle is known within the speed tier's radius of `cell`; outside the window none is known.
    pub fn is_hit(&self, tier: usize, cell: Cell) -> bool {
        !self.ready[tier] || self.holds(tier, cell) && self.hit[tier].test(cell)
    }

    /// [`Self::is_hit`] for the whole window: near its border a hit may belong to something at the opposite side,
    /// because cells are addressed modulo the window's size. Such cells do not count.
    pub fn is_hit_inside(&self, tier: usize, cell: Cell) -> bool {
        let level_m = self.hit_reach_m(tier);
        let height_m = self.radii_m[tier].max(self.clearance.band_half_m);
        let cell_m = self.cell_m(tier);
        let reach = [level_m, level_m, height_m].map(|reach_m| (reach_m / cell_m).ceil() as i32 + 1);
        let ends = [-1, 1].map(|side| std::array::from_fn(|axis| cell[axis] + side * reach[axis]));
        self.is_hit(tier, cell) && ends.into_iter().all(|end| self.holds(tier, end))
    }

    /// Horizontal distance (m) that `tier` keeps from an occupied cell: its radius, or the standoff and the tube.
    fn hit_reach_m(&self, tier: usize) -> f64 {
        let tube_m = self.radii_m[tier] - self.clearance.footprint_m;
        self.radii_m[tier].max(self.clearance.standoff_m + tube_m)
    }

    /// Radius that holds the whole vehicle, with the errors of the map (m).
    pub fn footprint_m(&self) -> f64 {
        self.clearance.footprint_m
    }

    /// Distance that a speed tier keeps from what is not known to be free (m).
    pub fn radius_m(&self, tier: usize) -> f64 {
        self.radii_m[tier]
    }

    /// Whether nothing is known of `cell`, which lies inside the window.
    pub fn is_unknown(&self, cell: Cell) -> bool {
        self.contains(cell) && self.not_free.test(cell) && !self.occupied.test(cell)
    }

    /// Whether `cell` itself is known to be occupied.
    pub fn is_occupied(&self, cell: Cell) -> bool {
        self.contains(cell) && self.occupied.test(cell)
    }

    /// Whether `cell` of the map is nearer to an obstacle than is comfortable; not known unless the highest speed tier
    /// is prepared.
    pub fn is_near(&self, cell: Cell) -> bool {
        self.near_ready && self.contains(cell) && self.near.test(cell)
    }

    /// The layer of a speed tier that holds everything unsafe.
    pub fn blocked(&self, tier: usize) -> &BitLayer {
        &self.blocked[tier]
    }

    /// The layer of the map's cells that are nearer to an obstacle than is comfortable, if the highest speed tier is
    /// prepared.
    pub fn near(&self) -> Option<&BitLayer> {
        self.near_ready.then_some(&self.near)
    }

    /// The layer of a speed tier that holds everything too near to a known obstacle.
    pub fn hit(&self, tier: usize) -> &BitLayer {
        &self.hit[tier]
    }
}

#[cfg(test)]
pub(crate) mod tests;
