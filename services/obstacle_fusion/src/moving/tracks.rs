//! Tracks: groups of hits followed from frame to frame.
//!
//! Each axis is filtered on its own, with a constant velocity and white acceleration (Y. Bar-Shalom, X. Li and T.
//! Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 6.3.2). The centre of a group jumps by parts of a cell, and shows only the side that the sensor sees: both last for
//! several frames, so that the noise assumed is larger than that of one frame.

use super::clusters::Group;
use jink_shared_types::Timestamp;
use jink_shared_types::frames::{Point, Velocity};
use jink_shared_types::map::CELL_M;
use jink_shared_types::moving::{MOVING_OBSTACLES, MovingObstacle, MovingObstacles};
use nalgebra::Vector3;

/// Noise of a group's centre on an axis (m, one standard deviation).
const CENTRE_SD_M: f64 = 0.15;
/// Accelerations of what moves (m/s2, one standard deviation): a walking person turns within a step.
const ACCELERATION_SD_MPS2: f64 = 1.5;
/// Speed of something that has just been seen (m/s, one standard deviation).
const FIRST_SD_MPS: f64 = 2.0;
/// A group belongs to a track if it is no farther from where that should be than this (m), and the uncertainty allows.
const GATE_M: f64 = 0.6;
/// The same in standard deviations.
const GATE_SD: f64 = 3.0;
/// A track that was not seen for this long is given up (s): a second person hides one for about that.
const LOST_S: f64 = 0.7;
/// A track moves when it was seen in so many frames ...
const FRAMES_MIN: u32 = 4;
/// ... over so long (s), which is four frames at 30 Hz: several cameras make as many in less ...
const AGE_MIN_S: f64 = 0.13;
/// ... has moved by this (m) ...
const MOVED_M: f64 = 0.3;
/// ... and its speed is at least this (m/s) ...
const MOVING_MPS: f64 = 0.35;
/// ... and so many times its uncertainty.
const MOVING_SD: f64 = 2.0;
/// ... while its groups were where it expected them, but for this on an axis (m, root mean square): what noise puts along
/// the ground and round trunks jumps.
const EXPECTED_M: f64 = 0.25;
/// Share of the newest frame in that mean.
const NEWEST: f64 = 0.25;
/// A track that moved, does so as long as it is faster than this (m/s).
const STILL_MOVING_MPS: f64 = 0.2;
/// What is no higher than this (m, half of it) ...
const FLAT_M: f64 = 0.25;
/// ... and lower than the vehicle by this (m) is the ground, whose hits run along with the vehicle. Who walks is higher, and
/// what is flat and may meet the vehicle is nearer to its height than that.
const BELOW_M: f64 = 0.8;
/// What is higher than this (m, half of it) stands on the ground.
const UPRIGHT_M: f64 = 0.6;
/// How soon a size follows one that is seen smaller: the share of the difference per frame. Larger ones count at once
/// by half.
const SHRINK: f64 = 0.05;
/// The attitude of an autopilot may be so late (s): what is seen while the vehicle turns is displaced by that much of the turn ...
const LATE_S: f64 = 0.03;
/// ... and, by more than this (m), may lie in open space although it stands beside it: a cell beside an obstacle is never open, and noise
/// takes half of it.
const DISPLACED_M: f64 = 0.5 * CELL_M;
/// Most tracks.
const TRACKS_MAX: usize = 2 * MOVING_OBSTACLES;

/// Position and velocity on an axis, and their covariance.
#[derive(Clone, Copy, Debug)]
struct Axis {
    position_m: f64,
    velocity_mps: f64,
    /// Of position, of position with velocity, of velocity.
    covariance: [f64; 3],
}

impl Axis {
    fn new(position_m: f64) -> Self {
        Self {
            position_m,
            velocity_mps: 0.0,
            covariance: [CENTRE_SD_M.powi(2), 0.0, FIRST_SD_MPS.powi(2)],
        }
    }

    fn predict(&mut self, passed_s: f64) {
        let [pp, pv, vv] = self.covariance;
        let q = ACCELERATION_SD_MPS2.powi(2);
        let t = passed_s;
        self.position_m += self.velocity_mps * t;
        self.covariance = [
            pp + 2.0 * t * pv + t * t * vv + 0.25 * t.powi(4) * q,
            pv + t * vv + 0.5 * t.powi(3) * q,
            vv + t * t * q,
        ];
    }

