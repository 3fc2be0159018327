//! Flying a mission: which item, how it is begun, when it is reached.

use super::input::NavigatorInput;
use super::work::{HeightPatience, Work};
use super::{Navigator, NavigatorEvents};
use crate::parameters::Parameter as P;
use crate::setpoint::{CurrentPoint, NextPoint, PointKind};
use jink_emulated_autopilot::mission::{Task, place_of, single};
use jink_shared_types::frames::wrap_pi;
use nalgebra::Vector3;

/// By how much the height acceptance then exceeds the height error (m).
const HEIGHT_RELAXATION_M: f64 = 0.5;

impl Navigator {
    /// Works off items that lead nowhere and makes the next that does the current waypoint.
    pub(super) fn start_item(&mut self, input: &NavigatorInput, events: &mut NavigatorEvents) {
        self.stayed_s = 0.0;
        self.height = HeightPatience::default();
        let mut found = self.jumps.follow(input.mission, self.item);
        // Speeds in a circle of jumps lead nowhere.
        for _ in 0..input.mission.len() {
            match found.and_then(|index| input.mission.task(index)) {
                Some(Task::Speed(speed_mps)) => {
                    self.set_speed(speed_mps);
                    found = found.and_then(|index| self.jumps.follow(input.mission, index + 1));
                }
                Some(Task::Return) => {
                    events.wants_return = true;
                    break;
                }
                _ => break,
            }
        }
        let Some(index) = found else {
            self.finish(input, events);
            return;
        };
        self.item = index;
        if events.wants_return {
            return;
        }
        self.work = self.first_work(index, input);
        self.fly_item(input);
    }

    fn first_work(&self, index: usize, input: &NavigatorInput) -> Work {
        let Some(item) = input.mission.get(index) else {
            return Work::Item;
        };
        let place = place_of(item, input.frame);
        let here = input.estimate.position;
        let task = input.mission.task(index);
        if input.landed && task != Some(Task::Land) {
            let least_down = input.home.z - input.parameters.get(P::MIS_TAKEOFF_ALT);
            return Work::Climb(place.z.min(least_down));
        }
        let far = (place.xy() - here.vector().xy()).norm() > input.parameters.get(P::NAV_ACC_RAD);
        if task == Some(Task::Land) && far {
            return Work::ApproachLanding;
        }
        Work::Item
    }

    fn fly_item(&mut self, input: &NavigatorInput) {
        let (Some(item), Some(task)) = (input.mission.get(self.item), input.mission.task(self.item)) else {
            return;
        };
        let place = place_of(item, input.frame);
        let here = single(input.estimate.position.vector());
        let (kind, position) = match (self.work, task) {
            (Work::Climb(down), _) => (PointKind::Takeoff, single(Vector3::new(here.x, here.y, down))),
            (Work::ApproachLanding, _) => {
                let level = Vector3::new(place.x, place.y, here.z);
                (PointKind::Position, level)
            }
            (Work::Item, Task::Land) => (PointKind::Land, place),
            (Work::Item, Task::LoiterForever) => (PointKind::Loiter, place),
            (Work::Item, _) => (PointKind::Position, place),
        };
        let mut point = self.point(input, kind, position);
        if self.work == Work::Item {
            point.yaw_rad = f64::from(item.param4).to_radians();
        }
        if let Task::Waypoint { acceptance_m, .. } = task
            && acceptance_m > 0.0
        {
            point.acceptance_m = acceptance_m;
        }
        self.may_loiter_at_point = kind == PointKind::Loiter;
        self.go_to(point);
        self.triplet.next = self.next_point(task, place, input);
    }

    fn next_point(&self, task: Task, place: Vector3<f64>, input: &NavigatorInput) -> Option<NextPoint> {
        if self.work != Work::Item {
            let item = input.mission.get(self.item)?;
            let yaw_rad = f64::from(item.param4).to_radians();
            return Some(NextPoint {
                position: place,
                yaw_rad,
            });
        }
        match task {
            Task::Waypoint { hold_s, .. } if hold_s > 0.0 => None,
            Task::LoiterForever | Task::Land => None,
            _ => {
                let item = input.mission.get(input.mission.next_place(self.item + 1)?)?;
                Some(NextPoint {
                    position: place_of(item, input.frame),
                    yaw_rad: f64::from(item.param4).to_radians(),
                })
            }
        }
    }

    pub(super) fn run_mission(&mut self, input: &NavigatorInput, events: &mut NavigatorEvents) {
        if self.finished || events.wants_return {
            return;
        }
        let (Some(task), Some(current)) = (input.mission.task(self.item), self.triplet.current) else {
            return;
        };
        if self.work == Work::Item && task == Task::Land {
            if input.landed {
                events.reached = Some(self.item);
                self.finished = true;
                events.mission_finished = true;
            }
            return;
        }
        if !self.is_reached(&current, input) {
            self.stayed_s = 0.0;
            return;
        }
        if self.work != Work::Item {
            self.work = Work::Item;
            self.height = HeightPatience::default();
            self.fly_item(input);
            return;
        }
        self.stayed_s += input.dt_s;
        let done = match task {
            Task::Waypoint { hold_s, .. } => self.stayed_s >= hold_s,
            Task::LoiterForever => false,
            _ => true,
        };
        if done {
            events.reached = Some(self.item);
            self.item += 1;
            self.start_item(input, events);
        }
    }

    fn is_reached(&mut self, current: &CurrentPoint, input: &NavigatorInput) -> bool {
        let away = current.position - input.estimate.position.vector();
        let mut height_acceptance_m = input.parameters.get(P::NAV_MC_ALT_RAD);
        if matches!(self.work, Work::Climb(_)) {
            return !input.landed && away.z > -height_acceptance_m;
        }
        let near = away.xy().norm() <= current.acceptance_m;
        let avoiding = input.parameters.avoidance_enabled();
        if near && avoiding && self.height.is_exhausted(away.z.abs(), input.dt_s) {
            height_acceptance_m = height_acceptance_m.max(away.z.abs() + HEIGHT_RELAXATION_M);
        }
        let yaw_error_rad = wrap_pi(current.yaw_rad - input.estimate.attitude.yaw_rad()).abs();
        let heading_ok = avoiding
            || !current.yaw_rad.is_finite()
            || yaw_error_rad < input.parameters.radians(P::MIS_YAW_ERR);
        near && away.z.abs() <= height_acceptance_m && heading_ok
    }

    /// Nothing left: stay at the last waypoint.
    fn finish(&mut self, input: &NavigatorInput, events: &mut NavigatorEvents) {
        self.finished = true;
        self.item = input.mission.len().saturating_sub(1);
        self.may_loiter_at_point = true;
        self.speed_mps = -1.0;
        let place = self
            .triplet
            .current
            .map_or(single(input.estimate.position.vector()), |c| c.position);
        self.go_to(self.point(input, PointKind::Loiter, place));
        events.mission_finished = true;
    }
}
