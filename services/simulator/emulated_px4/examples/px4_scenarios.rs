//! Writes scenarios of PX4's collision prevention with what it answers, as the emulated one does, which answers every vector that was
//! recorded as PX4 did. In their form, one JSON object a line, for the example `vectors` of the guard.
//!
//! | kind | what it is about |
//! |---|---|
//! | `turning` | rows that count from north, under a vehicle that turns between them |
//! | `sparse` | rows with most elements unknown, at high speed, the stick toward what is free or known |
//!
//! `cargo run --release -p jink-emulated-px4 --example px4_scenarios -- KIND FIRST LAST > FILE.jsonl`

use jink_emulated_px4::collision_prevention::{CollisionPrevention, ObstacleDistance, Settings};
use jink_simulated_world::random::Random;
use nalgebra::Vector2;
use serde_json::{Value, json};
use std::process::ExitCode;

const BINS: usize = 72;
const UNKNOWN_CM: u16 = u16::MAX;
/// MAV_FRAME_LOCAL_NED, MAV_FRAME_BODY_FRD.
const FRAMES: [u8; 2] = [1, 12];
/// An answer that such a change (deg) of where a row begins changes is one of rounding, and marked as fragile.
const PERTURBED_DEG: f32 = 2e-3;
/// The same of a setpoint (m/s2).
const PERTURBED_MPS2: f32 = 1e-3;
const START_US: u64 = 60_000_000;

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Turning,
    Sparse,
}

struct Step {
    t_us: u64,
    yaw_rad: f64,
    row: Option<ObstacleDistance>,
    setpoint_mps2: Vector2<f32>,
    velocity_mps: Vector2<f32>,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [kind, first, last] = arguments.as_slice() else {
        eprintln!("usage: px4_scenarios turning|sparse FIRST LAST");
        return ExitCode::from(2);
    };
    let kind_of = match kind.as_str() {
        "turning" => Some(Kind::Turning),
        "sparse" => Some(Kind::Sparse),
        _ => None,
    };
    let (Some(of), Ok(first), Ok(last)) = (kind_of, first.parse::<u64>(), last.parse::<u64>()) else {
        eprintln!("px4_scenarios: {kind:?} {first:?} {last:?} is not a kind and two numbers");
        return ExitCode::from(2);
    };
    for seed in first..=last {
        println!("{}", scenario(of, &format!("{kind}-{seed:04}"), seed));
    }
    ExitCode::SUCCESS
}

fn scenario(kind: Kind, id: &str, seed: u64) -> Value {
    let mut random = Random::new(seed, kind as u64);
    let settings = Settings {
        distance_m: pick(&mut random, &[1.0, 2.0, 3.0, 5.0]),
        delay_s: pick(&mut random, &[0.0, 0.2, 0.4]),
        guide_deg: pick(&mut random, &[0.0, 30.0, 60.0]),
        acceleration_mps2: pick(&mut random, &[3.0, 5.0, 8.0]),
        ..Settings::default()
    };
    let steps = steps(kind, &mut random);
    // As it is, and with its rows begun a hair to either side: what differs then is rounding.
    let mut flights = [0.0, -PERTURBED_DEG, PERTURBED_DEG].map(|shift_deg| Flight {
        prevention: CollisionPrevention::new(settings),
        shift_deg,
    });
    let written: Vec<Value> = steps.iter().map(|step| answered(&mut flights, step)).collect();
    json!({
        "id": id,
        "family": "setpoint_constraint",
        "start_us": START_US,
        "params": {
            "CP_DIST": settings.distance_m,
            "CP_DELAY": settings.delay_s,
            "CP_GUIDE_ANG": settings.guide_deg,
            "CP_GO_NO_DATA": u8::from(settings.go_without_data),
            "MPC_XY_P": settings.position_gain_per_s,
            "MPC_JERK_MAX": settings.jerk_mps3,
            "MPC_ACC_HOR": settings.acceleration_mps2,
            "MPC_XY_VEL_P_ACC": settings.velocity_gain_per_s,
            "MPC_VEL_MANUAL": settings.manual_speed_mps,
        },
        "steps": written,
        "tags": [],
    })
}

