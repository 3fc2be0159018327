//! Height, clearance and speed of a flight over its time: what a picture from above cannot show.

use super::{escaped, put};
use crate::flight_log::{CoursePoint, FaultRecord};

/// Height of the chart with its axes (pixels).
pub(super) const HEIGHT: f64 = 220.0;
/// Room for the axes' numbers (pixels).
const LEFT: f64 = 44.0;
const RIGHT: f64 = 44.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 36.0;
/// Lines across, and so many steps between them on both axes.
const STEPS: u32 = 4;
/// Two hues of the Okabe-Ito palette, distinct with any colour vision, and grey.
const HEIGHT_COLOUR: &str = "#0072b2";
const CLEARANCE_COLOUR: &str = "#d55e00";
const SPEED_COLOUR: &str = "#777777";

/// From time and metres to pixels.
struct Axes {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    from_s: f64,
    to_s: f64,
    most_m: f64,
    most_mps: f64,
}

impl Axes {
    fn x(&self, time_s: f64) -> f64 {
        let span_s = (self.to_s - self.from_s).max(1e-9);
        self.left + self.width * (time_s - self.from_s) / span_s
    }

    fn y(&self, share: f64) -> f64 {
        self.top + self.height * (1.0 - share.clamp(0.0, 1.0))
    }
}

/// Draws it `width` pixels wide below `top`. `course` has at least two points.
pub(super) fn draw(out: &mut String, top: f64, width: f64, course: &[CoursePoint], faults: &[FaultRecord]) {
    let (Some(first), Some(last)) = (course.first(), course.last()) else {
        return;
    };
    let most = |of: fn(&CoursePoint) -> f64| {
        course
            .iter()
            .map(of)
            .filter(|v| v.is_finite())
            .fold(0.0, f64::max)
    };
    let axes = Axes {
        left: LEFT,
        top: top + TOP,
        width: width - LEFT - RIGHT,
        height: HEIGHT - TOP - BOTTOM,
        from_s: first.time_s,
        to_s: last.time_s,
        // Clearance counts where it is small; the height always fits.
        most_m: round_up(most(|point| point.up_m).max(4.0)),
        most_mps: round_up(most(|point| point.speed_mps).max(1.0)),
    };
    scales(out, &axes);
    curve(out, &axes, SPEED_COLOUR, course, |point| {
        point.speed_mps / axes.most_mps
    });
    curve(out, &axes, CLEARANCE_COLOUR, course, |point| {
        point.clearance_m / axes.most_m
    });
    curve(out, &axes, HEIGHT_COLOUR, course, |point| {
        point.up_m / axes.most_m
    });
    for (index, fault) in faults.iter().enumerate() {
        let x = axes.x(fault.at_s);
        put(
            out,
            format_args!(
                "<path d=\"M{x:.1} {:.1}v{:.1}\" stroke=\"#000\" stroke-dasharray=\"3 3\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" font-weight=\"bold\">{}</text>",
                axes.top,
                axes.height,
                x + 3.0,
                axes.top + 12.0,
                index + 1
            ),
        );
    }
    let mut x = axes.left;
    for (colour, text) in [
        (HEIGHT_COLOUR, "height above the start (m)"),
        (
            CLEARANCE_COLOUR,
            &format!("clearance (m, where below {})", axes.most_m),
        ),
        (SPEED_COLOUR, "speed (m/s, right)"),
    ] {
        put(
            out,
            format_args!(
                "<path d=\"M{x:.1} {:.1}h18\" stroke=\"{colour}\" stroke-width=\"2.5\"/><text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                top + 14.0,
                x + 23.0,
                top + 18.0,
                escaped(text)
            ),
        );
        x += 40.0 + 7.0 * text.len() as f64;
    }
}

/// 1, 2, 4 or 8 times a power of ten: four steps of it are round numbers.
fn round_up(value: f64) -> f64 {
    let decade = 10f64.powf(value.log10().floor());
    let rounds = [1.0, 2.0, 4.0, 8.0, 20.0].map(|factor| factor * decade);
    rounds.into_iter().find(|round| *round >= value).unwrap_or(value)
}

fn scales(out: &mut String, axes: &Axes) {
    for step in 0..=STEPS {
        let share = f64::from(step) / f64::from(STEPS);
        let y = axes.y(share);
        put(
            out,
            format_args!(
                "<path d=\"M{:.1} {y:.1}h{:.1}\" stroke=\"#e4e4de\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text><text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                axes.left,
                axes.width,
                axes.left - 6.0,
                y + 4.0,
                share * axes.most_m,
                axes.left + axes.width + 6.0,
                y + 4.0,
                share * axes.most_mps
            ),
        );
    }
    let step_s = time_step_s(axes.to_s - axes.from_s);
    let mut time_s = (axes.from_s / step_s).ceil() * step_s;
    while time_s <= axes.to_s {
        put(
            out,
            format_args!(
                "<path d=\"M{x:.1} {:.1}v5\" stroke=\"#333\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{time_s}</text>",
                axes.top + axes.height,
                axes.top + axes.height + 18.0,
                x = axes.x(time_s)
            ),
        );
        time_s += step_s;
    }
    put(
        out,
        format_args!(
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">time since the mission began (s)</text>",
            axes.left + axes.width / 2.0,
            axes.top + axes.height + 33.0
        ),
    );
}

/// Between two marks of time (s): at most ten of them.
pub(super) fn time_step_s(span_s: f64) -> f64 {
    let steps = [1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 120.0, 300.0];
    steps
        .into_iter()
        .find(|step_s| span_s / step_s <= 10.0)
        .unwrap_or(600.0)
}

fn curve(
    out: &mut String,
    axes: &Axes,
    colour: &str,
    course: &[CoursePoint],
    share: impl Fn(&CoursePoint) -> f64,
) {
    let points: Vec<String> = course
        .iter()
        .map(|point| (point.time_s, share(point)))
        .filter(|(_, share)| share.is_finite())
        .map(|(time_s, share)| format!("{:.1},{:.1}", axes.x(time_s), axes.y(share)))
        .collect();
    put(
        out,
        format_args!(
            "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" points=\"{}\"/>",
            points.join(" ")
        ),
    );
}

#[cfg(test)]
mod tests {
    use super::{round_up, time_step_s};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn an_axis_ends_above_its_largest_value_and_not_far_above(value in 0.01f64..10_000.0) {
            let top = round_up(value);
            prop_assert!(top >= value && top <= 2.6 * value, "{value} {top}");
        }

        #[test]
        fn there_are_a_few_marks_of_time(span_s in 2.0f64..3000.0) {
            let marks = span_s / time_step_s(span_s);
            prop_assert!((0.9..=10.0).contains(&marks), "{marks}");
        }
    }
}
