//! Plots: distance and speed over time, the path from above, the distances at rest.

use super::scene::Place;
use super::{Approach, CP_DIST_M, Cell, Moment, Scene, Variant, Who};
use jink_simulated_world::world::Obstacle;
use serde_json::Value;
use std::fmt::Write;

/// So few approaches are all drawn.
const FEW: usize = 60;
/// Of more, those with this delay of the sensor (s) and these speeds (m/s).
const DRAWN_DELAY_S: f64 = 0.1;
const DRAWN_SPEEDS_MPS: [f64; 3] = [2.0, 6.0, 10.0];

/// Colours that differ for those who do not see red and green apart, too: of jink, PX4 and of what stands there.
const JINK: &str = "#0072b2";
const PX4: &str = "#d55e00";
const SOLID: &str = "#777777";

/// Whether the moments of an approach are wanted for plots, of `count` that are flown.
pub fn is_drawn(cell: &Cell, count: usize) -> bool {
    count <= FEW || cell.delay_s == DRAWN_DELAY_S && DRAWN_SPEEDS_MPS.contains(&cell.speed_mps)
}

/// File names and contents; of approaches without moments only the distances at rest are drawn.
pub fn plots(flown: &[(Approach, Vec<Moment>)]) -> Vec<(String, String)> {
    let mut files = vec![("distances_at_rest.svg".to_owned(), distribution(flown))];
    for (approach, moments) in flown
        .iter()
        .filter(|(a, m)| a.cell.who == Who::Jink && !m.is_empty())
    {
        let beside = |other: &&(Approach, Vec<Moment>)| {
            let jinks = Cell {
                who: Who::Jink,
                ..other.0.cell
            };
            other.0.cell.who == Who::Px4 && jinks == approach.cell
        };
        let px4 = flown.iter().find(beside).map_or(&[][..], |(_, moments)| moments);
        let name = approach.cell.name();
        let name = name.trim_end_matches("_jink").trim_end_matches("_usual");
        files.push((format!("{name}.svg"), pair(&approach.cell, name, moments, px4)));
    }
    files
}

const WIDTH: f64 = 960.0;
const CHART_HEIGHT: f64 = 300.0;
const MAP_HEIGHT: f64 = 300.0;
const LEFT: f64 = 60.0;
const RIGHT: f64 = 60.0;

/// A rectangle of the picture, and what its edges mean.
struct Frame {
    /// Left, top, width, height (px).
    px: [f64; 4],
    /// Values at left, right, bottom, top.
    value: [f64; 4],
}

impl Frame {
    fn x(&self, value: f64) -> f64 {
        self.px[0] + self.px[2] * (value - self.value[0]) / (self.value[1] - self.value[0])
    }

    fn y(&self, value: f64) -> f64 {
        self.px[1] + self.px[3] * (self.value[3] - value) / (self.value[3] - self.value[2])
    }

    fn line(&self, out: &mut String, style: &str, points: impl Iterator<Item = (f64, f64)>) {
        let mut path = String::new();
        for (x, y) in points {
            let y = y.clamp(self.value[2], self.value[3]);
            let _ = write!(path, "{:.1},{:.1} ", self.x(x), self.y(y));
        }
        let _ = writeln!(
            out,
            "<polyline fill=\"none\" {style} points=\"{}\"/>",
            path.trim_end()
        );
    }

    fn border(&self, out: &mut String) {
        let [x, y, width, height] = self.px;
        let _ = writeln!(
            out,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"none\" stroke=\"#bbb\"/>"
        );
    }

    fn ticks_below(&self, out: &mut String) {
        let bottom = self.px[1] + self.px[3];
        for value in ticks(self.value[0], self.value[1]) {
            let x = self.x(value);
            let _ = writeln!(
                out,
                "<line x1=\"{x:.1}\" y1=\"{bottom:.1}\" x2=\"{x:.1}\" y2=\"{:.1}\" stroke=\"#bbb\"/>",
                bottom + 4.0
            );
            text(out, x, bottom + 17.0, "middle", &short(value));
        }
    }

