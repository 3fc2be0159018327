//! What stands ahead of the vehicle: it starts at the origin and is pushed north.

use jink_simulated_world::world::{
    Bounds, Cylinder, FLIGHT_HEIGHT_M, Obstacle, Scene as Solids, World, YawedBox,
};
use serde::Serialize;

/// Height of everything (m): nothing is flown over.
const TALL_M: f64 = 40.0;
/// Thickness of walls (m).
const THICK_M: f64 = 0.3;
/// Length of walls (m): no end of them is reached within an approach.
const LONG_M: f64 = 400.0;
/// Radius of the post (m).
const POST_RADIUS_M: f64 = 0.15;
/// Openings of the gaps (m): narrower than twice CP_DIST, and wide enough to keep it on both sides with room to spare.
const NARROW_M: f64 = 3.0;
const WIDE_M: f64 = 7.0;
/// Width of the corridor (m): half a metre more than CP_DIST on either side.
const CORRIDOR_M: f64 = 5.0;
/// Beside the axis of gap and corridor (m): a vehicle never is exactly on it.
const BESIDE_M: f64 = 0.3;
/// Length of the corridor before its end (m), and behind the vehicle's start.
const CORRIDOR_BEHIND_M: f64 = 10.0;
/// A person, seen from above (m), and how fast they walk (m/s).
const PERSON_RADIUS_M: f64 = 0.25;
const WALK_MPS: f64 = 1.4;
/// Who crosses comes from this far aside (m).
const CROSSES_FROM_M: f64 = 6.0;
/// Who walks towards the vehicle is on its way when it is this near (m), and stops walking after this (m).
const MEETS_AT_M: f64 = 25.0;
const WALKS_ON_M: f64 = 40.0;

/// What stands ahead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Scene {
    /// A long wall.
    Wall,
    /// A post of 0.3 m.
    Post,
    /// Two walls at right angles, open towards the vehicle.
    Corner,
    /// A wall with an opening of 3 m.
    NarrowGap,
    /// A wall with an opening of 7 m.
    WideGap,
    /// Two walls 5 m apart, and a third at their end.
    Corridor,
    /// A person who walks across at 1.4 m/s and is ahead of the vehicle when it comes.
    Crossing,
    /// A person who walks towards the vehicle at 1.4 m/s, wherever it is: to stop is not enough.
    Towards,
}

/// Where, and what moved it there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// How long the person has been walking (s).
    pub walked_s: f64,
}

impl Scene {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Wall,
        Self::Post,
        Self::Corner,
        Self::NarrowGap,
        Self::WideGap,
        Self::Corridor,
        Self::Crossing,
        Self::Towards,
    ];

    /// For arguments, files and the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wall => "wall",
            Self::Post => "post",
            Self::Corner => "corner",
            Self::NarrowGap => "narrow_gap",
            Self::WideGap => "wide_gap",
            Self::Corridor => "corridor",
            Self::Crossing => "crossing",
            Self::Towards => "towards",
        }
    }

    /// By its name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|scene| scene.name() == name)
    }

    /// Whether something in it moves.
    pub fn moves(self) -> bool {
        matches!(self, Self::Crossing | Self::Towards)
    }

    /// Whether the person begins to walk, with the vehicle `to_go_m` before what stands ahead and `speed_mps` fast.
    pub fn sets_off(self, to_go_m: f64, speed_mps: f64) -> bool {
        match self {
            Self::Crossing => to_go_m <= speed_mps * CROSSES_FROM_M / WALK_MPS,
            Self::Towards => to_go_m <= MEETS_AT_M,
            _ => false,
        }
    }

    /// Where the person is (north, east, m).
    pub fn person_m(self, ahead_m: f64, place: Place) -> Option<[f64; 2]> {
        let walked_m = WALK_MPS * place.walked_s;
        match self {
            Self::Crossing => Some([ahead_m, walked_m.min(WALKS_ON_M) - CROSSES_FROM_M]),
            Self::Towards => Some([ahead_m - walked_m.min(WALKS_ON_M), 0.0]),
            _ => None,
        }
    }

    /// The solids, with what is struck beginning `ahead_m` north of the start and turned by `incidence_deg`.
    pub fn obstacles(self, ahead_m: f64, incidence_deg: f64, place: Place) -> Vec<Obstacle> {
        let turn = Turn {
            ahead_m,
            rad: incidence_deg.to_radians(),
        };
        let across = |aside_m: f64| turn.wall([0.0, aside_m], 90.0);
        match self {
            Self::Wall => vec![across(-0.5 * LONG_M)],
            Self::Post => vec![post(ahead_m + POST_RADIUS_M, 0.0, POST_RADIUS_M)],
            // Each begins in the corner and leads back past the vehicle.
            Self::Corner => vec![turn.wall([0.0, 0.0], 135.0), turn.wall([0.0, 0.0], -135.0)],
            Self::NarrowGap => turn.gap(NARROW_M),
            Self::WideGap => turn.gap(WIDE_M),
            Self::Corridor => {
                // The vehicle starts inside, and the corridor turns about it there.
                let turn = Turn { ahead_m: 0.0, ..turn };
                let side = |aside_m: f64| {
                    turn.slab(
                        [0.5 * (ahead_m - CORRIDOR_BEHIND_M), aside_m],
                        ahead_m + CORRIDOR_BEHIND_M,
                        0.0,
                    )
                };
                let half_m = 0.5 * (CORRIDOR_M + THICK_M);
                vec![
                    side(BESIDE_M - half_m),
                    side(BESIDE_M + half_m),
                    turn.slab(
                        [ahead_m + 0.5 * THICK_M, BESIDE_M],
                        CORRIDOR_M + 2.0 * THICK_M,
                        90.0,
                    ),
                ]
            }
            Self::Crossing | Self::Towards => {
                let [north_m, east_m] = self.person_m(ahead_m, place).unwrap_or_default();
                vec![post(north_m, east_m, PERSON_RADIUS_M)]
            }
        }
    }

    /// The world.
    pub fn world(self, ahead_m: f64, incidence_deg: f64, place: Place) -> World {
        World::new(Solids {
            flight_height_m: FLIGHT_HEIGHT_M,
            structures: Vec::new(),
            name: self.name().to_owned(),
            seed: 0,
            goals: Vec::new(),
            bounds: Bounds {
                north_min_m: -LONG_M,
                north_max_m: LONG_M,
                east_min_m: -LONG_M,
                east_max_m: LONG_M,
                up_max_m: TALL_M,
            },
            obstacles: self.obstacles(ahead_m, incidence_deg, place),
        })
    }
}

