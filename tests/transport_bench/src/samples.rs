//! The samples of the chain, of the types that jink's topics have.

use jink_shared_types::Timestamp;
use jink_shared_types::coded::Coded;
use jink_shared_types::layout::Layout;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{
    ApprovedTrajectory, BezierPiece, Route, TRAJECTORY_PIECES, Trajectory, TrajectoryMode, Verdict,
};
use jink_shared_types::ranges::{CLOUD_POINTS, CloudPoint, PointCloud, RayKind};
use std::mem::offset_of;

/// A sample that a stage makes without computing anything.
pub trait Sample: Layout + Sized {
    /// How much of its memory is written and read, of a cloud with `points` points (bytes).
    fn used(_points: u32) -> usize {
        size_of::<Self>()
    }

    /// Writes all of it that is used; what a reader looks at before it takes a sample is plausible.
    fn fill(&mut self, mark: u64, points: u32);
}

impl Sample for PointCloud {
    fn used(points: u32) -> usize {
        offset_of!(Self, points) + (points as usize).min(CLOUD_POINTS) * size_of::<CloudPoint>()
    }

    fn fill(&mut self, mark: u64, points: u32) {
        self.first_point = Timestamp::from_ns(mark);
        self.range_min_m = 0.1;
        self.range_max_m = 20.0;
        self.range_sigma_m = 0.02;
        self.len = points.min(CLOUD_POINTS as u32);
        self.points[..self.len as usize].fill(CloudPoint {
            forward_m: 1.0,
            right_m: 2.0,
            down_m: 3.0,
            offset_10us: mark as u16,
            kind: Coded::new(RayKind::Hit),
            ..CloudPoint::default()
        });
    }
}

impl Sample for LocalMap {
    fn fill(&mut self, mark: u64, _points: u32) {
        self.cell_m = jink_shared_types::map::CELL_M;
        self.occupied_cells = 0;
        self.known_cells = 0;
        for plane in [&mut self.occupied, &mut self.known, &mut self.declared] {
            plane.fill([mark; 2]);
        }
    }
}

impl Sample for Route {
    fn fill(&mut self, mark: u64, _points: u32) {
        *self = Self {
            id: mark,
            ..Self::default()
        };
    }
}

/// As many pieces as there is room for, since each of them is looked at.
fn trajectory(mark: u64) -> Trajectory {
    let piece = BezierPiece {
        duration_s: 1.0,
        ..BezierPiece::default()
    };
    Trajectory {
        id: mark,
        start: Timestamp::from_ns(mark),
        mode: Coded::new(TrajectoryMode::Plan),
        len: TRAJECTORY_PIECES as u32,
        pieces: [piece; TRAJECTORY_PIECES],
        ..Trajectory::default()
    }
}

impl Sample for Trajectory {
    fn fill(&mut self, mark: u64, _points: u32) {
        *self = trajectory(mark);
    }
}

impl Sample for ApprovedTrajectory {
    fn fill(&mut self, mark: u64, _points: u32) {
        *self = Self {
            trajectory: trajectory(mark),
            verdict: Coded::new(Verdict::Passed),
            ..Self::default()
        };
    }
}

/// Size of the message of each hop (bytes): as much as jink writes into the sample of its topic.
pub fn bytes(points: u32) -> [usize; 5] {
    [
        PointCloud::used(points),
        LocalMap::used(points),
        Route::used(points),
        Trajectory::used(points),
        ApprovedTrajectory::used(points),
    ]
}

#[cfg(test)]
mod tests {
    use super::{Sample, bytes};
    use jink_shared_types::map::LocalMap;
    use jink_shared_types::motion::{ApprovedTrajectory, Route, Trajectory};
    use jink_shared_types::ranges::PointCloud;
    use jink_shared_types::sample::zeroed_box;

    fn assert_plausible<T: Sample>() {
        let mut sample: Box<T> = zeroed_box();
        sample.fill(7, 20_000);
        assert!(sample.is_plausible(), "{sample:?}");
        assert_eq!(T::used(20_000) % 8, 0);
    }

    #[test]
    fn what_is_sent_would_be_taken() {
        assert_plausible::<PointCloud>();
        assert_plausible::<LocalMap>();
        assert_plausible::<Route>();
        assert_plausible::<Trajectory>();
        assert_plausible::<ApprovedTrajectory>();
        assert_eq!(bytes(20_000)[0], 320_064);
    }
}