    fn ticks_beside(&self, out: &mut String, at_right: bool) {
        for value in ticks(self.value[2], self.value[3]) {
            let y = self.y(value) + 4.0;
            if at_right {
                text(out, self.px[0] + self.px[2] + 6.0, y, "start", &short(value));
            } else {
                text(out, self.px[0] - 6.0, y, "end", &short(value));
            }
        }
    }
}

fn short(value: f64) -> String {
    format!("{}", (value * 100.0).round() / 100.0 + 0.0)
}

fn ticks(from: f64, to: f64) -> Vec<f64> {
    let rough = (to - from) / 6.0;
    let decade = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|factor| factor * decade)
        .find(|step| *step >= rough)
        .unwrap_or(decade);
    let first = (from / step - 1e-9).ceil() as i64;
    let last = (to / step + 1e-9).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

fn text(out: &mut String, x: f64, y: f64, anchor: &str, words: &str) {
    let _ = writeln!(
        out,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{words}</text>"
    );
}

fn document(height: f64, body: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"white\"/>\n{body}</svg>\n"
    )
}

fn legend(out: &mut String, y: f64, entries: &[(&str, &str)]) {
    let mut x = LEFT;
    for (style, words) in entries {
        let _ = writeln!(
            out,
            "<line x1=\"{x:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" {style}/>",
            y - 4.0,
            x + 28.0,
            y - 4.0
        );
        text(out, x + 34.0, y, "start", words);
        x += 60.0 + 6.5 * words.len() as f64;
    }
}

fn style(colour: &str, width: f64, dashes: &str) -> String {
    format!("stroke=\"{colour}\" stroke-width=\"{width}\" stroke-dasharray=\"{dashes}\"")
}

/// One approach of both: over time, and from above.
fn pair(cell: &Cell, name: &str, jink: &[Moment], px4: &[Moment]) -> String {
    let mut out = String::new();
    text(
        &mut out,
        LEFT,
        20.0,
        "start",
        &format!("{name}, CP_DIST {CP_DIST_M} m"),
    );
    let (jink_distance, px4_distance) = (style(JINK, 2.0, ""), style(PX4, 2.0, ""));
    let (jink_speed, px4_speed) = (style(JINK, 1.2, "5 3"), style(PX4, 1.2, "5 3"));
    let kept = style("#333", 1.0, "2 3");
    legend(
        &mut out,
        40.0,
        &[
            (&jink_distance, "jink, distance (m)"),
            (&jink_speed, "jink, speed (m/s)"),
            (&px4_distance, "PX4, distance (m)"),
            (&px4_speed, "PX4, speed (m/s)"),
            (&kept, "CP_DIST"),
        ],
    );
    let both = || jink.iter().chain(px4);
    let end_s = both().map(|m| m.time_s).fold(1.0, f64::max);
    // What is far off says nothing of how it stops.
    let top_m = both().map(|m| m.distance_m).fold(CP_DIST_M, f64::max).min(30.0) * 1.05;
    let top_mps = both().map(Moment::speed_mps).fold(0.5, f64::max) * 1.05;
    let px = [LEFT, 56.0, WIDTH - LEFT - RIGHT, CHART_HEIGHT - 80.0];
    let distance = Frame {
        px,
        value: [0.0, end_s, 0.0, top_m],
    };
    let speed = Frame {
        px,
        value: [0.0, end_s, 0.0, top_mps],
    };
    distance.border(&mut out);
    distance.ticks_below(&mut out);
    distance.ticks_beside(&mut out, false);
    speed.ticks_beside(&mut out, true);
    distance.line(
        &mut out,
        &kept,
        [(0.0, CP_DIST_M), (end_s, CP_DIST_M)].into_iter(),
    );
    for (moments, distance_style, speed_style) in [
        (px4, &px4_distance, &px4_speed),
        (jink, &jink_distance, &jink_speed),
    ] {
        distance.line(
            &mut out,
            distance_style,
            moments.iter().map(|m| (m.time_s, m.distance_m)),
        );
        speed.line(
            &mut out,
            speed_style,
            moments.iter().map(|m| (m.time_s, m.speed_mps())),
        );
    }
    text(
        &mut out,
        WIDTH / 2.0,
        CHART_HEIGHT + 10.0,
        "middle",
        "time since the stick was pushed (s)",
    );
    from_above(&mut out, cell, jink, px4);
    document(CHART_HEIGHT + MAP_HEIGHT + 60.0, &out)
}