fn post(north_m: f64, east_m: f64, radius_m: f64) -> Obstacle {
    Obstacle::Cylinder(Cylinder {
        north_m,
        east_m,
        radius_m,
        top_m: TALL_M,
    })
}

/// A frame at `ahead_m` on the way, turned clockwise: its first axis leads away from the vehicle.
#[derive(Clone, Copy)]
struct Turn {
    ahead_m: f64,
    rad: f64,
}

impl Turn {
    /// A wall whose near face begins at `from_m` of the frame and leads towards `toward_deg`, clockwise from its first axis: its
    /// thickness lies on the side away from the vehicle.
    fn wall(self, from_m: [f64; 2], toward_deg: f64) -> Obstacle {
        let toward = toward_deg.to_radians();
        let (sin, cos) = toward.sin_cos();
        // Of the two normals the one that leads away from the vehicle.
        let away = if sin >= 0.0 { [sin, -cos] } else { [-sin, cos] };
        let middle =
            |axis: usize, along: f64| from_m[axis] + 0.5 * LONG_M * along + 0.5 * THICK_M * away[axis];
        self.slab([middle(0, cos), middle(1, sin)], LONG_M, toward_deg)
    }

    /// A wall by its centre.
    fn slab(self, centre_m: [f64; 2], length_m: f64, toward_deg: f64) -> Obstacle {
        let (sin, cos) = self.rad.sin_cos();
        Obstacle::Box(YawedBox::new(
            self.ahead_m + cos * centre_m[0] - sin * centre_m[1],
            sin * centre_m[0] + cos * centre_m[1],
            length_m,
            THICK_M,
            self.rad + toward_deg.to_radians(),
            TALL_M,
        ))
    }

    fn gap(self, width_m: f64) -> Vec<Obstacle> {
        vec![
            self.wall([0.0, BESIDE_M + 0.5 * width_m], 90.0),
            self.wall([0.0, BESIDE_M - 0.5 * width_m], -90.0),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::{Place, Scene};
    use jink_shared_types::Point;

    /// The way ahead ends where the scene says, and before it everything is at least as far as it looks from there.
    #[test]
    fn what_is_struck_head_on_begins_where_it_should() {
        let place = Place::default();
        let distance_m = |scene: Scene, north_m: f64| {
            let world = scene.world(30.0, 0.0, place);
            world.clearance_to_obstacles_m(Point::new(north_m, 0.0, -10.0))
        };
        for scene in [Scene::Wall, Scene::Post, Scene::Corner, Scene::Corridor] {
            assert!(
                distance_m(scene, 30.0).abs() < 1e-9,
                "{scene:?}: {}",
                distance_m(scene, 30.0)
            );
            assert!(distance_m(scene, 29.0) > 0.5, "{scene:?}");
        }
        let corner_m = 10.0 * std::f64::consts::FRAC_1_SQRT_2;
        assert!((distance_m(Scene::Corner, 20.0) - corner_m).abs() < 1e-9);
        assert!((distance_m(Scene::NarrowGap, 30.0) - 1.2).abs() < 1e-9);
        assert!((distance_m(Scene::WideGap, 30.0) - 3.2).abs() < 1e-9);
        assert!((distance_m(Scene::Corridor, 10.0) - 2.2).abs() < 1e-9);
    }

    #[test]
    fn who_crosses_is_in_the_way_when_the_vehicle_would_be_there() {
        let walked_s = 6.0 / 1.4;
        let place = Place { walked_s };
        let [north_m, east_m] = Scene::Crossing.person_m(30.0, place).unwrap_or_default();
        assert!(north_m == 30.0 && east_m.abs() < 1e-9);
        assert!(Scene::Crossing.sets_off(4.0 * walked_s, 4.0));
        assert!(!Scene::Crossing.sets_off(4.0 * walked_s + 0.1, 4.0));
    }
}
