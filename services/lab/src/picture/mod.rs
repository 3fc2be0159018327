//! A flight as SVG: from above, north to the right and east downwards, as a map that was turned by a quarter; below it
//! height, clearance and speed over time.

mod chart;
mod world;

pub use world::{Bounds, Cylinder, Place, Sphere, World, YawedBox};

use crate::drawing::{Area, Colour, Document, Frame, Group, Letters, Style};
use crate::flight_log::{CoursePoint, FaultRecord};

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
/// Distance between lines of the grid, and length of the scale bar (m).
const GRID_M: f64 = 10.0;
/// Letters (pixels): of the title, of everything that does not say otherwise, of the marks of time.
const TITLE: f64 = 15.0;
const LETTERS: f64 = 13.0;
const SMALL: f64 = 10.0;
/// What is written beside marks of time is at least this far apart (m).
const MARKS_APART_M: f64 = 4.0;

const PAPER: Colour = Colour::hex(0xfcfcfa);
const INK: Colour = Colour::hex(0x333333);
const OBSTACLE: Style = Style::filled(Colour::hex(0x6b705c)).stroke(Colour::hex(0x3f4238));
const START: Colour = Colour::hex(0x2a9d8f);
const GOAL: Colour = Colour::hex(0xd62828);

/// Everything that is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// The world.
    pub world: &'a World,
    /// The course flown.
    pub course: &'a [CoursePoint],
    /// What was done to the system on the way.
    pub faults: &'a [FaultRecord],
    /// One line above it all.
    pub title: &'a str,
}

/// The picture.
pub fn svg(scene: &Scene<'_>) -> String {
    let frame = frame_around(scene.world);
    let width_px = frame.area.width + 2.0 * frame.area.left;
    let is_flown = scene.course.len() > 1;
    let chart_height = if is_flown { chart::HEIGHT } else { 0.0 };
    let chart_top = frame.area.bottom() + FOOTER;
    let list_top = chart_top + chart_height;
    let mut content = Group::default();
    frame.lines_along(&mut content, GRID_M);
    frame.lines_across(&mut content, GRID_M);
    content.add(obstacles(&frame, scene.world));
    let fastest_mps = scene
        .course
        .iter()
        .map(|point| point.speed_mps)
        .fold(0.0, f64::max);
    content.add(course(&frame, scene.course, fastest_mps));
    time_marks(&mut content, &frame, scene.course);
    ends(&mut content, &frame, scene.world);
    faults(&mut content, &frame, scene.faults, list_top);
    legend(&mut content, frame.area.bottom() + 24.0, fastest_mps);
    if is_flown {
        chart::draw(&mut content, chart_top, width_px, scene.course, scene.faults);
    }
    content.text((12.0, 20.0), Letters::START.size(TITLE), scene.title);
    let document = Document {
        width_px,
        height_px: list_top + LINE * scene.faults.len() as f64 + 10.0,
        background: PAPER,
        letters_px: LETTERS,
        content,
    };
    document.into_svg()
}

/// North to the right, east downwards; in the middle of a picture that is wide enough.
fn frame_around(world: &World) -> Frame {
    let bounds = &world.bounds;
    let x = [bounds.north_min_m - MARGIN_M, bounds.north_max_m + MARGIN_M];
    let y = [bounds.east_max_m + MARGIN_M, bounds.east_min_m - MARGIN_M];
    let width = (x[1] - x[0]) * SCALE;
    let area = Area {
        left: (width.max(WIDTH_MIN) - width) / 2.0,
        top: HEADER,
        width,
        height: (y[0] - y[1]) * SCALE,
    };
    Frame { area, x, y }
}

fn obstacles(frame: &Frame, world: &World) -> Group {
    let mut group = Group::new(OBSTACLE.opacity(0.75));
    let circles = world.cylinders.iter().map(|c| (c.north_m, c.east_m, c.radius_m));
    let spheres = world.spheres.iter().map(|s| (s.north_m, s.east_m, s.radius_m));
    for (north_m, east_m, radius_m) in circles.chain(spheres) {
        group.circle(frame.at(north_m, east_m), radius_m * SCALE, Style::INHERITED);
    }
    for solid in &world.boxes {
        let centre = frame.at(solid.north_m, solid.east_m);
        let size_px = [solid.length_m * SCALE, solid.width_m * SCALE];
        group.turned_rect(centre, size_px, solid.yaw_rad.to_degrees(), Style::INHERITED);
    }
    group
}

