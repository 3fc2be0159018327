//! The results of decoding a packet: rays in the sensor frame of the manual, stamped on the sensor's clock.
//!
//! | in | out |
//! |---|---|
//! | the payload of one UDP datagram | [`Item`]s, in the order of the packet, or a [`Fault`] |
//!
//! No decoder knows time, sockets or mountings. A packet is checked as a whole before its first ray leaves.

use std::fmt;

/// One measured direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Laser, beam or line, counted from 0.
    pub row: u16,
    /// Measurement id, firing or index in the scan.
    pub column: u32,
    /// When it was measured (ns), on the sensor's clock.
    pub stamp_ns: u64,
    /// The range as the sensor reports it (m); zero where nothing answered.
    pub range_m: f32,
    /// Where the beam begins, less what the reported range contains of it (m), sensor frame: the point is `base + range
    /// * direction`.
    pub base_m: [f32; 3],
    /// Direction of the beam, length 1, sensor frame.
    pub direction: [f32; 3],
    /// Which of the answers of one pulse this is, from 0; of how many.
    pub echo: Echo,
}

/// Answers of one pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Echo {
    /// This one, from 0: the order in which the sensor lists them.
    pub index: u8,
    /// How many the sensor reports of every pulse.
    pub count: u8,
}

impl Echo {
    /// The only answer.
    pub const ONLY: Self = Self { index: 0, count: 1 };
}

impl Ray {
    /// Where the ray is after `range_m` (m, sensor frame).
    pub fn at(&self, range_m: f32) -> [f32; 3] {
        let [x, y, z] = self.direction;
        let [bx, by, bz] = self.base_m;
        [bx + range_m * x, by + range_m * y, bz + range_m * z]
    }

    /// Whether something answered.
    pub fn is_return(&self) -> bool {
        self.range_m > 0.0
    }
}

/// What a packet holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Item {
    /// The scan that was begun before is complete; `lost` packets of it never came.
    ScanEnds {
        /// Packets that are missing in it.
        lost: u32,
    },
    /// The packet is sound. Its first and its last measurement (ns, the sensor's clock).
    Packet {
        /// Of its first measurement.
        first_ns: u64,
        /// Of its last measurement.
        last_ns: u64,
    },
    /// One measured direction.
    Ray(Ray),
}

/// Why a packet is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// It is no packet of this model in this configuration: its length or its marks are others.
    Foreign,
    /// Its checksum or its contents contradict themselves.
    Damaged,
    /// All of it was there before.
    Doubled,
    /// It belongs to a scan that has ended.
    Late,
    /// It is of the sensor and holds no ranges: positions, inertial data, status.
    Other,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Foreign => "foreign",
            Self::Damaged => "damaged",
            Self::Doubled => "doubled",
            Self::Late => "late",
            Self::Other => "without ranges",
        })
    }
}

/// Packets overtake each other by less than this (us). What is older by its stamp was sent after the sensor's clock was set.
pub(crate) const OVERTAKEN_US: i64 = 20_000;

/// A decoder of one model.
pub trait Decode {
    /// Takes the payload of one datagram and passes on what it holds.
    ///
    /// # Errors
    /// [`Fault`]; nothing was passed on then but, where the packet began a scan, the end of the one before.
    fn packet(&mut self, bytes: &[u8], sink: &mut dyn FnMut(Item)) -> Result<(), Fault>;

    /// Ends the scan that was begun, if there is one: nothing more has come for a while.
    fn finish(&mut self, sink: &mut dyn FnMut(Item));

    /// The stream begins anew: what comes next is neither late nor doubled. [`Self::finish`] comes first.
    fn restart(&mut self);
}

/// The `N` bytes at `at`; zeros beyond the end, which callers have excluded by the length.
pub(crate) fn bytes_at<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let slice = bytes.get(at..at + N);
    slice.and_then(|slice| slice.try_into().ok()).unwrap_or([0; N])
}

/// Little-endian numbers at `at`.
pub(crate) fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(bytes_at(bytes, at))
}
pub(crate) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes_at(bytes, at))
}
pub(crate) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes_at(bytes, at))
}
pub(crate) fn i16_at(bytes: &[u8], at: usize) -> i16 {
    i16::from_le_bytes(bytes_at(bytes, at))
}
pub(crate) fn i32_at(bytes: &[u8], at: usize) -> i32 {
    i32::from_le_bytes(bytes_at(bytes, at))
}
