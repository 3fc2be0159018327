//! Suites of flights in which planners are compared: S1 forests, S2 dead ends, S3 narrow places, S4 moving obstacles, S5
//! degraded sensing. A suite has cells, each a world, what happens in it and a target; a flight is a cell and a seed.
//!
//! The vehicle is half a metre wide. Worlds follow the published ones as closely as their texts allow
//! ([`jink_simulated_world::world::Benchmark`]); how hard each is, is stated beside its result (`difficulty`).

pub(crate) mod anchors;
pub(crate) mod difficulty;
pub mod hindrance;
pub(crate) mod judge;
pub(crate) mod picture;

use crate::campaign::Cell;
use hindrance::{Degraded, Hindrance, Movers};
use jink_runtime::config::sensor_sets::{self, SensorSet};
use jink_simulated_world::world::{Benchmark, WorldKind};
use std::path::PathBuf;

/// Radius of the vehicle in all suites (m).
pub const RADIUS_M: f64 = 0.25;
/// What it sees with where nobody says otherwise.
pub const SENSOR: &str = "lidar8";
/// Density of the forests where nobody says otherwise (1/m2).
const DENSITY_PER_M2: f64 = 1.0 / 25.0;
/// A forest that obstructs the view like those of FlightBench: 0.47 on average over eight seeds; its forests have 0.30, 0.44 and 0.60.
const MATCHED_DENSITY_PER_M2: f64 = 1.0 / 12.0;
/// Longest mission (s).
const LIMIT_S: f64 = 180.0;
/// The same where dead ends have to be found out about one by one (s): three times the shortest way at the speed that narrow corridors are
/// flown at is 160 s, and the worst of it twice as long.
const EXPLORING_S: f64 = 300.0;

/// The sensors of published comparisons: name and file.
const SENSORS: [(&str, &str); 3] = [
    ("lidar8", include_str!("sensors/lidar8.toml")),
    ("lidar40", include_str!("sensors/lidar40.toml")),
    ("depth4", include_str!("sensors/depth4.toml")),
];

/// The set of sensors called `name`: one of published comparisons, one that comes with jink, or a file.
///
/// # Errors
/// A text naming what there is no set of, or file and line.
pub fn sensor_set(name: &str) -> Result<SensorSet, String> {
    match SENSORS.iter().find(|(known, _)| *known == name) {
        Some((_, text)) => Ok(SensorSet {
            name: name.to_owned(),
            file: PathBuf::from(format!("suite/sensors/{name}.toml")),
            text: (*text).to_owned(),
        }),
        None => sensor_sets::named(name).map_err(|error| {
            let known = SENSORS.map(|(name, _)| name).join(", ");
            format!("{error}; in campaigns {known} too")
        }),
    }
}

/// A suite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Suite {
    /// Forests.
    S1,
    /// Dead ends.
    S2,
    /// Narrow places.
    S3,
    /// Moving obstacles.
    S4,
    /// Degraded sensing.
    S5,
}

/// What is chosen beside the suite; `None` is what each cell has.
#[derive(Clone, Debug, Default)]
pub struct Choice {
    /// Cells, by name; empty for all that count.
    pub cells: Vec<String>,
    /// Trees per square metre of the forests.
    pub density_per_m2: Option<f64>,
    /// Highest speed (m/s).
    pub speed_mps: Option<f64>,
    /// What it sees with.
    pub sensor: Option<String>,
    /// Longest mission (s).
    pub limit_s: Option<f64>,
}

/// A cell of a suite as it stands in the table.
struct Row {
    name: &'static str,
    kind: Benchmark,
    speed_mps: f64,
    sensor: &'static str,
    hindrance: Hindrance,
    /// Longest mission (s).
    limit_s: f64,
    /// Flown only when it is asked for by name.
    is_apart: bool,
}

impl Row {
    const fn of(name: &'static str, kind: Benchmark, speed_mps: f64) -> Self {
        Self {
            name,
            kind,
            speed_mps,
            sensor: SENSOR,
            hindrance: Hindrance::None,
            limit_s: LIMIT_S,
            is_apart: false,
        }
    }

    const fn apart(self) -> Self {
        Self {
            is_apart: true,
            ..self
        }
    }

    const fn within(self, limit_s: f64) -> Self {
        Self { limit_s, ..self }
    }

    const fn hindered(self, hindrance: Hindrance) -> Self {
        Self { hindrance, ..self }
    }

    const fn seen_with(self, sensor: &'static str) -> Self {
        Self { sensor, ..self }
    }
}

