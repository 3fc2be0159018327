//! What one sensor saw at one moment: per sector how far it is free, per slot of a sector the nearest hit, fixed in
//! local NED.

use super::bearing::{SLOTS, sector_toward};
use jink_shared_types::Timestamp;
use jink_shared_types::pose_history::Pose;
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS};

/// The nearest hit of one slot of a [`SensorView`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlotHit {
    /// Forward and right of the view's origin (m); infinite for none.
    pub level_m: [f32; 2],
    /// When it was measured.
    pub seen: Timestamp,
}

impl SlotHit {
    /// No hit.
    pub const NONE: Self = Self {
        level_m: [f32::INFINITY; 2],
        seen: Timestamp::NEVER,
    };
}

/// One sector of a [`SensorView`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewSector {
    /// Squared horizontal distance of the nearest hit (m2); infinity for none.
    pub near_m2: f32,
    /// Squared horizontal distance up to which a ray found it free (m2); zero for unknown.
    pub known_m2: f32,
    /// The same with rays that leave the height band through its bottom (m2), where space above a free place counts as free: not less.
    pub under_m2: f32,
    /// When it was measured.
    pub seen: Timestamp,
}

impl ViewSector {
    /// Nothing known.
    pub const UNKNOWN: Self = Self {
        near_m2: f32::INFINITY,
        known_m2: 0.0,
        under_m2: 0.0,
        seen: Timestamp::NEVER,
    };

    /// Squared range that is known to be free (m2): no farther than any ray saw, no farther than the nearest hit.
    pub fn free_m2(&self) -> f32 {
        self.near_m2.min(self.known_m2)
    }

    /// The same; `no_overhang`: space above a free place counts as free.
    fn free_under_m2(&self, no_overhang: bool) -> f32 {
        match no_overhang {
            true => self.near_m2.min(self.under_m2),
            false => self.free_m2(),
        }
    }

    /// Whether anything is known of it.
    pub fn is_known(&self) -> bool {
        self.known_m2 > 0.0 || self.near_m2.is_finite()
    }
}

/// The sectors around the place where the vehicle was, in the level frame that had its heading.
#[derive(Clone, Debug)]
pub struct SensorView {
    /// The vehicle's position (m): north, east.
    pub origin_m: [f64; 2],
    /// Its height as down coordinate (m).
    pub down_m: f64,
    /// Its heading (rad).
    pub heading_rad: f64,
    /// Cosine and sine of the heading.
    turn: [f32; 2],
    /// The sectors.
    pub sectors: [ViewSector; SECTORS],
    /// The nearest hits.
    pub hits: [SlotHit; SLOTS],
}

impl SensorView {
    /// Nothing known, anywhere.
    pub fn unknown() -> Self {
        Self {
            origin_m: [0.0; 2],
            down_m: 0.0,
            heading_rad: 0.0,
            turn: [1.0, 0.0],
            sectors: [ViewSector::UNKNOWN; SECTORS],
            hits: [SlotHit::NONE; SLOTS],
        }
    }

    /// Clears everything and moves the origin to `pose`.
    pub fn reset(&mut self, pose: &Pose) {
        self.origin_m = [pose.position_m.x, pose.position_m.y];
        self.down_m = pose.position_m.z;
        self.heading_rad = pose.yaw_rad();
        let (sin, cos) = self.heading_rad.sin_cos();
        self.turn = [cos as f32, sin as f32];
        self.sectors = [ViewSector::UNKNOWN; SECTORS];
        self.hits = [SlotHit::NONE; SLOTS];
    }

    /// A local NED place (north, east) as forward and right of the origin (m).
    pub fn level(&self, place_m: [f64; 2]) -> [f32; 2] {
        let north = (place_m[0] - self.origin_m[0]) as f32;
        let east = (place_m[1] - self.origin_m[1]) as f32;
        let [cos, sin] = self.turn;
        [north * cos + east * sin, east * cos - north * sin]
    }

    /// Forward and right of the origin (m) as a local NED place (north, east).
    pub fn local(&self, level_m: [f32; 2]) -> [f64; 2] {
        let [cos, sin] = self.turn;
        let north = level_m[0] * cos - level_m[1] * sin;
        let east = level_m[0] * sin + level_m[1] * cos;
        [
            self.origin_m[0] + f64::from(north),
            self.origin_m[1] + f64::from(east),
        ]
    }

    /// The nearest hits, as places in local NED (north, east) with the times of their measurement.
    pub fn places(&self) -> impl Iterator<Item = ([f64; 2], Timestamp)> {
        self.hits
            .iter()
            .filter(|hit| hit.level_m[0].is_finite())
            .map(|hit| (self.local(hit.level_m), hit.seen))
    }

