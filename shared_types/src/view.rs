//! What a vehicle's sensors can see: directions in the body frame in which range sensors have given answers.
//!
//! It is learned from the answers themselves, whatever driver they come from, so that it is right for any sensor and any
//! mounting, and shows what is covered.

use crate::reserved::Reserved;
use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Directions around the vehicle: columns of 5 degrees, clockwise from forward.
pub const COLUMNS: usize = 72;
/// A view that reaches higher than this shows where a climb leads (rad).
const HIGH_RAD: f64 = 0.6;
/// Directions from straight down to straight up: rows of 5 degrees.
pub const ROWS: usize = 36;
/// Width of a row and of a column (rad).
pub const STEP_RAD: f64 = TAU / COLUMNS as f64;

crate::sample! {
    /// A field of view: one bit per direction, and how near and how far is seen.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct FieldOfView: 608 {
        /// Row by row from straight down, bit `c` of the 128 for the column at `c` times 5 degrees to the right of forward.
        pub seen: [[u64; 2]; ROWS],
        /// What is nearer than this to a sensor is not seen (m): the largest shortest range of the sensors that see an area.
        pub near_m: f32,
        /// What is farther than this is not seen (m): the largest range up to which rays clear the map.
        pub far_m: f32,
        /// Declared: what a planar sensor says of its plane counts this far above it (m) ...
        pub band_up_m: f32,
        /// ... and this far below (m).
        pub band_down_m: f32,
        /// Range sensors that have given answers.
        pub sensors: u32,
        /// Room for later fields, zero.
        pub reserved: Reserved<12>,
    }
}

impl Default for FieldOfView {
    fn default() -> Self {
        Self {
            seen: [[0; 2]; ROWS],
            near_m: 0.0,
            far_m: 0.0,
            band_up_m: 0.0,
            band_down_m: 0.0,
            sensors: 0,
            reserved: Reserved::ZERO,
        }
    }
}

/// Row and column of a direction (body, any length but zero).
pub fn bin_of(direction: &Vector3<f64>) -> (usize, usize) {
    let level = direction.xy().norm();
    let up_rad = (-direction.z).atan2(level);
    let right_rad = direction.y.atan2(direction.x).rem_euclid(TAU);
    // A cast of a float stops at zero.
    let row = ((up_rad + FRAC_PI_2) / STEP_RAD) as usize;
    let column = (right_rad / STEP_RAD) as usize;
    (row.min(ROWS - 1), column.min(COLUMNS - 1))
}

impl FieldOfView {
    /// Adds a direction (body) in which a sensor has seen something, or nothing.
    pub fn add(&mut self, direction: &Vector3<f64>) {
        let (row, column) = bin_of(direction);
        self.seen[row][column >> 6] |= 1 << (column & 63);
    }

    /// Adds all directions of another field of view.
    pub fn join(&mut self, other: &Self) {
        for (row, more) in self.seen.iter_mut().flatten().zip(other.seen.iter().flatten()) {
            *row |= more;
        }
    }

    /// Whether anything is seen at all.
    pub fn is_empty(&self) -> bool {
        self.seen.iter().flatten().all(|word| *word == 0)
    }

    /// Whether the direction in `row` and `column` is seen; columns count on beyond a turn.
    pub fn is_seen(&self, row: usize, column: usize) -> bool {
        let column = column % COLUMNS;
        row < ROWS && self.seen[row][column >> 6] >> (column & 63) & 1 == 1
    }

    /// Whether something at `offset_m` (body, from the vehicle) is in view: in a direction in which a sensor looks, or in the band of a
    /// planar one, and neither too near nor too far. What may stand between is not looked at.
    pub fn covers(&self, offset_m: &Vector3<f64>) -> bool {
        let range_m = offset_m.norm();
        if range_m < f64::from(self.near_m) || range_m > f64::from(self.far_m) {
            return false;
        }
        let (row, column) = bin_of(offset_m);
        self.is_seen(row, column) || self.is_in_band(offset_m, column)
    }

