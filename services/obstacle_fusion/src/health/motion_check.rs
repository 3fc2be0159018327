//! Compares two frames of one sensor, taken at two places: an obstacle of one must not lie where rays of the other pass
//! through.
//!
//! The frames are placed by the vehicle's poses and compared in both directions, in range images around the places of
//! the sensor ([`super::range_image`]). If there are too many contradictions, every known cause is tried in turn: both
//! frames are placed with it, and the cause that removes most of the contradictions is the result.
//!
//! A sensor that has agreed with itself for a while is as it should be. If it contradicts itself later, the vehicle has moved
//! otherwise than its estimated position: that cause is tried first then, as a shift of the later frame. (Where a vehicle flies
//! straight on, a shift and a sensor that is turned look the same.) Frames of a fast motion are not compared.

use super::range_image::{RangeAgreement, RangeImage};
use crate::poses::{Pose, SweepPoses};
use jink_shared_types::Timestamp;
use jink_shared_types::pose_history::PoseHistory;
use jink_shared_types::ranges::{PointCloud, RangeScan, RayKind};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// Rays kept of a frame: fewer leave holes in an image in which thin trunks stand.
const RAYS: usize = 8_192;
/// Of these, so many are checked against the other frame.
const CHECKED_RAYS: usize = 1_000;
/// Poses kept of a frame.
const SLICES: usize = 16;
/// Frames are compared that are so far apart (m, rad), or, if that is less, this part of the mean distance of the
/// sensor's hits: over a shorter distance noise dominates, over a longer one the surroundings differ ...
const APART_M: [f64; 2] = [1.0, 4.0];
const APART_RATIO: f64 = 0.5;
const APART_RAD: f64 = 40.0 * PI / 180.0;
/// ... and no further in time (s): in that time an estimate of the position drifts by some decimetres.
const AGE_MAX_S: f64 = 5.0;
/// Of a faster motion (m/s, rad/s) nothing is compared: 20 ms, which stamps and poses may be off, are as much as a comparison
/// allows.
const FASTEST_MPS: f64 = 7.5;
const FASTEST_RADPS: f64 = 1.5;
/// Nearer is the vehicle itself, farther few rays hit (m).
const DISTANCE_M: [f64; 2] = [0.8, 12.0];
/// A ray into the open counts as seen through up to here (m).
const OPEN_M: f64 = 60.0;
/// Matches that a comparison needs.
const MATCHES_MIN: u32 = 30;
/// Share of contradictions from which a cause is searched. Rendered flights without a fault had 0.09 at most, with a
/// Mid-360 in a forest 0.17: for that no cause was found.
const WRONG: f64 = 0.12;
/// Share from which there is a fault although no known cause explains it.
const VERY_WRONG: f64 = 0.3;
/// A cause explains the contradictions if this part of them remains ...
const REMAINING_RATIO: f64 = 0.35;
/// ... with at least this part of the matches.
const MATCHES_RATIO: f64 = 0.4;
/// Comparisons that must agree on the kind of cause.
const AGREE: u32 = 2;
/// Without a known cause they must be so many.
const AGREE_UNKNOWN: u32 = 3;
/// Comparisons in a row without contradiction after which a sensor is credible again: many motions do not show a fault.
const CREDIBLE: u32 = 20;
/// Comparisons in a row without contradiction after which later ones are first explained by the estimated position, and so many
/// that must agree on a fault of the sensor then.
const PROVEN: u32 = 8;
const AGREE_PROVEN: u32 = 6;
/// From then on frames are compared that are so far apart in time (s), whatever the motion: in that time a position runs off by
/// no more than the shifts that are tried.
const LOOK_S: f64 = 0.7;
/// Comparisons in a row without contradiction after which the estimated position is credible again.
const SETTLED: u32 = 3;
/// Shifts that are tried: a grid of this step (m), and so many steps to each side.
const SHIFT_M: f64 = 1.0;
const SHIFTS: i32 = 3;
/// A later cause must be so much better than one before: upside down and mirrored look almost the same where everything
/// is upright.
const BETTER_FACTOR: f64 = 1.1;
/// Causes tried per frame.
const CAUSES_PER_FRAME: usize = 5;
/// A frame of which less than this share lies within the sensor's own range, of so many hits, has wrong units.
const WITHIN: f64 = 0.1;
const HITS_MIN: u32 = 200;

