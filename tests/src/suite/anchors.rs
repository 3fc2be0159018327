//! What a cell should reach, and the best that was published for one like it.

/// A target and its anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchor {
    /// Least share of flights that reach the goal (percent).
    pub goal_percent: f64,
    /// What was published, by whom, on what.
    pub published: &'static str,
}

/// Of a cell flown at `speed_mps` through a forest of `density_per_m2`; `None` where none is stated.
pub fn of(suite: &str, cell: &str, density_per_m2: Option<f64>) -> Option<Anchor> {
    let anchor = |goal_percent, published| {
        Some(Anchor {
            goal_percent,
            published,
        })
    };
    match (suite, cell) {
        ("S1", "forest") if density_per_m2.is_some_and(|density| density > 1.0 / 13.0) => {
            anchor(95.0, "only Bubble Planner was flown at 1/12 trees/m2 (IROS 2022)")
        }
        ("S1", "forest") => anchor(
            99.6,
            "SUPER: 99.63 % of 1,080 runs, lidar (Science Robotics 2025)",
        ),
        ("S1", "flightbench") => anchor(
            100.0,
            "EGO-Planner: 100 % at 2.49 m/s; Fast-Planner 90 to 100 % at 2.07 to 2.67 (FlightBench 2024)",
        ),
        ("S2", "maze") => anchor(
            95.0,
            "60 %: best that senses on board (FlightBench 2024, its hardest maze)",
        ),
        ("S2", "bugtrap") => anchor(100.0, "FASTER: 13.8 s at 10 m/s (T-RO 2021)"),
        ("S2", _) => anchor(100.0, "planners like VFH stall in it"),
        ("S3", "gap_0.7") => None,
        ("S3", _) => anchor(99.0, "none published as such"),
        ("S4", "movers_20" | "movers_40" | "movers_60") => {
            anchor(97.0, "TRUST-Planner: 96 % in scenes of its own (2025)")
        }
        ("S5", _) => anchor(99.0, "none published as such; a stop without a contact counts"),
        _ => None,
    }
}
