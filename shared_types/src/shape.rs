//! What a sample looks like in memory, as data. The layout hash and the schemas for other languages are both made
//! from it, so they cannot disagree.
//!
//! What is in the hash: names, offsets and types of all fields, names and codes of enums, units and frames of
//! quantities, and the constants that the numbers depend on. What is not: comments, and the room that is kept for
//! later fields ([`crate::reserved`]).

use crate::hash::{START, number, text};

/// The type of one value in shared memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A number.
    Number(Number),
    /// [`Flag`](crate::Flag): one byte, zero is false, anything else true.
    Flag,
    /// [`Timestamp`](crate::Timestamp): nanoseconds of CLOCK_MONOTONIC in eight bytes, zero is never.
    Timestamp,
    /// One byte that holds a code of an enum.
    Enum(&'static EnumShape),
    /// Three f64: a vector in a frame.
    Quantity(QuantityShape),
    /// Four f64: a unit quaternion `w, x, y, z` that takes components in one frame to components in another.
    Rotation {
        /// Frame of what it is applied to.
        from: &'static str,
        /// Frame of what comes of it.
        to: &'static str,
    },
    /// As many of the same, without gaps.
    Array {
        /// What each is.
        of: &'static Shape,
        /// How many.
        len: usize,
    },
    /// Fields.
    Struct(&'static StructShape),
    /// So many bytes that are zero.
    Reserved(usize),
    /// A field in bytes that were reserved once: absent while all of them are zero.
    Added(&'static Shape),
}

macro_rules! numbers {
    ($( $name:ident = $type:ident, )*) => {
        /// The number types that samples are made of.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Number {
            $( #[doc = concat!("Rust's `", stringify!($type), "`.")] $name, )*
        }

        impl Number {
            /// Its name in Rust.
            pub const fn name(self) -> &'static str {
                match self {
                    $( Self::$name => stringify!($type), )*
                }
            }

            /// Bytes in memory.
            pub const fn size(self) -> usize {
                match self {
                    $( Self::$name => size_of::<$type>(), )*
                }
            }
        }

        $(
            #[allow(unsafe_code)]
            // SAFETY: plain numbers have no padding and no invalid bit pattern.
            unsafe impl crate::layout::Layout for $type {
                const SHAPE: Shape = Shape::Number(Number::$name);
            }
        )*
    };
}
numbers! {
    U8 = u8,
    U16 = u16,
    U32 = u32,
    U64 = u64,
    I8 = i8,
    I16 = i16,
    I32 = i32,
    I64 = i64,
    F32 = f32,
    F64 = f64,
}

/// An enum that travels as one byte.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnumShape {
    /// Its name.
    pub name: &'static str,
    /// What it says, line by line.
    pub docs: &'static [&'static str],
    /// The first is what an unknown code is taken for.
    pub variants: &'static [VariantShape],
}

/// One variant of an enum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VariantShape {
    /// Its name in the source.
    pub name: &'static str,
    /// Its name in logs and JSON.
    pub text: &'static str,
    /// The byte.
    pub code: u8,
    /// What it means, line by line.
    pub docs: &'static [&'static str],
}

/// A vector of three f64 in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QuantityShape {
    /// What it is: a point, a velocity.
    pub name: &'static str,
    /// Unit of each component.
    pub unit: &'static str,
    /// Frame of the components.
    pub frame: &'static str,
    /// Names of the components.
    pub components: [&'static str; 3],
}

/// A sample, or a part of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StructShape {
    /// Its name.
    pub name: &'static str,
    /// What it says, line by line.
    pub docs: &'static [&'static str],
    /// Bytes.
    pub size: usize,
    /// Alignment (bytes).
    pub align: usize,
    /// Its fields in the order of their offsets, without gaps.
    pub fields: &'static [FieldShape],
    /// Constants that its numbers depend on.
    pub means: &'static [Meaning],
}

/// One field of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldShape {
    /// Its name; its unit stands in it.
    pub name: &'static str,
    /// What it means, line by line.
    pub docs: &'static [&'static str],
    /// Where it begins (bytes).
    pub offset: usize,
    /// Bytes.
    pub size: usize,
    /// Its type.
    pub shape: Shape,
}

