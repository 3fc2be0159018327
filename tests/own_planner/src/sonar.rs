//! A sensor as somebody else would write it: a sonar that looks down, with a topic and a parameter of its own.
//!
//! There is no device behind it: it says what a sonar over level ground at the height of home would say.

use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, Wake};
use jink_shared_types::frames::{Mounting, unit_quaternion};
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::RangeScan;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use std::f64::consts::FRAC_1_SQRT_2;

jink_shared_types::sample! {
    /// What the sonar received.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Echo: 16 {
        /// Where the echo came from (m).
        pub range_m: f64,
        /// Its strength, 0 to 1.
        pub strength: f64,
    }
}

/// Soundings per second.
const RATE_HZ: u32 = 20;
/// Full opening angle of the beam (rad).
const BEAM_WIDTH_RAD: f32 = 0.4;

/// It looks down: turned by -90 degrees about the axis to the right.
const DOWN: [f64; 4] = [FRAC_1_SQRT_2, 0.0, -FRAC_1_SQRT_2, 0.0];

struct Sonar {
    state: Input<VehicleState>,
    scans: Output<RangeScan>,
    echoes: Output<Echo>,
    reach_m: f64,
    scan: RangeScan,
}

fn reach_m(params: &ParamSet) -> f64 {
    params.named("USR_SONAR_MAX").unwrap_or(5.0)
}

impl Service for Sonar {
    const PROGRAM: &'static str = "own_sonar";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            state: ports.input(topics::VEHICLE_STATE)?,
            scans: ports.range_output(topics::RANGE_SCAN, "sonar", RATE_HZ.into())?,
            echoes: ports.user_output("user/echo")?,
            reach_m: reach_m(&ports.config().params),
            scan: RangeScan {
                mounting: unit_quaternion(DOWN)
                    .map(Mounting::from_rotation)
                    .unwrap_or_default(),
                beam_width_rad: BEAM_WIDTH_RAD,
                range_min_m: 0.2,
                range_sigma_m: 0.05,
                beams: 1,
                ..RangeScan::default()
            },
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        if let Some(state) = self.state.latest(cycle.now).fresh() {
            let range_m = (-state.position.z_m).max(0.2);
            self.sound(cycle.now, range_m);
        }
        Wake::at(cycle.now.next_beat(RATE_HZ))
    }

    fn on_params_changed(&mut self, params: &ParamSet) {
        self.reach_m = reach_m(params);
    }
}

impl Sonar {
    fn sound(&mut self, now: Timestamp, range_m: f64) {
        let is_received = range_m <= self.reach_m;
        self.scan.first_beam = now;
        self.scan.range_max_m = self.reach_m as f32;
        self.scan.range_m[0] = if is_received {
            range_m as f32
        } else {
            f32::INFINITY
        };
        let header = SampleHeader {
            capture: now,
            ..SampleHeader::default()
        };
        self.scans.send(header.derived(Stage::Sensor, now), &self.scan);
        let strength = if is_received {
            1.0 - range_m / self.reach_m
        } else {
            0.0
        };
        self.echoes.send(header, &Echo { range_m, strength });
    }
}

fn main() -> std::process::ExitCode {
    jink_runtime::run::<Sonar>()
}
