//! Both maps compared cell by cell, and every difference explained.
//!
//! What each ray says is worked out a third time, slowly and without any of the short cuts of either map: which cells it ends in, which
//! it crosses. A difference is explained by the first of [`REASONS`] that holds for the cell; what none explains is counted as such.

use crate::clouds::Series;
use crate::octomap::Occupancy;
use crate::rays::{LocalRay, local_rays, middle_m, reach_m, vehicle_m};
use jink_shared_types::map::{CELL_M, CELLS, LocalMap, SIZE_X, SIZE_Y, SIZE_Z};
use jink_shared_types::params::{OA_VEH_RADIUS, ParamSet};
use nalgebra::Vector3;
use serde::Serialize;
use std::collections::BTreeMap;

/// Distance from a face (cells) within which rounding decides in which cell a point lies, or whether a ray crosses a corner: 1 mm by
/// which the poses of both differ (blended between knots of 1.28 ms here, OctoMap's single-precision points there).
const ROUNDING_CELLS: f64 = 0.005;

/// Occupancy here and there, and how many cells have it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Agreement {
    /// Cells of the window that either map says something of.
    pub cells: u64,
    /// Share of them of which both say the same.
    pub same: f64,
    /// `here_there` for `unknown`, `free`, `occupied`: cells.
    pub confusion: BTreeMap<String, u64>,
    /// `here_there: reason`: cells.
    pub differences: BTreeMap<String, u64>,
    /// Free here, occupied there, and no reason for it: what must never be.
    pub free_here_occupied_there_unexplained: u64,
}

/// What the rays said of a cell, counted up to 255 clouds each.
#[derive(Clone, Copy, Default)]
struct Facts {
    /// Clouds with a hit while the cell was in the window; of these beyond the range up to which rays are looked along.
    hits: u8,
    far_hits: u8,
    /// Clouds with a hit before the cell entered the window.
    early_hits: u8,
    /// Clouds with a hit within rounding of a face.
    hits_at_face: u8,
    /// Clouds in which a ray crossed the cell while it was in the window, and before.
    crossed: u8,
    early_crossed: u8,
    /// Clouds in which a ray crossed it if all began at the cloud's one origin.
    crossed_from_middle: u8,
    /// Clouds in which a ray passed within rounding of it.
    grazed: u8,
    /// Clouds in which a ray went on behind the cell in which it was cut off.
    cut_off: u8,
    /// Clouds at whose time the vehicle was in it.
    body: u8,
}

/// Reasons, in the order in which they are looked for.
pub const REASONS: [(&str, &str); 9] = [
    ("body", "the vehicle itself has been there"),
    (
        "left_window",
        "seen before the cell entered the window, which forgets what leaves it",
    ),
    (
        "beyond_range",
        "hits beyond the maximum range count here; there it is measured from one place",
    ),
    (
        "hit_outlives_misses",
        "one hit here outlives six looks through the cell, three there",
    ),
    (
        "cut_off_end",
        "the cell in which a ray is cut off is looked through here",
    ),
    ("one_origin", "there all rays of a cloud begin at one place"),
    (
        "early_exit",
        "carving here stops after three cells that are free already",
    ),
    ("rounding", "an end or a ray within 1 mm of the cell's face"),
    ("unexplained", "none of these"),
];

/// Cells of a window as numbers, x fastest.
struct Grid {
    min_cell: [i32; 3],
}

impl Grid {
    fn number(&self, cell: [i32; 3]) -> Option<usize> {
        let size = [SIZE_X as i32, SIZE_Y as i32, SIZE_Z as i32];
        let offset = [0, 1, 2].map(|axis| cell[axis] - self.min_cell[axis]);
        let inside = (0..3).all(|axis| (0..size[axis]).contains(&offset[axis]));
        inside.then(|| (offset[0] + (offset[1] + offset[2] * size[1]) * size[0]) as usize)
    }

    fn cell(&self, number: usize) -> [i32; 3] {
        let offset = [
            number % SIZE_X,
            number / SIZE_X % SIZE_Y,
            number / SIZE_X / SIZE_Y,
        ];
        [0, 1, 2].map(|axis| self.min_cell[axis] + offset[axis] as i32)
    }
}

/// Compares `map` with the cells of OctoMap in the same window. `windows`: smallest cell of the window at each cloud of `series`.
pub fn compare(
    series: &Series,
    params: &ParamSet,
    map: &LocalMap,
    windows: &[[i32; 3]],
    there: &[Occupancy],
) -> Agreement {
    let grid = Grid {
        min_cell: map.min_cell,
    };
    let facts = facts(series, params, &grid, windows);
    let mut agreement = Agreement::default();
    let mut same = 0u64;
    for (number, (facts, there)) in facts.iter().zip(there).enumerate() {
        let cell = grid.cell(number);
        let here = match (map.is_occupied(cell), map.is_free(cell)) {
            (true, _) => Occupancy::Occupied,
            (false, true) => Occupancy::Free,
            (false, false) => Occupancy::Unknown,
        };
        let pair = format!("{}_{}", name(here), name(*there));
        if (here, *there) != (Occupancy::Unknown, Occupancy::Unknown) {
            agreement.cells += 1;
            same += u64::from(here == *there);
        }
        if here != *there {
            let reason = reason(here, *there, facts);
            *agreement
                .differences
                .entry(format!("{pair}: {reason}"))
                .or_default() += 1;
            let is_unsafe = (here, *there) == (Occupancy::Free, Occupancy::Occupied);
            agreement.free_here_occupied_there_unexplained += u64::from(is_unsafe && reason == "unexplained");
        }
        *agreement.confusion.entry(pair).or_default() += 1;
    }
    agreement.same = same as f64 / agreement.cells.max(1) as f64;
    agreement
}

