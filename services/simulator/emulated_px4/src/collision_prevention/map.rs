//! The fused map: one distance per bin, and the rule which reading it keeps.
//!
//! Bin `i` is centred on `5 i` degrees from the nose, clockwise, and reaches 2.5 degrees to either side.
//!
//! | distance (cm) | meaning |
//! |---|---|
//! | [`UNKNOWN_CM`] | no data |
//! | at least the range of the sensor that wrote it | nothing seen up to there; from then on an obstacle at that distance |
//! | anything else | an obstacle |

/// Bins of the map, and elements of a message.
pub const BINS: usize = 72;
/// Nothing is known of this bin or element.
pub const UNKNOWN_CM: u16 = u16::MAX;
/// Width of a bin (deg).
pub(super) const BIN_DEG: f32 = 5.0;
/// A message older than this is not read, a bin older than this is forgotten (us).
pub(super) const TIMEOUT_US: u64 = 500_000;

/// The map.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Distances (cm).
    pub distance_cm: [u16; BINS],
    /// The map's time when the bin was written last (us).
    pub written_us: [u64; BINS],
    /// Range of the sensor that wrote it (cm): it outlives the distance.
    pub range_cm: [u16; BINS],
    /// It was written once. Never taken back.
    pub seen: [bool; BINS],
    /// Smallest minimum of all sensors so far (cm).
    pub min_cm: u16,
    /// Largest range of all sensors so far (cm).
    pub max_cm: u16,
    /// Newest time of all messages so far (us).
    pub time_us: u64,
}

impl Default for Map {
    fn default() -> Self {
        Self {
            distance_cm: [UNKNOWN_CM; BINS],
            written_us: [0; BINS],
            range_cm: [0; BINS],
            seen: [false; BINS],
            min_cm: u16::MAX,
            max_cm: 0,
            time_us: 0,
        }
    }
}

/// Whether a bin that holds `bin_cm`, written by a sensor of range `bin_range_cm`, takes `reading_m` from a sensor of
/// range `range_m`.
///
/// A hit replaces "nothing there" and any hit of a sensor that reaches as far or further; "nothing there" replaces its
/// own sensor's hits, and "nothing there" of sensors that reach less far.
pub fn accepts(bin_cm: u16, bin_range_cm: u16, range_m: f32, reading_m: f32) -> bool {
    let range_cm = whole_cm(100.0 * range_m);
    let holds_hit = bin_cm < bin_range_cm;
    if reading_m < range_m {
        !holds_hit || range_cm <= bin_range_cm
    } else if holds_hit {
        range_cm == bin_range_cm
    } else {
        range_cm >= bin_range_cm
    }
}

/// Rounded to a whole number that wraps at 16 bits, as PX4's conversion does on the machine it was observed on.
pub(super) fn whole_cm(cm: f32) -> u16 {
    cm.round() as i32 as u16
}

impl Map {
    /// A sensor spoke: its time and range count for the whole map, whatever comes of its reading.
    pub(super) fn receive(&mut self, time_us: u64, min_cm: u16, max_cm: u16) {
        self.time_us = self.time_us.max(time_us);
        self.min_cm = self.min_cm.min(min_cm);
        self.max_cm = self.max_cm.max(max_cm);
    }

    /// Offers `reading_m` of a sensor of range `range_m` to a bin, which would then hold `distance_cm`.
    pub(super) fn offer(
        &mut self,
        bin: usize,
        range_m: f32,
        reading_m: f32,
        distance_cm: u16,
        range_cm: u16,
    ) {
        if accepts(self.distance_cm[bin], self.range_cm[bin], range_m, reading_m) {
            self.distance_cm[bin] = distance_cm;
            self.range_cm[bin] = range_cm;
            self.written_us[bin] = self.time_us;
            self.seen[bin] = true;
        }
    }

    /// Forgets bins that nobody wrote for half a second.
    pub(super) fn forget_stale(&mut self, now_us: u64) {
        for (distance_cm, written_us) in self.distance_cm.iter_mut().zip(&self.written_us) {
            if now_us.wrapping_sub(*written_us) > TIMEOUT_US {
                *distance_cm = UNKNOWN_CM;
            }
        }
    }

    /// Whether anything is known now.
    pub(super) fn is_present(&self, now_us: u64) -> bool {
        now_us.wrapping_sub(self.time_us) < TIMEOUT_US && self.distance_cm.iter().any(|cm| *cm != UNKNOWN_CM)
    }

    /// The closest bin, the first of several.
    pub(super) fn closest(&self) -> usize {
        let bins = self.distance_cm.iter().enumerate();
        bins.min_by_key(|(_, cm)| **cm).map_or(0, |(bin, _)| bin)
    }

    /// The distance of a bin (m).
    pub(super) fn distance_m(&self, bin: usize) -> f32 {
        f32::from(self.distance_cm[bin]) * 0.01
    }
}
