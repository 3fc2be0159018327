//! What was measured, for people: lines of text, a comparison, a page with plots.

use super::figures::Figures;
use super::recorder::Measured;
use super::scaling::{self, Fit};
use crate::drawing::{Area, Colour, Document, Frame, Group, Letters, Style, legend, step};
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// Where the figures come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Commit of the checkout, with a plus if it was changed.
    pub commit: Option<String>,
    /// The CPU.
    pub cpu: String,
    /// The kernel.
    pub kernel: String,
    /// The world and its seed.
    pub world: String,
    /// The seed.
    pub seed: u64,
    /// Highest speed (m/s).
    pub speed_mps: f64,
}

/// A whole benchmark.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bench {
    /// Where it comes from.
    pub provenance: Provenance,
    /// Its loads.
    pub loads: Vec<Measured>,
}

/// Head of [`Measured::text`].
const COLUMNS: &str = "ms                 p50      p90      p99    p99.9      max   jitter";

fn row(text: &mut String, name: &str, figures: &Figures) {
    let Figures {
        p50_ms,
        p90_ms,
        p99_ms,
        p999_ms,
        max_ms,
        jitter_ms,
        ..
    } = figures;
    // Writing to a text cannot fail.
    let _written = writeln!(
        text,
        "{name:<13} {p50_ms:>8.3} {p90_ms:>8.3} {p99_ms:>8.3} {p999_ms:>8.3} {max_ms:>8.3} {jitter_ms:>8.3}"
    );
}

impl Measured {
    /// Its figures as a table.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{}: {} trajectories in {:.0} s\n{COLUMNS}\n",
            self.load, self.total.n, self.seconds
        );
        row(&mut text, "capture..wire", &self.total);
        row(&mut text, "sensor..wire", &self.after_sensor);
        row(&mut text, "  first plan", &self.first_of_map);
        for stage in &self.stages {
            let _written = writeln!(text, "{}", stage.stage);
            if stage.stage != "sensor" {
                row(&mut text, "  busy", &stage.busy);
                row(&mut text, "  wake-up", &stage.wake_up);
            }
            row(&mut text, "  compute", &stage.compute);
        }
        let _written = writeln!(
            text,
            "process                cpu %  waits/s  preempted/s  minor faults/s  major faults"
        );
        for process in &self.processes {
            let _written = writeln!(
                text,
                "{:<20} {:>7.2} {:>8.1} {:>12.2} {:>15.2} {:>13}",
                process.process,
                process.cpu_percent,
                process.waits_per_s,
                process.preemptions_per_s,
                process.minor_faults_per_s,
                process.major_faults
            );
        }
        let _written = writeln!(
            text,
            "of the chain         {:>7.2}   (without what is simulated)",
            self.chain_cpu_percent()
        );
        if self.restarts > 0 {
            let _written = writeln!(text, "{} processes were started again meanwhile", self.restarts);
        }
        text
    }

    /// CPU of all processes that would run on an aircraft (percent of one core).
    pub fn chain_cpu_percent(&self) -> f64 {
        let of_aircraft = self
            .processes
            .iter()
            .filter(|process| !["simulator", "sensors"].contains(&process.process.as_str()));
        of_aircraft.map(|process| process.cpu_percent).sum()
    }
}

impl Bench {
    /// One line about where the figures come from.
    pub fn head(&self) -> String {
        let Provenance {
            commit,
            cpu,
            kernel,
            world,
            seed,
            speed_mps,
        } = &self.provenance;
        format!(
            "commit {}; {cpu}; Linux {kernel}; {world} {seed} at {speed_mps} m/s",
            commit.as_deref().unwrap_or("unknown")
        )
    }

    /// How the cost grows with the load, where three or more loads differ in one thing; else empty.
    pub fn scaling(&self) -> String {
        scaling::text(&scaling::fits(&self.loads))
    }

