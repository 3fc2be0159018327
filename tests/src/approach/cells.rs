//! Which approaches there are.

use super::{Cell, Scene, Variant, Who};

/// CP_GUIDE_ANG where guidance is on (deg): its default.
const GUIDE_DEG: f64 = 30.0;
const SPEEDS_MPS: [f64; 6] = [1.0, 2.0, 4.0, 6.0, 8.0, 10.0];
const DELAYS_S: [f64; 5] = [0.0, 0.1, 0.2, 0.3, 0.5];
const QUICK_SPEEDS_MPS: [f64; 3] = [2.0, 6.0, 10.0];
const QUICK_DELAYS_S: [f64; 2] = [0.1, 0.3];
/// Delay of the sensor where it is not looked at (s).
const ORDINARY_DELAY_S: f64 = 0.1;

/// Which of them are wanted; `None` is all.
#[derive(Clone, Debug, Default)]
pub struct Filter {
    /// These scenes.
    pub scenes: Vec<Scene>,
    /// These speeds (m/s).
    pub speeds_mps: Vec<f64>,
    /// These delays (s).
    pub delays_s: Vec<f64>,
    /// Of speeds and delays a few, of directions only head-on.
    pub is_quick: bool,
}

/// A scene, how it is met, and what is not as usual.
struct Row {
    scene: Scene,
    guide_deg: f64,
    /// Heading and incidence (deg).
    directions: &'static [(f64, f64)],
    variant: Variant,
}

const fn row(scene: Scene, guide_deg: f64, directions: &'static [(f64, f64)]) -> Row {
    Row {
        scene,
        guide_deg,
        directions,
        variant: Variant::Usual,
    }
}

const fn but(variant: Variant, scene: Scene) -> Row {
    Row {
        scene,
        guide_deg: 0.0,
        directions: &[(0.0, 0.0)],
        variant,
    }
}

const HEAD_ON: &[(f64, f64)] = &[(0.0, 0.0)];
const ROWS: [Row; 18] = [
    row(
        Scene::Wall,
        0.0,
        &[
            (0.0, 0.0),
            (45.0, 0.0),
            (135.0, 0.0),
            (180.0, 0.0),
            (-90.0, 0.0),
            (0.0, 20.0),
            (0.0, 45.0),
            (0.0, 70.0),
        ],
    ),
    row(Scene::Wall, GUIDE_DEG, &[(0.0, 0.0), (0.0, 45.0), (0.0, 70.0)]),
    row(Scene::Post, 0.0, &[(0.0, 0.0), (45.0, 0.0)]),
    row(Scene::Post, GUIDE_DEG, &[(0.0, 0.0), (45.0, 0.0)]),
    row(Scene::Corner, 0.0, &[(0.0, 0.0), (0.0, 20.0)]),
    row(Scene::Corner, GUIDE_DEG, HEAD_ON),
    row(Scene::NarrowGap, GUIDE_DEG, HEAD_ON),
    row(Scene::WideGap, 0.0, HEAD_ON),
    row(Scene::WideGap, GUIDE_DEG, HEAD_ON),
    row(Scene::Corridor, 0.0, &[(0.0, 1.0)]),
    row(Scene::Corridor, GUIDE_DEG, &[(0.0, 1.0)]),
    row(Scene::Crossing, 0.0, HEAD_ON),
    row(Scene::Towards, 0.0, HEAD_ON),
    but(Variant::NoDelaySet, Scene::Wall),
    but(Variant::NoDelaySet, Scene::Corner),
    but(Variant::StampedOnArrival, Scene::Wall),
    but(Variant::NearSighted, Scene::Wall),
    but(Variant::Gusts, Scene::Wall),
];

/// All approaches that are wanted, jink and PX4 next to each other.
pub fn cells(filter: &Filter) -> Vec<Cell> {
    let scenes = |row: &&Row| filter.scenes.is_empty() || filter.scenes.contains(&row.scene);
    let mut cells = Vec::new();
    for row in ROWS.iter().filter(scenes) {
        let directions = if filter.is_quick {
            row.directions.get(..1).unwrap_or_default()
        } else {
            row.directions
        };
        for &(heading_deg, incidence_deg) in directions {
            for speed_mps in filter.speeds_mps() {
                for delay_s in filter.delays_s(row.variant) {
                    cells.extend([Who::Jink, Who::Px4].map(|who| Cell {
                        guide_deg: row.guide_deg,
                        heading_deg,
                        incidence_deg,
                        delay_s,
                        variant: row.variant,
                        ..Cell::new(row.scene, speed_mps, who)
                    }));
                }
            }
        }
    }
    cells
}

impl Filter {
    fn speeds_mps(&self) -> Vec<f64> {
        let all: &[f64] = if self.is_quick {
            &QUICK_SPEEDS_MPS
        } else {
            &SPEEDS_MPS
        };
        or_all(&self.speeds_mps, all)
    }

    fn delays_s(&self, variant: Variant) -> Vec<f64> {
        let all: &[f64] = match variant {
            Variant::NearSighted | Variant::Gusts => &[ORDINARY_DELAY_S],
            _ if self.is_quick => &QUICK_DELAYS_S,
            _ => &DELAYS_S,
        };
        or_all(&self.delays_s, all)
    }
}

fn or_all(wanted: &[f64], all: &[f64]) -> Vec<f64> {
    if wanted.is_empty() {
        all.to_vec()
    } else {
        wanted.to_vec()
    }
}
