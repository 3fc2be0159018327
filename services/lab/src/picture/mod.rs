//! A flight as SVG: from above, north to the right and east downwards, as a map that was turned by a quarter; below it height,
//! clearance and speed over time. Only what SVG 1.1 has is used, so that every program that draws SVG draws the same.

mod chart;
mod world;

pub use world::{Bounds, Cylinder, Place, Sphere, World, YawedBox};

use crate::flight_log::{CoursePoint, FaultRecord};
use std::fmt::Write;

/// Pixels per metre.
const SCALE: f64 = 16.0;
/// Room around the world (m).
const MARGIN_M: f64 = 3.0;
/// Least width of the picture (pixels): legend and chart need it.
const WIDTH_MIN: f64 = 760.0;
/// Room above the world for the title (pixels).
const HEADER: f64 = 30.0;
/// Room below the world for legend and scale bar (pixels).
const FOOTER: f64 = 64.0;
/// Height of a line of text (pixels).
const LINE: f64 = 18.0;
/// Marks of time are at least this far apart (m).
const MARKS_APART_M: f64 = 4.0;
/// Edge of a sensed cell (m).
const CELL_M: f64 = jink_shared_types::map::CELL_M;

/// Everything that is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// The world.
    pub world: &'a World,
    /// The course flown.
    pub course: &'a [CoursePoint],
    /// Centres of cells that were seen occupied near the height of flight: north, east (m).
    pub sensed: &'a [(f64, f64)],
    /// What was done to the system on the way.
    pub faults: &'a [FaultRecord],
    /// One line above it all.
    pub title: &'a str,
}

/// The picture.
pub fn svg(scene: &Scene<'_>) -> String {
    let frame = Frame::around(scene.world);
    let is_flown = scene.course.len() > 1;
    let chart_height = if is_flown { chart::HEIGHT } else { 0.0 };
    let below = frame.top + frame.height;
    let list_top = below + FOOTER + chart_height;
    let mut out = String::with_capacity(1 << 16);
    put(
        &mut out,
        format_args!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w:.0} {h:.0}\" width=\"{w:.0}\" height=\"{h:.0}\" \
             font-family=\"sans-serif\" font-size=\"13\">",
            w = frame.picture_width,
            h = list_top + LINE * scene.faults.len() as f64 + 10.0
        ),
    );
    out.push_str("<rect width=\"100%\" height=\"100%\" fill=\"#fcfcfa\"/>\n");
    grid(&mut out, &frame);
    sensed(&mut out, &frame, scene.sensed);
    obstacles(&mut out, &frame, scene.world);
    let fastest_mps = scene
        .course
        .iter()
        .map(|point| point.speed_mps)
        .fold(0.0, f64::max);
    course(&mut out, &frame, scene.course, fastest_mps);
    time_marks(&mut out, &frame, scene.course);
    ends(&mut out, &frame, scene.world);
    faults(&mut out, &frame, scene.faults, list_top);
    legend(&mut out, &frame, fastest_mps);
    if is_flown {
        chart::draw(
            &mut out,
            below + FOOTER,
            frame.picture_width,
            scene.course,
            scene.faults,
        );
    }
    put(
        &mut out,
        format_args!(
            "<text x=\"12\" y=\"20\" font-size=\"15\">{}</text>",
            escaped(scene.title)
        ),
    );
    out.push_str("</svg>\n");
    out
}

/// From metres to pixels.
struct Frame {
    north_min_m: f64,
    east_min_m: f64,
    /// Left and upper border of the world.
    left: f64,
    top: f64,
    /// Of the world.
    width: f64,
    height: f64,
    picture_width: f64,
}

impl Frame {
    fn around(world: &World) -> Self {
        let bounds = &world.bounds;
        let north_min_m = bounds.north_min_m - MARGIN_M;
        let east_min_m = bounds.east_min_m - MARGIN_M;
        let width = (bounds.north_max_m + MARGIN_M - north_min_m) * SCALE;
        let picture_width = width.max(WIDTH_MIN);
        Self {
            north_min_m,
            east_min_m,
            left: (picture_width - width) / 2.0,
            top: HEADER,
            width,
            height: (bounds.east_max_m + MARGIN_M - east_min_m) * SCALE,
            picture_width,
        }
    }

    fn at(&self, north_m: f64, east_m: f64) -> (f64, f64) {
        (
            self.left + (north_m - self.north_min_m) * SCALE,
            self.top + (east_m - self.east_min_m) * SCALE,
        )
    }
}

