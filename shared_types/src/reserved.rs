//! Room in a sample for fields that are not thought of yet.
//!
//! A build without the field has [`Reserved<16>`](Reserved) where a newer one has [`Added<f64>`](Added) and
//! `Reserved<8>`. Neither is part of the layout hash, so both builds open each other's topics: the old producer
//! writes zeros, which the new reader takes for "not given"; what the new producer writes, the old reader does not
//! look at.
//!
//! A field that was added once keeps its bytes and its meaning. The size of the whole sample, its alignment and the
//! offsets of all other fields are in the hash and do not change.

use crate::layout::{Layout, ZeroCopySend};
use crate::shape::Shape;
use std::fmt;

/// `N` bytes that are zero: padding up to the next field's alignment, or room for later fields. Who fills a sample in
/// place leaves them zero.
#[repr(transparent)]
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Reserved<const N: usize>([u8; N]);

impl<const N: usize> Reserved<N> {
    /// What they always are.
    pub const ZERO: Self = Self([0; N]);
}
impl<const N: usize> Default for Reserved<N> {
    fn default() -> Self {
        Self::ZERO
    }
}
impl<const N: usize> fmt::Debug for Reserved<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{N} bytes")
    }
}

#[allow(unsafe_code)]
// SAFETY: transparent bytes.
unsafe impl<const N: usize> ZeroCopySend for Reserved<N> {}
#[allow(unsafe_code)]
// SAFETY: transparent bytes: no padding, every pattern valid.
unsafe impl<const N: usize> Layout for Reserved<N> {
    const SHAPE: Shape = Shape::Reserved(N);
}

/// A field in bytes that were [`Reserved`] once. A value whose bytes are all zero cannot be distinguished from an
/// absent one: choose a representation in which zero says the same as "not given".
#[repr(transparent)]
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Added<T>(T);

impl<T: Layout + Copy> Added<T> {
    /// A value that is given.
    pub const fn new(value: T) -> Self {
        Self(value)
    }

    /// The value; `None` if the producer knows nothing of the field, or left it zero.
    pub fn get(&self) -> Option<T> {
        #[allow(unsafe_code)]
        // SAFETY: `Layout` promises a type without padding, so each of its bytes is initialised.
        let bytes =
            unsafe { std::slice::from_raw_parts(std::ptr::from_ref(&self.0).cast::<u8>(), size_of::<T>()) };
        bytes.iter().any(|byte| *byte != 0).then_some(self.0)
    }
}
impl<T: Layout + Copy> Default for Added<T> {
    /// Absent.
    fn default() -> Self {
        #[allow(unsafe_code)]
        // SAFETY: `Layout` promises that every bit pattern, zero included, is a valid value.
        Self(unsafe { std::mem::zeroed() })
    }
}
impl<T: Layout + Copy> fmt::Debug for Added<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.get() {
            Some(value) => write!(f, "{value:?}"),
            None => f.write_str("not given"),
        }
    }
}

#[allow(unsafe_code)]
// SAFETY: a transparent `T`.
unsafe impl<T: Layout> ZeroCopySend for Added<T> where Added<T>: fmt::Debug {}
#[allow(unsafe_code)]
// SAFETY: a transparent `T`, which is `Layout` itself.
unsafe impl<T: Layout + Copy> Layout for Added<T> {
    const SHAPE: Shape = Shape::Added(&T::SHAPE);
}

#[cfg(test)]
mod tests {
    use super::Added;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_given_is_read_and_zero_is_absent(bits in any::<u64>()) {
            let added = Added::new(f64::from_bits(bits));
            prop_assert_eq!(added.get().map(f64::to_bits), (bits != 0).then_some(bits));
        }
    }

    #[test]
    fn nothing_is_given_by_default() {
        assert_eq!(Added::<f64>::default().get(), None);
        assert_eq!(Added::<[u32; 3]>::default().get(), None);
        assert_eq!(Added::new([0, 0, 1u32]).get(), Some([0, 0, 1]));
    }
}
