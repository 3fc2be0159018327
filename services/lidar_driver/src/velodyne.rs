//! Velodyne VLP-16 (Puck), Puck LITE, Puck Hi-Res: data packets of 1206 bytes.
//!
//! Source: VLP-16 user manual 63-9243 Rev. E, chapter 9 ("Sensor Data"), and its appendix on the Hi-Res.
//!
//! | bytes | hold |
//! |---|---|
//! | 12 x 100 | data blocks: 0xFFEE, azimuth (0.01 deg), 32 x (range in 2 mm, reflectivity): two firings of sixteen lasers |
//! | 4 | microseconds after the full hour |
//! | 2 | return mode (0x37 strongest, 0x38 last, 0x39 dual), product (0x22 VLP-16, 0x24 Hi-Res) |
//!
//! A laser fires every 2.304 us, the sixteen of them every 55.296 us. A block holds the azimuth of its first firing;
//! that of any other follows from the time since, and from the angle between blocks. In dual mode two blocks share
//! their azimuth: the last return, then the strongest, or the second strongest where the last is the strongest.
//!
//! **Position**, in the sensor's coordinates (x right, y forward, z up; the azimuth counts clockwise from y): x = r cos
//! w sin a, y = r cos w cos a, z = r sin w + the laser's vertical correction. The sensor frame here is x forward, y
//! left, z up, like that of the other lidars: (y, -x, z).
//!
//! **What can be detected.** There is no checksum and no number: marks, azimuths and stamps that do not follow each
//! other are. A range of zero is no return.

use crate::decode::{Decode, Echo, Fault, Item, OVERTAKEN_US, Ray, bytes_at, u16_at, u32_at};

/// Elevation (deg) and vertical correction (mm) of the sixteen lasers, in the order in which they fire.
pub type Lasers = [[f64; 2]; LASERS];

/// Those of a VLP-16 and of a Puck LITE.
pub const VLP16_LASERS: Lasers = [
    [-15.0, 11.2],
    [1.0, -0.7],
    [-13.0, 9.7],
    [3.0, -2.2],
    [-11.0, 8.1],
    [5.0, -3.7],
    [-9.0, 6.6],
    [7.0, -5.1],
    [-7.0, 5.1],
    [9.0, -6.6],
    [-5.0, 3.7],
    [11.0, -8.1],
    [-3.0, 2.2],
    [13.0, -9.7],
    [-1.0, 0.7],
    [15.0, -11.2],
];
/// Those of a Puck Hi-Res.
pub const HI_RES_LASERS: Lasers = [
    [-10.0, 7.4],
    [0.667, -0.9],
    [-8.667, 6.5],
    [2.0, -1.8],
    [-7.333, 5.5],
    [3.333, -2.7],
    [-6.0, 4.6],
    [4.667, -3.7],
    [-4.667, 3.7],
    [6.0, -4.6],
    [-3.333, 2.7],
    [7.333, -5.5],
    [-2.0, 1.8],
    [8.667, -6.5],
    [-0.667, 0.9],
    [10.0, -7.4],
];

/// Of a data packet, and of a position packet.
pub const PACKET_BYTES: usize = 1_206;
const POSITION_BYTES: usize = 512;
const BLOCKS: usize = 12;
const BLOCK_BYTES: usize = 100;
const LASERS: usize = 16;
const MARK: [u8; 2] = [0xFF, 0xEE];
/// Where the stamp, the return mode and the product stand.
const STAMP_AT: usize = 1_200;
const MODE_AT: usize = 1_204;
const PRODUCT_AT: usize = 1_205;
const STRONGEST: u8 = 0x37;
const LAST: u8 = 0x38;
const DUAL: u8 = 0x39;
const VLP16: u8 = 0x22;
const HI_RES: u8 = 0x24;
/// A turn (0.01 deg).
const TURN_CDEG: u32 = 36_000;
/// Time of one laser and of all sixteen (ns).
const LASER_NS: f64 = 2_304.0;
const FIRING_NS: f64 = 55_296.0;
/// Full scale of the stamp (us).
const HOUR_US: i64 = 3_600_000_000;
/// Where the clock without hours begins (ns): so far from zero that no step of the sensor's clock leads there.
const BEGIN_NS: u64 = 1 << 60;
/// Fastest and slowest turn (0.01 deg per block of two firings): 20 Hz and some, to standing still.
const STEP_CDEG: std::ops::RangeInclusive<u32> = 0..=120;

