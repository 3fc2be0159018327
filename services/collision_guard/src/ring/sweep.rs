//! From rays to sectors: takes the ends of rays in the body frame, corrects each for the motion of the vehicle since it
//! was measured, and keeps per sector the farthest free range and per slot of a sector the nearest hit.
//!
//! | in | out |
//! |---|---|
//! | poses at the first and at the last ray, sensor origin and range | |
//! | ray ends in the body frame with their share of the sweep's time | sectors and hits of a [`SensorView`] |
//!
//! The level frame has its origin and heading at the vehicle's pose at the last ray. The transformation from body to
//! level is interpolated linearly between first and last ray: at 1 rad/s a sweep of 0.1 s turns by 0.1 rad, and the
//! chord of that arc misses it by at most 0.1^2 / 8 of the range, 1 cm at 10 m.
//!
//! A ray determines how far its sector is free: horizontally, as long as the ray stays inside the height band. A ray
//! that leaves the band through its top or bottom says nothing about what is beyond. Where the user declares that space
//! above a free place is free, a ray that leaves the band through its bottom does.
//!
//! A hundred thousand points have to pass in half a millisecond, 12 cycles each. So rays are taken in blocks, each step
//! is a loop without branches over plain arrays, which the compiler turns into vector instructions, and only the last
//! step, two comparisons per ray, is scalar.

use super::bearing::{BINS, SECTOR_BINS, bearing_sectors, bin_of, sector_bin, sector_of_bin, slot_of_bin};
use super::sensor_view::{SensorView, SlotHit};
use jink_shared_types::Timestamp;
use jink_shared_types::pose_history::Pose;
use jink_shared_types::ranges::RayKind;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Rays per block: long enough to hide the loops' ends, short enough for the first-level cache.
const BLOCK: usize = 64;

/// Squared range that no sensor has (m2): coordinates beyond are damaged.
pub(super) const BEYOND_ANY_SENSOR_M2: f32 = 1e10;

/// Transforms the rays of one sensor sample into points of the level frame.
#[derive(Clone, Debug)]
pub struct SweepTransform {
    /// Rows of the rotation from body to level at the first ray, and what is added up to the last.
    turn: [[f32; 3]; 3],
    turn_rate: [[f32; 3]; 3],
    /// Vehicle position at the first ray (m); at the last it is zero.
    shift_m: [f32; 3],
    /// The sensor in the level frame at the first ray (m), and what is added up to the last.
    sensor_m: [f32; 3],
    sensor_rate_m: [f32; 3],
    band_m: f32,
    self_m2: f32,
    /// Greatest squared range that counts as known free (m2): the sensor's reach, zero if the sensor lies outside the
    /// band.
    reach_m2: f32,
    first: Timestamp,
    duration_s: f64,
}

/// What does not change from sample to sample.
#[derive(Clone, Copy, Debug)]
pub struct Envelope {
    /// Radius within which a hit is the vehicle itself (m).
    pub radius_m: f64,
    /// Half height of the band that counts (m).
    pub band_half_m: f64,
}

impl SweepTransform {
    /// Rays measured from `first` to `last`, by a sensor at `sensor_m` in the body that sees as far as `range_max_m`.
    pub fn new(
        first: (Timestamp, &Pose),
        last: (Timestamp, &Pose),
        sensor_m: Vector3<f64>,
        range_max_m: f32,
        envelope: Envelope,
    ) -> Self {
        let level_q_local = Rotation3::from_axis_angle(&Vector3::z_axis(), -last.1.yaw_rad());
        let turn = |pose: &Pose| (level_q_local * pose.local_q_body.to_rotation_matrix()).into_inner();
        let (turn_first, turn_last) = (turn(first.1), turn(last.1));
        let shift = level_q_local * (first.1.position_m - last.1.position_m);
        let sensor_first = turn_first * sensor_m + shift;
        let sensor_last = turn_last * sensor_m;
        let in_band = sensor_first.z.abs().max(sensor_last.z.abs()) < envelope.band_half_m;
        Self {
            turn: rows(&turn_first),
            turn_rate: rows(&(turn_last - turn_first)),
            shift_m: components(&shift),
            sensor_m: components(&sensor_first),
            sensor_rate_m: components(&(sensor_last - sensor_first)),
            band_m: envelope.band_half_m as f32,
            self_m2: (envelope.radius_m * envelope.radius_m) as f32,
            reach_m2: if in_band { range_max_m * range_max_m } else { 0.0 },
            first: first.0,
            duration_s: last.0.seconds_since(first.0).max(0.0),
        }
    }