/// Reported metres for one metre: millimetres and centimetres taken for metres and the reverse, feet, two units that
/// are in use for depth images.
const FACTORS: [f64; 10] = [
    1_000.0, 0.001, 3.280_84, 0.304_8, 100.0, 0.01, 10.0, 0.1, 2.0, 0.5,
];
/// A sensor may be turned by these about each axis (deg), either way.
const TURNS_DEG: [f64; 7] = [15.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0];
/// Step of the planes in which left and right may be exchanged (deg).
const MIRROR_DEG: f64 = 15.0;

/// A possible cause of the contradictions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum FaultCause {
    /// This many metres are reported for one.
    Scale(f64),
    /// Left and right are exchanged.
    Mirrored,
    /// It is rotated by this angle (deg).
    Turned(f64),
    /// It is none of the sensor: the vehicle has moved otherwise than its estimated position.
    Adrift,
    /// No known cause explains them.
    Unexplained,
}

impl FaultCause {
    /// Number of the kind.
    fn kind(self) -> usize {
        match self {
            FaultCause::Scale(_) => 0,
            FaultCause::Mirrored => 1,
            FaultCause::Turned(_) => 2,
            FaultCause::Unexplained => 3,
            FaultCause::Adrift => 4,
        }
    }
}

/// How two frames are placed.
#[derive(Clone, Copy, Debug)]
struct Placement {
    /// From the reported to the true vector of a ray.
    true_t_reported: Matrix3<f64>,
    /// By how much the later frame is shifted (m north, m east).
    now_m: [f64; 2],
}

impl Placement {
    const AS_REPORTED: Self = Self {
        true_t_reported: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        now_m: [0.0; 2],
    };
}

/// Shifts among the causes.
const SHIFT_COUNT: usize = ((2 * SHIFTS + 1) * (2 * SHIFTS + 1) - 1) as usize;

#[derive(Clone, Copy)]
struct SnapshotRay {
    /// From the sensor, as reported (body, m).
    way_m: [f32; 3],
    slice: u8,
    is_hit: bool,
}

/// A frame, with the poses during it.
struct Snapshot {
    at: Timestamp,
    pose: Option<Pose>,
    slices: [Option<Pose>; SLICES],
    origin_m: Vector3<f64>,
    rays: Vec<SnapshotRay>,
    hits: u32,
    /// Sum of their distances, each 20 m at most (m).
    distances_m: f64,
    /// Hits within the sensor's own range.
    within: u32,
    is_planar: bool,
}

impl Snapshot {
    fn new() -> Self {
        Self {
            at: Timestamp::NEVER,
            pose: None,
            slices: [None; SLICES],
            origin_m: Vector3::zeros(),
            rays: Vec::with_capacity(RAYS),
            hits: 0,
            distances_m: 0.0,
            within: 0,
            is_planar: false,
        }
    }

    fn begin(&mut self, at: Timestamp, pose: Pose, origin_m: Vector3<f64>, is_planar: bool) {
        (self.at, self.pose, self.origin_m, self.is_planar) = (at, Some(pose), origin_m, is_planar);
        self.rays.clear();
        (self.hits, self.within, self.distances_m) = (0, 0, 0.0);
    }

    /// Poses of a frame that took `duration_10us`.
    fn slice(&mut self, duration_10us: u16, sweep: &mut SweepPoses, history: &PoseHistory) {
        for (number, slice) in self.slices.iter_mut().enumerate() {
            let middle = (2 * number as u32 + 1) * u32::from(duration_10us) / (2 * SLICES as u32);
            *slice = sweep.at(middle as u16, history);
        }
    }

    fn push(&mut self, way_m: Vector3<f64>, share: f64, is_hit: bool, limits_m: [f32; 2]) {
        let distance_m = way_m.norm();
        if !distance_m.is_finite() || self.rays.len() == RAYS {
            return;
        }
        if is_hit {
            self.hits += 1;
            self.distances_m += distance_m.min(20.0);
            let [least_m, most_m] = limits_m.map(f64::from);
            self.within += u32::from((0.9 * least_m..=1.01 * most_m).contains(&distance_m));
        }
        self.rays.push(SnapshotRay {
            way_m: way_m.cast::<f32>().into(),
            slice: (share * SLICES as f64).clamp(0.0, (SLICES - 1) as f64) as u8,
            is_hit,
        });
    }