    fn correct(&mut self, position_m: f64) {
        let [pp, pv, vv] = self.covariance;
        let innovation_m = position_m - self.position_m;
        let variance = pp + CENTRE_SD_M.powi(2);
        let (gain, gain_v) = (pp / variance, pv / variance);
        self.position_m += gain * innovation_m;
        self.velocity_mps += gain_v * innovation_m;
        self.covariance = [(1.0 - gain) * pp, (1.0 - gain) * pv, vv - gain_v * pv];
    }
}

/// A group followed over frames.
#[derive(Clone, Copy, Debug)]
struct Track {
    id: u32,
    axes: [Axis; 3],
    radius_m: f64,
    half_height_m: f64,
    first_m: Vector3<f64>,
    /// How far the estimated position had slipped by then (m).
    first_slipped_m: Vector3<f64>,
    first_radius_m: f64,
    first_seen: Timestamp,
    seen: Timestamp,
    frames: u32,
    /// Mean square of how far its groups were from where it expected them, on an axis (m2).
    unexpected_m2: f64,
    moves: bool,
    is_matched: bool,
}

impl Track {
    fn new(id: u32, now: Timestamp, group: &Group, slipped_m: &Vector3<f64>) -> Self {
        Self {
            id,
            axes: [0, 1, 2].map(|axis| Axis::new(group.centre_m[axis])),
            radius_m: group.radius_m,
            half_height_m: group.half_height_m,
            first_m: group.centre_m,
            first_slipped_m: *slipped_m,
            first_radius_m: group.radius_m,
            first_seen: now,
            seen: now,
            frames: 1,
            unexpected_m2: 0.0,
            moves: false,
            is_matched: true,
        }
    }

    fn position_m(&self) -> Vector3<f64> {
        Vector3::from(self.axes.map(|axis| axis.position_m))
    }

    fn velocity_mps(&self) -> Vector3<f64> {
        Vector3::from(self.axes.map(|axis| axis.velocity_mps))
    }

    /// Horizontal distance to `group` (m), if it may be this one's.
    fn distance_m(&self, group: &Group) -> Option<f64> {
        let away_m = (group.centre_m - self.position_m()).xy().norm();
        let sd_m = self.axes[0].covariance[0].sqrt();
        (away_m <= GATE_M + GATE_SD * sd_m).then_some(away_m)
    }

    fn correct(&mut self, now: Timestamp, group: &Group, slipped_m: &Vector3<f64>) {
        let unexpected_m2 = 0.5 * (group.centre_m - self.position_m()).xy().norm_squared();
        // Of the first frames, in which it has no velocity yet, nothing is expected.
        if self.frames >= FRAMES_MIN {
            self.unexpected_m2 += NEWEST * (unexpected_m2 - self.unexpected_m2);
        }
        for (axis, place_m) in self.axes.iter_mut().zip(group.centre_m.iter()) {
            axis.correct(*place_m);
        }
        for (size, seen) in [
            (&mut self.radius_m, group.radius_m),
            (&mut self.half_height_m, group.half_height_m),
        ] {
            *size += (seen - *size) * if seen > *size { 0.5 } else { SHRINK };
        }
        // Who stands on the ground does not rise: more of him comes into view.
        if self.half_height_m >= UPRIGHT_M {
            self.axes[2].velocity_mps = 0.0;
        }
        self.seen = now;
        self.frames += 1;
        let speed_mps = self.velocity_mps().xy().norm();
        // What stands still moves as the estimated position slips, and what of it lies where nothing was changes with that.
        let way_m = (self.position_m() - self.first_m).xy();
        let slipped_m = (slipped_m - self.first_slipped_m).xy();
        let moved_m = way_m.norm().min((way_m - slipped_m).norm()) - 0.5 * slipped_m.norm();
        // What comes into view grows, and its centre moves with that.
        let grown_m = (self.radius_m - self.first_radius_m).abs();
        let certain_mps = MOVING_SD * self.axes[0].covariance[2].sqrt();
        self.moves = if self.moves {
            speed_mps >= STILL_MOVING_MPS
        } else {
            self.frames >= FRAMES_MIN
                && now.seconds_since(self.first_seen) >= AGE_MIN_S
                && self.unexpected_m2 <= EXPECTED_M.powi(2)
                && moved_m >= MOVED_M + grown_m
                && speed_mps >= MOVING_MPS.max(certain_mps)
        };
    }