    /// Duration from first to last ray (s).
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// A fast test for places that may lie inside the band, at any time of the sweep, for rays up to `range_max_m`
    /// long.
    pub fn near_band(&self, range_max_m: f32) -> NearBand {
        let (row, rate) = (self.turn[2], self.turn_rate[2]);
        let middle = |i: usize| row[i] + 0.5 * rate[i];
        // The sensor is not at the origin: its rays reach a bit farther from there.
        let reach_m = range_max_m + self.sensor_m.iter().map(|m| m.abs()).sum::<f32>();
        let swing = (rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2]).sqrt();
        NearBand {
            row: [middle(0), middle(1), middle(2)],
            shift_m: 0.5 * self.shift_m[2],
            half_m: self.band_m + 0.5 * (swing * reach_m + self.shift_m[2].abs()),
        }
    }

    /// Component `row` of a body-frame place in the level frame (m).
    #[inline(always)]
    fn level_component(&self, row: usize, [x, y, z]: [f32; 3], share: f32) -> f32 {
        let (r, d) = (&self.turn[row], &self.turn_rate[row]);
        let at_first = r[0] * x + r[1] * y + r[2] * z + self.shift_m[row];
        let change = d[0] * x + d[1] * y + d[2] * z - self.shift_m[row];
        at_first + share * change
    }

    fn time_of(&self, share: f32) -> Timestamp {
        self.first.plus_seconds(self.duration_s * f64::from(share))
    }
}

/// The height of a body-frame place with the attitude in the middle of the sweep, and its error bound.
#[derive(Clone, Copy, Debug)]
pub struct NearBand {
    row: [f32; 3],
    shift_m: f32,
    half_m: f32,
}

impl NearBand {
    /// Whether the place (m) may lie inside the band; never false for one that does.
    #[inline(always)]
    pub fn holds(&self, [x, y, z]: [f32; 3]) -> bool {
        (self.row[0] * x + self.row[1] * y + self.row[2] * z + self.shift_m).abs() <= self.half_m
    }
}

fn rows(m: &Matrix3<f64>) -> [[f32; 3]; 3] {
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}

