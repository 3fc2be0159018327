//! Obstacles as points and faces between them, and the first contact of a straight flight with them.
//!
//! A sector says how far its nearest hit is, not where in its 5 degrees. The hit is placed where a wall would have it:
//!
//! | sector | where its hit is placed |
//! |---|---|
//! | one of its neighbours ends nearer | at the edge to the nearer one: a wall that comes nearer on that side is nearest there |
//! | it ends before both | at both edges, with a face between: it may be anywhere in there |
//!
//! Neighbours' hits less than twice the standoff apart are joined by a face: nothing that keeps the standoff from both
//! passes between them. So are those that may belong to one wall ([`STEEP`]). With points alone, a flight along a wall
//! would seem to approach every one of them, and one towards it to pass between them.
//!
//! A disc with the standoff as radius that moves straight on touches a point or a face at a place with a normal. The
//! distance left in this direction limits the speed *along the normal*; what it passes beside does not count at all.
//!
//! What is small and isolated may be a person who takes another step: it is listed separately, for a stricter limit.

use super::sector_states::{SectorState, SectorStates};
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS};
use nalgebra::{Rotation2, Vector2};

/// What is joined and not longer than this (m) may be a person, an animal, a vehicle: something that moves.
const SMALL_M: f64 = 1.5;
/// Hits of neighbouring sectors are joined up to so many times the width of a sector there: a wall seen at 15 degrees, and at 10 where its
/// sectors lie well.
const STEEP: f64 = 6.0;
/// A part of a unit vector shorter than this has no direction.
const NONE: f64 = 1e-6;
/// Most points: two for each sector.
const POINTS: usize = 2 * SECTORS;

/// The first contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstContact {
    /// Unit vector from the vehicle towards the obstacle at the contact.
    pub normal: Vector2<f64>,
    /// How far the vehicle may still move along the normal (m); negative if it is too near already.
    pub room_m: f64,
}

/// One hit, seen from the vehicle (m).
#[derive(Clone, Copy, Debug)]
struct OutlinePoint {
    place: Vector2<f64>,
    /// A face leads from here to the next one.
    is_joined: bool,
    /// An obstacle, not the end of what is known.
    is_solid: bool,
}

/// All hits, clockwise.
#[derive(Clone, Debug)]
pub struct Outline {
    hits: [OutlinePoint; POINTS],
    len: usize,
    /// The nearest hits of what is small and isolated.
    isolated: [Vector2<f64>; SECTORS],
    isolated_len: usize,
    keep_m: f64,
}

impl Outline {
    /// The outline of `sectors`, to be kept `keep_m` away from.
    pub fn of(sectors: &SectorStates, keep_m: f64) -> Self {
        let nothing = OutlinePoint {
            place: Vector2::zeros(),
            is_joined: false,
            is_solid: false,
        };
        let mut outline = Self {
            hits: [nothing; POINTS],
            len: 0,
            isolated: [Vector2::zeros(); SECTORS],
            isolated_len: 0,
            keep_m,
        };
        for (sector, toward, reach_m) in sectors.known() {
            let ends_at = |sector: usize| {
                sectors.states[sector % SECTORS]
                    .reach_m()
                    .unwrap_or(f64::INFINITY)
            };
            let (left_m, right_m) = (ends_at(sector + SECTORS - 1), ends_at(sector + 1));
            let is_solid = matches!(sectors.states[sector], SectorState::Hit { .. });
            let mut push = |aside: f64, is_joined: bool| {
                let place = Rotation2::new(0.5 * aside * SECTOR_WIDTH_RAD) * toward * reach_m;
                outline.push(OutlinePoint {
                    place,
                    is_joined,
                    is_solid,
                });
            };
            if left_m < reach_m && left_m <= right_m {
                push(-1.0, false);
            } else if right_m < reach_m {
                push(1.0, false);
            } else {
                push(-1.0, true);
                push(1.0, false);
            }
        }
        outline.join();
        outline.find_isolated(sectors);
        outline
    }

    /// The nearest hits (m) of everything small and isolated.
    pub fn isolated(&self) -> &[Vector2<f64>] {
        &self.isolated[..self.isolated_len]
    }

    fn find_isolated(&mut self, sectors: &SectorStates) {
        let place = |sector: usize| match sectors.states[sector % SECTORS] {
            SectorState::Hit { distance_m, .. } => Some(sectors.directions[sector % SECTORS] * distance_m),
            SectorState::Clear { .. } | SectorState::Unknown => None,
        };
        let keep_m = self.keep_m;
        let goes_on = |sector: usize| match (place(sector), place(sector + 1)) {
            (Some(this), Some(next)) => is_one(&this, &next, keep_m),
            _ => false,
        };
        for first in (0..SECTORS).filter(|first| !goes_on(first + SECTORS - 1)) {
            let Some(begin) = place(first) else { continue };
            let (mut nearest, mut end, mut sector) = (begin, begin, first);
            while sector < first + SECTORS && goes_on(sector) {
                sector += 1;
                end = place(sector).unwrap_or(end);
                if end.norm() < nearest.norm() {
                    nearest = end;
                }
            }
            if (end - begin).norm() <= SMALL_M {
                self.isolated[self.isolated_len] = nearest;
                self.isolated_len += 1;
            }
        }
    }