fn put(out: &mut String, line: std::fmt::Arguments<'_>) {
    // Writing into a string cannot fail.
    let _infallible = out.write_fmt(line);
    out.push('\n');
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// A line every ten metres.
fn grid(out: &mut String, frame: &Frame) {
    const STEP: f64 = 10.0;
    let line = |out: &mut String, x1: f64, y1: f64, x2: f64, y2: f64| {
        put(
            out,
            format_args!("<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"#e4e4de\"/>"),
        );
    };
    let (right, bottom) = (frame.left + frame.width, frame.top + frame.height);
    let mut north_m = (frame.north_min_m / STEP).ceil() * STEP;
    loop {
        let (x, _) = frame.at(north_m, 0.0);
        if x >= right {
            break;
        }
        line(out, x, frame.top, x, bottom);
        north_m += STEP;
    }
    let mut east_m = (frame.east_min_m / STEP).ceil() * STEP;
    loop {
        let (_, y) = frame.at(0.0, east_m);
        if y >= bottom {
            break;
        }
        line(out, frame.left, y, right, y);
        east_m += STEP;
    }
}

fn sensed(out: &mut String, frame: &Frame, cells: &[(f64, f64)]) {
    out.push_str("<g fill=\"#f2a65a\" fill-opacity=\"0.7\">\n");
    for (north_m, east_m) in cells {
        let (x, y) = frame.at(north_m - CELL_M / 2.0, east_m - CELL_M / 2.0);
        let edge = CELL_M * SCALE;
        put(
            out,
            format_args!("<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{edge:.1}\" height=\"{edge:.1}\"/>"),
        );
    }
    out.push_str("</g>\n");
}

fn obstacles(out: &mut String, frame: &Frame, world: &World) {
    out.push_str("<g fill=\"#6b705c\" fill-opacity=\"0.75\" stroke=\"#3f4238\">\n");
    let circles = world.cylinders.iter().map(|c| (c.north_m, c.east_m, c.radius_m));
    let spheres = world.spheres.iter().map(|s| (s.north_m, s.east_m, s.radius_m));
    for (north_m, east_m, radius_m) in circles.chain(spheres) {
        let (x, y) = frame.at(north_m, east_m);
        put(
            out,
            format_args!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{:.1}\"/>",
                radius_m * SCALE
            ),
        );
    }
    for solid in &world.boxes {
        let (x, y) = frame.at(solid.north_m, solid.east_m);
        let (length, width) = (solid.length_m * SCALE, solid.width_m * SCALE);
        put(
            out,
            format_args!(
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{length:.1}\" height=\"{width:.1}\" transform=\"rotate({:.2} {x:.1} {y:.1})\"/>",
                x - length / 2.0,
                y - width / 2.0,
                solid.yaw_rad.to_degrees()
            ),
        );
    }
    out.push_str("</g>\n");
}

fn course(out: &mut String, frame: &Frame, course: &[CoursePoint], fastest_mps: f64) {
    out.push_str("<g fill=\"none\" stroke-width=\"3\" stroke-linecap=\"round\">\n");
    for pair in course.windows(2) {
        let (x1, y1) = frame.at(pair[0].north_m, pair[0].east_m);
        let (x2, y2) = frame.at(pair[1].north_m, pair[1].east_m);
        let colour = speed_colour(pair[1].speed_mps, fastest_mps);
        put(
            out,
            format_args!("<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"{colour}\"/>"),
        );
    }
    out.push_str("</g>\n");
}

/// Dark blue (standing), green, yellow (the fastest): matplotlib's viridis, which is read in grey and by eyes without red or green, too.
const SPEED_COLOURS: [[f64; 3]; 6] = [
    [68.0, 1.0, 84.0],
    [65.0, 68.0, 135.0],
    [42.0, 120.0, 142.0],
    [34.0, 168.0, 132.0],
    [122.0, 209.0, 81.0],
    [253.0, 231.0, 37.0],
];

fn speed_colour(speed_mps: f64, fastest_mps: f64) -> String {
    let share = if fastest_mps > 0.0 {
        (speed_mps / fastest_mps).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let at = share * (SPEED_COLOURS.len() - 1) as f64;
    let before = (at as usize).min(SPEED_COLOURS.len() - 2);
    let [red, green, blue] = std::array::from_fn(|part| {
        let [from, to] = [SPEED_COLOURS[before][part], SPEED_COLOURS[before + 1][part]];
        (from + (to - from) * (at - before as f64)).round() as u8
    });
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// A dot with the time and the height every so many seconds; fewer where the vehicle is slow, so that they can be read.
fn time_marks(out: &mut String, frame: &Frame, course: &[CoursePoint]) {
    let (Some(first), Some(last)) = (course.first(), course.last()) else {
        return;
    };
    let step_s = chart::time_step_s(last.time_s - first.time_s);
    let mut due_s = (first.time_s / step_s).ceil().max(0.0) * step_s;
    let mut marked: Option<&CoursePoint> = None;
    for point in course {
        let is_near = |other: &CoursePoint| {
            (point.north_m - other.north_m).hypot(point.east_m - other.east_m) < MARKS_APART_M
        };
        if point.time_s < due_s || marked.is_some_and(is_near) {
            continue;
        }
        marked = Some(point);
        let (x, y) = frame.at(point.north_m, point.east_m);
        put(
            out,
            format_args!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"#fff\" stroke=\"#222\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" font-size=\"10\">{:.0} s, {:.1} m up</text>",
                x + 5.0,
                y + 13.0,
                point.time_s,
                point.up_m
            ),
        );
        due_s = ((point.time_s / step_s).floor() + 1.0) * step_s;
    }
}

fn ends(out: &mut String, frame: &Frame, world: &World) {
    let (x, y) = frame.at(world.start.north_m, world.start.east_m);
    put(
        out,
        format_args!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7\" fill=\"#2a9d8f\" stroke=\"#fff\"/><text x=\"{:.1}\" y=\"{:.1}\">start</text>",
            x + 10.0,
            y - 8.0
        ),
    );
    for (index, goal) in world.goals.iter().enumerate() {
        let (x, y) = frame.at(goal.north_m, goal.east_m);
        let number = if world.goals.len() > 1 {
            format!(" {}", index + 1)
        } else {
            String::new()
        };
        put(
            out,
            format_args!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"8\" fill=\"none\" stroke=\"#d62828\" stroke-width=\"2.5\"/><circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.5\" fill=\"#d62828\"/><text x=\"{:.1}\" y=\"{:.1}\">goal{number}</text>",
                x + 11.0,
                y - 8.0
            ),
        );
    }
}

