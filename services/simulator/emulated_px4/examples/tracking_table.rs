//! Flies the references on which PX4's tracking and stopping were measured, and prints both side by side.
//!
//! `cargo run -p jink-emulated-px4 --example tracking_table`

#[path = "../tests/it/support/mod.rs"]
mod support;

use support::{tracking, tracking_current, travel};

fn main() {
    println!("PX4 of July 2021");
    trajectory_interface();
    println!("\ncurrent PX4, OFFBOARD with position, velocity and acceleration at 50 Hz");
    current();
}

fn trajectory_interface() {
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

fn current() {
    println!("tracking errors in metres: observed | emulated | ratio");
    println!(
        "{:>4} {:>4} {:>7} {:>5} | {:^22} | {:^22} | {:^22} | {:^22} | {:^22} | {:^22}",
        "drag", "v", "A, L", "ahead", "p50", "max", "along p50", "along worst", "cross p50", "cross max"
    );
    for row in tracking_current::rows() {
        let emulated = tracking_current::tracking(&row).list();
        let observed = row.observed.list();
        let cells: Vec<String> = observed
            .iter()
            .zip(emulated)
            .map(|(o, e)| format!("{o:>6.2} {e:>6.2} {:>8.2}", e / o))
            .collect();
        println!(
            "{:>4} {:>4} {:>2}, {:>3} {:>5} | {}",
            row.drag,
            row.reference.speed,
            row.reference.amplitude,
            row.reference.wavelength,
            row.rest_ahead_s,
            cells.join(" | ")
        );
    }
    println!("\nstops in metres, past the end, furthest ahead, furthest behind: observed | emulated | ratio");
    for stop in tracking_current::stops() {
        let emulated = tracking_current::stopping(&stop).list();
        let cells: Vec<String> = stop
            .observed
            .list()
            .iter()
            .zip(emulated)
            .map(|(o, e)| format!("{o:>5.2} {e:>5.2} {:>5.2}", e / o))
            .collect();
        println!(
            "drag {:>3} v {:>3} peak {} m/s2 | {}",
            stop.drag,
            stop.reference.speed,
            stop.reference.stop,
            cells.join(" | ")
        );
    }
    println!("\ntravel after the last setpoint in metres: observed | emulated | ratio");
    for case in travel::cases() {
        let emulated = travel::travel(&case);
        println!(
            "{:<40} {:>5.1} {emulated:>5.1} {:>5.2}",
            case.name,
            case.observed,
            emulated / case.observed
        );
    }
}