    /// How far away a frame must be to be compared with this one (m).
    fn apart_m(&self) -> f64 {
        let [least_m, most_m] = APART_M;
        (APART_RATIO * self.distances_m / f64::from(self.hits.max(1))).clamp(least_m, most_m)
    }

    /// The sensor (local, m).
    fn place(&self) -> Option<Vector3<f64>> {
        let pose = self.pose.as_ref()?;
        Some(pose.position_m + pose.rotation * self.origin_m)
    }

    /// Where a ray ends (local, m), and how far that is from the sensor, with `true_t_reported` mapping the reported to the true
    /// vector.
    fn end(&self, ray: &SnapshotRay, true_t_reported: &Matrix3<f64>) -> Option<(Vector3<f64>, f64)> {
        let pose = self.slices[usize::from(ray.slice)].as_ref()?;
        let mut way_m = true_t_reported * Vector3::from(ray.way_m).cast::<f64>();
        let distance_m = way_m.norm();
        if !ray.is_hit && distance_m > OPEN_M {
            way_m *= OPEN_M / distance_m;
        }
        Some((
            pose.position_m + pose.rotation * (self.origin_m + way_m),
            distance_m,
        ))
    }
}

/// Matches of a comparison.
#[derive(Clone, Copy, Debug, Default)]
struct Matches {
    contradict: u32,
    all: u32,
}

impl Matches {
    /// Score of a cause: matches count for it, contradictions count more against it.
    fn score(self) -> f64 {
        f64::from(self.all) - 4.0 * f64::from(self.contradict)
    }

    fn share(self) -> f64 {
        f64::from(self.contradict) / f64::from(self.all.max(1))
    }
}

/// A search for the cause, in progress.
struct CauseSearch {
    before: Matches,
    next: usize,
    best: Option<(FaultCause, Matches)>,
    /// Nothing of it lies within the sensor's range: only a factor can be the cause.
    is_out_of_range: bool,
}

/// One sensor.
pub(super) struct MotionCheck {
    key: Snapshot,
    now: Snapshot,
    /// A frame has come since the last [`MotionCheck::compare_pending`].
    is_pending: bool,
    /// The newest frame is kept in `now`, to be compared.
    is_taken: bool,
    image: RangeImage,
    /// The shifts come first.
    causes: Vec<(FaultCause, Placement)>,
    search: Option<CauseSearch>,
    /// Comparisons that support each kind of cause.
    evidence: [u32; 5],
    /// Comparisons in a row without contradiction.
    agreed: u32,
    /// The same, with those for which the vehicle need not move.
    settled: u32,
    found: Option<FaultCause>,
    /// The sensor is as it should be: enough comparisons in a row have agreed.
    is_proven: bool,
    /// The estimated position does not agree with what is seen.
    is_adrift: bool,
}

impl MotionCheck {
    pub fn new() -> Self {
        Self {
            key: Snapshot::new(),
            now: Snapshot::new(),
            is_pending: false,
            is_taken: false,
            image: RangeImage::new(),
            causes: causes(),
            search: None,
            evidence: [0; 5],
            agreed: 0,
            settled: 0,
            found: None,
            is_proven: false,
            is_adrift: false,
        }
    }

    /// The cause that was found.
    pub fn cause(&self) -> Option<FaultCause> {
        self.found
    }

    /// Whether the vehicle moves otherwise than its estimated position.
    pub fn is_adrift(&self) -> bool {
        self.is_adrift
    }

    /// Earlier poses are not comparable with later ones.
    pub fn clear(&mut self) {
        self.key.pose = None;
        self.search = None;
        self.is_taken = false;
        self.settled = 0;
    }