fn steps(kind: Kind, random: &mut Random) -> Vec<Step> {
    let mut yaw_rad = random.between(-3.1, 3.1);
    let mut t_us = START_US;
    let count = match kind {
        Kind::Turning => 4 + (random.bits() % 8) as usize,
        Kind::Sparse => 1 + (random.bits() % 3) as usize,
    };
    let increment_deg = pick(random, &[5.0, 5.0, 6.0, 10.0]);
    let offset_deg = random.between(-180.0, 180.0) as f32;
    let mut bearing_rad = 0.0;
    let mut step = |index: usize, random: &mut Random| {
        if index > 0 {
            t_us += pick(random, &[20_000, 50_000, 100_000, 200_000]);
            if kind == Kind::Turning {
                yaw_rad += random.between(-0.6, 0.6);
            }
        }
        let row = (index == 0 || random.unit() < 0.7).then(|| {
            let frame = match kind {
                Kind::Turning => FRAMES[0],
                Kind::Sparse => pick(random, &FRAMES),
            };
            let (distances_cm, element) = distances(kind, random);
            let from_rad = if frame == FRAMES[0] { 0.0 } else { yaw_rad };
            bearing_rad = from_rad + f64::from(offset_deg + element as f32 * increment_deg).to_radians();
            ObstacleDistance {
                time_us: t_us - pick(random, &[0, 10_000, 50_000]),
                frame,
                increment_deg,
                offset_deg,
                min_cm: 20,
                max_cm: 2000,
                distances_cm,
            }
        });
        let speed_mps = match kind {
            Kind::Turning => random.between(0.0, 4.0),
            Kind::Sparse => random.between(5.0, 15.0),
        };
        // Half of them to where something is known or just beside it, the others anywhere.
        let toward = |random: &mut Random, length: f64| {
            let spread_rad = pick(random, &[0.3, 3.2]);
            let (east, north) = (bearing_rad + random.between(-spread_rad, spread_rad)).sin_cos();
            Vector2::new((length * north) as f32, (length * east) as f32)
        };
        let pushed_mps2 = random.between(0.5, 8.0);
        Step {
            t_us,
            yaw_rad,
            row,
            setpoint_mps2: toward(random, pushed_mps2),
            velocity_mps: toward(random, speed_mps),
        }
    };
    (0..count).map(|index| step(index, random)).collect()
}

/// Some arcs with something or nothing in them, in between nothing is known; and the middle element of the last one.
fn distances(kind: Kind, random: &mut Random) -> ([u16; BINS], usize) {
    let mut middle = 0;
    let mut cm = [UNKNOWN_CM; BINS];
    let (arcs, widest) = match kind {
        Kind::Turning => (6, 24),
        Kind::Sparse => (1 + random.bits() % 3, 6),
    };
    for _ in 0..arcs {
        let (first, width) = (random.bits() as usize % BINS, 1 + random.bits() as usize % widest);
        middle = first + width / 2;
        let is_free = random.unit() < 0.4;
        let near_cm = random.between(60.0, 1900.0);
        for element in first..first + width {
            cm[element % BINS] = match is_free {
                true => 2001,
                false => (near_cm + random.between(-40.0, 40.0)) as u16,
            };
        }
    }
    (cm, middle)
}

struct Flight {
    prevention: CollisionPrevention,
    shift_deg: f32,
}

impl Flight {
    fn fly(&mut self, step: &Step) -> jink_emulated_px4::collision_prevention::Outcome {
        self.prevention.attitude(attitude(step.yaw_rad));
        if let Some(row) = step.row {
            let offset_deg = row.offset_deg + self.shift_deg;
            self.prevention
                .obstacle_distance(ObstacleDistance { offset_deg, ..row });
        }
        self.prevention
            .tick(step.t_us, step.setpoint_mps2, step.velocity_mps)
    }
}