fn course(frame: &Frame, course: &[CoursePoint], fastest_mps: f64) -> Group {
    let mut group = Group::new(Style::hollow().width(3.0).round_ends());
    for pair in course.windows(2) {
        let [from, to] = [&pair[0], &pair[1]].map(|point| frame.at(point.north_m, point.east_m));
        let colour = speed_colour(pair[1].speed_mps, fastest_mps);
        group.line(from, to, Style::INHERITED.stroke(colour));
    }
    group
}

/// Dark blue (standing), green, yellow (the fastest): matplotlib's viridis, which is read in grey and by eyes without red or
/// green, too.
const SPEED_COLOURS: [[f64; 3]; 6] = [
    [68.0, 1.0, 84.0],
    [65.0, 68.0, 135.0],
    [42.0, 120.0, 142.0],
    [34.0, 168.0, 132.0],
    [122.0, 209.0, 81.0],
    [253.0, 231.0, 37.0],
];

fn speed_colour(speed_mps: f64, fastest_mps: f64) -> Colour {
    let share = if fastest_mps > 0.0 {
        (speed_mps / fastest_mps).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let at = share * (SPEED_COLOURS.len() - 1) as f64;
    let before = (at as usize).min(SPEED_COLOURS.len() - 2);
    Colour::rgb(std::array::from_fn(|part| {
        let [from, to] = [SPEED_COLOURS[before][part], SPEED_COLOURS[before + 1][part]];
        (from + (to - from) * (at - before as f64)).round() as u8
    }))
}

/// A dot every so many seconds, with the time and the height where there is room for words.
fn time_marks(group: &mut Group, frame: &Frame, course: &[CoursePoint]) {
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
        if point.time_s < due_s {
            continue;
        }
        due_s = ((point.time_s / step_s).floor() + 1.0) * step_s;
        let (x, y) = frame.at(point.north_m, point.east_m);
        let dot = Style::filled(Colour::WHITE).stroke(Colour::hex(0x222222));
        group.circle((x, y), 3.5, dot);
        if marked.is_some_and(is_near) {
            continue;
        }
        marked = Some(point);
        let words = format!("{:.0} s, {:.1} m up", point.time_s, point.up_m);
        group.text((x + 5.0, y + 13.0), Letters::START.size(SMALL), &words);
    }
}

fn ends(group: &mut Group, frame: &Frame, world: &World) {
    let (x, y) = frame.at(world.start.north_m, world.start.east_m);
    group.circle((x, y), 7.0, Style::filled(START).stroke(Colour::WHITE));
    group.text((x + 10.0, y - 8.0), Letters::START, "start");
    for (index, goal) in world.goals.iter().enumerate() {
        let (x, y) = frame.at(goal.north_m, goal.east_m);
        group.circle((x, y), 8.0, Style::line(GOAL, 2.5));
        group.circle((x, y), 2.5, Style::filled(GOAL));
        let words = if world.goals.len() > 1 {
            format!("goal {}", index + 1)
        } else {
            "goal".to_owned()
        };
        group.text((x + 11.0, y - 8.0), Letters::START, &words);
    }
}

/// A numbered cross where a fault was made; what became of it is listed below the picture.
fn faults(group: &mut Group, frame: &Frame, faults: &[FaultRecord], list_top: f64) {
    const ARM: f64 = 6.0;
    for (index, fault) in faults.iter().enumerate() {
        let number = (index + 1).to_string();
        let (x, y) = frame.at(fault.north_m, fault.east_m);
        for arm in [ARM, -ARM] {
            let (from, to) = ((x - ARM, y - arm), (x + ARM, y + arm));
            group.line(from, to, Style::line(Colour::BLACK, 2.5));
        }
        group.text((x + 8.0, y + 18.0), Letters::START.bold(), &number);
        let place = (12.0, list_top + LINE * index as f64 + 10.0);
        group.text_with_lead(place, Letters::START, &number, &fault.line());
    }
}