const FOREST: Benchmark = Benchmark::Forest {
    density_per_m2: DENSITY_PER_M2,
};

const fn trap(depth_m: f64) -> Benchmark {
    Benchmark::Trap { depth_m }
}

const fn gap(width_m: f64) -> Benchmark {
    Benchmark::Gap { width_m }
}

const fn movers(name: &'static str, count: u32, fastest_mps: f64) -> Row {
    Row::of(name, Benchmark::Glade, 3.0).hindered(Hindrance::Movers(Movers::crowd(count, fastest_mps)))
}

const fn degraded(name: &'static str, how: Degraded) -> Row {
    Row::of(name, FOREST, 5.0).hindered(Hindrance::Degraded(how))
}

const S1: &[Row] = &[
    Row::of("forest", FOREST, 5.0),
    Row::of(
        "flightbench",
        Benchmark::Forest {
            density_per_m2: MATCHED_DENSITY_PER_M2,
        },
        3.0,
    )
    .seen_with("depth4")
    .apart(),
];

const S2: &[Row] = &[
    Row::of("trap_4", trap(4.0), 3.0),
    Row::of("trap_8", trap(8.0), 3.0),
    Row::of("trap_12", trap(12.0), 3.0),
    Row::of("trap_16", trap(16.0), 3.0),
    Row::of("trap_20", trap(20.0), 3.0),
    Row::of("maze", Benchmark::Maze, 3.0).within(EXPLORING_S),
    Row::of("bugtrap", Benchmark::Bugtrap, 3.0),
];

const S3: &[Row] = &[
    Row::of("office", Benchmark::Office, 3.0),
    Row::of("gap_2.0", gap(2.0), 3.0),
    Row::of("gap_1.2", gap(1.2), 3.0),
    Row::of("gap_1.0", gap(1.0), 3.0),
    Row::of("gap_0.8", gap(0.8), 3.0),
    Row::of("gap_0.7", gap(0.7), 3.0).apart(),
    Row::of("slot", Benchmark::Slot, 3.0),
    Row::of("corner", Benchmark::Corner, 4.0),
];

const S4: &[Row] = &[
    movers("movers_20", 20, 2.0),
    movers("movers_40", 40, 2.0),
    movers("movers_60", 60, 2.0),
    movers("fast_20", 20, 3.0).apart(),
    movers("fast_40", 40, 3.0).apart(),
    movers("fast_60", 60, 3.0).apart(),
    Row::of("thrown", Benchmark::Glade, 3.0)
        .hindered(Hindrance::Movers(Movers::thrown()))
        .apart(),
];

const S5: &[Row] = &[
    degraded("noise", Degraded::Noise),
    degraded("dropped", Degraded::Dropped),
    degraded("latency", Degraded::Latency),
    degraded("drift", Degraded::Drift),
    degraded("gusts", Degraded::Gusts),
    degraded("sensor_death", Degraded::SensorDeath),
    degraded("companion_death", Degraded::CompanionDeath),
];

impl Suite {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::S1, Self::S2, Self::S3, Self::S4, Self::S5];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::S1 => "S1",
            Self::S2 => "S2",
            Self::S3 => "S3",
            Self::S4 => "S4",
            Self::S5 => "S5",
        }
    }

    /// By its name, however it is written; `None` for one that means nothing.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|suite| suite.name().eq_ignore_ascii_case(name))
    }

    fn rows(self) -> &'static [Row] {
        match self {
            Self::S1 => S1,
            Self::S2 => S2,
            Self::S3 => S3,
            Self::S4 => S4,
            Self::S5 => S5,
        }
    }

    /// The names of its cells.
    pub fn cell_names(self) -> impl Iterator<Item = &'static str> {
        self.rows().iter().map(|row| row.name)
    }

    /// What is to be flown of it.
    ///
    /// # Errors
    /// A text naming a cell that it does not have, a choice that does not go with it, or sensors that there are not.
    pub fn cells(self, choice: &Choice) -> Result<Vec<Cell>, String> {
        for name in &choice.cells {
            if !self.cell_names().any(|known| known == name) {
                let known: Vec<_> = self.cell_names().collect();
                return Err(format!(
                    "{} has no cell {name:?}: {}",
                    self.name(),
                    known.join(", ")
                ));
            }
        }
        let is_chosen = |row: &&Row| match choice.cells.is_empty() {
            true => !row.is_apart,
            false => choice.cells.iter().any(|name| name == row.name),
        };
        let rows = self.rows().iter().filter(is_chosen);
        rows.map(|row| self.cell(row, choice)).collect()
    }

    fn cell(self, row: &Row, choice: &Choice) -> Result<Cell, String> {
        let kind = match (row.kind, choice.density_per_m2) {
            (Benchmark::Forest { .. }, Some(density_per_m2)) => Benchmark::Forest { density_per_m2 },
            (kind, None) => kind,
            (kind, Some(_)) => {
                return Err(format!(
                    "{} has no trees to be denser: it is a {}",
                    row.name,
                    kind.name()
                ));
            }
        };
        Ok(Cell {
            suite: Some((self.name(), row.name)),
            kind: WorldKind::Benchmark(kind),
            density_per_m2: None,
            speed_mps: choice.speed_mps.unwrap_or(row.speed_mps),
            limit_s: choice.limit_s.unwrap_or(row.limit_s),
            sensors: sensor_set(choice.sensor.as_deref().unwrap_or(row.sensor))?,
            radius_m: Some(RADIUS_M),
            hindrance: row.hindrance,
            variation: None,
        })
    }
}