fn name(occupancy: Occupancy) -> &'static str {
    match occupancy {
        Occupancy::Unknown => "unknown",
        Occupancy::Free => "free",
        Occupancy::Occupied => "occupied",
    }
}

fn reason(here: Occupancy, there: Occupancy, facts: &Facts) -> &'static str {
    use Occupancy::{Free, Occupied, Unknown};
    let hits = facts.hits > 0;
    let holds = |reason: &str| match reason {
        "body" => facts.body > 0 && here == Free,
        "left_window" => match there {
            Occupied => facts.early_hits > 0 && !hits,
            Free => here == Unknown && facts.early_crossed > 0 && facts.crossed == 0,
            Unknown => false,
        },
        "beyond_range" => here == Occupied && facts.far_hits > 0 && facts.far_hits == facts.hits,
        "hit_outlives_misses" => (here, there) == (Occupied, Free) && hits,
        "cut_off_end" => (here, there) == (Free, Unknown) && facts.cut_off > 0,
        "one_origin" => match (here, there) {
            (Free, Unknown) => facts.crossed > 0 && facts.crossed_from_middle == 0,
            (Unknown, Free) => facts.crossed == 0 && facts.crossed_from_middle > 0,
            // A cell that something has left needs looks through it: those from the one place miss it.
            (Free, Occupied) => facts.crossed > facts.crossed_from_middle,
            _ => false,
        },
        "early_exit" => (here, there) == (Unknown, Free) && facts.crossed > 0,
        "rounding" => facts.hits_at_face > 0 || facts.grazed > 0,
        _ => true,
    };
    let found = REASONS.iter().find(|(reason, _)| holds(reason));
    found.map_or("unexplained", |(reason, _)| reason)
}

/// What all rays said of the cells of `grid`.
fn facts(series: &Series, params: &ParamSet, grid: &Grid, windows: &[[i32; 3]]) -> Vec<Facts> {
    let mut facts = vec![Facts::default(); CELLS];
    // Every fact counts once per cloud.
    let mut marks = vec![0u16; CELLS];
    let radius_cells = params.get(&OA_VEH_RADIUS) / CELL_M;
    for (shot, min_cell) in series.shots.iter().zip(windows) {
        marks.fill(0);
        let window = Grid { min_cell: *min_cell };
        let reach_m = reach_m(shot, params);
        let middle_m = middle_m(series, shot);
        let mut mark = |cell: [i32; 3], bit: u16| {
            if let Some(number) = grid.number(cell) {
                marks[number] |= bit;
            }
        };
        for ray in local_rays(series, shot, params) {
            mark_ray(&ray, &window, reach_m, &middle_m, &mut mark);
        }
        let vehicle = vehicle_m(series, shot) / CELL_M;
        let around = radius_cells.ceil() as i32 + 1;
        let center = floor(&vehicle);
        for z in -around..=around {
            for y in -around..=around {
                for x in -around..=around {
                    let cell = [center[0] + x, center[1] + y, center[2] + z];
                    let middle = Vector3::from(cell.map(|index| f64::from(index) + 0.5));
                    if (middle - vehicle).norm() <= radius_cells + ROUNDING_CELLS {
                        mark(cell, BODY);
                    }
                }
            }
        }
        for (facts, marks) in facts.iter_mut().zip(&marks).filter(|(_, marks)| **marks != 0) {
            let add = |count: &mut u8, bit: u16| *count = count.saturating_add(u8::from(marks & bit != 0));
            add(&mut facts.hits, HIT);
            add(&mut facts.far_hits, FAR_HIT);
            add(&mut facts.early_hits, EARLY_HIT);
            add(&mut facts.hits_at_face, AT_FACE);
            add(&mut facts.crossed, CROSSED);
            add(&mut facts.early_crossed, EARLY_CROSSED);
            add(&mut facts.crossed_from_middle, FROM_MIDDLE);
            add(&mut facts.grazed, GRAZED);
            add(&mut facts.cut_off, CUT_OFF);
            add(&mut facts.body, BODY);
        }
    }
    facts
}