/// A numbered cross where a fault was made; what became of it is listed below the picture.
fn faults(out: &mut String, frame: &Frame, faults: &[FaultRecord], list_top: f64) {
    for (index, fault) in faults.iter().enumerate() {
        let number = index + 1;
        let (x, y) = frame.at(fault.north_m, fault.east_m);
        put(
            out,
            format_args!(
                "<path d=\"M{:.1} {:.1}l12 12m0 -12l-12 12\" stroke=\"#000\" stroke-width=\"2.5\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" font-weight=\"bold\">{number}</text>",
                x - 6.0,
                y - 6.0,
                x + 8.0,
                y + 18.0,
            ),
        );
        put(
            out,
            format_args!(
                "<text x=\"12\" y=\"{:.1}\"><tspan font-weight=\"bold\">{number}</tspan> {}</text>",
                list_top + LINE * index as f64 + 10.0,
                escaped(&fault.line()),
            ),
        );
    }
}

fn legend(out: &mut String, frame: &Frame, fastest_mps: f64) {
    let y = frame.top + frame.height + 24.0;
    let bar = 10.0 * SCALE;
    put(
        out,
        format_args!(
            "<path d=\"M12 {y:.1}v-6v12v-6h{bar:.1}v-6v12\" stroke=\"#333\" stroke-width=\"2\" fill=\"none\"/><text x=\"12\" y=\"{:.1}\">10 m</text>",
            y + 22.0
        ),
    );
    let left = bar + 60.0;
    const STEPS: u32 = 24;
    for step in 0..STEPS {
        let colour = speed_colour(f64::from(step), f64::from(STEPS - 1));
        put(
            out,
            format_args!(
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"6.5\" height=\"10\" fill=\"{colour}\"/>",
                left + 6.0 * f64::from(step),
                y - 5.0
            ),
        );
    }
    let right = left + 6.0 * f64::from(STEPS) + 24.0;
    put(
        out,
        format_args!(
            "<text x=\"{left:.1}\" y=\"{below:.1}\">speed 0 to {fastest_mps:.1} m/s (middle: {:.1})</text>\
             <circle cx=\"{:.1}\" cy=\"{y:.1}\" r=\"6\" fill=\"#6b705c\" stroke=\"#3f4238\"/><text x=\"{:.1}\" y=\"{text:.1}\">obstacle</text>\
             <rect x=\"{:.1}\" y=\"{:.1}\" width=\"10\" height=\"10\" fill=\"#f2a65a\"/><text x=\"{:.1}\" y=\"{text:.1}\">sensed occupied</text>\
             <path d=\"M{:.1} {y:.1}h30m-8 -5l8 5l-8 5\" stroke=\"#333\" stroke-width=\"2\" fill=\"none\"/><text x=\"{:.1}\" y=\"{text:.1}\">north</text>",
            fastest_mps / 2.0,
            right + 6.0,
            right + 18.0,
            right + 92.0,
            y - 5.0,
            right + 108.0,
            right + 226.0,
            right + 262.0,
            below = y + 22.0,
            text = y + 5.0,
        ),
    );
}

