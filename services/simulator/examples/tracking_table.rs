//! Flies the references on which PX4's tracking and stopping were measured, and prints both side by side.
//!
//! `cargo run -p jink-simulator --example tracking_table`

#[path = "../tests/support/mod.rs"]
mod support;

use support::tracking;

fn main() {
    println!("tracking errors in metres: observed | emulated | ratio");
    println!(
        "{:<31} {:>4} {:>7} | {:^22} | {:^22} | {:^22} | {:^22}",
        "stream", "v", "A, L", "along p50", "along worst", "cross p50", "cross max"
    );
    for row in tracking::rows() {
        let emulated = tracking::tracking(&row);
        let cells: Vec<String> = row
            .observed
            .iter()
            .zip(emulated)
            .map(|(o, e)| format!("{o:>6.2} {e:>6.2} {:>8.2}", e / o))
            .collect();
        println!(
            "{:<31} {:>4} {:>2}, {:>3} | {}",
            row.name,
            row.reference.speed,
            row.reference.amplitude,
            row.reference.wavelength,
            cells.join(" | ")
        );
    }
    println!("\nstops, past the end in metres: observed | emulated | ratio");
    for stop in tracking::stops() {
        let past = tracking::overshoot(&stop);
        println!(
            "{:<31} v {:>3} peak {} m/s2 | {:>5.2} {past:>5.2} {:>5.2}",
            stop.name,
            stop.reference.speed,
            stop.reference.stop,
            stop.observed,
            past / stop.observed
        );
    }
}
