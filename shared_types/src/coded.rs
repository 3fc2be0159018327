//! Enums and booleans inside samples: one byte that may hold anything, read back as a value that cannot.
//!
//! A Rust enum in shared memory would be undefined behaviour if another process wrote an unknown discriminant.
//! [`Coded`] stores the byte and yields the enum's safest variant ([`Wire::UNKNOWN`]) for anything it does not know.

use crate::layout::{Layout, ZeroCopySend};
use crate::shape::{EnumShape, Shape};
use std::fmt;
use std::marker::PhantomData;

/// An enum that travels as one byte.
pub trait Wire: Copy + fmt::Debug + PartialEq + 'static {
    /// What an unknown byte is taken for: the variant that promises least.
    const UNKNOWN: Self;
    /// Its name, and every variant with its byte: part of the layout hash of each sample that holds one.
    const SHAPE: EnumShape;
    /// The byte of this variant.
    fn code(self) -> u8;
    /// The variant of `code`, if there is one.
    fn from_code(code: u8) -> Option<Self>;
    /// The variant's name in lower case with underscores, for logs and JSON.
    fn name(self) -> &'static str;
}

/// One byte holding a [`Wire`] enum.
#[repr(transparent)]
pub struct Coded<E> {
    code: u8,
    kind: PhantomData<E>,
}

impl<E: Wire> Coded<E> {
    /// Stores `value`.
    pub fn new(value: E) -> Self {
        Self {
            code: value.code(),
            kind: PhantomData,
        }
    }

    /// The stored value; [`Wire::UNKNOWN`] if the byte means nothing to this build.
    pub fn get(self) -> E {
        E::from_code(self.code).unwrap_or(E::UNKNOWN)
    }
}

impl<E: Wire> From<E> for Coded<E> {
    fn from(value: E) -> Self {
        Self::new(value)
    }
}
impl<E> Clone for Coded<E> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<E> Copy for Coded<E> {}
impl<E: Wire> Default for Coded<E> {
    fn default() -> Self {
        Self::new(E::UNKNOWN)
    }
}
impl<E: Wire> PartialEq for Coded<E> {
    fn eq(&self, other: &Self) -> bool {
        self.get() == other.get()
    }
}
impl<E: Wire> PartialEq<E> for Coded<E> {
    fn eq(&self, other: &E) -> bool {
        self.get() == *other
    }
}
impl<E: Wire> fmt::Debug for Coded<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.get())
    }
}

#[allow(unsafe_code)]
// SAFETY: a transparent u8.
unsafe impl<E: Wire> ZeroCopySend for Coded<E> {}
#[allow(unsafe_code)]
// SAFETY: a transparent u8; every pattern is read back through `from_code`.
unsafe impl<E: Wire> Layout for Coded<E> {
    const SHAPE: Shape = Shape::Enum(&E::SHAPE);
}

/// A boolean in a sample: zero is false, anything else true.
#[repr(transparent)]
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub struct Flag(u8);

impl Flag {
    /// False.
    pub const NO: Self = Self(0);
    /// True.
    pub const YES: Self = Self(1);

    /// Whether the flag is set.
    pub const fn is_set(self) -> bool {
        self.0 != 0
    }
}
impl From<bool> for Flag {
    fn from(value: bool) -> Self {
        Self(u8::from(value))
    }
}
impl fmt::Debug for Flag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.is_set())
    }
}
#[allow(unsafe_code)]
// SAFETY: a transparent u8.
unsafe impl ZeroCopySend for Flag {}
#[allow(unsafe_code)]
// SAFETY: a transparent u8, every pattern valid.
unsafe impl Layout for Flag {
    const SHAPE: Shape = Shape::Flag;
}

/// Declares a [`Wire`] enum: variants with their bytes and names; the first variant is what unknown bytes become.
#[macro_export]
macro_rules! wire_enum {
    (
        $(#[doc = $doc:literal])*
        pub enum $name:ident {
            $(#[doc = $first_doc:literal])* $first:ident = $first_code:literal $first_text:literal,
            $( $(#[doc = $variant_doc:literal])* $variant:ident = $code:literal $text:literal, )*
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(u8)]
        pub enum $name {
            $(#[doc = $first_doc])* $first = $first_code,
            $( $(#[doc = $variant_doc])* $variant = $code, )*
        }

        impl $crate::coded::Wire for $name {
            const UNKNOWN: Self = Self::$first;
            const SHAPE: $crate::shape::EnumShape = $crate::shape::EnumShape {
                name: stringify!($name),
                docs: &[$($doc),*],
                variants: &[
                    $crate::shape::VariantShape {
                        name: stringify!($first),
                        text: $first_text,
                        code: $first_code,
                        docs: &[$($first_doc),*],
                    },
                    $( $crate::shape::VariantShape {
                        name: stringify!($variant),
                        text: $text,
                        code: $code,
                        docs: &[$($variant_doc),*],
                    }, )*
                ],
            };
            fn code(self) -> u8 {
                self as u8
            }
            fn from_code(code: u8) -> Option<Self> {
                match code {
                    $first_code => Some(Self::$first),
                    $( $code => Some(Self::$variant), )*
                    _ => None,
                }
            }
            fn name(self) -> &'static str {
                match self {
                    Self::$first => $first_text,
                    $( Self::$variant => $text, )*
                }
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str($crate::coded::Wire::name(*self))
            }
        }
    };
}
