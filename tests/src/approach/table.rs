//! The table: jink and PX4 side by side, per scene and speed, and per scene and delay.

use super::{Approach, Ending, Variant, Who};
use jink_shared_types::quantile::quantile;
use std::fmt::Write;

/// What belongs into one part of the table.
fn title(approach: &Approach) -> (Variant, String) {
    let cell = &approach.cell;
    let guided = if cell.guide_deg > 0.0 { ", guided" } else { "" };
    let oblique = if cell.incidence_deg >= 20.0 {
        ", oblique"
    } else {
        ""
    };
    let usual = match cell.variant {
        Variant::Usual => String::new(),
        other => format!(", {}", other.name()),
    };
    (
        cell.variant,
        format!("{}{guided}{oblique}{usual}", cell.scene.name()),
    )
}

/// The whole table.
pub fn table(approaches: &[Approach]) -> String {
    let mut out = String::from(
        "Distances are those of the centre less CP_DIST (m): p50, worst. rest: where it comes to rest; nearest: on the way there.\n\
         to rest: from 15 m before CP_DIST (s). swing: of the distance in the last 5 s. aside: speed along what is struck (m/s).\n\
         jink | px4 in every column.\n",
    );
    let mut titles: Vec<_> = approaches.iter().map(title).collect();
    titles.dedup();
    let mut seen = Vec::new();
    for wanted in titles {
        if seen.contains(&wanted) {
            continue;
        }
        let part: Vec<_> = approaches.iter().filter(|a| title(a) == wanted).collect();
        part_of_table(&mut out, &wanted.1, &part);
        seen.push(wanted);
    }
    out
}

fn part_of_table(out: &mut String, title: &str, part: &[&Approach]) {
    let _ = writeln!(
        out,
        "\n{title}\n  {:<11} {:>3} {:>9} {:>9} {:>15} {:>29} {:>27} {:>23} {:>11} {:>13} {:>13}",
        "",
        "n",
        "hit",
        "passed",
        "reached m/s",
        "nearest m",
        "rest m",
        "to rest s",
        "turns",
        "swing m",
        "aside m/s"
    );
    let values = |of: fn(&Approach) -> f64| {
        let mut values: Vec<f64> = part.iter().map(|a| of(a)).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values
    };
    let speeds = values(|a| a.cell.speed_mps);
    let delays = values(|a| a.cell.delay_s);
    for speed_mps in &speeds {
        let rows = part.iter().copied().filter(|a| a.cell.speed_mps == *speed_mps);
        line(out, &format!("{speed_mps} m/s"), &rows.collect::<Vec<_>>());
    }
    if delays.len() > 1 {
        for delay_s in &delays {
            let rows = part.iter().copied().filter(|a| a.cell.delay_s == *delay_s);
            line(out, &format!("late {delay_s} s"), &rows.collect::<Vec<_>>());
        }
    }
    if speeds.len() > 1 {
        line(out, "all", part);
    }
}

fn line(out: &mut String, name: &str, rows: &[&Approach]) {
    let of = |who: Who| Column(rows.iter().copied().filter(|a| a.cell.who == who).collect());
    let (jink, px4) = (of(Who::Jink), of(Who::Px4));
    let both = |text: fn(&Column) -> String, width: usize| {
        format!("{:>width$} | {:<width$}", text(&jink), text(&px4))
    };
    let _ = writeln!(
        out,
        "  {name:<11} {:>3} {} {} {} {} {} {} {} {} {}",
        jink.0.len().max(px4.0.len()),
        both(|c| c.count(Ending::Collision), 3),
        both(|c| c.count(Ending::Passed), 3),
        both(|c| c.median(|a| Some(a.reached_mps), 1), 6),
        both(|c| c.median_and_least(|a| Some(a.nearest_m)), 13),
        both(|c| c.median_and_farthest(|a| a.rest_m), 12),
        both(|c| c.median_and_most(|a| a.rest_after_s, 1), 10),
        both(|c| c.most(|a| Some(f64::from(a.reversals)), 0), 4),
        both(|c| c.most(|a| a.swing_m, 2), 5),
        both(|c| c.median(|a| Some(a.aside_mps), 2), 5),
    );
}

/// One side's approaches.
struct Column<'a>(Vec<&'a Approach>);

impl Column<'_> {
    fn count(&self, ending: Ending) -> String {
        self.0.iter().filter(|a| a.ending == ending).count().to_string()
    }

    fn values(&self, of: fn(&Approach) -> Option<f64>) -> Vec<f64> {
        self.0.iter().filter_map(|a| of(a)).collect()
    }

    fn at(&self, share: f64, of: fn(&Approach) -> Option<f64>, digits: usize) -> String {
        number(quantile(&self.values(of), share), digits)
    }

    fn median(&self, of: fn(&Approach) -> Option<f64>, digits: usize) -> String {
        self.at(0.5, of, digits)
    }

    fn most(&self, of: fn(&Approach) -> Option<f64>, digits: usize) -> String {
        self.at(1.0, of, digits)
    }

    fn median_and_most(&self, of: fn(&Approach) -> Option<f64>, digits: usize) -> String {
        format!("{} {}", self.median(of, digits), self.most(of, digits))
    }

    fn median_and_least(&self, of: fn(&Approach) -> Option<f64>) -> String {
        format!("{} {}", self.median(of, 2), self.at(0.0, of, 2))
    }

    /// Farthest from zero: too near and too far off are both wrong.
    fn median_and_farthest(&self, of: fn(&Approach) -> Option<f64>) -> String {
        let farthest = self
            .values(of)
            .into_iter()
            .max_by(|a, b| a.abs().total_cmp(&b.abs()));
        format!("{} {}", self.median(of, 2), number(farthest, 2))
    }
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}