    /// This one over `before`, load by load: ratios of the medians and of the 99th percentiles.
    pub fn compared(&self, before: &Self) -> String {
        let mut text = format!(
            "over: {}\n{:<44} {:>8} {:>8} {:>8}\n",
            before.head(),
            "ratio",
            "p50",
            "p99",
            "cpu"
        );
        for now in &self.loads {
            let same = |other: &&Measured| other.load == now.load;
            let Some(then) = before.loads.iter().find(same) else {
                let _written = writeln!(text, "{:<44} was not measured", now.load.to_string());
                continue;
            };
            let ratio = |now: f64, then: f64| if then > 0.0 { now / then } else { f64::NAN };
            let _written = writeln!(
                text,
                "{:<44} {:>8.3} {:>8.3} {:>8.3}",
                now.load.to_string(),
                ratio(now.after_sensor.p50_ms, then.after_sensor.p50_ms),
                ratio(now.after_sensor.p99_ms, then.after_sensor.p99_ms),
                ratio(now.chain_cpu_percent(), then.chain_cpu_percent()),
            );
        }
        text
    }
}

const WIDTH: f64 = 860.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 20.0;
const CHART_HEIGHT: f64 = 260.0;
const BAR_HEIGHT: f64 = 18.0;
const BAR_APART: f64 = 30.0;
const LETTERS: f64 = 12.0;
/// Numbers along an axis, at most.
const STEPS: f64 = 8.0;

