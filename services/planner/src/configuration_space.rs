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

use crate::bit_layer::{BitLayer, StructuringElement, gap_m};
use crate::speed_tiers::{LAST_TIER, TIERS};
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::map::{
    CELL_M, Cell, LocalMap, SIZE_X, SIZE_Y, SIZE_Z, cell_of, center_of, declared_as,
};
use jink_shared_types::motion::MotionLimits;
use jink_shared_types::params::{self, ParamSet};
use nalgebra::Vector3;

/// Additional clearance whose absence has a cost in the search (m).
const COMFORT_M: f64 = 0.4;
/// An element as large as the clearance must not reach the cell that limits it, for rounding (m).
const ROUNDING_M: f64 = 1e-6;
/// Beyond this, CP_DIST is left to the guard (m): the map reaches 12.8 m.
const STANDOFF_MAX_M: f64 = 5.0;

/// The clearance that the vehicle needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Radius of the vehicle (m).
    pub vehicle_m: f64,
    /// Footprint: that radius and the error of the map (m).
    pub footprint_m: f64,
    /// Standoff: horizontal distance of its centre from obstacles at its height (m); zero and below: no more than the
    /// footprint.
    pub standoff_m: f64,
    /// Half height of the band that counts as the vehicle's height (m).
    pub band_half_m: f64,
}

impl Clearance {
    /// The clearance of the vehicle that `params` describe.
    pub fn from_params(params: &ParamSet) -> Self {
        Self {
            vehicle_m: params.get(&params::OA_VEH_RADIUS),
            footprint_m: params.get(&params::OA_VEH_RADIUS) + params.get(&params::OA_MAP_ERR),
            standoff_m: params.get(&params::CP_DIST).min(STANDOFF_MAX_M),
            band_half_m: params.get(&params::GD_BAND),
        }
    }

    /// What has to be free of obstacles around a reference that is followed within `tube_m`; `None` if the standoff is
    /// no more than the footprint.
    fn standoff_element(&self, tube_m: f64) -> Option<StructuringElement> {
        (self.standoff_m > self.footprint_m).then(|| {
            StructuringElement::in_cylinder(
                self.footprint_m + tube_m,
                self.standoff_m + tube_m,
                self.band_half_m,
            )
        })
    }
}

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
    scratch: BitLayer,
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
    declared: BitLayer,
    /// What the user declares, bits of [`declared_as`].
    declarations: u8,
    loaded: bool,
}

impl ConfigurationSpace {
    /// For a vehicle that needs this clearance.
    pub fn new(speed_tiers: &[MotionLimits; TIERS], clearance: Clearance) -> Self {
        let radii_m = std::array::from_fn(|tier: usize| clearance.footprint_m + speed_tiers[tier].tube_m);
        Self {
            min_cell: [0; 3],
            clearance,
            radii_m,
            elements: std::array::from_fn(|tier| StructuringElement::of_cells(radii_m[tier], cell_m(tier))),
            standoff_elements: std::array::from_fn(|tier| {
                clearance.standoff_element(speed_tiers[tier].tube_m)
            }),
            is_inside_standoff: false,
            narrow: None,
            comfort: StructuringElement::new(COMFORT_M),
            not_free: BitLayer::default(),
            occupied: BitLayer::default(),
            scratch: BitLayer::default(),
            halves: BitLayer::default(),
            unknown: BitLayer::default(),
            other_occupied: BitLayer::default(),
            too_near: Vec::with_capacity(1_024),
            ready: [false; TIERS],
            blocked: std::array::from_fn(|_| BitLayer::default()),
            hit: std::array::from_fn(|_| BitLayer::default()),
            near: BitLayer::default(),
            declared: BitLayer::default(),
            declarations: 0,
            loaded: false,
        }
    }

    /// Sets the standoff; the footprint stays what it was.
    pub fn set_standoff(&mut self, speed_tiers: &[MotionLimits; TIERS], clearance: Clearance) {
        if clearance.standoff_m != self.clearance.standoff_m {
            self.clearance.standoff_m = clearance.standoff_m;
            self.standoff_elements =
                std::array::from_fn(|tier| self.clearance.standoff_element(speed_tiers[tier].tube_m));
            self.ready = [false; TIERS];
        }
    }

