//! Where obstacles that move are going to be: upright cylinders along straight lines that widen with the uncertainty of
//! their tracks.
//!
//! What moves keeps its velocity, as far as is known; people turn. So no promise follows from this for the certificate,
//! whose obstacles stand still: it is the best estimate, renewed with every frame.

use jink_shared_types::motion::Trajectory;
use jink_shared_types::moving::{MOVING_OBSTACLES, MovingObstacle, MovingObstacles};
use jink_shared_types::{Stamped, Timestamp};
use nalgebra::Vector3;

/// How far ahead is predicted (s): by then a person has turned or not.
pub(crate) const HORIZON_S: f64 = 3.0;
/// What comes by then has to be evaded for so long (s): it has passed.
pub(crate) const EVADED_S: f64 = HORIZON_S + 1.0;
/// Time between two checked moments (s): at a closing speed of 5 m/s half a metre, a person's width.
const STEP_S: f64 = 0.1;
/// Most widening for the uncertainty of a track (m).
const UNCERTAIN_MAX_M: f64 = 0.5;

/// What moves, as of one moment.
#[derive(Debug)]
pub(crate) struct Predictions {
    captured: Timestamp,
    obstacles: Vec<MovingObstacle>,
}

/// Where an obstacle is at a moment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PredictedCylinder {
    /// Its centre (local, m).
    pub centre_m: Vector3<f64>,
    /// Its radius, widened (m).
    pub radius_m: f64,
    /// Half of its height (m).
    pub half_height_m: f64,
}

impl PredictedCylinder {
    fn of(obstacle: &MovingObstacle, seconds: f64) -> Self {
        Self {
            centre_m: obstacle.after(seconds),
            radius_m: obstacle.radius_m + obstacle.sd_after_m(seconds).min(UNCERTAIN_MAX_M),
            half_height_m: obstacle.half_height_m,
        }
    }

    /// Distance of `place` (local, m) from its surface, to the side; infinite `above_m` or more above or below it.
    fn distance_m(&self, place: &Vector3<f64>, above_m: f64) -> f64 {
        if (place.z - self.centre_m.z).abs() > self.half_height_m + above_m {
            return f64::INFINITY;
        }
        (place - self.centre_m).xy().norm() - self.radius_m
    }
}

impl Predictions {
    pub fn new() -> Self {
        Self {
            captured: Timestamp::NEVER,
            obstacles: Vec::with_capacity(MOVING_OBSTACLES),
        }
    }

    /// Takes what moves; nothing does as long as that is not known.
    pub fn load(&mut self, moving: Option<Stamped<'_, MovingObstacles>>) {
        self.obstacles.clear();
        if let Some(moving) = moving {
            self.captured = moving.header.capture;
            self.obstacles.extend_from_slice(moving.obstacles());
        }
    }

    /// When it was seen.
    pub fn captured(&self) -> Timestamp {
        self.captured
    }

    /// Whether nothing moves.
    pub fn is_empty(&self) -> bool {
        self.obstacles.is_empty()
    }

    /// Where everything is at `time`.
    pub fn at(&self, time: Timestamp) -> impl Iterator<Item = PredictedCylinder> {
        let seconds = time.seconds_since(self.captured).max(0.0);
        self.obstacles
            .iter()
            .map(move |obstacle| PredictedCylinder::of(obstacle, seconds))
    }

    /// Distance of a vehicle that is at `place` (local, m) at `time` from the surface of the nearest (m); infinite for
    /// those that stay `above_m` or more above or below it.
    fn distance_m(&self, time: Timestamp, place: &Vector3<f64>, above_m: f64) -> f64 {
        let distances = self.at(time).map(|cylinder| cylinder.distance_m(place, above_m));
        distances.fold(f64::INFINITY, f64::min)
    }

    /// The smallest such distance (m) of a vehicle that moves as `place_at` says (seconds from `now`, local m), until
    /// `until_s`, at most [`EVADED_S`].
    pub fn nearest_m(
        &self,
        now: Timestamp,
        until_s: f64,
        above_m: f64,
        place_at: impl Fn(f64) -> Vector3<f64>,
    ) -> f64 {
        if self.is_empty() {
            return f64::INFINITY;
        }
        let steps = (until_s.clamp(0.0, EVADED_S) / STEP_S).ceil() as u32;
        let distances = (0..=steps).map(|step| {
            let ahead_s = f64::from(step) * STEP_S;
            self.distance_m(now.plus_seconds(ahead_s), &place_at(ahead_s), above_m)
        });
        distances.fold(f64::INFINITY, f64::min)
    }

    /// The same of a vehicle that follows `trajectory` to its end.
    pub fn nearest_along_m(&self, now: Timestamp, trajectory: &Trajectory, above_m: f64) -> f64 {
        let until_s = trajectory.end().seconds_since(now);
        if until_s <= 0.0 {
            return f64::INFINITY;
        }
        let rest = trajectory.end();
        self.nearest_m(now, until_s.min(HORIZON_S), above_m, |ahead_s| {
            let at = trajectory.at(now.plus_seconds(ahead_s).min(rest));
            at.map_or(Vector3::repeat(f64::MAX), |state| state.position.vector())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Predictions;
    use jink_shared_types::frames::{Point, Velocity};
    use jink_shared_types::moving::{MovingObstacle, MovingObstacles};
    use jink_shared_types::{SampleHeader, Stamped, Timestamp};
    use nalgebra::Vector3;

    #[test]
    fn a_crossing_is_a_conflict_of_time_not_only_of_place() {
        let mut moving = MovingObstacles::default();
        moving.push(MovingObstacle {
            position: Point::new(4.0, -3.0, -2.0),
            velocity: Velocity::new(0.0, 1.5, 0.0),
            radius_m: 0.3,
            half_height_m: 1.0,
            ..MovingObstacle::default()
        });
        let now = Timestamp::from_seconds(50.0);
        let header = SampleHeader::at(now);
        let mut predictions = Predictions::new();
        predictions.load(Some(Stamped {
            header: &header,
            sample: &moving,
        }));
        let at_mps = |speed_mps: f64| {
            predictions.nearest_m(now, 3.0, 0.5, |ahead_s| {
                Vector3::new(speed_mps * ahead_s, 0.0, -2.0)
            })
        };
        assert!(at_mps(2.0) < 0.0, "both are there after two seconds");
        assert!(at_mps(4.0) > 1.0, "it has passed before");
        assert!(at_mps(0.5) > 1.0, "the other one has passed before");
        let above_m = predictions.nearest_m(now, 3.0, 0.5, |ahead_s| Vector3::new(2.0 * ahead_s, 0.0, -4.0));
        assert!(above_m.is_infinite());
        predictions.load(None);
        assert!(predictions.is_empty());
    }
}