/// All cells of all suites as a table: what is flown, and what it should reach. Those flown only by name have a star.
pub fn list() -> String {
    let mut text = format!(
        "{:<6}{:<18}{:>6}  {:<9}{:>7}  published\n",
        "suite", "cell", "m/s", "sensor", "target"
    );
    for suite in Suite::ALL {
        for row in suite.rows() {
            let name = format!("{}{}", row.name, if row.is_apart { "*" } else { "" });
            let density_per_m2 = WorldKind::Benchmark(row.kind).density_per_m2();
            let anchor = anchors::of(suite.name(), row.name, density_per_m2);
            let target = anchor.map_or("-".to_owned(), |anchor| format!("{} %", anchor.goal_percent));
            let line = format!(
                "{:<6}{name:<18}{:>6}  {:<9}{target:>7}  {}",
                suite.name(),
                row.speed_mps,
                row.sensor,
                anchor.map_or("", |anchor| anchor.published)
            );
            text.push_str(line.trim_end());
            text.push('\n');
        }
    }
    text.push_str("* flown only where --cell names it\n");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_has_every_cell() {
        let list = list();
        for suite in Suite::ALL {
            for name in suite.cell_names() {
                let is_its = |line: &str| {
                    let mut words = line.split_whitespace();
                    words.next() == Some(suite.name())
                        && words
                            .next()
                            .is_some_and(|cell| cell.trim_end_matches('*') == name)
                };
                assert!(list.lines().any(is_its), "{name}: {list}");
            }
        }
    }

    #[test]
    fn every_cell_can_be_chosen_by_its_name_and_a_wrong_one_is_named() {
        for suite in Suite::ALL {
            assert_eq!(Suite::named(&suite.name().to_lowercase()), Some(suite));
            for name in suite.cell_names() {
                let choice = Choice {
                    cells: vec![name.to_owned()],
                    ..Choice::default()
                };
                let cells = suite.cells(&choice).unwrap();
                assert_eq!(cells.len(), 1);
                assert_eq!(cells[0].suite, Some((suite.name(), name)));
            }
            assert!(!suite.cells(&Choice::default()).unwrap().is_empty());
        }
        let wrong = Choice {
            cells: vec!["trap_5".to_owned()],
            ..Choice::default()
        };
        let error = Suite::S2.cells(&wrong).unwrap_err();
        assert!(
            error.starts_with("S2 has no cell \"trap_5\": trap_4, "),
            "{error}"
        );
    }

    #[test]
    fn what_is_chosen_is_flown() {
        let choice = Choice {
            density_per_m2: Some(0.05),
            speed_mps: Some(7.0),
            sensor: Some("mid360".to_owned()),
            limit_s: Some(30.0),
            ..Choice::default()
        };
        let [forest] = &Suite::S1.cells(&choice).unwrap()[..] else {
            panic!("one cell counts");
        };
        let kind = WorldKind::Benchmark(Benchmark::Forest { density_per_m2: 0.05 });
        assert_eq!(
            (&forest.kind, forest.speed_mps, forest.limit_s),
            (&kind, 7.0, 30.0)
        );
        assert_eq!(forest.sensors.name, "mid360");
        assert!(Suite::S2.cells(&choice).is_err(), "a trap has no trees");
        let blind = Choice {
            sensor: Some("sonar".to_owned()),
            ..Choice::default()
        };
        assert!(Suite::S1.cells(&blind).unwrap_err().contains("lidar8"));
    }
}
