//! Plots: distance and speed over time, the path from above, the distances at rest.

use super::scene::Place;
use super::{Approach, CP_DIST_M, Cell, Moment, Scene, Variant, Who};
use jink_lab::drawing::{Area, Colour, Document, Frame, Group, Letters, Style, legend, step};
use jink_simulated_world::world::Obstacle;
use serde_json::Value;

/// So few approaches are all drawn.
const FEW: usize = 60;
/// Of more, those with this delay of the sensor (s) and these speeds (m/s).
const DRAWN_DELAY_S: f64 = 0.1;
const DRAWN_SPEEDS_MPS: [f64; 3] = [2.0, 6.0, 10.0];

const JINK: Colour = Colour::BLUE;
const PX4: Colour = Colour::VERMILION;
const SOLID: Colour = Colour::GREY;
/// How the distance to keep is drawn.
const KEPT: Style = Style::line(Colour::hex(0x333333), 1.0).dashed([2.0, 3.0]);

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
/// Of letters (pixels).
const LETTERS: f64 = 12.0;
/// Steps between the numbers of an axis, at most.
const STEPS: f64 = 6.0;

/// As wide as the picture allows.
fn area(top: f64, height: f64) -> Area {
    Area {
        left: LEFT,
        top,
        width: WIDTH - LEFT - RIGHT,
        height,
    }
}

/// Border, ticks below and numbers at the left, at the axes' own steps.
fn axes(group: &mut Group, frame: &Frame) {
    frame.border(group);
    frame.ticks_below(group, step(frame.x[1] - frame.x[0], STEPS));
    frame.numbers_left(group, step(frame.y[1] - frame.y[0], STEPS));
}

fn document(height_px: f64, content: Group) -> String {
    let document = Document {
        width_px: WIDTH,
        height_px,
        background: Colour::WHITE,
        letters_px: LETTERS,
        content,
    };
    document.into_svg()
}

/// One approach of both: over time, and from above.
fn pair(cell: &Cell, name: &str, jink: &[Moment], px4: &[Moment]) -> String {
    let mut out = Group::default();
    let title = format!("{name}, CP_DIST {CP_DIST_M} m");
    out.text((LEFT, 20.0), Letters::START, &title);
    let distances = |colour: Colour| Style::line(colour, 2.0);
    let speeds = |colour: Colour| Style::line(colour, 1.2).dashed([5.0, 3.0]);
    let entries = [
        (distances(JINK), "jink, distance (m)"),
        (speeds(JINK), "jink, speed (m/s)"),
        (distances(PX4), "PX4, distance (m)"),
        (speeds(PX4), "PX4, speed (m/s)"),
        (KEPT, "CP_DIST"),
    ];
    legend(&mut out, (LEFT, 40.0), &entries);
    let both = || jink.iter().chain(px4);
    let end_s = both().map(|m| m.time_s).fold(1.0, f64::max);
    // What is far off says nothing of how it stops.
    let top_m = both().map(|m| m.distance_m).fold(CP_DIST_M, f64::max).min(30.0) * 1.05;
    let top_mps = both().map(Moment::speed_mps).fold(0.5, f64::max) * 1.05;
    let distance = Frame {
        area: area(56.0, CHART_HEIGHT - 80.0),
        x: [0.0, end_s],
        y: [0.0, top_m],
    };
    let speed = Frame {
        y: [0.0, top_mps],
        ..distance
    };
    axes(&mut out, &distance);
    speed.numbers_right(&mut out, step(top_mps, STEPS));
    distance.label_below(&mut out, "time since the stick was pushed (s)");
    distance.curve(&mut out, [(0.0, CP_DIST_M), (end_s, CP_DIST_M)], KEPT);
    for (moments, colour) in [(px4, PX4), (jink, JINK)] {
        let metres = moments.iter().map(|m| (m.time_s, m.distance_m));
        distance.curve(&mut out, metres, distances(colour));
        let mps = moments.iter().map(|m| (m.time_s, m.speed_mps()));
        speed.curve(&mut out, mps, speeds(colour));
    }
    from_above(&mut out, cell, jink, px4);
    document(CHART_HEIGHT + MAP_HEIGHT + 60.0, out)
}