    fn push(&mut self, hit: OutlinePoint) {
        if let Some(slot) = self.hits.get_mut(self.len) {
            *slot = hit;
            self.len += 1;
        }
    }

    fn join(&mut self) {
        for index in 0..self.len {
            let (this, next) = (self.hits[index], self.hits[(index + 1) % self.len]);
            self.hits[index].is_joined |= is_one(&this.place, &next.place, self.keep_m);
        }
    }

    /// Every hit with the face that leads on from it.
    fn parts(&self) -> impl Iterator<Item = (Vector2<f64>, Option<Vector2<f64>>)> + '_ {
        (0..self.len).map(|index| {
            let next = self.hits[(index + 1) % self.len].place;
            let hit = self.hits[index];
            (hit.place, hit.is_joined.then_some(next))
        })
    }

    /// The first contact of a disc with the standoff as radius that moves along `direction` (a unit vector), if there
    /// is one.
    pub fn first_contact(&self, direction: &Vector2<f64>) -> Option<FirstContact> {
        let mut first: Option<(f64, FirstContact)> = None;
        let mut offer = |way_m: f64, contact: FirstContact| {
            if first.is_none_or(|(first_m, _)| way_m < first_m) {
                first = Some((way_m, contact));
            }
        };
        for (place, next) in self.parts() {
            if let Some((way_m, contact)) = self.meet_point(&place, direction) {
                offer(way_m, contact);
            }
            if let Some((way_m, contact)) = next.and_then(|next| self.meet_face(&place, &next, direction)) {
                offer(way_m, contact);
            }
        }
        first.map(|(_, contact)| contact)
    }

    fn meet_point(&self, place: &Vector2<f64>, direction: &Vector2<f64>) -> Option<(f64, FirstContact)> {
        let (ahead_m, distance_m) = (place.dot(direction), place.norm());
        if ahead_m <= NONE * distance_m {
            return None;
        }
        if distance_m <= self.keep_m {
            let contact = FirstContact {
                normal: place / distance_m,
                room_m: distance_m - self.keep_m,
            };
            return Some((contact.room_m * distance_m / ahead_m, contact));
        }
        let beside_m2 = distance_m * distance_m - ahead_m * ahead_m;
        let half_m2 = self.keep_m * self.keep_m - beside_m2;
        if half_m2 <= 0.0 {
            return None;
        }
        let way_m = ahead_m - half_m2.sqrt();
        let normal = (place - direction * way_m) / self.keep_m;
        let room_m = way_m * normal.dot(direction);
        Some((way_m, FirstContact { normal, room_m }))
    }

    fn meet_face(
        &self,
        from: &Vector2<f64>,
        to: &Vector2<f64>,
        direction: &Vector2<f64>,
    ) -> Option<(f64, FirstContact)> {
        let (normal, distance_m) = plane(from, to)?;
        let slope = normal.dot(direction);
        if slope <= NONE {
            return None;
        }
        let room_m = distance_m - self.keep_m;
        // Too near already: a contact at once, where it is nearest.
        let way_m = room_m / slope;
        let centre = direction * way_m.max(0.0);
        let is_met = is_between(&centre, from, to);
        is_met.then_some((way_m, FirstContact { normal, room_m }))
    }

    /// The nearest obstacle, if it is nearer than the standoff.
    pub fn too_near(&self) -> Option<FirstContact> {
        let hits = self.hits[..self.len].iter();
        let solid = hits.zip(self.parts()).filter(|(hit, _)| hit.is_solid);
        let nearest = solid
            .flat_map(|(_, (place, next))| {
                let face = next.and_then(|next| {
                    let (normal, distance_m) = plane(&place, &next)?;
                    is_between(&Vector2::zeros(), &place, &next).then_some((normal, distance_m))
                });
                let distance_m = place.norm();
                let point = (distance_m > NONE).then(|| (place / distance_m, distance_m));
                [point, face]
            })
            .flatten()
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        let room_m = nearest.1 - self.keep_m;
        (room_m < 0.0).then_some(FirstContact {
            normal: nearest.0,
            room_m,
        })
    }
}

/// Whether two neighbouring hits are joined.
fn is_one(this: &Vector2<f64>, next: &Vector2<f64>, keep_m: f64) -> bool {
    let width_m = SECTOR_WIDTH_RAD * this.norm().min(next.norm());
    (next - this).norm() < (2.0 * keep_m).max(STEEP * width_m)
}

/// The line through two places: its normal away from the vehicle, and how far it is (m). `None` for one that is no
/// line.
fn plane(from: &Vector2<f64>, to: &Vector2<f64>) -> Option<(Vector2<f64>, f64)> {
    let along = (to - from).try_normalize(NONE)?;
    let normal = Vector2::new(along.y, -along.x);
    let distance_m = normal.dot(from);
    Some(if distance_m < 0.0 {
        (-normal, -distance_m)
    } else {
        (normal, distance_m)
    })
}

/// Whether the foot of `place` on the line from one place to another lies between them.
fn is_between(place: &Vector2<f64>, from: &Vector2<f64>, to: &Vector2<f64>) -> bool {
    let along = to - from;
    let share = (place - from).dot(&along);
    (0.0..=along.norm_squared()).contains(&share)
}