/// The step with what is expected of it.
fn answered(flights: &mut [Flight; 3], step: &Step) -> Value {
    let outcomes = flights.each_mut().map(|flight| flight.fly(step));
    let [outcome, ..] = &outcomes;
    let map = flights[0].prevention.map();
    let fragile: Vec<usize> = (0..BINS)
        .filter(|bin| {
            flights
                .iter()
                .any(|flight| flight.prevention.map().distance_cm[*bin] != map.distance_cm[*bin])
        })
        .collect();
    let moved = outcomes
        .iter()
        .any(|other| (other.setpoint_mps2 - outcome.setpoint_mps2).norm() > PERTURBED_MPS2);
    let mut written = json!({
        "t_us": step.t_us,
        "attitude": { "t_us": step.t_us, "q": attitude(step.yaw_rad) },
        "setpoint_accel": pair(step.setpoint_mps2),
        "velocity": pair(step.velocity_mps),
        "expect": {
            "active": outcome.active,
            "setpoint_out": pair(outcome.setpoint_mps2),
            "map_cm": runs(&map.distance_cm.map(u64::from)),
            "published_map_cm": runs(&flights[0].prevention.published_cm().map(u64::from)),
            "bin_time_us": runs(&map.written_us),
            "bin_max_range_cm": runs(&map.range_cm.map(u64::from)),
            "bin_seen": runs(&map.seen.map(u64::from)),
            "map_min_cm": map.min_cm,
            "map_max_cm": map.max_cm,
            "map_time_us": map.time_us,
            "yaw": flights[0].prevention.yaw_rad(),
            "data_present": outcome.data_present,
            "warn_no_data": outcome.warns_of_no_data,
            "hold_requested": outcome.wants_hold,
            "unsupported_frame": outcome.unsupported_frame.is_some(),
            "closest_m": outcome.closest_m,
            "closest_dir": pair(outcome.closest_direction),
            "min_keep_m": outcome.keep_m,
        },
    });
    if let Some(row) = step.row {
        written["obstacle_distance"] = json!({
            "t_us": row.time_us,
            "frame": row.frame,
            "increment_deg": row.increment_deg,
            "angle_offset_deg": row.offset_deg,
            "min_cm": row.min_cm,
            "max_cm": row.max_cm,
            "distances_cm": runs(&row.distances_cm.map(u64::from)),
        });
    }
    if let Some(steering) = &outcome.steering {
        let expect = &mut written["expect"];
        expect["guided_bin"] = json!(steering.guidance.bin);
        expect["guided_dir"] = pair(steering.guidance.direction);
        expect["feasible"] = json!(steering.feasible);
        expect["constrained_accel"] = pair(steering.constrained_mps2);
        expect["vel_comp_accel"] = number(steering.braking.acceleration_mps2);
        expect["vel_comp_dir"] = pair(steering.braking.direction);
    }
    if moved || !fragile.is_empty() {
        written["fragile"] = json!({ "map_bins": fragile, "published_bins": fragile, "setpoint": moved });
    }
    written
}

fn attitude(yaw_rad: f64) -> [f32; 4] {
    let (sine, cosine) = (0.5 * yaw_rad).sin_cos();
    [cosine as f32, 0.0, 0.0, sine as f32]
}

/// Numbers that are none have names in this form.
fn number(x: f32) -> Value {
    match x.is_finite() {
        true => json!(x),
        false if x.is_nan() => json!("NaN"),
        false => json!(if x > 0.0 { "Infinity" } else { "-Infinity" }),
    }
}

fn pair(vector: Vector2<f32>) -> Value {
    json!([number(vector.x), number(vector.y)])
}

/// Run-length coded.
fn runs(values: &[u64; BINS]) -> Value {
    let mut runs: Vec<(u64, u64)> = Vec::new();
    for value in values {
        match runs.last_mut() {
            Some((last, count)) if last == value => *count += 1,
            _ => runs.push((*value, 1)),
        }
    }
    json!(runs)
}

fn pick<T: Copy>(random: &mut Random, choices: &[T]) -> T {
    choices[random.bits() as usize % choices.len()]
}
