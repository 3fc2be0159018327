//! Whether a sensor's data can be true, checked in flight.
//!
//! | fault | symptom | consequence |
//! |---|---|---|
//! | stuck | the same data to the last bit while the vehicle moves, or for 2.5 s; frames with the same time ([`repeat_check`]) | the frames are not entered, so the sensor expires |
//! | wrong scale, mirrored, wrong mounting | under motion, what the sensor has seen before lies in space that its rays now pass through, and does not after ranges are scaled, left and right exchanged, or the sensor rotated ([`motion_check`]) | an event |
//! | position adrift | none of the sensor: what a credible sensor has seen before lies in space that its rays now pass through, and does not after the later frame is shifted ([`motion_check`]); or the estimated position moves otherwise than the estimated velocity says ([`crate::moving`]) | an event; ranges are not fresh, so the vehicle stops |
//! | wrong rate | frames per second against the sensor's table ([`rate_check`]) | an event |
//!
//! Before arming, ranges are not fresh while any sensor has a fault.
//!
//! Faults that motion cannot show are not found: left and right exchanged while the vehicle only flies straight on, a
//! factor while it only turns, an error of position of some decimetres. Only some frames are checked, and of those only
//! a part of their rays; a search for the fault is spread over frames. Everything is allocated at the start.

mod motion_check;
mod range_image;
mod rate_check;
mod repeat_check;

use crate::poses::{Pose, SweepPoses};
use jink_shared_types::Timestamp;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::faults::{FaultBits, SensorFault, with_fault};
use jink_shared_types::pose_history::PoseHistory;
use jink_shared_types::ranges::{PointCloud, RangeScan};
use motion_check::{FaultCause, MotionCheck};
use nalgebra::UnitQuaternion;
use rate_check::RateCheck;
use repeat_check::{FrameFingerprint, RepeatCheck};
use std::f32::consts::PI;

/// A fault with its numbers, as in its event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorFinding {
    /// Number of the sensor.
    pub sensor: usize,
    /// The fault, or [`SensorFault::Unknown`] when the last one has ended.
    pub fault: SensorFault,
    /// Scale: measured and true metres; mounting: an angle (deg); rate: measured and expected frames per second (Hz).
    pub numbers: [f64; 2],
}

impl SensorFinding {
    /// The event for the pilot about the sensor called `name`.
    pub fn event(&self, name: &str) -> EventSample {
        let event = match self.fault {
            SensorFault::Stuck => &events::SENSOR_STUCK,
            SensorFault::WrongScale => &events::SENSOR_SCALE,
            SensorFault::Mirrored => &events::SENSOR_MIRRORED,
            SensorFault::WrongMounting => &events::SENSOR_MOUNTING,
            SensorFault::WrongRate => &events::SENSOR_RATE,
            SensorFault::Unknown => &events::SENSOR_CREDIBLE,
        };
        EventSample::new(event, name, self.numbers)
    }
}

/// One sensor.
struct SensorHealth {
    repeat: RepeatCheck,
    rate: RateCheck,
    motion: MotionCheck,
    /// The fault last reported.
    reported: SensorFault,
}

impl SensorHealth {
    /// The most severe fault now, and its numbers.
    fn fault(&self) -> (SensorFault, [f64; 2]) {
        if self.repeat.is_stuck() {
            return (SensorFault::Stuck, [0.0; 2]);
        }
        match self.motion.cause() {
            Some(FaultCause::Scale(factor)) => return (SensorFault::WrongScale, shown(factor)),
            Some(FaultCause::Mirrored) => return (SensorFault::Mirrored, [0.0; 2]),
            Some(FaultCause::Turned(angle_deg)) => return (SensorFault::WrongMounting, [angle_deg, 0.0]),
            Some(FaultCause::Unexplained) => return (SensorFault::WrongMounting, [0.0; 2]),
            Some(FaultCause::Adrift) | None => {}
        }
        match self.rate.wrong_hz() {
            Some(rates_hz) => (SensorFault::WrongRate, rates_hz),
            None => (SensorFault::Unknown, [0.0; 2]),
        }
    }
}

/// A factor as measured and true metres, neither below one.
fn shown(factor: f64) -> [f64; 2] {
    if factor < 1.0 {
        [1.0, 1.0 / factor]
    } else {
        [factor, 1.0]
    }
}

/// All sensors.
pub(crate) struct SensorChecks {
    sensors: Vec<SensorHealth>,
}

