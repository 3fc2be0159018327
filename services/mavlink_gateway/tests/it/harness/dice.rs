//! Bytes as decisions: every byte sequence is a valid story, and a small change of it is a small change of the story.

use mavlink::dialect::MavMessage;

/// Numbers at which arithmetic breaks first.
const SPECIAL: [f32; 16] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    -0.0,
    0.0,
    1.0e-45,
    1.0e6,
    -1.0e6,
    1.1e6,
    200.0,
    201.0,
    1.0e30,
    -1.0,
];

/// Reads decisions from bytes; zeros when they have run out.
#[derive(Clone, Debug)]
pub struct Dice<'a>(&'a [u8]);

impl<'a> Dice<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Up to `len` bytes.
    pub fn take(&mut self, len: usize) -> &'a [u8] {
        let (taken, rest) = self.0.split_at(len.min(self.0.len()));
        self.0 = rest;
        taken
    }

    fn array<const N: usize>(&mut self) -> [u8; N] {
        let mut array = [0; N];
        let taken = self.take(N);
        array[..taken.len()].copy_from_slice(taken);
        array
    }

    pub fn byte(&mut self) -> u8 {
        u8::from_le_bytes(self.array())
    }

    pub fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.array())
    }

    pub fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.array())
    }

    pub fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.array())
    }

    /// Below `end`.
    pub fn below(&mut self, end: u8) -> u8 {
        self.byte() % end
    }

    /// Once in `times`.
    pub fn once_in(&mut self, times: u8) -> bool {
        self.below(times) == times - 1
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[usize::from(self.byte()) % from.len()]
    }

    /// Mostly of the size of a flight, at times one that nobody means.
    pub fn number(&mut self) -> f32 {
        match self.below(8) {
            0 => self.pick(&SPECIAL),
            1 => f32::from_bits(self.u32()),
            _ => f32::from(self.byte() as i8) * 0.25,
        }
    }

    /// Of the size of a flight.
    pub fn metres(&mut self) -> f64 {
        f64::from(self.byte() as i8) * 0.125
    }

    /// The id of a message of the dialect.
    pub fn known_id(&mut self) -> u32 {
        self.pick(MavMessage::all_ids())
    }
}