/// A constant of this build that the numbers in a sample depend on: builds in which it differs must not exchange the
/// sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meaning {
    /// Its name.
    pub name: &'static str,
    /// Its value.
    pub value: Value,
}

/// The value of such a constant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// A number.
    Float(f64),
    /// A count.
    Count(u64),
    /// What the elements of an array stand for, in order.
    Texts(&'static [&'static str]),
}

/// Named after the types of the constants: `sample!` says `means { CELL_M: f64 }`.
impl Value {
    /// Of a number.
    pub const fn f64(value: &f64) -> Self {
        Self::Float(*value)
    }

    /// Of a size.
    pub const fn usize(value: &usize) -> Self {
        Self::Count(*value as u64)
    }

    /// Of a list of names.
    pub const fn texts(value: &'static [&'static str]) -> Self {
        Self::Texts(value)
    }
}

impl Shape {
    /// Whether it is room that is reserved, or a field in such room: neither is part of the hash.
    pub const fn is_later(&self) -> bool {
        matches!(self, Self::Reserved(_) | Self::Added(_))
    }

    /// Bytes in memory.
    pub const fn size(&self) -> usize {
        match self {
            Self::Number(number) => number.size(),
            Self::Flag | Self::Enum(_) => 1,
            Self::Timestamp => 8,
            Self::Quantity(_) => 24,
            Self::Rotation { .. } => 32,
            Self::Array { of, len } => of.size() * *len,
            Self::Struct(shape) => shape.size,
            Self::Reserved(bytes) => *bytes,
            Self::Added(shape) => shape.size(),
        }
    }

    /// The layout hash. Two builds that have it in common read the same thing into the same bytes.
    pub const fn hash(&self) -> u64 {
        match self {
            Self::Number(number) => text(START, number.name()),
            Self::Flag => text(START, "Flag"),
            Self::Timestamp => text(START, "Timestamp"),
            Self::Enum(shape) => shape.hash(),
            Self::Quantity(shape) => shape.hash(),
            Self::Rotation { from, to } => text(text(text(START, "Rotation"), from), to),
            Self::Array { of, len } => number(number(text(START, "Array"), of.hash()), *len as u64),
            Self::Struct(shape) => shape.hash(),
            Self::Reserved(bytes) => number(text(START, "Reserved"), *bytes as u64),
            Self::Added(shape) => number(text(START, "Added"), shape.hash()),
        }
    }
}

impl EnumShape {
    const fn hash(&self) -> u64 {
        let mut hash = text(text(START, "Enum"), self.name);
        let mut i = 0;
        while i < self.variants.len() {
            hash = number(text(hash, self.variants[i].text), self.variants[i].code as u64);
            i += 1;
        }
        hash
    }
}

impl QuantityShape {
    const fn hash(&self) -> u64 {
        let [x, y, z] = self.components;
        let name = text(text(text(START, self.name), self.unit), self.frame);
        text(text(text(name, x), y), z)
    }
}

impl StructShape {
    const fn hash(&self) -> u64 {
        let mut hash = text(START, self.name);
        hash = number(number(hash, self.size as u64), self.align as u64);
        let mut i = 0;
        while i < self.fields.len() {
            let field = &self.fields[i];
            if !field.shape.is_later() {
                hash = number(text(hash, field.name), field.offset as u64);
                hash = number(hash, field.shape.hash());
            }
            i += 1;
        }
        i = 0;
        while i < self.means.len() {
            hash = self.means[i].value.hash(text(hash, self.means[i].name));
            i += 1;
        }
        hash
    }
}

impl Value {
    const fn hash(&self, hash: u64) -> u64 {
        match self {
            Self::Float(value) => number(hash, value.to_bits()),
            Self::Count(value) => number(hash, *value),
            Self::Texts(texts) => {
                let mut hash = number(hash, texts.len() as u64);
                let mut i = 0;
                while i < texts.len() {
                    hash = text(hash, texts[i]);
                    i += 1;
                }
                hash
            }
        }
    }
}