    /// Sets where the next plan departs from: whether there is clearance for `tier`, if the vehicle creeps or rests
    /// there (`is_creeping`), and whether it is inside the standoff. Nearer to something than its radius, only a
    /// vehicle that `has_plan` is moved away: one that takes off is near to the ground, and controlled by the
    /// autopilot.
    pub fn set_departure(&mut self, place: &Vector3<f64>, tier: usize, is_creeping: bool, has_plan: bool) {
        let cell = cell_holding(place);
        self.set_narrow(None);
        self.update_standoff_at(place);
        if !is_creeping || !self.contains(cell) {
            return;
        }
        self.prepare(tier);
        if !self.is_safe_at(tier, place) {
            let clearance_m = self.clearance_m(cell, self.radii_m[tier]);
            if clearance_m < self.clearance.vehicle_m && !has_plan {
                return;
            }
            self.set_narrow(Some(NarrowPlace {
                tier,
                element: StructuringElement::new(clearance_m.max(self.clearance.vehicle_m) - ROUNDING_M),
                from: cell,
            }));
            self.prepare(tier);
        }
    }

    /// Whether a speed tier plans with less clearance than it needs, to leave a place too narrow for it.
    pub fn is_narrow(&self) -> bool {
        self.narrow.is_some()
    }

    /// The speed tier that plans with less clearance than it needs.
    pub fn narrow_tier(&self) -> Option<usize> {
        self.narrow.as_ref().map(|narrow| narrow.tier)
    }

    /// Whether an occupied cell limits the clearance.
    pub fn is_narrowed_by_obstacle(&self) -> bool {
        self.narrow.as_ref().is_some_and(|narrow| {
            let radius_m = self.radii_m[narrow.tier];
            self.clearance_m(narrow.from, radius_m) < radius_m
        })
    }

    /// Whether `tier` has the clearance in `cell` that it needs.
    pub fn has_clearance(&self, tier: usize, cell: Cell) -> bool {
        let radius_m = self.radii_m[tier];
        self.is_safe(tier, cell) && cells_within(cell, radius_m).all(|(there, _)| !self.is_not_free(there))
    }

    /// Whether `cell` is occupied or unknown; outside the window all is unknown.
    fn is_not_free(&self, cell: Cell) -> bool {
        !self.contains(cell) || self.not_free.test(cell)
    }

    fn set_narrow(&mut self, narrow: Option<NarrowPlace>) {
        let speed_tiers = [self.narrow.as_ref(), narrow.as_ref()];
        for narrow in speed_tiers.into_iter().flatten() {
            self.ready[narrow.tier] = false;
        }
        self.narrow = narrow;
    }

    /// Distance from `cell` to the nearest occupied one, at most `max_m`, between their nearest points.
    fn clearance_m(&self, cell: Cell, max_m: f64) -> f64 {
        let occupied = cells_within(cell, max_m).filter(|(there, _)| self.is_occupied(*there));
        occupied.fold(max_m, |min_m, (_, away_m)| min_m.min(away_m))
    }

    fn update_standoff_at(&mut self, place: &Vector3<f64>) {
        let slowest = LAST_TIER;
        if self.standoff_elements[slowest].is_none() {
            return;
        }
        self.set_inside_standoff(false);
        self.prepare(slowest);
        let is_too_near = self.is_hit_at(slowest, place);
        self.set_inside_standoff(is_too_near);
    }

    fn set_inside_standoff(&mut self, is_inside_standoff: bool) {
        if is_inside_standoff != self.is_inside_standoff {
            self.is_inside_standoff = is_inside_standoff;
            self.ready = [false; TIERS];
        }
    }

