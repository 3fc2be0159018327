//! Temporary.
#![allow(clippy::unwrap_used)]
use jink_lab::drill::Fault;
use jink_lab::flight_log::{CoursePoint, FaultRecord};
use jink_lab::picture::{Scene, World, svg};
fn main() {
    let world: World = serde_json::from_slice(&std::fs::read("/tmp/w/lab-world.json").unwrap()).unwrap();
    let course: Vec<CoursePoint> = (-60..300).map(|i| { let t = f64::from(i) * 0.1; let n = (t.max(0.0) * 1.4).min(38.0);
        CoursePoint { time_s: t, north_m: n, east_m: 2.0 * (0.2 * n).sin(), up_m: (2.5 * (t + 6.0) / 6.0).min(2.5) + 0.2 * (0.5 * t).sin().abs(), speed_mps: if n < 38.0 && t > 0.0 { 1.5 + (0.3 * t).sin() } else { 0.0 }, clearance_m: if i < -30 { f64::INFINITY } else { 2.0 + 1.5 * (0.4 * t).cos() } } }).collect();
    let fault = FaultRecord { fault: Fault::Kill, process: "planner".to_owned(), at_s: 8.0, phase: "mission".to_owned(), survived: true, detection_ms: None, recovery_ms: Some(58.0), gap_ms: 52.0, collisions: 0, holds: 0, north_m: 11.2, east_m: 1.5, seams: Vec::new(), reason: None };
    let sensed: Vec<(f64, f64)> = (0..60).map(|i| (15.0 + 0.2 * f64::from(i % 3), -4.0 + 0.2 * f64::from(i / 3))).collect();
    print!("{}", svg(&Scene { world: &world, course: &course, sensed: &sensed, faults: &[fault], title: "jink: gap <7>, goal, 1.50 m/s mean" }));
}