    /// Whether this view saw the place (north, east) to be free; `no_overhang`: space above a free place counts as free.
    pub fn admits(&self, place_m: [f64; 2], no_overhang: bool) -> bool {
        let [forward, right] = self.level(place_m);
        let distance_m2 = forward * forward + right * right;
        distance_m2 <= self.sectors[sector_toward(forward, right)].free_under_m2(no_overhang)
    }

    /// Whether one of this view's own hits lies within `clearance_m` of the place (north, east).
    pub fn has_hit_within(&self, place_m: [f64; 2], clearance_m: f32) -> bool {
        let [forward, right] = self.level(place_m);
        let limit_m2 = clearance_m * clearance_m;
        self.hits.iter().any(|hit| {
            let (df, dr) = (hit.level_m[0] - forward, hit.level_m[1] - right);
            df * df + dr * dr < limit_m2
        })
    }

    /// How far from `place_m` (north, east) in the direction `heading_rad` the view knows to be free. `None` if it
    /// knows nothing there.
    ///
    /// The free region is a fan of 72 wedges around the origin. Seen from the origin the ray turns in one direction
    /// only, so the wedges it crosses are consecutive, and in each one it ends at the border, or at the wedge's radius.
    /// Within `footprint_m` of the origin the vehicle itself has been, so it counts as free; a ray that does not lead
    /// out of there has no result, nor does one that is no longer than that.
    pub fn free_distance_m(
        &self,
        borders: &SectorBorders,
        place_m: [f64; 2],
        heading_rad: f64,
        footprint_m: f32,
    ) -> Option<FreeDistance<'_>> {
        let start = self.level(place_m);
        let (sin, cos) = (heading_rad - self.heading_rad).sin_cos();
        let along = [cos as f32, sin as f32];
        let offset_m2 = dot(start, start);
        let footprint_m = footprint_m + offset_m2.sqrt();
        let last = sector_toward(along[0], along[1]);
        // At the origin itself there is no bearing to start from: all of the ray lies in one wedge.
        let at_origin = offset_m2 < 1e-8;
        let mut index = if at_origin {
            last
        } else {
            sector_toward(start[0], start[1])
        };
        let clockwise = cross(start, along) >= 0.0;
        let out_m = exit_m(start, along, footprint_m * footprint_m);
        let (mut way_m, mut last_known) = (0.0, None);
        for _ in 0..=SECTORS {
            let sector = &self.sectors[index];
            if sector.is_known() {
                last_known = Some(sector);
            }
            let radius_m2 = sector.free_m2().max(footprint_m * footprint_m);
            let rim_m = exit_m(start, along, radius_m2);
            let border_m = if index == last {
                f32::INFINITY
            } else {
                borders.crossing_m(index, clockwise, start, along, way_m)
            };
            if rim_m <= border_m {
                let way = FreeDistance {
                    way_m: rim_m.max(way_m),
                    ends_at_obstacle: rim_m >= way_m && sector.near_m2 <= sector.known_m2,
                    sector: last_known?,
                };
                return (way.way_m > out_m.max(footprint_m)).then_some(way);
            }
            way_m = border_m;
            index = (index + if clockwise { 1 } else { SECTORS - 1 }) % SECTORS;
        }
        None
    }
}

/// The free distance in one direction.
#[derive(Clone, Copy, Debug)]
pub struct FreeDistance<'a> {
    /// How far (m).
    pub way_m: f32,
    /// It ends at the nearest hit of a sector, not where knowledge ends.
    pub ends_at_obstacle: bool,
    /// The last known sector along it.
    pub sector: &'a ViewSector,
}

/// Where the ray from `start` along `along` leaves the circle of radius squared `radius_m2` around the origin (m);
/// negative if it is outside for good.
fn exit_m(start: [f32; 2], along: [f32; 2], radius_m2: f32) -> f32 {
    let forward = dot(start, along);
    let chord = forward * forward + radius_m2 - dot(start, start);
    if chord < 0.0 { -1.0 } else { chord.sqrt() - forward }
}

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

fn cross(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[1] - a[1] * b[0]
}

/// The directions that separate neighbouring sectors: entry `i` lies between sectors `i` and `i + 1`.
#[derive(Clone, Debug)]
pub struct SectorBorders([[f32; 2]; SECTORS]);

