//! Results for people and for programs: one table for each setup, pictures.

use crate::judge::Verdict;
use crate::record::Record;
use crate::setup::Setup;
use jink_lab::flight_log::CoursePoint;
use jink_lab::picture::{Scene, World as Drawn, svg};
use jink_simulated_world::world::{World, WorldSpec};
use std::fmt::Write;
use std::path::Path;

/// A flight on one line.
pub fn line(verdict: &Verdict) -> String {
    format!(
        "{} {}/{}: {}{}; clearance {} m, {:.1} m/s, {:.0} s",
        if verdict.passed { "pass" } else { "FAIL" },
        verdict.setup,
        verdict.flight,
        verdict.outcome,
        if verdict.reason.is_empty() {
            String::new()
        } else {
            format!(" ({})", verdict.reason)
        },
        metres(verdict.min_clearance_m),
        verdict.top_speed_mps,
        verdict.time_s
    )
}

fn metres(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |m| format!("{m:.2}"))
}

/// The whole table in Markdown, with what was not tested and why.
pub fn markdown(verdicts: &[Verdict], untested: &[(Setup, String)]) -> String {
    let mut out = String::new();
    for setup in Setup::ALL {
        let flown: Vec<&Verdict> = verdicts
            .iter()
            .filter(|verdict| verdict.setup == setup.name())
            .collect();
        if let Some((_, why)) = untested.iter().find(|(not, _)| *not == setup) {
            let _infallible = writeln!(out, "## {setup}: NOT TESTED: {why}\n");
        }
        let Some(first) = flown.first() else { continue };
        let (passed, collided) = (
            flown.iter().filter(|v| v.passed).count(),
            flown.iter().filter(|v| v.collided).count(),
        );
        let _infallible = writeln!(
            out,
            "## {setup} ({}): {passed} of {} passed, {collided} collisions\n\n\
             | flight | world, seed | expected | outcome | clearance (m) | top (m/s) | time (s) | gap (ms) | unasked modes | restarts | texts of jink | radio, of it jink (B/s) | verdict |\n\
             |---|---|---|---|---|---|---|---|---|---|---|---|---|",
            first.version,
            flown.len()
        );
        for verdict in flown {
            row(&mut out, verdict);
        }
        out.push('\n');
    }
    let (passed, collided) = (
        verdicts.iter().filter(|v| v.passed).count(),
        verdicts.iter().filter(|v| v.collided).count(),
    );
    let _infallible = writeln!(
        out,
        "{passed} of {} flights passed, {collided} collisions.",
        verdicts.len()
    );
    out
}

/// The texts without their times, each kind once: those that differ in numbers only are counted.
fn kinds_of_texts(texts: &[String]) -> Vec<String> {
    let mut kinds: Vec<(String, &str, u32)> = Vec::new();
    for text in texts {
        let words = text
            .split_once(' ')
            .map_or("", |(_, words)| words.trim_start_matches("jink: "));
        let kind: String = words.chars().filter(|letter| !letter.is_ascii_digit()).collect();
        match kinds.iter_mut().find(|(known, _, _)| *known == kind) {
            Some((_, _, count)) => *count += 1,
            None => kinds.push((kind, words, 1)),
        }
    }
    let reported = kinds.iter().map(|(_, words, count)| match count {
        1 => (*words).to_owned(),
        _ => format!("{words} ({count} times)"),
    });
    reported.collect()
}

fn row(out: &mut String, verdict: &Verdict) {
    let texts = kinds_of_texts(&verdict.texts);
    let _infallible = writeln!(
        out,
        "| {} | {} {} | {} | {} | {} | {:.2} | {:.1} | {:.0} | {} | {} | {} | {:.0}, {:.0} | {} |",
        verdict.flight,
        verdict.world,
        verdict.seed,
        verdict.expectation.replace('|', " or "),
        verdict.outcome,
        metres(verdict.min_clearance_m),
        verdict.top_speed_mps,
        verdict.time_s,
        verdict.longest_gap_ms,
        verdict.unwanted_modes.join("; "),
        verdict.restarts,
        texts.join("; ").replace('|', "/"),
        verdict.radio_bytes_per_s,
        verdict.jink_bytes_per_s,
        if verdict.passed {
            "pass".to_owned()
        } else {
            format!("FAIL: {}", verdict.reason.replace('|', " or "))
        }
    );
}

/// Draws the course by truth.
///
/// # Errors
/// If it cannot be written.
pub fn draw(verdict: &Verdict, record: &Record, file: &Path) -> Result<(), String> {
    let spec = WorldSpec {
        kind: verdict.world.parse().map_err(|error| format!("{error}"))?,
        seed: verdict.seed,
        density_per_m2: None,
    };
    let world = World::from_spec(&spec).map_err(|error| error.to_string())?;
    let drawn: Drawn = serde_json::from_value(world.json()).map_err(|error| error.to_string())?;
    let begin_s = record.truth.first().map_or(0.0, |truth| truth.at_s);
    let course: Vec<CoursePoint> = record
        .truth
        .iter()
        .step_by(5)
        .map(|truth| CoursePoint {
            time_s: truth.at_s - begin_s,
            clearance_m: truth.clearance_m,
            north_m: truth.place.x_m,
            east_m: truth.place.y_m,
            up_m: -truth.place.z_m,
            speed_mps: truth.speed_mps(),
        })
        .collect();
    let picture = svg(&Scene {
        world: &drawn,
        course: &course,
        faults: &[],
        title: &line(verdict),
    });
    std::fs::write(file, picture).map_err(|error| error.to_string())
}