/// North is to the right, east is down: the vehicle flies to the right, and what is at its right hand is below.
fn from_above(out: &mut Group, cell: &Cell, jink: &[Moment], px4: &[Moment]) {
    let both = || jink.iter().chain(px4);
    let area = area(CHART_HEIGHT + 30.0, MAP_HEIGHT - 30.0);
    let farthest_m = both().map(|m| m.ahead_m).fold(cell.ahead_m() + 4.0, f64::max) + 1.0;
    let near_m = both().map(|m| m.ahead_m).fold(0.0, f64::min) - 1.0;
    let (least_m, most_m) = both().fold((-4.0f64, 4.0f64), |(least, most), m| {
        (least.min(m.right_m - 2.0), most.max(m.right_m + 2.0))
    });
    // One scale for both axes.
    let per_px = ((farthest_m - near_m) / area.width).max((most_m - least_m) / area.height);
    let middle_m = 0.5 * (least_m + most_m);
    let half_m = 0.5 * per_px * area.height;
    let frame = Frame {
        area,
        x: [near_m, near_m + per_px * area.width],
        y: [middle_m + half_m, middle_m - half_m],
    };
    let scale = 1.0 / per_px;
    let mut map = Group::default();
    if !cell.scene.moves() {
        for obstacle in cell
            .scene
            .obstacles(cell.ahead_m(), cell.incidence_deg, Place::default())
        {
            solid(&mut map, &frame, scale, &obstacle);
        }
    }
    for (moments, colour) in [(px4, PX4), (jink, JINK)] {
        let people: Vec<_> = moments.iter().filter_map(|m| m.person_m).collect();
        for [north_m, east_m] in people.iter().step_by(50) {
            let radius_px = (0.25 * scale).max(1.5);
            let person = Style::filled(SOLID).opacity(0.4);
            map.circle(frame.at(*north_m, *east_m), radius_px, person);
        }
        let path = moments.iter().map(|m| frame.at(m.ahead_m, m.right_m));
        map.polyline(path, Style::line(colour, 2.0));
        if let Some(end) = moments.last() {
            let place = frame.at(end.ahead_m, end.right_m);
            let around = Style::filled(colour);
            map.circle(place, 0.3 * scale, around.opacity(0.8));
            map.circle(place, CP_DIST_M * scale, around.opacity(0.08));
        }
    }
    out.add_clipped(area, map);
    axes(out, &frame);
    frame.label_below(
        out,
        "from above: ahead (m), to the right (m) downwards; at the end the hull, and CP_DIST around it",
    );
}

fn solid(group: &mut Group, frame: &Frame, scale: f64, obstacle: &Obstacle) {
    let style = Style::filled(SOLID);
    match obstacle {
        Obstacle::Cylinder(post) => {
            let radius_px = (post.radius_m * scale).max(1.5);
            group.circle(frame.at(post.north_m, post.east_m), radius_px, style);
        }
        Obstacle::Box(wall) => {
            // What a box is made of is shown by its drawing only.
            let Ok(Value::Object(wall)) = serde_json::to_value(wall) else {
                return;
            };
            let get = |name: &str| wall.get(name).and_then(Value::as_f64).unwrap_or(0.0);
            let centre = frame.at(get("north_m"), get("east_m"));
            let size_px = [get("length_m") * scale, (get("width_m") * scale).max(1.5)];
            group.turned_rect(centre, size_px, get("yaw_rad").to_degrees(), style);
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
    let mut out = Group::default();
    let total = |counts: &[u32]| counts.iter().sum::<u32>();
    out.text(
        (LEFT, 20.0),
        Letters::START,
        "Distance at rest less CP_DIST: wall, post and corner, without guidance; the last bar holds everything beyond",
    );
    let charts = [(JINK, "jink", &jink, 40.0), (PX4, "PX4", &px4, 230.0)];
    for (colour, name, counts, top) in charts {
        let frame = Frame {
            area: area(top, 150.0),
            x: [FROM_M, TO_M],
            y: [0.0, f64::from(most) * 1.08],
        };
        for (bin, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let from_m = FROM_M + bin as f64 * BIN_M;
            let ends_m = [from_m, from_m + BIN_M];
            frame.bar(&mut out, ends_m, f64::from(*count), Style::filled(colour));
        }
        frame.curve(&mut out, [(0.0, 0.0), (0.0, f64::from(most))], KEPT);
        axes(&mut out, &frame);
        let words = format!("{name}, {} approaches", total(counts));
        out.text((WIDTH - RIGHT - 8.0, top + 18.0), Letters::END, &words);
    }
    out.text((WIDTH / 2.0, 418.0), Letters::MIDDLE, "m");
    document(430.0, out)
}