impl SectorBorders {
    /// Computes them once.
    pub fn new() -> Self {
        Self(std::array::from_fn(|i| {
            let (sin, cos) = ((i as f64 + 0.5) * SECTOR_WIDTH_RAD).sin_cos();
            [cos as f32, sin as f32]
        }))
    }

    /// Where a ray leaves sector `index` in its turning direction (m), not before `from_m`; infinity if it never does.
    fn crossing_m(
        &self,
        index: usize,
        clockwise: bool,
        start: [f32; 2],
        along: [f32; 2],
        from_m: f32,
    ) -> f32 {
        /// A crossing this little behind (m) was moved by rounding; farther behind, the ray is nearly parallel to the
        /// border and never crosses it.
        const ROUNDING_M: f32 = 1e-3;
        let border = self.0[if clockwise {
            index
        } else {
            (index + SECTORS - 1) % SECTORS
        }];
        let way_m = -cross(border, start) / cross(border, along);
        if way_m >= from_m - ROUNDING_M {
            way_m.max(from_m)
        } else {
            f32::INFINITY
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{FreeDistance, SectorBorders, SensorView, ViewSector};
    use jink_shared_types::pose_history::Pose;
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    fn view(ranges: &[f32], heading_rad: f64) -> SensorView {
        let mut view = SensorView::unknown();
        view.reset(&Pose {
            position_m: Vector3::new(100.0, -50.0, -3.0),
            local_q_body: UnitQuaternion::from_euler_angles(0.0, 0.0, heading_rad),
        });
        for (sector, range) in view.sectors.iter_mut().zip(ranges) {
            *sector = ViewSector {
                known_m2: range * range,
                ..ViewSector::UNKNOWN
            };
        }
        view
    }

    proptest! {
        #[test]
        fn the_free_distance_is_free_at_every_point(
            ranges in proptest::collection::vec(prop_oneof![Just(0.0f32), 1.0..20.0f32], 72),
            heading in -3.0..3.0f64, toward in -3.0..3.0f64, north in -0.7..0.7f64, east in -0.7..0.7f64,
        ) {
            let view = view(&ranges, heading);
            let place = [100.0 + north, -50.0 + east];
            let footprint = 0.3 + (north.hypot(east) as f32);
            if let Some(FreeDistance { way_m, sector, .. }) = view.free_distance_m(&SectorBorders::new(), place, toward, 0.3) {
                let (sin, cos) = toward.sin_cos();
                prop_assert!(sector.is_known());
                let end = [north + cos * f64::from(way_m), east + sin * f64::from(way_m)];
                prop_assert!(end[0].hypot(end[1]) >= f64::from(footprint) - 1e-4, "it ends where the vehicle was");
                for i in 0..200 {
                    let s = f64::from(way_m) * f64::from(i) / 200.0;
                    let point = [place[0] + cos * s, place[1] + sin * s];
                    let from_origin = (point[0] - 100.0).hypot(point[1] + 50.0);
                    // Slightly to either side: at a border both neighbours are right.
                    let admitted = [-1e-3, 0.0, 1e-3].iter().any(|aside| {
                        view.admits([point[0] - sin * aside, point[1] + cos * aside], false)
                    });
                    prop_assert!(admitted || from_origin <= f64::from(footprint) + 1e-3, "at {} of {}", s, way_m);
                }
            }
        }

        #[test]
        fn from_its_own_place_a_view_reports_each_sector_as_it_is(
            ranges in proptest::collection::vec(1.0..20.0f32, 72), sector in 0..72usize,
        ) {
            let view = view(&ranges, 1.0);
            let toward = 1.0 + jink_shared_types::ring::sector_bearing_rad(sector);
            let way = view.free_distance_m(&SectorBorders::new(), view.origin_m, toward, 0.3).unwrap();
            prop_assert!(!way.ends_at_obstacle);
            prop_assert!((way.way_m - ranges[sector]).abs() < 1e-4);
        }
    }

    #[test]
    fn a_view_knows_nothing_where_it_did_not_look() {
        let mut ranges = [0.0; 72];
        ranges[..9].fill(8.0);
        ranges[64..].fill(8.0);
        let view = view(&ranges, 0.0);
        let borders = SectorBorders::new();
        let ahead = view.free_distance_m(&borders, [99.0, -50.0], 0.0, 0.3);
        assert!(
            ahead.is_some_and(|way| (way.way_m - 9.0).abs() < 1e-3),
            "one metre behind its own place it still knows what it saw"
        );
        assert!(
            view.free_distance_m(&borders, [100.0, -50.0], std::f64::consts::PI, 0.3)
                .is_none()
        );
        assert!(!view.admits([99.0, -50.0], true));
    }
}