    /// A frame has come that was captured at `at`, at `pose`: whether it is to be compared, or kept for a later
    /// comparison. [`MotionCheck::compare_pending`] does so.
    pub fn on_frame(&mut self, pose: &Pose, at: Timestamp) -> bool {
        self.compare_pending();
        self.is_pending = true;
        let Some(key) = self.key.pose.as_ref().filter(|_| self.search.is_none()) else {
            return self.search.is_none();
        };
        let age_s = at.seconds_since(self.key.at);
        !(0.0..=self.age_max_s()).contains(&age_s) || self.is_apart(key, pose)
    }

    /// Longest time (s) until a frame is compared with the one kept, or replaces it.
    fn age_max_s(&self) -> f64 {
        if self.is_proven { LOOK_S } else { AGE_MAX_S }
    }

    /// Whether the vehicle has moved so far between these poses that a fault of the sensor shows.
    fn is_apart(&self, key: &Pose, pose: &Pose) -> bool {
        let way_m = (pose.position_m - key.position_m).norm();
        way_m > self.key.apart_m() || key.turned_rad(pose) > APART_RAD
    }

    /// Takes a cloud.
    pub fn cloud(
        &mut self,
        cloud: &PointCloud,
        (pose, at): (Pose, Timestamp),
        sweep: &mut SweepPoses,
        history: &PoseHistory,
    ) {
        let points = cloud.points();
        let origin_m = cloud.origin.vector();
        let duration_10us = points.iter().map(|point| point.offset_10us).max().unwrap_or(0);
        self.now.begin(at, pose, origin_m, false);
        self.now.slice(duration_10us, sweep, history);
        let step = points.len().div_ceil(RAYS).max(1);
        for point in points.iter().step_by(step) {
            let kind = point.kind.get();
            if kind != RayKind::Unknown {
                let end_m = Vector3::new(point.forward_m, point.right_m, point.down_m).cast::<f64>();
                let share = f64::from(point.offset_10us) / f64::from(duration_10us.max(1));
                let limits_m = [cloud.range_min_m, cloud.range_max_m];
                self.now
                    .push(end_m - origin_m, share, kind == RayKind::Hit, limits_m);
            }
        }
        self.is_taken = true;
    }

    /// Takes a scan of many beams. A part of a turn has too little in common with the part before.
    pub fn scan(
        &mut self,
        scan: &RangeScan,
        body_q_sensor: &UnitQuaternion<f64>,
        (pose, at): (Pose, Timestamp),
        sweep: &mut SweepPoses,
        history: &PoseHistory,
    ) {
        let beams = scan.ranges().len() as f64;
        if beams * f64::from(scan.angle_step_rad).abs() < 0.5 * PI {
            return;
        }
        self.now.begin(at, pose, scan.origin.vector(), true);
        let duration_s = f64::from(scan.beam_interval_s) * beams;
        self.now
            .slice((duration_s * 1e5).min(65_535.0) as u16, sweep, history);
        let limits_m = [scan.range_min_m, scan.range_max_m];
        for (beam, range_m) in scan.ranges().iter().enumerate() {
            if range_m.is_nan() || *range_m < 0.0 {
                continue;
            }
            let angle_rad = f64::from(scan.angle_first_rad) + beam as f64 * f64::from(scan.angle_step_rad);
            let (sin, cos) = angle_rad.sin_cos();
            let is_hit = range_m.is_finite();
            let range_m = if is_hit { *range_m } else { scan.range_max_m };
            let way_m = body_q_sensor * Vector3::new(cos, sin, 0.0) * f64::from(range_m);
            self.now.push(way_m, beam as f64 / beams, is_hit, limits_m);
        }
        self.is_taken = true;
    }

    /// Once per frame: compares it, and continues a search. It takes up to a few milliseconds and the map does not depend on
    /// it, so it has time until the map is published.
    pub fn compare_pending(&mut self) {
        if !std::mem::take(&mut self.is_pending) {
            return;
        }
        if std::mem::take(&mut self.is_taken) {
            self.on_frame_taken();
        }
        self.advance();
    }