    /// Loads a new map. Speed tiers are inflated when they are needed ([`Self::prepare`]): most plans need only one.
    pub fn load(&mut self, map: &LocalMap) {
        self.min_cell = map.min_cell;
        self.loaded = true;
        self.ready = [false; TIERS];
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

    /// Inflates the map for `tier`, once per map. Before that nothing is safe in the tier and everything is a hit.
    pub fn prepare(&mut self, tier: usize) {
        if self.ready[tier] || !self.loaded {
            return;
        }
        self.ready[tier] = true;
        if self.narrow_tier() == Some(tier) {
            self.prepare_narrow(tier);
            return;
        }
        if per_cell(tier) > 1 {
            self.prepare_halves(tier);
            return;
        }
        let element = &self.elements[tier];
        element.dilate(&self.not_free, &mut self.scratch, &mut self.blocked[tier]);
        let standoff_elements = self.standoff_elements[tier]
            .as_ref()
            .filter(|_| !self.is_inside_standoff);
        let body = standoff_elements.unwrap_or(element);
        body.dilate(&self.occupied, &mut self.scratch, &mut self.hit[tier]);
        if standoff_elements.is_some() {
            self.blocked[tier].add(&self.hit[tier]);
        }
        if tier == 0 {
            self.comfort
                .dilate(&self.hit[0], &mut self.scratch, &mut self.near);
        }
    }

    /// Prepares the layers of half cells. The standoff is dilated on the map's cells: it is metres.
    fn prepare_halves(&mut self, tier: usize) {
        let min_half = self.min_half();
        let element = &self.elements[tier];
        self.halves.load_halves(&self.not_free, min_half);
        self.halves.close_shell(min_half);
        element.dilate(&self.halves, &mut self.scratch, &mut self.blocked[tier]);
        match self.standoff_elements[tier]
            .as_ref()
            .filter(|_| !self.is_inside_standoff)
        {
            Some(standoff_elements) => {
                standoff_elements.dilate(&self.occupied, &mut self.scratch, &mut self.halves);
                self.hit[tier].load_halves(&self.halves, min_half);
                self.blocked[tier].add(&self.hit[tier]);
            }
            None => {
                self.halves.load_halves(&self.occupied, min_half);
                element.dilate(&self.halves, &mut self.scratch, &mut self.hit[tier]);
            }
        }
    }

    /// Prepares a tier with the clearance that there is: unknown cells nearby, and occupied ones within the vehicle's
    /// radius, may stay as near as they are.
    fn prepare_narrow(&mut self, tier: usize) {
        let Some(narrow) = &self.narrow else {
            return;
        };
        let radius_m = self.radii_m[tier];
        let mut near = std::mem::take(&mut self.too_near);
        near.clear();
        self.unknown.copy(&self.not_free);
        self.unknown.remove(&self.occupied);
        self.other_occupied.copy(&self.occupied);
        for (cell, away_m) in cells_within(narrow.from, radius_m) {
            if self.contains(cell) && self.unknown.test(cell) {
                self.unknown.unset(cell);
                near.push((cell, radius_m));
            } else if self.is_occupied(cell) && away_m < self.clearance.vehicle_m {
                self.other_occupied.unset(cell);
                near.push((cell, self.clearance.vehicle_m));
            }
        }
        // Not the tier's own element, which may be one of half cells.
        StructuringElement::new(radius_m).dilate(&self.unknown, &mut self.scratch, &mut self.blocked[tier]);
        narrow
            .element
            .dilate(&self.other_occupied, &mut self.scratch, &mut self.hit[tier]);
        self.blocked[tier].add(&self.hit[tier]);
        for (cell, min_distance_m) in &near {
            let present_squared = distance_squared_cells(*cell, narrow.from);
            for (nearer, _) in cells_within(*cell, *min_distance_m) {
                if distance_squared_cells(*cell, nearer) < present_squared && self.contains(nearer) {
                    self.blocked[tier].set(nearer);
                }
            }
        }
        self.too_near = near;
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
        cell.map(|index| index.div_euclid(self.per_cell(tier)))
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
        let tube_m = self.radii_m[tier] - self.clearance.footprint_m;
        let level_m = self.radii_m[tier].max(self.clearance.standoff_m + tube_m);
        let height_m = self.radii_m[tier].max(self.clearance.band_half_m);
        let cell_m = self.cell_m(tier);
        let reach = [level_m, level_m, height_m].map(|reach_m| (reach_m / cell_m).ceil() as i32 + 1);
        let ends = [-1, 1].map(|side| std::array::from_fn(|axis| cell[axis] + side * reach[axis]));
        self.is_hit(tier, cell) && ends.into_iter().all(|end| self.holds(tier, end))
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

    /// Whether `cell` of the map is nearer to an obstacle than is comfortable.
    pub fn is_near(&self, cell: Cell) -> bool {
        self.contains(cell) && self.near.test(cell)
    }

    /// The layer of a speed tier that holds everything unsafe.
    pub fn blocked(&self, tier: usize) -> &BitLayer {
        &self.blocked[tier]
    }

    /// The layer of a speed tier that holds everything too near to a known obstacle.
    pub fn hit(&self, tier: usize) -> &BitLayer {
        &self.hit[tier]
    }

    /// The share of the segment from `a` to `b` at which the first cell of `tier` that `is_wanted` is entered; `None`
    /// if there is none.
    pub fn first_in(
        &self,
        tier: usize,
        a: &Vector3<f64>,
        b: &Vector3<f64>,
        is_wanted: impl Fn(&Self, Cell) -> bool,
    ) -> Option<f64> {
        let scale = f64::from(self.per_cell(tier));
        self.first_cell(&(a * scale), &(b * scale), is_wanted)
    }

    /// The same for the cells of the map.
    pub fn first_cell(
        &self,
        a: &Vector3<f64>,
        b: &Vector3<f64>,
        is_wanted: impl Fn(&Self, Cell) -> bool,
    ) -> Option<f64> {
        let mut walk = CellWalk::new(a, b);
        loop {
            if is_wanted(self, walk.cell) {
                return Some(walk.entered_t);
            }
            if !walk.advance() {
                return None;
            }
        }
    }

    /// Whether the straight segment from `a` to `b` is safe in `tier`.
    pub fn segment_is_safe(&self, tier: usize, a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
        let is_unsafe = |space: &Self, cell: Cell| !space.is_safe(tier, cell);
        self.first_in(tier, a, b, is_unsafe).is_none()
    }
}

/// How many cells of `tier` fit along an edge of a map cell.
fn per_cell(tier: usize) -> i32 {
    if tier == LAST_TIER { 2 } else { 1 }
}

/// Edge of a cell of `tier` (m).
fn cell_m(tier: usize) -> f64 {
    CELL_M / f64::from(per_cell(tier))
}

/// Whether `cell` is one of a layer that begins at `min_cell`.
fn is_within(min_cell: Cell, cell: Cell) -> bool {
    let inside = |axis: usize, size: usize| {
        let offset = cell[axis].wrapping_sub(min_cell[axis]);
        (0..size as i32).contains(&offset)
    };
    inside(0, SIZE_X) && inside(1, SIZE_Y) && inside(2, SIZE_Z)
}

/// The map's cell of `place` (local, m).
fn cell_holding(place: &Vector3<f64>) -> Cell {
    cell_of(Point::<LocalNed>::from_vector(*place))
}

/// The cells whose nearest points are nearer than `radius_m` to those of `cell`, with that distance (m).
fn cells_within(cell: Cell, radius_m: f64) -> impl Iterator<Item = (Cell, f64)> {
    let reach = (radius_m / CELL_M).ceil() as i32 + 1;
    let offsets = (-reach..=reach).flat_map(move |dz| {
        (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| [dx, dy, dz]))
    });
    offsets.filter_map(move |offset: Cell| {
        let away_m = Vector3::from(offset.map(gap_m)).norm();
        let there = std::array::from_fn(|axis| cell[axis] + offset[axis]);
        (away_m < radius_m).then_some((there, away_m))
    })
}

/// Square of the distance between the centres of two cells (cells squared).
fn distance_squared_cells(a: Cell, b: Cell) -> i32 {
    (0..3).map(|axis| (a[axis] - b[axis]).pow(2)).sum()
}

/// Visits every cell a segment passes, in order (Amanatides and Woo 1987).
#[derive(Debug)]
struct CellWalk {
    cell: Cell,
    /// Share of the segment at which the cell was entered.
    entered_t: f64,
    step: [i32; 3],
    next_t: [f64; 3],
    delta_t: [f64; 3],
}

impl CellWalk {
    fn new(a: &Vector3<f64>, b: &Vector3<f64>) -> Self {
        let cell = cell_holding(a);
        let way = b - a;
        let mut walk = Self {
            cell,
            entered_t: 0.0,
            step: [0; 3],
            next_t: [f64::INFINITY; 3],
            delta_t: [f64::INFINITY; 3],
        };
        for axis in 0..3 {
            if way[axis].abs() > 1e-12 {
                let forward = way[axis] > 0.0;
                walk.step[axis] = if forward { 1 } else { -1 };
                let border_m = (f64::from(cell[axis]) + f64::from(u8::from(forward))) * CELL_M;
                walk.next_t[axis] = (border_m - a[axis]) / way[axis];
                walk.delta_t[axis] = CELL_M / way[axis].abs();
            }
        }
        walk
    }