/// A page that stands by itself: where the figures come from, the distribution under every load, where the time goes, all tables.
pub fn html(bench: &Bench) -> String {
    let mut page = String::from(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>jink bench latency</title>\n\
         <style>body{font-family:sans-serif;max-width:900px;margin:2em auto}pre{overflow-x:auto}svg{max-width:100%}</style>\
         </head><body>\n<h1>From the sensor to the wire</h1>\n",
    );
    let _written = write!(
        page,
        "<p>{}</p>\n<h2>How long it takes</h2>\n{}\n<h2>Where the time goes</h2>\n{}\n",
        escaped(&bench.head()),
        distribution(&bench.loads),
        stages(&bench.loads)
    );
    let fits = scaling::fits(&bench.loads);
    if !fits.is_empty() {
        page.push_str("<h2>How it grows</h2>\n");
        for of_one in fits.chunk_by(Fit::is_of_same_loads) {
            let _written = writeln!(page, "{}", growth(of_one));
        }
        let _written = writeln!(page, "<pre>{}</pre>", escaped(&scaling::text(&fits)));
    }
    page.push_str("<h2>Figures</h2>\n");
    for measured in &bench.loads {
        let _written = writeln!(page, "<pre>{}</pre>", escaped(&measured.text()));
    }
    page.push_str("</body></html>\n");
    page
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// Colours come back with dashes, and once more with longer ones: there are sixteen loads.
fn curve_style(n: usize) -> Style {
    let colours = Colour::SEVERAL;
    let line = Style::line(colours[n % colours.len()], 2.0);
    match n / colours.len() {
        0 => line,
        round => line.dashed([3.0 * round as f64, 2.0]),
    }
}

/// Which share of all trajectories is on the wire by then, under each load.
fn distribution(loads: &[Measured]) -> String {
    let names: Vec<String> = loads.iter().map(|measured| measured.load.to_string()).collect();
    let entries: Vec<(Style, &str)> = names
        .iter()
        .enumerate()
        .map(|(n, name)| (curve_style(n), name.as_str()))
        .collect();
    // A few that are much longer would press all others to the edge; they stand in the tables.
    let longest = loads.iter().map(|measured| measured.after_sensor.p99_ms);
    let longest_ms = longest.fold(1.0, f64::max) * 1.3;
    let top = 30.0 + 18.0 * entries.len() as f64;
    let area = Area {
        left: LEFT,
        top,
        width: WIDTH - LEFT - RIGHT,
        height: CHART_HEIGHT,
    };
    let frame = Frame {
        area,
        x: [0.0, longest_ms],
        y: [0.0, 100.0],
    };
    let mut out = Group::default();
    out.text(
        (LEFT, 16.0),
        Letters::START.bold(),
        "share on the wire (%) so long after the sensor's publication (ms)",
    );
    for (n, entry) in entries.iter().enumerate() {
        legend(
            &mut out,
            (LEFT, 34.0 + 18.0 * n as f64),
            std::slice::from_ref(entry),
        );
    }
    let across = step(longest_ms, STEPS);
    frame.lines_across(&mut out, 25.0);
    frame.numbers_left(&mut out, 25.0);
    frame.lines_along(&mut out, across);
    frame.ticks_below(&mut out, across);
    for (measured, (style, _)) in loads.iter().zip(&entries) {
        let times = &measured.sorted_after_sensor_ms;
        let share = |index: usize| 100.0 * (index + 1) as f64 / times.len() as f64;
        let points = times
            .iter()
            .enumerate()
            .map(|(index, ms)| (*ms, share(index)))
            .take_while(|(ms, _)| *ms <= longest_ms);
        frame.curve(&mut out, points, *style);
    }
    frame.border(&mut out);
    document(out, top + CHART_HEIGHT + 40.0)
}

/// The medians of what each stage takes, one bar for each load: before its begin light, computing dark.
fn stages(loads: &[Measured]) -> String {
    let total = |measured: &Measured| -> f64 {
        let parts = measured.stages.iter().filter(|stage| stage.stage != "sensor");
        parts
            .map(|stage| stage.busy.p50_ms + stage.wake_up.p50_ms + stage.compute.p50_ms)
            .sum()
    };
    let longest_ms = loads.iter().map(total).fold(1.0, f64::max) * 1.05;
    let names = ["fusion", "planner", "generator", "guard", "gateway"];
    let colour = |name: &str| {
        let index = names.iter().position(|known| *known == name).unwrap_or(0);
        Colour::SEVERAL[index]
    };
    let mut out = Group::default();
    out.text(
        (LEFT, 16.0),
        Letters::START.bold(),
        "medians (ms): grey before a stage's begin, coloured while it computes",
    );
    let entries: Vec<(Style, &str)> = names
        .iter()
        .map(|name| (Style::line(colour(name), BAR_HEIGHT / 2.0), *name))
        .collect();
    legend(&mut out, (LEFT, 34.0), &entries);
    let width = WIDTH - LEFT - RIGHT;
    let scale = width / longest_ms;
    for (n, measured) in loads.iter().enumerate() {
        let top = 70.0 + n as f64 * (BAR_HEIGHT + BAR_APART);
        out.text(
            (LEFT, top - 5.0),
            Letters::START,
            &format!("{}: {:.2} ms", measured.load, total(measured)),
        );
        let mut left = LEFT;
        for stage in measured.stages.iter().filter(|stage| stage.stage != "sensor") {
            let parts = [
                (stage.busy.p50_ms + stage.wake_up.p50_ms, Colour::hex(0xcccccc)),
                (stage.compute.p50_ms, colour(&stage.stage)),
            ];
            for (ms, colour) in parts {
                let area = Area {
                    left,
                    top,
                    width: ms * scale,
                    height: BAR_HEIGHT,
                };
                out.rect(area, Style::filled(colour));
                left += ms * scale;
            }
        }
    }
    document(out, 70.0 + loads.len() as f64 * (BAR_HEIGHT + BAR_APART))
}

/// Lines of one group of loads, each cost in a chart of its own beside the others.
fn growth(fits: &[Fit]) -> String {
    let mut out = Group::default();
    if let Some(fit) = fits.first() {
        let title = format!("{}, per {}", fit.title(), fit.dimension.words());
        out.text((LEFT, 16.0), Letters::START.bold(), &title);
    }
    let apart = LEFT;
    let width = (WIDTH - RIGHT) / fits.len().max(1) as f64 - apart;
    for (n, fit) in fits.iter().enumerate() {
        let longest = |value: fn(&(f64, f64)) -> f64| fit.points.iter().map(value).fold(0.0, f64::max);
        let (most_x, most_y) = (longest(|point| point.0) * 1.1, longest(|point| point.1) * 1.2);
        let frame = Frame {
            area: Area {
                left: apart + n as f64 * (width + apart),
                top: 54.0,
                width,
                height: CHART_HEIGHT * 0.7,
            },
            x: [0.0, most_x.max(1e-3)],
            y: [0.0, most_y.max(1e-3)],
        };
        let (across, along) = (step(frame.y[1], 5.0), step(frame.x[1], 5.0));
        out.text((frame.area.left, 44.0), Letters::START, fit.cost.words());
        frame.lines_across(&mut out, across);
        frame.numbers_left(&mut out, across);
        frame.lines_along(&mut out, along);
        frame.ticks_below(&mut out, along);
        let ends = [0.0, frame.x[1]].map(|x| (x, (fit.base + fit.slope * x).clamp(0.0, frame.y[1])));
        frame.curve(
            &mut out,
            ends,
            Style::line(Colour::hex(0x999999), 1.5).dashed([4.0, 3.0]),
        );
        for (x, y) in &fit.points {
            out.circle(frame.at(*x, *y), 4.0, Style::filled(Colour::SEVERAL[n]));
        }
        frame.border(&mut out);
    }
    document(out, 54.0 + CHART_HEIGHT * 0.7 + 40.0)
}

fn document(body: Group, height: f64) -> String {
    Document {
        width_px: WIDTH,
        height_px: height,
        background: Colour::WHITE,
        letters_px: LETTERS,
        content: body,
    }
    .into_svg()
}

#[cfg(test)]
pub(super) mod tests {
    use super::{Bench, Provenance, html};
    use crate::latency::disturbance::Disturbance;
    use crate::latency::{Figures, Load, Measured, ProcessFigures, StageFigures};

    /// What a load has shown, with times and CPU of this scale; `change` changes the load.
    pub fn measured_with(scale: f64, change: impl Fn(&mut Load)) -> Measured {
        let figures = Figures::of(&[1.0 * scale, 2.0 * scale, 4.0 * scale]);
        let mut load = Load {
            points: 20_000,
            rate_hz: 10.0,
            sensors: 1,
            readers: 0,
            beside: Disturbance::None,
            realtime: false,
        };
        change(&mut load);
        Measured {
            load,
            seconds: 20.0,
            total: figures,
            after_sensor: figures,
            first_of_map: figures,
            stages: vec![StageFigures {
                stage: "fusion".to_owned(),
                busy: figures,
                wake_up: figures,
                compute: figures,
            }],
            processes: ["planner", "sensors"]
                .map(|process| ProcessFigures {
                    process: process.to_owned(),
                    cpu_percent: 4.0 * scale,
                    waits_per_s: 30.0,
                    preemptions_per_s: 1.0,
                    minor_faults_per_s: 0.0,
                    major_faults: 0,
                })
                .to_vec(),
            sorted_after_sensor_ms: vec![1.0, 2.0, 4.0],
            sorted_total_ms: vec![1.0, 2.0, 4.0],
            restarts: 0,
        }
    }

    fn bench(scale: f64) -> Bench {
        let measured = |beside| measured_with(scale, |load| load.beside = beside);
        Bench {
            provenance: Provenance {
                commit: Some("abc<".to_owned()),
                cpu: "2 x CPU".to_owned(),
                kernel: "6".to_owned(),
                world: "forest".to_owned(),
                seed: 1,
                speed_mps: 3.0,
            },
            loads: vec![measured(Disturbance::None), measured(Disturbance::Hog)],
        }
    }

    #[test]
    fn what_is_simulated_is_no_part_of_the_chain() {
        assert_eq!(bench(1.0).loads[0].chain_cpu_percent(), 4.0);
    }

    #[test]
    fn a_comparison_takes_the_same_loads() {
        let (mut now, before) = (bench(2.0), bench(1.0));
        now.loads[1].load.points = 1;
        let text = now.compared(&before);
        assert!(
            text.contains("20000 points, 10 Hz") && text.contains("2.000"),
            "{text}"
        );
        assert!(
            text.contains("1 points, 10 Hz, hog") && text.contains("was not measured"),
            "{text}"
        );
    }

    #[test]
    fn the_page_is_whole_and_shows_every_load() {
        let page = html(&bench(1.0));
        for part in [
            "abc&lt;",
            "20000 points, 10 Hz, hog",
            "<polyline",
            "capture..wire",
            "</html>",
        ] {
            assert!(page.contains(part), "{part} is not in\n{page}");
        }
        assert_eq!(page.matches("<svg").count(), 2);
    }

    #[test]
    fn a_file_that_was_written_can_be_read() {
        let text = serde_json::to_string(&bench(1.0)).unwrap();
        assert_eq!(serde_json::from_str::<Bench>(&text).unwrap(), bench(1.0));
    }
}