    /// A frame was taken: compares it with the one kept, which it replaces unless a search needs both.
    fn on_frame_taken(&mut self) {
        if self.is_comparable() {
            let before = self.compare(&Placement::AS_REPORTED);
            let hits = self.now.hits.min(self.key.hits);
            let within = f64::from(self.now.within.max(self.key.within));
            let is_out_of_range = hits >= HITS_MIN && within < WITHIN * f64::from(hits);
            if is_out_of_range || (before.all >= MATCHES_MIN && before.share() > WRONG) {
                self.search = Some(CauseSearch {
                    before,
                    next: if self.is_proven { 0 } else { SHIFT_COUNT },
                    best: None,
                    is_out_of_range,
                });
                return;
            }
            if before.all >= MATCHES_MIN {
                let shows_faults = self.shows_faults();
                self.count(None, shows_faults);
            }
        }
        std::mem::swap(&mut self.key, &mut self.now);
    }

    /// Whether the vehicle has moved so far between the frames that a fault of the sensor shows.
    fn shows_faults(&self) -> bool {
        let poses = self.key.pose.as_ref().zip(self.now.pose.as_ref());
        poses.is_some_and(|(key, now)| self.is_apart(key, now))
    }

    fn is_comparable(&self) -> bool {
        let (Some(key), Some(now)) = (&self.key.pose, &self.now.pose) else {
            return false;
        };
        let age_s = self.now.at.seconds_since(self.key.at);
        let way_m = (now.position_m - key.position_m).norm();
        let is_fast = way_m > FASTEST_MPS * age_s || key.turned_rad(now) > FASTEST_RADPS * age_s;
        (0.0..=AGE_MAX_S).contains(&age_s) && !is_fast && (self.is_proven || self.is_apart(key, now))
    }

    /// Continues a search that is in progress.
    fn advance(&mut self) {
        let Some(mut search) = self.search.take() else {
            return;
        };
        // The shifts are tried on their own.
        let ends = [SHIFT_COUNT, self.causes.len()];
        let end = ends[usize::from(search.next >= SHIFT_COUNT)];
        let last = end.min(search.next + CAUSES_PER_FRAME);
        for number in search.next..last {
            let (cause, placement) = self.causes[number];
            if search.is_out_of_range && !matches!(cause, FaultCause::Scale(_)) {
                continue;
            }
            let matches = self.compare(&placement);
            let is_better = search
                .best
                .is_none_or(|(_, best)| matches.score() > BETTER_FACTOR * best.score().max(0.0));

            if matches.all >= MATCHES_MIN && is_better {
                search.best = Some((cause, matches));
            }
        }
        search.next = last;
        let is_explained = last == SHIFT_COUNT && matches!(search.verdict(), Some(FaultCause::Adrift));
        if last == SHIFT_COUNT && !is_explained {
            search.best = None;
        }
        if last < self.causes.len() && !is_explained {
            self.search = Some(search);
            return;
        }
        self.count(search.verdict(), true);
        std::mem::swap(&mut self.key, &mut self.now);
        // The poses between them are old: the comparison starts again.
        self.key.pose = None;
    }

    /// Counts a comparison with the result `cause`, or with none; whether the vehicle has moved so far that faults of the sensor show.
    fn count(&mut self, cause: Option<FaultCause>, shows_faults: bool) {
        let Some(cause) = cause else {
            self.evidence = self.evidence.map(|count| count.saturating_sub(1));
            self.settled += 1;
            self.is_adrift &= self.settled < SETTLED;
            self.agreed += u32::from(shows_faults);
            if self.agreed >= CREDIBLE {
                self.found = None;
            }
            self.is_proven |= self.agreed >= PROVEN;
            return;
        };
        (self.agreed, self.settled) = (0, 0);
        let kind = cause.kind();
        let needed = match cause {
            FaultCause::Adrift => AGREE,
            _ if self.is_proven => AGREE_PROVEN,
            FaultCause::Unexplained => AGREE_UNKNOWN,
            _ => AGREE,
        };
        self.evidence[kind] = (self.evidence[kind] + 1).min(needed + 1);
        if cause == FaultCause::Adrift {
            self.is_adrift |= self.evidence[kind] >= needed;
            return;
        }
        // The cause found first stays until frames agree again, unless it was none: one fault gives one event.
        let is_open = matches!(self.found, None | Some(FaultCause::Unexplained));
        if self.evidence[kind] >= needed && is_open {
            self.found = Some(cause);
        }
    }