/// North is to the right, east is down: the vehicle flies to the right, and what is at its right hand is below.
fn from_above(out: &mut String, cell: &Cell, jink: &[Moment], px4: &[Moment]) {
    let both = || jink.iter().chain(px4);
    let px = [LEFT, CHART_HEIGHT + 30.0, WIDTH - LEFT - RIGHT, MAP_HEIGHT - 30.0];
    let farthest_m = both().map(|m| m.ahead_m).fold(cell.ahead_m() + 4.0, f64::max) + 1.0;
    let near_m = both().map(|m| m.ahead_m).fold(0.0, f64::min) - 1.0;
    let (least_m, most_m) = both().fold((-4.0f64, 4.0f64), |(least, most), m| {
        (least.min(m.right_m - 2.0), most.max(m.right_m + 2.0))
    });
    // One scale for both axes.
    let per_px = ((farthest_m - near_m) / px[2]).max((most_m - least_m) / px[3]);
    let middle_m = 0.5 * (least_m + most_m);
    let half_m = 0.5 * per_px * px[3];
    let frame = Frame {
        px,
        value: [
            near_m,
            near_m + per_px * px[2],
            middle_m + half_m,
            middle_m - half_m,
        ],
    };
    let _ = writeln!(
        out,
        "<clipPath id=\"map\"><rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/></clipPath><g clip-path=\"url(#map)\">",
        px[0], px[1], px[2], px[3]
    );
    let scale = 1.0 / per_px;
    if !cell.scene.moves() {
        for obstacle in cell
            .scene
            .obstacles(cell.ahead_m(), cell.incidence_deg, Place::default())
        {
            solid(out, &frame, scale, &obstacle);
        }
    }
    for (moments, colour) in [(px4, PX4), (jink, JINK)] {
        let people: Vec<_> = moments.iter().filter_map(|m| m.person_m).collect();
        for [north_m, east_m] in people.iter().step_by(50) {
            circle(
                out,
                &frame,
                [*north_m, *east_m],
                (0.25 * scale).max(1.5),
                SOLID,
                0.4,
            );
        }
        let mut path = String::new();
        for m in moments {
            let _ = write!(path, "{:.1},{:.1} ", frame.x(m.ahead_m), frame.y(m.right_m));
        }
        let _ = writeln!(
            out,
            "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" points=\"{}\"/>",
            path.trim_end()
        );
        if let Some(end) = moments.last() {
            let place_m = [end.ahead_m, end.right_m];
            circle(out, &frame, place_m, 0.3 * scale, colour, 0.8);
            circle(out, &frame, place_m, CP_DIST_M * scale, colour, 0.08);
        }
    }
    out.push_str("</g>\n");
    frame.border(out);
    frame.ticks_below(out);
    frame.ticks_beside(out, false);
    let bottom = px[1] + px[3] + 34.0;
    text(
        out,
        WIDTH / 2.0,
        bottom,
        "middle",
        "from above: ahead (m), to the right (m) downwards; at the end the hull, and CP_DIST around it",
    );
}

fn circle(out: &mut String, frame: &Frame, place_m: [f64; 2], radius: f64, colour: &str, opacity: f64) {
    let _ = writeln!(
        out,
        "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius:.1}\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>",
        frame.x(place_m[0]),
        frame.y(place_m[1])
    );
}