/// `y`: the height of its middle (pixels).
fn legend(group: &mut Group, y: f64, fastest_mps: f64) {
    const LEFT: f64 = 12.0;
    const STEPS: u32 = 24;
    const STEP: f64 = 6.0;
    /// From the middle down to words beside and words below.
    const BESIDE: f64 = 5.0;
    const BELOW: f64 = 22.0;
    let line = Style::line(INK, 2.0);
    let bar = GRID_M * SCALE;
    let ends = [LEFT, LEFT + bar].map(|x| [(x, y), (x, y - 6.0), (x, y + 6.0), (x, y)]);
    group.polyline(ends.concat(), line);
    group.text((LEFT, y + BELOW), Letters::START, &format!("{GRID_M} m"));
    let left = bar + 60.0;
    for step in 0..STEPS {
        let area = Area {
            left: left + STEP * f64::from(step),
            top: y - 5.0,
            // They overlap a little, so that no gaps are seen between them.
            width: STEP + 0.5,
            height: 10.0,
        };
        let colour = speed_colour(f64::from(step), f64::from(STEPS - 1));
        group.rect(area, Style::filled(colour));
    }
    let speeds = format!(
        "speed 0 to {fastest_mps:.1} m/s (middle: {:.1})",
        fastest_mps / 2.0
    );
    group.text((left, y + BELOW), Letters::START, &speeds);
    let right = left + STEP * f64::from(STEPS) + 24.0;
    let mut beside = |x: f64, words: &str| group.text((right + x, y + BESIDE), Letters::START, words);
    beside(18.0, "obstacle");
    beside(130.0, "north");
    group.circle((right + 6.0, y), 6.0, OBSTACLE);
    let (tail, tip) = (right + 94.0, right + 124.0);
    group.line((tail, y), (tip, y), line);
    group.polyline([(tip - 8.0, y - 5.0), (tip, y), (tip - 8.0, y + 5.0)], line);
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

    /// Whether there is an element of this name with these attributes, in whatever order.
    fn has(picture: &str, name: &str, attributes: &[(&str, &str)]) -> bool {
        let start = format!("<{name} ");
        let elements = picture.split(&start).skip(1);
        let mut tags = elements.filter_map(|rest| rest.split('>').next());
        tags.any(|tag| {
            let tag = format!(" {tag}");
            let holds = |(name, value): &(&str, &str)| tag.contains(&format!(" {name}=\"{value}\""));
            attributes.iter().all(holds)
        })
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
            faults: &[kill],
            title: "forest <7>",
        });
        // 3 m of margin beyond the bounds, 16 pixels per metre: the tree's centre and radius.
        assert!(has(
            &picture,
            "circle",
            &[("cx", "288.0"), ("cy", "254.0"), ("r", "8.0")]
        ));
        assert!(
            has(&picture, "rect", &[("transform", "rotate(28.65 448.0 206.0)")]),
            "a box turns clockwise from north"
        );
        let speeds = ["#269089", "#fde725"];
        assert!(
            speeds
                .iter()
                .all(|colour| has(&picture, "line", &[("stroke", colour)]))
        );
        for text in [
            "start",
            "goal",
            ">1</tspan> kill of planner at 3.0 s: back after 58 ms, largest gap 52 ms",
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
        let groups = picture.matches("<g ").count();
        assert!(groups == 2 && groups == picture.matches("</g>").count());
        assert!(picture.trim_end().ends_with("</svg>"));
    }

    #[test]
    fn a_vehicle_that_waits_is_marked_in_time_and_written_beside_where_there_is_room() {
        let world: World = serde_json::from_str(WORLD).unwrap();
        // Ten seconds on one spot, then ten metres within as many seconds.
        let course: Vec<CoursePoint> = (0..=20)
            .map(|second| CoursePoint {
                time_s: f64::from(second),
                ..point(f64::from((second - 10).max(0)), 1.0)
            })
            .collect();
        let picture = svg(&Scene {
            world: &world,
            course: &course,
            faults: &[],
            title: "",
        });
        let step_s = super::chart::time_step_s(20.0);
        let marks = (20.0 / step_s) as usize + 1;
        assert_eq!(picture.matches("r=\"3.5\"").count(), marks);
        let written: Vec<f64> = picture
            .split(" s, ")
            .filter_map(|before| before.rsplit('>').next()?.parse().ok())
            .collect();
        assert!(written.len() < marks && written.len() > 2, "{written:?}");
        assert!(written.iter().all(|time_s| time_s % step_s == 0.0), "{written:?}");
    }

    #[test]
    fn a_flight_that_never_began_still_has_a_picture() {
        let world: World = serde_json::from_str(WORLD).unwrap();
        let picture = svg(&Scene {
            world: &world,
            course: &[],
            faults: &[],
            title: "",
        });
        assert!(picture.contains("speed 0 to 0.0 m/s") && !picture.contains("NaN"));
    }
}
