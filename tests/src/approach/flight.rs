//! One approach in lock-step: take off, hover, push the stick, hold it.

use super::measure::Measure;
use super::scene::Place;
use super::{Approach, CP_DIST_M, Cell, Moment, Variant, Who};
use crate::lockstep::{FlightSetup, FrameDelay, LockStep};
use jink_emulated_ground_station::{Ending as PlanEnding, FlightPlan, Make, Phase};
use jink_mavlink_link::profile_name::{ProfileName, Representation};
use jink_shared_types::params::ParamSet;
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::sensors::{SensorKind, SensorSpec};
use jink_simulated_world::vehicle::wind::WindConfig;
use jink_simulator::autopilot::AutopilotConfig;
use mavlink::dialect::{MANUAL_CONTROL_DATA, MavMessage};

/// Height of the flight (m): a lidar on a vehicle that brakes looks down, and must not take the ground for what it sees.
const HEIGHT_M: f64 = 12.0;
/// Between two messages of the sticks (s).
const STICKS_PERIOD_S: f64 = 0.05;
/// Steps from one moment to the next: 20 ms.
const MOMENT_STEPS: u64 = 5;
/// It hovers when it was slower than this (m/s) for this long (s).
const HOVER_MPS: f64 = 0.15;
const HOVER_S: f64 = 1.0;
/// Longest time until it hovers (s).
const READY_S: f64 = 120.0;
/// The stick is held for this long after the time that the way takes (s).
const HELD_S: f64 = 40.0;
/// MPC_VEL_MANUAL is not below this (m/s): slower is part of the stick.
const SLOWEST_FULL_MPS: f64 = 3.0;
/// Steps from one place of the person to the next: 20 ms.
const WALK_STEPS: u64 = 5;

/// Flies one approach.
///
/// # Errors
/// A text naming what cannot be built, or that it never hovered.
pub fn fly(cell: &Cell) -> Result<(Approach, Vec<Moment>), String> {
    let mut flight = LockStep::new(setup(cell)?)?;
    flight.frame_delay = FrameDelay {
        delay_s: cell.delay_s,
        is_stamped_on_arrival: cell.variant == Variant::StampedOnArrival,
    };
    let mut sticks = Sticks::new(cell);
    hover(&mut flight, &mut sticks)?;
    sticks.is_pushed = true;
    let begin_s = flight.truth().time_s;
    let limit_s = cell.ahead_m() / cell.speed_mps + HELD_S;
    let (mut moments, mut measure) = (Vec::new(), Measure::new(cell));
    let (mut place, mut walks, mut steps) = (Place::default(), false, 0u64);
    loop {
        sticks.hold(&mut flight);
        flight.step();
        steps += 1;
        if cell.scene.moves() && steps.is_multiple_of(WALK_STEPS) {
            let to_go_m = cell.ahead_m() - flight.truth().position.x_m;
            walks |= cell.scene.sets_off(to_go_m, cell.speed_mps);
            if walks {
                place.walked_s += WALK_STEPS as f64 * 0.004;
                flight.move_world(cell.scene.world(cell.ahead_m(), cell.incidence_deg, place));
            }
        }
        if !steps.is_multiple_of(MOMENT_STEPS) {
            continue;
        }
        let moment = Moment {
            person_m: cell.scene.person_m(cell.ahead_m(), place),
            ..moment(&flight, begin_s)
        };
        moments.push(moment);
        measure.take(&moment, flight.truth().collisions);
        if measure.is_over() || moment.time_s > limit_s {
            return Ok((measure.finish(&moments), moments));
        }
    }
}

fn setup(cell: &Cell) -> Result<FlightSetup, String> {
    let world = cell
        .scene
        .world(cell.ahead_m(), cell.incidence_deg, Place::default());
    let shared = [
        ("CP_DELAY", cell.cp_delay_s()),
        ("CP_GUIDE_ANG", cell.guide_deg),
        ("MPC_VEL_MANUAL", full_mps(cell)),
    ];
    let distance_m = |who: Who| if cell.who == who { CP_DIST_M } else { -1.0 };
    let mut params = ParamSet::default();
    let mut autopilot = AutopilotConfig::named("px4_current")
        .ok_or("no such autopilot")?
        .with_parameter("EAV_EN", 1.0)
        .with_parameter("CP_DIST", distance_m(Who::Px4));
    let jinks = shared.into_iter().chain([("CP_DIST", distance_m(Who::Jink))]);
    for (name, value) in jinks {
        params.set(name, value).map_err(|error| error.to_string())?;
    }
    for (name, value) in shared {
        autopilot = autopilot.with_parameter(name, value);
    }
    let vehicle = autopilot.vehicle_mut();
    vehicle.heading_rad = cell.heading_deg.to_radians();
    if cell.variant == Variant::Gusts {
        vehicle.wind = WindConfig {
            mean_mps: [3.0, 0.0, 0.0],
            gust_sigma_mps: 1.5,
            ..WindConfig::default()
        };
    }
    let lidar = SensorSpec {
        range_max_m: Some(cell.variant.range_m()),
        // A driver that is late says so: its scans are stale otherwise before they come.
        delay_ms: (cell.delay_s > 0.0).then_some(cell.delay_s * 1e3),
        ..SensorSpec::new("lidar", SensorKind::Lidar2d)
    };
    Ok(FlightSetup {
        world,
        seed: cell.seed,
        params,
        sensors: vec![lidar],
        autopilot,
        profile: ProfileName::Px4Deviation,
        representation: Representation::default(),
        takes_missions: true,
        link_faults: None,
        plan: FlightPlan {
            takeoff_height_m: HEIGHT_M,
            waypoints: vec![jink_shared_types::Point::new(0.0, 0.0, -HEIGHT_M)],
            tail: Vec::new(),
            in_flight: Vec::new(),
            cruise_speed_mps: None,
            ending: PlanEnding::Hold,
            resume: false,
            mission_limit_s: f64::INFINITY,
        },
        proposer: None,
        planner: None,
    })
}