/// Decodes the packets of one sensor.
#[derive(Clone, Debug)]
pub struct Velodyne {
    product: u8,
    /// Cosine and sine of the elevation of every laser, and its vertical correction (m).
    lasers: [[f32; 3]; LASERS],
    /// Laser number by elevation, lowest first.
    rows: [u16; LASERS],
    /// Stamp of the packet before (us), and the nanoseconds that it came to.
    last: Option<(u32, u64)>,
    /// Azimuth of the firing before (0.01 deg), and the firing's number in the turn.
    azimuth: Option<f64>,
    column: u32,
    open: bool,
    lost: u32,
}

impl Velodyne {
    /// For a sensor with these lasers.
    pub fn new(table: &Lasers) -> Self {
        let lasers = table.map(|[elevation_deg, correction_mm]| {
            let (sin, cos) = elevation_deg.to_radians().sin_cos();
            [cos as f32, sin as f32, (correction_mm * 1e-3) as f32]
        });
        let rank = |laser: usize| table.iter().filter(|other| other[0] < table[laser][0]).count() as u16;
        Self {
            product: if table == &HI_RES_LASERS { HI_RES } else { VLP16 },
            lasers,
            rows: std::array::from_fn(rank),
            last: None,
            azimuth: None,
            column: 0,
            open: false,
            lost: 0,
        }
    }

    /// Whether the packet is one of this sensor and sound as far as can be checked; the angle between its firings (0.01
    /// deg).
    fn check(&self, bytes: &[u8]) -> Result<f64, Fault> {
        if bytes.len() != PACKET_BYTES {
            return Err(if bytes.len() == POSITION_BYTES {
                Fault::Other
            } else {
                Fault::Foreign
            });
        }
        if bytes[PRODUCT_AT] != self.product || !matches!(bytes[MODE_AT], STRONGEST | LAST | DUAL) {
            return Err(Fault::Foreign);
        }
        let dual = bytes[MODE_AT] == DUAL;
        let azimuth = |block: usize| u32::from(u16_at(bytes, block * BLOCK_BYTES + 2));
        let stamp_us = u32_at(bytes, STAMP_AT);
        let marked = (0..BLOCKS)
            .all(|block| bytes_at::<2>(bytes, block * BLOCK_BYTES) == MARK && azimuth(block) < TURN_CDEG);
        if !marked || i64::from(stamp_us) >= HOUR_US {
            return Err(Fault::Damaged);
        }
        let step = |block: usize| (azimuth(block) + TURN_CDEG - azimuth(block - 1)) % TURN_CDEG;
        let sound = (1..BLOCKS).all(|block| {
            if dual && block % 2 == 1 {
                step(block) == 0
            } else {
                STEP_CDEG.contains(&step(block))
            }
        });
        if !sound {
            return Err(Fault::Damaged);
        }
        let turned = (azimuth(BLOCKS - 1) + TURN_CDEG - azimuth(0)) % TURN_CDEG;
        // Between the first and the last block there are 22 firings, in dual mode 10.
        let firings = if dual { BLOCKS - 2 } else { 2 * (BLOCKS - 1) };
        Ok(f64::from(turned) / firings as f64)
    }

    /// The stamp on a clock that does not begin anew every hour. `follows`: by its azimuth it is the packet after the last
    /// one, whatever its stamp says.
    fn unwrapped_ns(&mut self, stamp_us: u32, packet_ns: f64, follows: bool) -> Result<u64, Fault> {
        let Some((last_us, last_ns)) = self.last else {
            self.last = Some((stamp_us, BEGIN_NS));
            return Ok(BEGIN_NS);
        };
        // The shorter way around the hour.
        let ahead_us =
            (i64::from(stamp_us) - i64::from(last_us) + HOUR_US / 2).rem_euclid(HOUR_US) - HOUR_US / 2;
        if ahead_us == 0 {
            return Err(Fault::Doubled);
        }
        if (-OVERTAKEN_US..0).contains(&ahead_us) {
            return Err(Fault::Late);
        }
        // A longer step backwards is a clock that was set; the mapping of stamps handles that.
        if !follows {
            let missing = ahead_us.max(0) as f64 * 1e3 / packet_ns - 1.0;
            let missing = missing.round().clamp(0.0, 10_000.0) as u32;
            self.lost = self.lost.saturating_add(missing);
        }
        let ns = last_ns.saturating_add_signed(ahead_us * 1_000);
        self.last = Some((stamp_us, ns));
        Ok(ns)
    }

