//! From values to pixels: curves, bars, and axes with round numbers.

use super::{Colour, Group, Letters, Place, Style};

/// Colour of lines that only guide the eye.
const GRID: Colour = Colour::hex(0xe4e4de);
/// Colour of borders and ticks.
const AXIS: Colour = Colour::hex(0xbbbbbb);
/// Length of a tick (pixels).
const TICK: f64 = 4.0;
/// From an area down to the numbers below it, and to the words below those (pixels).
const NUMBERS_BELOW: f64 = 17.0;
const LABEL_BELOW: f64 = 34.0;
/// From an area aside to its numbers (pixels).
const NUMBERS_BESIDE: f64 = 6.0;
/// From the middle of a line of text down to its lower edge (pixels).
const HALF_LETTER: f64 = 4.0;
/// Between two bars (pixels).
const BARS_APART: f64 = 1.0;
/// Values may be off a round number by this share of a step.
const TOLERANCE: f64 = 1e-9;
/// No axis has more round numbers than this, whatever is asked for.
const MULTIPLES_MAX: usize = 10_000;

/// A rectangle of the picture (pixels).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// Left edge.
    pub left: f64,
    /// Upper edge.
    pub top: f64,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

impl Area {
    /// Right edge.
    pub fn right(&self) -> f64 {
        self.left + self.width
    }

    /// Lower edge.
    pub fn bottom(&self) -> f64 {
        self.top + self.height
    }
}

/// A rectangle of the picture, and which values its edges mean. Values may grow in either direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Where it lies.
    pub area: Area,
    /// Values at the left and the right edge, in the unit of the axis.
    pub x: [f64; 2],
    /// Values at the lower and the upper edge, in the unit of the axis.
    pub y: [f64; 2],
}

impl Frame {
    /// Where these values are (pixels); outside of the area, too.
    pub fn at(&self, x: f64, y: f64) -> Place {
        (
            self.area.left + self.area.width * share(self.x, x),
            self.area.bottom() - self.area.height * share(self.y, y),
        )
    }

    /// A curve through these values. Where it leaves the area at its upper or lower edge it follows that edge; values that
    /// are not finite are passed over.
    pub fn curve(&self, group: &mut Group, values: impl IntoIterator<Item = (f64, f64)>, style: Style) {
        let [least, most] = [self.y[0].min(self.y[1]), self.y[0].max(self.y[1])];
        let finite = values.into_iter().filter(|(x, y)| x.is_finite() && y.is_finite());
        let places = finite.map(|(x, y)| self.at(x, y.max(least).min(most)));
        group.polyline(places, style);
    }

    /// A bar from zero to `value` over this part of the x axis, less half a pixel at either side.
    pub fn bar(&self, group: &mut Group, [from, to]: [f64; 2], value: f64, style: Style) {
        let ((left, zero), (right, end)) = (self.at(from, 0.0), self.at(to, value));
        let area = Area {
            left: left.min(right) + 0.5 * BARS_APART,
            top: zero.min(end),
            width: (right - left).abs() - BARS_APART,
            height: (zero - end).abs(),
        };
        group.rect(area, style);
    }

    /// A line around it.
    pub fn border(&self, group: &mut Group) {
        group.rect(self.area, Style::line(AXIS, 1.0));
    }

    /// Lines across at the multiples of `step`.
    pub fn lines_across(&self, group: &mut Group, step: f64) {
        for value in multiples(step, self.y) {
            let (_, y) = self.at(self.x[0], value);
            group.line(
                (self.area.left, y),
                (self.area.right(), y),
                Style::line(GRID, 1.0),
            );
        }
    }

    /// Lines up and down at the multiples of `step`.
    pub fn lines_along(&self, group: &mut Group, step: f64) {
        for value in multiples(step, self.x) {
            let (x, _) = self.at(value, self.y[0]);
            group.line(
                (x, self.area.top),
                (x, self.area.bottom()),
                Style::line(GRID, 1.0),
            );
        }
    }

    /// Ticks with their numbers below it, at the multiples of `step`.
    pub fn ticks_below(&self, group: &mut Group, step: f64) {
        let bottom = self.area.bottom();
        for value in multiples(step, self.x) {
            let (x, _) = self.at(value, self.y[0]);
            group.line((x, bottom), (x, bottom + TICK), Style::line(AXIS, 1.0));
            let words = number(value, step);
            group.text((x, bottom + NUMBERS_BELOW), Letters::MIDDLE, &words);
        }
    }

    /// Numbers at its left edge, at the multiples of `step`.
    pub fn numbers_left(&self, group: &mut Group, step: f64) {
        self.numbers(group, step, self.area.left - NUMBERS_BESIDE, Letters::END);
    }

    /// Numbers at its right edge, at the multiples of `step`.
    pub fn numbers_right(&self, group: &mut Group, step: f64) {
        self.numbers(group, step, self.area.right() + NUMBERS_BESIDE, Letters::START);
    }

    fn numbers(&self, group: &mut Group, step: f64, x: f64, letters: Letters) {
        for value in multiples(step, self.y) {
            let (_, y) = self.at(self.x[0], value);
            group.text((x, y + HALF_LETTER), letters, &number(value, step));
        }
    }

