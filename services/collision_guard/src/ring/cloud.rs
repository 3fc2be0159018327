//! From the points of a cloud to rays: every obstacle, and a sample of the rest.
//!
//! An obstacle point inside the height band must never be missed, so every point is tested for it. How far a sector is
//! free, in contrast, is the maximum over its rays: leaving rays out can only make it smaller. A large cloud has a
//! thousand rays per sector, of which some [`KNOWLEDGE_RAYS`]` / 72` give the same result.

use super::sweep::{NearBand, SectorCollector, SweepTransform};
use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};

/// How many rays of a cloud are used for the free range, about: some sixty per sector. With a quarter of them a lidar
/// of 64 rows, 28 degrees up and down, loses its level row in some sectors, which are then known half as far as they
/// could be; with eight times as many a cloud of 100 000 points costs twice the time.
const KNOWLEDGE_RAYS: usize = 4_096;
/// Units of [`CloudPoint::offset_10us`] in a second.
const OFFSETS_PER_S: f64 = 1e5;
/// Points per chunk.
const CHUNK: usize = 64;
/// Points whose marks are tested together, as the bytes of one number.
const GROUP: usize = 8;
/// Mark of a point that may lie in the height band.
const NEAR: u8 = 1;
/// Mark of a point that is used for the free range.
const ASKED: u8 = 2;
/// Golden ratio in 32-bit fixed point: multiples of it, modulo one, are spread evenly and follow no pattern that rows
/// or columns of a sensor could have (Weyl's sequence), so that no row is always left out.
const GOLDEN: u32 = 0x9e37_79b9;
/// The first multiples of it.
const SPREAD: [u32; CHUNK] = {
    let mut spread = [0; CHUNK];
    let mut i = 1;
    while i < CHUNK {
        spread[i] = GOLDEN.wrapping_mul(i as u32);
        i += 1;
    }
    spread
};

/// Adds the relevant points of `cloud` to `collector`.
pub fn collect(cloud: &PointCloud, sweep: &SweepTransform, collector: &mut SectorCollector) {
    let per_offset = if sweep.duration_s() > 0.0 {
        (1.0 / (OFFSETS_PER_S * sweep.duration_s())) as f32
    } else {
        0.0
    };
    let points = cloud.points();
    let share_asked = KNOWLEDGE_RAYS as f64 / points.len().max(1) as f64;
    let asked_below = (share_asked * f64::from(u32::MAX)) as u32;
    let mut filter = PointFilter {
        near_band: sweep.near_band(cloud.range_max_m),
        per_offset,
        asked_below,
        phase: 0,
    };
    let (chunks, rest) = points.as_chunks::<CHUNK>();
    for chunk in chunks {
        filter.pass(chunk, sweep, collector);
    }
    let mut last = [CloudPoint::default(); CHUNK];
    last[..rest.len()].copy_from_slice(rest);
    filter.pass(&last, sweep, collector);
}

/// Finds the relevant points. Loops over plain arrays without branches: see [`super::sweep`].
struct PointFilter {
    near_band: NearBand,
    per_offset: f32,
    asked_below: u32,
    phase: u32,
}

impl PointFilter {
    fn pass(&mut self, chunk: &[CloudPoint; CHUNK], sweep: &SweepTransform, collector: &mut SectorCollector) {
        let mut wanted = [0u8; CHUNK];
        for i in 0..CHUNK {
            let point = &chunk[i];
            let near = self
                .near_band
                .holds([point.forward_m, point.right_m, point.down_m]);
            let asked = self.phase.wrapping_add(SPREAD[i]) <= self.asked_below;
            wanted[i] = (u8::from(near) * NEAR) | (u8::from(asked) * ASKED);
        }
        self.phase = self.phase.wrapping_add(GOLDEN.wrapping_mul(CHUNK as u32));

        // Most points are not needed: whole groups are skipped with one comparison.
        let (groups, _) = wanted.as_chunks::<GROUP>();
        for (group, members) in groups.iter().enumerate() {
            let mut marks = u64::from_le_bytes(*members);
            while marks != 0 {
                let member = marks.trailing_zeros() as usize / 8;
                let why = (marks >> (8 * member)) as u8;
                marks &= !(0xff << (8 * member));
                self.push(&chunk[(group * GROUP + member) % CHUNK], why, sweep, collector);
            }
        }
    }

    #[inline(always)]
    fn push(&self, point: &CloudPoint, why: u8, sweep: &SweepTransform, collector: &mut SectorCollector) {
        let kind = point.kind.get();
        if why & ASKED != 0 || kind == RayKind::Hit {
            let end_m = [point.forward_m, point.right_m, point.down_m];
            let share = f32::from(point.offset_10us) * self.per_offset;
            let share = if share < 1.0 { share } else { 1.0 };
            collector.push(sweep, end_m, share, kind);
        }
    }
}
