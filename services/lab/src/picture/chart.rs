//! Height, clearance and speed of a flight over its time: what a picture from above cannot show.

use crate::drawing::{Area, Colour, Frame, Group, Letters, Style, legend, step};
use crate::flight_log::{CoursePoint, FaultRecord};

/// Height of the chart with its axes (pixels).
pub(super) const HEIGHT: f64 = 220.0;
/// Room for the axes' numbers (pixels).
const LEFT: f64 = 44.0;
const RIGHT: f64 = 44.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 36.0;
/// Steps between lines across, on both axes at most.
const STEPS: f64 = 4.0;
const HEIGHT_COLOUR: Colour = Colour::BLUE;
const CLEARANCE_COLOUR: Colour = Colour::VERMILION;
const SPEED_COLOUR: Colour = Colour::GREY;
/// Width of curves (pixels).
const CURVE: f64 = 2.0;

/// Draws it `width` pixels wide below `top`. `course` has at least two points.
pub(super) fn draw(group: &mut Group, top: f64, width: f64, course: &[CoursePoint], faults: &[FaultRecord]) {
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
    // Clearance counts where it is small; the height always fits.
    let most_m = round_up(most(|point| point.up_m).max(4.0));
    let metres = Frame {
        area: Area {
            left: LEFT,
            top: top + TOP,
            width: width - LEFT - RIGHT,
            height: HEIGHT - TOP - BOTTOM,
        },
        x: [first.time_s, last.time_s],
        y: [0.0, most_m],
    };
    let most_mps = round_up(most(|point| point.speed_mps).max(1.0));
    let speeds = Frame {
        y: [0.0, most_mps],
        ..metres
    };
    metres.lines_across(group, step(most_m, STEPS));
    metres.numbers_left(group, step(most_m, STEPS));
    speeds.numbers_right(group, step(most_mps, STEPS));
    metres.ticks_below(group, time_step_s(last.time_s - first.time_s));
    metres.label_below(group, "time since the mission began (s)");
    let mut curve = |frame: &Frame, colour: Colour, of: fn(&CoursePoint) -> f64| {
        let values = course.iter().map(|point| (point.time_s, of(point)));
        frame.curve(group, values, Style::line(colour, CURVE));
    };
    curve(&speeds, SPEED_COLOUR, |point| point.speed_mps);
    curve(&metres, CLEARANCE_COLOUR, |point| point.clearance_m);
    curve(&metres, HEIGHT_COLOUR, |point| point.up_m);
    for (index, fault) in faults.iter().enumerate() {
        let ((x, bottom), (_, top)) = (metres.at(fault.at_s, 0.0), metres.at(fault.at_s, most_m));
        let dashed = Style::line(Colour::BLACK, 1.0).dashed([3.0, 3.0]);
        group.line((x, top), (x, bottom), dashed);
        let number = (index + 1).to_string();
        group.text((x + 3.0, top + 12.0), Letters::START.bold(), &number);
    }
    let clearance = format!("clearance (m, where below {most_m})");
    let entries = [
        (HEIGHT_COLOUR, "height above the start (m)"),
        (CLEARANCE_COLOUR, clearance.as_str()),
        (SPEED_COLOUR, "speed (m/s, right)"),
    ]
    .map(|(colour, words)| (Style::line(colour, CURVE), words));
    legend(group, (LEFT, top + 18.0), &entries);
}

/// 1, 2, 4 or 8 times a power of ten: a few steps of it are round numbers.
fn round_up(value: f64) -> f64 {
    let decade = 10f64.powf(value.log10().floor());
    let rounds = [1.0, 2.0, 4.0, 8.0, 20.0].map(|factor| factor * decade);
    rounds.into_iter().find(|round| *round >= value).unwrap_or(value)
}

/// Between two marks of time (s): at most ten of them, and whole seconds.
pub(super) fn time_step_s(span_s: f64) -> f64 {
    step(span_s, 10.0).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::{STEPS, round_up, step, time_step_s};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn an_axis_ends_above_its_largest_value_and_not_far_above(value in 0.01f64..10_000.0) {
            let top = round_up(value);
            prop_assert!(top >= value && top <= 2.6 * value, "{value} {top}");
        }

        /// Both axes of the chart have the same lines across.
        #[test]
        fn numbers_at_either_axis_stand_at_quarters_of_it(value in 0.01f64..10_000.0) {
            let quarters = STEPS * step(round_up(value), STEPS) / round_up(value);
            prop_assert!([1.0, 2.0].iter().any(|q| (quarters - q).abs() < 1e-9), "{value} {quarters}");
        }

        #[test]
        fn there_are_a_few_marks_of_time(span_s in 2.0f64..3000.0) {
            let marks = span_s / time_step_s(span_s);
            prop_assert!((0.9..=10.000_001).contains(&marks), "{marks}");
        }
    }
}