    /// Places both frames with `placement`, and checks the hits of each against the other.
    fn compare(&mut self, placement: &Placement) -> Matches {
        let cause = &placement.true_t_reported;
        let shift_m = Vector3::new(placement.now_m[0], placement.now_m[1], 0.0);
        let mut matches = Matches::default();
        for (seen, checked, shift_m) in [(&self.key, &self.now, shift_m), (&self.now, &self.key, -shift_m)] {
            let Some(place_m) = seen.place() else {
                continue;
            };
            self.image.clear(seen.is_planar);
            for ray in &seen.rays {
                if let Some((end_m, _)) = seen.end(ray, cause) {
                    self.image.add(&(end_m - place_m));
                }
            }
            let step = checked.rays.len().div_ceil(CHECKED_RAYS).max(1);
            for ray in checked.rays.iter().step_by(step).filter(|ray| ray.is_hit) {
                let Some((end_m, distance_m)) = checked.end(ray, cause) else {
                    continue;
                };
                let offset_m = end_m + shift_m - place_m;
                let [least_m, most_m] = DISTANCE_M;
                let is_near = distance_m >= least_m && (least_m..=most_m).contains(&offset_m.norm());
                match is_near.then(|| self.image.judge(&offset_m)) {
                    Some(RangeAgreement::SeenThrough) => {
                        matches.contradict += 1;
                        matches.all += 1;
                    }
                    Some(RangeAgreement::Agrees) => matches.all += 1,
                    Some(RangeAgreement::Unknown) | None => {}
                }
            }
        }
        matches
    }
}

impl CauseSearch {
    /// The result when every cause was tried.
    fn verdict(&self) -> Option<FaultCause> {
        let explained = self.best.filter(|(_, matches)| {
            let is_enough = f64::from(matches.all) >= MATCHES_RATIO * f64::from(self.before.all);
            if self.is_out_of_range {
                matches.share() < WRONG
            } else {
                is_enough && matches.share() < REMAINING_RATIO * self.before.share()
            }
        });
        let is_very_wrong = self.before.all >= MATCHES_MIN && self.before.share() > VERY_WRONG;
        match explained {
            Some((cause, _)) => Some(cause),
            None => is_very_wrong.then_some(FaultCause::Unexplained),
        }
    }
}

/// Every known cause, with how it places the frames.
fn causes() -> Vec<(FaultCause, Placement)> {
    let shifts = (-SHIFTS..=SHIFTS).flat_map(|north| (-SHIFTS..=SHIFTS).map(move |east| [north, east]));
    let shifts = shifts.filter(|shift| *shift != [0, 0]).map(|shift| {
        let now_m = shift.map(|steps| f64::from(steps) * SHIFT_M);
        (
            FaultCause::Adrift,
            Placement {
                now_m,
                ..Placement::AS_REPORTED
            },
        )
    });
    let scales = FACTORS.map(|factor| (FaultCause::Scale(factor), Matrix3::identity() / factor));
    let mirrors = (0..(180.0 / MIRROR_DEG) as i32).map(|number| {
        // The reflection in an upright plane through the sensor.
        let (sin, cos) = (2.0 * f64::from(number) * MIRROR_DEG.to_radians()).sin_cos();
        let matrix = Matrix3::new(cos, sin, 0.0, sin, -cos, 0.0, 0.0, 0.0, 1.0);
        (FaultCause::Mirrored, matrix)
    });
    let turns = TURNS_DEG.iter().flat_map(|turn_deg| {
        [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()]
            .into_iter()
            .flat_map(move |axis| {
                [*turn_deg, -turn_deg].map(|deg| {
                    let turn = Rotation3::from_axis_angle(&axis, deg.to_radians());
                    (FaultCause::Turned(*turn_deg), turn.into_inner())
                })
            })
    });
    let of_the_sensor = scales.into_iter().chain(mirrors).chain(turns);
    let of_the_sensor = of_the_sensor.map(|(cause, true_t_reported)| {
        (
            cause,
            Placement {
                true_t_reported,
                ..Placement::AS_REPORTED
            },
        )
    });
    shifts.chain(of_the_sensor).collect()
}