#[cfg(test)]
mod tests {
    use super::{Scene, World, svg};
    use crate::drill::Fault;
    use crate::flight_log::{CoursePoint, FaultRecord};

    const WORLD: &str = r#"{
        "world": "forest", "seed": 7,
        "start": {"north_m": 0, "east_m": 0, "up_m": 0},
        "goals": [{"north_m": 40, "east_m": 0, "up_m": 2.5}],
        "bounds": {"north_min_m": -5, "north_max_m": 45, "east_min_m": -10, "east_max_m": 10, "up_max_m": 6},
        "cylinders": [{"north_m": 10, "east_m": 1, "radius_m": 0.5, "top_m": 5}],
        "boxes": [{"north_m": 20, "east_m": -2, "length_m": 4, "width_m": 1, "yaw_rad": 0.5, "bottom_m": 0, "top_m": 3}],
        "spheres": []
    }"#;

    fn point(north_m: f64, speed_mps: f64) -> CoursePoint {
        CoursePoint {
            north_m,
            east_m: 0.0,
            up_m: 2.5,
            speed_mps,
            time_s: north_m / 2.0,
            clearance_m: 1.2,
        }
    }

    #[test]
    fn everything_that_happened_is_in_the_picture() {
        let world: World = serde_json::from_str(WORLD).unwrap();
        let kill = FaultRecord {
            fault: Fault::Kill,
            process: "planner".to_owned(),
            at_s: 3.0,
            phase: "mission".to_owned(),
            survived: true,
            detection_ms: None,
            recovery_ms: Some(58.0),
            gap_ms: 52.0,
            collisions: 0,
            holds: 0,
            north_m: 9.0,
            east_m: 0.0,
            seams: Vec::new(),
            reason: None,
        };
        let picture = svg(&Scene {
            world: &world,
            course: &[point(0.0, 0.0), point(5.0, 1.5), point(10.0, 3.0)],
            sensed: &[(9.5, 1.1)],
            faults: &[kill],
            title: "forest <7>",
        });
        // 3 m of margin beyond the bounds, 16 pixels per metre: the tree's centre and radius.
        assert!(picture.contains("<circle cx=\"288.0\" cy=\"254.0\" r=\"8.0\"/>"));
        assert!(
            picture.contains("rotate(28.65 448.0 206.0)"),
            "a box turns clockwise from north"
        );
        let speeds = ["#269089", "#fde725"];
        assert!(speeds.iter().all(|colour| picture.contains(colour)));
        for text in [
            "start",
            "goal",
            "kill of planner at 3.0 s: back after 58 ms, largest gap 52 ms",
            "10 m",
            "speed 0 to 3.0 m/s (middle: 1.5)",
            "height above the start (m)",
            "clearance (m, where below 4)",
            ">5 s, 2.5 m up<",
            "forest &lt;7&gt;",
        ] {
            assert!(picture.contains(text), "{text}");
        }
        // What a newer standard has is drawn black by many programs.
        assert!(!picture.contains("hsl(") && !picture.contains("rgba("));
        assert_eq!(picture.matches("<g ").count(), picture.matches("</g>").count());
        assert!(picture.trim_end().ends_with("</svg>"));
    }

    #[test]
    fn a_flight_that_never_began_still_has_a_picture() {
        let world: World = serde_json::from_str(WORLD).unwrap();
        let picture = svg(&Scene {
            world: &world,
            course: &[],
            sensed: &[],
            faults: &[],
            title: "",
        });
        assert!(picture.contains("speed 0 to 0.0 m/s") && !picture.contains("NaN"));
    }
}