fn components(v: &Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

#[derive(Clone, Copy, Debug)]
struct NearestHit {
    m2: f32,
    forward_m: f32,
    right_m: f32,
    share: f32,
}

#[derive(Clone, Copy, Debug)]
struct FarthestRay {
    m2: f32,
    share: f32,
    /// The farthest of rays that may leave the band through its bottom (m2).
    under_m2: f32,
}

/// Rays of one block, and the results of each step.
#[derive(Clone, Debug)]
struct RayBlock {
    len: usize,
    x_m: [f32; BLOCK],
    y_m: [f32; BLOCK],
    z_m: [f32; BLOCK],
    share: [f32; BLOCK],
    /// 1 for a hit, 0 otherwise.
    hit: [f32; BLOCK],
    near_m2: [f32; BLOCK],
    known_m2: [f32; BLOCK],
    under_m2: [f32; BLOCK],
    bin: [u32; BLOCK],
}

/// Collects the rays of one sensor sample. Holds all its memory.
#[derive(Clone, Debug)]
pub struct SectorCollector {
    block: RayBlock,
    nearest: [NearestHit; BINS],
    farthest: [FarthestRay; SECTOR_BINS],
}

impl SectorCollector {
    /// Empty.
    pub fn new() -> Self {
        let zero = [0.0; BLOCK];
        Self {
            block: RayBlock {
                len: 0,
                x_m: zero,
                y_m: zero,
                z_m: zero,
                share: zero,
                hit: zero,
                near_m2: zero,
                known_m2: zero,
                under_m2: zero,
                bin: [0; BLOCK],
            },
            nearest: [NOTHING_NEAR; BINS],
            farthest: [NOTHING_KNOWN; SECTOR_BINS],
        }
    }

    /// Starts a new sample.
    pub fn start(&mut self) {
        self.block.len = 0;
        self.nearest = [NOTHING_NEAR; BINS];
        self.farthest = [NOTHING_KNOWN; SECTOR_BINS];
    }

    /// Adds the ray that ends at `end_m` in the body frame, `share` (0 to 1) of the way from first to last ray.
    #[inline(always)]
    pub fn push(&mut self, sweep: &SweepTransform, end_m: [f32; 3], share: f32, kind: RayKind) {
        let block = &mut self.block;
        // Slots beyond `len` are written, but never read: an unknown ray costs no branch.
        let slot = block.len % BLOCK;
        block.x_m[slot] = end_m[0];
        block.y_m[slot] = end_m[1];
        block.z_m[slot] = end_m[2];
        block.share[slot] = share;
        block.hit[slot] = if kind == RayKind::Hit { 1.0 } else { 0.0 };
        block.len = block.len.wrapping_add(usize::from(kind != RayKind::Unknown));
        if block.len == BLOCK {
            self.flush(sweep);
        }
    }

    /// Ends the sample: writes sectors and hits into `view`, which is empty.
    pub fn finish(&mut self, sweep: &SweepTransform, view: &mut SensorView) {
        self.flush(sweep);
        for (bin, farthest) in self.farthest.iter().enumerate() {
            let sector = &mut view.sectors[sector_of_bin(bin)];
            if farthest.m2 > sector.known_m2 {
                sector.known_m2 = farthest.m2;
                sector.seen = sweep.time_of(farthest.share);
            }
            sector.under_m2 = sector.under_m2.max(farthest.under_m2);
        }
        for (bin, nearest) in self.nearest.iter().enumerate() {
            let hit = &mut view.hits[slot_of_bin(bin)];
            let [forward_m, right_m] = hit.level_m;
            if nearest.m2 < forward_m * forward_m + right_m * right_m {
                *hit = SlotHit {
                    level_m: [nearest.forward_m, nearest.right_m],
                    seen: sweep.time_of(nearest.share),
                };
                let sector = &mut view.sectors[sector_of_bin(sector_bin(bin))];
                if nearest.m2 < sector.near_m2 {
                    sector.near_m2 = nearest.m2;
                    sector.seen = hit.seen;
                }
            }
        }
    }

    fn flush(&mut self, sweep: &SweepTransform) {
        self.block.turn_to_level(sweep);
        self.block.measure(sweep);
        let block = &self.block;
        for i in 0..block.len.min(BLOCK) {
            let bin = block.bin[i] as usize % BINS;
            if block.near_m2[i] < self.nearest[bin].m2 {
                self.nearest[bin] = NearestHit {
                    m2: block.near_m2[i],
                    forward_m: block.x_m[i],
                    right_m: block.y_m[i],
                    share: block.share[i],
                };
            }
            let farthest = &mut self.farthest[sector_bin(bin)];
            if block.known_m2[i] > farthest.m2 {
                farthest.m2 = block.known_m2[i];
                farthest.share = block.share[i];
            }
            if block.under_m2[i] > farthest.under_m2 {
                farthest.under_m2 = block.under_m2[i];
            }
        }
        self.block.len = 0;
    }
}

const NOTHING_NEAR: NearestHit = NearestHit {
    m2: f32::INFINITY,
    forward_m: 0.0,
    right_m: 0.0,
    share: 0.0,
};

const NOTHING_KNOWN: FarthestRay = FarthestRay {
    m2: 0.0,
    share: 0.0,
    under_m2: 0.0,
};

impl RayBlock {
    /// Turns body coordinates into level ones, in place.
    fn turn_to_level(&mut self, sweep: &SweepTransform) {
        for i in 0..BLOCK {
            let end_m = [self.x_m[i], self.y_m[i], self.z_m[i]];
            let share = self.share[i];
            self.x_m[i] = sweep.level_component(0, end_m, share);
            self.y_m[i] = sweep.level_component(1, end_m, share);
            self.z_m[i] = sweep.level_component(2, end_m, share);
        }
    }

    /// Per ray: the sector's bin, the squared distance if it is an obstacle, the squared range it knows to be free, and that
    /// where space above a free place is free.
    fn measure(&mut self, sweep: &SweepTransform) {
        let band = sweep.band_m;
        for i in 0..BLOCK {
            let (x, y, z, share) = (self.x_m[i], self.y_m[i], self.z_m[i], self.share[i]);
            let flat_m2 = x * x + y * y;
            let outside = z.abs() > band;
            let is_self = flat_m2 + z * z < sweep.self_m2;

            let obstacle = self.hit[i] > 0.5 && !outside && !is_self;
            self.near_m2[i] = if obstacle { flat_m2 } else { f32::INFINITY };

            // Where the ray leaves the band, on its way from the sensor to its end.
            let sensor_x = sweep.sensor_m[0] + share * sweep.sensor_rate_m[0];
            let sensor_y = sweep.sensor_m[1] + share * sweep.sensor_rate_m[1];
            let sensor_z = sweep.sensor_m[2] + share * sweep.sensor_rate_m[2];
            let limit = if z > 0.0 { band } else { -band };
            let inside_share = (limit - sensor_z) / (z - sensor_z);
            let exit_x = sensor_x + inside_share * (x - sensor_x);
            let exit_y = sensor_y + inside_share * (y - sensor_y);
            let exit_m2 = exit_x * exit_x + exit_y * exit_y;
            let seen_m2 = if outside { exit_m2 } else { flat_m2 };
            let under_m2 = if z > band { flat_m2 } else { seen_m2 };
            let within_reach = |m2: f32| if m2 < sweep.reach_m2 { m2 } else { sweep.reach_m2 };
            // Both comparisons are false for NaN, and no sensor reaches infinity: damaged coordinates are ignored.
            let known = !is_self && seen_m2 > sweep.self_m2 && flat_m2 < BEYOND_ANY_SENSOR_M2;
            self.known_m2[i] = if known { within_reach(seen_m2) } else { 0.0 };
            self.under_m2[i] = if known { within_reach(under_m2) } else { 0.0 };
            self.bin[i] = bin_of(bearing_sectors(x, y));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Envelope, SweepTransform};
    use jink_shared_types::Timestamp;
    use jink_shared_types::pose_history::Pose;
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose> {
        (
            -0.4..0.4f64,
            -0.4..0.4f64,
            -0.4..0.4f64,
            -0.5..0.5f64,
            -0.5..0.5f64,
        )
            .prop_map(|(roll, pitch, yaw, x, z)| Pose {
                position_m: Vector3::new(x, 0.0, z),
                local_q_body: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            })
    }

    proptest! {
        // One in five is inside the band.
        #![proptest_config(ProptestConfig::with_cases(2048))]

        #[test]
        fn the_quick_test_misses_nothing_inside_the_band(
            first in pose(), last in pose(), azimuth in -3.2..3.2f32, down in -0.3..0.3f32,
            range in 0.5..20.0f32, share in 0.0..=1.0f32,
        ) {
            let envelope = Envelope { radius_m: 0.3, band_half_m: 0.5 };
            let times = [Timestamp::from_seconds(1.0), Timestamp::from_seconds(1.1)];
            let sweep = SweepTransform::new((times[0], &first), (times[1], &last), Vector3::new(0.1, 0.0, -0.1), 20.0, envelope);
            let end_m = [range * azimuth.cos() * down.cos(), range * azimuth.sin() * down.cos(), range * down.sin()];
            let height_m = sweep.level_component(2, end_m, share);
            let is_inside = height_m.abs() < 0.499;
            prop_assert!(!is_inside || sweep.near_band(20.0).holds(end_m));
        }
    }
}