    /// Whether it lies in the declared band of a planar sensor that looks into that column.
    fn is_in_band(&self, offset_m: &Vector3<f64>, column: usize) -> bool {
        let (up_m, down_m) = (f64::from(self.band_up_m), f64::from(self.band_down_m));
        let is_beside = -offset_m.z <= up_m && offset_m.z <= down_m;
        let horizon = ROWS / 2;
        is_beside && (self.is_seen(horizon, column) || self.is_seen(horizon - 1, column))
    }

    /// Whether every direction around is seen at the height of the horizon.
    pub fn is_all_around(&self) -> bool {
        (0..COLUMNS).all(|column| self.is_level_seen(column))
    }

    /// Whether it is seen 35 degrees up and more in at least a quarter of the directions around.
    pub fn is_high(&self) -> bool {
        let is_high = |column: &usize| {
            self.height_rad(*column)
                .is_some_and(|[_, up_rad]| up_rad > HIGH_RAD)
        };
        (0..COLUMNS).filter(is_high).count() >= COLUMNS / 4
    }

    /// How far to the left and to the right of forward it is seen without a gap at the height of the horizon (rad).
    pub fn aside_rad(&self) -> [f64; 2] {
        let right = (0..COLUMNS / 2)
            .take_while(|column| self.is_level_seen(*column))
            .count();
        let left = (0..COLUMNS / 2)
            .take_while(|column| self.is_level_seen(COLUMNS - 1 - column))
            .count();
        [left, right].map(|columns| columns as f64 * STEP_RAD)
    }

    /// Whether `column` is seen at the height of the horizon.
    pub fn is_level_seen(&self, column: usize) -> bool {
        self.is_seen(ROWS / 2, column) || self.is_seen(ROWS / 2 - 1, column)
    }

    /// Lowest and highest direction seen without a gap around the horizon in `column` (rad, up positive); `None` if the horizon is
    /// not seen there.
    pub fn height_rad(&self, column: usize) -> Option<[f64; 2]> {
        let horizon = ROWS / 2;
        let up = (horizon..ROWS)
            .take_while(|row| self.is_seen(*row, column))
            .count();
        let down = (0..horizon)
            .rev()
            .take_while(|row| self.is_seen(*row, column))
            .count();
        (up + down > 0).then(|| [-(down as f64) * STEP_RAD, up as f64 * STEP_RAD])
    }
}

/// What a vehicle needs to see to leave the place where it has taken off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Needs {
    /// Distance around the centre that has to be known to be free in the slowest motion (m).
    pub clearance_m: f64,
    /// Declared: so near to the place of the take-off everything is free (m); zero for none.
    pub start_bubble_m: f64,
    /// Declared: nothing hangs from above.
    pub no_overhang: bool,
    /// It stands on the ground, which hides what is below.
    pub is_landed: bool,
}

crate::wire_enum! {
    /// What no sensor sees.
    pub enum Missing {
        /// Nothing is missing, as far as is known.
        Nothing = 0 "nothing",
        /// No sensor answers.
        Everything = 1 "anything",
        /// No sensor looks around.
        Ahead = 2 "ahead",
        /// No sensor looks far enough up.
        Above = 3 "above",
        /// No sensor looks far enough down.
        Below = 4 "below",
        /// What is beside the vehicle while it climbs is not seen.
        SidesAtStart = 5 "beside the start",
    }
}

impl Missing {
    /// For the pilot, as "nobody sees above".
    pub fn text(self) -> String {
        format!("nobody sees {self}")
    }

    /// What would remedy it.
    pub fn remedy(self) -> &'static str {
        match self {
            Missing::Nothing => "",
            Missing::Everything => "look at the sensors: jink status, jink check sensors",
            Missing::Ahead => "add a sensor that looks to the horizon",
            Missing::Above => {
                "add a sensor that looks up; or declare band_up_m and band_down_m of a planar sensor (0.8 and more), or OA_DCL_HANG_LO \
                 and OA_DCL_HANG_HI where nothing hangs from above"
            }
            Missing::Below => {
                "add a sensor that looks down; or declare band_down_m of a planar sensor (0.8 and more)"
            }
            Missing::SidesAtStart => {
                "add sensors that look to the sides; or declare OA_DCL_START, 0.8 and more, where the pilot sees to it that nothing \
                 stands beside the take-off"
            }
        }
    }
}