    fn report(&self) -> MovingObstacle {
        let [position, _, velocity] = self.axes[0].covariance;
        MovingObstacle {
            position: Point::from_vector(self.position_m()),
            velocity: Velocity::from_vector(self.velocity_mps()),
            radius_m: self.radius_m,
            half_height_m: self.half_height_m,
            position_sd_m: position.sqrt(),
            velocity_sd_mps: velocity.sqrt(),
            id: self.id,
            frames: self.frames,
        }
    }
}

/// From where, and in what turn, groups are seen.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Viewpoint {
    pub place_m: Vector3<f64>,
    pub turning_radps: f64,
}

impl Viewpoint {
    /// Whether `group` is where it seems to be: one that is not may be a part of what stands still, and only continues a track that
    /// moves.
    fn is_steady(&self, group: &Group) -> bool {
        let away_m = (group.centre_m - self.place_m).norm();
        LATE_S * self.turning_radps * away_m <= DISPLACED_M
    }
}

/// All tracks.
pub(crate) struct Tracks {
    tracks: Vec<Track>,
    last_id: u32,
    /// Time of the newest frame.
    now: Timestamp,
    /// Distance, track and group of the pairs that may belong together.
    pairs: Vec<(f64, usize, usize)>,
    used: Vec<bool>,
    order: Vec<(f64, usize)>,
}

impl Tracks {
    pub fn new() -> Self {
        Self {
            tracks: Vec::with_capacity(TRACKS_MAX),
            last_id: 0,
            now: Timestamp::NEVER,
            pairs: Vec::with_capacity(TRACKS_MAX * TRACKS_MAX),
            used: Vec::with_capacity(TRACKS_MAX),
            order: Vec::with_capacity(TRACKS_MAX),
        }
    }

    pub fn clear(&mut self) {
        self.tracks.clear();
        self.now = Timestamp::NEVER;
    }

    /// Takes the groups of a frame captured at `capture`, when the estimated position has slipped by `slipped_m` so far, seen from
    /// `viewpoint`: the track and group first.
    pub fn update(
        &mut self,
        capture: Timestamp,
        groups: &[Group],
        slipped_m: &Vector3<f64>,
        viewpoint: &Viewpoint,
    ) {
        let groups = &groups[..groups.len().min(TRACKS_MAX)];
        let passed_s = if self.now.is_set() {
            capture.seconds_since(self.now)
        } else {
            0.0
        };
        // A frame may come a little late; a clock that went back begins anew.
        let is_late = (-LOST_S..=0.0).contains(&passed_s);
        if passed_s < -LOST_S {
            self.tracks.clear();
        }
        if !is_late || !self.now.is_set() {
            self.now = capture;
        }
        let now = self.now;
        for track in &mut self.tracks {
            track
                .axes
                .iter_mut()
                .for_each(|axis| axis.predict(passed_s.max(0.0)));
            track.is_matched = false;
        }
        self.pairs.clear();
        for (index, track) in self.tracks.iter().enumerate() {
            let near = groups
                .iter()
                .enumerate()
                .filter(|(_, seen)| track.moves || viewpoint.is_steady(seen));
            self.pairs.extend(
                near.filter_map(|(group, seen)| track.distance_m(seen).map(|away_m| (away_m, index, group))),
            );
        }
        self.pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        self.used.clear();
        self.used.resize(groups.len(), false);
        for (_, track, group) in &self.pairs {
            let track = &mut self.tracks[*track];
            if !track.is_matched && !self.used[*group] {
                track.is_matched = true;
                self.used[*group] = true;
                track.correct(now, &groups[*group], slipped_m);
            }
        }
        self.tracks
            .retain(|track| now.seconds_since(track.seen) <= LOST_S);
        for (group, is_used) in groups.iter().zip(&self.used) {
            if !is_used && viewpoint.is_steady(group) && self.tracks.len() < TRACKS_MAX {
                self.last_id = self.last_id.wrapping_add(1).max(1);
                self.tracks.push(Track::new(self.last_id, now, group, slipped_m));
            }
        }
    }

