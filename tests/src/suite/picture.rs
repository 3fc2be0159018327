//! A flight of a campaign as a picture: the true course in the true world.

use crate::lockstep::LockStep;
use jink_lab::flight_log::CoursePoint;
use jink_lab::picture::{Scene, World as Drawn, svg};
use jink_simulated_world::world::World;

/// Steps of a flight (4 ms) between two points of the course.
const POINT_EVERY: u64 = 25;

/// The course so far.
#[derive(Clone, Debug, Default)]
pub struct Course {
    points: Vec<CoursePoint>,
    steps: u64,
}

impl Course {
    /// After a step of a flight.
    pub fn look(&mut self, flight: &LockStep) {
        if self.steps.is_multiple_of(POINT_EVERY) {
            let truth = flight.truth();
            self.points.push(CoursePoint {
                north_m: truth.position.x_m,
                east_m: truth.position.y_m,
                up_m: -truth.position.z_m,
                speed_mps: truth.velocity.vector().norm(),
                time_s: truth.time_s,
                clearance_m: truth.clearance_m,
            });
        }
        self.steps += 1;
    }

    /// The picture.
    ///
    /// # Errors
    /// A text, if the world cannot be drawn.
    pub fn svg(&self, world: &World, title: &str) -> Result<String, String> {
        let drawn: Drawn = serde_json::from_value(world.json()).map_err(|error| error.to_string())?;
        Ok(svg(&Scene {
            world: &drawn,
            course: &self.points,
            faults: &[],
            title,
        }))
    }
}