/// Width of a cell of the map (m), by which what has to be known grows.
const CELL_M: f64 = crate::map::CELL_M;
/// What is to be flown through must have been seen from this share of the sensors' range: nearer it may have been hidden.
const FROM_AFAR: f64 = 0.8;

impl FieldOfView {
    /// What is missing for a vehicle that has been seeing so since it stood on the ground; `None` if nothing is.
    ///
    /// A place ahead is known once it has been seen from afar: as high above and as deep below as the vehicle needs room, from no
    /// farther than four fifths of the range. And the vehicle must come away from where it hovers: what is unknown must be left
    /// behind, so that half of all directions around have to be seen, or declared.
    pub fn missing(&self, needs: &Needs) -> Option<Missing> {
        if self.is_empty() {
            return Some(Missing::Everything);
        }
        let level: Vec<usize> = (0..COLUMNS)
            .filter(|column| self.is_level_seen(*column))
            .collect();
        if level.is_empty() {
            return Some(Missing::Ahead);
        }
        // Cells count if all of them is known, whichever part of its cell the vehicle is in.
        let clearance_m = (needs.clearance_m / CELL_M).ceil() * CELL_M + 0.5 * CELL_M;
        let needed_rad = (clearance_m / (FROM_AFAR * f64::from(self.far_m))).atan();
        let reaches = |rad: f64, band_m: f32| {
            // The outermost row may be seen in part.
            rad - 0.5 * STEP_RAD >= needed_rad || f64::from(band_m) >= clearance_m
        };
        let heights = || level.iter().filter_map(|column| self.height_rad(*column));
        if !needs.no_overhang && !heights().any(|[_, up]| reaches(up, self.band_up_m)) {
            return Some(Missing::Above);
        }
        if !needs.is_landed && !heights().any(|[down, _]| reaches(-down, self.band_down_m)) {
            return Some(Missing::Below);
        }
        let widest = (0..COLUMNS)
            .map(|first| {
                (0..COLUMNS)
                    .take_while(|column| self.is_level_seen(first + column))
                    .count()
            })
            .max();
        let is_beside = widest.unwrap_or(0) >= COLUMNS / 2 || needs.start_bubble_m >= clearance_m;
        (!is_beside).then_some(Missing::SidesAtStart)
    }
}

#[cfg(test)]
mod tests {
    use super::{FieldOfView, Missing, Needs, STEP_RAD, bin_of};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn toward(right_deg: f64, up_deg: f64) -> Vector3<f64> {
        let (right, up) = (right_deg.to_radians(), up_deg.to_radians());
        Vector3::new(up.cos() * right.cos(), up.cos() * right.sin(), -up.sin())
    }

    proptest! {
        #[test]
        fn a_direction_that_was_seen_is_in_view_at_any_range(
            right in -180.0..180.0f64, up in -90.0..90.0f64, range in 0.5..10.0f64,
        ) {
            let mut view = FieldOfView { near_m: 0.3, far_m: 12.0, ..FieldOfView::default() };
            prop_assert!(view.is_empty() && !view.covers(&(toward(right, up) * range)));
            view.add(&(toward(right, up) * 3.0));
            prop_assert!(view.covers(&(toward(right, up) * range)));
            prop_assert!(!view.covers(&(toward(right, up) * 0.2)) && !view.covers(&(toward(right, up) * 13.0)));
        }
    }

    #[test]
    fn rows_count_from_below_and_columns_clockwise_from_forward() {
        assert_eq!(bin_of(&toward(2.0, 2.0)), (18, 0));
        assert_eq!(bin_of(&toward(-2.0, -2.0)), (17, 71));
        assert_eq!(bin_of(&toward(92.0, -90.0)).0, 0);
        assert_eq!(bin_of(&toward(92.0, 89.0)), (35, 18));
    }