    /// What the axis means, below its numbers.
    pub fn label_below(&self, group: &mut Group, words: &str) {
        let middle = self.area.left + 0.5 * self.area.width;
        group.text((middle, self.area.bottom() + LABEL_BELOW), Letters::MIDDLE, words);
    }
}

/// 0 at the first end, 1 at the second.
fn share([first, second]: [f64; 2], value: f64) -> f64 {
    let span = second - first;
    (value - first) / if span == 0.0 { 1.0 } else { span }
}

/// The least of 1, 2 and 5 times the powers of ten that divides `span` into at most `parts`, in the unit of `span`; 1 if there
/// is nothing to divide.
pub fn step(span: f64, parts: f64) -> f64 {
    let least = span.abs() / parts;
    if !(least.is_finite() && least > 0.0) {
        return 1.0;
    }
    let decade = 10f64.powf(least.log10().floor());
    let rounds = [1.0, 2.0, 5.0].map(|factor| factor * decade);
    rounds
        .into_iter()
        .find(|round| *round >= least * (1.0 - TOLERANCE))
        .unwrap_or(10.0 * decade)
}

/// The multiples of `step` between two ends, both included; none if there is no telling.
fn multiples(step: f64, [first, second]: [f64; 2]) -> impl Iterator<Item = f64> {
    let is_known = first.is_finite() && second.is_finite() && step.is_finite() && step > 0.0;
    let least = (first.min(second) / step - TOLERANCE).ceil();
    let most = (first.max(second) / step + TOLERANCE).floor();
    (0..MULTIPLES_MAX)
        .take_while(move |_| is_known)
        // Never a negative zero.
        .map(move |count| least + count as f64 + 0.0)
        .take_while(move |multiple| *multiple <= most)
        .map(move |multiple| multiple * step)
}

/// A multiple of `step`, with as many decimals as it takes.
fn number(value: f64, step: f64) -> String {
    let decimals = (-step.log10() - TOLERANCE).ceil().clamp(0.0, 12.0) as i32;
    let scale = 10f64.powi(decimals);
    format!("{}", (value * scale).round() / scale + 0.0)
}

/// A line of each style with what it means, one beside the other; the words' lower edge is at the height of `place`.
pub fn legend(group: &mut Group, place: Place, entries: &[(Style, &str)]) {
    const LINE: f64 = 28.0;
    const WORDS: f64 = 34.0;
    const APART: f64 = 26.0;
    const LETTER: f64 = 6.5;
    let (mut x, y) = place;
    for (style, words) in entries {
        group.line((x, y - HALF_LETTER), (x + LINE, y - HALF_LETTER), *style);
        group.text((x + WORDS, y), Letters::START, words);
        x += WORDS + APART + LETTER * words.chars().count() as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::{Area, Frame, multiples, number, step};
    use proptest::prelude::*;

    const AREA: Area = Area {
        left: 10.0,
        top: 20.0,
        width: 200.0,
        height: 100.0,
    };

    #[test]
    fn values_grow_to_the_right_and_upwards_unless_the_axis_is_turned() {
        let frame = Frame {
            area: AREA,
            x: [0.0, 4.0],
            y: [-1.0, 1.0],
        };
        assert_eq!(frame.at(0.0, -1.0), (10.0, 120.0));
        assert_eq!(frame.at(4.0, 1.0), (210.0, 20.0));
        let turned = Frame {
            y: [1.0, -1.0],
            ..frame
        };
        assert_eq!(turned.at(1.0, -0.5), (60.0, 45.0));
    }

    #[test]
    fn an_axis_of_a_single_value_has_a_place_for_it() {
        let frame = Frame {
            area: AREA,
            x: [3.0, 3.0],
            y: [0.0, 0.0],
        };
        assert_eq!(frame.at(3.0, 0.0), (10.0, 120.0));
        assert_eq!(multiples(step(0.0, 6.0), [3.0, 3.0]).collect::<Vec<_>>(), [3.0]);
    }

    #[test]
    fn numbers_have_no_more_decimals_than_they_need() {
        let written = |step: f64, ends: [f64; 2]| {
            multiples(step, ends)
                .map(|value| number(value, step))
                .collect::<Vec<_>>()
        };
        assert_eq!(written(0.1, [-0.1, 0.3]), ["-0.1", "0", "0.1", "0.2", "0.3"]);
        assert_eq!(written(0.5, [1.0, -1.0]), ["-1", "-0.5", "0", "0.5", "1"]);
        assert_eq!(written(0.002, [0.0, 0.004]), ["0", "0.002", "0.004"]);
        assert_eq!(written(20.0, [5.0, 45.0]), ["20", "40"]);
    }

    proptest! {
        #[test]
        fn an_axis_has_a_few_round_numbers(span in 1e-6f64..1e6, parts in 4.0f64..12.0) {
            let step = step(span, parts);
            let count = span / step;
            prop_assert!(count <= parts * 1.000_001 && count >= 0.39 * parts, "{count}");
            let leading = step / 10f64.powf((step.log10() + 1e-9).floor());
            prop_assert!([1.0, 2.0, 5.0].iter().any(|round| (leading - round).abs() < 1e-6), "{step}");
            let numbers = multiples(step, [0.0, span]).count() as f64;
            prop_assert!((numbers - 1.0 - count.floor()).abs() < 0.5, "{numbers} {count}");
        }
    }
}
