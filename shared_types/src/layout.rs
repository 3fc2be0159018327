//! Layout hashes: two builds that disagree about a sample refuse to talk instead of misreading each other.
//!
//! iceoryx2 compares a payload's type name, size and alignment, but not its fields. The [`sample!`](crate::sample!)
//! macro therefore describes every sample as a [`Shape`], and folds it into a 64-bit hash that is part of the type
//! name (`jink.VehicleState#9f3c0d52a7b1e684`). A field, an enum's code or a constant that has changed changes the
//! name, and the topic does not open.
//!
//! `unsafe` here, and in the few types that samples are made of, asserts what every sample guarantees by construction:
//! `repr(C)`, no padding, no pointers, every bit pattern valid.
#![allow(unsafe_code)]

use crate::shape::Shape;
pub use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;

/// A type whose memory layout can be compared between builds.
///
/// # Safety
/// The implementor is `repr(C)`, holds no pointer and no padding, and every bit pattern is a valid value: a sample
/// that another process filled with garbage may be nonsense, but reading it is never undefined behaviour. Its
/// [`SHAPE`](Layout::SHAPE) says what its memory holds.
pub unsafe trait Layout: ZeroCopySend + std::fmt::Debug + 'static {
    /// What it looks like in memory.
    const SHAPE: Shape;

    /// A number that two builds have in common if they read the same into the same bytes.
    const LAYOUT_HASH: u64 = Self::SHAPE.hash();

    /// Whether a consumer can use it: what must be finite is, and its parts fit together. Samples that say nothing else
    /// are always plausible.
    fn is_plausible(&self) -> bool {
        true
    }
}

/// The memory of a sample, as other languages and tools read it.
pub fn bytes_of<T: Layout>(sample: &T) -> &[u8] {
    // SAFETY: a `Layout` has no padding, so that each of its bytes is initialised; the borrow keeps it alive.
    unsafe { std::slice::from_raw_parts(std::ptr::from_ref(sample).cast::<u8>(), size_of::<T>()) }
}

/// A sample whose memory held `bytes`; what they lack at its end is zero.
pub fn from_bytes<T: Layout>(bytes: &[u8]) -> Box<T> {
    let used = bytes.len().min(size_of::<T>());
    let mut sample = Box::<T>::new_uninit();
    let memory = sample.as_mut_ptr().cast::<u8>();
    // SAFETY: `memory` has room for `size_of::<T>()` bytes and is nobody else's, all of them are written, and every bit pattern of a
    // `Layout` is a valid value.
    unsafe {
        memory.write_bytes(0, size_of::<T>());
        memory.copy_from_nonoverlapping(bytes.as_ptr(), used);
        sample.assume_init()
    }
}

// SAFETY: an array of such elements adds neither padding nor invalid patterns.
unsafe impl<T: Layout, const N: usize> Layout for [T; N] {
    const SHAPE: Shape = Shape::Array {
        of: &T::SHAPE,
        len: N,
    };
}

/// Upper bound of a sample's type name: `jink.` + name + `#` + 16 hexadecimal digits.
pub const TYPE_NAME_CAPACITY: usize = 64;

/// Writes `jink.<name>#<hash>` into a fixed buffer; returns it with the number of bytes used.
pub const fn type_name_bytes(name: &str, hash: u64) -> ([u8; TYPE_NAME_CAPACITY], usize) {
    let prefix = b"jink.";
    let name = name.as_bytes();
    let mut out = [0u8; TYPE_NAME_CAPACITY];
    let mut used = 0;
    let mut i = 0;
    while i < prefix.len() {
        out[used] = prefix[i];
        used += 1;
        i += 1;
    }
    i = 0;
    while i < name.len() {
        out[used] = name[i];
        used += 1;
        i += 1;
    }
    out[used] = b'#';
    used += 1;
    i = 0;
    while i < 16 {
        let nibble = ((hash >> (60 - 4 * i)) & 0xf) as u8;
        out[used] = if nibble < 10 {
            b'0' + nibble
        } else {
            b'a' + nibble - 10
        };
        used += 1;
        i += 1;
    }
    (out, used)
}