    /// Moves to the next cell; `false` at the end of the segment.
    fn advance(&mut self) -> bool {
        let axis = (0..3).fold(0, |best, axis| {
            if self.next_t[axis] < self.next_t[best] {
                axis
            } else {
                best
            }
        });
        if self.next_t[axis] > 1.0 {
            return false;
        }
        self.entered_t = self.next_t[axis].max(self.entered_t);
        self.cell[axis] += self.step[axis];
        self.next_t[axis] += self.delta_t[axis];
        true
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::speed_tiers::{SLOW_TIER, speed_tiers};
    use jink_shared_types::map::{center_of, set};
    use proptest::prelude::*;

    /// A map whose cells are all known free except where `occupied` says so.
    pub(crate) fn known_map(occupied: impl Fn(Vector3<f64>) -> bool) -> Box<LocalMap> {
        let mut map = LocalMap::boxed();
        map.min_cell = [-64, -64, -32];
        for x in -64..64 {
            for y in -64..64 {
                for z in -32..32 {
                    set(&mut map.known, [x, y, z]);
                    if occupied(center_of([x, y, z]).vector()) {
                        set(&mut map.occupied, [x, y, z]);
                    }
                }
            }
        }
        map.ranges_fresh = true.into();
        map
    }

    pub(crate) fn space_of(map: &LocalMap) -> ConfigurationSpace {
        space_with(&ParamSet::default(), map)
    }

    fn space_with(params: &ParamSet, map: &LocalMap) -> ConfigurationSpace {
        let mut space = ConfigurationSpace::new(&speed_tiers(params), Clearance::from_params(params));
        space.load(map);
        (0..TIERS).for_each(|tier| space.prepare(tier));
        space
    }

    #[test]
    fn a_post_blocks_its_surroundings_and_less_of_them_in_a_lower_tier() {
        let map = known_map(|p| (p.x - 5.0).hypot(p.y) < 0.3);
        let space = space_of(&map);
        let radius = |tier: usize| {
            (0..200)
                .map(|i| f64::from(i) * 0.02)
                .find(|d| space.is_safe(tier, cell_of(Point::new(5.0 - d, 0.1, 0.1))))
                .unwrap()
        };
        assert!(radius(2) < radius(1) && radius(1) < radius(0));
        assert!(radius(0) > 0.3 + 0.4 + 0.4);
    }

    #[test]
    fn with_collision_prevention_a_post_is_kept_away_from_and_who_is_too_near_may_leave() {
        let map = known_map(|p| (p.x - 5.0).hypot(p.y) < 0.3);
        let mut params = ParamSet::default();
        params.set("CP_DIST", 2.0).unwrap();
        let mut space = space_with(&params, &map);
        let at = |distance_m: f64| cell_of(Point::new(4.7 - distance_m, 0.1, 0.1));
        assert!(!space.is_safe(2, at(2.0)) && space.is_hit(2, at(2.0)));
        assert!(space.is_safe(2, at(2.8)));
        space.set_departure(&center_of(at(3.0)).vector(), SLOW_TIER, false, true);
        space.prepare(2);
        assert!(!space.is_safe(2, at(2.0)));
        space.set_departure(&center_of(at(1.5)).vector(), SLOW_TIER, false, true);
        space.prepare(2);
        assert!(space.is_safe(2, at(1.5)) && !space.is_safe(2, at(0.5)));
        // Without CP_DIST there is no standoff.
        params.set("CP_DIST", -1.0).unwrap();
        space.set_standoff(&speed_tiers(&params), Clearance::from_params(&params));
        space.set_departure(&center_of(at(3.0)).vector(), SLOW_TIER, false, true);
        space.prepare(2);
        assert!(space.is_safe(2, at(1.2)));
    }

    #[test]
    fn who_rests_in_a_narrow_place_has_the_clearance_there_is_and_comes_no_nearer_to_the_unknown() {
        // Walls on both sides, the left one too near.
        let mut map = known_map(|p| p.y < -0.4 || (0.8..1.0).contains(&p.y));
        let here = cell_of(Point::new(0.1, 0.1, 0.1));
        let mut space = space_of(&map);
        assert!(!space.is_safe(SLOW_TIER, here));
        space.set_departure(&center_of(here).vector(), SLOW_TIER, false, true);
        assert!(!space.is_narrow(), "in motion it is left alone");
        space.set_departure(&center_of(here).vector(), SLOW_TIER, true, true);
        assert!(space.is_narrow() && space.is_safe(SLOW_TIER, here) && !space.has_clearance(SLOW_TIER, here));
        let aside = |east_m: f64| cell_of(Point::new(0.1, east_m, 0.1));
        assert!(!space.is_safe(2, aside(-0.1)), "no nearer to what is near");
        for row in 0..map.known.len() {
            // Nothing is known within x = 0.4 to 1 m.
            for x in 2..5u32 {
                map.known[row][0] &= !(1 << x);
            }
        }
        space.load(&map);
        space.set_departure(&center_of(here).vector(), SLOW_TIER, true, true);
        assert!(space.is_safe(SLOW_TIER, here) && !space.has_clearance(SLOW_TIER, here));
        let along = |north_m: f64| cell_of(Point::new(north_m, 0.1, 0.1));
        assert!(!space.is_safe(2, along(0.3)), "no nearer to the unknown either");
        assert!(space.is_safe(2, along(-0.1)), "away from it");
    }

    #[test]
    fn who_rests_nearer_to_something_than_its_radius_may_go_away_from_it_and_no_nearer() {
        let at = |north_m: f64, east_m: f64| cell_of(Point::new(north_m, east_m, 0.1));
        let (here, there) = (at(0.1, 0.1), at(0.1, 0.5));
        // Something small beside it, and a wall before it.
        let map = known_map(|p| cell_of(Point::from_vector(p)) == there || p.x > 1.0);
        let mut space = space_of(&map);
        space.set_departure(&center_of(here).vector(), SLOW_TIER, true, true);
        assert!(space.is_narrow() && space.is_safe(SLOW_TIER, here) && !space.has_clearance(SLOW_TIER, here));
        assert!(!space.is_safe(2, at(0.1, 0.3)) && !space.is_safe(2, there));
        assert!(space.is_safe(2, at(0.1, -0.1)) && space.is_safe(2, at(-0.1, 0.1)));
        assert!(space.is_safe(2, at(0.5, 0.1)) && !space.is_safe(2, at(0.9, 0.1)));
        space.set_departure(&center_of(here).vector(), SLOW_TIER, true, false);
        assert!(!space.is_narrow(), "on its take-off");
    }

    #[test]
    fn nothing_outside_the_window_is_safe() {
        let space = space_of(&known_map(|_| false));
        assert!(space.is_safe(0, [0, 0, 0]));
        assert!(!space.is_safe(0, [64, 0, 0]));
        assert!(!space.is_safe(0, [63, 0, 0]), "one cell from the unknown");
    }

    proptest! {
        #[test]
        fn a_walk_visits_the_cell_of_every_point(
            a in proptest::array::uniform3(-5.0..5.0f64), b in proptest::array::uniform3(-5.0..5.0f64),
        ) {
            let (a, b) = (Vector3::from(a), Vector3::from(b));
            let mut walk = CellWalk::new(&a, &b);
            let mut visited = vec![walk.cell];
            while walk.advance() {
                visited.push(walk.cell);
            }
            for i in 0..=100 {
                let point = a + (b - a) * (f64::from(i) / 100.0);
                let cell = cell_of(Point::from_vector(point));
                let near_border = (0..3).any(|k| {
                    let f = (point[k] / CELL_M).rem_euclid(1.0);
                    !(1e-6..=1.0 - 1e-6).contains(&f)
                });
                prop_assert!(near_border || visited.contains(&cell));
            }
        }
    }
}
