//! A plot of what a varied quantity does: how many flights reach their goal, how fast they are, and how near they come to
//! obstacles.

use super::variation::Quantity;
use super::{FlightReport, percentiles, table};
use jink_lab::drawing::{Area, Colour, Document, Frame, Group, Letters, Style, legend, step};

const WIDTH: f64 = 760.0;
const LEFT: f64 = 60.0;
const RIGHT: f64 = 20.0;
const CHART_HEIGHT: f64 = 170.0;
/// From one chart to the next, with its words (pixels).
const APART: f64 = 64.0;
const LETTERS: f64 = 12.0;
/// Steps between the numbers of an axis, at most.
const STEPS: f64 = 6.0;
/// Beside the outermost values, as a share of what lies between them.
const MARGIN: f64 = 0.06;

/// What one cell does at one value.
struct Point {
    value: f64,
    /// Flights that reached their goal (percent), and the interval of that.
    goals: f64,
    interval: [f64; 2],
    /// Median, and from the slowest to the fastest (m/s).
    mean_mps: [f64; 3],
    /// Median of the smallest distances, and the smallest and the largest of them (m).
    clearance_m: [f64; 3],
}

impl Point {
    fn of(value: f64, reports: &[&FlightReport]) -> Self {
        let goals = table::successes(reports);
        let (low, high) = table::wilson(goals, reports.len());
        let spread = |of: fn(&FlightReport) -> f64| {
            let values: Vec<f64> = reports.iter().map(|report| of(report)).collect();
            let [median, _, most] = percentiles(&values);
            [median, values.iter().copied().fold(f64::INFINITY, f64::min), most]
        };
        Self {
            value,
            goals: table::percent(goals, reports.len()),
            interval: [low, high],
            mean_mps: spread(|report| report.mean_speed_mps),
            clearance_m: spread(|report| report.min_clearance_m),
        }
    }
}

/// Words, the highest value, and of a point the middle, the lowest and the highest value.
type Chart<'a> = (&'a str, f64, fn(&Point) -> [f64; 3]);

/// The plot of flights whose `quantity` was varied, as SVG; `None` if none was.
pub fn svg(quantity: Quantity, reports: &[FlightReport]) -> Option<String> {
    let mut curves: Vec<(&str, Vec<Point>)> = Vec::new();
    for flights in table::by_cell(reports) {
        let first = flights.first()?;
        let Some(varied) = first.variation.filter(|varied| varied.quantity == quantity) else {
            continue;
        };
        let point = Point::of(varied.value, &flights);
        match curves.iter_mut().find(|(cell, _)| *cell == first.cell) {
            Some((_, points)) => points.push(point),
            None => curves.push((&first.cell, vec![point])),
        }
    }
    for (_, points) in &mut curves {
        points.sort_by(|a, b| a.value.total_cmp(&b.value));
    }
    let values = || {
        curves
            .iter()
            .flat_map(|(_, points)| points.iter().map(|point| point.value))
    };
    let (least, most) = (
        values().fold(f64::INFINITY, f64::min),
        values().fold(f64::NEG_INFINITY, f64::max),
    );
    if least > most {
        return None;
    }
    let margin = MARGIN * (most - least).max(1e-9);
    let x = [least - margin, most + margin];
    let largest = |of: fn(&Point) -> f64| {
        let all = curves.iter().flat_map(|(_, points)| points.iter().map(of));
        all.filter(|value| value.is_finite()).fold(0.1, f64::max) * 1.05
    };
    let mut out = Group::default();
    let flights = reports.len();
    let first = reports.first()?;
    let title = format!(
        "{}, {}, {}, {flights} flights",
        quantity.words(),
        first.profile,
        first.sensor
    );
    out.text((LEFT, 20.0), Letters::START.bold(), &title);
    let names: Vec<(Style, &str)> = curves
        .iter()
        .zip(Colour::SEVERAL.iter().cycle())
        .map(|((cell, _), colour)| (Style::line(*colour, 2.0), *cell))
        .collect();
    legend(&mut out, (LEFT, 40.0), &names);
    let charts: [Chart<'_>; 3] = [
        ("goal reached (%), 95 % interval", 100.0, |point| {
            [point.goals, point.interval[0], point.interval[1]]
        }),
        (
            "mean speed (m/s): median, slowest and fastest flight",
            largest(|point| point.mean_mps[2]),
            |point| point.mean_mps,
        ),
        (
            "smallest distance to obstacles (m): median, least and most",
            largest(|point| point.clearance_m[2]),
            |point| point.clearance_m,
        ),
    ];
    let mut top = 72.0;
    let unit = quantity.unit();
    let below = if unit.is_empty() {
        quantity.words().to_owned()
    } else {
        format!("{} ({unit})", quantity.words())
    };
    for (words, highest, of) in charts {
        let frame = Frame {
            area: Area {
                left: LEFT,
                top,
                width: WIDTH - LEFT - RIGHT,
                height: CHART_HEIGHT,
            },
            x,
            y: [0.0, highest],
        };
        out.text((LEFT, top - 8.0), Letters::START, words);
        frame.lines_across(&mut out, step(highest, STEPS));
        frame.border(&mut out);
        frame.ticks_below(&mut out, step(x[1] - x[0], STEPS));
        frame.numbers_left(&mut out, step(highest, STEPS));
        for ((_, points), colour) in curves.iter().zip(Colour::SEVERAL.iter().cycle()) {
            let style = Style::line(*colour, 2.0);
            frame.curve(
                &mut out,
                points.iter().map(|point| (point.value, of(point)[0])),
                style,
            );
            for point in points {
                let [middle, low, high] = of(point).map(|value| frame.at(point.value, value.min(highest)));
                out.line(low, high, Style::line(*colour, 1.0));
                out.circle(middle, 3.0, Style::filled(*colour));
            }
        }
        top += CHART_HEIGHT + APART;
    }
    out.text(
        (LEFT + 0.5 * (WIDTH - LEFT - RIGHT), top - 28.0),
        Letters::MIDDLE,
        &below,
    );
    let document = Document {
        width_px: WIDTH,
        height_px: top - 14.0,
        background: Colour::WHITE,
        letters_px: LETTERS,
        content: out,
    };
    Some(document.into_svg())
}