impl SensorChecks {
    /// For sensors with these rates (Hz); zero where the table does not say.
    pub fn new(rates_hz: &[f64]) -> Self {
        let sensors = rates_hz.iter().map(|rate_hz| SensorHealth {
            repeat: RepeatCheck::default(),
            rate: RateCheck::new(*rate_hz),
            motion: MotionCheck::new(),
            reported: SensorFault::Unknown,
        });
        Self {
            sensors: sensors.collect(),
        }
    }

    /// Earlier poses belong to another local frame now.
    pub fn forget_poses(&mut self) {
        for sensor in &mut self.sensors {
            sensor.motion.clear();
            sensor.repeat.forget_pose();
        }
    }

    /// A frame of `sensor` was captured at `capture`, no later than the one captured at `newest`.
    pub fn late(&mut self, sensor: usize, capture: Timestamp, newest: Timestamp) {
        if let Some(sensor) = self.sensors.get_mut(sensor).filter(|_| capture == newest) {
            sensor.repeat.count_same_time();
        }
    }

    /// Records a cloud; whether it may be entered.
    pub fn accepts_cloud(
        &mut self,
        sensor: usize,
        cloud: &PointCloud,
        capture: Timestamp,
        pose: Option<Pose>,
    ) -> bool {
        self.sensors.get_mut(sensor).is_some_and(|sensor| {
            sensor.rate.take(capture, false);
            sensor
                .repeat
                .accepts(FrameFingerprint::of_cloud(cloud), capture, pose)
        })
    }

    /// Records a scan; whether it may be entered.
    pub fn accepts_scan(
        &mut self,
        sensor: usize,
        scan: &RangeScan,
        capture: Timestamp,
        pose: Option<Pose>,
    ) -> bool {
        self.sensors.get_mut(sensor).is_some_and(|sensor| {
            let turned_rad = scan.beams as f32 * scan.angle_step_rad.abs();
            sensor.rate.take(capture, scan.beams > 1 && turned_rad < PI);
            sensor
                .repeat
                .accepts(FrameFingerprint::of_scan(scan), capture, pose)
        })
    }

    /// Takes a cloud to compare it with an earlier one, if the vehicle has moved enough.
    pub fn cloud(
        &mut self,
        sensor: usize,
        cloud: &PointCloud,
        capture: Timestamp,
        sweep: &mut SweepPoses,
        history: &PoseHistory,
    ) {
        if let Some((motion, pose)) = self.due(sensor, capture, history) {
            motion.cloud(cloud, (pose, capture), sweep, history);
        }
    }

    /// The same for a scan of many beams whose mounting is `body_q_sensor`.
    pub fn scan(
        &mut self,
        sensor: usize,
        scan: &RangeScan,
        body_q_sensor: &UnitQuaternion<f64>,
        capture: Timestamp,
        sweep: &mut SweepPoses,
        history: &PoseHistory,
    ) {
        if let Some((motion, pose)) = self.due(sensor, capture, history) {
            motion.scan(scan, body_q_sensor, (pose, capture), sweep, history);
        }
    }

    /// The motion check of a sensor, and the pose at `capture`, if a frame of that time is to be compared.
    fn due(
        &mut self,
        sensor: usize,
        capture: Timestamp,
        history: &PoseHistory,
    ) -> Option<(&mut MotionCheck, Pose)> {
        let pose = history.at(capture).map(Pose::from)?;
        let motion = &mut self.sensors.get_mut(sensor)?.motion;
        motion.on_frame(&pose, capture).then_some((motion, pose))
    }

    /// Faults of all sensors.
    pub fn bits(&self) -> FaultBits {
        let sensors = self.sensors.iter().enumerate();
        sensors.fold(FaultBits::default(), |bits, (number, sensor)| {
            with_fault(bits, number, sensor.fault().0)
        })
    }

    /// Whether any sensor has a fault.
    pub fn is_any_wrong(&self) -> bool {
        self.sensors
            .iter()
            .any(|sensor| sensor.fault().0 != SensorFault::Unknown)
    }

    /// A sensor by which the vehicle moves otherwise than its estimated position.
    pub fn adrift(&self) -> Option<usize> {
        self.sensors.iter().position(|sensor| sensor.motion.is_adrift())
    }

    /// Compares the frames that have come since the last call.
    pub fn compare_pending(&mut self) {
        for sensor in &mut self.sensors {
            sensor.motion.compare_pending();
        }
    }

    /// The next change of a sensor's fault that was not yet reported.
    pub fn next_change(&mut self) -> Option<SensorFinding> {
        self.sensors.iter_mut().enumerate().find_map(|(number, sensor)| {
            let (fault, numbers) = sensor.fault();
            (fault != sensor.reported).then(|| {
                sensor.reported = fault;
                SensorFinding {
                    sensor: number,
                    fault,
                    numbers,
                }
            })
        })
    }
}