    /// Whether the firing at `azimuth_cdeg` is the one after the last, but for half a packet of `firings`.
    fn follows(&self, azimuth_cdeg: f64, step_cdeg: f64, firings: usize) -> bool {
        let turn = f64::from(TURN_CDEG);
        self.azimuth.is_some_and(|before| {
            let ahead = (azimuth_cdeg - before - step_cdeg + turn / 2.0).rem_euclid(turn) - turn / 2.0;
            ahead.abs() < 0.5 * step_cdeg * firings as f64
        })
    }

    /// Begins the next firing, and the next scan where the azimuth passes zero.
    fn turn_to(&mut self, azimuth_cdeg: f64, sink: &mut dyn FnMut(Item)) {
        let turn = f64::from(TURN_CDEG);
        let azimuth = azimuth_cdeg.rem_euclid(turn);
        if self.azimuth.is_some_and(|before| azimuth < before - turn / 2.0) {
            self.finish(sink);
        }
        self.azimuth = Some(azimuth);
        self.column += u32::from(self.open);
        self.open = true;
    }

    /// The ranges of one firing: of each laser one, in dual mode two, from `at` on and a block later.
    fn ranges(&self, bytes: &[u8], at: usize, echoes: u8, firing: &Firing, sink: &mut dyn FnMut(Item)) {
        for laser in 0..LASERS {
            let since_ns = laser as f64 * LASER_NS;
            let azimuth_rad = ((firing.azimuth_cdeg + since_ns * firing.cdeg_per_ns) * 0.01).to_radians();
            let (sin_a, cos_a) = azimuth_rad.sin_cos();
            let (sin_a, cos_a) = (sin_a as f32, cos_a as f32);
            let [cos, sin, up_m] = self.lasers[laser];
            for echo in 0..echoes {
                let at = at + usize::from(echo) * BLOCK_BYTES + 3 * laser;
                sink(Item::Ray(Ray {
                    row: self.rows[laser],
                    column: self.column,
                    stamp_ns: firing.begin_ns + since_ns as u64,
                    range_m: f32::from(u16_at(bytes, at)) * 0.002,
                    base_m: [0.0, 0.0, up_m],
                    direction: [cos * cos_a, -cos * sin_a, sin],
                    echo: Echo {
                        index: echo,
                        count: echoes,
                    },
                }));
            }
        }
    }
}

/// All sixteen lasers once.
#[derive(Clone, Copy, Debug)]
struct Firing {
    begin_ns: u64,
    azimuth_cdeg: f64,
    cdeg_per_ns: f64,
}

impl Decode for Velodyne {
    fn packet(&mut self, bytes: &[u8], sink: &mut dyn FnMut(Item)) -> Result<(), Fault> {
        let step_cdeg = self.check(bytes)?;
        let echoes = if bytes[MODE_AT] == DUAL { 2 } else { 1 };
        let pairs = BLOCKS / usize::from(echoes);
        let follows = self.follows(f64::from(u16_at(bytes, 2)), step_cdeg, 2 * pairs);
        let base_ns = self.unwrapped_ns(u32_at(bytes, STAMP_AT), 2.0 * pairs as f64 * FIRING_NS, follows)?;
        let last_ns = base_ns + ((2 * pairs - 1) as f64 * FIRING_NS + (LASERS - 1) as f64 * LASER_NS) as u64;
        sink(Item::Packet {
            first_ns: base_ns,
            last_ns,
        });
        for pair in 0..pairs {
            let at = pair * usize::from(echoes) * BLOCK_BYTES;
            for half in 0..2 {
                let firing = Firing {
                    begin_ns: base_ns + ((2 * pair + half) as f64 * FIRING_NS) as u64,
                    azimuth_cdeg: f64::from(u16_at(bytes, at + 2)) + half as f64 * step_cdeg,
                    cdeg_per_ns: step_cdeg / FIRING_NS,
                };
                self.turn_to(firing.azimuth_cdeg, sink);
                self.ranges(bytes, at + 4 + half * 3 * LASERS, echoes, &firing, sink);
            }
        }
        Ok(())
    }

    fn restart(&mut self) {
        self.last = None;
        self.azimuth = None;
        self.column = 0;
        self.open = false;
        self.lost = 0;
    }

    fn finish(&mut self, sink: &mut dyn FnMut(Item)) {
        if std::mem::take(&mut self.open) {
            self.column = 0;
            self.azimuth = None;
            let lost = std::mem::take(&mut self.lost);
            sink(Item::ScanEnds { lost });
        }
    }
}
