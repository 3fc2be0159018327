//! Point clouds: every point is the end of one narrow ray.

use crate::rays::RayTracer;
use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};

impl RayTracer<'_> {
    /// Enters every point of `cloud`.
    pub fn cloud(&mut self, cloud: &PointCloud) {
        self.sweep.begin(cloud.first_point);
        let (last, first) = cloud.points().split_at(self.first_ray(cloud.points().len()));
        for point in first.iter().chain(last) {
            match point.kind.get() {
                RayKind::Unknown => {}
                RayKind::Hit => self.cloud_point(point, true),
                RayKind::Clear => self.cloud_point(point, false),
            }
        }
    }

    #[inline]
    fn cloud_point(&mut self, point: &CloudPoint, is_hit: bool) {
        let body_m = [point.forward_m, point.right_m, point.down_m];
        if is_hit && self.limits.is_self(body_m) {
            self.counters.self_hits += 1;
            return;
        }
        if !self.set_time(point.offset_10us) {
            return;
        }
        let range_m = self.limits.range_m(body_m);
        let is_beyond = self.limits.is_beyond(range_m);
        let is_below = self.limits.is_below(range_m);
        let is_malformed = is_beyond | (is_below & !is_hit);
        self.counters.rays_malformed += u64::from(is_malformed);
        self.has_information |= !is_malformed;
        let clear_m = if is_beyond | is_below { 0.0 } else { range_m };
        self.enter(body_m, range_m, is_hit, clear_m);
    }
}