/// Declares a sample (or a part of one): a `repr(C)` struct with its [`Shape`], its type name for iceoryx2 and a
/// compile-time proof that it has no padding and exactly the stated size in bytes.
///
/// `means` lists the constants that its numbers depend on, with their types (`f64`, `usize`, or `texts` for a list of
/// names): they are part of the layout hash. `plausible if` names the method behind [`Layout::is_plausible`].
///
/// ```
/// /// Degrees per count.
/// const STEP_DEG: f64 = 0.25;
///
/// jink_shared_types::sample! {
///     /// Air temperature.
///     #[derive(Clone, Copy, Debug, Default, PartialEq)]
///     pub struct Temperature: 8 {
///         /// Counts above -273.25 degrees Celsius, at most 4000.
///         pub counts: u32,
///         /// Room for later fields, zero.
///         pub reserved: jink_shared_types::Reserved<4>,
///     }
///     means { STEP_DEG: f64 }
///     plausible if Self::is_air
/// }
///
/// impl Temperature {
///     fn is_air(&self) -> bool {
///         self.counts <= 4000
///     }
/// }
/// # use jink_shared_types::layout::Layout;
/// assert!(Temperature::default().is_plausible());
/// ```
#[macro_export]
macro_rules! sample {
    (
        $(#[doc = $doc:literal])*
        $(#[derive($($derive:path),* $(,)?)])?
        pub struct $name:ident: $size:literal {
            $( $(#[doc = $field_doc:literal])* pub $field:ident: $type:ty, )*
        }
        $( means { $( $constant:ident: $constant_type:ident ),* $(,)? } )?
        $( plausible if $plausible:path )?
    ) => {
        $(#[doc = $doc])*
        $(#[derive($($derive),*)])?
        #[repr(C)]
        pub struct $name {
            $( $(#[doc = $field_doc])* pub $field: $type, )*
        }

        const _: () = assert!(
            size_of::<$name>() == $size,
            concat!("the size of ", stringify!($name), " is part of the contract and has changed")
        );
        const _: () = assert!(
            0 $( + size_of::<$type>() )* == size_of::<$name>(),
            concat!(stringify!($name), " has padding: make it explicit")
        );

        #[allow(unsafe_code)]
        // SAFETY: repr(C), no padding (asserted above), every field is itself `Layout`.
        unsafe impl $crate::layout::Layout for $name {
            const SHAPE: $crate::shape::Shape = $crate::shape::Shape::Struct(&$crate::shape::StructShape {
                name: stringify!($name),
                docs: &[$($doc),*],
                size: size_of::<$name>(),
                align: align_of::<$name>(),
                fields: &[$(
                    $crate::shape::FieldShape {
                        name: stringify!($field),
                        docs: &[$($field_doc),*],
                        offset: std::mem::offset_of!($name, $field),
                        size: size_of::<$type>(),
                        shape: <$type as $crate::layout::Layout>::SHAPE,
                    },
                )*],
                means: &[$($(
                    $crate::shape::Meaning {
                        name: stringify!($constant),
                        value: $crate::shape::Value::$constant_type(&$constant),
                    },
                )*)?],
            });

            $( fn is_plausible(&self) -> bool {
                $plausible(self)
            } )?
        }

        #[allow(unsafe_code)]
        // SAFETY: self-contained, repr(C), no pointers: see `Layout`.
        unsafe impl $crate::layout::ZeroCopySend for $name {
            unsafe fn type_name() -> &'static str {
                const NAME: ([u8; $crate::layout::TYPE_NAME_CAPACITY], usize) = $crate::layout::type_name_bytes(
                    stringify!($name),
                    <$name as $crate::layout::Layout>::LAYOUT_HASH,
                );
                static BYTES: [u8; $crate::layout::TYPE_NAME_CAPACITY] = NAME.0;
                std::str::from_utf8(&BYTES[..NAME.1]).unwrap_or(stringify!($name))
            }
        }
    };
}

/// The name under which iceoryx2 knows a sample type, layout hash included.
pub fn type_name<T: Layout>() -> &'static str {
    // SAFETY: the method only reads a constant; its contract concerns the implementor.
    unsafe { <T as ZeroCopySend>::type_name() }
}

#[cfg(test)]
mod tests;