const HIT: u16 = 1;
const FAR_HIT: u16 = 2;
const EARLY_HIT: u16 = 4;
const AT_FACE: u16 = 8;
const CROSSED: u16 = 16;
const EARLY_CROSSED: u16 = 32;
const FROM_MIDDLE: u16 = 64;
const GRAZED: u16 = 128;
const CUT_OFF: u16 = 256;
const BODY: u16 = 512;

fn mark_ray(
    ray: &LocalRay,
    window: &Grid,
    reach_m: f64,
    middle_m: &Vector3<f64>,
    mark: &mut impl FnMut([i32; 3], u16),
) {
    let (origin, end) = (ray.origin_m / CELL_M, ray.end_m / CELL_M);
    let end_cell = floor(&end);
    let in_window = |cell| window.number(cell).is_some();
    if ray.is_hit {
        // OctoMap measures it from its one origin.
        let range_m = ray.range_m.max((ray.end_m - middle_m).norm());
        let is_far = range_m > reach_m - ROUNDING_CELLS * CELL_M;
        let bit = match in_window(end_cell) {
            true if is_far => HIT | FAR_HIT,
            true => HIT,
            // OctoMap has no hits beyond the range.
            false if is_far => 0,
            false => EARLY_HIT,
        };
        mark(end_cell, bit);
        near_faces(&end, |cell| mark(cell, AT_FACE));
    }
    let share = (reach_m / ray.range_m).min(1.0);
    let cut = origin + (end - origin) * share;
    if share < 1.0 {
        mark(floor(&cut), CUT_OFF);
        near_faces(&cut, |cell| mark(cell, GRAZED));
    }
    let last = floor(&cut);
    walk(&origin, &cut, |cell, passage| {
        let crossed = if in_window(cell) { CROSSED } else { EARLY_CROSSED };
        match passage {
            Passage::Beside => mark(cell, GRAZED),
            _ if cell == last => {}
            Passage::Brief => mark(cell, crossed | GRAZED),
            Passage::Through => mark(cell, crossed),
        }
    });
    let from = middle_m / CELL_M;
    let length = (end - from).norm();
    let share = if ray.is_hit {
        (reach_m / CELL_M / length).min(1.0)
    } else {
        reach_m / CELL_M / length
    };
    let cut = from + (end - from) * share;
    let last = floor(&cut);
    walk(&from, &cut, |cell, passage| match passage {
        Passage::Beside => mark(cell, GRAZED),
        _ if cell == last => {}
        Passage::Brief | Passage::Through => mark(cell, FROM_MIDDLE),
    });
}

fn floor(point: &Vector3<f64>) -> [i32; 3] {
    [
        point.x.floor() as i32,
        point.y.floor() as i32,
        point.z.floor() as i32,
    ]
}

/// The cells that `point` lies in or within rounding of, if it is near a face.
fn near_faces(point: &Vector3<f64>, mut at: impl FnMut([i32; 3])) {
    let own = floor(point);
    for corner in 0..8 {
        let shift = |axis: usize| {
            if corner >> axis & 1 == 0 {
                -ROUNDING_CELLS
            } else {
                ROUNDING_CELLS
            }
        };
        let cell = floor(&(point + Vector3::new(shift(0), shift(1), shift(2))));
        if cell != own {
            at(cell);
            at(own);
        }
    }
}

/// How a ray passes a cell.
#[derive(Clone, Copy)]
enum Passage {
    /// It crosses it.
    Through,
    /// It crosses it for no more than rounding.
    Brief,
    /// It misses it by no more than rounding.
    Beside,
}

/// Calls `at` for every cell from `from` to `to`, both included, by sorted crossings, and for those that it nearly crosses.
fn walk(from: &Vector3<f64>, to: &Vector3<f64>, mut at: impl FnMut([i32; 3], Passage)) {
    let ray = to - from;
    let length = ray.norm();
    let mut cell = floor(from);
    let last = floor(to);
    let mut next = [f64::INFINITY; 3];
    let mut step = [0; 3];
    for axis in 0..3 {
        step[axis] = (last[axis] - cell[axis]).signum();
        if step[axis] != 0 {
            let face = f64::from(cell[axis] + i32::from(step[axis] > 0));
            next[axis] = (face - from[axis]) / ray[axis];
        }
    }
    let mut entered = 0.0;
    loop {
        let axis = (0..3).fold(0, |best, axis| if next[axis] < next[best] { axis } else { best });
        let left = next[axis].min(1.0);
        let is_near = (left - entered) * length < 2.0 * ROUNDING_CELLS;
        at(cell, if is_near { Passage::Brief } else { Passage::Through });
        if cell == last || next[axis] > 1.0 + 1e-9 {
            return;
        }
        // Where two crossings nearly coincide, the neighbour on the other side of the edge might be crossed instead.
        for other in (0..3).filter(|other| *other != axis) {
            if (next[other] - next[axis]).abs() * length < 2.0 * ROUNDING_CELLS {
                let mut neighbour = cell;
                neighbour[other] += step[other];
                at(neighbour, Passage::Beside);
            }
        }
        entered = left;
        cell[axis] += step[axis];
        next[axis] += 1.0 / ray[axis].abs();
    }
}
