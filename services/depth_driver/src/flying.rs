//! Flying pixels: depths that hang in the air between a near and a far surface.
//!
//! At the edge of an object the correlation window of a stereo pair, like the pixel of a time-of-flight camera, covers
//! both surfaces, and the depth that comes out lies anywhere between them. A pixel is kept if it belongs to a square of
//! 2 x 2 pixels, any of the four around it, that have a depth each and lie on one surface: the inverse depths of the
//! four differ by no more than a limit. Of a plane the inverse depth is linear in column and row, so the limit sets how
//! steeply a surface may be looked at, the same at every depth; and a difference of inverse depths `k` is a difference
//! of depths `k z^2`, as the noise of stereo is. What is not kept becomes unknown.

/// Neighbouring depths that differ by no more than this (units of the depth image) lie on one surface, however near:
/// rounding.
const ROUNDING: f32 = 2.0;

/// The filter, with room for two rows.
#[derive(Clone, Debug)]
pub struct FlyingPixelFilter {
    width_px: usize,
    /// Greatest difference of inverse depths times the depth unit: of inverse raw depths.
    limit: f32,
    /// Lesser and greater depth of each column in the present row and the next.
    pairs: Vec<[u16; 2]>,
    /// Whether the square is one surface whose left column is the place less one: squares above and below the present
    /// row. Bytes instead of flags, and places at both ends that stay 0, so that the compiler handles several pixels at
    /// a time.
    above: Vec<u8>,
    below: Vec<u8>,
}

impl FlyingPixelFilter {
    /// For rows of `width_px`; `per_m` is the greatest difference of inverse depths on one surface (1/m), zero to keep
    /// everything; `depth_scale_m` the unit of the image (m).
    pub fn new(width_px: usize, per_m: f64, depth_scale_m: f64) -> Self {
        Self {
            width_px,
            limit: (per_m * depth_scale_m) as f32,
            pairs: vec![[0; 2]; width_px],
            above: vec![0; width_px + 1],
            below: vec![0; width_px + 1],
        }
    }

    /// Sets the flying pixels of `depths` (rows one after the other, 0 = unknown) to 0. Returns how many they were.
    pub fn remove(&mut self, depths: &mut [u16]) -> usize {
        if self.limit <= 0.0 || self.width_px < 2 {
            return 0;
        }
        let mut removed = 0;
        self.above.fill(0);
        let mut rest = depths;
        // A last row that is cut short belongs to no square: what is in it is left out by its reader.
        while rest.len() >= self.width_px {
            let (row, next) = rest.split_at_mut(self.width_px);
            match next.get(..self.width_px) {
                Some(next) => self.squares(row, next),
                None => self.below.fill(0),
            }
            removed += self.sweep(row);
            std::mem::swap(&mut self.above, &mut self.below);
            rest = next;
        }
        removed
    }

    /// Finds the squares between two rows that are one surface.
    fn squares(&mut self, row: &[u16], next: &[u16]) {
        for ((pair, upper), lower) in self.pairs.iter_mut().zip(row).zip(next) {
            *pair = [*upper.min(lower), *upper.max(lower)];
        }
        let columns = self.pairs.iter().zip(self.pairs.iter().skip(1));
        for ((left, right), is_one) in columns.zip(self.below.iter_mut().skip(1)) {
            let least = f32::from(left[0].min(right[0]));
            let most = f32::from(left[1].max(right[1]));
            let apart = most - least;
            let is_near = (apart <= self.limit * least * most) | (apart <= ROUNDING);
            *is_one = u8::from((least > 0.0) & is_near);
        }
    }

    fn sweep(&self, row: &mut [u16]) -> usize {
        let mut removed = 0u32;
        let above = self.above.iter().zip(self.above.iter().skip(1));
        let below = self.below.iter().zip(self.below.iter().skip(1));
        for ((depth, above), below) in row.iter_mut().zip(above).zip(below) {
            let kept = above.0 | above.1 | below.0 | below.1;
            let left = *depth * u16::from(kept);
            removed = removed.wrapping_add(u32::from(left != *depth));
            *depth = left;
        }
        removed as usize
    }
}
