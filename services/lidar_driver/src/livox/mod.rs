//! Livox lidars: their patterns have no turns, so a scan is what they measure in a fixed time.
//!
//! | module | holds |
//! |---|---|
//! | [`sdk2`] | point data of the second protocol (Mid-360) |
//! | [`sdk1`] | point data of the first protocol (Avia) |

//! | [`control`] | what is sent to a sensor so that it sends points, and what it answers |
//! | [`crc`] | the checksums of both |

pub mod control;
pub mod crc;
pub mod sdk1;
pub mod sdk2;

use crate::decode::Item;

/// Cuts a stream without turns into scans of equal length by the stamps of its packets.
#[derive(Clone, Copy, Debug)]
struct ScanSplitter {
    period_ns: u64,
    /// When the present scan began (ns, the sensor's clock).
    begun_ns: Option<u64>,
    /// Points of it so far.
    points: u32,
    lost: u32,
}

impl ScanSplitter {
    fn new(rate_hz: f64) -> Self {
        Self {
            period_ns: (1e9 / rate_hz.max(0.1)) as u64,
            begun_ns: None,
            points: 0,
            lost: 0,
        }
    }

    /// A packet begins at `stamp_ns`: whether the scan before it ends there, too, is passed on.
    fn packet(&mut self, stamp_ns: u64, sink: &mut dyn FnMut(Item)) {
        match self.begun_ns {
            Some(begun_ns) if (begun_ns..begun_ns.saturating_add(self.period_ns)).contains(&stamp_ns) => {}
            Some(begun_ns) => {
                self.finish(sink);
                // Scans follow each other without a gap, unless the clock was set or packets are missing.
                let next_ns = begun_ns.saturating_add(self.period_ns);
                let follows = stamp_ns < next_ns.saturating_add(self.period_ns) && stamp_ns >= next_ns;
                self.begun_ns = Some(if follows { next_ns } else { stamp_ns });
            }
            None => self.begun_ns = Some(stamp_ns),
        }
    }

    fn finish(&mut self, sink: &mut dyn FnMut(Item)) {
        if self.begun_ns.take().is_some() {
            self.points = 0;
            let lost = std::mem::take(&mut self.lost);
            sink(Item::ScanEnds { lost });
        }
    }
}

/// Range (m) and direction of a Cartesian point (m); nothing at the origin.
fn polar(point_m: [f32; 3]) -> Option<(f32, [f32; 3])> {
    let [x, y, z] = point_m.map(f64::from);
    let range_m = (x * x + y * y + z * z).sqrt();
    (range_m > 0.0).then(|| (range_m as f32, [x, y, z].map(|part| (part / range_m) as f32)))
}

/// Direction of a spherical point: angle from the z axis and about it, both in 0.01 deg.
fn spherical(theta_cdeg: u16, phi_cdeg: u16) -> [f32; 3] {
    let (sin_theta, cos_theta) = (f64::from(theta_cdeg) * 0.01).to_radians().sin_cos();
    let (sin_phi, cos_phi) = (f64::from(phi_cdeg) * 0.01).to_radians().sin_cos();
    [sin_theta * cos_phi, sin_theta * sin_phi, cos_theta].map(|part| part as f32)
}
