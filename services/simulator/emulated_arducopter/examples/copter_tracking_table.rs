//! Flies the references on which ArduCopter's tracking and stopping were measured, and prints both side by side.
//!
//! `cargo run --release -p jink-emulated-arducopter --example copter_tracking_table`

#[path = "../tests/it/support/mod.rs"]
mod support;

use support::copter_tracking as tracking;

fn cell(observed: f64, emulated: f64) -> String {
    if observed.is_nan() {
        format!("{:>6} {emulated:>6.2} {:>5}", "-", "")
    } else {
        format!("{observed:>6.2} {emulated:>6.2} {:>5.2}", emulated / observed)
    }
}

fn main() {
    println!("tracking errors in metres: observed emulated ratio");
    println!(
        "{:<27} {:>3} {:>6} | {:^19} | {:^19} | {:^19}",
        "sent", "v", "A, L", "p50", "max", "cross max"
    );
    for row in tracking::rows() {
        let emulated = tracking::tracking(&row);
        println!(
            "{:<27} {:>3} {:>2}, {:>2} | {} | {} | {}",
            row.name,
            row.reference.speed,
            row.reference.amplitude,
            row.reference.wavelength,
            cell(row.observed.p50, emulated.p50),
            cell(row.observed.max, emulated.max),
            cell(row.observed.cross_max, emulated.cross_max)
        );
    }
    println!("\nstops, past the end in metres: observed emulated ratio");
    for stop in tracking::stops() {
        println!(
            "{:<27} v {:>3} peak {} m/s2 | {}",
            stop.name,
            stop.reference.speed,
            stop.reference.stop,
            cell(stop.observed, tracking::overshoot(&stop))
        );
    }
    println!("\nhalts from 4.5 m/s: travel, end (m), time to 0.1 m/s (s)");
    for halt in tracking::halts() {
        let after = tracking::come_to_rest(&halt);
        let [travel, end, time] = halt.observed;
        println!(
            "{:<27} | {} | {} | {}",
            halt.name,
            cell(travel, after.max),
            cell(end, after.last),
            cell(time, after.stopped_s)
        );
    }
    println!("\nstreams that stop at 4.5 m/s: +1 s, +3 s, max, final (m)");
    for silence in tracking::silences() {
        let after = tracking::fall_silent(&silence);
        let emulated = [after.one_s, after.three_s, after.max, after.last];
        let cells: Vec<String> = silence
            .observed
            .iter()
            .zip(emulated)
            .map(|(o, e)| cell(*o, e))
            .collect();
        println!("{:<27} | {}", silence.name, cells.join(" | "));
    }
}
