//! Layout hashes: two builds that disagree about a sample refuse to talk instead of misreading each other.
//!
//! iceoryx2 compares a payload's type name, size and alignment, but not its fields. The [`sample!`](crate::sample!) macro
//! therefore folds every field's name, offset, size and own layout into a 64-bit hash and makes it part of the
//! type name (`jink.VehicleState#9f3c0d52a7b1e684`). A changed field changes the name, and the topic does not open.
//!
//! This is the crate's only module with `unsafe`: it asserts, once, what every sample guarantees by construction
//! (`repr(C)`, no padding, no pointers, every bit pattern valid).
#![allow(unsafe_code)]

pub use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;

/// A type whose memory layout can be compared between builds.
///
/// # Safety
/// The implementor is `repr(C)`, holds no pointer and no padding, and every bit pattern is a valid value: a sample
/// that another process filled with garbage may be nonsense, but reading it is never undefined behaviour.
pub unsafe trait Layout: ZeroCopySend + std::fmt::Debug + 'static {
    /// Hash over names, offsets and layouts of all fields.
    const LAYOUT_HASH: u64;

    /// Whether a consumer can use it: what must be finite is, and its parts fit together. Samples that say nothing else
    /// are always plausible.
    fn is_plausible(&self) -> bool {
        true
    }
}

const FNV_OFFSET_BASIS: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

/// FNV-1a over `text`, continuing from `hash`. Source: Fowler, Noll, Vo, "The FNV hash".
pub const fn hash_text(mut hash: u64, text: &str) -> u64 {
    let bytes = text.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(FNV_PRIME);
        i += 1;
    }
    hash
}

/// FNV-1a over the eight little-endian bytes of `number`, continuing from `hash`.
pub const fn hash_number(mut hash: u64, number: u64) -> u64 {
    let bytes = number.to_le_bytes();
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(FNV_PRIME);
        i += 1;
    }
    hash
}

/// Starts a layout hash for the type called `name`.
pub const fn hash_start(name: &str, size: usize, align: usize) -> u64 {
    hash_number(
        hash_number(hash_text(FNV_OFFSET_BASIS, name), size as u64),
        align as u64,
    )
}

macro_rules! primitive_layout {
    ($($t:ty),*) => {$(
        // SAFETY: plain numbers have no padding and no invalid bit pattern.
        unsafe impl Layout for $t {
            const LAYOUT_HASH: u64 = hash_start(stringify!($t), size_of::<$t>(), align_of::<$t>());
        }
    )*};
}
primitive_layout!(u8, u16, u32, u64, i8, i16, i32, i64, f32, f64);

// SAFETY: an array of such elements adds neither padding nor invalid patterns.
unsafe impl<T: Layout, const N: usize> Layout for [T; N] {
    const LAYOUT_HASH: u64 = hash_number(hash_number(T::LAYOUT_HASH, N as u64), size_of::<T>() as u64);
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

/// Declares a sample (or a part of one): a `repr(C)` struct with its layout hash, its type name for iceoryx2 and a
/// compile-time proof that it has no padding and exactly the stated size in bytes.
///
/// ```
/// jink_shared_types::sample! {
///     /// Air temperature.
///     #[derive(Clone, Copy, Debug, Default, PartialEq)]
///     pub struct Temperature: 8 {
///         /// Degrees Celsius.
///         pub celsius: f64,
///     }
/// }
/// # use jink_shared_types::layout::Layout;
/// assert_ne!(Temperature::LAYOUT_HASH, 0);
/// ```
#[macro_export]
macro_rules! sample {
    (
        $(#[$meta:meta])*
        pub struct $name:ident: $size:literal {
            $( $(#[$field_meta:meta])* pub $field:ident: $type:ty, )*
        }
        $( plausible if $plausible:path )?
    ) => {
        $(#[$meta])*
        #[repr(C)]
        pub struct $name {
            $( $(#[$field_meta])* pub $field: $type, )*
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
            const LAYOUT_HASH: u64 = {
                let mut hash =
                    $crate::layout::hash_start(stringify!($name), size_of::<$name>(), align_of::<$name>());
                $(
                    hash = $crate::layout::hash_text(hash, stringify!($field));
                    hash = $crate::layout::hash_number(hash, std::mem::offset_of!($name, $field) as u64);
                    hash = $crate::layout::hash_number(hash, <$type as $crate::layout::Layout>::LAYOUT_HASH);
                )*
                hash
            };

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
mod tests {
    use super::{Layout, type_name};

    mod one {
        crate::sample! {
            /// Same name, fields a and b.
            #[derive(Clone, Copy, Debug)]
            pub struct Pair: 16 {
                /// first
                pub a: u64,
                /// second
                pub b: f64,
            }
        }
    }
    mod other {
        crate::sample! {
            /// Same name and size, fields swapped.
            #[derive(Clone, Copy, Debug)]
            pub struct Pair: 16 {
                /// first
                pub b: f64,
                /// second
                pub a: u64,
            }
        }
    }

    #[test]
    fn a_moved_field_changes_the_type_name() {
        assert_ne!(one::Pair::LAYOUT_HASH, other::Pair::LAYOUT_HASH);
        assert_ne!(type_name::<one::Pair>(), type_name::<other::Pair>());
    }

    #[test]
    fn the_type_name_carries_the_hash() {
        let name = type_name::<one::Pair>();
        assert_eq!(name, format!("jink.Pair#{:016x}", one::Pair::LAYOUT_HASH));
    }

    #[test]
    fn array_length_and_element_matter() {
        assert_ne!(<[u8; 4]>::LAYOUT_HASH, <[u8; 5]>::LAYOUT_HASH);
        assert_ne!(<[u32; 4]>::LAYOUT_HASH, <[f32; 4]>::LAYOUT_HASH);
    }
}
