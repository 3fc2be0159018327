//! A 3-D lidar: a sweep of rays in the directions of its [pattern](super::pattern), each from the pose at its own time.

use super::error::SensorError;
use super::head::{Answer, Beam, Head, HeadDefaults};
use super::pattern::Directions;
use super::pose::PoseCursor;
use super::products::{Pattern, product};
use super::spec::SensorSpec;
use crate::world::World;
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{CloudPoint, PointCloud};

/// Time unit of a point's offset (ns).
const TICK_NS: u64 = 10_000;

pub(super) const DEFAULT_RATE_HZ: f64 = 10.0;

#[derive(Clone, Debug)]
pub(super) struct Lidar3d {
    head: Head,
    beam: Beam,
    directions: Directions,
    /// The sweep under way: when it began, and what was measured so far.
    sweep_begin: Timestamp,
    sweep: Vec<CloudPoint>,
}

impl Lidar3d {
    pub fn new(spec: &SensorSpec, rig_seed: u64) -> Result<Self, SensorError> {
        let mut head = Head::new(
            spec,
            rig_seed,
            &HeadDefaults {
                range_m: [0.1, 12.0],
                sigma_m: 0.02,
                sigma_ratio: 0.0,
                sigma_per_m: 0.0,
                dropout: 0.0,
            },
        )?;
        let pattern = product(spec).map_or(Pattern::Even, |product| product.pattern);
        let directions = Directions::new(spec, pattern, &mut head)?;
        Ok(Self {
            beam: Beam::new(spec)?,
            sweep_begin: Timestamp::NEVER,
            sweep: Vec::with_capacity(directions.rays() as usize),
            directions,
            head,
        })
    }

    /// One sweep from `begin` to `end`. Rays are spread evenly over it, each from the pose at its own time as given
    /// by its offset.
    pub fn render(
        &mut self,
        world: &World,
        poses: &mut PoseCursor<'_>,
        begin: Timestamp,
        end: Timestamp,
        cloud: &mut PointCloud,
    ) {
        self.advance(world, poses, [begin, end], end);
        self.head.begin_cloud(cloud);
        cloud.first_point = begin;
        for point in &self.sweep {
            cloud.push(*point);
        }
        self.sweep.clear();
    }

    /// Measures the rays of the sweep over `span` that are due by `until` and were not measured yet: a real lidar, too,
    /// has most of a sweep behind it when the sweep ends.
    pub fn advance(
        &mut self,
        world: &World,
        poses: &mut PoseCursor<'_>,
        span: [Timestamp; 2],
        until: Timestamp,
    ) {
        let [begin, end] = span;
        if self.sweep_begin != begin {
            self.sweep_begin = begin;
            self.sweep.clear();
        }
        let ticks = end.ns_since(begin) / TICK_NS;
        let due_ticks = until.min(end).ns_since(begin) / TICK_NS;
        let mut view = None;
        let rays = self.directions.rays();
        for ray in self.sweep.len() as u64..rays {
            let tick = ray * ticks / rays;
            if tick > due_ticks {
                break;
            }
            let view = match &view {
                Some((at, view)) if *at == tick => view,
                _ => {
                    let time = Timestamp::from_ns(begin.ns + tick * TICK_NS);
                    &view.insert((tick, self.head.view(&poses.at(time)))).1
                }
            };
            let direction = self.directions.next();
            let direction = self.head.to_body(&direction);
            let hit = self.head.cast_beam(world, view, &direction, &self.beam);
            let dazzled_m = match hit {
                None => self.head.dazzled(world, view, &direction),
                Some(_) => None,
            };
            let answer = match self.head.answer(world, hit.as_ref()) {
                _ if dazzled_m.is_some() => dazzled_m.map_or(Answer::Unknown, Answer::Hit),
                _ if self.head.drops_out() || self.head.is_too_near(hit.as_ref()) => Answer::Unknown,
                Answer::Hit(range_m) => Answer::Hit(self.head.measured_m(range_m)),
                other => other,
            };
            self.sweep.push(self.head.point(&direction, answer, tick as u16));
        }
    }
}