    #[test]
    fn a_view_is_high_if_a_quarter_of_it_reaches_35_degrees_up() {
        let is_high = |columns: i32, up_deg: i32| {
            let mut view = FieldOfView::default();
            for column in 0..columns {
                (-2..up_deg / 5)
                    .for_each(|row| view.add(&toward(f64::from(column * 5) + 2.0, f64::from(row * 5) + 2.0)));
            }
            view.is_high()
        };
        assert!(is_high(72, 50) && is_high(18, 40) && !is_high(17, 50));
        assert!(!is_high(72, 30) && !is_high(72, 15));
    }

    #[test]
    fn a_band_is_seen_beside_the_plane_only() {
        let mut view = FieldOfView {
            near_m: 0.1,
            far_m: 12.0,
            band_up_m: 1.0,
            band_down_m: 0.5,
            ..FieldOfView::default()
        };
        view.add(&toward(1.0, 0.0));
        assert!(view.covers(&Vector3::new(1.0, 0.0, -0.9)) && view.covers(&Vector3::new(1.0, 0.0, 0.4)));
        assert!(!view.covers(&Vector3::new(1.0, 0.0, -1.1)) && !view.covers(&Vector3::new(1.0, 0.0, 0.6)));
        assert!(!view.covers(&Vector3::new(-1.0, 0.0, 0.3)));
        let [low, high] = view.height_rad(0).unwrap();
        assert!((low, high) == (0.0, STEP_RAD) && view.height_rad(9).is_none());
    }

    const NEEDS: Needs = Needs {
        clearance_m: 0.59,
        start_bubble_m: 0.0,
        no_overhang: false,
        is_landed: false,
    };

    fn looking(aside_deg: f64, low_deg: f64, high_deg: f64) -> FieldOfView {
        let mut view = FieldOfView {
            near_m: 0.1,
            far_m: 12.0,
            ..FieldOfView::default()
        };
        for aside in -360..360 {
            for up in -180..180 {
                let (aside, up) = (f64::from(aside) * 0.5 + 0.25, f64::from(up) * 0.5 + 0.25);
                if aside.abs() <= aside_deg && (low_deg..=high_deg).contains(&up) {
                    view.add(&toward(aside, up));
                }
            }
        }
        view
    }

    #[test]
    fn a_sensor_set_that_cannot_fly_is_reported_with_what_it_lacks() {
        let of = |aside, low, high| looking(aside, low, high).missing(&NEEDS);
        assert_eq!(FieldOfView::default().missing(&NEEDS), Some(Missing::Everything));
        for (low, high) in [(-7.0, 52.0), (-45.0, 45.0), (-22.5, 22.5), (-15.0, 15.0)] {
            assert_eq!(of(180.0, low, high), None, "{low} to {high}");
        }
        assert_eq!(of(180.0, 0.0, 1.0), Some(Missing::Above), "one plane");
        assert_eq!(of(180.0, 0.0, 50.0), Some(Missing::Below));
        assert_eq!(of(180.0, -90.0, -60.0), Some(Missing::Ahead));
        assert_eq!(of(43.5, -29.0, 29.0), Some(Missing::SidesAtStart), "one camera");
        assert_eq!(of(118.0, -29.0, 29.0), None, "three of them");
    }

    #[test]
    fn what_is_declared_need_not_be_seen() {
        let camera = looking(43.5, -29.0, 29.0);
        let started = Needs {
            start_bubble_m: 1.0,
            ..NEEDS
        };
        assert_eq!(camera.missing(&started), None);
        let mut plane = looking(160.0, 0.0, 1.0);
        let open_above = Needs {
            no_overhang: true,
            ..NEEDS
        };
        assert_eq!(plane.missing(&open_above), Some(Missing::Below));
        (plane.band_up_m, plane.band_down_m) = (0.4, 0.4);
        assert_eq!(plane.missing(&NEEDS), Some(Missing::Above), "too narrow a band");
        (plane.band_up_m, plane.band_down_m) = (0.8, 0.8);
        assert_eq!(plane.missing(&NEEDS), None);
    }
}