    /// Writes what moves, the nearest to `vehicle_m` (local) first.
    pub fn write(&mut self, vehicle_m: &Vector3<f64>, out: &mut MovingObstacles) {
        *out = MovingObstacles::default();
        self.order.clear();
        let is_ground =
            |track: &Track| track.half_height_m <= FLAT_M && track.axes[2].position_m > vehicle_m.z + BELOW_M;
        let moving = self
            .tracks
            .iter()
            .enumerate()
            .filter(|(_, track)| track.moves && !is_ground(track));
        self.order.extend(
            moving.map(|(index, track)| ((track.position_m() - vehicle_m).norm() - track.radius_m, index)),
        );
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        for (_, index) in &self.order {
            out.push(self.tracks[*index].report());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Group, Tracks, Viewpoint};
    use jink_shared_types::Timestamp;
    use jink_shared_types::moving::MovingObstacles;
    use nalgebra::Vector3;

    /// What is reported of one group as it is at each of 20 frames a second, after two seconds.
    fn seen(group_at: impl Fn(f64) -> Group) -> MovingObstacles {
        seen_while_slipping(group_at, 0.0)
    }

    /// The same while the estimated position slips north by `slips_mps`.
    fn seen_while_slipping(group_at: impl Fn(f64) -> Group, slips_mps: f64) -> MovingObstacles {
        let mut tracks = Tracks::new();
        for frame in 0..=40 {
            let t_s = 0.05 * f64::from(frame);
            let now = Timestamp::from_seconds(100.0 + t_s);
            let slipped_m = Vector3::new(slips_mps * t_s, 0.0, 0.0);
            tracks.update(now, &[group_at(t_s)], &slipped_m, &Viewpoint::default());
        }
        let mut moving = MovingObstacles::default();
        tracks.write(&Vector3::new(0.0, 0.0, -2.0), &mut moving);
        moving
    }

    #[test]
    fn what_comes_into_view_from_one_side_does_not_move() {
        let grows = |t_s: f64| {
            let half_m = 0.2 + 0.5 * t_s;
            Group {
                centre_m: Vector3::new(5.0 + half_m, 1.0, -1.0),
                radius_m: half_m,
                half_height_m: 1.0,
            }
        };
        assert!(seen(grows).obstacles().is_empty());
    }

    #[test]
    fn what_moves_only_as_the_estimated_position_slips_does_not_move() {
        let goes_north = |t_s: f64| Group {
            centre_m: Vector3::new(5.0 + t_s, 1.0, -1.0),
            radius_m: 0.3,
            half_height_m: 1.0,
        };
        for (slips_mps, moves) in [(0.0, true), (1.0, false), (0.9, false), (-1.0, true)] {
            let moving = seen_while_slipping(goes_north, slips_mps);
            assert_eq!(
                !moving.obstacles().is_empty(),
                moves,
                "{slips_mps} m/s: {moving:?}"
            );
        }
    }

    #[test]
    fn who_stands_on_the_ground_does_not_rise_as_more_of_him_is_seen() {
        let walks = |t_s: f64| Group {
            centre_m: Vector3::new(5.0, t_s, -0.5 - 0.4 * t_s),
            radius_m: 0.3,
            half_height_m: 0.7 + 0.4 * t_s,
        };
        let moving = seen(walks);
        let [walker] = moving.obstacles() else {
            panic!("{moving:?}");
        };
        assert!((walker.velocity.y_mps - 1.0).abs() < 0.2, "{walker:?}");
        assert_eq!(walker.velocity.z_mps, 0.0);
        assert!((walker.position.z_m + 1.3).abs() < 0.2, "{walker:?}");
        // What is small may fly up.
        let flies = |t_s: f64| Group {
            half_height_m: 0.2,
            ..walks(t_s)
        };
        assert!(seen(flies).obstacles()[0].velocity.z_mps < -0.2);
    }
}