fn full_mps(cell: &Cell) -> f64 {
    cell.speed_mps.max(SLOWEST_FULL_MPS)
}

/// Takes off, hands over to the pilot, and waits until the vehicle stands.
fn hover(flight: &mut LockStep, sticks: &mut Sticks) -> Result<(), String> {
    let mut still_s = 0.0;
    loop {
        if flight.station().progress().phase >= Phase::Mission {
            // The pilot has it now; the ground station would set its mission.
            flight.silent_station = true;
            sticks.hold(flight);
        }
        flight.step();
        let truth = flight.truth();
        let stands = truth.mode == NavMode::Position && truth.velocity.vector().norm() < HOVER_MPS;
        still_s = if stands { still_s + 0.004 } else { 0.0 };
        if still_s > HOVER_S {
            return Ok(());
        }
        if truth.time_s > READY_S {
            return Err(format!("it does not hover after {READY_S} s"));
        }
    }
}

/// The pilot's hands.
struct Sticks {
    forward: f64,
    right: f64,
    is_pushed: bool,
    next_s: f64,
    mode_due_s: f64,
}

impl Sticks {
    fn new(cell: &Cell) -> Self {
        let share = cell.speed_mps / full_mps(cell);
        let (sin, cos) = cell.heading_deg.to_radians().sin_cos();
        Self {
            forward: deflection(share * cos, cell.who),
            right: deflection(-share * sin, cell.who),
            is_pushed: false,
            next_s: 0.0,
            mode_due_s: 0.0,
        }
    }

    /// Says where they are, as often as a remote control does, and sets Position mode while it is another.
    fn hold(&mut self, flight: &mut LockStep) {
        let truth = *flight.truth();
        if truth.mode.get() != NavMode::Position && truth.time_s >= self.mode_due_s {
            self.mode_due_s = truth.time_s + 0.5;
            if let Some(command) = Make::Px4.mode_command(NavMode::Position, 1) {
                flight.send(command);
            }
        }
        if truth.time_s < self.next_s {
            return;
        }
        self.next_s = truth.time_s + STICKS_PERIOD_S;
        let stick = |share: f64| (1000.0 * share).round() as i16;
        let [x, y] = if self.is_pushed {
            [stick(self.forward), stick(self.right)]
        } else {
            [0, 0]
        };
        flight.send(MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
            x,
            y,
            z: 500,
            target: 1,
            ..MANUAL_CONTROL_DATA::default()
        }));
    }
}

/// How far a stick is to be pushed for a share of the full speed along its axis: jink takes it in proportion beyond a dead zone of a
/// tenth, current PX4 along a curve of six tenths cube.
fn deflection(share: f64, who: Who) -> f64 {
    let wanted = share.abs().min(1.0);
    let stick = if wanted < 1e-6 {
        0.0
    } else if who == Who::Jink {
        0.1 + 0.9 * wanted
    } else {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..40 {
            let middle: f64 = 0.5 * (low + high);
            if 0.4 * middle + 0.6 * middle.powi(3) < wanted {
                low = middle;
            } else {
                high = middle;
            }
        }
        high
    };
    stick.copysign(share)
}

fn moment(flight: &LockStep, begin_s: f64) -> Moment {
    let truth = flight.truth();
    let velocity = truth.velocity.vector();
    let acceleration = flight.autopilot().truth().acceleration.vector();
    let setpoint = flight.prevented().velocity.vector();
    Moment {
        time_s: truth.time_s - begin_s,
        ahead_m: truth.position.x_m,
        right_m: truth.position.y_m,
        velocity_mps: [velocity.x, velocity.y],
        acceleration_mps2: [acceleration.x, acceleration.y],
        // Clearance counts from the hull.
        distance_m: truth.clearance_m + truth.hull_radius_m,
        setpoint_mps: [setpoint.x, setpoint.y],
        person_m: None,
    }
}