fn solid(out: &mut String, frame: &Frame, scale: f64, obstacle: &Obstacle) {
    match obstacle {
        Obstacle::Cylinder(post) => {
            let radius = (post.radius_m * scale).max(1.5);
            circle(out, frame, [post.north_m, post.east_m], radius, SOLID, 1.0);
        }
        Obstacle::Box(wall) => {
            // What a box is made of is shown by its drawing only.
            let Ok(Value::Object(wall)) = serde_json::to_value(wall) else {
                return;
            };
            let get = |name: &str| wall.get(name).and_then(Value::as_f64).unwrap_or(0.0);
            let (x, y) = (frame.x(get("north_m")), frame.y(get("east_m")));
            let (length, width) = (get("length_m") * scale, (get("width_m") * scale).max(1.5));
            let _ = writeln!(
                out,
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{length:.1}\" height=\"{width:.1}\" fill=\"{SOLID}\" \
                 transform=\"rotate({:.2} {x:.1} {y:.1})\"/>",
                x - 0.5 * length,
                y - 0.5 * width,
                get("yaw_rad").to_degrees()
            );
        }
        Obstacle::Sphere(_) => {}
    }
}

/// Where vehicles come to rest that meet a wall, a post or a corner head-on, in the usual variant, without guidance.
fn distribution(flown: &[(Approach, Vec<Moment>)]) -> String {
    const BIN_M: f64 = 0.05;
    const FROM_M: f64 = -0.5;
    const TO_M: f64 = 2.5;
    let counts = |who: Who| {
        let mut counts = vec![0u32; ((TO_M - FROM_M) / BIN_M).round() as usize];
        let last = counts.len() - 1;
        let stops = |cell: &Cell| {
            let stands = matches!(cell.scene, Scene::Wall | Scene::Post | Scene::Corner);
            stands && cell.variant == Variant::Usual && cell.guide_deg == 0.0 && cell.who == who
        };
        for rest_m in flown
            .iter()
            .filter(|(a, _)| stops(&a.cell))
            .filter_map(|(a, _)| a.rest_m)
        {
            let bin = ((rest_m - FROM_M) / BIN_M).floor().max(0.0) as usize;
            counts[bin.min(last)] += 1;
        }
        counts
    };
    let (jink, px4) = (counts(Who::Jink), counts(Who::Px4));
    let most = jink.iter().chain(&px4).copied().max().unwrap_or(1).max(1);
    let mut out = String::new();
    let total = |counts: &[u32]| counts.iter().sum::<u32>();
    text(
        &mut out,
        LEFT,
        20.0,
        "start",
        "Distance at rest less CP_DIST: wall, post and corner, without guidance; the last bar holds everything beyond",
    );
    let frames = [(JINK, "jink", &jink, 40.0), (PX4, "PX4", &px4, 230.0)];
    for (colour, name, counts, top) in frames {
        let frame = Frame {
            px: [LEFT, top, WIDTH - LEFT - RIGHT, 150.0],
            value: [FROM_M, TO_M, 0.0, f64::from(most) * 1.08],
        };
        for (bin, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let x = frame.x(FROM_M + bin as f64 * BIN_M);
            let y = frame.y(f64::from(*count));
            let _ = writeln!(
                out,
                "<rect x=\"{:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{colour}\"/>",
                x + 0.5,
                frame.px[2] * BIN_M / (TO_M - FROM_M) - 1.0,
                frame.y(0.0) - y
            );
        }
        frame.line(
            &mut out,
            &style("#333", 1.0, "2 3"),
            [(0.0, 0.0), (0.0, f64::from(most))].into_iter(),
        );
        frame.border(&mut out);
        frame.ticks_below(&mut out);
        frame.ticks_beside(&mut out, false);
        text(
            &mut out,
            WIDTH - RIGHT - 8.0,
            top + 18.0,
            "end",
            &format!("{name}, {} approaches", total(counts)),
        );
    }
    text(&mut out, WIDTH / 2.0, 418.0, "middle", "m");
    document(430.0, &out)
}
